"""Motion of chief and difference between epochs."""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import CHIEF, DEPUTY_5KM, J2, START
from scipy.linalg import expm

from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_nav.relative.common.dynamics import (
    MotionNoise,
    OrbitalMotion,
    TerrestrialMotion,
    ThrustInterval,
)
from vtff_nav.relative.kernels.motion import empirical_noise, white_acceleration_noise

NOISE = MotionNoise(empirical_sigma=1e-6)
PROCESS = (np.array([1e-6, 3e-6, 2e-7]), np.array([900.0, 600.0, 100.0]))
"""Sigmas and times of accelerations that differ between the axes."""


def motion(model: ForceModel = J2) -> OrbitalMotion:
    return OrbitalMotion(model, NOISE, NOISE)


def nine(state: np.ndarray) -> np.ndarray:
    return np.concatenate((state, np.zeros(3)))


@pytest.mark.parametrize("model", [J2, ForceModel(degree=8, order=8, drag="harris_priester")])
def test_follows_the_propagator(model):
    """Both spacecraft over a minute, with the thrust of some seconds."""
    chief, deputy = (Propagator(START, state, model) for state in (CHIEF, DEPUTY_5KM))
    thrust = [
        ThrustInterval(START + 10.0, 1.0, np.array([0.05, -0.02, 0.01])),
        ThrustInterval(START + 11.0, 1.0, np.array([0.0, 0.0, -0.05])),
    ]
    for second in range(60):
        acceleration = None
        for interval in thrust:
            if interval.start == START + float(second):
                rotation = rotation_gcrf_to_rtn(chief.state_gcrf)
                acceleration = rotation.T @ interval.acceleration_rtn
        chief.advance()
        deputy.advance(acceleration)
    predicted = motion(model).predict(START, 60.0, nine(CHIEF), nine(DEPUTY_5KM - CHIEF), thrust)
    np.testing.assert_allclose(predicted.chief[:6], chief.state_gcrf, rtol=0, atol=2e-5)
    difference = deputy.state_gcrf - chief.state_gcrf
    np.testing.assert_allclose(predicted.relative[:3], difference[:3], rtol=0, atol=1e-5)
    np.testing.assert_allclose(predicted.relative[3:6], difference[3:], rtol=0, atol=1e-7)


def test_follows_the_euler_steps_of_a_simulation():
    """Without a residual force, thrust included, however far apart the epochs are."""
    chief, deputy = (
        Propagator(START, state, J2, integrator="euler") for state in (CHIEF, DEPUTY_5KM)
    )
    thrust = [ThrustInterval(START + 3.0, 1.0, np.array([0.05, -0.02, 0.01]))]
    for second in range(10):
        acceleration = None
        if second == 3:
            acceleration = rotation_gcrf_to_rtn(chief.state_gcrf).T @ thrust[0].acceleration_rtn
        chief.advance()
        deputy.advance(acceleration)
    stepped = OrbitalMotion(J2, NOISE, NOISE, integrator="euler", longest_step=1.0)
    predicted = stepped.predict(START, 10.0, nine(CHIEF), nine(DEPUTY_5KM - CHIEF), thrust)
    np.testing.assert_allclose(predicted.chief[:6], chief.state_gcrf, rtol=0, atol=1e-6)
    difference = deputy.state_gcrf - chief.state_gcrf
    np.testing.assert_allclose(predicted.relative[:6], difference, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "text"), [({"integrator": "rk5"}, "rk5"), ({"longest_step": 0.0}, "longest_step")]
)
def test_integration_is_checked(wrong, text):
    with pytest.raises(ValueError, match=text):
        OrbitalMotion(J2, NOISE, NOISE, **wrong)


def test_thrust_in_the_middle_of_a_second():
    """Intervals need not begin at epochs, nor end there."""
    whole = [ThrustInterval(START + 0.25, 1.5, np.array([0.0, 0.04, 0.0]))]
    once = motion().predict(START, 3.0, nine(CHIEF), nine(DEPUTY_5KM - CHIEF), whole)
    relative, chief = nine(DEPUTY_5KM - CHIEF), nine(CHIEF)
    free = motion().predict(START, 3.0, chief, relative)
    gained = once.relative[3:6] - free.relative[3:6]
    along = rotation_gcrf_to_rtn(CHIEF)[1]
    assert gained @ along == pytest.approx(0.06, rel=1e-3)


def test_thrust_of_the_chief_moves_the_chief_and_the_difference():
    push = np.array([0.01, 0.04, -0.02])
    thrust = [ThrustInterval(START, 2.0, push, is_of_chief=True)]
    chief, relative = nine(CHIEF), nine(DEPUTY_5KM - CHIEF)
    pushed, free = (motion().predict(START, 2.0, chief, relative, t) for t in (thrust, ()))
    to_rtn = rotation_gcrf_to_rtn(CHIEF)
    gained = pushed.chief[3:6] - free.chief[3:6]
    assert to_rtn @ gained == pytest.approx(2.0 * push, rel=1e-3)
    # The deputy flies on as it was: the difference loses what the chief gains.
    deputies = [p.chief[:6] + p.relative[:6] for p in (pushed, free)]
    np.testing.assert_allclose(deputies[0], deputies[1], rtol=0.0, atol=1e-8)
    # Its error is in both covariances, and none of it in the errors of the deputy's thrust.
    assert (pushed.noise_chief - free.noise_chief)[3, 3] > 0.0
    assert (pushed.noise_relative - free.noise_relative)[3, 3] > 0.0
    assert not pushed.thrust_coupling.any()


@pytest.mark.parametrize("duration", [1.0, 30.0])
def test_transition_is_the_derivative(duration):
    """Finite differences; J2 is not in the matrix (0.3 percent of the gravity gradient)."""
    relative = nine(DEPUTY_5KM - CHIEF)
    relative[6:] = 1e-6
    predicted = motion().predict(START, duration, nine(CHIEF), relative)
    steps = np.repeat([10.0, 0.1, 1e-3], 3)
    for column, step in enumerate(steps):
        moved = relative.copy()
        moved[column] += step
        after = motion().predict(START, duration, nine(CHIEF), moved)
        derivative = (after.relative - predicted.relative) / step
        expected = predicted.transition_relative[:, column]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(derivative, expected, rtol=0.02, atol=2e-5 * scale)


def test_noise_of_two_steps_is_that_of_one():
    """Q(2 dt) = Phi Q(dt) Phi' + Q(dt) of the triple integrator."""
    axes = rotation_gcrf_to_rtn(CHIEF).T
    phi = np.eye(9)
    phi[:3, 3:6] = np.eye(3)
    phi[:3, 6:] = 0.5 * axes
    phi[3:6, 6:] = axes
    one, two = empirical_noise(*PROCESS, axes, 1.0), empirical_noise(*PROCESS, axes, 2.0)
    np.testing.assert_allclose(phi @ one @ phi.T + one, two, rtol=1e-9, atol=1e-30)
    assert np.linalg.eigvalsh(one / one.max()).min() > -1e-12


def integrated_noise(drift: np.ndarray, density: np.ndarray, duration: float) -> np.ndarray:
    """Return the integral of Phi(t) density Phi(t)' over a duration, by Gauss-Legendre nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = np.zeros_like(density)
    for node, weight in zip(nodes, weights, strict=True):
        phi = expm(0.5 * duration * (1.0 + node) * drift)
        total += 0.5 * duration * weight * phi @ density @ phi.T
    return total


@pytest.mark.parametrize("step", [0.25, 1.0, 5.0])
def test_white_acceleration_is_integrated_twice(step):
    """Process noise and a covariance that stays positive: position and velocity are correlated."""
    drift, density = np.zeros((9, 9)), np.zeros((9, 9))
    drift[:3, 3:6] = np.eye(3)
    density[3:6, 3:6] = 0.3**2 * np.eye(3)
    noise = white_acceleration_noise(0.3, step)
    np.testing.assert_allclose(noise, integrated_noise(drift, density, step), rtol=1e-12)
    eigenvalues = np.linalg.eigvalsh(noise[:6, :6])
    assert eigenvalues.min() > 1e-3 * 0.3**2 * min(step, step**3)
    # The correlation of the integral of white noise with its own integral.
    correlation = noise[0, 3] / np.sqrt(noise[0, 0] * noise[3, 3])
    assert correlation == pytest.approx(np.sqrt(3.0) / 2.0)


@pytest.mark.parametrize("step", [0.25, 1.0, 5.0])
def test_empirical_acceleration_is_integrated_three_times(step):
    axes = rotation_gcrf_to_rtn(CHIEF).T
    drift, density = np.zeros((9, 9)), np.zeros((9, 9))
    drift[:3, 3:6] = np.eye(3)
    drift[3:6, 6:] = axes
    density[6:, 6:] = np.diag(2.0 * PROCESS[0] ** 2 / PROCESS[1])
    expected = integrated_noise(drift, density, step)
    noise = empirical_noise(*PROCESS, axes, step)
    np.testing.assert_allclose(noise, expected, rtol=1e-9, atol=1e-9 * density.max())
    np.testing.assert_array_equal(noise, noise.T)


def test_gradients_change_faster_than_the_other_accelerations():
    """Variance and spectral density are the sums of those of both processes."""
    noise = MotionNoise(3e-8, empirical_time=900.0, gradient_sigma=1e-11, gradient_time=100.0)
    alone, together = noise.at_distance(0.0), noise.at_distance(4e3)
    np.testing.assert_allclose(alone.sigma, 3e-8)
    np.testing.assert_allclose(alone.time, 900.0)
    np.testing.assert_allclose(together.sigma, 5e-8)
    density = 2.0 * together.sigma**2 / together.time
    np.testing.assert_allclose(density, 2.0 * (3e-8**2 / 900.0 + 4e-8**2 / 100.0))
    np.testing.assert_allclose(noise.at_distance(4e3, factor=2.0).sigma, 2.0 * together.sigma)
    np.testing.assert_allclose(noise.at_distance(4e3, factor=2.0).time, together.time)


def test_accelerations_across_the_track_are_those_stated_for_it():
    noise = MotionNoise(5e-8, gradient_sigma=1e-11, gradient_time=100.0, across_sigma=6e-9)
    np.testing.assert_allclose(noise.at_distance(0.0).sigma, [6e-9, 5e-8, 6e-9])
    np.testing.assert_allclose(noise.at_distance(800.0).sigma, [1e-8, np.hypot(5e-8, 8e-9), 1e-8])
    # Gradients are more of what acts across the track, so that it changes faster.
    times = noise.at_distance(800.0).time
    assert times[0] == times[2] < times[1] < 900.0
    model = OrbitalMotion(ForceModel(gravity="two_body"), MotionNoise(0.0), noise)
    predicted = model.predict(START, 1.0, nine(CHIEF), np.zeros(9))
    expected = 2.0 / 900.0 * np.array([6e-9, 5e-8, 6e-9]) ** 2
    np.testing.assert_allclose(np.diagonal(predicted.noise_relative)[6:], expected, rtol=1e-9)


def test_no_acceleration_has_a_time_too():
    noise = MotionNoise(0.0, empirical_time=700.0).at_distance(1e3)
    np.testing.assert_array_equal(noise.sigma, np.zeros(3))
    np.testing.assert_array_equal(noise.time, np.full(3, 700.0))


@pytest.mark.parametrize(("distance", "time"), [(0.0, 900.0), (2e5, 100.0)])
def test_the_relative_acceleration_decays_with_the_time_of_its_distance(distance, time):
    noise = MotionNoise(1e-9, gradient_sigma=1e-11)
    motion = OrbitalMotion(ForceModel(gravity="two_body"), MotionNoise(0.0), noise)
    relative = np.zeros(9)
    relative[1], relative[6] = distance, 1e-6
    predicted = motion.predict(START, 10.0, nine(CHIEF), relative)
    assert predicted.relative[6] == pytest.approx(1e-6 * np.exp(-10.0 / time), rel=1e-3)
    assert predicted.transition_relative[6, 6] == pytest.approx(np.exp(-10.0 / time), rel=1e-3)


def test_error_of_thrust_is_noise():
    thrust = [ThrustInterval(START, 1.0, np.array([0.0, 0.05, 0.0]))]
    arguments = (START, 1.0, nine(CHIEF), nine(DEPUTY_5KM - CHIEF), thrust)
    free = motion().predict(*arguments).noise_relative
    noisy = motion().predict(*arguments, thrust_sigma=0.01).noise_relative
    assert np.sqrt((noisy - free)[4, 4]) == pytest.approx(0.0005, rel=1e-6)
    np.testing.assert_allclose(noisy - free, white_acceleration_noise(0.0005, 1.0), atol=1e-12)


@pytest.mark.parametrize("error", range(4))
def test_effect_of_scale_and_misalignment_of_the_thrust_is_the_derivative(error):
    acceleration = np.array([0.4, -0.9, 0.3])
    small = 1e-3
    wrong = acceleration * (1.0 + small)
    if error:
        wrong = acceleration + small * np.cross(np.eye(3)[error - 1], acceleration)
    predicted, disturbed = (
        motion().predict(
            START, 6.0, nine(CHIEF), nine(DEPUTY_5KM - CHIEF), [ThrustInterval(START + 1.0, 1.0, a)]
        )
        for a in (acceleration, wrong)
    )
    derivative = (disturbed.relative - predicted.relative)[:6] / small
    assert np.linalg.norm(derivative[:3]) > 1.0
    coupling = predicted.thrust_coupling[:6, error]
    np.testing.assert_allclose(coupling[:3], derivative[:3], rtol=0, atol=1e-3)
    np.testing.assert_allclose(coupling[3:], derivative[3:], rtol=0, atol=1e-3)


@pytest.mark.parametrize("thrust_sigma", [0.0, 0.01])
def test_covariance_of_many_epochs_stays_positive(thrust_sigma):
    """An hour of epochs with thrust: the noise never makes a variance negative."""
    state, covariance = nine(DEPUTY_5KM - CHIEF), np.zeros((9, 9))
    thrust = [ThrustInterval(START, 3600.0, np.array([0.0, 0.05, 0.0]))]
    predicted = motion().predict(START, 10.0, nine(CHIEF), state, thrust, thrust_sigma)
    for _ in range(360):
        phi = predicted.transition_relative
        covariance = phi @ covariance @ phi.T + predicted.noise_relative
    scale = np.sqrt(covariance.diagonal())
    assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > 0.0


def test_on_the_ground():
    state = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0])
    still = np.array([4e6, 0.0, 5e6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    moving = TerrestrialMotion("static", "kinematic", NOISE, NOISE)
    predicted = moving.predict(START, 2.0, still, state)
    np.testing.assert_array_equal(predicted.chief, still)
    np.testing.assert_allclose(predicted.relative[:3], [1.2, 2.4, 3.6])
    assert not predicted.noise_chief.any()
    expected = white_acceleration_noise(NOISE.kinematic_acceleration, 2.0)
    np.testing.assert_array_equal(predicted.noise_relative, expected)
    assert predicted.noise_relative[3, 3] == pytest.approx(200.0)

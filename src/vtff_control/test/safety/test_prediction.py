"""Free motion of pairs: against the full propagator, and its covariance against drawn flights."""

import math

import numpy as np
import pytest
from safety_samples import CHIEF, COVARIANCE, predict_formation, relative

from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.relative.designs import helix, projected_circular_track_normal
from vtff_dynamics.relative.relative_elements import relative_state_of_elements
from vtff_dynamics.time.timescales import parse_epoch

EPOCH = parse_epoch("2016-03-21T01:00:00 GPS")


def predict(states, covariances=None, orbits=2.0, hard_radius=30.0, clear_radius=32.0):
    motion = predict_formation(states, covariances, orbits)
    return motion, motion.predict_pair(0, 1, hard_radius, clear_radius, 3.7)


def test_closest_approach_of_a_fast_deputy_between_samples():
    """It passes the chief at 20 m/s; truth by steps of 0.1 s with 8x8 gravity."""
    state = relative(r=20.0, t=700.0, n=45.0, vt=-20.0)
    _, pair = predict([state])
    truth = [
        Propagator(EPOCH, start, ForceModel(), step=0.1)
        for start in (CHIEF, deputy_state_gcrf(CHIEF, state))
    ]
    distances = []
    for _ in range(600):
        chief, deputy = (propagator.advance() for propagator in truth)
        distances.append(np.linalg.norm(deputy[:3] - chief[:3]))
    assert pair.separation == pytest.approx(min(distances), abs=0.1)
    assert pair.separation_time == pytest.approx(0.1 * (1 + np.argmin(distances)), abs=0.3)


def test_two_orbits_of_a_formation():
    states = [
        relative_state_of_elements(CHIEF, design)
        for design in (
            projected_circular_track_normal(80.0, 0.2),
            helix(50.0, 60.0, 0.2),
            helix(50.0, 60.0, 0.2 + math.pi),
        )
    ]
    motion, pco = predict(states)
    assert motion.names == ("chief", "deputy0", "deputy1", "deputy2")
    assert pco.radial_normal < 1.0  # a projected circle is not passively safe
    helical = motion.predict_pair(0, 2, 30.0, 32.0, 3.7)
    assert helical.radial_normal == pytest.approx(50.0, abs=2.0)
    assert helical.violation_time == math.inf
    opposite = motion.predict_pair(2, 3, 30.0, 32.0, 3.7)
    assert opposite.radial_normal == pytest.approx(100.0, abs=4.0)
    assert (opposite.first, opposite.second) == ("deputy1", "deputy2")


def test_covariance_is_that_of_drawn_flights():
    sigma = np.array([0.5, 0.8, 0.3, 1e-3, 2e-3, 1e-3])
    mean = relative(t=2000.0, n=100.0, vr=0.05)
    motion, _ = predict([mean], [np.diag(sigma**2)], orbits=1.0)
    drawn = mean + sigma * np.random.default_rng(1).standard_normal((400, 6))
    flown, _ = predict(list(drawn), [COVARIANCE] * 400, orbits=1.0)
    for index in (40, 120, len(motion.times) - 1):
        frame = rotation_gcrf_to_rtn(CHIEF)
        ends = flown.relative[1:, index, :3] @ frame.T
        expected = frame @ motion.covariances[1][index] @ frame.T
        np.testing.assert_allclose(
            np.sqrt(np.diag(np.cov(ends.T))), np.sqrt(np.diag(expected)), rtol=0.12
        )


def test_in_track_uncertainty_does_not_alarm_where_the_plane_across_is_safe():
    """A helix 50 m across is clear although its in-track sigma reaches the chief."""
    uncertain = np.diag([0.1**2] * 3 + [2e-4**2, 3e-3**2, 2e-4**2])
    across = relative_state_of_elements(CHIEF, helix(60.0, 60.0, 0.2))
    _, safe = predict([across], [uncertain])
    assert safe.violation_time == math.inf
    assert safe.probability < 1e-4
    _, follower = predict([relative(t=100.0)], [uncertain])
    assert follower.violation_time < 1e4
    assert follower.probability > 1e-3


def test_probability_of_a_fly_by_is_that_of_drawn_ones():
    covariance = np.diag([15.0**2, 15.0**2, 15.0**2, 0.2**2, 0.2**2, 0.2**2])
    state = relative(r=25.0, t=600.0, n=10.0, vt=-15.0)
    _, pair = predict([state], [covariance])
    generator = np.random.default_rng(2)
    drawn = state + np.sqrt(np.diag(covariance)) * generator.standard_normal((4000, 6))
    inside = 0
    times = np.linspace(20.0, 60.0, 200)
    for start in drawn:  # straight in a rotating frame is good to a metre for a minute
        turn = 2.0 * math.pi / 5739.0
        position = start[:3, np.newaxis] + start[3:, np.newaxis] * times
        position[0] += turn * start[4] * times**2
        inside += np.linalg.norm(position, axis=0).min() < 30.0
    assert pair.probability == pytest.approx(inside / len(drawn), rel=0.15)

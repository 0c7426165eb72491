"""Scintillating phases in the relative filter: more noise, not slips, and no wrong integers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from cdgps_test_support import CHIEF, START, configuration, fly, simulate
from cdgps_truth_support import wrong_integers
from scipy.spatial.transform import Rotation

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.measurement_faults import reject_faults
from vtff_nav.relative.cdgps.phase_scatter import PhaseScatter, SlipRate, epochs_to_average
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion

WAVELENGTH, STATED, LIMIT = 0.19, 2e-6, 5.0
COUNT = 8


def everywhere(s4: float) -> IrregularityRegion:
    """Return plasma that scintillates around the spacecraft at all local times."""
    quarter = 0.5 * math.pi
    return IrregularityRegion("all", -quarter, quarter, 0.0, 24.0, 450e3, 700e3, s4, 0.5)


def east_of_90_s(s4: float) -> IrregularityRegion:
    """Return plasma that begins where the chief is after 90 s."""
    moment = START + 90.0
    state = free_flight(CHIEF[np.newaxis], np.arange(0.0, 91.0, 10.0))[-1, 0]
    _, longitude, _ = geodetic_from_itrf(rotation_gcrf_to_itrf(moment) @ state[:3])
    west = mean_solar_local_time_hours(moment, float(longitude))
    limits = {"local_time_start_hours": west, "local_time_end_hours": (west + 3.0) % 24.0}
    return dataclasses.replace(everywhere(s4), **limits)


def behind(seconds: float) -> np.ndarray:
    """Return the state of a deputy that passes where the chief does, later."""
    normal = np.cross(CHIEF[:3], CHIEF[3:])
    rate = np.linalg.norm(normal) / (CHIEF[:3] @ CHIEF[:3])
    turn = Rotation.from_rotvec(-seconds * rate * normal / np.linalg.norm(normal))
    return np.concatenate((turn.apply(CHIEF[:3]), turn.apply(CHIEF[3:])))


def differences(phase: np.ndarray) -> SingleDifferences:
    """Return L1 phases of `COUNT` satellites, with codes that say nothing."""
    empty = np.zeros(COUNT)
    return SingleDifferences(
        keys=[SignalKey(0, prn, 1, ord("C")) for prn in range(1, COUNT + 1)],
        satellite=np.arange(COUNT),
        wavelength=np.full(COUNT, WAVELENGTH),
        frequency_hz=np.full(COUNT, 1575.42e6),
        code=empty,
        phase=phase,
        code_variance=np.full(COUNT, 1e4),
        phase_variance=np.full(COUNT, STATED),
        is_parity_known=np.ones(COUNT, dtype=bool),
        half_cycles=np.zeros(COUNT, dtype=np.int64),
        is_lock_lost=np.zeros(COUNT, dtype=bool),
        lock_time=np.zeros((2, COUNT)),
        noise_growth=np.ones(COUNT),
    )


CODE_STATE = GaussianState([("code",)], np.zeros(1), np.eye(1))
CODE_DESIGN = np.repeat([[1.0], [0.0]], COUNT, axis=0)


def innovation_of(measured: SingleDifferences, state=CODE_STATE, design=CODE_DESIGN):
    """Return the innovation where all phases have one unknown mean, and codes another."""
    nuisance = np.repeat([[0.0], [1.0]], COUNT, axis=0)
    values = np.concatenate((measured.code, measured.phase))
    variances = np.concatenate((measured.code_variance, measured.phase_variance))
    return state.innovation(design, values, variances, nuisance)


def learned(sigma: np.ndarray, epochs: int, scatter: PhaseScatter, seed: int) -> PhaseScatter:
    """Show phases of some sigmas to a scatter."""
    random = np.random.default_rng(seed)
    for epoch in range(epochs):
        stated = differences(sigma * random.standard_normal(COUNT))
        measured = scatter.add_excess(stated)
        search = reject_faults(
            innovation_of(measured), measured, scatter.is_scattered(measured), LIMIT
        )
        raised = search.innovation.noise[COUNT:] > measured.phase_variance
        scatter.learn(START + float(epoch), stated, search.innovation, raised)
    return scatter


def test_quiet_phases_are_believed():
    scatter = learned(np.full(COUNT, math.sqrt(STATED)), 2000, PhaseScatter(), 1)
    quiet = differences(np.zeros(COUNT))
    assert scatter.add_excess(quiet) is quiet


@pytest.mark.parametrize("scattered", [3e-3, 9e-3, 20e-3])
def test_variances_are_followed(scattered):
    """Up where there is scatter, and only there; back when it is over."""
    sigma = np.full(COUNT, math.sqrt(STATED))
    noisy = np.where(np.arange(COUNT) < 3, scattered, sigma)
    scatter, found = PhaseScatter(), []
    for block in range(200):
        learned(noisy, 10, scatter, block)
        found.append(scatter.add_excess(differences(np.zeros(COUNT))).phase_variance)
    mean = np.mean(found, axis=0)
    assert np.all(mean[3:] < 1.2 * STATED)
    assert np.sqrt(mean[:3]) == pytest.approx(scattered, rel=0.2)
    learned(sigma, 150, scatter, 1)
    assert not scatter.is_scattered(differences(np.zeros(COUNT))).any()


def test_slow_change_is_no_scatter():
    """Residuals that motion or plasma shifts step by step do not pass for noise."""
    drift, scatter = np.where(np.arange(COUNT) < 2, 0.3e-3, 0.0), PhaseScatter()
    random = np.random.default_rng(3)
    for epoch in range(20):
        phase = epoch * drift + math.sqrt(STATED) * random.standard_normal(COUNT)
        measured = differences(phase)
        innovation = innovation_of(measured)
        scatter.learn(START + float(epoch), measured, innovation, np.zeros(COUNT, bool))
    assert np.abs(innovation.normalised[COUNT : COUNT + 2]).max() > 2.0
    assert not scatter.is_scattered(measured).any()


def test_slip_and_scatter():
    """Less than a quarter of a cycle is noise, more is a slip, whatever noise is known of."""
    measured = differences(np.zeros(COUNT))
    measured.phase[1], measured.phase[4] = 0.24 * WAVELENGTH, -0.5 * WAVELENGTH
    search = reject_faults(innovation_of(measured), measured, np.zeros(COUNT, bool), LIMIT)
    assert sorted(search.faulty_phases) == [1, 4]
    assert search.count_satellites(measured, np.ones(len(measured), dtype=bool)) == 2
    assert np.flatnonzero(~search.innovation.is_used).tolist() == [COUNT + 4]
    assert search.innovation.noise[COUNT + 1] > (0.2 * WAVELENGTH) ** 2
    measured.phase_variance[4] = (0.2 * WAVELENGTH) ** 2
    for is_known in (False, True):
        scattered = np.full(COUNT, is_known)
        search = reject_faults(innovation_of(measured), measured, scattered, LIMIT)
        assert search.innovation.is_used[COUNT + 4] != is_known


@pytest.mark.parametrize(("prediction_over_noise", "is_slip"), [(0.5, True), (2.0, False)])
def test_only_a_precise_prediction_tells_a_slip_from_scatter(prediction_over_noise, is_slip):
    """Half a cycle of a phase whose noise is most of its variance, and of one whose is not."""
    measured = differences(np.zeros(COUNT))
    measured.phase[4] = 0.5 * WAVELENGTH
    measured.phase_variance[4] = (0.2 * WAVELENGTH) ** 2
    covariance = np.diag([1.0, prediction_over_noise * measured.phase_variance[4]])
    state = GaussianState([("code",), ("ambiguity",)], np.zeros(2), covariance)
    design = np.zeros((2 * COUNT, 2))
    design[:COUNT, 0] = design[COUNT + 4, 1] = 1.0
    innovation = innovation_of(measured, state, design)
    search = reject_faults(innovation, measured, np.ones(COUNT, bool), LIMIT)
    assert search.innovation.is_used[COUNT + 4] != is_slip


def test_epochs_to_average():
    assert epochs_to_average(STATED, WAVELENGTH, 0.05) == 1
    assert epochs_to_average((0.1 * WAVELENGTH) ** 2, WAVELENGTH, 0.05) == 4


@pytest.mark.parametrize("seed", [1, 2])
def test_scintillation(seed):
    """Weak enough that no phase runs around a fade: every integer right, every epoch fixed."""
    scenario = simulate(120, behind(2.0), seed, regions=[everywhere(0.25)])
    flight = fly(scenario, configuration())
    wrong = [wrong_integers(scenario.truth, k, s) for k, s in enumerate(flight.solutions)]
    assert not any(wrong)
    assert flight.is_fixed[60:].all()
    # Noise of 5 and 9 mm on each carrier instead of 1.4 mm.
    assert flight.rms() < 10e-3
    assert not any(s.degraded for s in flight.solutions[60:])


@pytest.mark.parametrize("seed", [1, 2])
def test_scintillation_of_the_whole_sky_is_no_motion(seed):
    """From 90 s on every ray crosses plasma; taken for motion, velocities erred by 5 to 8 cm/s."""
    flight = fly(simulate(150, behind(2.0), seed, regions=[east_of_90_s(0.5)]), configuration())
    assert not any("motion" in text for s in flight.solutions[60:] for text in s.degraded)
    assert np.abs(flight.error_rtn[60:, 3:]).max() < 15e-3


@pytest.mark.parametrize("is_orbital", [True, False])
def test_signals_whose_scatter_is_not_seen_have_that_of_the_others(is_orbital):
    """Half of the ambiguities are not known: nothing shows the noise of their phases."""
    random, scatter, epoch = np.random.default_rng(5), PhaseScatter(is_orbital), 0
    hidden = np.arange(COUNT) >= 4
    labels = [("code",), *(("ambiguity", row) for row in np.flatnonzero(hidden))]
    design = np.zeros((2 * COUNT, len(labels)))
    design[:COUNT, 0] = 1.0
    design[COUNT + np.flatnonzero(hidden), np.arange(1, len(labels))] = 1.0

    def show(sigma: float, unknown: float, epochs: int) -> float:
        """Return the mean excess of the hidden signals after some epochs."""
        nonlocal epoch
        covariance = np.diag([1.0] + [unknown**2] * (len(labels) - 1))
        for _ in range(epochs):
            phase = math.hypot(sigma, math.sqrt(STATED)) * random.standard_normal(COUNT)
            stated = differences(phase)
            state = GaussianState(labels, np.zeros(len(labels)), covariance)
            measured = scatter.add_excess(stated)
            innovation = innovation_of(measured, state, design)
            search = reject_faults(innovation, measured, scatter.is_scattered(measured), LIMIT)
            raised = search.innovation.noise[COUNT:] > measured.phase_variance
            scatter.learn(START + float(epoch), stated, search.innovation, raised)
            epoch += 1
        return float(scatter.variances(differences(np.zeros(COUNT)))[hidden].mean())

    assert show(0.0, 10.0, 20) == 0.0
    excess = show(20e-3, 10.0, 60)
    assert scatter.is_common == is_orbital
    assert math.sqrt(excess) == pytest.approx(20e-3 if is_orbital else 0.0, rel=0.4)
    # Quiet again: also where each prediction is too imprecise to show it alone.
    assert show(0.0, 0.04, 150) < (2e-3) ** 2
    assert not scatter.is_common


def test_slips_count_where_they_would_show():
    """Rare slips are found one by one; frequent ones also occur where nothing shows them."""
    rate = SlipRate()
    for epoch in range(300):
        rate.count(int(epoch % 10 == 0), 10, 1.0)
    assert rate.rate == 0.0
    for _ in range(100):
        rate.count(1, 10, 1.0)
    assert rate.rate == pytest.approx(0.1, rel=0.05)
    for _ in range(120):
        rate.count(0, 0, 1.0)
    assert rate.rate == 0.0


def test_fades_of_the_whole_sky_leave_an_honest_covariance():
    """Two minutes of them; with every jump taken for motion of the chief NEES was 40."""
    flight = fly(simulate(200, behind(2.0), 1, regions=[east_of_90_s(0.8)]), configuration())
    covariance = np.array([s.covariance_rtn[:3, :3] for s in flight.solutions[60:]])
    error = flight.error_rtn[60:, :3]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error) / 3.0
    assert nees.mean() < 2.0
    assert np.abs(error).max() < 40e-3

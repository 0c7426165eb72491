"""The filter of the testbed paper: its parts against references, the whole on emulated flights."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from cdgps_test_support import simulate
from scipy.linalg import expm
from shared_data import require_shared

from vtff_dynamics.constants import EARTH_ROTATION_RATE, GM_EARTH
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.relative.motion import hcw_transition_matrix
from vtff_dynamics.time.timescales import parse_epoch
from vtff_dynamics.vectors import skew
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_gnss.rinex.observation import read_rinex_observation
from vtff_nav.relative.common.solution import (
    SOLUTION_FLOAT,
    SOLUTION_NONE,
    SOLUTION_PREDICTED,
    RelativeSolution,
)
from vtff_nav.relative.paper.estimator import PaperConfiguration, PaperEstimator
from vtff_nav.relative.paper.filter import (
    CLOCK,
    MOTION,
    STATES,
    CarrierPhaseFilter,
    process_noise,
    state_jacobian,
)
from vtff_sim_bridge.gnss.faults import Fault

NAVIGATION = "data/navigation"
PAPER_RMS = np.array([0.49, 0.19, 0.18])  # m; table A1: what the closed loop kept
TWO_BODY = ForceModel("two_body")


# --- parts ------------------------------------------------------------------------------------


def test_transition_agrees_with_hill_clohessy_wiltshire():
    """Another derivation: Hill's equations, carried from the RTN axes to the turning Earth."""
    time, duration = parse_epoch("2016-03-21T01:00:00 GPS"), 10.0
    radius = 6928137.0
    rate = np.sqrt(GM_EARTH / radius**3)
    speed = rate * radius
    inclination = np.radians(60.0)
    chief = np.array([radius, 0, 0, 0, speed * np.cos(inclination), speed * np.sin(inclination)])
    later = Propagator(time, chief, TWO_BODY, step=duration).advance()
    relative = np.array([30.0, -80.0, 50.0, 0.05, -0.03, 0.02])

    def to_itrf(at, state_chief, rtn):
        to_gcrf = rotation_gcrf_to_rtn(state_chief).T
        velocity = rtn[3:] + np.cross([0.0, 0.0, rate], rtn[:3])
        return state_gcrf_to_itrf(at, np.concatenate((to_gcrf @ rtn[:3], to_gcrf @ velocity)))

    expected = to_itrf(time + duration, later, hcw_transition_matrix(rate, duration) @ relative)
    # The gradient is held over the step: taken in its middle it is right to third order.
    middle = Propagator(time, chief, TWO_BODY, step=duration / 2).advance()
    jacobian = state_jacobian(middle[:3], rotation_gcrf_to_itrf(time + duration / 2))
    state = np.zeros(STATES)
    state[list(MOTION)] = to_itrf(time, chief, relative)
    predicted = expm(duration * jacobian) @ state
    np.testing.assert_allclose(predicted[:3], expected[:3], atol=1e-4)
    np.testing.assert_allclose(predicted[4:7], expected[3:], atol=2e-5)


def test_clock_states_are_a_line_and_independent_of_motion():
    jacobian = state_jacobian([7e6, 0.0, 0.0], np.eye(3))
    transition = expm(3.0 * jacobian)
    np.testing.assert_allclose(transition[3, [3, 7]], [1.0, 3.0], rtol=1e-14)
    assert not transition[3, list(MOTION)].any()
    assert not transition[list(MOTION), 3].any()
    # Far from the Earth only the rotation of the axes is left: straight lines, seen turning.
    far = expm(100.0 * state_jacobian([1e12, 0.0, 0.0], np.eye(3)))
    angle = 100.0 * EARTH_ROTATION_RATE
    turn = np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    inertial = 100.0 * skew([0.0, 0.0, EARTH_ROTATION_RATE])
    np.testing.assert_allclose(far[:3, 4:7], 100.0 * turn, atol=1e-9)
    np.testing.assert_allclose(far[:3, :3], turn @ (np.eye(3) + inertial), atol=1e-9)


def test_process_noise_is_the_integral_of_white_noise():
    """Van Loan's matrix exponential gives the same Q."""
    duration, density = 2.5, np.diag([0, 0, 0, 0.3**2, 1e-4, 1e-4, 1e-4, 0.5**2])
    line = np.zeros((STATES, STATES))
    line[:3, 4:7] = np.eye(3)
    line[3, 7] = 1.0
    block = np.block([[-line, density], [np.zeros_like(line), line.T]])
    exponential = expm(duration * block)
    expected = exponential[STATES:, STATES:].T @ exponential[:STATES, STATES:]
    np.testing.assert_allclose(process_noise(duration, 1e-2, 0.3, 0.5), expected, atol=1e-12)


def test_update_of_any_size_agrees_with_the_information_form():
    generator = np.random.default_rng(4)
    root = generator.normal(size=(STATES, STATES))
    for count in (1, 4, 12):
        prior, mean = root @ root.T, generator.normal(size=STATES)
        direction = generator.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        variances = generator.uniform(0.5, 2.0, count)
        residual = generator.normal(size=count)
        estimate = CarrierPhaseFilter(mean.copy(), prior.copy())
        estimate.update_phases(residual, direction, variances)
        design = np.zeros((count, STATES))
        design[:, :3], design[:, CLOCK] = direction, 1.0
        information = np.linalg.inv(prior) + design.T @ np.diag(1.0 / variances) @ design
        covariance = np.linalg.inv(information)
        expected = mean + covariance @ design.T @ (residual / variances)
        assert estimate.x.shape == (STATES,)
        np.testing.assert_allclose(estimate.x, expected, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(estimate.P, covariance, rtol=1e-8, atol=1e-10)
        np.testing.assert_array_equal(estimate.P, estimate.P.T)
        squared, degrees = estimate.innovation
        scatter = design @ prior @ design.T + np.diag(variances)
        assert squared == pytest.approx(residual @ np.linalg.solve(scatter, residual))
        assert degrees == count


def test_millimetres_after_a_start_from_codes():
    """filterpy inverts S explicitly; with the widest clock that is let in nothing is lost."""
    prior = np.diag([1.0, 1.0, 1.0, 30.0**2, 1.0, 1.0, 1.0, 1.0])
    estimate = CarrierPhaseFilter(np.zeros(STATES), prior.copy())
    direction = np.vstack((np.eye(3), -np.eye(3), np.full((1, 3), 3**-0.5)))
    estimate.update_phases(np.zeros(7), direction, np.full(7, 2e-6))
    design = np.zeros((7, STATES))
    design[:, :3], design[:, CLOCK] = direction, 1.0
    expected = np.linalg.inv(np.linalg.inv(prior) + design.T @ design / 2e-6)
    np.testing.assert_allclose(estimate.P, expected, rtol=1e-4, atol=1e-12)
    assert np.sqrt(estimate.P[0, 0]) < 2e-3


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"start_duration": 0.0}, "start_duration"), ({"bands": {0: ()}}, "bands")],
)
def test_wrong_parameters_are_named(changes, words):
    with pytest.raises(ValueError, match=words):
        PaperConfiguration(**changes)


def test_wrong_thrust_is_refused():
    estimator = PaperEstimator()
    time = parse_epoch("2016-03-21T01:00:00 GPS")
    with pytest.raises(ValueError, match="acceleration_rtn"):
        estimator.add_thrust(time, 1.0, [0.0, np.nan, 0.0])
    with pytest.raises(ValueError, match="duration"):
        estimator.add_thrust(time, 0.0, [0.0, 1.0, 0.0])


def test_nothing_is_known_without_observations():
    estimator = PaperEstimator()
    time = parse_epoch("2016-03-21T01:00:00 GPS")
    solution = estimator.process(time, None, None)
    assert solution.solution == SOLUTION_NONE
    assert solution.degraded == ("the chief has no position yet",)
    assert np.isnan(solution.position_rtn).all()
    with pytest.raises(ValueError, match="not after"):
        estimator.process(time, None, None)


# --- the whole, on flights --------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Flight:
    """Observations of two receivers 250 m apart, by seconds, and their true baseline."""

    ephemerides: Sequence[BroadcastEphemeris]
    receivers: list[ObservationTable]
    baseline_itrf: np.ndarray

    @classmethod
    def emulated(cls, seconds: int, faults: Sequence[Fault] = ()) -> Flight:
        """Return a flight of the emulated receivers."""
        scenario = simulate(seconds, faults=faults)
        difference = scenario.deputy_gcrf - scenario.chief_gcrf
        times = [scenario.start + float(second) for second in range(seconds)]
        return cls(
            scenario.ephemerides,
            [ObservationTable.from_epochs(r.values()) for r in (scenario.chief, scenario.deputy)],
            np.array(
                [rotation_gcrf_to_itrf(t) @ d[:3] for t, d in zip(times, difference, strict=True)]
            ),
        )

    @classmethod
    def recorded(cls) -> Flight:
        """Return the 100 minutes of leo_250m."""
        folder = require_shared(f"{NAVIGATION}/leo_250m")
        navigation = require_shared(f"{NAVIGATION}/spirent_dynamic/RINEX_GN_Spirent.23N")
        truth = np.load(folder / "250m_truth.npz")
        return cls(
            read_rinex_navigation(navigation).ephemerides,
            [read_rinex_observation(folder / f"250m_{name}.obs.gz").table for name in "AB"],
            truth["B"] - truth["A"],
        )

    def estimator(self, **changes) -> PaperEstimator:
        # The flight was computed with a point mass and J2.
        force_model = ForceModel("spherical_harmonics", 2, 0)
        estimator = PaperEstimator(PaperConfiguration(force_model=force_model, **changes))
        for ephemeris in self.ephemerides:
            estimator.add_ephemeris(ephemeris)
        return estimator

    def process(self, estimator, index, change=None) -> RelativeSolution:
        """Process the epoch of a second; `change` may replace the epochs of both receivers."""
        epochs = [table.epoch(index) for table in self.receivers]
        if change is not None:
            epochs = change(index, *epochs)
        return estimator.process(self.receivers[0].time(index), *epochs)

    def errors_rtn(self, solutions) -> np.ndarray:
        """Return errors of position, shape (n, 3), of solutions by number of the epoch."""
        errors = []
        for index, solution in solutions.items():
            chief = np.concatenate((solution.position_chief_gcrf, solution.velocity_chief_gcrf))
            to_gcrf = rotation_gcrf_to_itrf(solution.time).T
            error = solution.position_itrf - self.baseline_itrf[index]
            errors.append(rotation_gcrf_to_rtn(chief) @ to_gcrf @ error)
        return np.array(errors)


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight.emulated(400)


@pytest.fixture(scope="module")
def recorded_flight() -> Flight:
    return Flight.recorded()


def deputy_changed(epoch, chosen, **columns):
    """Return an epoch with other values in the rows chosen."""
    changed = {}
    for name, change in columns.items():
        column = getattr(epoch, name).copy()
        column[chosen] = change(column[chosen])
        changed[name] = column
    return dataclasses.replace(epoch, **changed)


@pytest.mark.parametrize("first", [0, 200])
def test_errors_are_far_below_those_of_the_paper(flight, first):
    assert_accuracy(flight, first)


def test_errors_of_the_recorded_flight_are_far_below_those_of_the_paper(recorded_flight):
    for first in (0, 1400, 2800, 4200, 5600):
        assert_accuracy(recorded_flight, first)


def assert_accuracy(flight: Flight, first: int) -> None:
    """Fly 200 s from a second on, with a start from nothing, and check every solution."""
    estimator = flight.estimator()
    solutions = {}
    for index in range(first, first + 200):
        solution = flight.process(estimator, index)
        if solution.solution == SOLUTION_NONE:
            assert index - first <= 65
            assert "mean of the code" in solution.degraded[0] or "chief" in solution.degraded[0]
        else:
            solutions[index] = solution
    assert len(solutions) >= 135
    assert all(s.solution == SOLUTION_FLOAT and not s.degraded for s in solutions.values())
    rms = np.sqrt(np.mean(flight.errors_rtn(solutions) ** 2, axis=0))
    assert (rms <= PAPER_RMS / 10.0).all(), rms
    last = solutions[first + 199]
    chief = np.concatenate((last.position_chief_gcrf, last.velocity_chief_gcrf))
    relative_gcrf = state_itrf_to_gcrf(last.time, np.concatenate((last.position_itrf, np.zeros(3))))
    rtn = relative_state_rtn(chief, chief + relative_gcrf)
    np.testing.assert_allclose(last.position_rtn, rtn[:3], atol=1e-6)
    assert len(last.ambiguities) == last.satellites_used
    assert not last.ambiguities.reference_prn.any()
    assert np.linalg.eigvalsh(last.covariance_rtn).min() > 0.0


def test_measurements_of_the_flight_are_as_noisy_as_the_filter_thinks(flight):
    estimator = flight.estimator()
    squared = degrees = 0.0
    for index in range(400):
        solution = flight.process(estimator, index)
        if index >= 100:
            squared += solution.normalised_innovation_squared
            degrees += solution.innovation_count
    # The clock is nearly free: of n innovations n - 1 degrees are those of the position.
    assert 0.8 < squared / degrees < 1.1


def test_slips_that_the_receiver_tells_are_taken_out(flight):
    def slip(index, chief, deputy):
        chosen = (deputy.prn == prn) & (deputy.band == 1)
        if index >= 100:
            deputy = deputy_changed(
                deputy, chosen, carrier_phase_cycles=lambda phase: phase + 1234567.0
            )
        if index == 100:
            deputy = deputy_changed(
                deputy,
                chosen,
                flags=lambda flags: flags | c.FLAG_LOCK_LOST,
                lock_time=lambda lock: 0.0 * lock,
            )
        return chief, deputy

    estimator = flight.estimator()
    prn = int(flight.receivers[0].epoch(100).prn[0])
    solutions = {}
    for index in range(140):
        solutions[index] = flight.process(estimator, index, slip)
    kept = {index: solutions[index] for index in range(99, 140)}
    assert np.abs(flight.errors_rtn(kept)).max() < 0.02
    assert solutions[100].satellites_used == solutions[99].satellites_used - 1
    assert solutions[101].satellites_used == solutions[99].satellites_used


@pytest.mark.parametrize("silent", ["chief", "deputy", "both"])
def test_without_common_satellites_the_prediction_goes_on(flight, silent):
    def outage(index, chief, deputy):
        if 100 <= index < 160:
            chief = None if silent in ("chief", "both") else chief
            deputy = None if silent in ("deputy", "both") else deputy
        return chief, deputy

    estimator = flight.estimator()
    solutions = {}
    for index in range(190):
        solutions[index] = flight.process(estimator, index, outage)
    gone = solutions[159]
    assert gone.solution == SOLUTION_PREDICTED
    assert gone.age == pytest.approx(60.0)
    assert gone.degraded == ("no common satellite for 60 s",)
    assert gone.satellites_used == 0
    before, after = solutions[99].covariance_rtn, gone.covariance_rtn
    assert (after.diagonal()[:3] > before.diagonal()[:3]).all()
    assert np.abs(flight.errors_rtn({159: gone})).max() < 0.05
    back = {index: solutions[index] for index in range(163, 190)}
    assert all(s.solution == SOLUTION_FLOAT for s in back.values())
    assert np.abs(flight.errors_rtn(back)).max() < 0.02


@pytest.mark.parametrize("jump", [1e-3, -1e-3])
def test_times_of_reception_follow_the_clocks(jump):
    """Clocks jump by 1 ms, in which the spacecraft fly 7.6 m, and are then steered back."""
    faults = [
        Fault("clock_jump", name, 90.0, seconds=sign * jump)
        for name, sign in (("chief", 1.0), ("deputy", -1.0))
    ]
    flight = Flight.emulated(120, faults)
    estimator = flight.estimator()
    solutions = {index: flight.process(estimator, index) for index in range(120)}
    after = {index: s for index, s in solutions.items() if index >= 90}
    assert all(s.solution == SOLUTION_FLOAT for s in after.values())
    assert max(abs(s.clock_difference) for s in after.values()) > 1.5 * abs(jump)
    assert (np.sqrt(np.mean(flight.errors_rtn(after) ** 2, axis=0)) <= PAPER_RMS / 10.0).all()


def test_long_outages_end_the_solution(flight):
    estimator = flight.estimator(longest_prediction=20.0)
    for index in range(90):
        flight.process(estimator, index)
    for index in range(90, 111):
        solution = flight.process(estimator, index, lambda *_: (None, None))
    assert solution.solution == SOLUTION_NONE
    for index in range(111, 180):
        solution = flight.process(estimator, index)
    assert solution.solution == SOLUTION_FLOAT


def test_thrust_moves_the_prediction_as_it_moves_the_spacecraft(flight):
    """Nothing is measured during the thrust: what is seen is the propagation."""
    estimator = flight.estimator()
    for index in range(80):
        solution = flight.process(estimator, index)
    thrust = np.array([0.05, -0.2, 0.1])
    start = solution.time
    estimator.add_thrust(start, 1.0, thrust)
    without = flight.estimator()
    for index in range(80):
        flight.process(without, index)
    for index in range(80, 90):
        moved = flight.process(estimator, index, lambda *_: (None, None))
        free = flight.process(without, index, lambda *_: (None, None))
    # A push over the first second, then 9 s of coasting; Hill's terms are below 1 %.
    np.testing.assert_allclose(
        moved.position_rtn - free.position_rtn, 9.5 * thrust, rtol=0.02, atol=0.03
    )


def test_reset_begins_anew_and_keeps_ephemerides(flight):
    estimator = flight.estimator()
    first = [flight.process(estimator, index) for index in range(80)]
    estimator.reset()
    second = [flight.process(estimator, index) for index in range(80)]
    assert second[0].solution == SOLUTION_NONE
    np.testing.assert_array_equal(first[-1].position_rtn, second[-1].position_rtn)
    np.testing.assert_array_equal(first[-1].covariance_rtn, second[-1].covariance_rtn)

"""The rows of issue 4 that the carrier-phase filter has to show by itself.

Scenario of paper 004 (Oh et al. 2016) on the bytes of the emulated receivers: L1 C/A and L2P(Y),
1 mm and 0.3 m noise, steered TCXO, receiver biases; errors after the first 60 s. Integers are
compared one by one with those of the emulator at every epoch. What was measured is printed
(pytest -rP). LAMBDA: integers/test_*; RINEX files: test_rinex.

Each test has two extents: `WHOLE`, marked slow, is what the issue asks for, 100 minutes and two
seeds among the satellites of Spirent's navigation file (reference data). `SHORT` flies minutes
among the satellites of the nominal constellation, with the same bounds but where a few minutes do
not average the errors: there the covariance must keep the bound, and the errors the covariance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pytest
from cdgps_test_support import (
    CHIEF,
    DEPUTY_5KM,
    DEPUTY_250M,
    J2,
    L1,
    REPOSITORY,
    Flight,
    Laser,
    Scenario,
    configuration,
    fly,
    simulate,
)
from cdgps_truth_support import longest_run, tec_errors, wrong_integers
from scipy.stats import chi2
from shared_data import require_shared

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.signals import carrier_frequency_hz
from vtff_nav.relative.common.solution import SOLUTION_PREDICTED
from vtff_sim_bridge.atmosphere.density_models import constant_profile
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
from vtff_sim_bridge.gnss.faults import Fault

NAVIGATION = "data/navigation/spirent_dynamic/RINEX_GN_Spirent.23N"
DEPUTIES = {"250 m": DEPUTY_250M, "5 km": DEPUTY_5KM}


@dataclass(frozen=True)
class Extent:
    """Length of the flights of a test, s, and their satellites."""

    name: str
    seeds: tuple[int, ...]
    flight: int
    flight_in_plasma: int
    laser: int
    laser_settles: int
    latency_error: float
    tracking: int
    manoeuvres: slice
    tec: int
    consistency_runs: int
    consistency_step: int
    consistency_steps: int
    has_reference_satellites: bool

    def simulate(self, seconds: int, deputy: np.ndarray = DEPUTY_250M, **options) -> Scenario:
        """Simulate a flight among the satellites of this extent."""
        if self.has_reference_satellites:
            options["constellation"] = str(require_shared(NAVIGATION))
            options["start"] = parse_epoch("2023-01-08T10:00:00 GPS")
        return simulate(seconds, deputy, **options)


SHORT = Extent(
    "short",
    seeds=(1,),
    flight=301,
    flight_in_plasma=301,
    laser=241,
    laser_settles=180,
    # Coarse, about six times the limit after 10 min: the sharp check of the short form is that the
    # error stays within three of the stated sigmas.
    latency_error=6e-4,
    tracking=60,
    manoeuvres=slice(-1, None),
    tec=181,
    consistency_runs=8,
    consistency_step=60,
    consistency_steps=2,
    has_reference_satellites=False,
)
# 100 min of the paper are a whole orbit; with plasma half of one, which has every distance and both
# signs of the altitude difference (the whole one was measured too: README of vtff_nav).
WHOLE = Extent(
    "whole",
    seeds=(1, 2),
    flight=6001,
    flight_in_plasma=3001,
    laser=901,
    laser_settles=600,
    latency_error=1e-4,
    tracking=400,
    manoeuvres=slice(None),
    tec=1201,
    consistency_runs=20,
    consistency_step=600,
    consistency_steps=2,
    has_reference_satellites=True,
)

# Bounds of issue 4 on the 3-D RMS, m, by distance and electron density around the spacecraft, 1/m3.
BOUNDS = {
    ("250 m", 0.0): 0.6e-3,
    ("5 km", 0.0): 0.8e-3,
    ("250 m", 5e11): 0.8e-3,
    ("5 km", 5e11): 0.8e-3,
    ("250 m", 1e12): 1.0e-3,
    ("5 km", 1e12): 1.0e-3,
}
L1_BOUND = 0.9e-3
# Errors change over minutes with the geometry: 3 min hold about five independent errors of three
# axes.
SHORT_FREEDOM = 15
# Bounds of the short form on the 3-D RMS, m: the sigma of the covariance at this distance (0.573
# and 0.721 mm) times 1.585, which the RMS of 15 degrees of freedom exceeds once in a thousand runs.
# They are numbers, so that a covariance that grows does not take its bound along. The bounds of the
# issue are near the sigma, so that after 3 min only the covariance can keep them.
SHORT_BOUNDS = {"250 m": 0.92e-3, "5 km": 1.15e-3}
# The same with L1 alone, whose sigma is 1.680 mm after 3 min.
L1_SHORT_BOUND = 2.7e-3
BACK_BOUND = 2e-3
LONGEST_WRONG = 2
FAULTS_BEGIN = 60
# The emulated laser as it is by default.
LASER = Laser(1e-4)
LATENCY_FACTOR = 5.0


@dataclass(frozen=True)
class Case:
    """A scenario and the flight of the filter with both carriers over it."""

    extent: Extent
    distance: str
    density: float
    scenario: Scenario
    flight: Flight


@pytest.fixture(scope="session")
def case(request: pytest.FixtureRequest) -> Case:
    """Return the case of a test; tests of the same one share it."""
    extent, distance, density, seed = request.param
    profile = constant_profile(density, 450e3, 800e3) if density else None
    seconds = extent.flight_in_plasma if density else extent.flight
    scenario = extent.simulate(seconds, DEPUTIES[distance], seed=seed, profile=profile)
    return Case(extent, distance, density, scenario, fly(scenario, configuration()))


def for_cases(cases: Iterable[tuple[str, float]]) -> pytest.MarkDecorator:
    """Return the parametrisation of a test by distances and densities, in both extents."""
    parameters = [
        pytest.param(
            (extent, distance, density, seed),
            id=f"{extent.name}, {distance}, {density:g}, {seed}",
            marks=[pytest.mark.slow] if extent is WHOLE else [],
        )
        for extent in (SHORT, WHOLE)
        for distance, density in cases
        for seed in extent.seeds
    ]
    return pytest.mark.parametrize("case", parameters, indirect=True, scope="session")


def wrong_of(scenario: Scenario, flight: Flight) -> list[list[str]]:
    """Return the wrong integers of every epoch."""
    return [
        wrong_integers(scenario.truth, second, solution)
        for second, solution in enumerate(flight.solutions)
    ]


def assert_accuracy(
    extent: Extent, flight: Flight, bound: float | None, short_bound: float
) -> None:
    """Assert bounds on the 3-D RMS, m: of the issue for the whole extent, else of the covariance.

    The short extent keeps the bound of the issue (if any) by its stated sigma, the short bound by
    its errors, and the mean NEES is within the interval that once in 500 runs does not hold it.
    """
    if extent is WHOLE:
        assert flight.rms() <= bound
        return
    traces = [np.trace(s.covariance_position_itrf) for s in flight.solutions[60:]]
    stated = float(np.sqrt(np.mean(traces)))
    nees = float(flight.normalised_squares()[60:].mean()) / 3.0
    print(f"stated 3-D sigma {1e3 * stated:.3f} mm, mean NEES {nees:.2f} of 1")
    assert bound is None or stated <= bound
    assert flight.rms() <= short_bound
    low, high = chi2.ppf((0.001, 0.999), SHORT_FREEDOM) / SHORT_FREEDOM
    assert low <= nees <= high
    assert flight.rms() <= stated * np.sqrt(high)


def integers_of(flight: Flight) -> int:
    """Return how many integers were compared."""
    return sum(solution.ambiguities_fixed for solution in flight.solutions)


@for_cases(BOUNDS)
def test_accuracy(case: Case):
    """At 250 m and 5 km, with and without plasma: every epoch fixed, no integer ever wrong."""
    flight, bound = case.flight, BOUNDS[case.distance, case.density]
    wrong = wrong_of(case.scenario, flight)
    print(
        f"3-D RMS {1e3 * flight.rms():.3f} mm (<= {1e3 * bound}), "
        f"velocity {1e6 * flight.velocity_rms():.1f} um/s, "
        f"fixed {flight.is_fixed[60:].mean():.2%}, "
        f"{sum(map(len, wrong))} of {integers_of(flight)} integers wrong"
    )
    assert_accuracy(case.extent, flight, bound, SHORT_BOUNDS[case.distance])
    assert flight.velocity_rms() <= 20e-6
    assert flight.is_fixed[60:].all()
    assert not any(wrong)
    assert integers_of(flight) > 10 * len(flight.solutions)


@for_cases([("250 m", 0.0)])
def test_l1_only(case: Case):
    """L1 alone at 250 m: 0.9 mm, first fix within 10 s."""
    flight = fly(case.scenario, configuration(bands=L1))
    wrong = wrong_of(case.scenario, flight)
    first = int(np.flatnonzero(flight.is_fixed)[0])
    print(
        f"3-D RMS {1e3 * flight.rms():.3f} mm, first fix after {first} s, "
        f"{sum(map(len, wrong))} of {integers_of(flight)} integers wrong"
    )
    # One carrier tells plasma from position by its motion only: that takes more than 3 min.
    bound = L1_BOUND if case.extent is WHOLE else None
    assert_accuracy(case.extent, flight, bound, L1_SHORT_BOUND)
    assert first <= 10
    assert flight.is_fixed[60:].all()
    assert not any(wrong)


def with_laser(case: Case) -> tuple[Flight, Flight]:
    """Return the flight with laser over the first minutes, and that without over the same."""
    scenario, settled = case.scenario.until(case.extent.laser), case.extent.laser_settles
    flight = fly(scenario, configuration(), laser=LASER)
    assert not any(wrong_of(scenario, flight))
    alone = case.flight.until(case.extent.laser)
    residuals = np.array([s.laser_residual for s in flight.solutions[60:]])
    latency, sigma = latencies(flight)
    print(
        f"latency error {latency[settled]:.2e} s after {settled} s, then at most "
        f"{np.abs(latency[settled:]).max():.2e}; sigma {sigma[settled]:.2e}; "
        f"residual {1e3 * residuals.std():.4f} mm; "
        f"3-D RMS {1e3 * flight.rms():.4f} mm, GPS alone {1e3 * alone.rms():.4f} mm"
    )
    # n residuals of white noise give their sigma to 1 / sqrt(2 n); the limits are four times that.
    assert residuals.std() == pytest.approx(LASER.sigma, rel=4.0 / np.sqrt(2.0 * len(residuals)))
    assert abs(residuals.mean()) < 4.0 * LASER.sigma / np.sqrt(len(residuals))
    assert flight.rms() <= alone.rms()
    return flight, alone


def latencies(flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Return error and sigma of the latency of each epoch, s."""
    latency = np.array([s.laser_latency for s in flight.solutions]) - LASER.latency
    return latency, np.array([s.laser_latency_sigma for s in flight.solutions])


@for_cases([("5 km", 0.0)])
def test_laser_at_5_km(case: Case):
    """The latency within 1e-4 s after 10 min, the residual at its noise, no worse than GPS."""
    flight, _ = with_laser(case)
    latency, sigma = (column[case.extent.laser_settles :] for column in latencies(flight))
    assert np.abs(latency).max() < case.extent.latency_error
    assert np.all(np.abs(latency) < 3.0 * sigma)


@for_cases([("250 m", 0.0)])
def test_laser_at_250_m(case: Case):
    """Accuracy at 250 m, where the latency is NOT within 1e-4 s after 10 min.

    The range changes by less than 0.3 m/s there, so that 1e-4 s is 0.03 mm of range. Even with the
    forces known exactly and no plasma, all phases of 10 min leave a sigma of 1.2e-4 s: a late
    laser looks much like an orbit flown later, which only GPS can tell. The filter, which allows
    for varying plasma (factor 2.9) and unknown accelerations of 5e-8 m/s2 (1.5), states 5.2e-4 s.
    It must be right about that.
    """
    flight, _ = with_laser(case)
    settled = case.extent.laser_settles
    latency, sigma = (column[settled:] for column in latencies(flight))
    floor = latency_floor(case.scenario, settled)
    print(f"floor of the sigma after {settled} s {floor:.2e} s")
    assert np.all(np.abs(latency) < 3.0 * sigma)
    assert 1e-4 < floor < sigma[0] < LATENCY_FACTOR * floor


def latency_floor(scenario: Scenario, seconds: int, step: int = 10) -> float:
    """Return the Cramer-Rao bound of the latency, s: integers and forces known exactly, no plasma.

    Unknown are the relative state at the start, the clock at every epoch and the latency. L1 and
    L2 of the satellites above 5 deg with 1 mm at each receiver, as the emulator has them, and the
    laser; the information of every `step`-th epoch counts `step` times.
    """
    steps = np.diag([1.0] * 3 + [1e-3] * 3)
    deputy = scenario.deputy_gcrf[0]
    start = scenario.start
    crafts = [Propagator(start, state, J2) for state in (deputy, *(deputy + steps))]
    information = np.zeros((7, 7))
    for second in range(0, seconds + 1, step):
        states = np.array([craft.state_gcrf for craft in crafts])
        transition = ((states[1:] - states[0]) / np.diagonal(steps)[:, None]).T
        time, chief = start + float(second), scenario.chief_gcrf[second]
        table = EphemerisStore(scenario.ephemerides).table(time)
        state_itrf = state_gcrf_to_itrf(time, chief)
        seen = lines_of_sight(table, time, 0.0, state_itrf[:3], state_itrf[3:])
        directions = seen.direction_itrf[seen.elevation > np.radians(5.0)]
        directions = directions @ rotation_gcrf_to_itrf(time)
        directions = directions - directions.mean(axis=0)
        # Two carriers of variance 2 (1 mm)^2 in the single difference.
        phase = directions @ transition[:3] / 1e-3
        information[:6, :6] += step * phase.T @ phase
        relative = states[0] - chief
        distance = np.linalg.norm(relative[:3])
        rate = relative[:3] @ relative[3:] / distance
        laser = np.append(relative[:3] / distance @ transition[:3], rate) / LASER.sigma
        information += step * np.outer(laser, laser)
        for craft in crafts:
            for _ in range(step):
                craft.advance()
    return float(np.sqrt(np.linalg.inv(information)[6, 6]))


@pytest.fixture(
    scope="session",
    params=[
        pytest.param((extent, seed), marks=[pytest.mark.slow] if extent is WHOLE else [])
        for extent in (SHORT, WHOLE)
        for seed in extent.seeds
    ],
    ids=lambda extent_and_seed: f"{extent_and_seed[0].name}, seed {extent_and_seed[1]}",
)
def extent_and_seed(request: pytest.FixtureRequest) -> tuple[Extent, int]:
    """Return extent and seed of a test with faults."""
    return request.param


@pytest.fixture(scope="session")
def tracked(extent_and_seed: tuple[Extent, int]) -> list[tuple[str, str]]:
    """Return satellite and signal of all that is tracked during the tests with faults."""
    extent, seed = extent_and_seed
    scenario = extent.simulate(extent.tracking, seed=seed)
    names = [name for receiver, *name in scenario.truth.arcs if receiver == "chief"]
    always = scenario.always_tracked()
    return [(satellite, signal) for satellite, signal in names if satellite in always]


@dataclass(frozen=True)
class Faulty:
    """A flight with faults, and for how many epochs a signal had a wrong integer."""

    scenario: Scenario
    flight: Flight
    wrong_for: int

    @classmethod
    def of(cls, scenario: Scenario, thrust_rtn: np.ndarray | None = None) -> Faulty:
        """Fly a scenario; the filter knows its thrust, or the thrust given here."""
        thrust_rtn = scenario.thrust_rtn if thrust_rtn is None else thrust_rtn
        flight = fly(dataclasses.replace(scenario, thrust_rtn=thrust_rtn), configuration())
        wrong = wrong_of(scenario, flight)
        print(
            f"largest error {1e3 * flight.error[FAULTS_BEGIN:].max():.2f} mm; "
            f"{sum(map(len, wrong))} of {integers_of(flight)} integers wrong, none for longer than "
            f"{longest_run(wrong)} s"
        )
        return cls(scenario, flight, longest_run(wrong))


POINT_FAULTS: dict[str, Callable[[int], dict[str, object]]] = {
    "slip": lambda number: {
        "cycles": (1.0, -1.0)[number // 4 % 2],
        "is_silent_slip": number % 3 > 0,
    },
    "half_cycle": lambda number: {},
}


@pytest.mark.parametrize("kind", POINT_FAULTS)
def test_phase_faults_of_any_signal(kind, extent_and_seed, tracked):
    """Single slips of one cycle, or half cycles, on every signal of every satellite in turn.

    One each 4 s, at one of the receivers, two of three slips without a new lock time. The error is
    never above 2 mm, so it need not come back.
    """
    faults = [
        Fault(
            kind,
            # Both receivers have their share of L1 and of L2, which take turns.
            ("deputy", "chief")[(number + number // 2) % 2],
            float(FAULTS_BEGIN + 4 * number),
            satellite=satellite,
            signal=signal,
            **POINT_FAULTS[kind](number),
        )
        for number, (satellite, signal) in enumerate(tracked)
    ]
    extent, seed = extent_and_seed
    end = FAULTS_BEGIN + 4 * len(faults) + 20
    run = Faulty.of(extent.simulate(end, seed=seed, faults=faults))
    events = [c for _, cycles in run.scenario.truth.arcs.values() for c in np.diff(cycles)]
    size = 1.0 if kind == "slip" else 0.5
    assert np.count_nonzero(np.abs(events) == size) >= len(faults)
    assert run.flight.is_fixed[1:].all()
    assert run.flight.error[FAULTS_BEGIN:].max() < BACK_BOUND
    assert run.wrong_for <= LONGEST_WRONG


def test_clock_jumps(extent_and_seed):
    """Jumps of 1 ms forwards and backwards at both receivers."""
    extent, seed = extent_and_seed
    jumps = [(name, size) for name in ("deputy", "chief") for size in (1e-3, -1e-3)]
    faults = [
        Fault("clock_jump", name, FAULTS_BEGIN + 15.0 * number, seconds=size)
        for number, (name, size) in enumerate(jumps)
    ]
    run = Faulty.of(extent.simulate(FAULTS_BEGIN + 80, seed=seed, faults=faults))
    assert run.flight.is_fixed[1:].all()
    assert run.flight.error[FAULTS_BEGIN:].max() < BACK_BOUND
    assert run.wrong_for <= LONGEST_WRONG


def test_outage(extent_and_seed):
    """60 s without any satellite: predicted with an honest covariance, back within 30 s."""
    extent, seed = extent_and_seed
    begin, end = FAULTS_BEGIN + 30, FAULTS_BEGIN + 90
    faults = [Fault("outage", name, float(begin), 60.0) for name in ("chief", "deputy")]
    run = Faulty.of(extent.simulate(end + 120, seed=seed, faults=faults))
    flight = run.flight
    assert {s.solution for s in flight.solutions[begin:end]} == {SOLUTION_PREDICTED}
    assert flight.normalised_squares()[begin:end].max() < chi2.ppf(0.999, 3)
    fixed = end + int(np.flatnonzero(flight.is_fixed[end:])[0])
    print(f"predicted to {1e3 * flight.error[begin:end].max():.1f} mm, fixed {fixed - end} s later")
    assert flight.is_fixed[end + 30 :].all()
    assert flight.error[end + 30 :].max() < BACK_BOUND
    assert run.wrong_for <= LONGEST_WRONG


CAP = 1.4
QUANTUM = 1e-5
# Fractions of the cap, which is one of each axis, in RTN; seconds. Each is flown out and back.
MANOEUVRES = (
    ((1.0, 0.0, 0.0), 1),
    ((0.0, -1.0, 0.0), 10),
    ((0.0, 0.0, 1.0), 30),
    ((1.0, -1.0, 1.0), 10),
)
PAUSE = 60

# Metres of the difference of L1 and L2 phase to a TECU.
TEC_SCALE = (
    IONOSPHERIC_DELAY_CONSTANT
    * ELECTRONS_PER_TECU
    * (carrier_frequency_hz(0, 2) ** -2 - carrier_frequency_hz(0, 1) ** -2)
)


def schedule(extent: Extent) -> list[tuple[int, int, np.ndarray]]:
    """Return begin, end and acceleration of the manoeuvres, s and m/s2."""
    # The thrust is a third of a quantum beside the values that a command can have.
    size = CAP - QUANTUM / 3.0
    planned, begin = [], FAULTS_BEGIN + 30
    for direction, duration in MANOEUVRES[extent.manoeuvres]:
        for sign in (1.0, -1.0):
            planned.append((begin, begin + duration, sign * size * np.array(direction)))
            begin += duration + PAUSE
    return planned


def test_manoeuvres_at_the_cap(extent_and_seed):
    """1.4 m/s2, known in pieces of 1 s and to 1e-5 m/s2: back under 2 mm within 10 s of the end.

    Once back, the RMS stays below, but not every epoch: thrust is believed to 5e-4, so that the
    velocity is to be found anew, while the plasma is estimated too. By the covariance the 3-D
    sigma is 1.3 mm after 10 s and 1.0 mm after 26 s; single epochs of 2.0 to 2.4 mm followed 5 of
    48 manoeuvres (6 seeds). Where thrust may be believed to 5e-5, as that of the emulated thrusters
    may, no epoch is above (at most 1.91 mm after the 48).
    """
    extent, seed = extent_and_seed
    planned = schedule(extent)

    def thrust_rtn(second: int) -> np.ndarray:
        return sum((a for b, e, a in planned if b <= second < e), np.zeros(3))

    scenario = extent.simulate(planned[-1][1] + PAUSE, seed=seed, thrust_rtn=thrust_rtn)
    rounded_thrust = QUANTUM * np.rint(scenario.thrust_rtn / QUANTUM)
    run = Faulty.of(scenario, rounded_thrust)
    flight = run.flight
    back = [int(np.flatnonzero(flight.error[end:] < BACK_BOUND)[0]) for _, end, _ in planned]
    after = np.concatenate([np.arange(end + 10, end + PAUSE) for _, end, _ in planned])
    rms = [np.sqrt(np.mean(flight.error[end + 10 : end + PAUSE] ** 2)) for _, end, _ in planned]
    print(
        f"under 2 mm after {back} s; then RMS {np.round(1e3 * np.array(rms), 2)} mm, "
        f"largest {1e3 * flight.error[after].max():.2f} mm, "
        f"mean NEES {flight.normalised_squares()[after].mean() / 3.0:.2f} of 1"
    )
    assert max(back) <= 10
    assert max(rms) < BACK_BOUND
    assert flight.normalised_squares()[after].max() < chi2.ppf(1.0 - 1e-5, 3)
    assert flight.is_fixed[1:].all()
    assert run.wrong_for <= LONGEST_WRONG

    exact = configuration(
        thrust_relative_sigma=5e-5, thrust_scale_sigma=5e-5, thrust_misalignment_sigma_deg=3e-3
    )
    trusting = fly(dataclasses.replace(scenario, thrust_rtn=rounded_thrust), exact)
    print(f"thrust believed to 5e-5: largest {1e3 * trusting.error[after].max():.2f} mm")
    assert trusting.error[after].max() < BACK_BOUND
    for _, end, _ in planned:
        believed, usual = (
            np.trace(solutions[end + 5].covariance_rtn[:3, :3])
            for solutions in (trusting.solutions, flight.solutions)
        )
        print(f"sigma 5 s after the end {1e3 * np.sqrt([believed, usual])} mm")
        assert believed < 0.9 * usual


@pytest.mark.parametrize("scale", [1.0, 4.0], ids=["250 m", "1 km"])
def test_differential_tec(scale, extent_and_seed):
    """The plasma between the spacecraft in the reference ionosphere, against the emulator's."""
    profile = load_gnss_configuration(REPOSITORY / "config/gnss/reference.yaml").profile
    deputy = CHIEF + scale * (DEPUTY_250M - CHIEF)
    extent, seed = extent_and_seed
    scenario = extent.simulate(extent.tec, deputy, seed=seed, profile=profile)
    flight = fly(scenario, configuration())
    assert not any(wrong_of(scenario, flight))
    epochs = [tec_errors(scenario.truth, s, flight.solutions[s]) for s in range(60, extent.tec)]
    level = np.array([errors.mean() for errors, _ in epochs])
    minutes = level[: 60 * (len(level) // 60)].reshape(-1, 60).mean(axis=1)
    scatter = np.concatenate([errors - errors.mean() for errors, _ in epochs])
    sigmas = np.concatenate([sigma for _, sigma in epochs])
    normalised = np.concatenate([errors / sigma for errors, sigma in epochs])
    # What the phases of one satellite, 2 (1 mm)^2 on each carrier, tell at one epoch.
    phase_sigma = 2e-3 / TEC_SCALE
    level_sigma = np.sqrt(max(np.mean(sigmas**2) - phase_sigma**2, 0.0))
    print(
        f"level {1e3 * rms_of(level):.2f} mTECU at an epoch, {1e3 * rms_of(minutes):.2f} in means "
        f"of a minute (stated {1e3 * level_sigma:.2f}), scatter {1e3 * rms_of(scatter):.2f}, "
        f"stated sigma {1e3 * rms_of(sigmas):.2f}, normalised RMS {rms_of(normalised):.3f}"
    )
    assert rms_of(normalised) == pytest.approx(1.0, abs=0.05)
    assert np.mean(np.abs(normalised) < 3.0) > 0.99
    assert rms_of(scatter) < phase_sigma
    assert rms_of(minutes) < 3.0 * level_sigma


def rms_of(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    "extent", [SHORT, pytest.param(WHOLE, marks=pytest.mark.slow)], ids=lambda extent: extent.name
)
def test_consistency(extent):
    """NEES and NIS of many seeds are inside their 95 % bounds.

    The whole: 20 arcs of 20 min, with NEES at 10 and 20 min: 120 degrees of freedom, bounds -24 and
    +27 %, and a million of the NIS; the filter has settled after 10 min. The accelerations of
    the truth are drawn from the model of the filter, and the plasma that is not there is not
    estimated: what is tested is whether the covariance follows from the assumptions.
    """
    parameters = configuration(estimate_plasma=False)
    sigma = parameters.noise_relative.empirical_sigma
    squares, innovations, freedoms = [], 0.0, 0
    step = extent.consistency_step
    for number in range(extent.consistency_runs):
        seconds = step * extent.consistency_steps + 1
        scenario = extent.simulate(seconds, seed=number, empirical_sigma=(0.0, sigma))
        flight = fly(scenario, parameters)
        assert flight.is_fixed[1:].all()
        squares.extend(flight.normalised_squares()[step::step])
        innovations += sum(s.normalised_innovation_squared for s in flight.solutions[60:])
        freedoms += sum(s.innovation_count for s in flight.solutions[60:])
    low, high = chi2.ppf((0.025, 0.975), 3 * len(squares))
    print(f"NEES {sum(squares):.1f} in [{low:.1f}, {high:.1f}]")
    assert low <= sum(squares) <= high
    low, high = chi2.ppf((0.025, 0.975), freedoms)
    print(f"NIS {innovations / freedoms:.5f} in [{low / freedoms:.5f}, {high / freedoms:.5f}]")
    assert low <= innovations <= high

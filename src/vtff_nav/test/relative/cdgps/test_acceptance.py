"""The rows of issue 4 that the carrier-phase filter has to show by itself, all of them slow.

Scenario of paper 004 (Oh et al. 2016) on the bytes of the emulated receivers: L1 C/A and L2P(Y),
1 mm and 0.3 m noise, steered TCXO, receiver biases; errors after the first 60 s; two seeds.
Integers are compared one by one with those of the emulator at every epoch. What was measured is
printed (pytest -rP). LAMBDA: test_nav_integer_*; RINEX files: test_nav_cdgps_rinex.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
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
    START,
    Flight,
    Laser,
    Scenario,
    configuration,
    fly,
    simulate,
)
from cdgps_truth_support import longest_run, tec_errors, wrong_integers
from scipy.stats import chi2

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.orbit.propagator import Propagator
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.signals import carrier_frequency_hz
from vtff_nav.relative.common.solution import SOLUTION_PREDICTED
from vtff_sim_bridge.atmosphere.density_models import constant_profile
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
from vtff_sim_bridge.gnss.faults import Fault

pytestmark = pytest.mark.slow

SEEDS = (1, 2)
# Epochs: 100 min of the paper, a whole orbit; with plasma half of one, which has every distance and
# both signs of the altitude difference (the whole one was measured too: README of vtff_nav).
WHOLE, HALF = 6001, 3001
DEPUTIES = {"250 m": DEPUTY_250M, "5 km": DEPUTY_5KM}

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
BACK_BOUND = 2e-3
LONGEST_WRONG = 2
FAULTS_BEGIN = 60
# The emulated laser as it is by default.
LASER = Laser(1e-4)
LASER_END = 901
LATENCY_FACTOR = 5.0


def name_of(case: tuple) -> str:
    """Return the name of a case in the list of tests."""
    return ", ".join(part if isinstance(part, str) else f"{part:g}" for part in case)


def plain(distance: str, seed: int) -> tuple[str, float, int]:
    """Return the case without plasma."""
    return distance, 0.0, seed


PAPER_CASES = [(*case, seed) for case in BOUNDS for seed in SEEDS]


@dataclass(frozen=True)
class Case:
    """A scenario of `WHOLE` or `HALF` and the flight of the filter with both carriers over it."""

    distance: str
    density: float
    scenario: Scenario
    flight: Flight


@pytest.fixture(scope="session")
def case(request: pytest.FixtureRequest) -> Case:
    """Return one of `PAPER_CASES`; tests of the same one share it."""
    distance, density, seed = request.param
    profile = constant_profile(density, 450e3, 800e3) if density else None
    scenario = simulate(HALF if density else WHOLE, DEPUTIES[distance], seed, profile)
    return Case(distance, density, scenario, fly(scenario, configuration()))


def for_cases(cases: Sequence[tuple[str, float, int]]) -> pytest.MarkDecorator:
    """Return the parametrisation of a test by cases."""
    return pytest.mark.parametrize("case", cases, indirect=True, ids=name_of, scope="session")


def wrong_of(scenario: Scenario, flight: Flight) -> list[list[str]]:
    """Return the wrong integers of every epoch."""
    return [
        wrong_integers(scenario.truth, second, solution)
        for second, solution in enumerate(flight.solutions)
    ]


def integers_of(flight: Flight) -> int:
    """Return how many integers were compared."""
    return sum(solution.ambiguities_fixed for solution in flight.solutions)


@for_cases(PAPER_CASES)
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
    assert flight.rms() <= bound
    assert flight.velocity_rms() <= 20e-6
    assert flight.is_fixed[60:].all()
    assert not any(wrong)
    assert integers_of(flight) > 10 * len(flight.solutions)


@for_cases([plain("250 m", seed) for seed in SEEDS])
def test_l1_only(case: Case):
    """L1 alone at 250 m: 0.9 mm, first fix within 10 s."""
    flight = fly(case.scenario, configuration(bands=L1))
    wrong = wrong_of(case.scenario, flight)
    first = int(np.flatnonzero(flight.is_fixed)[0])
    print(
        f"3-D RMS {1e3 * flight.rms():.3f} mm, first fix after {first} s, "
        f"{sum(map(len, wrong))} of {integers_of(flight)} integers wrong"
    )
    assert flight.rms() <= L1_BOUND
    assert first <= 10
    assert flight.is_fixed[60:].all()
    assert not any(wrong)


def with_laser(case: Case) -> tuple[Flight, Flight]:
    """Return the flight with laser over the first 15 minutes, and that without over the same."""
    scenario = dataclasses.replace(
        case.scenario,
        chief_gcrf=case.scenario.chief_gcrf[:LASER_END],
        deputy_gcrf=case.scenario.deputy_gcrf[:LASER_END],
    )
    flight = fly(scenario, configuration(), laser=LASER)
    assert not any(wrong_of(scenario, flight))
    alone = dataclasses.replace(case.flight, error_itrf=case.flight.error_itrf[:LASER_END])
    residuals = np.array([s.laser_residual for s in flight.solutions[60:]])
    latency, sigma = latencies(flight)
    print(
        f"latency error {latency[600]:.2e} s at 10 min, at most {np.abs(latency[600:]).max():.2e} "
        f"until 15 min; sigma {sigma[600]:.2e}; residual {1e3 * residuals.std():.4f} mm; "
        f"3-D RMS {1e3 * flight.rms():.4f} mm, GPS alone {1e3 * alone.rms():.4f} mm"
    )
    # 840 residuals of white noise: their sigma is known to 2.4 %, the limits are four times that.
    assert residuals.std() == pytest.approx(LASER.sigma, rel=0.1)
    assert abs(residuals.mean()) < 4.0 * LASER.sigma / np.sqrt(len(residuals))
    assert flight.rms() <= alone.rms()
    return flight, alone


def latencies(flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Return error and sigma of the latency of each epoch, s."""
    latency = np.array([s.laser_latency for s in flight.solutions]) - LASER.latency
    return latency, np.array([s.laser_latency_sigma for s in flight.solutions])


@for_cases([plain("5 km", seed) for seed in SEEDS])
def test_laser_at_5_km(case: Case):
    """The latency within 1e-4 s after 10 min, the residual at its noise, no worse than GPS."""
    flight, _ = with_laser(case)
    latency, sigma = latencies(flight)
    assert np.abs(latency[600:]).max() < 1e-4
    assert np.all(np.abs(latency[600:]) < 3.0 * sigma[600:])


@for_cases([plain("250 m", seed) for seed in SEEDS])
def test_laser_at_250_m(case: Case):
    """What holds at 250 m, where the latency is NOT within 1e-4 s after 10 min.

    The range changes by less than 0.3 m/s there, so that 1e-4 s is 0.03 mm of range. Even with the
    forces known exactly and no plasma, all phases of 10 min leave a sigma of 1.2e-4 s: a late
    laser looks much like an orbit flown later, which only GPS can tell. The filter, which allows
    for varying plasma (factor 2.9) and unknown accelerations of 5e-8 m/s2 (1.5), states 5.2e-4 s.
    It must be right about that.
    """
    flight, _ = with_laser(case)
    latency, sigma = latencies(flight)
    floor = latency_floor(case.scenario, 600)
    print(f"floor of the sigma at 10 min {floor:.2e} s")
    assert np.all(np.abs(latency[600:]) < 3.0 * sigma[600:])
    assert 1e-4 < floor < sigma[600] < LATENCY_FACTOR * floor


def latency_floor(scenario: Scenario, seconds: int, step: int = 10) -> float:
    """Return the Cramer-Rao bound of the latency, s: integers and forces known exactly, no plasma.

    Unknown are the relative state at the start, the clock at every epoch and the latency. L1 and
    L2 of the satellites above 5 deg with 1 mm at each receiver, as the emulator has them, and the
    laser; the information of every `step`-th epoch counts `step` times.
    """
    steps = np.diag([1.0] * 3 + [1e-3] * 3)
    deputy = scenario.deputy_gcrf[0]
    crafts = [Propagator(START, state, J2) for state in (deputy, *(deputy + steps))]
    information = np.zeros((7, 7))
    for second in range(0, seconds + 1, step):
        states = np.array([craft.state_gcrf for craft in crafts])
        transition = ((states[1:] - states[0]) / np.diagonal(steps)[:, None]).T
        time, chief = START + float(second), scenario.chief_gcrf[second]
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


@pytest.fixture(scope="session", params=SEEDS, ids=lambda seed: f"seed {seed}")
def seed(request: pytest.FixtureRequest) -> int:
    """Return the seed of a test with faults."""
    return request.param


@pytest.fixture(scope="session")
def tracked(seed: int) -> list[tuple[str, str]]:
    """Return satellite and signal of all that is tracked during the tests with faults."""
    scenario = simulate(400, seed=seed)
    names = [name for receiver, *name in scenario.truth.arcs if receiver == "chief"]
    ends = (scenario.truth.slant_tec_tecu["chief", second] for second in (30, 399))
    always = set.intersection(*map(set, ends))
    return [(satellite, signal) for satellite, signal in names if satellite in always]


@dataclass(frozen=True)
class Faulty:
    """How a flight with faults went."""

    scenario: Scenario
    flight: Flight
    wrong_for: int

    @classmethod
    def of(cls, scenario: Scenario, told_thrust: np.ndarray | None = None) -> Faulty:
        """Fly a scenario; the filter is told its thrust, or another."""
        told = scenario.thrust_rtn if told_thrust is None else told_thrust
        flight = fly(dataclasses.replace(scenario, thrust_rtn=told), configuration())
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
def test_phase_faults_of_any_signal(kind, seed, tracked):
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
    run = Faulty.of(simulate(FAULTS_BEGIN + 4 * len(faults) + 20, seed=seed, faults=faults))
    events = [c for _, cycles in run.scenario.truth.arcs.values() for c in np.diff(cycles)]
    size = 1.0 if kind == "slip" else 0.5
    assert np.count_nonzero(np.abs(events) == size) >= len(faults)
    assert run.flight.is_fixed[1:].all()
    assert run.flight.error[FAULTS_BEGIN:].max() < BACK_BOUND
    assert run.wrong_for <= LONGEST_WRONG


def test_clock_jumps(seed):
    """Jumps of 1 ms forwards and backwards at both receivers."""
    jumps = [(name, size) for name in ("deputy", "chief") for size in (1e-3, -1e-3)]
    faults = [
        Fault("clock_jump", name, FAULTS_BEGIN + 15.0 * number, seconds=size)
        for number, (name, size) in enumerate(jumps)
    ]
    run = Faulty.of(simulate(FAULTS_BEGIN + 80, seed=seed, faults=faults))
    assert run.flight.is_fixed[1:].all()
    assert run.flight.error[FAULTS_BEGIN:].max() < BACK_BOUND
    assert run.wrong_for <= LONGEST_WRONG


def test_outage(seed):
    """60 s without any satellite: predicted with an honest covariance, back within 30 s."""
    begin, end = FAULTS_BEGIN + 30, FAULTS_BEGIN + 90
    faults = [Fault("outage", name, float(begin), 60.0) for name in ("chief", "deputy")]
    run = Faulty.of(simulate(end + 120, seed=seed, faults=faults))
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


def schedule() -> list[tuple[int, int, np.ndarray]]:
    """Return begin, end and acceleration of the manoeuvres, s and m/s2."""
    # The thrust is a third of a quantum beside what can be told.
    size = CAP - QUANTUM / 3.0
    planned, begin = [], FAULTS_BEGIN + 30
    for direction, duration in MANOEUVRES:
        for sign in (1.0, -1.0):
            planned.append((begin, begin + duration, sign * size * np.array(direction)))
            begin += duration + PAUSE
    return planned


def test_manoeuvres_at_the_cap(seed):
    """1.4 m/s2, told in pieces of 1 s and to 1e-5 m/s2: back under 2 mm within 10 s of the end.

    Once back, the RMS stays below, but not every epoch: thrust is believed to 5e-4, so that the
    velocity is to be found anew, while the plasma is estimated too. By the covariance the 3-D
    sigma is 1.3 mm after 10 s and 1.0 mm after 26 s; single epochs of 2.0 to 2.4 mm followed 5 of
    48 manoeuvres (6 seeds). Where thrust may be believed to 5e-5, as that of the emulated thrusters
    may, no epoch is above (at most 1.91 mm after the 48).
    """
    planned = schedule()

    def thrust_rtn(second: int) -> np.ndarray:
        return sum((a for b, e, a in planned if b <= second < e), np.zeros(3))

    scenario = simulate(planned[-1][1] + PAUSE, seed=seed, thrust_rtn=thrust_rtn)
    told = QUANTUM * np.rint(scenario.thrust_rtn / QUANTUM)
    run = Faulty.of(scenario, told)
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

    exact = configuration(thrust_relative_sigma=5e-5)
    trusting = fly(dataclasses.replace(scenario, thrust_rtn=told), exact)
    print(f"thrust believed to 5e-5: largest {1e3 * trusting.error[after].max():.2f} mm")
    assert trusting.error[after].max() < BACK_BOUND


@pytest.mark.parametrize("scale", [1.0, 4.0], ids=["250 m", "1 km"])
def test_differential_tec(scale, seed):
    """The plasma between the spacecraft in the reference ionosphere, against the emulator's."""
    profile = load_gnss_configuration(REPOSITORY / "config/gnss/reference.yaml").profile
    deputy = CHIEF + scale * (DEPUTY_250M - CHIEF)
    scenario = simulate(1201, deputy, seed, profile)
    flight = fly(scenario, configuration())
    assert not any(wrong_of(scenario, flight))
    epochs = [tec_errors(scenario.truth, s, flight.solutions[s]) for s in range(60, 1201)]
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


def test_consistency():
    """NEES (10 min apart) and NIS of 20 seeds are inside their 95 % bounds.

    Arcs of 20 min, with NEES at 10 and 20 min: 120 degrees of freedom, bounds -24 and +27 %, and
    a million of the NIS; what has settled after 10 min does not change later. The accelerations of
    the truth are drawn from the model of the filter, and the plasma that is not there is not
    estimated: what is tested is whether the covariance follows from the assumptions.
    """
    parameters = configuration(estimate_plasma=False)
    sigma = parameters.noise_relative.empirical_sigma
    squares, innovations, freedoms = [], 0.0, 0
    for number in range(20):
        scenario = simulate(1201, seed=number, empirical_sigma=(0.0, sigma))
        flight = fly(scenario, parameters)
        assert flight.is_fixed[1:].all()
        squares.extend(flight.normalised_squares()[600::600])
        innovations += sum(s.normalised_innovation_squared for s in flight.solutions[60:])
        freedoms += sum(s.innovation_count for s in flight.solutions[60:])
    low, high = chi2.ppf((0.025, 0.975), 3 * len(squares))
    print(f"NEES {sum(squares):.1f} in [{low:.1f}, {high:.1f}]")
    assert low <= sum(squares) <= high
    low, high = chi2.ppf((0.025, 0.975), freedoms)
    print(f"NIS {innovations / freedoms:.5f} in [{low / freedoms:.5f}, {high / freedoms:.5f}]")
    assert low <= innovations <= high

"""Attitude of SNAP-1 and of a deputy that turns: errors and NEES of drawn cases, without ROS.

Sensor 60 nT, error of the field model 300 nT. NEES is e' P^-1 e over its degrees of freedom, so 1
is honest; a flight of an orbit or two has few independent errors, and scatters.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from realism.flight import Flight, Log, summarise
from realism.recording import EmulatedFormation, Recording
from realism.worlds import WORLDS

from vtff_analysis.attitude.loop import AttitudeHistory, AttitudeLoop, LoopConfiguration
from vtff_analysis.attitude.snap1 import (
    DIPOLE_COMPASS,
    DIPOLE_FINAL,
    DIPOLE_WITH_WHEEL,
    ORBITAL_PERIOD,
    ThreeAxisResult,
    fly_compass,
    fly_dipole_estimation,
    fly_kick,
    fly_three_axis,
    snap1_track,
)
from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.attitude.quaternion import (
    conjugate,
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    rotation_matrix,
)
from vtff_dynamics.attitude.rigid_body import AttitudeState
from vtff_dynamics.attitude.spacecraft import SpacecraftBody
from vtff_dynamics.constants import SECONDS_PER_DAY
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray, cross, norm
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.field_error import FieldErrorModel
from vtff_nav.relative.common.antenna_correction import Antenna, AntennaPair
from vtff_nav.relative.common.body_attitude import BodyAttitude
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.shipped_estimators import make_cdgps
from vtff_sim_bridge.attitude.magnetometer import MagnetometerModel

FIELD_SIGMA = 3e-7
"""Error of the field model on each axis, T."""
LEVER_ARM = (0.4, 0.1, -0.2828)
"""Lever arm of the deputy's antenna, m: 0.5 m from the centre of mass, most of it across z."""

_ATTITUDES = ("exact", "known", "magnetometer", "not corrected")
"""What is known of the attitude of a deputy that turns."""

_FOREVER = 1e12  # s
_CONVERGED_DEG = 5.0
_KNOWN_DEG = 0.1
_SAMPLES_OF_TEN_MINUTES = 120
_AVERAGING_HOURS = 4.0


class BelievedFieldError:
    """An error of the field drawn from what the filter takes it for: its harmonics, each Gaussian.

    Parameters
    ----------
    sigma : float
        Root mean square of each component, T.
    seed : int
    """

    def __init__(self, sigma: float, seed: int) -> None:
        self._model = FieldErrorModel(sigma)
        normal = np.random.default_rng((seed, 0xF1)).standard_normal(len(self._model.variances))
        self._coefficients = np.sqrt(self._model.variances) * normal

    def field_itrf(self, position_itrf: npt.ArrayLike) -> FloatArray:
        """Return the error at a position (3,), m, in ITRF axes, T, shape (3,)."""
        partial = self._model.partial(np.asarray(position_itrf, dtype=float), 0.0)
        error: FloatArray = partial @ self._coefficients
        return error


def _believed_track(seed: int) -> OrbitTrack:
    """Return the orbit with an error of the field that is drawn from the belief of the filter."""
    track = snap1_track()
    return OrbitTrack(
        track.epoch, track.state_gcrf(0), field_error=BelievedFieldError(FIELD_SIGMA, seed)
    )


def _believed_filter(**others: float) -> AttitudeFilterConfiguration:
    """Return the filter whose beliefs of field and drift are true: what is drawn once stays."""
    return AttitudeFilterConfiguration(
        field_sigma=FIELD_SIGMA, field_time=_FOREVER, dipole_drift_time=_FOREVER, **others
    )


def pointing(seeds: range, world: str = "steady") -> None:
    """Fly eight hours of pointing with compensation on board; the first 1.5 h do not count."""
    print(
        f"pointing, {world}: seed, NEES of attitude, rate, dipole until 4 h; until 8 h; RMS error "
        "of the attitude, deg; pointing sigma, deg; largest difference of the wheel, rpm"
    )
    rows = []
    for seed in seeds:
        result = _fly_pointing(world, seed)
        history = result.history
        late = history.time > 1.5 * 3600.0
        rows.append([*_nees(history, late & (history.time <= 4.0 * 3600.0)), *_nees(history, late)])
        error = np.degrees(np.sqrt((history.rotation_error[late] ** 2).mean(axis=0)))
        print(
            seed, np.round(rows[-1], 2), error.round(2),
            history.angles_deg[late].std(axis=0).round(2),
            round(max(np.abs(result.wheel_variation_rpm))), flush=True,
        )  # fmt: skip
    print(f"{len(rows)} flights: mean NEES {np.mean(rows, axis=0).round(2)}", flush=True)


def pointing_drifting(seeds: range) -> None:
    """Fly the same with a dipole that drifts by 10 % a day in a drawn direction."""
    pointing(seeds, "drifting")


def pointing_believed(seeds: range) -> None:
    """Fly the same with field, drift and torques drawn from what the filter believes of them.

    This is the test of its covariance: the other worlds are as likely as the table makes them. A
    dipole that stays, in a world without torques that nobody models, uses neither margin.
    """
    pointing(seeds, "believed")


def _fly_pointing(world: str, seed: int) -> ThreeAxisResult:
    normal = np.random.default_rng((seed, 0xD1)).standard_normal(3)
    if world == "believed":
        belief = _believed_filter()
        return fly_three_axis(
            "estimated", 8.0, FIELD_SIGMA, seed,
            dipole_rate=SECONDS_PER_DAY * belief.dipole_drift_sigma * normal,
            track=_believed_track(seed), filter_configuration=belief,
            torque_noise=belief.torque_noise,
        )  # fmt: skip
    drift = 0.1 * norm(DIPOLE_FINAL) * normal / norm(normal)
    steady = world == "steady"
    return fly_three_axis(
        "estimated", 8.0, FIELD_SIGMA, seed, dipole_rate=np.zeros(3) if steady else drift
    )


def _nees(history: AttitudeHistory, rows: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> FloatArray:
    parts = [history.normalised_error_squared(first, 3)[rows].mean() for first in (0, 3, 6)]
    return np.array(parts)


def robust(seeds: range, wheel_rpm: float = -2700.0, believed: bool = False) -> None:
    """Fly three orbits from drawn attitudes: bias 0.5 uT, inertia 5 % wrong, drifting dipole."""
    print("robust: orbits until it stays below 5 deg; RMS of the last orbit, deg; NEES of it")
    rows = []
    for seed in seeds:
        history = _fly_robust(seed, wheel_rpm, believed)
        late = history.time > history.time[-1] - ORBITAL_PERIOD
        off = np.nonzero(~(history.attitude_error_deg < _CONVERGED_DEG))[0]
        converged = (off[-1] + 1) * 5.0 / ORBITAL_PERIOD if len(off) else 0.0
        rms = math.sqrt(float(np.mean(history.attitude_error_deg[late] ** 2)))
        rows.append([converged, rms, *_nees(history, late)])
        print(seed, np.round(rows[-1], 2), flush=True)
    table = np.array(rows)
    errors = table[:, 1]
    print(
        f"latest {table[:, 0].max():.2f} orbits; {(errors <= 1.0).sum()} of {len(table)} "
        f"<= 1 deg, median {np.median(errors):.2f}, worst {errors.max():.2f}; "
        f"mean NEES {table[:, 2:].mean(axis=0).round(2)}"
    )


def _fly_robust(seed: int, wheel_rpm: float, believed: bool) -> AttitudeHistory:
    generator = np.random.default_rng((seed, 0x50))
    quaternion = generator.standard_normal(4)
    rate = 2e-3 * generator.standard_normal(3)
    inertia = np.array([0.055, 0.058, 0.056])
    wrong = 0.05 * generator.choice([-1.0, 1.0], 3)
    bias, drift = generator.standard_normal((2, 3))
    if believed:
        belief = _believed_filter(bias_sigma=0.3e-6, inertia_sigma=0.05)
        track = _believed_track(seed)
        wrong = belief.inertia_sigma * generator.standard_normal(3)
        bias, drift = belief.bias_sigma * bias, SECONDS_PER_DAY * belief.dipole_drift_sigma * drift
    else:
        belief = AttitudeFilterConfiguration(
            field_sigma=FIELD_SIGMA, bias_sigma=0.3e-6, inertia_sigma=0.05
        )
        track = snap1_track(FIELD_SIGMA, seed)
        bias, drift = 0.5e-6 * bias / norm(bias), 0.1 * norm(DIPOLE_FINAL) * drift / norm(drift)
    body = SpacecraftBody(inertia=inertia, dipole=DIPOLE_FINAL, dipole_rate=drift)
    configuration = LoopConfiguration(
        body=body,
        believed_body=BodyModel(inertia=inertia * (1.0 + wrong)),
        magnetometer=MagnetometerModel(bias=bias),
        filter=belief,
    )
    start = AttitudeState(
        quaternion / np.linalg.norm(quaternion), rate, body.wheel_momentum(wheel_rpm)
    )
    mode = "point" if wheel_rpm else "off"
    loop = AttitudeLoop(track, configuration, start, seed, mode, mode)
    return loop.fly(round(3.0 * ORBITAL_PERIOD / track.period))


def robust_free(seeds: range) -> None:
    """Fly the same without wheel and control."""
    robust(seeds, 0.0)


def robust_believed(seeds: range) -> None:
    """Fly the same with bias, inertia, drift and field drawn from what the filter believes."""
    robust(seeds, believed=True)


def six_states(seeds: range) -> None:
    """Estimate the dipole with the paper's filter, without the wheel and at -2700 rpm.

    The bound of Cramer and Rao comes from the true motion and field, not from the filter: no
    estimator has smaller errors. What of errors within 10 mA m2 can be expected is the share of a
    Gaussian of that covariance.
    """
    print(
        "six states: rpm, seed, errors (mA m2) of x, y, z after 10 min, the filter's sigmas, "
        "the bound (1 sigma); errors at the end, the bound there"
    )
    for wheel_rpm in (0.0, -2700.0):
        errors, bounds, rows = [], [], []
        for seed in seeds:
            result = fly_dipole_estimation(wheel_rpm, seed=seed)
            error = result.dipole - result.true_dipole
            row, last = _SAMPLES_OF_TEN_MINUTES, len(error)
            bound, end = result.bound(row), np.sqrt(np.diag(result.bound(last)))
            errors.append(error[row - 1])
            bounds.append(bound)
            rows.append(
                [result.normalised_error_squared(row - 1), result.normalised_error_squared(-1),
                 (result.sigma[row - 1] / np.sqrt(np.diag(bound))).max(),
                 bool((np.abs(error[-1]) <= 5e-3).all())]
            )  # fmt: skip
            print(
                wheel_rpm, seed, (1e3 * np.abs(error[row - 1])).round(1),
                (1e3 * result.sigma[row - 1]).round(1), (1e3 * np.sqrt(np.diag(bound))).round(1),
                (1e3 * np.abs(error[-1])).round(2), (1e3 * end).round(2), flush=True,
            )  # fmt: skip
        _print_six_states(
            wheel_rpm, np.array(errors), np.array(bounds), np.array(rows, dtype=float)
        )


def _print_six_states(
    wheel_rpm: float, errors: FloatArray, bounds: FloatArray, rows: FloatArray
) -> None:
    """Print errors after ten minutes, (flights, 3), beside what their bounds let expect."""
    ratio = errors / np.sqrt(np.einsum("ijj->ij", bounds))
    axes = ratio.size
    counts = ", ".join(
        f"{(np.abs(ratio) <= limit).sum()} ({axes * share:.1f} +- "
        f"{math.sqrt(axes * share * (1.0 - share)):.1f}) within {limit}"
        for limit, share in ((1, 0.6827), (2, 0.9545), (3, 0.9973))
    )
    normal = np.random.default_rng(17).standard_normal((20000, 3))
    inside = np.array(
        [
            (np.abs(normal @ np.linalg.cholesky(bound).T) <= 0.01).all(axis=1).mean()
            for bound in bounds
        ]
    )
    squares = np.einsum("ij,ijk,ik->i", errors, np.linalg.inv(bounds), errors) / 3.0
    rms = np.sqrt((ratio**2).mean(axis=0))
    met = (np.abs(errors) <= 0.01).all(axis=1).sum()
    scatter = math.sqrt(float((inside * (1.0 - inside)).sum()))
    print(
        f"{wheel_rpm:g} rpm, {len(errors)} flights, after 10 min: errors over the bound of Cramer "
        f"and Rao, RMS of x, y, z {rms.round(2)}; of {axes} errors (a Gaussian: expected) "
        f"{counts} sigma; squared by its covariance {squares.mean():.2f}\n"
        f"  every error <= 10 mA m2 in {met}; an estimator at the bound: {inside.sum():.1f} +- "
        f"{scatter:.1f}; "
        f"the filter's sigma over the bound at most {rows[:, 2].max():.2f}; its NEES "
        f"{rows[:, 0].mean():.2f}, at the end {rows[:, 1].mean():.2f}; every error <= 5 mA m2 at "
        f"the end in {rows[:, 3].sum():.0f}",
        flush=True,
    )


def averaging(seeds: range) -> None:
    """Take the mean of the measured field for the direction of the dipole, as the paper did.

    Compass mode of 4 h without wheel and at -1000 rpm, from a swing of 20 deg and from rest in a
    drawn attitude; the dipoles of equations 3, 4 (the one with the wheel) and 14.
    """
    print("averaging: angle between the mean field and the dipole, deg")
    dipoles = {"(3)": DIPOLE_COMPASS, "(4)": DIPOLE_WITH_WHEEL, "(14)": DIPOLE_FINAL}
    for wheel_rpm in (0.0, -1000.0):
        for start, released in (("from a swing of 20 deg", False), ("released at rest", True)):
            for name, dipole in dipoles.items():
                errors = np.array(
                    [
                        fly_compass(
                            wheel_rpm, _AVERAGING_HOURS, seed, released, dipole
                        ).direction_error_deg
                        for seed in seeds
                    ]
                )
                print(
                    f"{wheel_rpm:g} rpm, {start}, dipole {name}: median {np.median(errors):.1f}, "
                    f"{errors.min():.1f} to {errors.max():.1f}: {errors.round(1)}",
                    flush=True,
                )


def kick(seeds: range) -> None:
    """Fire from rest against the field, and after an orbit of compass mode; without damping.

    The row asks for the pendulum formula with the field at the place of the firing, within 5 %:
    the first number, from rest. The field of an orbit is not that of one place: until the peak, 150
    s later, it grows by 10 % and turns. The other numbers take that into the pendulum: the mean of
    the field until the peak, and with it the state just after the firing and the turn of the field.
    """
    print(
        "kick: peak over a pendulum less 1, %: field at the place of the firing (the row), its "
        "mean until the peak, from the state at the firing; from rest | with what swings already"
    )
    rows = []
    for seed in seeds:
        row: list[float] = []
        for settled in (False, True):
            flight = fly_kick(damped=False, strengths=(1.0,), seed=seed, settled=settled)
            pendulums = (flight.formula_deg, flight.mean_field_formula_deg, flight.actual_deg)
            row += [100.0 * float(flight.peak_deg[0] / peak[0] - 1.0) for peak in pendulums]
        rows.append(row)
        print(seed, np.round(row[:3], 2), "|", np.round(row[3:], 2), flush=True)
    table = np.array(rows)
    within = (np.abs(table) <= 5.0).sum(axis=0)
    print(
        f"of {len(table)}, within 5 % of the pendulum in the field at the place of the firing (the "
        f"row) {within[0]} from rest, {within[3]} with what swings; in the mean of the field "
        f"{within[1]}, {within[4]}; from the state at the firing {within[2]}, {within[5]}"
    )
    print(
        f"from rest: mean and scatter {table[:, 0].mean():.2f} +- {table[:, 0].std():.2f} % at the "
        f"place, {table[:, 1].mean():.2f} +- {table[:, 1].std():.2f} % with the mean of the field"
    )


def lever_arm(seeds: range, seconds: int = 600) -> None:
    """Navigate to a deputy that turns once an orbit about the radial axis, antenna to the zenith.

    The errors of the attitude are a bias and a slow wave (known: the whole rotation is 0.1 deg,
    root mean square over flights, 0.058 deg about each axis), and those of the magnetometer-only
    estimator of a flight of SNAP-1; the filter takes neither for what it is. Of an error that stays
    only the motion tells, and little in ten minutes: 0.1 deg of 0.5 m are 0.71 mm over many flights
    (0.87 mm where all of it is across the arm, 1.23 mm with 0.1 deg about each axis). Each flight
    draws one such error, so that only means over flights say something of the covariance.
    """
    print(
        "lever arm: RMS, largest error, stated sigma (mm), NEES of position, wrong integers; error "
        "that the attitude alone makes of the lever arm, RMS (mm)"
    )
    flown: dict[str, list[tuple[Flight, float]]] = {name: [] for name in _ATTITUDES}
    for seed in seeds:
        recording = _record_turning(seed, seconds)
        for name, flights in flown.items():
            flights.append(_navigate_to_turning(recording, seed, name))
            print(seed, f"{name:14s}", _lever_arm_figures(flights[-1:]), flush=True)
    for name, flights in flown.items():
        print(f"{len(flights)} flights, {name}: {_lever_arm_figures(flights)}", flush=True)


def _lever_arm_figures(flown: list[tuple[Flight, float]]) -> str:
    world, flights = WORLDS["ideal"], [flight for flight, _ in flown]
    figures, spread = summarise(flights, world), ""
    if len(flights) > 1:
        each = [summarise([flight], world).nees_position for flight in flights]
        spread = f"+-{figures.nees_scatter:.2f} ({min(each):.2f} to {max(each):.2f}) "
    return (
        f"{figures.rms:.2f} {figures.largest:.2f} {figures.sigma:.2f} "
        f"{figures.nees_position:.2f} {spread}{figures.wrong} of {figures.integers}; "
        f"{math.sqrt(float(np.mean([moved**2 for _, moved in flown]))):.2f}"
    )


def _record_turning(seed: int, seconds: int) -> Recording:
    scenario, gnss = WORLDS["ideal"].make(seed, seconds)
    chief, deputy = gnss.receivers
    deputy = dataclasses.replace(deputy, lever_arm_body=LEVER_ARM)
    gnss = dataclasses.replace(gnss, receivers=(chief, deputy))
    formation = EmulatedFormation(gnss, scenario, _turning_about_the_radial_axis)
    recording = []
    for _ in range(seconds):
        recording.append(formation.measure(np.zeros(3)))
        formation.advance(np.zeros(3))
    return recording


def _navigate_to_turning(recording: Recording, seed: int, name: str) -> tuple[Flight, float]:
    """Return the flight of the filter, and what the attitude alone moves the antenna, RMS, mm."""
    antenna = Antenna(lever_arm_body=LEVER_ARM, attitude_frame="estimated")
    pair = AntennaPair(deputy=Antenna() if name == "not corrected" else antenna)
    estimator = make_cdgps(dataclasses.replace(EstimatorSetting(), antennas=pair))
    error_of = _attitude_errors(seed, name)
    log, moved = Log(), []
    for number, second in enumerate(recording):
        for ephemeris in second.ephemerides:
            estimator.add_ephemeris(ephemeris)
        log.add(number, second, estimator.process(second.time, *second.epochs))
        if number % 5 == 0:
            state = second.state_deputy_gcrf
            true, rate = _turning_about_the_radial_axis(state, number)
            # The errors are given in axes to the front, against the normal and to the Earth.
            turn = rotation_matrix(true).T @ _orbit_axes(state)
            error, rate_error, covariance, correction = error_of(number)
            moved.append(norm(cross(turn @ error, np.array(LEVER_ARM))))
            wrong = multiply(true, conjugate(from_rotation_vector(turn @ error)))
            estimator.add_attitude(
                BodyAttitude(
                    second.time,
                    wrong,
                    rate - turn @ rate_error,
                    turn @ covariance @ turn.T,
                    turn @ correction,
                )
            )
    return log.flight(), 1e3 * math.sqrt(float(np.mean(np.square(moved))))


def _orbit_axes(state_gcrf: FloatArray) -> FloatArray:
    radial, along, normal = rotation_gcrf_to_rtn(state_gcrf)
    return np.column_stack((along, -normal, -radial))


def _turning_about_the_radial_axis(
    state_gcrf: FloatArray, second: int
) -> tuple[FloatArray, FloatArray]:
    position, velocity = state_gcrf[:3], state_gcrf[3:]
    radial, along, normal = rotation_gcrf_to_rtn(state_gcrf)
    orbit_rate = norm(cross(position, velocity)) / float(position @ position)
    angle = orbit_rate * second
    x = math.cos(angle) * along + math.sin(angle) * normal
    to_gcrf = np.column_stack((x, cross(-radial, x), -radial))
    rate = to_gcrf.T @ (orbit_rate * (normal + radial))
    return from_rotation_matrix(np.ascontiguousarray(to_gcrf)), rate


def _attitude_errors(
    seed: int, name: str
) -> Callable[[int], tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Return errors of attitude (rad) and rate (rad/s), covariance and correction of the first.

    The rate of the attitude that is known is known, too; of its corrections nothing is told.
    """
    if name == "magnetometer":
        history = fly_three_axis("estimated", 4.0, FIELD_SIGMA, seed).history
        first = len(history.time) // 2
        return lambda second: (
            history.rotation_error[first + second // 5],
            history.rate_error[first + second // 5],
            history.covariance[first + second // 5, :3, :3],
            history.correction[first + second // 5],
        )
    generator = np.random.default_rng((seed, 77))
    sigma = math.radians(_KNOWN_DEG if name == "known" else 0.0) / math.sqrt(3.0)
    bias = math.sqrt(0.5) * sigma * generator.standard_normal(3)
    phase = generator.uniform(0.0, 2.0 * math.pi, 3)
    covariance = max(sigma, 1e-6) ** 2 * np.eye(3)
    return lambda second: (
        bias + sigma * np.sin(2.0 * math.pi * second / 5900.0 + phase),
        np.zeros(3),
        covariance,
        np.full(3, math.nan),
    )


CASES: dict[str, Callable[[range], None]] = {
    case.__name__: case
    for case in (
        pointing,
        pointing_drifting,
        pointing_believed,
        robust,
        robust_free,
        robust_believed,
        six_states,
        averaging,
        kick,
        lever_arm,
    )
}


def fly_cases(description: str | None, cases: Mapping[str, Callable[[range], None]]) -> None:
    """Fly the cases that the command line names, with its seeds; all by default.

    Parameters
    ----------
    description
        What ``--help`` says of the program.
    cases
        Functions that fly the given seeds, by name.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", metavar="case", help=f"{', '.join(cases)}; default all")
    parser.add_argument("--seeds", type=int, default=3, help="flights of each case (3)")
    parser.add_argument("--first-seed", type=int, default=1, help="seed of the first flight (1)")
    given = parser.parse_args()
    unknown = sorted(set(given.cases) - set(cases))
    if unknown:
        parser.error(f"no case {unknown[0]!r}")
    for name in given.cases or cases:
        cases[name](range(given.first_seed, given.first_seed + given.seeds))


if __name__ == "__main__":
    fly_cases(__doc__, CASES)

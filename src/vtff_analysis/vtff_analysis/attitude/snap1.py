"""Flights of the SNAP-1 study (Steyn and Hashida 2001): what the paper flew, in the closed loop.

Each function flies one case and returns its numbers and history; `vtff study snap1` shows them
beside the paper's. What the paper does not give is assumed here and said in `ASSUMPTIONS`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from vtff_analysis.attitude.dipole_bound import dipole_bound
from vtff_analysis.attitude.loop import AttitudeHistory, AttitudeLoop, LoopConfiguration
from vtff_control.attitude.compensation import (
    PAPER_COMPENSATION_FINAL,
    PAPER_COMPENSATION_FIRST,
)
from vtff_control.attitude.controller import AttitudeControlConfiguration, ControlMode
from vtff_control.attitude.pointing import MomentumGains
from vtff_dynamics.attitude.magnetic_field import DrawnFieldError
from vtff_dynamics.attitude.orbit_axes import (
    orbit_rate,
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.attitude.pendulum import swing_peak
from vtff_dynamics.attitude.quaternion import from_rotation_matrix, from_rotation_vector, multiply
from vtff_dynamics.attitude.rigid_body import AttitudeState
from vtff_dynamics.attitude.spacecraft import SpacecraftBody, TorqueWindow
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.time.timescales import parse_epoch
from vtff_dynamics.vectors import FloatArray, cross, norm
from vtff_nav.attitude.attitude_filter import FilterPeriod
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.dipole_estimator import DipoleEstimator, DipoleEstimatorConfiguration

__all__ = [
    "ASSUMPTIONS",
    "DIPOLE_COMPASS",
    "DIPOLE_FINAL",
    "DIPOLE_WITH_WHEEL",
    "ORBITAL_PERIOD",
    "AxisStatistics",
    "CompassResult",
    "DetumbleResult",
    "DipoleResult",
    "KickResult",
    "ThreeAxisResult",
    "fly_autonomous",
    "fly_compass",
    "fly_detumble",
    "fly_dipole_estimation",
    "fly_kick",
    "fly_three_axis",
    "snap1_track",
]

DIPOLE_COMPASS = np.array([0.033, 0.063, -0.187])
"""Dipole of equation 3, A m2."""

DIPOLE_WITH_WHEEL = np.array([0.034, 0.042, -0.165])
"""Dipole of equation 4, which the paper found with the wheel at -1000 rpm, A m2."""

DIPOLE_FINAL = np.array([0.034, 0.036, -0.12])
"""Dipole of equation 14, A m2."""

ORBITAL_PERIOD = 5931.0
"""Period of the 704 km orbit, s."""

_EPOCH = parse_epoch("2001-02-08T00:00:00 UTC")
_ORBIT = ClassicalElements(7.082e6, 1e-3, math.radians(98.1), 1.0, 0.5, 0.0)

ASSUMPTIONS = (
    "principal moments 0.055, 0.058, 0.056 kg m2 (paper: one number, 0.058)",
    "wheel 1.91e-5 kg m2 (0.01 N m s at 5000 rpm), motor 1 mN m",
    "node and argument of latitude at the epoch, phase of the Earth's rotation",
    "gains of the torquers; nutation damping 0.03 1/s, wheel momentum 0.003 1/s",
    "no cross coupling of the rods: the paper names it and gives no numbers",
    "drag, sunlight and the on-board estimator's own errors of 2000-2001",
)
"""Values that the paper does not give and that the flights take."""


def snap1_track(field_sigma: float = 0.0, seed: int = 1) -> OrbitTrack:
    """Return the orbit of SNAP-1 on 2001-02-08, with a drawn error of the field, T on each axis."""
    error = DrawnFieldError(field_sigma, seed) if field_sigma > 0.0 else None
    return OrbitTrack(_EPOCH, _ORBIT.to_state(), field_error=error)


def _compass_start(
    track: OrbitTrack, body: SpacecraftBody, tilt: float, wheel_rpm: float, seed: int
) -> AttitudeState:
    """Return an attitude with the dipole at an angle to the field, turning with the field."""
    generator = np.random.default_rng((seed, 7))
    field, later = track.true_field_gcrf(0), track.true_field_gcrf(1)
    moment = np.asarray(body.dipole, dtype=float)

    def axes(first: FloatArray, helper: FloatArray) -> FloatArray:
        first = first / norm(first)
        second = cross(first, helper)
        second /= norm(second)
        return np.array([first, second, cross(first, second)])

    if wheel_rpm == 0.0:
        matrix = axes(field, generator.standard_normal(3)).T @ axes(moment, np.eye(3)[1])
    else:
        # The spin axis is along the orbit normal; the rest of the dipole follows the field.
        spin = rotation_gcrf_to_orbit(track.state_gcrf(0))[1]
        matrix = axes(spin, field).T @ axes(np.eye(3)[1], moment)
    quaternion = from_rotation_matrix(np.ascontiguousarray(matrix))
    about = cross(moment, generator.standard_normal(3))
    quaternion = multiply(quaternion, from_rotation_vector(tilt * about / norm(about)))
    turn = cross(field, later) / float(field @ field) / track.period
    return AttitudeState(quaternion, matrix.T @ turn, body.wheel_momentum(wheel_rpm))


def _at_rest(body: SpacecraftBody, wheel_rpm: float, seed: int) -> AttitudeState:
    """Return a drawn attitude that does not turn."""
    quaternion = np.random.default_rng((seed, 3)).standard_normal(4)
    quaternion /= np.linalg.norm(quaternion)
    return AttitudeState(quaternion, np.zeros(3), body.wheel_momentum(wheel_rpm))


@dataclass(frozen=True)
class CompassResult:
    """Compass mode: table 2 and figure 2.

    Attributes
    ----------
    mean_field_ut
        Mean of the measured field, uT, body axes, shape (3,).
    direction_error_deg
        Angle between it and the dipole: the error of the paper's averaging method.
    oscillations_per_orbit
        From the strongest line of the field across the dipole.
    history
        The flight.
    """

    mean_field_ut: FloatArray
    direction_error_deg: float
    oscillations_per_orbit: float
    history: AttitudeHistory


def fly_compass(
    wheel_rpm: float = 0.0,
    hours: float = 24.0,
    seed: int = 1,
    released: bool = False,
    dipole: npt.ArrayLike = DIPOLE_COMPASS,
) -> CompassResult:
    """Fly compass mode without control from a swing of 20 deg, as between two passes.

    With `released` the start is at rest in a drawn attitude, and nothing has damped the swing. The
    mean of the field is then still along the dipole, but no longer with a wheel: its momentum has
    the dipole turn about other axes than the field, and the paper's averaging method, equations 1
    to 5, is wrong by up to 130 deg.
    """
    track = snap1_track()
    body = SpacecraftBody(dipole=dipole)
    if released:
        start = _at_rest(body, wheel_rpm, seed)
    else:
        start = _compass_start(track, body, math.radians(20.0), wheel_rpm, seed)
    loop = AttitudeLoop(
        track,
        LoopConfiguration(body=body, control=AttitudeControlConfiguration()),
        start,
        seed,
        requested="off",
        first="off",
        estimates=False,
    )
    history = loop.fly(round(hours * 3600.0 / track.period))
    mean = history.field_body.mean(axis=0)
    moment = np.asarray(dipole, dtype=float)
    direction = moment / norm(moment)
    error = math.degrees(math.acos(float(mean @ direction) / norm(mean)))
    across = history.field_body - np.outer(history.field_body @ direction, direction)
    power = (np.abs(np.fft.rfft(across * np.hanning(len(across))[:, None], axis=0)) ** 2).sum(
        axis=1
    )
    frequency = np.fft.rfftfreq(len(across), track.period) * ORBITAL_PERIOD
    # Below four in an orbit lies the field itself, which turns twice.
    fast = frequency > 4.0
    # The swing is a band (its frequency goes with the root of the field): its centre.
    centre = float((frequency[fast] * power[fast]).sum() / power[fast].sum())
    return CompassResult(1e6 * mean, error, centre, history)


@dataclass(frozen=True)
class DipoleResult:
    """The paper's estimator, figure 5.

    Attributes
    ----------
    time
        s.
    dipole
        Estimate, A m2, one row for each sample.
    covariance
        Its covariance, shape (samples, 3, 3).
    true_dipole
        A m2.
    rate_body, field_body
        True rate (rad/s) and field (T) at the start and at each sample, shape (samples + 1, 3).
    rate_sigma
        Noise of the samples, rad/s.
    wheel_momentum
        N m s, body axes, shape (3,).
    """

    time: FloatArray
    dipole: FloatArray
    covariance: FloatArray
    true_dipole: FloatArray
    rate_body: FloatArray
    field_body: FloatArray
    rate_sigma: float
    wheel_momentum: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Sigma of each axis, A m2, one row for each sample."""
        sigma: FloatArray = np.sqrt(np.einsum("ijj->ij", self.covariance))
        return sigma

    def bound(self, samples: int) -> FloatArray:
        """Return the smallest covariance of the dipole after some samples, shape (3, 3)."""
        return dipole_bound(
            self.rate_body[: samples + 1],
            self.field_body[: samples + 1],
            float(self.time[0]),
            BodyModel().inertia_matrix,
            self.wheel_momentum,
            self.rate_sigma,
        )

    def normalised_error_squared(self, row: int) -> float:
        """Return the NEES of a row over its three axes."""
        error = self.dipole[row] - self.true_dipole
        return float(error @ np.linalg.solve(self.covariance[row], error)) / 3.0


def fly_dipole_estimation(
    wheel_rpm: float = -2700.0,
    samples: int = 1708,
    rate_sigma: float = 5e-4,
    seed: int = 1,
) -> DipoleResult:
    """Estimate the dipole from measured fields and noisy rates in compass mode."""
    track = snap1_track()
    body = SpacecraftBody(dipole=DIPOLE_FINAL)
    start = _compass_start(track, body, math.radians(20.0), wheel_rpm, seed)
    loop = AttitudeLoop(
        track, LoopConfiguration(body=body), start, seed, requested="off", first="off",
        estimates=False,
    )  # fmt: skip
    generator = np.random.default_rng((seed, 5))
    estimator = DipoleEstimator(BodyModel(), DipoleEstimatorConfiguration(rate_sigma=rate_sigma))
    rates, fields = np.empty((samples + 1, 3)), np.empty((samples + 1, 3))
    dipole, covariance = np.empty((samples, 3)), np.empty((samples, 3, 3))
    last = loop.step().report.field_body[-1]
    momentum = body.wheel_momentum(wheel_rpm)
    rates[0], fields[0] = _rate_and_field(loop)
    for row in range(samples):
        step = loop.step()
        rates[row + 1], fields[row + 1] = _rate_and_field(loop)
        field = step.report.field_body[-1]
        nothing = np.zeros(3)
        estimator.predict(
            FilterPeriod(track.period, nothing, nothing, nothing, momentum, momentum, nothing),
            last,
            field,
        )
        last = field
        estimator.update(step.truth.rate_body + rate_sigma * generator.standard_normal(3))
        dipole[row] = estimator.dipole
        covariance[row] = estimator.covariance[3:, 3:]
    time = track.period * np.arange(1.0, samples + 1.0)
    axis = np.asarray(body.wheel_axis, dtype=float)
    return DipoleResult(
        time, dipole, covariance, DIPOLE_FINAL, rates, fields, rate_sigma, momentum * axis
    )


def _rate_and_field(loop: AttitudeLoop) -> tuple[FloatArray, FloatArray]:
    """Return true rate and field now, body axes."""
    state = loop.spacecraft.state
    field = loop.track.true_field_gcrf(loop.number)
    return np.array(state.rate_body), state.rotation_gcrf_from_body.T @ field


@dataclass(frozen=True)
class AxisStatistics:
    """Mean and sigma of roll, pitch and yaw, deg, each of shape (3,)."""

    mean_deg: FloatArray
    sigma_deg: FloatArray


@dataclass(frozen=True)
class ThreeAxisResult:
    """Three-axis pointing: table 5, figures 3, 4, 6 and 7.

    Attributes
    ----------
    statistics
        After the first two orbits, in the first of which the attitude is found.
    wheel_variation_rpm
        Lowest and highest speed against -2700 rpm, after the first two orbits.
    history
        The flight.
    """

    statistics: AxisStatistics
    wheel_variation_rpm: tuple[float, float]
    history: AttitudeHistory


def three_axis_result(
    history: AttitudeHistory, skip: float = 2.0 * ORBITAL_PERIOD
) -> ThreeAxisResult:
    """Return the numbers of a flight after `skip` seconds."""
    late = history.time > skip
    angles = history.angles_deg[late]
    wheel = history.wheel_speed_rpm[late] + 2700.0
    return ThreeAxisResult(
        AxisStatistics(angles.mean(axis=0), angles.std(axis=0)),
        (float(wheel.min()), float(wheel.max())),
        history,
    )


def fly_three_axis(
    compensation: Literal["none", "first", "final", "estimated"],
    hours: float = 28.0,
    field_sigma: float = 0.0,
    seed: int = 1,
    dipole_rate: npt.ArrayLike = (0.0, 0.0, 0.0),
    track: OrbitTrack | None = None,
    filter_configuration: AttitudeFilterConfiguration | None = None,
    torque_noise: float = 0.0,
) -> ThreeAxisResult:
    """Point at nadir with the paper's compensation (6) or (14), none, or all that vtff has.

    The paper's cases have the paper's control: nutation and momentum of the wheel by torquers.
    `estimated` closes the loop on board: the estimated dipole is cancelled, also along the field,
    and the angular momentum is brought to the orbit normal.

    The dipole changes by `dipole_rate`, A m2 in a day. `track` and `filter_configuration` stand in
    for the orbit with a drawn error of the field and for the filter that counts with its sigma.
    `torque_noise` is a white torque of the world, N m sqrt(s).
    """
    track = track or snap1_track(field_sigma, seed)
    body = SpacecraftBody(dipole=DIPOLE_FINAL, dipole_rate=dipole_rate)
    moments = {
        "none": (0.0, 0.0, 0.0),
        "first": PAPER_COMPENSATION_FIRST,
        "final": PAPER_COMPENSATION_FINAL,
        "estimated": (0.0, 0.0, 0.0),
    }
    ours = compensation == "estimated"
    control = AttitudeControlConfiguration(
        compensation="estimated" if ours else "fixed",
        fixed_compensation=moments[compensation],
        shifts_along_field=ours,
        momentum=MomentumGains() if ours else MomentumGains(direction=0.0),
        lost_cone=math.pi,
    )
    state = track.state_gcrf(0)
    start = AttitudeState(
        quaternion_from_roll_pitch_yaw(0.0, 0.0, 0.0, rotation_gcrf_to_orbit(state)),
        np.array([0.0, -orbit_rate(state), 0.0]),
        body.wheel_momentum(-2700.0),
    )
    loop = AttitudeLoop(
        track,
        LoopConfiguration(
            body=body,
            filter=filter_configuration or _filter(field_sigma),
            control=control,
        ),
        start,
        seed,
        first="point",
    )
    periods = round(hours * 3600.0 / track.period)
    normal = np.random.default_rng((seed, 11)).standard_normal((periods, 3))
    torques = torque_noise / math.sqrt(track.period) * normal if torque_noise > 0.0 else None
    return three_axis_result(loop.fly(periods, torques))


def _filter(field_sigma: float) -> AttitudeFilterConfiguration:
    return AttitudeFilterConfiguration(field_sigma=field_sigma)


@dataclass(frozen=True)
class KickResult:
    """Thruster firings in compass mode: figures 8 and 9.

    Attributes
    ----------
    peak_deg
        Largest swing after each firing.
    formula_deg
        Undamped pendulum at rest, with the field at the place of the firing: 2 asin(w / 2 w_d).
    mean_field_formula_deg
        Such a pendulum with the mean strength of the field from the firing to the peak.
    actual_deg
        Undamped pendulum from the state just after each firing, with the swing that was left before
        it, the turn of the field along the orbit, and its mean strength until the peak.
    after_an_orbit_deg
        Swing that is left one orbit after the first firing; nan without damping.
    swing_deg
        Angle between dipole and field, one for each row of the history.
    history
        The flight.
    """

    peak_deg: FloatArray
    formula_deg: FloatArray
    mean_field_formula_deg: FloatArray
    actual_deg: FloatArray
    after_an_orbit_deg: float
    swing_deg: FloatArray
    history: AttitudeHistory


def fly_kick(
    torque: float = 1.9e-4,
    strengths: tuple[float, ...] = (1.0, 0.9, 0.8, 0.7, 0.6),
    orbits_between: int = 3,
    damped: bool = True,
    seed: int = 1,
    settled: bool = True,
) -> KickResult:
    """Fire for 3 s about pitch in compass mode over the equator, ascending; five times, weaker.

    The dipole is along -z with the 0.2 A m2 of the paper's model. Torquers damp throughout (compass
    mode), or until the first firing. What is left of the swing then, 1 to 6 deg that the turning
    field keeps up, adds to the kick or takes from it. With `settled` false the first firing is at
    the start, 28 deg north, from rest against the field as the pendulum formula has it.
    """
    track = snap1_track()
    body = SpacecraftBody(dipole=(0.0, 0.0, -0.2))
    start = _compass_start(track, body, 0.0, 0.0, seed)
    loop = AttitudeLoop(
        track, LoopConfiguration(body=body), start, seed, requested="compass", first="compass",
        estimates=False,
    )  # fmt: skip
    orbit = round(ORBITAL_PERIOD / track.period)
    # The second ascending pass of the equator: the first orbit settles.
    number = orbit if settled else 0
    while settled and not track.state_gcrf(number)[2] < 0.0 <= track.state_gcrf(number + 1)[2]:
        number += 1
    firings = [number + orbits_between * orbit * index for index in range(len(strengths))]
    periods = firings[-1] + round(1.2 * orbit)
    history = AttitudeHistory.empty(periods, track.period)
    swing, fired = np.empty(periods), []
    strength = [norm(track.true_field_gcrf(row)) for row in range(periods + 1)]
    for row in range(periods):
        windows = []
        if row in firings:
            kick = strengths[firings.index(row)] * torque
            windows = [TorqueWindow(0.0, 3.0, np.array([0.0, kick, 0.0]))]
        if not damped and row == max(firings[0] - 1, 0):
            loop.controller.request("off")
        history.set_row(row, loop, loop.step(windows))
        if row in firings:
            fired.append(_swing_now(loop))
        field = loop.spacecraft.state.rotation_gcrf_from_body.T @ track.true_field_gcrf(row + 1)
        swing[row] = math.degrees(math.acos(max(-1.0, min(1.0, -field[2] / norm(field)))))
    until = [first + int(swing[first : first + orbit // 5].argmax()) for first in firings]
    there = [strength[first] for first in firings]
    means = [float(np.mean(strength[a : b + 2])) for a, b in zip(firings, until, strict=True)]
    formula, mean_formula = (
        [
            _peak_from_rest_deg(body, 3.0 * share * torque, field_strength)
            for share, field_strength in zip(strengths, fields, strict=True)
        ]
        for fields in (there, means)
    )
    actual = [_swing_peak_deg(body, *now, mean) for now, mean in zip(fired, means, strict=True)]
    after = swing[firings[0] + orbit : firings[0] + orbit + orbit // 10]
    left = float(after.max()) if damped and len(after) else math.nan
    return KickResult(
        peak_deg=swing[until],
        formula_deg=np.array(formula),
        mean_field_formula_deg=np.array(mean_formula),
        actual_deg=np.array(actual),
        after_an_orbit_deg=left,
        swing_deg=swing,
        history=history,
    )


def _peak_from_rest_deg(body: SpacecraftBody, momentum: float, field_strength: float) -> float:
    """Return how far a dipole at rest along a constant field swings after a kick about y, deg."""
    inertia = float(np.asarray(body.inertia)[1, 1])
    swing_rate = math.sqrt(field_strength * norm(np.asarray(body.dipole)) / inertia)
    return 2.0 * math.degrees(math.asin(min(momentum / inertia / swing_rate / 2.0, 1.0)))


def _swing_now(loop: AttitudeLoop) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return direction of the dipole along -z, rate against the turning field, and field; GCRF."""
    track, number = loop.track, loop.number
    before, now, after = (track.true_field_gcrf(number + step) for step in (-1, 0, 1))
    # The field turns along the orbit: twice in an orbit and faster over the equator.
    turn = cross(before / norm(before), after / norm(after)) / (2.0 * track.period)
    rotation = loop.spacecraft.state.rotation_gcrf_from_body
    return -rotation[:, 2], rotation @ loop.spacecraft.state.rate_body - turn, now


def _swing_peak_deg(
    body: SpacecraftBody,
    direction: FloatArray,
    rate: FloatArray,
    field: FloatArray,
    field_strength: float,
) -> float:
    """Return how far a dipole swings without damping in a field of that strength, deg."""
    inertia = np.asarray(body.inertia)
    across = 0.5 * float(inertia[0, 0] + inertia[1, 1])
    along = field * (field_strength / norm(field))
    dipole = norm(np.asarray(body.dipole, dtype=float))
    return math.degrees(swing_peak(direction, rate, along, dipole, across))


@dataclass(frozen=True)
class DetumbleResult:
    """Detumbling from 5 rpm.

    Attributes
    ----------
    settled_after
        Time from which the rates about x and z stay below 0.01 rad/s, s; inf if never.
    final_rate
        Mean rate of the last orbit, rad/s, shape (3,).
    history
        The flight.
    """

    settled_after: float
    final_rate: FloatArray
    history: AttitudeHistory


def fly_detumble(
    mode: ControlMode = "thomson",
    dipole: tuple[float, float, float] = (0.0, 0.0, 0.0),
    hours: float = 24.0,
    seed: int = 1,
) -> DetumbleResult:
    """Detumble from 5 rpm about a drawn axis; the dipole of the paper makes it a compass needle."""
    track = snap1_track()
    generator = np.random.default_rng((seed, 9))
    quaternion, axis = generator.standard_normal(4), generator.standard_normal(3)
    start = AttitudeState(
        quaternion / np.linalg.norm(quaternion), 5.0 * 2.0 * math.pi / 60.0 * axis / norm(axis)
    )
    loop = AttitudeLoop(
        track, LoopConfiguration(body=SpacecraftBody(dipole=dipole)), start, seed,
        requested=mode, first=mode, estimates=False,
    )  # fmt: skip
    history = loop.fly(round(hours * 3600.0 / track.period))
    fast = np.nonzero(np.abs(history.rate_body[:, [0, 2]]).max(axis=1) > 0.01)[0]
    settled = 0.0 if not len(fast) else track.period * (fast[-1] + 1.0)
    if len(fast) and fast[-1] == len(history.time) - 1:
        settled = math.inf
    orbit = round(ORBITAL_PERIOD / track.period)
    return DetumbleResult(settled, history.rate_body[-orbit:].mean(axis=0), history)


def fly_autonomous(hours: float = 12.0, field_sigma: float = 0.0, seed: int = 1) -> ThreeAxisResult:
    """Fly from a launch tumble of 5 rpm to pointing without a hand; the last four orbits count."""
    track = snap1_track(field_sigma, seed)
    generator = np.random.default_rng((seed, 9))
    quaternion, axis = generator.standard_normal(4), generator.standard_normal(3)
    start = AttitudeState(
        quaternion / np.linalg.norm(quaternion), 5.0 * 2.0 * math.pi / 60.0 * axis / norm(axis)
    )
    configuration = LoopConfiguration(
        body=SpacecraftBody(dipole=DIPOLE_FINAL), filter=_filter(field_sigma)
    )
    loop = AttitudeLoop(track, configuration, start, seed)
    return three_axis_result(
        loop.fly(round(hours * 3600.0 / track.period)), hours * 3600.0 - 4.0 * ORBITAL_PERIOD
    )

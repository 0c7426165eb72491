"""Does a thruster do what it reports? Navigation is asked, over one, five and twenty steps.

From each navigated state of the last twenty steps the motion is continued with the thrust that
the thrusters have reported: that of the deputy, and that of a chief that thrusts too. A weak engine
changes the velocity too little in that time; the monitor then looks at one and three minutes, too.
Where the change of the velocity that navigation has found since differs by more than its own
covariance and the tolerance of healthy thrusters explain, a thruster is stuck on (it pushes
without saying so) or stuck off (it says so and does not push).

Relative navigation of one deputy does not tell whose thruster that is. A push of the chief that
nobody reports is seen by all deputies alike, one of a deputy by that deputy alone: `accused_axes`
compares them.

A step without a report has a thrust between bounds; what lies within them is no fault. A state
that navigation has predicted, without measurements, tells nothing and is not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import add_thrust, free_flight
from vtff_dynamics.vectors import FloatArray

__all__ = ["ThrustDifference", "ThrustMonitor", "accused_axes", "describe_fault"]

_WINDOWS = (1, 5, 20)  # steps
_LONG_WINDOWS = (60.0, 180.0)  # s: for weak engines
_SIGMAS = 7.0
_TOLERANCE = 0.2  # of the thrust: scale, direction and noise of a healthy thruster
_FLOOR_OF_CAP = 0.02  # s: change of velocity that is not looked at, in caps
_FLOOR = 2e-4  # m/s
# m/s: change of velocity that the longest window should contain, ten times the sigma of navigation.
_VISIBLE = 1e-3
_CERTAIN = 2.0  # of the threshold; a smaller excess must be seen twice


@dataclass(frozen=True, eq=False)
class ThrustDifference:
    """Thrust that navigation has found and nobody reports, over a window.

    Attributes
    ----------
    axes
        Which of R, T and N differ by more than can be explained, shape (3,), bool.
    residual
        Change of the relative velocity that nobody reports, m/s, shape (3,).
    reported, reported_chief
        Change of the velocity that deputy and chief report, m/s, shape (3,).
    age
        Steps of the window.
    """

    axes: np.ndarray[tuple[int], np.dtype[np.bool_]]
    residual: FloatArray
    reported: FloatArray
    reported_chief: FloatArray
    age: int


class ThrustMonitor:
    """Watches the thruster of a deputy, and that of its chief; call `update` once a step.

    Parameters
    ----------
    acceleration_cap
        Largest acceleration of the thruster, m/s2.
    step
        s.
    """

    def __init__(self, acceleration_cap: float, step: float = 1.0) -> None:
        self._floor = _FLOOR_OF_CAP * acceleration_cap + _FLOOR
        self._step = step
        self._windows = _windows(acceleration_cap, step)
        self._doubts = np.zeros(3, dtype=np.int64)
        self.reset()

    def reset(self) -> None:
        """Forget the past: a state is missing."""
        # Navigated states that are continued with the reported thrust, the youngest first. The
        # variance of a predicted one is infinite: its place keeps the count of the seconds.
        self._states_gcrf = np.empty((0, 2, 6))
        self._variance = np.empty((0, 3))
        self._reported = np.empty((0, 2, 3))  # of chief and deputy
        self._pushed = np.empty(0)
        self._unreported = np.empty((0, 3))
        self._doubts[:] = 0
        self._ages: list[int] = []
        self._residuals = np.empty((0, 3))
        self._is_known = np.empty(0, dtype=bool)

    def update(
        self,
        state_chief_gcrf: FloatArray,
        relative_rtn: FloatArray,
        covariance_rtn: FloatArray,
        reported_rtn: FloatArray,
        unreported_rtn: FloatArray | None = None,
        reported_chief_rtn: FloatArray | None = None,
        *,
        is_predicted: bool = False,
    ) -> ThrustDifference | None:
        """Take a navigated state and the thrust of the step that ends with it.

        Parameters
        ----------
        state_chief_gcrf, relative_rtn, covariance_rtn
            State of now: m and m/s, shapes (6,), (6,) and (6, 6).
        reported_rtn
            Acceleration that the thruster reported for the step before, m/s2, shape (3,).
        unreported_rtn
            How much more or less the thrusters may have given without a fault, m/s2, shape (3,);
            None for nothing.
        reported_chief_rtn
            As ``reported_rtn``, of the chief; None for a chief that does not thrust.
        is_predicted
            Whether the state rests on no measurement of this step.

        Returns
        -------
        ThrustDifference or None
            None if all thrusters do what they report.
        """
        if len(self._pushed):
            chief_rtn = np.zeros(3) if reported_chief_rtn is None else reported_chief_rtn
            self._continue(
                np.array([chief_rtn, reported_rtn]),
                np.zeros(3) if unreported_rtn is None else unreported_rtn,
            )
        self._ages = [age for age in self._windows if age <= len(self._pushed)]
        anchors = [age - 1 for age in self._ages]
        velocities = [relative_state_rtn(*self._states_gcrf[each])[3:] for each in anchors]
        variance, self._residuals, self._is_known, trips, shortest = _compare(
            relative_rtn,
            covariance_rtn.diagonal(),
            is_predicted,
            np.array(velocities).reshape(-1, 3),
            self._variance[anchors],
            _TOLERANCE * self._pushed[anchors],
            self._unreported[anchors],
            self._floor,
            self._doubts,
        )
        found = None
        if shortest >= 0:
            chief, deputy = self._reported[anchors[shortest]]
            found = ThrustDifference(
                trips[shortest], self._residuals[shortest], deputy, chief, self._ages[shortest]
            )
        self._keep(state_chief_gcrf, relative_rtn, variance)
        return found

    def residual(self, age: int) -> FloatArray | None:
        """Return the change of the velocity that nobody reports, m/s, shape (3,).

        Parameters
        ----------
        age
            Steps of the window.

        Returns
        -------
        ndarray or None
            Residuals of the last update; None if it tells nothing over such a window.
        """
        for window, residual, is_known in zip(
            self._ages, self._residuals, self._is_known, strict=True
        ):
            if window == age and is_known:
                return np.asarray(residual)
        return None

    def _keep(
        self, state_chief_gcrf: FloatArray, relative_rtn: FloatArray, variance: FloatArray
    ) -> None:
        """Put a navigated state before those of the updates before it."""
        oldest = self._windows[-1] - 1
        start = np.array([[state_chief_gcrf, deputy_state_gcrf(state_chief_gcrf, relative_rtn)]])
        self._states_gcrf = np.concatenate((start, self._states_gcrf[:oldest]))
        self._variance = np.concatenate((variance[np.newaxis], self._variance[:oldest]))
        self._reported = np.concatenate((np.zeros((1, 2, 3)), self._reported[:oldest]))
        self._pushed = np.concatenate((np.zeros(1), self._pushed[:oldest]))
        self._unreported = np.concatenate((np.zeros((1, 3)), self._unreported[:oldest]))

    def _continue(self, reported_rtn: FloatArray, unreported_rtn: FloatArray) -> None:
        """Carry the states of before over a step with the reported thrust of chief and deputy."""
        # The chiefs of all of them are metres apart, their axes the same.
        accelerations = reported_rtn @ rotation_gcrf_to_rtn(self._states_gcrf[0, 0])
        flown = free_flight(self._states_gcrf.reshape(-1, 6), [0.0, self._step])[-1]
        flown = flown.reshape(-1, 2, 6)
        add_thrust(flown, accelerations, self._step)
        self._states_gcrf = flown
        self._reported = self._reported + self._step * reported_rtn
        size = float(np.linalg.norm(np.abs(reported_rtn).sum(axis=0) + unreported_rtn))
        self._pushed = self._pushed + self._step * size
        self._unreported = self._unreported + self._step * unreported_rtn


@compiled
def _compare(
    relative_rtn: FloatArray,
    variances_rtn: FloatArray,
    is_predicted: bool,
    velocities: FloatArray,
    variance_then: FloatArray,
    allowed_push: FloatArray,
    allowed_unreported: FloatArray,
    floor: float,
    doubts: npt.NDArray[np.int64],
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_], npt.NDArray[np.bool_], int]:
    """Compare a navigated velocity with what each of n windows expects of it.

    Parameters
    ----------
    relative_rtn, is_predicted
        As of `ThrustMonitor.update`.
    variances_rtn
        Diagonal of the covariance there, shape (6,).
    velocities, variance_then
        Expected velocities, and variances of the navigated ones at the start of the windows, m/s
        and m2/s2, shape (n, 3).
    allowed_push, allowed_unreported, floor
        Differences that tell nothing, m/s, shapes (n,), (n, 3) and ().
    doubts
        How often each axis has differed one after the other, shape (3,); changed in place.

    Returns
    -------
    variance
        Variance of the navigated velocity, m2/s2, shape (3,).
    residuals
        m/s, shape (n, 3).
    is_known
        Whether both ends of a window are measured, shape (n,).
    trips
        Whether an axis differs by more than can be explained, shape (n, 3).
    shortest
        Index of the shortest window with such an axis, which tells most; -1 if there is none.
    """
    count = len(velocities)
    variance, doubted = np.empty(3), np.zeros(3, dtype=np.bool_)
    residuals, trips = np.empty((count, 3)), np.zeros((count, 3), dtype=np.bool_)
    is_known = np.ones(count, dtype=np.bool_)
    shortest = -1
    for axis in range(3):
        variance[axis] = np.inf if is_predicted else max(variances_rtn[axis + 3], 0.0)
    for window in range(count):
        for axis in range(3):
            sigma = math.sqrt(variance[axis] + variance_then[window, axis])
            threshold = floor + _SIGMAS * sigma
            threshold = threshold + allowed_push[window]
            threshold = threshold + allowed_unreported[window, axis]
            residual = relative_rtn[axis + 3] - velocities[window, axis]
            residuals[window, axis] = residual
            is_known[window] = is_known[window] and math.isfinite(sigma)
            is_over = abs(residual) > threshold
            doubted[axis] = doubted[axis] or is_over
            if abs(residual) > _CERTAIN * threshold or (is_over and doubts[axis] > 0):
                trips[window, axis] = True
                shortest = window if shortest < 0 else shortest
    for axis in range(3):
        doubts[axis] = doubts[axis] + 1 if doubted[axis] else 0
    return variance, residuals, is_known, trips, shortest


def _windows(acceleration_cap: float, step: float) -> tuple[int, ...]:
    """Return windows, in steps: longer ones until the longest contains a push that is visible."""
    windows = list(_WINDOWS)
    for seconds in _LONG_WINDOWS:
        age = round(seconds / step)
        if acceleration_cap * step * windows[-1] < _VISIBLE and age > windows[-1]:
            windows.append(age)
    return tuple(windows)


def accused_axes(
    found: ThrustDifference, others: Sequence[ThrustMonitor]
) -> tuple[np.ndarray[tuple[int], np.dtype[np.bool_]], np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Return whose thruster a difference accuses: axes of the deputy, and of the chief.

    Most of the other deputies decide: where they see the same difference it is the chief, where
    they see none it is the deputy. Without anybody to decide both are accused.

    Parameters
    ----------
    found
        Difference that one deputy sees, with a chief that thrusts.
    others
        Monitors of the other deputies, updated with the states of the same time.
    """
    residuals = [monitor.residual(found.age) for monitor in others]
    seen = [residual for residual in residuals if residual is not None]
    if not seen:
        return found.axes, found.axes
    # Nearer to what this deputy sees than to nothing.
    same = np.array(seen) * np.sign(found.residual) > 0.5 * np.abs(found.residual)
    is_chief = 2 * same.sum(axis=0) > len(seen)
    return found.axes & ~is_chief, found.axes & is_chief


def describe_fault(
    axes: np.ndarray[tuple[int], np.dtype[np.bool_]],
    residual: FloatArray,
    reported: FloatArray,
    seconds: float,
) -> str:
    """Return one line about a thruster that does not do what it reports.

    Parameters
    ----------
    axes
        Axes in question, shape (3,), bool.
    residual, reported
        Change of its spacecraft's velocity that it does not report, and that it does, m/s, shape
        (3,).
    seconds
        Length of the window, s.
    """
    # One that gives less than it says is left with a part of it.
    given, told = (residual + reported)[axes], reported[axes]
    share = np.divide(given, told, out=np.full(given.shape, np.inf), where=told != 0.0)
    stuck_on = not bool(((share > -0.1) & (share < 1.0)).all())
    names = ", ".join(name for name, is_it in zip("RTN", axes, strict=True) if is_it)
    size = math.sqrt(float(residual[axes] @ residual[axes])) / seconds
    kind = "stuck on" if stuck_on else "stuck off or weak"
    return (
        f"thruster {kind} along {names}: navigation and reported thrust differ by "
        f"{size:.3g} m/s2 over {seconds:g} s"
    )

"""Does a thruster do what it reports? Navigation is asked, over one, five and twenty seconds.

From each navigated state of the last twenty seconds the motion is continued with the thrust that
the thruster has reported. Where the change of the velocity that navigation has found since differs
by more than its own covariance and the tolerance of a healthy thruster explain, the thruster is
stuck on (it pushes without saying so) or stuck off (it says so and does not push).

A step without a report has a thrust between bounds; what lies within them is no fault. A state
that navigation has predicted, without measurements, tells nothing and is not looked at.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.vectors import FloatArray

__all__ = ["ThrustFault", "ThrustMonitor"]

_WINDOWS = (1, 5, 20)
_SIGMAS = 7.0
_TOLERANCE = 0.2  # of the thrust: scale, direction and noise of a healthy thruster
_FLOOR_OF_CAP = 0.02  # s: change of velocity that is not looked at, in caps
_FLOOR = 2e-4  # m/s
_CERTAIN = 2.0  # of the threshold; a smaller excess must be seen twice


@dataclass(frozen=True, eq=False)
class ThrustFault:
    """A thruster that does not do what it reports.

    Attributes
    ----------
    axes
        Which of R, T and N, shape (3,), bool.
    is_stuck_on
        True if it pushes more than it says, else less.
    text
        One line that says it.
    """

    axes: np.ndarray[tuple[int], np.dtype[np.bool_]]
    is_stuck_on: bool
    text: str


class ThrustMonitor:
    """Watches one thruster; call `update` once a step.

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
        self._doubts = np.zeros(3, dtype=int)
        self.reset()

    def reset(self) -> None:
        """Forget the past: a state is missing."""
        # Navigated states that are continued with the reported thrust, the youngest first. The
        # variance of a predicted one is infinite: its place keeps the count of the seconds.
        self._states_gcrf = np.empty((0, 2, 6))
        self._variance = np.empty((0, 3))
        self._reported = np.empty((0, 3))
        self._pushed = np.empty(0)
        self._unreported = np.empty((0, 3))
        self._doubts[:] = 0

    def update(
        self,
        state_chief_gcrf: FloatArray,
        relative_rtn: FloatArray,
        covariance_rtn: FloatArray,
        reported_rtn: FloatArray,
        unreported_rtn: FloatArray | None = None,
        is_predicted: bool = False,
    ) -> ThrustFault | None:
        """Take a navigated state and the thrust of the step that ends with it.

        Parameters
        ----------
        state_chief_gcrf, relative_rtn, covariance_rtn
            State of now: m and m/s, shapes (6,), (6,) and (6, 6).
        reported_rtn
            Acceleration that the thruster reported for the step before, m/s2, shape (3,).
        unreported_rtn
            How much more or less the thruster may have given without a fault, m/s2, shape (3,);
            None for nothing.
        is_predicted
            Whether the state rests on no measurement of this step.
        """
        fault = None
        trip = np.zeros(3, dtype=bool)
        doubted = np.zeros(3, dtype=bool)
        variance = np.maximum(np.diag(covariance_rtn)[3:], 0.0)
        if is_predicted:
            variance = np.full(3, np.inf)
        self._continue(reported_rtn, np.zeros(3) if unreported_rtn is None else unreported_rtn)
        for age in _WINDOWS:
            if age > len(self._pushed):
                break
            anchor = age - 1
            residual = relative_rtn[3:] - relative_state_rtn(*self._states_gcrf[anchor])[3:]
            sigma = np.sqrt(variance + self._variance[anchor])
            threshold = self._floor + _SIGMAS * sigma + _TOLERANCE * self._pushed[anchor]
            threshold = threshold + self._unreported[anchor]
            over = np.abs(residual) > threshold
            trip |= (np.abs(residual) > _CERTAIN * threshold) | (over & (self._doubts > 0))
            doubted |= over
            if trip.any() and fault is None:  # the shortest window tells most
                fault = _describe(trip, residual, self._reported[anchor], age * self._step)
        self._doubts = np.where(doubted, self._doubts + 1, 0)
        deputy = deputy_state_gcrf(state_chief_gcrf, relative_rtn)
        oldest = max(_WINDOWS) - 1
        start = np.array([[state_chief_gcrf, deputy]])
        self._states_gcrf = np.concatenate((start, self._states_gcrf[:oldest]))
        self._variance = np.concatenate((variance[np.newaxis], self._variance[:oldest]))
        self._reported = np.concatenate((np.zeros((1, 3)), self._reported[:oldest]))
        self._pushed = np.concatenate((np.zeros(1), self._pushed[:oldest]))
        self._unreported = np.concatenate((np.zeros((1, 3)), self._unreported[:oldest]))
        return fault

    def _continue(self, reported_rtn: FloatArray, unreported_rtn: FloatArray) -> None:
        """Carry the states of before over a step with the reported thrust."""
        if not len(self._pushed):
            return
        # The chiefs of all of them are metres apart, their axes the same.
        acceleration = rotation_gcrf_to_rtn(self._states_gcrf[0, 0]).T @ reported_rtn
        flown = free_flight(self._states_gcrf.reshape(-1, 6), [0.0, self._step])[-1]
        flown = flown.reshape(-1, 2, 6)
        flown[:, 1, :3] += 0.5 * self._step**2 * acceleration
        flown[:, 1, 3:] += self._step * acceleration
        self._states_gcrf = flown
        self._reported = self._reported + self._step * reported_rtn
        size = float(np.linalg.norm(np.abs(reported_rtn) + unreported_rtn))
        self._pushed = self._pushed + self._step * size
        self._unreported = self._unreported + self._step * unreported_rtn


def _describe(
    axes: np.ndarray[tuple[int], np.dtype[np.bool_]],
    residual: FloatArray,
    reported: FloatArray,
    seconds: float,
) -> ThrustFault:
    """Return the fault with its text; residual and reported are changes of the velocity."""
    # One that gives less than it says is left with a part of it.
    found, told = (residual + reported)[axes], reported[axes]
    share = np.divide(found, told, out=np.full(found.shape, np.inf), where=told != 0.0)
    stuck_on = not bool(((share > -0.1) & (share < 1.0)).all())
    names = ", ".join(name for name, is_it in zip("RTN", axes, strict=True) if is_it)
    size = math.sqrt(float(residual[axes] @ residual[axes])) / seconds
    kind = "stuck on" if stuck_on else "stuck off or weak"
    return ThrustFault(
        axes.copy(),
        stuck_on,
        f"thruster {kind} along {names}: navigation and reported thrust differ by "
        f"{size:.3g} m/s2 over {seconds:g} s",
    )

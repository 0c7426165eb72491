"""Thrust along the axes of a body whose attitude is estimated: commands in, reports back.

A formation controller commands in the RTN axes of the chief; thrusters that are fixed in the body
give along its axes. What the estimate of the attitude errs by is an error of the thrust.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.attitude.quaternion import rotation_matrix, turned_at_rate
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["BodyAxes", "KnownAttitude"]

_KEPT = 8
_LONGEST_ORBIT_AGE = 60.0  # s; without harmonics the orbit plane is then off by 1e-6 rad
_LONGEST_STEP = 5.0  # s, of the prediction of the chief: exact to 1e-7 m


@dataclass(frozen=True, eq=False)
class KnownAttitude:
    """An estimate of the attitude.

    Attributes
    ----------
    stamp_nanoseconds
        Time at which it holds, ns since 1970.
    is_valid
        False if it must not steer.
    quaternion_gcrf
        Body to GCRF, x, y, z, w, shape (4,).
    rate_body
        rad/s, shape (3,).
    """

    stamp_nanoseconds: int
    is_valid: bool
    quaternion_gcrf: FloatArray
    rate_body: FloatArray


class BodyAxes:
    """The rotation from the RTN axes of the chief to the axes of the body, as it is known on board.

    Parameters
    ----------
    longest_attitude_age : float
        Age beyond which an attitude no longer counts, s.

    Attributes
    ----------
    reason
        Why the last rotation that was asked for is not known, one line; empty if it is.
    """

    def __init__(self, longest_attitude_age: float = 60.0) -> None:
        self._longest_age = longest_attitude_age
        self._attitudes: list[KnownAttitude] = []
        self._chief: tuple[int, FloatArray] | None = None
        self.reason = ""

    def add_attitude(self, attitude: KnownAttitude) -> None:
        """Add an estimate; it counts for the commands after it until there is a newer one."""
        self._attitudes.append(attitude)
        del self._attitudes[:-_KEPT]

    def add_chief(self, stamp_nanoseconds: int, state_gcrf: FloatArray) -> None:
        """Take the orbit of the chief at a time, m and m/s, shape (6,)."""
        self._chief = stamp_nanoseconds, np.array(state_gcrf, dtype=float)

    def rotation_from_rtn(
        self, command_nanoseconds: int, start_nanoseconds: int
    ) -> FloatArray | None:
        """Return the rotation from RTN to body axes at the start of a thrust, shape (3, 3).

        Parameters
        ----------
        command_nanoseconds
            Stamp of the command. An attitude of that time does not count: whether it comes before
            or after the command must not change the thrust.
        start_nanoseconds
            Start of the thrust; attitude and orbit are predicted to it.

        Returns
        -------
        ndarray or None
            None if attitude or orbit are not known; `reason` says why.
        """
        attitude = next(
            (
                known
                for known in reversed(self._attitudes)
                if known.stamp_nanoseconds < command_nanoseconds
            ),
            None,
        )
        self.reason = self._missing(attitude, start_nanoseconds)
        if self.reason or attitude is None or self._chief is None:
            return None
        age = (start_nanoseconds - attitude.stamp_nanoseconds) / NANOSECONDS_PER_SECOND
        quaternion = turned_at_rate(attitude.quaternion_gcrf, attitude.rate_body, age)
        to_rtn = rotation_gcrf_to_rtn(_predicted(*self._chief, start_nanoseconds))
        rotation: FloatArray = (to_rtn @ rotation_matrix(quaternion)).T
        return rotation

    def _missing(self, attitude: KnownAttitude | None, start_nanoseconds: int) -> str:
        """Return what is not known of the rotation at a time; empty if nothing is."""
        if attitude is None:
            return "no attitude yet"
        if not attitude.is_valid:
            return "attitude not valid"
        age = (start_nanoseconds - attitude.stamp_nanoseconds) / NANOSECONDS_PER_SECOND
        if age > self._longest_age:
            return f"attitude is {age:.0f} s old"
        if self._chief is None:
            return "orbit of the chief not known"
        age = (start_nanoseconds - self._chief[0]) / NANOSECONDS_PER_SECOND
        if abs(age) > _LONGEST_ORBIT_AGE:
            return f"orbit of the chief is {age:.0f} s old"
        return ""


def _predicted(stamp_nanoseconds: int, state_gcrf: FloatArray, at_nanoseconds: int) -> FloatArray:
    """Return a state at another time, by the attraction of the Earth's centre."""
    span = (at_nanoseconds - stamp_nanoseconds) / NANOSECONDS_PER_SECOND
    if not span > 0.0:
        return state_gcrf
    steps = math.ceil(span / _LONGEST_STEP)
    propagator = Propagator(
        GpsTime.from_unix_nanoseconds(stamp_nanoseconds),
        state_gcrf,
        ForceModel("two_body"),
        step=span / steps,
    )
    for _ in range(steps):
        propagator.advance()
    return np.array(propagator.state_gcrf)

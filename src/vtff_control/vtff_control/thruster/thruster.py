"""A thruster without a bus: delay, cap and quantum (impulse bit) of a commanded acceleration.

The thruster is the one place where the control loop's delay is applied (paper 3.5 and figure 2:
the command computed from the state at second k acts from k+1 to k+2). The quantum of the CAN
thruster of the reference system stands in `vtff_sim_bridge.thruster.can_thruster_emulator`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray, is_finite


@dataclass(frozen=True)
class AppliedThrust:
    """Acceleration that a thruster gives over one step.

    Attributes
    ----------
    start_stamp
        Start of the step in which it acts, in nanoseconds of the scale of the command's stamp.
    acceleration_rtn
        Acceleration in m/s2 in the chief's RTN axes at the start of that step, shape (3,).
    saturated
        True if the cap limited an axis.
    reason
        Why a command was refused, one line; empty if it was not. A refused command gives zero.
    """

    start_stamp: int
    acceleration_rtn: FloatArray
    saturated: bool
    reason: str = ""


class Thruster:
    """Per-axis thruster with a delay of whole steps.

    A command is limited to the cap, rounded to the nearest multiple of the quantum (a tie goes to
    the even multiple), and limited again to the largest multiple that does not exceed the cap: a
    thruster never gives more than its cap. Without a quantum the first step is the only one.

    Parameters
    ----------
    acceleration_cap
        Largest acceleration in m/s2, for all axes or for each of R, T, N.
    quantum
        Smallest change of the acceleration in m/s2; 0 means continuous.
    delay_steps
        Whole steps between the stamp of a command and its start.
    step
        Length of a step in s.
    stuck_acceleration
        A fault: what R, T and N give whatever is commanded, m/s2; an axis of 0 is healthy.
    stuck_after
        When that fault begins, s after the first command starts to act.

    Attributes
    ----------
    isolated
        Whether R, T and N are shut off, shape (3,); such an axis gives nothing, stuck or not.

    Raises
    ------
    ValueError
        If a value is out of its range; the message names the parameter.
    """

    def __init__(
        self,
        acceleration_cap: float | Sequence[float] = 1.0,
        quantum: float = 0.0,
        delay_steps: int = 1,
        step: float = 1.0,
        stuck_acceleration: Sequence[float] = (0.0, 0.0, 0.0),
        stuck_after: float = 0.0,
    ) -> None:
        caps = np.asarray(acceleration_cap, dtype=float)
        if caps.shape not in ((), (3,)) or not np.all(caps > 0.0):
            raise ValueError(
                f"acceleration_cap: one or three positive numbers (m/s2) expected, "
                f"got {acceleration_cap!r}"
            )
        if not (np.isfinite(quantum) and quantum >= 0.0):
            raise ValueError(f"quantum: 0 or more (m/s2) expected, got {quantum!r}")
        if isinstance(delay_steps, bool) or not isinstance(delay_steps, int) or delay_steps < 0:
            raise ValueError(
                f"delay_steps: a whole number of 0 or more expected, got {delay_steps!r}"
            )
        if not (np.isfinite(step) and step > 0.0):
            raise ValueError(f"step: positive seconds expected, got {step!r}")
        self.acceleration_cap = np.array(np.broadcast_to(caps, (3,)))
        self.quantum = float(quantum)
        self.delay_steps = delay_steps
        self.step = float(step)
        stuck = np.asarray(stuck_acceleration, dtype=float)
        if stuck.shape != (3,) or not np.isfinite(stuck).all():
            raise ValueError(
                f"stuck_acceleration: three numbers (m/s2) expected, got {stuck_acceleration!r}"
            )
        self.isolated = np.zeros(3, dtype=bool)
        self._stuck = stuck.tolist()
        self._can_stick = bool(stuck.any())
        self._stuck_after = round(stuck_after * 1e9)
        self._first_start: int | None = None
        self._delay = delay_steps * round(step * 1e9)
        self._caps = self.acceleration_cap.tolist()
        # 1.4 / 0.1 is 13.999...: the slack keeps a cap that is a multiple of the quantum.
        self._quantised_caps = [
            float(np.floor(cap / quantum * (1.0 + 1e-12))) * quantum if quantum > 0.0 else cap
            for cap in self._caps
        ]

    def command(self, stamp: int, acceleration_rtn: npt.ArrayLike) -> AppliedThrust:
        """Schedule a command.

        Parameters
        ----------
        stamp
            Stamp of the command in nanoseconds: the time of the state it was computed from.
        acceleration_rtn
            Wanted acceleration in m/s2, shape (3,).

        Returns
        -------
        AppliedThrust
            What acts over the one step that starts at ``start_stamp``. A command that is not
            three finite numbers gives zero and a reason; this method does not raise on it.
        """
        start_stamp = stamp + self._delay
        wanted, reason = _usable_acceleration(acceleration_rtn)
        limited = _limit(wanted, self._caps)
        saturated = limited != wanted
        if self.quantum > 0.0:
            rounded = [round(value / self.quantum) * self.quantum for value in limited]
            limited = _limit(rounded, self._quantised_caps)
        if self._first_start is None:
            self._first_start = start_stamp
        if self._can_stick and start_stamp - self._first_start >= self._stuck_after:
            limited = [fault or value for fault, value in zip(self._stuck, limited, strict=True)]
        isolated = self.isolated.tolist()
        if True in isolated:
            given = zip(isolated, limited, strict=True)
            limited = [0.0 if is_isolated else value for is_isolated, value in given]
        # Adding zero turns a negative zero into a positive one: equal thrust, equal bytes.
        acceleration = np.array([value + 0.0 for value in limited])
        return AppliedThrust(start_stamp, acceleration, saturated, reason)


def _limit(values: Sequence[float], caps: Sequence[float]) -> list[float]:
    """Return numbers limited to caps on either side of zero."""
    # Without calls of min and max, which take most of the time.
    return [
        value if -cap <= value <= cap else cap if value > cap else -cap
        for value, cap in zip(values, caps, strict=True)
    ]


def _usable_acceleration(values: npt.ArrayLike) -> tuple[list[float], str]:
    """Return three finite numbers and no reason, or zeros and the reason."""
    if isinstance(values, tuple) and [*map(type, values)] == [float, float, float]:
        # As nodes have them: no array is needed, which would take longer than all the rest.
        if all(map(math.isfinite, values)):
            return list(values), ""
        return [0.0] * 3, "thrust command: not finite"
    try:
        acceleration = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return [0.0] * 3, "thrust command: not numeric"
    if acceleration.shape != (3,):
        return [0.0] * 3, f"thrust command: shape (3,) expected, got {acceleration.shape}"
    if not is_finite(acceleration):
        return [0.0] * 3, "thrust command: not finite"
    return acceleration.tolist(), ""

"""From a wanted moment to pulses of torquers: steps of 10 ms, quiet window, duty, allocation.

A rod is on or off, so that a mean moment is a share of the period. The magnetometer is sampled
while all rods are off; that leaves 80 % of a period of 5 s for pulses on SNAP-1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["TorquerLimits", "shift_along_field"]


@dataclass(frozen=True)
class TorquerLimits:
    """What the torquers can give in a period; the defaults are SNAP-1's (table 1).

    Parameters
    ----------
    moment : float
        Moment of a rod that is on, A m2.
    period : float
        Period of the ADCS, s.
    quiet_window : float
        Time at the end of a period without pulses, s.
    pulse_step : float
        Length of a step of a pulse, s.

    Raises
    ------
    ValueError
        One line that names the parameter.
    """

    moment: float = 0.127
    period: float = 5.0
    quiet_window: float = 1.0
    pulse_step: float = 0.01

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("moment", "period", "pulse_step"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a positive number; got {getattr(self, name)!r}")
        if not 0.0 <= self.quiet_window < self.period:
            raise ValueError(
                f"quiet_window: expected 0 or more and less than the period of {self.period:g} s; "
                f"got {self.quiet_window!r}"
            )

    @property
    def most_steps(self) -> int:
        """Longest pulse in steps."""
        return math.floor((self.period - self.quiet_window) / self.pulse_step + 1e-9)

    @property
    def largest_mean_moment(self) -> float:
        """Mean moment of the longest pulse over a period, A m2."""
        return self.moment * self.most_steps * self.pulse_step / self.period

    def pulse_steps(
        self, mean_moment: FloatArray, longest: float | None = None
    ) -> tuple[int, int, int]:
        """Return the pulses nearest to a mean moment, in steps with the sign of the moment.

        Parameters
        ----------
        mean_moment : ndarray, shape (3,)
            Wanted mean over the period, A m2.
        longest : float, optional
            Longest pulse, s, where that is shorter than the window leaves. The moment is then
            limited so that the direction of the torque is that of the field at the start.
        """
        most = self.most_steps
        if longest is not None:
            most = min(most, max(1, math.floor(longest / self.pulse_step)))
        wanted = mean_moment / self.moment * self.period / self.pulse_step
        x, y, z = np.clip(np.rint(wanted), -most, most).astype(int).tolist()
        return x, y, z

    def mean_moment(self, pulse_steps: tuple[int, int, int]) -> FloatArray:
        """Return the mean moment of pulses over a period, A m2, shape (3,)."""
        mean: FloatArray = (
            self.moment * self.pulse_step / self.period * np.array(pulse_steps, dtype=float)
        )
        return mean


def shift_along_field(moment: FloatArray, field_body: FloatArray, largest: float) -> FloatArray:
    """Return a moment with the same torque whose largest component is as small as it can be made.

    A moment along the field gives no torque, so any can be added: here the least that brings every
    axis within `largest`, or if none does, the one that exceeds it least.

    Parameters
    ----------
    moment : ndarray, shape (3,)
        A m2.
    field_body : ndarray, shape (3,)
        T.
    largest : float
        Limit of each axis, A m2.
    """
    if np.abs(moment).max() <= largest:
        return moment
    direction = field_body / norm(field_body)
    # The largest excess is convex in the shift: its minimum is where two axes are equal, or where
    # one is zero; the shifts at which an axis reaches its limit are those of the least change.
    shifts = [0.0]
    for i in range(3):
        if abs(direction[i]) > 1e-6:
            shifts += [(sign * largest - moment[i]) / direction[i] for sign in (-1.0, 1.0)]
            for j in range(i):
                for sign in (-1.0, 1.0):
                    slope = direction[i] + sign * direction[j]
                    if abs(slope) > 1e-6:
                        shifts.append(-(moment[i] + sign * moment[j]) / slope)

    def cost(shift: float) -> tuple[float, float]:
        excess = float(np.abs(moment + shift * direction).max()) - largest
        return (max(0.0, excess - 1e-12), abs(shift))

    shifted: FloatArray = moment + min(shifts, key=cost) * direction
    return shifted

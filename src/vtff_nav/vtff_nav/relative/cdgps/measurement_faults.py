"""Faults among the measurements of an epoch: outliers, slips, phases noisier than stated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_nav.relative.cdgps.phase_scatter import SLIP_CYCLES
from vtff_nav.relative.cdgps.state import Innovation
from vtff_nav.relative.common.measurements import SingleDifferences

__all__ = ["Judged", "without_faults"]


@dataclass(eq=False)
class Judged:
    """An innovation without faults, and the rows of phases that were found at fault."""

    innovation: Innovation
    odd: list[int]

    def satellites(self, measured: SingleDifferences) -> int:
        """Return how many satellites had a phase at fault."""
        return len(np.unique(measured.satellite[self.odd]))


def without_faults(
    innovation: Innovation,
    measured: SingleDifferences,
    is_scattered: npt.NDArray[np.bool_],
    limit: float,
) -> Judged:
    """Leave out one measurement after the other until none is a fault.

    A phase that does not fit but is nearer to its prediction than to a slip is used with more
    noise instead.

    Parameters
    ----------
    innovation : Innovation
        Of n codes, n phases and possibly more; changed.
    measured : SingleDifferences
    is_scattered : ndarray of bool, shape (n,)
        Phases known to be noisier than stated: what is nearer to a slip is one, however noisy they
        are, if the prediction can tell.
    limit : float
        Normalised residual against all others beyond which a measurement is a fault.
    """
    count = len(measured)
    phases = slice(count, 2 * count)
    slip = SLIP_CYCLES * measured.wavelength
    odd: list[int] = []
    while innovation.degrees_of_freedom > 0:
        residual, variance = innovation.leave_one_out
        normalised = np.abs(residual) / np.sqrt(variance)
        is_slip = is_scattered & (variance[phases] < 2.0 * innovation.noise[phases])
        is_slip &= np.abs(residual[phases]) > slip
        normalised[phases] += np.where(is_slip, limit, 0.0)
        worst = int(normalised.argmax())
        if normalised[worst] <= limit:
            break
        row = worst - count
        if 0 <= row < count:
            odd.append(row)
            if abs(residual[worst]) < slip[row]:
                innovation.add_noise(worst, float(residual[worst] ** 2))
                continue
        innovation.leave_out(worst)
    return Judged(innovation, odd)

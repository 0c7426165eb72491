"""Faults among the measurements of an epoch: outliers, slips, phases noisier than stated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_nav.relative.cdgps.phase_scatter import SLIP_CYCLES
from vtff_nav.relative.cdgps.state import Innovation
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.kernels.differences import find_worst_measurement

__all__ = ["FaultSearch", "reject_faults"]


@dataclass(eq=False)
class FaultSearch:
    """Result of a search for faults.

    Parameters
    ----------
    innovation : Innovation
        Innovation in which faulty measurements are left out or have more noise.
    faulty_phases : list of int
        Rows of the phases that were at fault.
    """

    innovation: Innovation
    faulty_phases: list[int]

    def count_satellites(
        self, measured: SingleDifferences, is_counted: npt.NDArray[np.bool_]
    ) -> int:
        """Return how many satellites had a faulty phase among those that count, shape (n,)."""
        rows = [row for row in self.faulty_phases if is_counted[row]]
        return len(set(measured.satellite[rows].tolist()))


def reject_faults(
    innovation: Innovation,
    measured: SingleDifferences,
    is_scattered: npt.NDArray[np.bool_],
    limit: float,
) -> FaultSearch:
    """Leave out the worst measurement until no measurement is a fault.

    A faulty phase that is nearer to its prediction than to a cycle slip is used with more noise
    instead.

    Parameters
    ----------
    innovation : Innovation
        Innovation of n codes, n phases and possibly more; it is changed.
    measured : SingleDifferences
    is_scattered : ndarray of bool, shape (n,)
        Phases known to be noisier than stated. A residual that is nearer to a slip counts as a slip
        there, however noisy the phase is, if the prediction is precise enough.
    limit : float
        Normalised residual against all others beyond which a measurement is a fault.
    """
    count = len(measured)
    slip = SLIP_CYCLES * measured.wavelength
    faulty_phases: list[int] = []
    while innovation.degrees_of_freedom > 0:
        residual, variance = innovation.leave_one_out
        worst = find_worst_measurement(
            residual, variance, innovation.noise, is_scattered, slip, limit
        )
        if worst < 0:
            break
        row = worst - count
        if 0 <= row < count:
            faulty_phases.append(row)
            if abs(residual[worst]) < slip[row]:
                innovation.add_noise(worst, float(residual[worst] ** 2))
                continue
        innovation.leave_out(worst)
    return FaultSearch(innovation, faulty_phases)

"""Means of a second of the links of two receivers, each with the stretch that it belongs to."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.fluctuations import LARGE_SCATTER
from vtff_iono.density.phase_differences import (
    DEVIATION,
    DEVIATION_SQUARED,
    ELEVATION_CHIEF,
    ELEVATION_DEPUTY,
    GEOMETRIC,
    STEC,
    STEP_SQUARED,
    WIDE_LANE,
)
from vtff_iono.density.phase_stretches import PhaseStretch

__all__ = ["LinkMeans", "StretchRows"]

IntArray = npt.NDArray[np.int64]


class StretchRows:
    """Stretches of n links, and what never changes of them as rows of arrays.

    Parameters
    ----------
    stretches : sequence of PhaseStretch, length n

    Attributes
    ----------
    number, prn : ndarray of int64, shape (n,)
        Numbers of the stretches and of their satellites.
    integers : ndarray, shape (n, 2)
        Integers of both signals, cycles; NaN for those that are not known.
    has_integers : ndarray of bool, shape (n,)
        Which links have integers of both signals.
    have_all, has_any : bool
        Whether all links have them, and whether any has.
    """

    def __init__(self, stretches: Sequence[PhaseStretch]) -> None:
        self.stretches = list(stretches)
        self.number: IntArray = np.array([each.number for each in self.stretches], dtype=np.int64)
        self.prn: IntArray = np.array([each.signals.prn for each in self.stretches], dtype=np.int64)
        self.integers: FloatArray = np.array(
            [
                [math.nan if cycles is None else cycles for cycles in each.integers]
                for each in self.stretches
            ],
            dtype=float,
        ).reshape(-1, 2)
        self.has_integers: npt.NDArray[np.bool_] = np.isfinite(self.integers.sum(axis=1))
        self.have_all = bool(self.has_integers.all())
        self.has_any = bool(self.has_integers.any())
        self._chosen: dict[bytes, StretchRows] = {}

    def select(self, chosen: npt.NDArray[np.bool_]) -> StretchRows:
        """Return the chosen links: the same object for the same choice, second after second."""
        key = chosen.tobytes()
        if key not in self._chosen:
            rows = np.flatnonzero(chosen).tolist()
            self._chosen[key] = StretchRows([self.stretches[row] for row in rows])
        return self._chosen[key]


@dataclass(frozen=True, eq=False)
class LinkMeans:
    """Means of one second of n links, each with its stretch.

    Parameters
    ----------
    links : StretchRows
    samples : ndarray of int, shape (n,)
        Number of samples of each mean.
    columns : ndarray, shape (8, n)
        Means of the columns of `phase_differences`. Deviations are from the first sample of a
        stretch: without integers contents are so large that their own squares have lost what they
        scatter by.
    least_noise : float
        Smallest variance of the white noise of a sample, TECU^2.
    """

    links: StretchRows
    samples: IntArray
    columns: FloatArray
    least_noise: float

    @property
    def stretches(self) -> Sequence[PhaseStretch]:
        """Stretches of the links."""
        return self.links.stretches

    @property
    def prns(self) -> IntArray:
        """Numbers of the satellites, shape (n,)."""
        return self.links.prn

    @property
    def has_integers(self) -> npt.NDArray[np.bool_]:
        """Which links have integers of both signals, shape (n,)."""
        return self.links.has_integers

    @property
    def stec(self) -> FloatArray:
        """Differential TEC, TECU, shape (n,)."""
        return np.asarray(self.columns[STEC])

    @property
    def wide_lane(self) -> FloatArray:
        """Wide lane of the single difference less its integers, cycles, shape (n,)."""
        return np.asarray(self.columns[WIDE_LANE])

    @property
    def geometric(self) -> FloatArray:
        """Wide lane of the phases less that of the ranges, less its integers, cycles, (n,)."""
        return np.asarray(self.columns[GEOMETRIC])

    @property
    def elevation_chief(self) -> FloatArray:
        """Elevations at the chief, rad, shape (n,)."""
        return np.asarray(self.columns[ELEVATION_CHIEF])

    @property
    def elevation_deputy(self) -> FloatArray:
        """Elevations at the deputy, rad, shape (n,)."""
        return np.asarray(self.columns[ELEVATION_DEPUTY])

    def select(self, chosen: npt.NDArray[np.bool_]) -> LinkMeans:
        """Return the chosen links."""
        if chosen.all():
            return self
        rows = np.flatnonzero(chosen)
        return LinkMeans(
            self.links.select(chosen),
            self.samples[rows],
            self.columns.take(rows, axis=1),
            self.least_noise,
        )

    @functools.cached_property
    def step_variance(self) -> FloatArray:
        """Variance that the changes from sample to sample show, TECU^2, shape (n,)."""
        return np.asarray(0.5 * self.columns[STEP_SQUARED])

    @functools.cached_property
    def scatter(self) -> FloatArray:
        """Variance of the contents within the second, TECU^2, shape (n,)."""
        return np.asarray(self.columns[DEVIATION_SQUARED] - self.columns[DEVIATION] ** 2)

    @functools.cached_property
    def white_noise(self) -> FloatArray:
        """Variance of the white noise of a sample, TECU^2, shape (n,)."""
        return np.maximum(self.step_variance, self.least_noise)

    @functools.cached_property
    def excess(self) -> FloatArray:
        """Variance that the samples have beside white noise, TECU^2, shape (n,)."""
        is_large = self.scatter > LARGE_SCATTER * self.white_noise
        return np.where(is_large, self.scatter - self.white_noise, 0.0)

    def with_integers(self, row: int, integers: tuple[float, float], content: float) -> LinkMeans:
        """Return the means with the integers of one link, whose content (TECU) is removed."""
        stretches = list(self.stretches)
        stretches[row] = replace(stretches[row], integers=integers)
        is_row = np.arange(len(stretches)) == row
        wide_lane = np.where(is_row, integers[0] - integers[1], 0.0)
        columns = self.columns.copy()
        columns[STEC] -= np.where(is_row, content, 0.0)
        columns[WIDE_LANE] -= wide_lane
        columns[GEOMETRIC] -= wide_lane
        return LinkMeans(StretchRows(stretches), self.samples, columns, self.least_noise)

"""Levels of arcs that the ionosphere of all satellites tells, better than the codes of each.

A solution for the receiver biases with a density profile (`vtff_iono.bias.profile_bias`) tells what
the phases of each arc lack to be contents. The content of an arc that has begun since then is what
the profile lets expect of its ray, and what the contents of the other arcs differ by from that. Its
sigma is the scatter of these differences, and what is particular to an arc.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.bias_samples import DECIMALS_TECU
from vtff_iono.bias.expected_contents import ExpectedContents
from vtff_iono.bias.profile_bias import ProfileBiases

__all__ = ["ArcContents", "ArcOffsets"]

# A new arc is compared with the others at its first epoch, and at multiples of this time, ns.
_INTERVAL = 20 * NANOSECONDS_PER_SECOND
# Fewest other arcs, so that their differences have a scatter.
_FEWEST = 3


class ArcContents(NamedTuple):
    """Contents of rows in order of time; arrays of shape (n,) and (n, 3).

    Attributes
    ----------
    time : ndarray of int
        GPS time, ns since 1980-01-06.
    link, arc : ndarray of int
    is_good : ndarray of bool
        Whether the content is usable.
    stec_phase_tecu, wind_up_tecu : ndarray
        Contents of the phases without level, and what the wind-up since the arc began looks like.
    stec_tecu, stec_sigma_tecu : ndarray
        Levelled by codes, all biases removed.
    position_itrf, direction_itrf : ndarray
        Antenna, m, and unit vectors to the satellites.
    """

    time: npt.NDArray[np.int64]
    link: npt.NDArray[np.int64]
    arc: npt.NDArray[np.int64]
    is_good: npt.NDArray[np.bool_]
    stec_phase_tecu: FloatArray
    wind_up_tecu: FloatArray
    stec_tecu: FloatArray
    stec_sigma_tecu: FloatArray
    position_itrf: FloatArray
    direction_itrf: FloatArray


class _Level(NamedTuple):
    """The level to add to the phases of an arc, and its sigma, TECU."""

    value: float
    sigma: float


class ArcOffsets:
    """Levels of the arcs of one receiver, by the latest solution with a density profile."""

    def __init__(self) -> None:
        self._solved: dict[tuple[int, int], _Level] = {}
        # The arcs that have begun since have the level of the ray with the smallest sigma.
        self._expected: dict[tuple[int, int], _Level] = {}
        self._contents: ExpectedContents | None = None
        self._wind_up = 0.0

    def renew(
        self, profile: ProfileBiases | None, levels: list[tuple[tuple[int, int], float]]
    ) -> None:
        """Take over a solution.

        Parameters
        ----------
        profile : ProfileBiases or None
            None if there is none: then levels are those of the codes.
        levels : list of ((int, int), float)
            Link and arc, and the level by codes in the samples (TECU), by the numbers of arcs.
        """
        self._solved, self._expected, self._contents = {}, {}, None
        if profile is None:
            return
        self._contents, self._wind_up = profile.contents, profile.wind_up
        columns = profile.arc, profile.offset_tecu, profile.offset_sigma_tecu
        for number, offset, sigma in zip(*(c.tolist() for c in columns), strict=True):
            arc, level = levels[number]
            self._solved[arc] = _Level(level - offset, sigma)

    def improve(self, rows: ArcContents) -> tuple[FloatArray, FloatArray]:
        """Return contents and their sigmas with the best level of each arc, TECU, (n,)."""
        stec, sigma = rows.stec_tecu.copy(), rows.stec_sigma_tecu.copy()
        if self._contents is None:
            return stec, sigma
        phase = rows.stec_phase_tecu - self._wind_up * rows.wind_up_tecu
        arcs = list(zip(rows.link.tolist(), rows.arc.tolist(), strict=True))
        for row, arc in enumerate(arcs):
            level = self._solved.get(arc)
            if level is not None:
                stec[row] = phase[row] + level.value
                sigma[row] = level.sigma
        good = np.flatnonzero(rows.is_good).tolist()
        new = [row for row in good if arcs[row] not in self._solved]
        compared = self._compare_with_others(rows, arcs, new, phase, stec, sigma)
        for row in new:
            best = self._expected.get(arcs[row])
            candidate = compared.get(row)
            if candidate is not None and (best is None or candidate.sigma < best.sigma):
                best = self._expected[arcs[row]] = candidate
            if best is not None:
                # Codes of a short arc err by more than they show, and more than this.
                stec[row] = phase[row] + best.value
                sigma[row] = best.sigma
        return stec, sigma

    def _compare_with_others(
        self,
        rows: ArcContents,
        arcs: list[tuple[int, int]],
        new: list[int],
        phase: FloatArray,
        stec: FloatArray,
        sigma: FloatArray,
    ) -> dict[int, _Level]:
        """Return the levels of new rows by the contents `stec` of the solved arcs of their epoch.

        `new` are rows that have no solved arc; `phase` are contents of phases without level and
        wind-up, and `sigma` is that of `stec`.
        """
        begun = set(self._expected)
        epochs: dict[int, list[int]] = {}
        for row in new:
            time = int(rows.time[row])
            if arcs[row] not in begun or time % _INTERVAL == 0:
                begun.add(arcs[row])
                epochs.setdefault(time, []).append(row)
        others = {
            time: [
                row
                for row in range(*np.searchsorted(rows.time, [time, time + 1]).tolist())
                if rows.is_good[row] and arcs[row] in self._solved
            ]
            for time in epochs
        }
        needed = [
            row
            for time in epochs
            for row in others[time] + epochs[time]
            if len(others[time]) >= _FEWEST
        ]
        if not needed or self._contents is None:
            return {}
        expected, mapping = np.full((2, len(arcs)), np.nan)
        expected[needed], mapping[needed] = self._contents.contents(
            np.asarray(1e-9 * rows.time[needed], dtype=float),
            rows.position_itrf[needed],
            rows.direction_itrf[needed],
        )
        levels = {}
        for time, of_epoch in epochs.items():
            solved = others[time]
            if len(solved) < _FEWEST:
                continue
            vertical = (stec[solved] - expected[solved]) / mapping[solved]
            mean, spread = float(vertical.mean()), float(vertical.var(ddof=1))
            # A gradient departs with the distance of the pierce point, the tangent of the zenith
            # angle there; a rising satellite is lower than the others.
            mean_tangent = float(np.mean(mapping[solved] ** 2)) - 1.0
            common = float(np.mean(sigma[solved] ** 2))
            for row in of_epoch:
                content, factor = float(expected[row] + mapping[row] * mean), float(mapping[row])
                particular = self._contents.arc_sigma * content
                growth = max(1.0, (factor**2 - 1.0) / mean_tangent) + 1.0 / len(solved)
                of_value = math.sqrt(spread * growth * factor**2 + common + particular**2)
                value = content - float(phase[row])
                levels[row] = _Level(round(value, DECIMALS_TECU), round(of_value, DECIMALS_TECU))
        return levels

"""Phase contents and positions of one spacecraft over the last minutes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.edge_crossing import ContentSeries
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftResult

__all__ = ["ContentHistory"]


class _SecondRows(NamedTuple):
    """Rows of one second; arrays of shape (n,), names as in `SlantTecRows` and `PairRows`.

    `begin` and `end` are the times of the first and the last row, ns; `position_of_observation`
    has the shape (observations, 3), m. Most seconds are forgotten before their rows are looked at.
    """

    begin: int
    end: int
    time: npt.NDArray[np.int64]
    link: npt.NDArray[np.int64]
    arc: npt.NDArray[np.int64]
    stec_phase_tecu: FloatArray
    elevation: FloatArray
    row_first: npt.NDArray[np.int64]
    position_of_observation: FloatArray

    def positions_itrf(self, rows: npt.NDArray[np.intp] | int) -> FloatArray:
        """Return the positions of the antenna at some rows (m,), shape (m, 3), m."""
        return np.asarray(self.position_of_observation[self.row_first[rows]])


class ContentHistory:
    """Contents that one spacecraft has observed, and its positions.

    Parameters
    ----------
    length : float
        Time for which they are kept, s.

    Attributes
    ----------
    links : sequence of Link
        All links of the spacecraft, by their numbers in the rows.
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._seconds: deque[_SecondRows] = deque()
        self.links: Sequence[Link] = ()
        # Ends of the seconds up to the last one for which they were asked: time of each, and of
        # those with known positions time, position and altitude.
        self._last_end = -1
        self._ends: tuple[npt.NDArray[np.int64], FloatArray, FloatArray]
        self._ends = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))

    def add(
        self, position_itrf: FloatArray, result: SpacecraftResult, links: Sequence[Link]
    ) -> None:
        """Add a second.

        Parameters
        ----------
        position_itrf : ndarray, shape (n, 3)
            Position of the antenna at each observation of the second, m.
        result : SpacecraftResult
            Results of the spacecraft for these observations.
        links : sequence of Link
            All links, by their numbers in the rows of `result`; the sequence may grow later.
        """
        rows = result.rows
        if not len(rows):
            return
        self.links = links
        times = rows.pairs.time
        begin, end = int(times[0]), int(times[-1])
        self._seconds.append(
            _SecondRows(
                begin,
                end,
                times,
                rows.pairs.link,
                rows.arc,
                rows.stec_phase_tecu,
                rows.elevation,
                rows.pairs.row_first,
                position_itrf,
            )
        )
        oldest = end - self._length * NANOSECONDS_PER_SECOND
        while self._seconds and self._seconds[0].end < oldest:
            self._seconds.popleft()

    @property
    def last_time(self) -> float:
        """Time of the last sample, s; minus infinity without any."""
        if not self._seconds:
            return -math.inf
        return self._seconds[-1].end / NANOSECONDS_PER_SECOND

    def trajectory(self) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Return the ends of seconds with known positions, ns, and these positions (n, 3), m."""
        times, positions, _ = self._known_ends()
        return times, positions

    def _known_ends(self) -> tuple[npt.NDArray[np.int64], FloatArray, FloatArray]:
        """Return time, position and altitude (n,), m, of the ends of seconds, see `trajectory`."""
        new = []
        for rows in reversed(self._seconds):
            if rows.end <= self._last_end:
                break
            new.append((rows.end, rows.positions_itrf(-1)))
        times, positions, altitudes = self._ends
        if new:
            new.reverse()
            self._last_end = new[-1][0]
            new_times = np.array([time for time, _ in new], dtype=np.int64)
            new_positions = np.array([position for _, position in new])
            is_known = np.isfinite(new_positions).all(axis=1)
            if is_known.any():
                new_positions = new_positions[is_known]
                times = np.concatenate((times, new_times[is_known]))
                positions = np.concatenate((positions, new_positions))
                new_altitudes = geodetic_from_itrf(new_positions)[:, 2]
                altitudes = np.concatenate((altitudes, new_altitudes))
        oldest = self._seconds[0].end if self._seconds else 0
        kept = slice(int(np.searchsorted(times, oldest)), None)
        self._ends = times[kept], positions[kept], altitudes[kept]
        return self._ends

    def vertical_speed(self) -> float:
        """Return the mean vertical speed, m/s; NaN with fewer than two positions."""
        times, _, altitudes = self._known_ends()
        if len(times) < 2:
            return math.nan
        duration = (times[-1] - times[0]) / NANOSECONDS_PER_SECOND
        return float(altitudes[-1] - altitudes[0]) / float(duration)

    def time_at_altitude(self, altitude: float) -> int | None:
        """Return when the spacecraft was at an altitude (m), ns.

        If it was not there within the history, this is the end of the history that is nearer to
        the altitude; None with fewer than two positions.
        """
        times, _, altitudes = self._known_ends()
        if len(times) < 2:
            return None
        order = slice(None) if altitudes[-1] > altitudes[0] else slice(None, None, -1)
        seconds = (times - times[-1]) / NANOSECONDS_PER_SECOND
        since_end = float(np.interp(altitude, altitudes[order], seconds[order]))
        return int(times[-1]) + round(since_end * NANOSECONDS_PER_SECOND)

    def position_at(self, time: int) -> FloatArray:
        """Return the position at a time (ns) within the history, shape (3,), m."""
        times, positions = self.trajectory()
        seconds = (times - time) / NANOSECONDS_PER_SECOND
        return np.array([np.interp(0.0, seconds, column) for column in positions.T])

    def epochs(self, begin: int, end: int) -> npt.NDArray[np.int64]:
        """Return the times of samples from `begin` to `end`, ns, increasing."""
        times = [np.unique(rows.time) for rows in self._seconds_between(begin, end)]
        epochs = np.concatenate([np.zeros(0, dtype=np.int64), *times])
        return epochs[(epochs >= begin) & (epochs <= end)]

    def series(self, epochs: npt.NDArray[np.int64], links: Sequence[Link]) -> ContentSeries:
        """Return the contents of links (m) at even epochs (n, ns); NaN where there is none."""
        shape = (len(links), len(epochs))
        altitude = np.full(len(epochs), np.nan)
        stec, elevation = np.full(shape, np.nan), np.full(shape, np.nan)
        arc = np.zeros(shape, dtype=np.int64)
        row_of_link = {link: row for row, link in enumerate(links)}
        # Row of the result by number of the link; -1 for other links and for rows without a link.
        table = np.array([*(row_of_link.get(link, -1) for link in self.links), -1], dtype=np.int64)
        for rows in self._seconds_between(int(epochs[0]), int(epochs[-1])):
            column = np.searchsorted(epochs, rows.time)
            column[column == len(epochs)] = 0
            is_epoch = epochs[column] == rows.time
            _, first = np.unique(column[is_epoch], return_index=True)
            first_rows = np.flatnonzero(is_epoch)[first]
            positions = rows.positions_itrf(first_rows)
            altitude[column[first_rows]] = geodetic_from_itrf(positions)[:, 2]
            row = table[rows.link]
            chosen = is_epoch & (row >= 0) & (rows.arc > 0)
            stec[row[chosen], column[chosen]] = rows.stec_phase_tecu[chosen]
            elevation[row[chosen], column[chosen]] = rows.elevation[chosen]
            arc[row[chosen], column[chosen]] = rows.arc[chosen]
        return ContentSeries(altitude, stec, arc, elevation)

    def _seconds_between(self, begin: int, end: int) -> list[_SecondRows]:
        return [rows for rows in self._seconds if rows.end >= begin and rows.begin <= end]

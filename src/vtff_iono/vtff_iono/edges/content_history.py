"""Phase contents and positions of one spacecraft over the last minutes."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.edge_crossing import ContentSeries
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftResult

__all__ = ["ContentHistory"]


@dataclass(frozen=True, eq=False)
class _Second:
    """Rows of one second."""

    time: npt.NDArray[np.int64]
    link: npt.NDArray[np.int64]
    arc: npt.NDArray[np.int64]
    stec: FloatArray
    elevation: FloatArray
    position: FloatArray


class ContentHistory:
    """What one spacecraft has seen and where it was.

    Parameters
    ----------
    length : float
        How much is kept, s.
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._seconds: deque[_Second] = deque()
        self.links: Sequence[Link] = ()

    def add(
        self, position_itrf: FloatArray, result: SpacecraftResult, links: Sequence[Link]
    ) -> None:
        """Take a second in.

        Parameters
        ----------
        position_itrf : ndarray, shape (n, 3)
            Of the antenna at each observation of the second, m.
        result : SpacecraftResult
            What has been made of them.
        links : sequence of Link
            Those whose numbers its rows tell; it may grow later.
        """
        rows = result.rows
        if not len(rows):
            return
        self.links = links
        self._seconds.append(
            _Second(
                rows.pairs.time,
                rows.pairs.link,
                rows.arc,
                rows.stec_phase_tecu,
                rows.elevation,
                position_itrf[rows.pairs.row_first],
            )
        )
        oldest = int(rows.pairs.time[-1]) - self._length * NANOSECONDS_PER_SECOND
        while self._seconds and self._seconds[0].time[-1] < oldest:
            self._seconds.popleft()

    def way(self) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Return the times, ns, and positions (n, 3), m, at the ends of seconds, where known."""
        ends = [(int(one.time[-1]), one.position[-1]) for one in self._seconds]
        ends = [end for end in ends if np.isfinite(end[1]).all()]
        return (
            np.array([time for time, _ in ends], dtype=np.int64),
            np.array([place for _, place in ends]).reshape(-1, 3),
        )

    def crossing(self, altitude: float) -> int | None:
        """Return when the spacecraft last was at an altitude (m), ns.

        If it was not, this is the end of the history that is nearer to the altitude; None
        without positions.
        """
        times, places = self.way()
        if len(times) < 2:
            return None
        heights = geodetic_from_itrf(places)[:, 2]
        order = slice(None) if heights[-1] > heights[0] else slice(None, None, -1)
        seconds = (times - times[-1]) / NANOSECONDS_PER_SECOND
        ago = float(np.interp(altitude, heights[order], seconds[order]))
        return int(times[-1]) + round(ago * NANOSECONDS_PER_SECOND)

    def position_at(self, time: int) -> FloatArray:
        """Return the position at a time (ns) of the history, shape (3,), m."""
        times, places = self.way()
        seconds = (times - time) / NANOSECONDS_PER_SECOND
        return np.array([np.interp(0.0, seconds, column) for column in places.T])

    def epochs(self, begin: int, end: int) -> npt.NDArray[np.int64]:
        """Return the times of samples from `begin` to `end`, ns, increasing."""
        times = [np.unique(one.time) for one in self._between(begin, end)]
        epochs = np.concatenate([np.zeros(0, dtype=np.int64), *times])
        return epochs[(epochs >= begin) & (epochs <= end)]

    def series(self, epochs: npt.NDArray[np.int64], links: Sequence[Link]) -> ContentSeries:
        """Return the contents of links (m) at even epochs (n, ns); NaN where there is none."""
        shape = (len(links), len(epochs))
        altitude = np.full(len(epochs), np.nan)
        stec, elevation = np.full(shape, np.nan), np.full(shape, np.nan)
        arc = np.zeros(shape, dtype=np.int64)
        row_of = {link: row for row, link in enumerate(links)}
        rows = np.array([row_of.get(link, -1) for link in self.links] + [-1], dtype=np.int64)
        for one in self._between(int(epochs[0]), int(epochs[-1])):
            column = np.searchsorted(epochs, one.time)
            column[column == len(epochs)] = 0
            known = epochs[column] == one.time
            _, first = np.unique(column[known], return_index=True)
            places = np.flatnonzero(known)[first]
            altitude[column[places]] = geodetic_from_itrf(one.position[places])[:, 2]
            row = rows[one.link]
            chosen = known & (row >= 0) & (one.arc > 0)
            stec[row[chosen], column[chosen]] = one.stec[chosen]
            elevation[row[chosen], column[chosen]] = one.elevation[chosen]
            arc[row[chosen], column[chosen]] = one.arc[chosen]
        return ContentSeries(altitude, stec, arc, elevation)

    def _between(self, begin: int, end: int) -> list[_Second]:
        return [one for one in self._seconds if one.time[-1] >= begin and one.time[0] <= end]

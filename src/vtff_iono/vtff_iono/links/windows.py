"""Windows of time that begin at multiples of their length, filled epoch by epoch or all at once."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["WindowBuffer"]

Columns = dict[str, npt.NDArray]  # type: ignore[type-arg]


class WindowBuffer:
    """Collects rows until the window that they belong to is over.

    Parameters
    ----------
    length : float
        Length of the windows, s; windows begin at multiples of it in GPS time.

    Raises
    ------
    ValueError
        If the length is not positive.
    """

    def __init__(self, length: float) -> None:
        self._length = round(length * NANOSECONDS_PER_SECOND)
        if self._length <= 0:
            raise ValueError(f"length of a window: must be positive, got {length} s")
        self._current: int | None = None
        self._blocks: list[Columns] = []

    def update(
        self,
        time: npt.NDArray[np.int64],
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
    ) -> Iterator[tuple[int, Columns]]:
        """Add rows and yield the windows that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time, ns since 1980-01-06, not decreasing.
        columns : mapping of str to ndarray, shape (n, ...)
            Columns of the rows.

        Yields
        ------
        end : int
            End of the window, ns.
        columns : dict of str to ndarray
            Rows of the window, and their times as ``"time"``.
        """
        if len(time) == 0:
            return
        # Divided are the first and the last time only: to divide all takes longer than all else.
        first, last = int(time[0]) // self._length, int(time[-1]) // self._length
        edges = [0, len(time)]
        if first + 1 == last:
            edges[1:1] = [int(time.searchsorted(self._length * last))]
        elif first != last:
            begins = self._length * np.arange(first + 1, last + 1)
            edges[1:1] = np.unique(np.searchsorted(time, begins)).tolist()
        for start, end in itertools.pairwise(edges):
            window = int(time[start]) // self._length
            if self._current is not None and window != self._current:
                yield self._take_window()
            self._current = window
            block = {name: column[start:end] for name, column in columns.items()}
            self._blocks.append({"time": time[start:end], **block})

    def flush(self) -> Iterator[tuple[int, Columns]]:
        """Yield the window that is not over yet, if it has rows."""
        if self._current is not None:
            yield self._take_window()
            self._current = None

    def _take_window(self) -> tuple[int, Columns]:
        """Return end and rows of the current window, and forget its rows."""
        assert self._current is not None
        rows = {
            name: np.concatenate([block[name] for block in self._blocks])
            for name in self._blocks[0]
        }
        self._blocks = []
        return (self._current + 1) * self._length, rows

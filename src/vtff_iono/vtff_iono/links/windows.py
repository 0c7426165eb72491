"""Windows of time that begin at multiples of their length, filled epoch by epoch or at once."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["WindowBuffer"]

Columns = dict[str, npt.NDArray]  # type: ignore[type-arg]


class WindowBuffer:
    """Collects rows until their window is over.

    Parameters
    ----------
    length : float
        Length of the windows, s; they begin at multiples of it in GPS time.

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
        self._parts: list[Columns] = []

    def update(
        self,
        time: npt.NDArray[np.int64],
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
    ) -> Iterator[tuple[int, Columns]]:
        """Take rows in and yield the windows that they end.

        Parameters
        ----------
        time : ndarray of int64, shape (n,)
            GPS time, ns since 1980-01-06, not decreasing.
        columns : mapping of str to ndarray, shape (n, ...)

        Yields
        ------
        end : int
            End of the window, ns.
        columns : dict of str to ndarray
            Its rows, and their times as ``"time"``.
        """
        if len(time) == 0:
            return
        number = time // self._length
        edges = [0, len(time)]
        if number[0] != number[-1]:
            edges[1:1] = (np.flatnonzero(np.diff(number)) + 1).tolist()
        for start, end in itertools.pairwise(edges):
            window = int(number[start])
            if self._current is not None and window != self._current:
                yield self._closed()
            self._current = window
            part = {name: column[start:end] for name, column in columns.items()}
            self._parts.append({"time": time[start:end], **part})

    def flush(self) -> Iterator[tuple[int, Columns]]:
        """Yield the window that is not over yet, if it has rows."""
        if self._current is not None:
            yield self._closed()
            self._current = None

    def _closed(self) -> tuple[int, Columns]:
        assert self._current is not None
        joined = {
            name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]
        }
        self._parts = []
        return (self._current + 1) * self._length, joined

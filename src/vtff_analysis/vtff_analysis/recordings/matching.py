"""Rows of two recordings that belong to the same second and the same satellite or signal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["match_rows"]

_NUMBER_BITS = 32


def match_rows(
    first_time: npt.NDArray[np.int64],
    first_number: npt.NDArray[np.int64],
    second_time: npt.NDArray[np.int64],
    second_number: npt.NDArray[np.int64],
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows of two tables that have the same second and the same number.

    Parameters
    ----------
    first_time, second_time : ndarray, shape (m,) and (n,)
        ns since 1970; rounded to whole seconds.
    first_number, second_number : ndarray, shape (m,) and (n,)
        `vtff_gnss.signals.satellite_number` or `vtff_gnss.signals.signal_number`.

    Returns
    -------
    rows_first, rows_second : ndarray, shape (k,)
        Indices of equal rows, ordered by second, then number. Of rows that repeat themselves in
        one table the first one counts.
    """
    keys = [
        np.round(time / NANOSECONDS_PER_SECOND).astype(np.int64) << _NUMBER_BITS | number
        for time, number in ((first_time, first_number), (second_time, second_number))
    ]
    _, rows_first, rows_second = np.intersect1d(keys[0], keys[1], return_indices=True)
    return rows_first, rows_second

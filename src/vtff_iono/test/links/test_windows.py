"""Windows: where they begin and end, and that pieces make no difference."""

import numpy as np
import pytest

from vtff_iono.links.windows import WindowBuffer

SECOND = 1_000_000_000


def filled(length, seconds, calls):
    """Return ends and rows of all windows; the rows come in a number of calls."""
    buffer = WindowBuffer(length)
    time = np.asarray(seconds, dtype=np.int64) * SECOND
    number = np.arange(len(time))
    windows = []
    for rows in np.array_split(number, calls):
        windows += buffer.update(time[rows], {"number": rows, "pair": np.stack((rows, rows), 1)})
    return [*windows, *buffer.flush()], buffer


@pytest.mark.parametrize("calls", [1, 3, 9])
def test_windows_begin_at_multiples_of_their_length(calls):
    windows, buffer = filled(10.0, [5, 9, 10, 10, 19, 20, 45, 49, 50], calls)
    assert [end // SECOND for end, _ in windows] == [10, 20, 30, 50, 60]
    assert [rows["number"].tolist() for _, rows in windows] == [[0, 1], [2, 3, 4], [5], [6, 7], [8]]
    assert [(rows["time"] // SECOND).tolist() for _, rows in windows] == [
        [5, 9],
        [10, 10, 19],
        [20],
        [45, 49],
        [50],
    ]
    assert windows[1][1]["pair"].tolist() == [[2, 2], [3, 3], [4, 4]]
    assert list(buffer.flush()) == []


def test_no_rows_make_no_window():
    buffer = WindowBuffer(1.0)
    assert list(buffer.update(np.zeros(0, np.int64), {"number": np.zeros(0)})) == []
    assert list(buffer.flush()) == []


@pytest.mark.parametrize("length", [0.0, -1.0, 1e-10])
def test_a_length_must_be_positive(length):
    with pytest.raises(ValueError, match="length of a window: must be positive"):
        WindowBuffer(length)

"""Numbers of few integers that occur in many rows, and the rows of each of them.

Rows of observations have a dozen satellites and signals, epoch by epoch. To sort rows by these, as
`numpy.unique` does, takes ten times as long as to look each of them up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled

__all__ = ["NumberedKeys", "compile_kernels", "number_keys", "rows_by_number"]

IntArray = npt.NDArray[np.int64]

# Places of the table of keys at first, a power of two.
_FIRST_PLACES = 256
# Keys are folded to so many bits, and multiplied with a number that spreads them over all bits
# (Knuth 1998, vol. 3, section 6.4); the product is no larger than integers are.
_FOLDED_BITS, _SPREAD = 31, 1_103_515_245


class NumberedKeys(NamedTuple):
    """Keys of n rows, by numbers in the order in which they appear.

    Attributes
    ----------
    keys : ndarray of int64, shape (k,)
        The k different keys.
    first : ndarray of int64, shape (k,)
        Row in which each appears first.
    number : ndarray of int64, shape (n,)
        Which of them is that of each row.
    """

    keys: IntArray
    first: IntArray
    number: IntArray


def number_keys(keys: IntArray) -> NumberedKeys:
    """Return the keys (n,) by numbers in the order in which they appear."""
    first, number = _number_keys(keys)
    return NumberedKeys(keys[first], first, number)


def rows_by_number(number: IntArray, count: int) -> list[IntArray]:
    """Return the rows of each of the numbers 0 to `count` - 1, in their order.

    `number`, shape (n,), is that of each row.
    """
    order, ends = _sort_rows(number, count)
    return np.split(order, ends[:-1]) if count else []


@compiled
def _number_keys(keys):  # type: ignore[no-untyped-def]
    """Return the first rows of different keys, and the numbers of keys, of `NumberedKeys`."""
    first, number = np.empty(len(keys), dtype=np.int64), np.empty(len(keys), dtype=np.int64)
    # At a place that follows from the key: the number of the key and one, zero where there is none.
    table = np.zeros(_FIRST_PLACES, dtype=np.int64)
    count = 0
    for row in range(len(keys)):
        if 2 * count >= len(table):
            table = np.zeros(2 * len(table), dtype=np.int64)
            for other in range(count):
                table[_place(keys, first, table, keys[first[other]])] = other + 1
        place = _place(keys, first, table, keys[row])
        if table[place] == 0:
            first[count] = row
            count += 1
            table[place] = count
        number[row] = table[place] - 1
    return first[:count].copy(), number


@compiled
def _place(keys, first, table, key):  # type: ignore[no-untyped-def]
    """Return the place of a key in a table, or the free one where it belongs."""
    last = len(table) - 1
    folded = (key ^ (key >> _FOLDED_BITS)) & ((1 << _FOLDED_BITS) - 1)
    place = ((folded * _SPREAD) >> 16) & last
    while table[place] != 0 and keys[first[table[place] - 1]] != key:
        place = (place + 1) & last
    return place


@compiled
def _sort_rows(number, count):  # type: ignore[no-untyped-def]
    """Return the rows (n,) by their numbers, and where those of each number end, shape (count,)."""
    place = np.zeros(count, dtype=np.int64)
    for row in range(len(number)):
        place[number[row]] += 1
    total = 0
    for other in range(count):
        total += place[other]
        place[other] = total - place[other]
    order = np.empty(len(number), dtype=np.int64)
    for row in range(len(number)):
        order[place[number[row]]] = row
        place[number[row]] += 1
    return order, place


def compile_kernels() -> None:
    """Compile the look-up and the order."""
    rows_by_number(number_keys(np.zeros(1, dtype=np.int64)).number, 1)

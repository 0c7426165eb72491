"""Numbers in the fixed fields of RINEX observations (format F14.3), many at a time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["FIELD_WIDTH", "digits_or_blank", "parse_fixed_point"]

FIELD_WIDTH = 14
_POINT = 10
_BLOCK = 1 << 15

# Kinds of characters, so ordered that blanks, sign and digits of a number do not descend.
_BLANK, _MINUS, _DIGIT, _OTHER = 0, 1, 2, 3
_KIND = np.full(256, _OTHER, dtype=np.uint8)
_KIND[ord(" ")] = _BLANK
_KIND[ord("-")] = _MINUS
_KIND[ord("0") : ord("9") + 1] = _DIGIT
_DIGIT_VALUE = np.zeros(256, dtype=np.uint8)
_DIGIT_VALUE[ord("0") : ord("9") + 1] = np.arange(10)
_BAD_DIGIT = 255
_DIGIT_OR_BLANK = np.full(256, _BAD_DIGIT, dtype=np.uint8)
_DIGIT_OR_BLANK[ord("0") : ord("9") + 1] = np.arange(10)
_DIGIT_OR_BLANK[ord(" ")] = 0
# Thousandths: an integer below 2^53, so that one division gives the nearest float.
_WEIGHT = np.array([10.0 ** (12 - i) for i in range(_POINT)] + [0.0, 100.0, 10.0, 1.0])


def parse_fixed_point(
    fields: npt.NDArray[np.uint8],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Return the numbers in fields of format F14.3.

    Parameters
    ----------
    fields : ndarray of uint8, shape (n, 14)
        Characters.

    Returns
    -------
    values : ndarray of float64, shape (n,)
        The nearest floats; NaN where the field is blank or irregular.
    is_irregular : ndarray of bool, shape (n,)
        Neither blank nor in this format.
    """
    count = len(fields)
    values = np.empty(count)
    is_irregular = np.empty(count, dtype=np.bool_)
    # Blocks that stay in the cache.
    for start in range(0, count, _BLOCK):
        rows = slice(start, start + _BLOCK)
        values[rows], is_irregular[rows] = _parse_block(fields[rows])
    return values, is_irregular


def _parse_block(
    fields: npt.NDArray[np.uint8],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    kind = _KIND[fields]
    # By columns: reductions over a short last axis are slow.
    column = np.ascontiguousarray(kind.T)
    is_blank = ~column.any(axis=0)
    is_regular = fields[:, _POINT] == ord(".")
    for i in (*range(_POINT), *range(_POINT + 1, FIELD_WIDTH)):
        is_regular &= column[i] == _DIGIT if i > _POINT else column[i] <= _DIGIT
    for i in range(1, _POINT):
        is_regular &= column[i] >= column[i - 1]
        is_regular &= (column[i] != _MINUS) | (column[i - 1] != _MINUS)
    values = (_DIGIT_VALUE[fields].astype(np.float64) @ _WEIGHT) / 1000.0
    is_negative = (column[:_POINT] == _MINUS).any(axis=0)
    np.negative(values, out=values, where=is_negative)
    values[~is_regular] = np.nan
    return values, ~(is_regular | is_blank)


def digits_or_blank(characters: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the digit in each character; 0 for a blank, 255 for anything else."""
    return np.asarray(_DIGIT_OR_BLANK[characters])

"""Arithmetic for compiled functions that rounds as Python and numpy do.

A loop that takes the place of operations on arrays gives the same bytes only if it also rounds
where these round.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = ["exact_total", "power", "total"]


@compiled
def power(value, exponent):  # type: ignore[no-untyped-def]
    """Return what ``value ** exponent`` is of floats in Python: the power of the C library.

    Arrays of numpy, and powers with an exponent that the compiler knows, are products instead. One
    square in a thousand has another last bit then. Where Python raises an error the result is
    infinite, and where it is complex, NaN.
    """
    if not math.isfinite(value):
        return value**exponent
    # The compiler does not know this exponent, because the value might be infinite.
    return math.pow(value, exponent + 0.0 * value)


@compiled
def total(values):  # type: ignore[no-untyped-def]
    """Return the sum of at most 128 numbers, shape (n,), in the order of `numpy.sum`.

    From eight numbers on there are eight sums, of every eighth number each.
    """
    blocks = len(values) // 8
    result = 0.0
    if blocks:
        part = np.zeros(8)
        for block in range(blocks):
            for place in range(8):
                part[place] += values[8 * block + place]
        first = (part[0] + part[1]) + (part[2] + part[3])
        result = first + ((part[4] + part[5]) + (part[6] + part[7]))
    for place in range(8 * blocks, len(values)):
        result += values[place]
    return result


@compiled
def exact_total(values):  # type: ignore[no-untyped-def]
    """Return the sum of finite numbers, shape (n,), rounded once, as `math.fsum` does.

    References
    ----------
    Shewchuk (1997), Adaptive precision floating-point arithmetic, figure 5.
    """
    part = np.zeros(len(values) + 1)
    count = 0
    for value in values:
        rest, kept = value, 0
        for place in range(count):
            larger, smaller = rest, part[place]
            if abs(larger) < abs(smaller):
                larger, smaller = smaller, larger
            rest = larger + smaller
            error = smaller - (rest - larger)
            if error != 0.0:
                part[kept] = error
                kept += 1
        part[kept] = rest
        count = kept + 1
    # The parts do not overlap: all but the largest ones only decide how their sum is rounded.
    result, error = 0.0, 0.0
    while count > 0 and error == 0.0:
        count -= 1
        whole = result + part[count]
        error = part[count] - (whole - result)
        result = whole
    if count > 0 and ((error < 0.0) == (part[count - 1] < 0.0)) and part[count - 1] != 0.0:
        # Half of a last bit is rounded to even, unless more lies behind it.
        double = 2.0 * error
        whole = result + double
        if double == whole - result:
            result = whole
    return result

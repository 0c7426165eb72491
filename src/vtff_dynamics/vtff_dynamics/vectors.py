"""Products and checks of single vectors, where numpy costs several times as much.

`numpy.cross` takes twenty times as long on so few numbers.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["FloatArray", "cross", "is_finite", "norm", "skew"]

FloatArray = npt.NDArray[np.float64]
"""An array of double precision numbers."""


def cross(left: npt.ArrayLike, right: npt.ArrayLike) -> FloatArray:
    """Return the cross product of two vectors of shape (3,)."""
    ax, ay, az = np.asarray(left, dtype=float).tolist()
    bx, by, bz = np.asarray(right, dtype=float).tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def is_finite(values: npt.ArrayLike) -> bool:
    """Return whether all numbers of a short vector or small matrix are finite."""
    array = np.asarray(values, dtype=float)
    numbers = (array if array.ndim == 1 else array.ravel()).tolist()
    # What is not finite stays so in a sum. A sum may also exceed the largest number.
    return math.isfinite(sum(numbers)) or all(map(math.isfinite, numbers))


def norm(vector: npt.ArrayLike) -> float:
    """Return the Euclidean length of a vector of shape (3,)."""
    x, y, z = np.asarray(vector, dtype=float).tolist()
    return math.sqrt(x * x + y * y + z * z)


def skew(vector: npt.ArrayLike) -> FloatArray:
    """Return the matrix S of shape (3, 3) with ``S @ b == cross(vector, b)``."""
    x, y, z = np.asarray(vector, dtype=float).tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

"""Unit quaternions of attitude: compiled products, rotations and rotation vectors.

A quaternion is x, y, z, w (scalar last, as in ROS messages) and turns body axes into reference
axes: ``vector_reference = rotation_matrix(q) @ vector_body``. ``multiply(p, q)`` turns by q first.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "check_quaternion",
    "conjugate",
    "from_rotation_matrix",
    "from_rotation_vector",
    "multiply",
    "rotation_matrix",
    "rotation_vector",
    "turned_at_rate",
]


@compiled
def multiply(left, right):  # type: ignore[no-untyped-def]
    """Return the Hamilton product of two quaternions, shape (4,)."""
    ax, ay, az, aw = left[0], left[1], left[2], left[3]
    bx, by, bz, bw = right[0], right[1], right[2], right[3]
    product = np.empty(4)
    product[0] = aw * bx + ax * bw + ay * bz - az * by
    product[1] = aw * by - ax * bz + ay * bw + az * bx
    product[2] = aw * bz + ax * by - ay * bx + az * bw
    product[3] = aw * bw - ax * bx - ay * by - az * bz
    return product


@compiled
def conjugate(quaternion):  # type: ignore[no-untyped-def]
    """Return the quaternion of the inverse rotation, shape (4,)."""
    inverse = -quaternion
    inverse[3] = quaternion[3]
    return inverse


@compiled
def rotation_matrix(quaternion):  # type: ignore[no-untyped-def]
    """Return the matrix R of shape (3, 3) with ``vector_reference = R @ vector_body``."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    matrix = np.empty((3, 3))
    matrix[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[0, 1] = 2.0 * (x * y - z * w)
    matrix[0, 2] = 2.0 * (x * z + y * w)
    matrix[1, 0] = 2.0 * (x * y + z * w)
    matrix[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[1, 2] = 2.0 * (y * z - x * w)
    matrix[2, 0] = 2.0 * (x * z - y * w)
    matrix[2, 1] = 2.0 * (y * z + x * w)
    matrix[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return matrix


@compiled
def from_rotation_vector(vector):  # type: ignore[no-untyped-def]
    """Return the quaternion of a rotation vector (axis times angle, rad), shape (4,)."""
    angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    # The series keeps full precision where sin(angle) / angle would lose it.
    factor = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    quaternion = np.empty(4)
    quaternion[0] = factor * vector[0]
    quaternion[1] = factor * vector[1]
    quaternion[2] = factor * vector[2]
    quaternion[3] = math.cos(0.5 * angle)
    return quaternion


@compiled
def rotation_vector(quaternion):  # type: ignore[no-untyped-def]
    """Return the rotation vector of a quaternion, rad, shape (3,), not longer than pi."""
    sign = 1.0 if quaternion[3] >= 0.0 else -1.0
    sine = math.sqrt(quaternion[0] ** 2 + quaternion[1] ** 2 + quaternion[2] ** 2)
    angle = 2.0 * math.atan2(sine, sign * quaternion[3])
    factor = 2.0 * sign if sine < 1e-12 else sign * angle / sine
    vector = np.empty(3)
    for axis in range(3):
        vector[axis] = factor * quaternion[axis]
    return vector


@compiled
def turned_at_rate(quaternion, rate_body, duration):  # type: ignore[no-untyped-def]
    """Return the attitude (4,) after `duration` s at a constant rate (3,), rad/s, body axes."""
    return multiply(quaternion, from_rotation_vector(duration * rate_body))


@compiled
def from_rotation_matrix(matrix):  # type: ignore[no-untyped-def]
    """Return the quaternion of a rotation matrix of shape (3, 3); its scalar is not negative.

    References
    ----------
    Shepperd (1978), Quaternion from rotation matrix, J. Guidance and Control 1(3), 223-224.
    """
    trace = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
    largest = 3
    size = trace
    for axis in range(3):
        if matrix[axis, axis] > size:
            size = matrix[axis, axis]
            largest = axis
    quaternion = np.empty(4)
    if largest == 3:
        quaternion[3] = 1.0 + trace
        quaternion[0] = matrix[2, 1] - matrix[1, 2]
        quaternion[1] = matrix[0, 2] - matrix[2, 0]
        quaternion[2] = matrix[1, 0] - matrix[0, 1]
    else:
        i = largest
        j = (i + 1) % 3
        k = (i + 2) % 3
        quaternion[i] = 1.0 + matrix[i, i] - matrix[j, j] - matrix[k, k]
        quaternion[j] = matrix[j, i] + matrix[i, j]
        quaternion[k] = matrix[k, i] + matrix[i, k]
        quaternion[3] = matrix[k, j] - matrix[j, k]
    length = math.sqrt(np.sum(quaternion * quaternion))
    if quaternion[3] < 0.0:
        length = -length
    return quaternion / length


def check_quaternion(name: str, value: npt.ArrayLike) -> FloatArray:
    """Return a quaternion of unit length, shape (4,).

    Raises
    ------
    ValueError
        If it is not four finite numbers, or its length is not 1 within 1e-3.
    """
    quaternion = np.array(value, dtype=float)
    if quaternion.shape != (4,) or not np.isfinite(quaternion).all():
        raise ValueError(f"{name}: expected four finite numbers x, y, z, w; got {value!r}")
    length = math.sqrt(float(quaternion @ quaternion))
    if abs(length - 1.0) > 1e-3:
        raise ValueError(f"{name}: expected a length of 1; got {length:.6g}")
    unit: FloatArray = quaternion / length
    return unit

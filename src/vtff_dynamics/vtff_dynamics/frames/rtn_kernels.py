"""Axes and states of `vtff_dynamics.frames.rtn` for loops that are compiled themselves."""

from __future__ import annotations

import math

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["write_axes", "write_deputy_state"]


@compiled
def write_axes(state_gcrf: FloatArray, rotation: FloatArray) -> float:
    """Write the axes R, T, N of a state (6,) as rows (3, 3); return their rate about N, rad/s.

    The numbers are those of `vtff_dynamics.frames.rtn.rotation_gcrf_to_rtn`.
    """
    x, y, z = state_gcrf[0], state_gcrf[1], state_gcrf[2]
    vx, vy, vz = state_gcrf[3], state_gcrf[4], state_gcrf[5]
    nx, ny, nz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
    momentum = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not momentum > 0.0:
        raise ValueError("state_gcrf: position and velocity do not span an orbital plane")
    square = x * x + y * y + z * z
    radius = math.sqrt(square)
    x, y, z = x / radius, y / radius, z / radius
    nx, ny, nz = nx / momentum, ny / momentum, nz / momentum
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = x, y, z
    rotation[1, 0], rotation[1, 1] = ny * z - nz * y, nz * x - nx * z
    rotation[1, 2] = nx * y - ny * x
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = nx, ny, nz
    rate: float = momentum / square
    return rate


@compiled
def write_deputy_state(
    chief_gcrf: FloatArray,
    rotation: FloatArray,
    rate: float,
    relative_rtn: FloatArray,
    deputy_gcrf: FloatArray,
) -> None:
    """Write the state (6,) of a deputy in GCRF, m and m/s, from that relative to a chief.

    Axes and rate are those of `write_axes`, the numbers those of
    `vtff_dynamics.frames.rtn.deputy_state_gcrf`.
    """
    x, y, z = relative_rtn[0], relative_rtn[1], relative_rtn[2]
    vx = relative_rtn[3] + (0.0 * z - rate * y)
    vy = relative_rtn[4] + (rate * x - 0.0 * z)
    vz = relative_rtn[5] + (0.0 * y - 0.0 * x)
    for k in range(3):
        r, t, n = rotation[0, k], rotation[1, k], rotation[2, k]
        deputy_gcrf[k] = chief_gcrf[k] + (r * x + t * y + n * z)
        deputy_gcrf[k + 3] = chief_gcrf[k + 3] + (r * vx + t * vy + n * vz)

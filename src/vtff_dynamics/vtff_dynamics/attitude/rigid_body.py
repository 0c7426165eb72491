"""Rotation of a rigid spacecraft with one wheel under magnetic and other torques.

    I w' = M x B + 3 GM / r^3 (u x I u) + c x F + N - w x (I w + h a) - h' a

with M the sum of all magnetic moments, u the direction of the Earth's centre, F a force (drag) at
the point c, N any other torque, and h the momentum of the wheel along its axis a (Steyn and Hashida
(2001), equation 8). The kernel takes field and position at the start, the middle and the end of an
interval of some seconds and passes a parabola through them: over 5 s in low orbit that leaves 1e-6
of the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.quaternion import check_quaternion, rotation_matrix
from vtff_dynamics.checks import check_vector
from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "AttitudeState",
    "OrbitInterval",
    "check_inertia",
    "integrate_rotation",
    "rotation_rate",
    "rotation_step",
]


def check_inertia(name: str, value: npt.ArrayLike) -> FloatArray:
    """Return an inertia tensor (3, 3), kg m2, from a matrix or its diagonal.

    Raises
    ------
    ValueError
        If it is not finite and symmetric, not positive definite, or its principal moments violate
        the triangle rule (no body has one moment larger than the sum of the other two).
    """
    tensor = np.array(value, dtype=float)
    if tensor.shape == (3,):
        tensor = np.diag(tensor)
    if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
        raise ValueError(f"{name}: expected 3 or 3 x 3 finite numbers (kg m2); got {value!r}")
    if not np.allclose(tensor, tensor.T, rtol=1e-9, atol=0.0):
        raise ValueError(f"{name}: expected a symmetric matrix; got {tensor.tolist()}")
    moments = np.linalg.eigvalsh(tensor)
    if not moments[0] > 0.0:
        raise ValueError(
            f"{name}: expected a positive definite matrix; its principal moments are "
            f"{moments.tolist()} kg m2"
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ValueError(
            f"{name}: no body has these principal moments, the largest exceeds the sum of the "
            f"others; got {moments.tolist()} kg m2"
        )
    return tensor


@dataclass(frozen=True)
class AttitudeState:
    """Attitude, rate and wheel of a spacecraft at one time.

    Attributes
    ----------
    quaternion_gcrf
        Body to GCRF, x, y, z, w, shape (4,).
    rate_body
        Angular velocity against GCRF in body axes, rad/s, shape (3,).
    wheel_momentum
        Momentum of the wheel along its axis, relative to the body, N m s.
    """

    quaternion_gcrf: FloatArray
    rate_body: FloatArray
    wheel_momentum: float = 0.0

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        object.__setattr__(
            self, "quaternion_gcrf", check_quaternion("quaternion_gcrf", self.quaternion_gcrf)
        )
        object.__setattr__(self, "rate_body", check_vector("rate_body", self.rate_body, 3, "rad/s"))
        if not math.isfinite(self.wheel_momentum):
            raise ValueError(
                f"wheel_momentum: expected a number (N m s); got {self.wheel_momentum}"
            )

    @property
    def rotation_gcrf_from_body(self) -> FloatArray:
        """Rotation matrix with ``vector_gcrf = R @ vector_body``, shape (3, 3)."""
        matrix: FloatArray = rotation_matrix(self.quaternion_gcrf)
        return matrix

    def to_array(self) -> FloatArray:
        """Return quaternion, rate and wheel momentum in one array, shape (8,)."""
        return np.concatenate((self.quaternion_gcrf, self.rate_body, [self.wheel_momentum]))

    @staticmethod
    def from_array(values: FloatArray) -> AttitudeState:
        """Return the state of an array of shape (8,)."""
        return AttitudeState(values[:4].copy(), values[4:7].copy(), float(values[7]))


@dataclass(frozen=True)
class OrbitInterval:
    """What the orbit does to the attitude over an interval.

    Attributes
    ----------
    duration
        Length, s.
    field_gcrf
        Magnetic field at start, middle and end, T, shape (3, 3), one row each.
    position_gcrf
        Position at the same times, m, shape (3, 3).
    drag_force_gcrf
        Aerodynamic force, N, shape (3,).
    """

    duration: float
    field_gcrf: FloatArray
    position_gcrf: FloatArray
    drag_force_gcrf: FloatArray


@compiled
def _parabola(nodes, fraction, result):  # type: ignore[no-untyped-def]
    """Interpolate between values at 0, 1/2 and 1."""
    first = (1.0 - fraction) * (1.0 - 2.0 * fraction)
    middle = 4.0 * fraction * (1.0 - fraction)
    last = fraction * (2.0 * fraction - 1.0)
    for axis in range(3):
        result[axis] = first * nodes[0, axis] + middle * nodes[1, axis] + last * nodes[2, axis]


@compiled
def rotation_rate(  # type: ignore[no-untyped-def]
    state,
    inertia,
    inverse_inertia,
    wheel_axis,
    wheel_torque,
    field_gcrf,
    position_gcrf,
    moment,
    force_gcrf,
    force_point,
    torque,
    rate,
):
    """Fill `rate` (8,) with the rate of change of a state (8,)."""
    x, y, z, w = state[0], state[1], state[2], state[3]
    a, b, c = state[4], state[5], state[6]
    rate[0] = 0.5 * (w * a + y * c - z * b)
    rate[1] = 0.5 * (w * b + z * a - x * c)
    rate[2] = 0.5 * (w * c + x * b - y * a)
    rate[3] = -0.5 * (x * a + y * b + z * c)
    matrix = rotation_matrix(state)
    bx = by = bz = ux = uy = uz = fx = fy = fz = 0.0
    square = 0.0
    for i in range(3):
        square += position_gcrf[i] * position_gcrf[i]
        bx += matrix[i, 0] * field_gcrf[i]
        by += matrix[i, 1] * field_gcrf[i]
        bz += matrix[i, 2] * field_gcrf[i]
        ux += matrix[i, 0] * position_gcrf[i]
        uy += matrix[i, 1] * position_gcrf[i]
        uz += matrix[i, 2] * position_gcrf[i]
        fx += matrix[i, 0] * force_gcrf[i]
        fy += matrix[i, 1] * force_gcrf[i]
        fz += matrix[i, 2] * force_gcrf[i]
    gradient = 3.0 * GM_EARTH / (square * square * math.sqrt(square))
    ix = inertia[0, 0] * ux + inertia[0, 1] * uy + inertia[0, 2] * uz
    iy = inertia[1, 0] * ux + inertia[1, 1] * uy + inertia[1, 2] * uz
    iz = inertia[2, 0] * ux + inertia[2, 1] * uy + inertia[2, 2] * uz
    h = state[7]
    hx = inertia[0, 0] * a + inertia[0, 1] * b + inertia[0, 2] * c + h * wheel_axis[0]
    hy = inertia[1, 0] * a + inertia[1, 1] * b + inertia[1, 2] * c + h * wheel_axis[1]
    hz = inertia[2, 0] * a + inertia[2, 1] * b + inertia[2, 2] * c + h * wheel_axis[2]
    px, py, pz = force_point[0], force_point[1], force_point[2]
    nx = moment[1] * bz - moment[2] * by + gradient * (uy * iz - uz * iy)
    ny = moment[2] * bx - moment[0] * bz + gradient * (uz * ix - ux * iz)
    nz = moment[0] * by - moment[1] * bx + gradient * (ux * iy - uy * ix)
    nx += py * fz - pz * fy + torque[0] - (b * hz - c * hy) - wheel_torque * wheel_axis[0]
    ny += pz * fx - px * fz + torque[1] - (c * hx - a * hz) - wheel_torque * wheel_axis[1]
    nz += px * fy - py * fx + torque[2] - (a * hy - b * hx) - wheel_torque * wheel_axis[2]
    for i in range(3):
        rate[4 + i] = (
            inverse_inertia[i, 0] * nx + inverse_inertia[i, 1] * ny + inverse_inertia[i, 2] * nz
        )
    rate[7] = wheel_torque


@compiled
def rotation_step(  # type: ignore[no-untyped-def]
    state,
    step,
    inertia,
    inverse_inertia,
    wheel_axis,
    wheel_torque,
    fields_gcrf,
    positions_gcrf,
    moment,
    force_gcrf,
    force_point,
    torque,
    rates,
    trial,
):
    """Advance a state (8,) in place by one classical Runge-Kutta step of order 4.

    Fields and positions (3, 3) are those at the start, the middle and the end of the step; `rates`
    (4, 8) and `trial` (8,) are room for the stages. The quaternion is brought back to unit length.
    """
    for stage in range(4):
        share = 1.0 if stage == 3 else 0.5
        for i in range(8):
            trial[i] = state[i]
            if stage:
                trial[i] += share * step * rates[stage - 1, i]
        node = (stage + 1) // 2
        rotation_rate(
            trial,
            inertia,
            inverse_inertia,
            wheel_axis,
            wheel_torque,
            fields_gcrf[node],
            positions_gcrf[node],
            moment,
            force_gcrf,
            force_point,
            torque,
            rates[stage],
        )
    for i in range(8):
        total = rates[0, i] + 2.0 * rates[1, i] + 2.0 * rates[2, i] + rates[3, i]
        state[i] += step / 6.0 * total
    length = math.sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
    for i in range(4):
        state[i] /= length


@compiled
def integrate_rotation(  # type: ignore[no-untyped-def]
    state,
    start,
    end,
    steps,
    duration,
    fields_gcrf,
    positions_gcrf,
    inertia,
    inverse_inertia,
    wheel_axis,
    wheel_torque,
    moment,
    force_gcrf,
    force_point,
    torque,
):
    """Advance a state (8,) in place from `start` to `end`, s within an interval.

    Classical Runge-Kutta of order 4 in `steps` equal steps; the quaternion is brought back to unit
    length after each. Moment (A m2), wheel torque and torque (N m) are constant.
    """
    step = (end - start) / steps
    fields = np.empty((3, 3))
    positions = np.empty((3, 3))
    rates = np.empty((4, 8))
    trial = np.empty(8)
    for number in range(steps):
        time = start + number * step
        for node in range(3):
            fraction = (time + 0.5 * node * step) / duration
            _parabola(fields_gcrf, fraction, fields[node])
            _parabola(positions_gcrf, fraction, positions[node])
        rotation_step(
            state,
            step,
            inertia,
            inverse_inertia,
            wheel_axis,
            wheel_torque,
            fields,
            positions,
            moment,
            force_gcrf,
            force_point,
            torque,
            rates,
            trial,
        )

"""Compiled steps of the attitude filters: prediction over a period and update by the field.

Error state, 22 numbers and those of the field: small rotation (rad, body axes), rate (rad/s),
residual dipole (A m2), magnetometer bias (T), inertia corrections (share of each diagonal moment),
drift of the dipole (A m2/s), momentum of the wheel less what it was told (N m s), torque that no
model knows (N m, body axes), where the model of the field has an error its coefficients (T, see
`vtff_nav.attitude.field_error`) and, where thrusters may miss the centre of mass, by how much (m,
six numbers at the end: for the force along each axis the offsets along the next two). What else is
not estimated has zero variance and zero process noise: its rows and columns stay zero and cost
little. The true attitude is the estimate times the small rotation, in body axes.

The dipole follows its drift, a Gauss-Markov process. A random walk of the dipole would have to be
large to follow a drift that lasts for hours, and would then doubt a dipole that stays. The error of
the wheel is new in each period: a wheel that follows its command is off by a bounded error, and
what it gave to the body in a period it takes back in the next. The torque is a Gauss-Markov
process: drag on a spacecraft that points stays alike in its axes, and white noise of its size would
doubt the rate in every period.

References
----------
Markley and Crassidis (2014), Fundamentals of Spacecraft Attitude Determination and Control, 6.2.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.attitude.quaternion import from_rotation_vector, multiply, rotation_matrix
from vtff_dynamics.attitude.rigid_body import rotation_step
from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH

__all__ = [
    "BIAS",
    "DIPOLE",
    "DRIFT",
    "FIELD",
    "INERTIA",
    "OFFSETS",
    "RATE",
    "ROTATION",
    "TORQUE",
    "WHEEL",
    "mean_rod_moment",
    "predict_attitude",
    "predict_rate_and_dipole",
    "update_by_field",
]

ROTATION, RATE, DIPOLE, BIAS, INERTIA, DRIFT, WHEEL, TORQUE, FIELD = 0, 3, 6, 9, 12, 15, 18, 19, 22
"""First number of each part of the error state; the mean has no rotation and begins with RATE."""
OFFSETS = 6
"""Offsets of the thrusters, which stand behind the field where they are estimated."""

_SHORTEST_STEP = 1e-9  # s; edges that are closer are one


@compiled
def _cross_matrix(vector):  # type: ignore[no-untyped-def]
    matrix = np.zeros((3, 3))
    matrix[0, 1] = -vector[2]
    matrix[0, 2] = vector[1]
    matrix[1, 0] = vector[2]
    matrix[1, 2] = -vector[0]
    matrix[2, 0] = -vector[1]
    matrix[2, 1] = vector[0]
    return matrix


@compiled
def _product(left, right):  # type: ignore[no-untyped-def]
    """Multiply matrices that are too small for a library call."""
    result = np.zeros((left.shape[0], right.shape[1]))
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            value = left[i, k]
            if value != 0.0:
                for j in range(right.shape[1]):
                    result[i, j] += value * right[k, j]
    return result


@compiled
def mean_rod_moment(pulses, start, end, rod_moment):  # type: ignore[no-untyped-def]
    """Return the mean moment of the rods between two times of a period, A m2, shape (3,)."""
    moment = np.zeros(3)
    for axis in range(3):
        on_time = abs(pulses[axis])
        share = min(max(on_time - start, 0.0), end - start) / (end - start)
        moment[axis] = math.copysign(share * rod_moment, pulses[axis]) if share > 0.0 else 0.0
    return moment


@compiled
def _step_edges(pulses, period, steps):  # type: ignore[no-untyped-def]
    """Return the times at which steps begin and end: equal steps, and the ends of the pulses.

    A pulse that ends within a step would act as a weaker one through all of it: 3e-7 rad/s in a
    period of 5 s with steps of 1 s, as much as white torque noise of 8e-9 N m sqrt(s).
    """
    edges = np.empty(steps + 4)
    for number in range(steps + 1):
        edges[number] = number * period / steps
    for axis in range(3):
        edges[steps + 1 + axis] = min(abs(pulses[axis]), period)
    edges.sort()
    return edges


@compiled
def _torque_by_offsets(force, by_offsets):  # type: ignore[no-untyped-def]
    """Write the derivatives (3, 6) of the torque by the offsets of forces along the axes, N."""
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        by_offsets[second, 2 * axis] = -force[axis]
        by_offsets[first, 2 * axis + 1] = force[axis]


@compiled
def predict_attitude(  # type: ignore[no-untyped-def]
    quaternion,
    mean,
    covariance,
    period,
    steps,
    field_start,
    field_end,
    position_gcrf,
    wheel_start,
    wheel_end,
    wheel_axis,
    inertia,
    pulses,
    rod_moment,
    coupling,
    noise,
    field_partial,
    field_variances,
    thruster_forces,
):
    """Predict attitude, state and covariance over a period, in place.

    Parameters
    ----------
    quaternion : (4,)
    mean : (n - 3,)
        The error state without the rotation.
    covariance : (n, n)
    steps : int
        Equal steps of the integration; they end too where a pulse does.
    field_start, field_end : (3,)
        Field of the model in GCRF, T.
    position_gcrf : (3,)
        In the middle of the period, m.
    wheel_start, wheel_end : float
        Momentum of the wheel, N m s; it changes uniformly.
    pulses : (3,)
        On-times of the rods from the start of the period, s, signed.
    noise : (9,)
        Torque (N m sqrt(s)), sigma of the drift of the dipole (A m2/s), its correlation time (s),
        bias walk (T/sqrt(s)), sigma of the momentum of the wheel about its command (N m s), sigma
        of the moment of a rod (share), correlation time of the error of the field (s), sigma of the
        torque that stays alike (N m), its correlation time (s).
    field_partial : (3, m)
        Derivatives of the field in GCRF by the m coefficients of its error.
    field_variances : (m,)
        Variances of these coefficients without measurements.
    thruster_forces : (parts, 3)
        Forces along the axes of the body in equal parts of the period, N. They act on the attitude
        where their offsets are estimated: n is then 28 + m, else 22 + m.
    """
    states = len(covariance)
    coefficients = field_partial.shape[1]
    field_end_state = FIELD + coefficients
    has_offsets = states > field_end_state
    identity = np.eye(3)
    body = inertia.copy()
    for axis in range(3):
        body[axis, axis] *= 1.0 + mean[INERTIA - RATE + axis]
    inverse = np.linalg.inv(body)
    wheel_begin = wheel_start + mean[WHEEL - RATE]
    wheel_torque = (wheel_end - wheel_begin) / period
    nothing = np.zeros(3)
    torque_mean = mean[TORQUE - RATE : FIELD - RATE].copy()
    torque = torque_mean.copy()
    by_offsets = np.zeros((3, OFFSETS))
    state = np.empty(8)
    state[:4] = quaternion
    state[4:7] = mean[:3]
    state[7] = wheel_begin
    rates = np.empty((4, 8))
    stage_state = np.empty(8)
    positions = np.empty((3, 3))  # of the middle of the period, throughout
    for node in range(3):
        positions[node] = position_gcrf
    field_error = np.zeros(3)
    for i in range(3):
        for j in range(coefficients):
            field_error[i] += field_partial[i, j] * mean[FIELD - RATE + j]
    by_wheel = np.zeros(3)
    for i in range(3):
        for j in range(3):
            by_wheel[i] += inverse[i, j] * wheel_axis[j]
    growth = np.zeros((6, states))
    for i in range(6):
        growth[i, i] = 1.0
    matrix = np.zeros((6, states))
    rod_variance = np.zeros(3)
    edges = _step_edges(pulses, period, steps)
    for number in range(len(edges) - 1):
        time = edges[number]
        step = edges[number + 1] - time
        if step < _SHORTEST_STEP:
            continue
        rods = mean_rod_moment(pulses, time, time + step, rod_moment)
        moment = mean[DIPOLE - RATE : BIAS - RATE].copy()
        for i in range(3):
            rod_variance[i] += (rods[i] * noise[5]) ** 2 * step / period
            for j in range(3):
                moment[i] += coupling[i, j] * rods[j]
        field = np.empty((3, 3))
        for half in range(3):
            share = (time + 0.5 * half * step) / period
            for i in range(3):
                field[half, i] = (
                    (1.0 - share) * field_start[i] + share * field_end[i] + field_error[i]
                )
        if has_offsets:
            part = int((time + 0.5 * step) / period * len(thruster_forces))
            _torque_by_offsets(thruster_forces[min(part, len(thruster_forces) - 1)], by_offsets)
            for i in range(3):
                torque[i] = torque_mean[i]
                for j in range(OFFSETS):
                    torque[i] += by_offsets[i, j] * mean[field_end_state - RATE + j]
        before = state.copy()
        rotation_step(
            state,
            step,
            body,
            inverse,
            wheel_axis,
            wheel_torque,
            field,
            positions,
            moment,
            nothing,
            nothing,
            torque,
            rates,
            stage_state,
        )
        # Linear model at the middle of the step.
        middle = 0.5 * (before + state)
        length = math.sqrt(np.sum(middle[:4] * middle[:4]))
        to_gcrf = rotation_matrix(middle[:4] / length)
        rate = middle[4:7].copy()
        acceleration = (state[4:7] - before[4:7]) / step
        field_body = np.zeros(3)
        down = np.zeros(3)
        square = 0.0
        for i in range(3):
            square += position_gcrf[i] ** 2
            for j in range(3):
                field_body[i] += to_gcrf[j, i] * field[1, j]
                down[i] += to_gcrf[j, i] * position_gcrf[j]
        gradient = 3.0 * GM_EARTH / (square * square * math.sqrt(square))
        momentum = np.zeros(3)
        heavy = np.zeros(3)
        for i in range(3):
            momentum[i] = middle[7] * wheel_axis[i]
            for j in range(3):
                momentum[i] += body[i, j] * rate[j]
                heavy[i] += body[i, j] * down[j]
        cross_rate = _cross_matrix(rate)
        cross_field = _cross_matrix(field_body)
        cross_moment = _cross_matrix(moment)
        cross_down = _cross_matrix(down)
        turned = _product(cross_moment, cross_field) + gradient * (
            _product(_product(cross_down, body), cross_down)
            - _product(_cross_matrix(heavy), cross_down)
        )
        by_rotation = _product(inverse, turned)
        by_rate = _product(inverse, _cross_matrix(momentum) - _product(cross_rate, body))
        by_dipole = -_product(inverse, cross_field)
        to_body = to_gcrf.T.copy()
        by_field = _product(inverse, _product(cross_moment, _product(to_body, field_partial)))
        by_inertia = np.empty((3, 3))
        for i in range(3):
            change = np.zeros(3)
            change[i] = inertia[i, i]
            balance = np.zeros((3, 1))
            gyroscopic = _product(cross_rate, (change * rate[i]).reshape(3, 1))
            gravity = _product(cross_down, (change * down[i]).reshape(3, 1))
            for j in range(3):
                balance[j, 0] = (
                    -change[j] * acceleration[i] - gyroscopic[j, 0] + gradient * gravity[j, 0]
                )
            column = _product(inverse, balance)
            for j in range(3):
                by_inertia[j, i] = column[j, 0]
        # The wheel gives its error of the last period back in this one.
        left = 1.0 - (time + 0.5 * step) / period
        turned_wheel = _product(inverse, _product(cross_rate, wheel_axis.copy().reshape(3, 1)))
        for i in range(3):
            for j in range(3):
                matrix[i, ROTATION + j] = -cross_rate[i, j]
                matrix[i, RATE + j] = identity[i, j]
                matrix[3 + i, ROTATION + j] = by_rotation[i, j]
                matrix[3 + i, RATE + j] = by_rate[i, j]
                matrix[3 + i, DIPOLE + j] = by_dipole[i, j]
                matrix[3 + i, INERTIA + j] = by_inertia[i, j]
                matrix[3 + i, TORQUE + j] = inverse[i, j]
            matrix[3 + i, WHEEL] = by_wheel[i] / period - left * turned_wheel[i, 0]
            for j in range(coefficients):
                matrix[3 + i, FIELD + j] = by_field[i, j]
        if has_offsets:
            faster = _product(inverse, by_offsets)
            for i in range(3):
                for j in range(OFFSETS):
                    matrix[3 + i, field_end_state + j] = faster[i, j]
        dynamics = matrix[:, :6].copy()
        slope = _product(dynamics, growth)
        slope[:, 6:] += matrix[:, 6:]
        trial = growth + 0.5 * step * slope
        slope = _product(dynamics, trial)
        slope[:, 6:] += matrix[:, 6:]
        growth += step * slope
    for i in range(4):
        quaternion[i] = state[i]
    for i in range(3):
        mean[i] = state[4 + i]
    known = math.exp(-period / noise[6])
    for i in range(coefficients):
        mean[FIELD - RATE + i] *= known
    mean[WHEEL - RATE] = 0.0
    lasting = math.exp(-period / noise[8])
    for i in range(3):
        mean[TORQUE - RATE + i] *= lasting
    # In a period the drift is too small to be felt: the dipole takes it at the end.
    kept = math.exp(-period / noise[2])
    for i in range(3):
        mean[DIPOLE - RATE + i] += period * mean[DRIFT - RATE + i]
        mean[DRIFT - RATE + i] *= kept
    upper = _product(growth, covariance)
    corner = _product(upper, growth.T.copy())
    for i in range(6):
        for j in range(6):
            covariance[i, j] = 0.5 * (corner[i, j] + corner[j, i])
        for j in range(6, states):
            covariance[i, j] = upper[i, j]
            covariance[j, i] = upper[i, j]
    for i in range(3):
        for j in range(states):
            covariance[DIPOLE + i, j] += period * covariance[DRIFT + i, j]
            covariance[DRIFT + i, j] *= kept
    for i in range(3):
        for j in range(states):
            covariance[j, DIPOLE + i] += period * covariance[j, DRIFT + i]
            covariance[j, DRIFT + i] *= kept
    for j in range(states):
        covariance[WHEEL, j] = 0.0
        covariance[j, WHEEL] = 0.0
    for i in range(TORQUE, FIELD):
        for j in range(states):
            covariance[i, j] *= lasting
            covariance[j, i] *= lasting
        covariance[i, i] += (1.0 - lasting * lasting) * noise[7] ** 2
    for i in range(FIELD, field_end_state):
        for j in range(states):
            covariance[i, j] *= known
            covariance[j, i] *= known
        covariance[i, i] += (1.0 - known * known) * field_variances[i - FIELD]
    # Torque noise, and what the rods give besides what is known of them.
    spread = np.zeros((3, 3))
    for i in range(3):
        spread[i, i] = noise[0] ** 2 * period
    for axis in range(3):
        if rod_variance[axis] > 0.0:
            unit = np.zeros(3)
            for i in range(3):
                unit[i] = coupling[i, axis]
            arm = np.zeros(3)
            arm[0] = unit[1] * field_body[2] - unit[2] * field_body[1]
            arm[1] = unit[2] * field_body[0] - unit[0] * field_body[2]
            arm[2] = unit[0] * field_body[1] - unit[1] * field_body[0]
            for i in range(3):
                for j in range(3):
                    spread[i, j] += arm[i] * arm[j] * rod_variance[axis] * period * period
    speeds = _product(_product(inverse, spread), inverse)
    for i in range(3):
        for j in range(3):
            covariance[RATE + i, RATE + j] += speeds[i, j]
            covariance[RATE + i, j] += 0.5 * period * speeds[i, j]
            covariance[i, RATE + j] += 0.5 * period * speeds[i, j]
            covariance[i, j] += period * period / 3.0 * speeds[i, j]
        covariance[DRIFT + i, DRIFT + i] += (1.0 - kept * kept) * noise[1] ** 2
        covariance[BIAS + i, BIAS + i] += noise[3] ** 2 * period
    # The error that the wheel has at the end, against the body.
    given = np.zeros(states)
    given[WHEEL] = noise[4]
    for i in range(3):
        given[ROTATION + i] = -0.5 * period * by_wheel[i] * noise[4]
        given[RATE + i] = -by_wheel[i] * noise[4]
    for i in range(states):
        if given[i] != 0.0:
            for j in range(states):
                covariance[i, j] += given[i] * given[j]


@compiled
def update_by_field(  # type: ignore[no-untyped-def]
    quaternion, mean, covariance, measured_body, field_gcrf, sigma, gate, field_partial, innovation
):
    """Update by a magnetometer sample, in place.

    Returns the normalised innovation squared and the logarithm of the likelihood. A sample whose
    normalised innovation squared exceeds `gate` changes nothing. `field_partial` is that of
    `predict_attitude`.
    """
    states = len(covariance)
    coefficients = field_partial.shape[1]
    to_gcrf = rotation_matrix(quaternion)
    field_body = np.zeros(3)
    for i in range(3):
        for j in range(3):
            field_body[i] += to_gcrf[j, i] * field_gcrf[j]
    by_field = _product(to_gcrf.T.copy(), field_partial)
    for i in range(3):
        for j in range(coefficients):
            field_body[i] += by_field[i, j] * mean[FIELD - RATE + j]
    partial = np.zeros((3, states))
    cross_field = _cross_matrix(field_body)
    for i in range(3):
        innovation[i] = measured_body[i] - field_body[i] - mean[BIAS - RATE + i]
        partial[i, BIAS + i] = 1.0
        for j in range(3):
            partial[i, ROTATION + j] = cross_field[i, j]
        for j in range(coefficients):
            partial[i, FIELD + j] = by_field[i, j]
    # Second order: a rotation a along the field and p across it moves the field by (p a + p^2) / 2
    # of its strength besides what the linear model says.
    strength = 0.0
    along = 0.0
    total = 0.0
    for i in range(3):
        strength += field_body[i] ** 2
        total += covariance[i, i]
        for j in range(3):
            along += field_body[i] * covariance[i, j] * field_body[j]
    along /= strength
    across = max(0.5 * (total - along), 0.0)
    variance = sigma * sigma + 0.25 * strength * (along * across + 4.0 * across * across)
    projected = _product(partial, covariance)
    scatter = _product(projected, partial.T.copy())
    for i in range(3):
        scatter[i, i] += variance
    # Scaled, because the inverse of numbers of 1e-15 is safe only in relation to each other.
    inverse = np.linalg.inv(scatter / sigma**2) / sigma**2
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += innovation[i] * inverse[i, j] * innovation[j]
    likelihood = -0.5 * (square + math.log(np.linalg.det(scatter / sigma**2)))
    if square > gate:
        return square, likelihood
    gain = _product(projected.T.copy(), inverse)
    # Joseph's form, multiplied out: P - K H P - (K H P)' + K S K'.
    scattered = _product(gain, scatter)
    for i in range(states):
        for j in range(i + 1):
            value = covariance[i, j]
            for k in range(3):
                value += (
                    scattered[i, k] * gain[j, k]
                    - gain[i, k] * projected[k, j]
                    - gain[j, k] * projected[k, i]
                )
            covariance[i, j] = value
            covariance[j, i] = value
    change = np.zeros(states)
    for i in range(states):
        for k in range(3):
            change[i] += gain[i, k] * innovation[k]
    turned = multiply(quaternion, from_rotation_vector(change[:3]))
    length = math.sqrt(np.sum(turned * turned))
    for i in range(4):
        quaternion[i] = turned[i] / length
    for i in range(states - 3):
        mean[i] += change[3 + i]
    # The small rotation starts anew in the axes of the turned body.
    reset = np.eye(3) - 0.5 * _cross_matrix(change[:3])
    covariance[:3, :] = _product(reset, covariance[:3, :].copy())
    covariance[:, :3] = _product(covariance[:, :3].copy(), reset.T.copy())
    return square, likelihood


@compiled
def predict_rate_and_dipole(  # type: ignore[no-untyped-def]
    mean,
    covariance,
    period,
    steps,
    field_start,
    field_end,
    wheel_start,
    wheel_end,
    wheel_axis,
    inertia,
    inverse,
    pulses,
    rod_moment,
    coupling,
    noise,
):
    """Predict rate and dipole (6,) of the paper's estimator over a period, in place.

    The fields are those measured, in body axes (the paper's Psi); the transition is the product of
    I + (df/dx) dt over the steps (equation 12). `noise` has torque (N m sqrt(s)), dipole walk
    (A m2/sqrt(s)) and the sigma of the magnetometer (T).
    """
    step = period / steps
    transition = np.eye(6)
    wheel_torque = (wheel_end - wheel_start) / period
    field = np.empty(3)
    for number in range(steps):
        share = (number + 0.5) / steps
        for i in range(3):
            field[i] = (1.0 - share) * field_start[i] + share * field_end[i]
        wheel = (1.0 - share) * wheel_start + share * wheel_end
        rods = mean_rod_moment(pulses, number * step, (number + 1) * step, rod_moment)
        moment = mean[3:6].copy()
        for i in range(3):
            for j in range(3):
                moment[i] += coupling[i, j] * rods[j]
        cross_field = _cross_matrix(field)
        rate = mean[:3].copy()
        for half in range(2):
            torque = np.zeros((3, 1))
            momentum = np.empty(3)
            for i in range(3):
                momentum[i] = wheel * wheel_axis[i]
                for j in range(3):
                    momentum[i] += inertia[i, j] * rate[j]
            for i in range(3):
                torque[i, 0] = -wheel_torque * wheel_axis[i]
                for j in range(3):
                    torque[i, 0] -= cross_field[i, j] * moment[j]
            torque[0, 0] -= rate[1] * momentum[2] - rate[2] * momentum[1]
            torque[1, 0] -= rate[2] * momentum[0] - rate[0] * momentum[2]
            torque[2, 0] -= rate[0] * momentum[1] - rate[1] * momentum[0]
            change = _product(inverse, torque)
            if half == 0:
                for i in range(3):
                    rate[i] = mean[i] + 0.5 * step * change[i, 0]
            else:
                for i in range(3):
                    mean[i] += step * change[i, 0]
        by_rate = _product(
            inverse, _cross_matrix(momentum) - _product(_cross_matrix(rate), inertia)
        )
        by_dipole = -_product(inverse, cross_field)
        one = np.eye(6)
        for i in range(3):
            for j in range(3):
                one[i, j] += step * by_rate[i, j]
                one[i, 3 + j] += step * by_dipole[i, j]
        transition = _product(one, transition)
    predicted = _product(_product(transition, covariance), transition.T.copy())
    # The magnetometer's noise acts through the moment, the same over the period.
    noisy = _product(_cross_matrix(moment), _cross_matrix(moment))
    spread = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            spread[i, j] = -noisy[i, j] * (noise[2] * period) ** 2
        spread[i, i] += noise[0] ** 2 * period
    speeds = _product(_product(inverse, spread), inverse)
    for i in range(6):
        for j in range(6):
            covariance[i, j] = 0.5 * (predicted[i, j] + predicted[j, i])
    for i in range(3):
        for j in range(3):
            covariance[i, j] += speeds[i, j]
        covariance[3 + i, 3 + i] += noise[1] ** 2 * period

"""Gravity by spherical harmonics and a Runge-Kutta step under it, compiled: for short predictions.

A step costs a fifth of one by `vtff_dynamics.orbit.propagator`, which stays the reference (a test
compares them): a filter begins anew at each epoch, and the objects of brahe cost more than the
arithmetic.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import EARTH_ROTATION_RATE, GM_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.earth_environment import jgm3_gravity_model
from vtff_dynamics.vectors import FloatArray

__all__ = ["GravityTerms", "advance_under_gravity", "gravity_terms", "harmonic_acceleration"]


class GravityTerms(NamedTuple):
    """Coefficients of JGM-3 to some degree N and order M, as the recursion takes them.

    Attributes
    ----------
    recursion : ndarray, shape (2, M + 2, N + 2)
        Factors of the two harmonics of lower degree.
    weights : ndarray, shape (6, M + 2, N + 2)
        Acceleration by the cosine and by the sine harmonic of each degree and order: x by both, y
        by both, z by both.
    """

    recursion: FloatArray
    weights: FloatArray


@functools.lru_cache(maxsize=8)
def gravity_terms(degree: int, order: int) -> GravityTerms:
    """Return the terms of JGM-3 to a degree and order; 0 and 0 are the point mass.

    References
    ----------
    Montenbruck and Gill (2000), Satellite Orbits, eqs. (3.29) to (3.33), by Cunningham (1970).
    """
    recursion = np.zeros((2, order + 2, degree + 2))
    weights = np.zeros((6, order + 2, degree + 2))
    model = jgm3_gravity_model()
    for n in range(degree + 2):
        for m in range(min(n, order + 2)):
            recursion[:, m, n] = (2 * n - 1) / (n - m), (n + m - 1) / (n - m)
    for n in range(degree + 1):
        for m in range(min(n, order) + 1):
            cosine, sine = _coefficients(model, n, m)
            weights[4:, m, n + 1] -= (n - m + 1) * cosine, (n - m + 1) * sine
            if m == 0:
                weights[0, 1, n + 1] -= cosine
                weights[3, 1, n + 1] -= cosine
                continue
            weights[:4, m + 1, n + 1] -= 0.5 * cosine, 0.5 * sine, -0.5 * sine, 0.5 * cosine
            half = 0.5 * (n - m + 2) * (n - m + 1)
            weights[:4, m - 1, n + 1] += half * cosine, half * sine, half * sine, -half * cosine
    for array in (recursion, weights):
        array.flags.writeable = False
    return GravityTerms(recursion, weights)


def _coefficients(model, n: int, m: int) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """Return the coefficients C and S without normalisation."""
    if n == 0:
        return 1.0, 0.0
    ratio = math.prod(range(n - m + 1, n + m + 1))
    scale = math.sqrt((2 - (m == 0)) * (2 * n + 1) / ratio)
    cosine, sine = model.get(n, m)
    return scale * cosine, scale * sine


@compiled
def harmonic_acceleration(position, recursion, weights):  # type: ignore[no-untyped-def]
    """Return the acceleration at a position, both in Earth-fixed axes, shape (3,), m/s2 and m.

    `recursion` and `weights` are those of `GravityTerms`.
    """
    orders, degrees = recursion.shape[1], recursion.shape[2]
    x, y, z = position[0], position[1], position[2]
    square = x * x + y * y + z * z
    scale = RADIUS_EARTH_JGM3 / square
    x, y, z, inverse = scale * x, scale * y, scale * z, scale * RADIUS_EARTH_JGM3
    along_x, along_y, along_z = 0.0, 0.0, 0.0
    first_cosine, first_sine = RADIUS_EARTH_JGM3 / math.sqrt(square), 0.0
    for m in range(orders):
        if m > 0:
            factor = 2.0 * m - 1.0
            first_cosine, first_sine = (
                factor * (x * first_cosine - y * first_sine),
                factor * (x * first_sine + y * first_cosine),
            )
        cosine, cosine_before, sine, sine_before = first_cosine, 0.0, first_sine, 0.0
        for n in range(m, degrees):
            if n > m:
                one, two = z * recursion[0, m, n], inverse * recursion[1, m, n]
                cosine, cosine_before = one * cosine - two * cosine_before, cosine
                sine, sine_before = one * sine - two * sine_before, sine
            along_x += weights[0, m, n] * cosine + weights[1, m, n] * sine
            along_y += weights[2, m, n] * cosine + weights[3, m, n] * sine
            along_z += weights[4, m, n] * cosine + weights[5, m, n] * sine
    factor = GM_EARTH / RADIUS_EARTH_JGM3**2
    total = np.empty(3)
    total[0], total[1], total[2] = factor * along_x, factor * along_y, factor * along_z
    return total


@compiled
def advance_under_gravity(state, acceleration, to_itrf, step, recursion, weights):  # type: ignore[no-untyped-def]
    """Return a state one Runge-Kutta step later, GCRF, shape (6,).

    Parameters
    ----------
    state : ndarray, shape (6,)
        Position and velocity, GCRF, m and m/s.
    acceleration : ndarray, shape (3,)
        Constant acceleration besides gravity, GCRF, m/s2.
    to_itrf : ndarray, shape (3, 3)
        Rotation from GCRF to ITRF at the begin of the step. Over the step the Earth turns about
        its axis alone.
    step : float
        s.
    recursion, weights : ndarray
        See `GravityTerms`.
    """
    rates = np.empty((4, 6))
    stage = np.empty(6)
    fixed = np.empty(3)
    for index in range(4):
        elapsed = 0.0 if index == 0 else (step if index == 3 else 0.5 * step)
        for k in range(6):
            stage[k] = state[k] + (elapsed * rates[index - 1, k] if index else 0.0)
        cosine = math.cos(EARTH_ROTATION_RATE * elapsed)
        sine = math.sin(EARTH_ROTATION_RATE * elapsed)
        for k in range(3):
            row = to_itrf[k]
            fixed[k] = row[0] * stage[0] + row[1] * stage[1] + row[2] * stage[2]
        x, y = fixed[0], fixed[1]
        fixed[0], fixed[1] = cosine * x + sine * y, cosine * y - sine * x
        pull = harmonic_acceleration(fixed, recursion, weights)
        x, y = pull[0], pull[1]
        pull[0], pull[1] = cosine * x - sine * y, cosine * y + sine * x
        for k in range(3):
            rates[index, k] = stage[3 + k]
            rates[index, 3 + k] = acceleration[k] + (
                to_itrf[0, k] * pull[0] + to_itrf[1, k] * pull[1] + to_itrf[2, k] * pull[2]
            )
    after = np.empty(6)
    for k in range(6):
        after[k] = state[k] + step / 6.0 * (
            rates[0, k] + 2.0 * rates[1, k] + 2.0 * rates[2, k] + rates[3, k]
        )
    return after

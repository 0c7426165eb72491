"""What any estimator can learn of a dipole from measured rates: the bound of Cramer and Rao.

It goes by the true motion and by no filter: the sensitivities of the rates to the rate at the start
and to the dipole follow from Euler's equations along true rates and fields, and nothing is known at
the start. The rates are measured at the ends of equal periods with white noise.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["dipole_bound"]


def dipole_bound(
    rate_body: FloatArray,
    field_body: FloatArray,
    period: float,
    inertia: FloatArray,
    wheel_momentum: FloatArray,
    rate_sigma: float,
) -> FloatArray:
    """Return the smallest covariance of the dipole, (A m2)2, shape (3, 3).

    Parameters
    ----------
    rate_body, field_body : ndarray, shape (samples + 1, 3)
        True rate (rad/s) and field (T) at the start and at each sample, body axes.
    period : float
        Time between samples, s.
    inertia : ndarray, shape (3, 3)
        kg m2.
    wheel_momentum : ndarray, shape (3,)
        Momentum of the wheel, which is constant, N m s, body axes.
    rate_sigma : float
        White noise of each axis of a sample, rad/s.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the samples do not tell the dipole.
    """
    inverse = np.linalg.inv(inertia)

    def slope(sensitivity: FloatArray, rate: FloatArray, field: FloatArray) -> FloatArray:
        momentum = inertia @ rate + wheel_momentum
        by_rate = inverse @ (_cross_matrix(momentum) - _cross_matrix(rate) @ inertia)
        changed: FloatArray = by_rate @ sensitivity
        changed[:, 3:] -= inverse @ _cross_matrix(field)
        return changed

    sensitivity = np.hstack((np.eye(3), np.zeros((3, 3))))
    # The dipole in units in which both parts of the information are alike.
    scale = np.array([1.0] * 3 + [1e3] * 3)
    information = np.zeros((6, 6))
    for number in range(1, len(rate_body)):
        rates, fields = rate_body[number - 1 : number + 1], field_body[number - 1 : number + 1]
        middle = rates.mean(axis=0), fields.mean(axis=0)
        first = slope(sensitivity, rates[0], fields[0])
        second = slope(sensitivity + 0.5 * period * first, *middle)
        third = slope(sensitivity + 0.5 * period * second, *middle)
        fourth = slope(sensitivity + period * third, rates[1], fields[1])
        sensitivity = sensitivity + period / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        scaled = sensitivity / scale
        information += scaled.T @ scaled / rate_sigma**2
    covariance = np.linalg.inv(information) / np.outer(scale, scale)
    bound: FloatArray = covariance[3:, 3:]
    return bound


def _cross_matrix(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

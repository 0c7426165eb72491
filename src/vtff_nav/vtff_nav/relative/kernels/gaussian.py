"""Update and prediction of a Gaussian state, but for its products of matrices, compiled.

Products stay with the BLAS of numpy: their sums have its order.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = [
    "decay_members",
    "linear_motion",
    "replace_members",
    "symmetric_mean",
    "symmetric_of_upper",
    "without_nuisance",
]


@compiled
def symmetric_of_upper(upper):  # type: ignore[no-untyped-def]
    """Return the symmetric matrix (n, n) of which the upper half is filled."""
    size = len(upper)
    matrix = np.empty((size, size))
    for row in range(size):
        for column in range(row + 1):
            matrix[row, column] = matrix[column, row] = upper[column, row]
    return matrix


@compiled
def symmetric_mean(matrix):  # type: ignore[no-untyped-def]
    """Return the mean of a matrix (n, n) and its transpose."""
    size = len(matrix)
    mean = np.empty((size, size))
    for row in range(size):
        for column in range(row + 1):
            mean[row, column] = mean[column, row] = 0.5 * (
                matrix[row, column] + matrix[column, row]
            )
    return mean


@compiled
def without_nuisance(weight, weighted, normal):  # type: ignore[no-untyped-def]
    """Project a nuisance parameter out of a weight matrix in place; return its gain, (1, m).

    Parameters
    ----------
    weight : ndarray, shape (m, m)
    weighted : ndarray, shape (m, 1)
        Its product with the derivatives by the parameter.
    normal : float
        Weight of the parameter.
    """
    count = len(weighted)
    inverse, gain = 1.0 / normal, np.empty((1, count))
    for m in range(count):
        gain[0, m] = inverse * weighted[m, 0]
    for row in range(count):
        for column in range(count):
            weight[row, column] -= weighted[row, 0] * gain[0, column]
    return gain


@compiled
def linear_motion(  # type: ignore[no-untyped-def]
    size, transition, thrust_columns, thrust_coupling, turn_columns, turn_coupling, contents, moved
):
    """Return the derivatives of the members that motion changes, (9 + contents, size).

    Parameters
    ----------
    size : int
        Number of members.
    transition : ndarray, shape (9, 9)
        Transition matrix of the first members.
    thrust_columns, turn_columns : ndarray of int, shape (k,)
        Errors of the thrust, and of the attitude that turns it; none without thrust.
    thrust_coupling, turn_coupling : ndarray, shape (9, k)
        Derivatives of the first members by them.
    contents : ndarray of int
        Contents of shells, each before its gradients to north and east.
    moved : ndarray, shape (2,)
        Motion to north and east over ground, deg.
    """
    states = len(transition)
    coefficients = np.zeros((states + len(contents), size))
    for row in range(states):
        for column in range(states):
            coefficients[row, column] = transition[row, column]
        for k in range(len(thrust_columns)):
            coefficients[row, thrust_columns[k]] = thrust_coupling[row, k]
        for k in range(len(turn_columns)):
            coefficients[row, turn_columns[k]] = turn_coupling[row, k]
    for k in range(len(contents)):
        # The content above the chief changes as the chief moves along the gradient.
        content = contents[k]
        coefficients[states + k, content] = 1.0
        coefficients[states + k, content + 1] = moved[0]
        coefficients[states + k, content + 2] = moved[1]
    return coefficients


@compiled
def replace_members(mean, covariance, rows, changed_mean, changed, block):  # type: ignore[no-untyped-def]
    """Replace some members of a state by linear functions of all of them, in place.

    Parameters
    ----------
    mean, covariance : ndarray, shape (n,) and (n, n)
    rows : ndarray of int, shape (k,)
        The members.
    changed_mean : ndarray, shape (k,)
        Their means.
    changed, block : ndarray, shape (k, n) and (k, k)
        Their covariances with all members as they were, and with each other.
    """
    size = len(mean)
    for k in range(len(rows)):
        mean[rows[k]] = changed_mean[k]
        for column in range(size):
            covariance[rows[k], column] = changed[k, column]
            covariance[column, rows[k]] = changed[k, column]
    for k in range(len(rows)):
        for j in range(len(rows)):
            covariance[rows[k], rows[j]] = block[k, j]


@compiled
def decay_members(mean, covariance, decay, steady_variance, growth):  # type: ignore[no-untyped-def]
    """Propagate the members of a state in place; see `GaussianState.predict_gauss_markov`."""
    size = len(mean)
    for row in range(size):
        mean[row] *= decay[row]
        for column in range(size):
            covariance[row, column] *= decay[row] * decay[column]
    for row in range(size):
        covariance[row, row] += (1.0 - decay[row] ** 2) * steady_variance[row]
        covariance[row, row] += growth[row]

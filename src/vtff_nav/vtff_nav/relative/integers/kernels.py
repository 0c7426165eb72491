"""Compiled inner loops of integer least squares: factorisation, decorrelation, search.

Call them through `vtff_nav.relative.integers.least_squares`, which checks the arguments and gives
reasons for failures.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = [
    "KERNEL_OK",
    "KERNEL_OVERFLOW",
    "KERNEL_SINGULAR",
    "factorise",
    "reduce",
    "search",
]

KERNEL_OK = 0
KERNEL_SINGULAR = 1
KERNEL_OVERFLOW = 2

_SINGULAR = 32.0 * float(np.finfo(float).eps)
"""A conditional variance below this fraction of the variance, times n, is rounding error."""

_EXCHANGE = 1.0 - 1e-6
"""Neighbours are exchanged only if that reduces a variance by more, so that the reduction ends."""

_LARGEST_ENTRY = 2**31
"""Limit of the entries of the transformation: products of two of them still fit into int64."""


@compiled
def factorise(covariance, lower, variances, order):  # type: ignore[no-untyped-def]
    """Factorise Q = L^T D L with symmetric pivoting; return a ``KERNEL_*`` and an ambiguity.

    Each step puts the smallest remaining conditional variance last, which leaves little to the
    reduction. `covariance` is overwritten; `lower`, `variances` and `order` are filled. The
    ambiguity returned is the one at which a matrix is not positive definite.

    References
    ----------
    Chang, Yang and Zhou (2005), MLAMBDA, section 4.1, J. Geodesy 79, 552-565.
    """
    n = covariance.shape[0]
    full = np.empty(n)
    for i in range(n):
        order[i] = i
        full[i] = covariance[i, i]
    for i in range(n - 1, -1, -1):
        smallest = 0
        for k in range(1, i + 1):
            if covariance[k, k] < covariance[smallest, smallest]:
                smallest = k
        if smallest != i:
            for k in range(n):
                kept = covariance[i, k]
                covariance[i, k] = covariance[smallest, k]
                covariance[smallest, k] = kept
            for k in range(n):
                kept = covariance[k, i]
                covariance[k, i] = covariance[k, smallest]
                covariance[k, smallest] = kept
            for k in range(i + 1, n):
                lower[k, i], lower[k, smallest] = lower[k, smallest], lower[k, i]
            order[i], order[smallest] = order[smallest], order[i]
        variance = covariance[i, i]
        if not variance > _SINGULAR * n * full[order[i]]:
            return KERNEL_SINGULAR, order[i]
        variances[i] = variance
        lower[i, i] = 1.0
        for j in range(i):
            lower[i, j] = covariance[i, j] / variance
        for j in range(i):
            factor = lower[i, j] * variance
            for k in range(j + 1):
                covariance[j, k] -= factor * lower[i, k]
                covariance[k, j] = covariance[j, k]
    return KERNEL_OK, 0


@compiled
def _subtract_column(lower, transformation, inverse_transposed, i, k):  # type: ignore[no-untyped-def]
    """Make |L[i, k]| <= 1/2 by an integer multiple of column i; return whether that was exact."""
    multiple = math.floor(lower[i, k] + 0.5)
    if multiple == 0.0:
        return True
    if not abs(multiple) < _LARGEST_ENTRY:
        return False
    n = lower.shape[0]
    for row in range(i, n):
        lower[row, k] -= multiple * lower[row, i]
    whole = np.int64(multiple)
    largest = np.int64(0)
    for row in range(n):
        transformation[row, k] -= whole * transformation[row, i]
        inverse_transposed[row, i] += whole * inverse_transposed[row, k]
        largest = max(largest, abs(transformation[row, k]), abs(inverse_transposed[row, i]))
    return largest < _LARGEST_ENTRY


@compiled
def reduce(lower, variances, transformation, inverse_transposed):  # type: ignore[no-untyped-def]
    """Decorrelate in place by integer Gauss steps and exchanges of neighbours.

    On return z = Z^T a has the factors `lower` and `variances`; `transformation` Z and
    `inverse_transposed` Z^-T must come in as a permutation. Returns a ``KERNEL_*``.

    References
    ----------
    Teunissen (1995), J. Geodesy 70, 65-82; de Jonge and Tiberius (1996), LGR 12, section 3; the
    order of steps is that of Lenstra, Lenstra and Lovasz.
    """
    n = lower.shape[0]
    k = n - 2
    while k >= 0:
        if not _subtract_column(lower, transformation, inverse_transposed, k + 1, k):
            return KERNEL_OVERFLOW
        correlation = lower[k + 1, k]
        exchanged = variances[k] + correlation * correlation * variances[k + 1]
        if exchanged < _EXCHANGE * variances[k + 1]:
            ratio = variances[k] / exchanged
            mixed = variances[k + 1] * correlation / exchanged
            variances[k] = ratio * variances[k + 1]
            variances[k + 1] = exchanged
            for j in range(k):
                first, second = lower[k, j], lower[k + 1, j]
                lower[k, j] = second - correlation * first
                lower[k + 1, j] = ratio * first + mixed * second
            lower[k + 1, k] = mixed
            for row in range(k + 2, n):
                lower[row, k], lower[row, k + 1] = lower[row, k + 1], lower[row, k]
            for row in range(n):
                transformation[row, k], transformation[row, k + 1] = (
                    transformation[row, k + 1],
                    transformation[row, k],
                )
                inverse_transposed[row, k], inverse_transposed[row, k + 1] = (
                    inverse_transposed[row, k + 1],
                    inverse_transposed[row, k],
                )
            k = min(k + 1, n - 2)
            continue
        for i in range(k + 2, n):
            if not _subtract_column(lower, transformation, inverse_transposed, i, k):
                return KERNEL_OVERFLOW
        k -= 1
    return KERNEL_OK


@compiled
def search(center, lower, variances, candidates, norms, node_limit):  # type: ignore[no-untyped-def]
    """Find the integer vectors nearest to `center` in the metric of L^T D L, depth first.

    Every level is visited in the order of distance (Schnorr and Euchner); the ellipsoid shrinks to
    the worst candidate so far. `candidates` (m, n) and `norms` (m,) are filled in rising order of
    the norms. Returns the number of nodes, or -1 if `node_limit` was reached before the search
    ended.

    References
    ----------
    Chang, Yang and Zhou (2005), MLAMBDA, section 4.3; Teunissen (1995), eq. 3.
    """
    wanted, n = candidates.shape
    partial = np.zeros((n + 1, n))
    distance = np.zeros(n + 1)
    conditional = np.empty(n)
    chosen = np.empty(n)
    step = np.empty(n)
    count = 0
    bound = math.inf
    nodes = 0
    k = n - 1
    conditional[k] = center[k]
    chosen[k] = math.floor(conditional[k] + 0.5)
    offset = conditional[k] - chosen[k]
    step[k] = 1.0 if offset >= 0.0 else -1.0
    while True:
        nodes += 1
        if nodes > node_limit:
            norms[count:] = math.inf
            return -1
        new_distance = distance[k + 1] + offset * offset / variances[k]
        if new_distance < bound:
            if k > 0:
                distance[k] = new_distance
                for j in range(k):
                    partial[k, j] = partial[k + 1, j] - offset * lower[k, j]
                k -= 1
                conditional[k] = center[k] + partial[k + 1, k]
                chosen[k] = math.floor(conditional[k] + 0.5)
                offset = conditional[k] - chosen[k]
                step[k] = 1.0 if offset >= 0.0 else -1.0
                continue
            rank = count if count < wanted else wanted - 1
            while rank > 0 and norms[rank - 1] > new_distance:
                norms[rank] = norms[rank - 1]
                candidates[rank] = candidates[rank - 1]
                rank -= 1
            norms[rank] = new_distance
            candidates[rank] = chosen
            count = min(count + 1, wanted)
            if count == wanted:
                bound = norms[wanted - 1]
        else:
            if k == n - 1:
                return nodes
            k += 1
        chosen[k] += step[k]
        offset = conditional[k] - chosen[k]
        step[k] = -step[k] - (1.0 if step[k] > 0.0 else -1.0)

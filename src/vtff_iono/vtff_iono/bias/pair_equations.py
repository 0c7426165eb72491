"""Pairs of satellites of one epoch, which determine receiver biases with a given mapping.

See `vtff_iono.bias.receiver_bias` for the method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from vtff_dynamics.compiled import compiled
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.geometry.mapping import pierce_point

__all__ = [
    "IntArray",
    "PairEquations",
    "PairSolution",
    "count_pairs",
    "jackknife_sigma",
    "satellite_pairs",
    "solve_pairs",
]

IntArray = npt.NDArray[np.intp]

# Smallest vertical content that the gradients are relative to, TECU.
_SMALLEST_CONTENT = 1.0
# Residuals beyond this many sigmas are given less weight (Huber).
_HUBER = 2.0
# Largest number of iterations, and the change of the biases below which they end, TECU.
_ITERATIONS = 15
_CONVERGED = 0.01
# Relative gradient of the content per metre: first value and limits.
_START_GRADIENT = 3e-7
_GRADIENT_LIMITS = (1e-9, 1e-5)
# Error of a vertical content that does not depend on the distance, TECU.
_NOISE = 0.3
# Median of the square of a standard normal number.
_MEDIAN_CHI_SQUARE = float(chdtri(1.0, 0.5))


def satellite_pairs(time: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the indices of all pairs of samples of equal time; `time` must not decrease."""
    edges = np.append(np.flatnonzero(np.diff(time, prepend=-np.inf)), len(time))
    firsts, seconds = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        i, j = np.triu_indices(end - start, 1)
        firsts.append(start + i)
        seconds.append(start + j)
    return np.concatenate(firsts), np.concatenate(seconds)


def count_pairs(time: FloatArray) -> int:
    """Return the number of `satellite_pairs`."""
    samples = np.diff(np.flatnonzero(np.diff(time, prepend=-np.inf, append=np.inf)))
    return int(np.sum(samples * (samples - 1)) // 2)


class PairEquations:
    """The equations of all pairs for one mapping, ordered by blocks of time.

    Parameters
    ----------
    samples : BiasSamples
        In the order of time.
    mapping, pierce_altitude : ndarray, shape (n,)
        Slant over vertical content, and the altitude of the pierce points, m.
    first, second : ndarray of int
        Indices of the samples of each pair, see `satellite_pairs`.
    block : float
        Length of the blocks of time, s.
    """

    def __init__(
        self,
        samples: BiasSamples,
        mapping: FloatArray,
        pierce_altitude: FloatArray,
        first: IntArray,
        second: IntArray,
        block: float,
    ) -> None:
        groups = int(samples.group.max()) + 1 if len(samples.group) else 0
        inverse = 1.0 / mapping
        columns = np.zeros((len(inverse), groups))
        columns[np.arange(len(inverse)), samples.group] = inverse
        vertical = samples.stec_tecu * inverse
        noise = (samples.stec_sigma_tecu * inverse) ** 2 + _NOISE**2
        point = pierce_point(
            samples.position_receiver_itrf, samples.direction_itrf, pierce_altitude
        )
        self.level_shift = _level_shifts(samples, inverse, first, second)
        self.elevation = np.minimum(samples.elevation[first], samples.elevation[second])
        self.design = columns[first] - columns[second]
        self.mean_design = 0.5 * (columns[first] + columns[second])
        self.mean_vertical = 0.5 * (vertical[first] + vertical[second])
        self.difference = vertical[first] - vertical[second]
        self.noise = noise[first] + noise[second]
        self.separation = np.linalg.norm(point[first] - point[second], axis=-1)
        self.structure = _structure_columns(point, samples.position_receiver_itrf, first, second)
        self.block = np.floor(samples.time[first] / block).astype(np.int64)

    def above(self, elevation: float) -> PairEquations:
        """Return the equations of the pairs whose satellites are both above an elevation, rad."""
        is_above = self.elevation >= elevation
        equations = object.__new__(PairEquations)
        for name, column in vars(self).items():
            setattr(equations, name, column[is_above])
        return equations

    def level_sigma(self, weight: FloatArray, matrix: FloatArray) -> FloatArray:
        """Return the sigmas of the biases that the errors of the levels cause, TECU, (groups,).

        `weight` (n,) holds the weights of the equations, `matrix` is their normal matrix.
        """
        arcs = self.level_shift[:, :2].astype(np.int64)
        if arcs.size == 0 or arcs.max() < 0:
            return np.zeros(len(matrix))
        influence = self.design * weight[:, np.newaxis]
        shift = np.zeros((arcs.max() + 1, len(matrix)))
        for side in (0, 1):
            change = influence * self.level_shift[:, 2 + side, np.newaxis]
            np.add.at(shift, arcs[:, side], change if side == 0 else -change)
        return np.asarray(np.sqrt(((np.linalg.pinv(matrix) @ shift.T) ** 2).sum(axis=1)))


def _level_shifts(
    samples: BiasSamples, inverse: FloatArray, first: IntArray, second: IntArray
) -> FloatArray:
    """Return the arcs of both samples, and the vertical contents of one sigma of their levels.

    The result has shape (n, 4). The arcs are -1 if the samples have none.
    """
    number = np.full(len(inverse), -1)
    if samples.arc is not None:
        number = np.unique(samples.arc, return_inverse=True)[1]
    sigma = samples.stec_sigma_tecu * inverse
    return np.stack((number[first], number[second], sigma[first], sigma[second]), axis=-1)


def _structure_columns(
    point: FloatArray, receiver_itrf: FloatArray, first: IntArray, second: IntArray
) -> FloatArray:
    """Return what gradients and the curvature of the content make of each pair, shape (n, 3).

    The first two columns are the separations of the pierce points to the east and north in 1000 km,
    the third is the difference of the squares of their distances from the receiver to the north.
    """
    geodetic = geodetic_from_itrf(point)
    radius = np.linalg.norm(point, axis=-1) * 1e-6
    latitude, longitude = geodetic[..., 0], geodetic[..., 1]
    east = np.angle(np.exp(1j * (longitude[first] - longitude[second])))
    east = east * np.cos(0.5 * (latitude[first] + latitude[second]))
    square = (radius * (latitude - geodetic_from_itrf(receiver_itrf)[..., 0])) ** 2
    columns = (
        radius[first] * east,
        radius[first] * (latitude[first] - latitude[second]),
        square[first] - square[second],
    )
    return np.stack(columns, axis=-1)


class PairSolution(NamedTuple):
    """Receiver biases of one model.

    Attributes
    ----------
    bias_tecu, sigma_tecu : ndarray, shape (groups,)
        Biases and their sigmas from jackknife and levels, TECU.
    left_out_tecu : ndarray, shape (blocks, groups)
        Biases of the solutions that each leave out one block of time, TECU.
    """

    bias_tecu: FloatArray
    sigma_tecu: FloatArray
    left_out_tecu: FloatArray


def solve_pairs(equations: PairEquations, structure: int) -> PairSolution:
    """Return the biases of one model.

    Parameters
    ----------
    equations : PairEquations
        Equations of all pairs.
    structure : int
        Number of the columns of `PairEquations.structure` that are estimated in each block of time:
        0, 2 for the gradients of the content, or 3 with its curvature to the north, too.

    Raises
    ------
    ReceiverBiasError
        If the equations do not determine the biases.
    """
    groups = equations.design.shape[1]
    starts = np.flatnonzero(np.diff(equations.block, prepend=equations.block[0] - 1))
    lengths = np.diff(starts, append=len(equations.block))
    biases, gradient = np.zeros(groups), _START_GRADIENT
    huber = variance = np.ones(len(equations.difference))
    matrices = vectors = np.zeros(0)
    for _ in range(_ITERATIONS):
        content = equations.mean_vertical - equations.mean_design @ biases
        content = np.maximum(content, _SMALLEST_CONTENT)
        variance = equations.noise + (gradient * content * equations.separation) ** 2
        design = equations.design
        if structure:
            # It is relative to the content, as the structure function is.
            columns = equations.structure[:, :structure] * content[:, np.newaxis]
            design = np.hstack((design, columns))
        matrices, vectors = _normal_equations(
            design, equations.difference, huber / variance, starts
        )
        matrix, vector, solve_structure = _eliminate_structure(matrices, vectors, groups)
        previous, biases = biases, _solve(matrix.sum(axis=0), vector.sum(axis=0))
        residual = equations.difference - equations.design @ biases
        if structure:
            of_block = np.repeat(solve_structure(biases), lengths, axis=0)
            residual -= (design[:, groups:] * of_block).sum(axis=1)
        chi_square = residual**2 / variance
        huber = np.minimum(1.0, _HUBER / np.sqrt(np.maximum(chi_square, 1e-12)))
        # The gradient follows from the median of the residuals, which outliers do not move.
        gradient *= math.sqrt(float(np.median(chi_square)) / _MEDIAN_CHI_SQUARE)
        gradient = min(max(gradient, _GRADIENT_LIMITS[0]), _GRADIENT_LIMITS[1])
        if np.abs(biases - previous).max() < _CONVERGED:
            break
    matrix, vector, _ = _eliminate_structure(matrices, vectors, groups)
    level = equations.level_sigma(huber / variance, matrices[:, :groups, :groups].sum(axis=0))
    left_out = _leave_out_blocks(matrix, vector)
    return PairSolution(biases, np.hypot(jackknife_sigma(left_out), level), left_out)


@compiled
def _normal_equations(design, observed, weight, starts):  # type: ignore[no-untyped-def]
    """Return the normal equations of blocks of weighted observations.

    Parameters
    ----------
    design, observed, weight : ndarray, shapes (n, m), (n,), (n,)
    starts : ndarray of int64, shape (k,)
        First observation of each block.

    Returns
    -------
    matrices, vectors : ndarray, shapes (k, m, m), (k, m)
    """
    blocks, size = len(starts), design.shape[1]
    matrices, vectors = np.zeros((blocks, size, size)), np.zeros((blocks, size))
    for block in range(blocks):
        end = starts[block + 1] if block + 1 < blocks else len(observed)
        for row in range(starts[block], end):
            for i in range(size):
                weighted = design[row, i] * weight[row]
                vectors[block, i] += weighted * observed[row]
                for j in range(i + 1):
                    matrices[block, i, j] += weighted * design[row, j]
        for i in range(size):
            for j in range(i):
                matrices[block, j, i] = matrices[block, i, j]
    return matrices, vectors


def _eliminate_structure(
    matrices: FloatArray, vectors: FloatArray, groups: int
) -> tuple[FloatArray, FloatArray, Callable[[FloatArray], FloatArray]]:
    """Return normal equations of the biases in each block, from those of biases and structure.

    The third result is a function that returns the structure (blocks, columns) for given biases.
    """
    bias_matrix = matrices[:, :groups, :groups]
    if matrices.shape[1] == groups:
        return bias_matrix, vectors, lambda biases: np.zeros((len(matrices), 0))
    mixed = matrices[:, :groups, groups:]
    inverse = np.linalg.pinv(matrices[:, groups:, groups:], hermitian=True)
    gain = mixed @ inverse
    matrix = bias_matrix - gain @ mixed.transpose(0, 2, 1)
    vector = vectors[:, :groups] - (gain @ vectors[:, groups:, np.newaxis])[..., 0]

    def solve_structure(biases: FloatArray) -> FloatArray:
        right = vectors[:, groups:] - np.einsum("bgi,g->bi", mixed, biases)
        return np.asarray((inverse @ right[..., np.newaxis])[..., 0])

    return matrix, vector, solve_structure


def _solve(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the solution of normal equations; raises ReceiverBiasError if they are singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, vector))
    except np.linalg.LinAlgError:
        raise ReceiverBiasError(
            "receiver bias: the satellites are all at the same elevation, or a group has no pairs"
        ) from None


def _leave_out_blocks(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the solutions that each leave out one block, by the normal equations of the blocks."""
    matrix_sum, vector_sum = matrices.sum(axis=0), vectors.sum(axis=0)
    return np.array(
        [
            np.linalg.lstsq(matrix_sum - matrix, vector_sum - vector)[0]
            for matrix, vector in zip(matrices, vectors, strict=True)
        ]
    )


def jackknife_sigma(left_out: FloatArray) -> FloatArray:
    """Return the sigmas of results (k, m) of all blocks but one, shape (m,); infinite for one."""
    count = len(left_out)
    if count < 2:
        return np.full(left_out.shape[1], np.inf)
    deviation = left_out - left_out.mean(axis=0)
    return np.asarray(np.sqrt((count - 1) / count * (deviation**2).sum(axis=0)))

"""Receiver biases from slant contents alone, with a sigma that contains the spread of the model.

With the bias b of the receiver (TECU, in the slant content) and the mapping factors M, two
satellites of one epoch tell b as far as the ionosphere is the same above both:

    S_i / M_i - S_j / M_j = b_i / M_i - b_j / M_j + (V_i - V_j).

The last term is the noise of the method. Its variance is a structure function, (g V s)^2: a
relative gradient g times the vertical content V times the separation s of the pierce points. So
pairs that are near to each other count more, and so do the hours before dawn, when little is there
that could differ. g follows from the residuals themselves. Pairs that do not fit are given less
weight (Huber). Several kinds of signal pairs (GPS L1/L2, Galileo E1/E5a) have a bias each and share
the ionosphere, which steadies all of them. The vertical content must not be negative, which bounds
b from above.

Neither the height of the layer nor the lowest useful elevation is known well, and gradients may or
may not be estimated along. The solution is repeated for the heights, elevations and bases that are
in use; its value is the mean. Its sigma contains the scatter of these solutions, the scatter that a
jackknife over blocks of time finds (residuals of neighbouring epochs are not independent, so that a
formal sigma would be far too small), and the errors of the levels, each of which shifts an arc.

An eccentric orbit measures a density profile, which takes the place of shells and pairs if it makes
that sigma smaller, see `vtff_iono.profile_bias`.

References
----------
Gaposchkin and Coster (1993), GPS L1-L2 bias determination, MIT Lincoln Laboratory TR-971 (pairwise
least squares); Vierinen et al. (2016), Atmos. Meas. Tech. 9, 1303 (weights by separation);
Rideout and Coster (2006), GPS Solutions 10, 219 (zero-TEC condition).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.mapping import (
    LOWEST_ORBIT,
    foelsche_kirchengast_mapping,
    pierce_point,
    shell_height,
    thin_shell_mapping,
)
from vtff_iono.profile_bias import ProfileBiases, profile_biases

__all__ = ["ReceiverBias", "content_sigma", "estimate_receiver_biases"]

IntArray = npt.NDArray[np.intp]

_GROUND_SHELLS = (350e3, 400e3, 450e3, 500e3)
"""m; from the shell of the Klobuchar model to that of the maps of CODE (506.7 km)."""
_ORBIT_SHELL_FACTORS = (0.8, 0.93, 1.07, 1.25)
_ELEVATIONS_DEG = (20.0, 25.0, 30.0)
# Interval of the epochs that are used, and of blocks: gradients, jackknife. s.
_GROUND_INTERVALS = (900.0, 3600.0)
_ORBIT_INTERVALS = (20.0, 1200.0)
_SHORTEST_INTERVAL = 20.0
_SMALLEST_CONTENT = 1.0
_HUBER = 2.0
_ITERATIONS = 15
_CONVERGED = 0.01
_FEWEST_PAIRS = 50
# The relative gradient per metre that the iteration starts from, its limits, and the error of a
# vertical content that does not depend on distance, TECU.
_START_GRADIENT = 3e-7
_GRADIENT_LIMITS = (1e-9, 1e-5)
_NOISE = 0.3
_MEDIAN_CHI_SQUARE = 0.4549
"""Median of the square of a standard normal number."""
# Smallest range of altitudes that tells a profile, m.
_SMALLEST_ALTITUDE_RANGE = 100e3
# Decimals of the results, TECU: those beyond depend on the number of threads of linear algebra, and
# a recording shall give the bytes that were published.
_DIGITS = 3
# One in this many contents may be below zero for another reason than the bias.
_NEGATIVE_PART = 0.01


@dataclass(frozen=True)
class ReceiverBias:
    """An estimated receiver bias.

    Parameters
    ----------
    bias_tecu, sigma_tecu : float
        What the receiver adds to every slant content, and one sigma: sampling and spread, TECU.
    sampling_sigma_tecu, spread_tecu : float
        Jackknife and levels, or posterior density with a profile, of the median model; standard
        deviation over the models.
    model_tecu : tuple of float
        Solutions of all models.
    is_bounded : bool
        The condition of a content that is not negative was active.
    pairs : int
        Number of pairs of samples that the largest solution used.
    satellite_sigma_tecu : float
        Sigma of the satellite biases, as the samples show it; NaN if they do not.
    """

    bias_tecu: float
    sigma_tecu: float
    sampling_sigma_tecu: float
    spread_tecu: float
    model_tecu: tuple[float, ...]
    is_bounded: bool
    pairs: int
    satellite_sigma_tecu: float = math.nan

    def code_bias(self, tecu_per_metre: float) -> tuple[float, float]:
        """Return the differential code bias first - second and its sigma, s.

        Parameters
        ----------
        tecu_per_metre : float
            Of the pair of signals, see `vtff_iono.geometry_free.tecu_per_metre`.
        """
        scale = 1.0 / (tecu_per_metre * SPEED_OF_LIGHT)
        return -self.bias_tecu * scale, self.sigma_tecu * scale


def content_sigma(
    stec_sigma_tecu: FloatArray,
    satellite_sigma_tecu: FloatArray,
    biases: Sequence[ReceiverBias | None],
    number: npt.NDArray[np.integer],
) -> FloatArray:
    """Return the sigmas of contents whose receiver bias has been removed, TECU, shape (n,).

    Parameters
    ----------
    stec_sigma_tecu, satellite_sigma_tecu : ndarray, shape (n,)
        Of contents that contain the bias of the receiver, and the part that is stated of the
        satellites. Where the samples of the bias show how large that is, it is replaced.
    biases : sequence of ReceiverBias or None
        None adds nothing.
    number : ndarray of int, shape (n,)
        Which of `biases` each content has; -1 for none.
    """
    table = [
        (0.0, math.nan) if b is None else (b.sigma_tecu, b.satellite_sigma_tecu) for b in biases
    ]
    receiver, shown = np.array([*table, (0.0, math.nan)])[number].T
    stated = np.where(np.isnan(shown), 0.0, np.nan_to_num(satellite_sigma_tecu))
    without = np.maximum(stec_sigma_tecu**2 - stated**2, 0.0)
    return np.asarray(np.sqrt(without + np.nan_to_num(shown) ** 2 + receiver**2))


def estimate_receiver_biases(samples: BiasSamples) -> list[ReceiverBias]:
    """Return the biases of all groups that make the vertical contents of an epoch agree.

    Parameters
    ----------
    samples : BiasSamples
        A day on the ground, or some revolutions in orbit.

    Raises
    ------
    ReceiverBiasError
        If there are fewer than 50 pairs of satellites above the highest limit of elevation.
    """
    altitude = geodetic_from_itrf(samples.position_receiver_itrf)[..., 2]
    is_ground = bool(np.median(altitude) < LOWEST_ORBIT)
    interval, block = _GROUND_INTERVALS if is_ground else _ORBIT_INTERVALS
    duration = float(np.ptp(samples.time)) if len(samples.time) else 0.0
    # Short data: more of the epochs, and six blocks, so that a jackknife can leave some out.
    interval = min(interval, max(_SHORTEST_INTERVAL, duration / 40.0))
    block = min(block, max(interval, duration / 6.0))
    usable = np.isfinite(samples.stec_tecu) & np.isfinite(samples.stec_sigma_tecu)
    all_elevations = samples.part(usable & _first_of_interval(samples.time, usable, interval))
    usable &= samples.elevation >= math.radians(min(_ELEVATIONS_DEG))
    chosen = usable & _first_of_interval(samples.time, usable, interval)
    samples, altitude = samples.part(chosen), altitude[chosen]
    order = np.argsort(samples.time, kind="stable")
    samples, altitude = samples.part(order), altitude[order]
    first, second = _pairs(samples.time)
    models = _models(samples, altitude, is_ground)
    solutions, sigmas = _solutions(samples, models, first, second, block)
    better = None if is_ground else _better(all_elevations, solutions, sigmas)
    if better is None:
        return _combined(samples, solutions, sigmas, len(first))
    biases = _combined(samples, better.bias_tecu, better.sigma_tecu, len(first))
    shown = round(better.satellite_sigma_tecu, _DIGITS)
    return [replace(bias, satellite_sigma_tecu=shown) for bias in biases]


def _solutions(
    samples: BiasSamples,
    models: list[tuple[FloatArray, FloatArray]],
    first: IntArray,
    second: IntArray,
    block: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the biases and jackknife sigmas of all models, (models, groups)."""
    solutions, sigmas = [], []
    for mapping, pierce_altitude in models:
        equations = _Equations(samples, mapping, pierce_altitude, first, second, block)
        for elevation_deg in _ELEVATIONS_DEG:
            part = equations.above(math.radians(elevation_deg))
            if len(part.difference) < _FEWEST_PAIRS or part.block[0] == part.block[-1]:
                raise ReceiverBiasError(
                    f"receiver bias: only {len(part.difference)} pairs of satellites above "
                    f"{elevation_deg:g} deg, {_FEWEST_PAIRS} are needed at two times at least"
                )
            for with_gradients in (False, True):
                biases, sigma = _solve(part, with_gradients)
                solutions.append(biases)
                sigmas.append(sigma)
    return np.array(solutions), np.array(sigmas)


def _better(
    samples: BiasSamples, solutions: FloatArray, sigmas: FloatArray
) -> ProfileBiases | None:
    """Return solutions with a density profile if they have smaller sigmas than those with shells.

    None also if the altitude changes too little to tell a profile.
    """
    altitude = geodetic_from_itrf(samples.position_receiver_itrf)[..., 2]
    if samples.arc is None or np.ptp(altitude) < _SMALLEST_ALTITUDE_RANGE:
        return None
    found = profile_biases(samples, altitude)
    sigma = _sigma(found.bias_tecu, found.sigma_tecu)
    if sigma.sum() >= _sigma(solutions, sigmas).sum():
        return None
    return found


def _sigma(solutions: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Return sampling and spread together, (groups,), of the solutions of models."""
    spread = np.std(solutions, axis=0, ddof=1)
    return np.asarray(np.hypot(np.median(sigmas, axis=0), spread))


def _combined(
    samples: BiasSamples, solutions: FloatArray, sigmas: FloatArray, pairs: int
) -> list[ReceiverBias]:
    """Return the biases from the solutions of all models, shape (models, groups)."""
    results = []
    for group in range(solutions.shape[1]):
        values = solutions[:, group]
        own = samples.group == group
        largest = np.quantile(samples.stec_tecu[own] + samples.stec_sigma_tecu[own], _NEGATIVE_PART)
        mean = float(np.mean(values))
        bias = min(mean, float(largest))
        sampling = float(np.median(sigmas[:, group]))
        spread = float(np.std(values, ddof=1))
        results.append(
            ReceiverBias(
                bias_tecu=round(bias, _DIGITS),
                sigma_tecu=round(math.hypot(sampling, spread), _DIGITS),
                sampling_sigma_tecu=sampling,
                spread_tecu=spread,
                model_tecu=tuple(values.tolist()),
                is_bounded=bias < mean,
                pairs=pairs,
            )
        )
    return results


def _first_of_interval(
    time: FloatArray, usable: npt.NDArray[np.bool_], interval: float
) -> npt.NDArray[np.bool_]:
    """Return which samples are of the first usable epoch of each interval."""
    keys, inverse = np.unique(np.floor(time / interval), return_inverse=True)
    earliest = np.full(len(keys), np.inf)
    np.minimum.at(earliest, inverse[usable], time[usable])
    return np.asarray(time == earliest[inverse])


def _pairs(time: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the indices of all pairs of samples of equal time; `time` does not decrease."""
    edges = np.append(np.flatnonzero(np.diff(time, prepend=-np.inf)), len(time))
    firsts, seconds = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)]
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        i, j = np.triu_indices(end - start, 1)
        firsts.append(start + i)
        seconds.append(start + j)
    return np.concatenate(firsts), np.concatenate(seconds)


def _models(
    samples: BiasSamples, altitude: FloatArray, is_ground: bool
) -> list[tuple[FloatArray, FloatArray]]:
    """Return mapping factors and altitudes of the pierce points for each shell height."""
    radius = np.linalg.norm(samples.position_receiver_itrf, axis=-1)
    elevation = samples.elevation
    if is_ground:
        return [
            (thin_shell_mapping(elevation, radius, h - altitude), np.full(len(radius), h))
            for h in _GROUND_SHELLS
        ]
    # The electrons above an orbit are a slab of about the shell height: its middle is at half.
    heights = [factor * shell_height(altitude) for factor in _ORBIT_SHELL_FACTORS]
    return [
        (foelsche_kirchengast_mapping(elevation, radius, h), altitude + 0.5 * h) for h in heights
    ]


class _Equations:
    """The equations of all pairs for one mapping, ordered by blocks of time."""

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
        self.gradients = _gradient_columns(point, first, second)
        self.block = np.floor(samples.time[first] / block).astype(np.int64)

    def above(self, elevation: float) -> _Equations:
        """Return the equations of which both satellites are above an elevation, rad."""
        chosen = self.elevation >= elevation
        part = object.__new__(_Equations)
        for name, value in vars(self).items():
            setattr(part, name, value[chosen])
        return part

    def level_sigma(self, weight: FloatArray, matrix: FloatArray) -> FloatArray:
        """Return what the errors of the levels make of the biases, TECU, shape (groups,).

        `weight` (n,) is that of the equations, `matrix` their normal matrix.
        """
        arcs = self.level_shift[:, :2].astype(np.int64)
        if arcs.size == 0 or arcs.max() < 0:
            return np.zeros(len(matrix))
        influence = self.design * weight[:, np.newaxis]
        shift = np.zeros((arcs.max() + 1, len(matrix)))
        for side in (0, 1):
            moved = influence * self.level_shift[:, 2 + side, np.newaxis]
            np.add.at(shift, arcs[:, side], moved if side == 0 else -moved)
        return np.asarray(np.sqrt(((np.linalg.pinv(matrix) @ shift.T) ** 2).sum(axis=1)))


def _level_shifts(
    samples: BiasSamples, inverse: FloatArray, first: IntArray, second: IntArray
) -> FloatArray:
    """Return arcs of both samples and what one sigma of their levels does to them, (n, 4).

    The arcs are -1 if they are not known.
    """
    number = np.full(len(inverse), -1)
    if samples.arc is not None:
        number = np.unique(samples.arc, return_inverse=True)[1]
    moved = samples.stec_sigma_tecu * inverse
    return np.stack((number[first], number[second], moved[first], moved[second]), axis=-1)


def _gradient_columns(point: FloatArray, first: IntArray, second: IntArray) -> FloatArray:
    """Return the separation of pierce points to the east and to the north, 1000 km, (n, 2)."""
    geodetic = geodetic_from_itrf(point)
    radius = np.linalg.norm(point, axis=-1)[first] * 1e-6
    latitude, longitude = geodetic[..., 0], geodetic[..., 1]
    east = np.angle(np.exp(1j * (longitude[first] - longitude[second])))
    east = east * np.cos(0.5 * (latitude[first] + latitude[second]))
    return np.stack((radius * east, radius * (latitude[first] - latitude[second])), axis=-1)


def _solve(equations: _Equations, with_gradients: bool) -> tuple[FloatArray, FloatArray]:
    """Return the biases of one model and their jackknife sigmas, TECU."""
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
        if with_gradients:
            # Relative to the content, as the structure function is.
            design = np.hstack((design, equations.gradients * content[:, np.newaxis]))
        weighted = design * (huber / variance)[:, np.newaxis]
        matrices = np.add.reduceat(weighted[:, :, np.newaxis] * design[:, np.newaxis, :], starts)
        vectors = np.add.reduceat(weighted * equations.difference[:, np.newaxis], starts)
        matrix, vector, local = _without_gradients(matrices, vectors, groups)
        previous, biases = biases, _solution(matrix.sum(axis=0), vector.sum(axis=0))
        residual = equations.difference - equations.design @ biases
        if with_gradients:
            slopes = np.repeat(local(biases), lengths, axis=0)
            residual -= (design[:, groups:] * slopes).sum(axis=1)
        normed = residual**2 / variance
        huber = np.minimum(1.0, _HUBER / np.sqrt(np.maximum(normed, 1e-12)))
        # The gradient for which the residuals are as large as their variance says, robustly.
        gradient *= math.sqrt(float(np.median(normed)) / _MEDIAN_CHI_SQUARE)
        gradient = min(max(gradient, _GRADIENT_LIMITS[0]), _GRADIENT_LIMITS[1])
        if np.abs(biases - previous).max() < _CONVERGED:
            break
    matrix, vector, _ = _without_gradients(matrices, vectors, groups)
    level = equations.level_sigma(huber / variance, matrices[:, :groups, :groups].sum(axis=0))
    return biases, np.hypot(_jackknife(matrix, vector), level)


def _without_gradients(matrices: FloatArray, vectors: FloatArray, groups: int):  # type: ignore[no-untyped-def]
    """Eliminate the gradients of each block; return its equations of the biases.

    The third result is a function that gives the gradients (blocks, 2) for given biases.
    """
    own, both, inner = matrices[:, :groups, :groups], matrices[:, :groups, groups:], None
    if matrices.shape[1] == groups:
        return own, vectors, lambda biases: np.zeros((len(matrices), 0))
    inner = np.linalg.pinv(matrices[:, groups:, groups:], hermitian=True)
    carried = both @ inner
    matrix = own - carried @ both.transpose(0, 2, 1)
    vector = vectors[:, :groups] - (carried @ vectors[:, groups:, np.newaxis])[..., 0]

    def local(biases: FloatArray) -> FloatArray:
        right = vectors[:, groups:] - np.einsum("bgi,g->bi", both, biases)
        return np.asarray((inner @ right[..., np.newaxis])[..., 0])

    return matrix, vector, local


def _solution(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.solve(matrix, vector))
    except np.linalg.LinAlgError:
        raise ReceiverBiasError(
            "receiver bias: the satellites are all at the same elevation, or a group has no pairs"
        ) from None


def _jackknife(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the sigmas of the solution, from leaving out one block after the other."""
    count = len(matrices)
    if count < 2:
        return np.full(vectors.shape[1], np.inf)
    matrix, vector = matrices.sum(axis=0), vectors.sum(axis=0)
    left_out = np.array(
        [
            np.linalg.lstsq(matrix - one, vector - other)[0]
            for one, other in zip(matrices, vectors, strict=True)
        ]
    )
    deviation = left_out - left_out.mean(axis=0)
    return np.asarray(np.sqrt((count - 1) / count * (deviation**2).sum(axis=0)))

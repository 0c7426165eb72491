"""Receiver biases of an eccentric orbit, together with the density profile that it flies through.

A receiver that climbs and falls observes the electrons above its own altitude. With the densities
n of shells of altitude, the path lengths P of rays through the shells, and the bias b, a content is

    S = b + P n + error of the level of the arc + error of the satellite bias + noise.

The change of S along arcs, good to the phase noise, determines n, and n determines the errors of
the levels: no shell height is assumed. The unknowns are the logarithms of n, so that no density is
negative; smoothness and the decrease far above the orbit are their prior
(`vtff_iono.bias.altitude_shells`). The errors of the levels are random effects with the sigmas of
the levels. The errors of the satellite biases are random effects with a common sigma, which is
estimated from the samples: the stated sigmas do not show how large these errors are (the navigation
message does not contain C1C - C1W).

The ionosphere also changes along the orbit and across it. To first order the content of a ray is
then larger by M (a(t) + g(t) d) + S c, where M is its slant over vertical content, S its content,
and d the vector from the receiver to the pierce point to the east and north. The vertical content a
and its gradient g are linear between knots; c is by what part the ionosphere that one arc passes
differs from that of the others. All are random effects as well, and their sigmas are estimated from
the samples. Without c the noise of a thousand samples would seem to tell the level of an arc to
0.02 TECU, while the shape of the ionosphere is not known as well as that. The noise is taken to be
correlated as the residuals of arcs are.

The offset of an arc is what its samples are larger by than its contents: the bias of the receiver,
and the errors of its level and of the satellite bias. The contents of an eccentric orbit tell it
better than the codes do, whose multipath hardly averages out over an arc and whose line biases
drift.

The solution is the maximum of the posterior density, reached by damped Gauss-Newton steps; its
covariance is the inverse of the curvature there. It is repeated for different decreases of the
topside.

References
----------
Dempster, Laird and Rubin (1977), J. R. Stat. Soc. B 39, 1 (variances of random effects).
Huber (1964), Ann. Math. Stat. 35, 73 (weights of outliers).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.altitude_shells import (
    TopsideModel,
    log_density_prior,
    shell_edges,
    shell_middles,
    shell_paths,
    vertical_paths,
)
from vtff_iono.bias.bias_samples import DECIMALS_TECU, BiasSamples
from vtff_iono.bias.expected_contents import (
    GRADIENT_UNIT,
    ExpectedContents,
    Knots,
    pierce_offsets,
)
from vtff_iono.bias.profile_solver import NormalEquations, ProfileSolution, solve_profile

__all__ = ["ProfileBiases", "profile_biases"]

IntArray = npt.NDArray[np.integer]

_TOPSIDES = (TopsideModel(), TopsideModel(exponent=3.0), TopsideModel(exponent=6.0))
# Largest number of epochs that are used, of evenly thinned samples.
_MOST_EPOCHS = 540
# Prior sigma of a receiver bias, TECU: nothing is known about it.
_GROUP_SIGMA = 1000.0
# Sigma of the satellite biases at first, TECU: 0.5 ns, the error of navigation messages.
_SATELLITE_SIGMA = 1.43
# Smallest sigma of a level, TECU.
_LEVEL_SIGMA_LEAST = 0.01
# Sigma of the noise at first, and its smallest value, TECU.
_NOISE_START, _NOISE_LEAST = 0.05, 0.01
# Sigmas at first of the vertical content (TECU) and its gradients (TECU per 1000 km), and of what
# is particular to an arc (relative to the content); and the value that switches them off.
_VERTICAL_SIGMA = 0.5
_ARC_SIGMA = 0.02
_NO_GRADIENT = 1e-6
# Residuals beyond this many sigmas are given less weight (Huber).
_HUBER = 3.0
_SMALLEST_RESIDUAL = 1e-12
# Ratio of standard deviation and median absolute value of a normal distribution.
_MEDIAN_TO_SIGMA = 1.4826
# Largest correlation of neighbouring residuals that is believed.
_LARGEST_CORRELATION = 0.95
# Largest numbers of iterations, and the relative changes of noise and sigmas that end them.
_NORMAL_ITERATIONS, _SIGMA_ITERATIONS = 8, 8
_NOISE_CONVERGED, _SIGMA_CONVERGED = 0.03, 0.1
# Densities that the search begins with, 1/m3, against altitude, m.
_START_ALTITUDE = np.array([100e3, 400e3, 700e3, 1000e3, 20e6])
_START_DENSITY = np.array([1e11, 5e11, 1e11, 3e10, 1e8])


@dataclass(frozen=True, eq=False)
class ProfileBiases:
    """Biases of all groups, for each model of the topside, and the profile.

    Parameters
    ----------
    bias_tecu, sigma_tecu : ndarray, shape (models, groups)
        Biases and their sigmas, TECU.
    altitude, density : ndarray, shape (shells,)
        Altitudes of the middles of the shells, m, and their densities in the first model,
        electrons per cubic metre.
    noise_tecu, satellite_sigma_tecu : float
        Estimated sigmas of single contents and of the satellite biases, TECU; the sigma of the
        satellite biases is NaN without links.
    vertical_sigma_tecu : float
        Sigma of the vertical content that is not of the profile, TECU.
    gradient_sigma : ndarray, shape (2,)
        Root of the expected squares of the gradients of the vertical content to the east and to the
        north, TECU/m.
    arc : ndarray of int, shape (arcs,)
        Numbers of the arcs of the samples that were used.
    offset_tecu, offset_sigma_tecu : ndarray, shape (arcs,)
        What the samples of an arc are larger by than its contents, mean of the models, and its
        sigma, which contains their spread, TECU.
    contents : ExpectedContents
        Contents of rays of other arcs.
    """

    bias_tecu: FloatArray
    sigma_tecu: FloatArray
    altitude: FloatArray
    density: FloatArray
    noise_tecu: float
    satellite_sigma_tecu: float
    vertical_sigma_tecu: float
    gradient_sigma: FloatArray
    arc: IntArray
    offset_tecu: FloatArray
    offset_sigma_tecu: FloatArray
    contents: ExpectedContents


def profile_biases(samples: BiasSamples, altitude: FloatArray) -> ProfileBiases:
    """Return the most probable receiver biases together with one density profile.

    Parameters
    ----------
    samples : BiasSamples
        Contents; they must have arcs.
    altitude : ndarray, shape (n,)
        Altitudes of the receiver, m.

    Raises
    ------
    ValueError
        If the samples have no arcs.
    """
    epoch = np.unique(samples.time, return_inverse=True)[1]
    is_used = epoch % (1 + epoch.max() // _MOST_EPOCHS) == 0
    problem = _Problem(samples.select(is_used), altitude[is_used])
    log_density, sigmas = problem.start()
    noise, weight = _NOISE_START, np.ones(int(is_used.sum()))
    # The first solution has no gradients, as their columns need a profile.
    normal = problem.normal(problem.effect_columns(log_density), weight / noise**2)
    level = replace(sigmas, vertical=_NO_GRADIENT, gradient=_NO_GRADIENT, arc=_NO_GRADIENT)
    solution = problem.solve(normal, _TOPSIDES[0], level, log_density)
    for _ in range(_NORMAL_ITERATIONS):
        columns = problem.effect_columns(solution.log_density)
        residual = problem.residual(solution, columns)
        previous, noise = noise, _scatter(residual)
        weight = np.minimum(1.0, _HUBER * noise / np.maximum(np.abs(residual), _SMALLEST_RESIDUAL))
        variance = noise**2 * problem.inflation(weight * residual)
        normal = problem.normal(columns, weight / variance)
        solution, sigmas = _estimate_sigmas(problem, normal, solution, sigmas)
        if abs(noise / previous - 1.0) < _NOISE_CONVERGED:
            break
    models = []
    for topside in _TOPSIDES:
        solution = problem.solve(normal, topside, sigmas, solution.log_density)
        models.append(solution)
    of_models = np.array([problem.offsets(model) for model in models])
    offsets, offset_variances = of_models[:, 0], of_models[:, 1]
    # The departures of contents from a profile are not independent of each other: their scatter
    # does not average out. Single contents of the arc scatter as much, too.
    variance = np.median(offset_variances, axis=0) + np.var(offsets, axis=0, ddof=1)
    residual = problem.residual(solution, problem.effect_columns(solution.log_density))
    variance += np.maximum(noise**2, problem.squares_of_arcs(residual))
    contents = ExpectedContents(
        problem.edges,
        np.exp(models[0].log_density),
        problem.knots,
        models[0].effects[: problem.gradients.stop],
        sigmas.arc,
    ).continued_below()
    return ProfileBiases(
        bias_tecu=np.array([model.effects[problem.groups] for model in models]),
        sigma_tecu=np.sqrt([model.effect_variance[problem.groups] for model in models]),
        altitude=shell_middles(problem.edges),
        density=np.exp(models[0].log_density),
        noise_tecu=noise,
        satellite_sigma_tecu=math.nan if samples.link is None else sigmas.satellite,
        vertical_sigma_tecu=round(sigmas.vertical, DECIMALS_TECU),
        gradient_sigma=problem.gradient_sigma(solution),
        arc=problem.arc_numbers,
        offset_tecu=np.asarray(offsets.mean(axis=0)).round(DECIMALS_TECU),
        offset_sigma_tecu=np.round(np.sqrt(variance), DECIMALS_TECU),
        contents=contents,
    )


@dataclass(frozen=True)
class _Sigmas:
    """Sigmas of random effects.

    Parameters
    ----------
    satellite : float
        Sigma of the satellite biases, TECU.
    vertical, gradient : float
        Sigmas of the vertical content, TECU, and of its gradients, TECU per 1000 km.
    arc : float
        Sigma of what is particular to an arc, relative to the content.
    level_factor : float
        Sigmas of the levels over those that are stated, 1 at least: codes that err alike for longer
        than was assumed, as by multipath, state too little.
    """

    satellite: float
    vertical: float
    gradient: float
    arc: float
    level_factor: float


class _EffectColumns(NamedTuple):
    """Columns of the effects in the equations of n samples.

    Attributes
    ----------
    knots : ndarray, shape (n, 3 knots)
        Columns of the vertical contents and their gradients at the knots.
    single : csr_matrix
        Columns of all other effects.
    """

    knots: FloatArray
    single: sparse.csr_matrix


class _Problem:
    """Samples, and the columns of the unknowns: shells, then effects.

    The effects are, in this order: vertical content, its gradients to the east and to the north at
    the knots; what is particular to each arc; biases of the groups; errors of the levels of arcs;
    errors of the satellite biases of the links.
    """

    def __init__(self, samples: BiasSamples, altitude: FloatArray) -> None:
        if samples.arc is None:
            raise ValueError("samples: arcs are required")
        self.stec = samples.stec_tecu
        self.edges = shell_edges(float(altitude.min()), float(altitude.max()))
        self._altitude_high = float(altitude.max())
        self._priors: dict[TopsideModel, tuple[FloatArray, FloatArray]] = {}
        self._paths = shell_paths(
            samples.position_receiver_itrf, samples.direction_itrf, altitude, self.edges
        )
        self._vertical_paths = vertical_paths(altitude, self.edges)
        self.knots = Knots.over(samples.time)
        self._knot_weights = self.knots.weights(samples.time)
        self._pierce_offset = pierce_offsets(
            samples.position_receiver_itrf, samples.direction_itrf, altitude
        )
        self.arc_numbers, first_of_arc, arc = np.unique(
            samples.arc, return_index=True, return_inverse=True
        )
        stated = np.zeros(len(self.stec))
        if samples.satellite_sigma_tecu is not None:
            stated = samples.satellite_sigma_tecu
        self._largest_satellite_sigma = max(_SATELLITE_SIGMA, float(np.median(stated)))
        self._level_variance = np.zeros(len(self.arc_numbers))
        self._level_variance[arc] = np.maximum(
            samples.stec_sigma_tecu**2 - stated**2, _LEVEL_SIGMA_LEAST**2
        )
        numbers: list[IntArray] = [arc, samples.group, arc]
        if samples.link is not None:
            numbers.append(np.unique(samples.link, return_inverse=True)[1])
        # Ends of the columns of each kind of effect.
        counts = [3 * self.knots.number, *(int(number.max()) + 1 for number in numbers)]
        ends = np.cumsum(counts).tolist()
        self.verticals = slice(0, self.knots.number)
        self.gradients = slice(self.knots.number, ends[0])
        self.arcs, self.groups, self.levels = (slice(*ends[k : k + 2]) for k in range(3))
        self.links = slice(ends[3], ends[-1])
        # Columns with one element in each row, which follow those of the knots.
        self._column = np.stack(numbers, axis=-1) + np.array([0, *ends[1:-1]])
        self._column[:, 1:] -= ends[0]
        self._columns = ends[-1] - ends[0]
        self._column_of_arc = self._column[first_of_arc, 1:] + ends[0]
        self._arc = arc
        # Indices of the samples that follow each other in an arc.
        order = np.lexsort((samples.time, arc))
        is_same_arc = np.diff(arc[order]) == 0
        self._neighbours = order[:-1][is_same_arc], order[1:][is_same_arc]

    def start(self) -> tuple[FloatArray, _Sigmas]:
        """Return the logarithms of densities and the sigmas that the search begins with."""
        log_altitude = np.log(shell_middles(self.edges))
        log_density = np.interp(log_altitude, np.log(_START_ALTITUDE), np.log(_START_DENSITY))
        return log_density, _Sigmas(
            self._largest_satellite_sigma, _VERTICAL_SIGMA, _VERTICAL_SIGMA, _ARC_SIGMA, 1.0
        )

    def solve(
        self,
        normal: NormalEquations,
        topside: TopsideModel,
        sigmas: _Sigmas,
        log_density: FloatArray,
    ) -> ProfileSolution:
        """Return the solution of normal equations for a topside and sigmas of the effects."""
        if topside not in self._priors:
            self._priors[topside] = log_density_prior(self.edges, self._altitude_high, topside)
        prior = self._priors[topside]
        return solve_profile(normal, *prior, self._precision(sigmas), log_density)

    def _precision(self, sigmas: _Sigmas) -> FloatArray:
        """Return one over the variances of the effects."""
        precision = np.full(self.links.stop, 1.0 / _GROUP_SIGMA**2)
        precision[self.verticals] = 1.0 / sigmas.vertical**2
        precision[self.gradients] = 1.0 / sigmas.gradient**2
        precision[self.arcs] = 1.0 / sigmas.arc**2
        precision[self.levels] = 1.0 / (sigmas.level_factor**2 * self._level_variance)
        precision[self.links] = 1.0 / sigmas.satellite**2
        return precision

    def sigmas(self, second_moment: FloatArray, sigmas: _Sigmas) -> _Sigmas:
        """Return the sigmas that expected squares of the effects imply."""
        satellite = sigmas.satellite
        if self.links.stop > self.links.start:
            satellite = math.sqrt(float(second_moment[self.links].mean()))
        level = float(np.mean(second_moment[self.levels] / self._level_variance))
        vertical, gradient, arc = (
            math.sqrt(float(second_moment[of_kind].mean()))
            for of_kind in (self.verticals, self.gradients, self.arcs)
        )
        return _Sigmas(
            min(satellite, self._largest_satellite_sigma),
            vertical,
            gradient,
            arc,
            max(1.0, math.sqrt(level)),
        )

    def effect_columns(self, log_density: FloatArray) -> _EffectColumns:
        """Return the columns of effects for the contents of logarithms of densities."""
        content = self._paths @ np.exp(log_density)
        mapping = content / (self._vertical_paths @ np.exp(log_density))
        level = mapping[:, np.newaxis] * self._knot_weights
        east, north = self._pierce_offset[:, :1], self._pierce_offset[:, 1:]
        values = np.ones(self._column.shape)
        values[:, 0] = content
        ends = np.arange(0, values.size + 1, values.shape[1])
        single = sparse.csr_matrix(
            (values.ravel(), self._column.ravel(), ends), shape=(len(content), self._columns)
        )
        return _EffectColumns(np.hstack((level, level * east, level * north)), single)

    def normal(self, columns: _EffectColumns, weight: FloatArray) -> NormalEquations:
        """Return the normal equations of weighted samples; `weight` has shape (n,)."""
        gradients, single = columns
        weighted_paths = self._paths * weight[:, np.newaxis]
        weighted_gradients = gradients * weight[:, np.newaxis]
        weighted_single = single.multiply(weight[:, np.newaxis]).tocsr()
        mixed = weighted_single.T @ gradients
        return NormalEquations(
            density=weighted_paths.T @ self._paths,
            effects=np.block(
                [
                    [weighted_gradients.T @ gradients, mixed.T],
                    [mixed, (weighted_single.T @ single).toarray()],
                ]
            ),
            mixed=np.vstack((gradients.T @ weighted_paths, single.T @ weighted_paths)),
            density_vector=weighted_paths.T @ self.stec,
            effects_vector=np.concatenate(
                (weighted_gradients.T @ self.stec, weighted_single.T @ self.stec)
            ),
        )

    def residual(self, solution: ProfileSolution, columns: _EffectColumns) -> FloatArray:
        """Return observed minus explained contents, TECU; the columns are of its densities."""
        gradients, single = columns
        explained = self._paths @ np.exp(solution.log_density)
        explained += gradients @ solution.effects[: self.gradients.stop]
        return np.asarray(self.stec - explained - single @ solution.effects[self.arcs.start :])

    def offsets(self, solution: ProfileSolution) -> tuple[FloatArray, FloatArray]:
        """Return the offsets of the arcs, TECU, and their variances, shape (arcs,)."""
        columns = np.zeros((len(self.arc_numbers), self.links.stop))
        np.put_along_axis(columns, self._column_of_arc, 1.0, axis=1)
        no_density = np.zeros((len(columns), len(solution.log_density)))
        return columns @ solution.effects, solution.variance(no_density, columns)

    def gradient_sigma(self, solution: ProfileSolution) -> FloatArray:
        """Return the roots of the expected squares of gradients to east and north, TECU/m, (2,)."""
        squares = solution.effects**2 + solution.effect_variance
        of_direction = squares[self.gradients].reshape(2, self.knots.number)
        return np.asarray(np.sqrt(of_direction.mean(axis=1)).round(DECIMALS_TECU) / GRADIENT_UNIT)

    def squares_of_arcs(self, residual: FloatArray) -> FloatArray:
        """Return the mean squares of residuals of each arc, shape (arcs,)."""
        return np.bincount(self._arc, residual**2) / np.bincount(self._arc)

    def inflation(self, residual: FloatArray) -> float:
        """Return the factor by which correlation increases the variance of weighted residuals.

        The residuals of an arc are taken as a first-order Markov process.
        """
        before, after = self._neighbours
        total = float(residual @ residual)
        correlation = float(residual[before] @ residual[after]) / total if total > 0.0 else 0.0
        correlation = min(max(correlation, 0.0), _LARGEST_CORRELATION)
        return (1.0 + correlation) / (1.0 - correlation)


def _scatter(residual: FloatArray) -> float:
    """Return the standard deviation of residuals from their median, which outliers do not move."""
    return max(_NOISE_LEAST, _MEDIAN_TO_SIGMA * float(np.median(np.abs(residual))))


def _estimate_sigmas(
    problem: _Problem,
    normal: NormalEquations,
    solution: ProfileSolution,
    sigmas: _Sigmas,
) -> tuple[ProfileSolution, _Sigmas]:
    """Return the solution and the sigmas of the random effects that agree with it."""
    for _ in range(_SIGMA_ITERATIONS):
        solution = problem.solve(normal, _TOPSIDES[0], sigmas, solution.log_density)
        second_moment = solution.effects**2 + solution.effect_variance
        previous, sigmas = sigmas, problem.sigmas(second_moment, sigmas)
        ratio = np.array(astuple(sigmas)) / np.array(astuple(previous))
        if np.abs(np.log(ratio)).max() < _SIGMA_CONVERGED:
            break
    return solution, sigmas

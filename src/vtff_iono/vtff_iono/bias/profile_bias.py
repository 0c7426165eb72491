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
then larger by the factor 1 + a(t) + g(t) d, where d is the vector from the receiver to the pierce
point to the east and north. The scale a and the gradient g are linear between knots; they are
random effects as well, and their sigmas are estimated from the samples. The noise is taken to be
correlated as the residuals of arcs are.

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
)
from vtff_iono.bias.bias_samples import BiasSamples
from vtff_iono.bias.profile_solver import NormalEquations, ProfileSolution, solve_profile
from vtff_iono.geometry.mapping import pierce_point, shell_height

__all__ = ["ProfileBiases", "knot_weights", "profile_biases"]

IntArray = npt.NDArray[np.integer]

_TOPSIDES = (TopsideModel(), TopsideModel(exponent=3.0), TopsideModel(exponent=6.0))
# Largest number of epochs that are used, of evenly thinned samples.
_MOST_EPOCHS = 540
# Interval of the knots of scale and gradients, s, and their largest number.
_KNOT_INTERVAL = 300.0
_MOST_KNOTS = 36
# Prior sigma of a receiver bias, TECU: nothing is known about it.
_GROUP_SIGMA = 1000.0
# Sigma of the satellite biases at first, TECU: 0.5 ns, the error of navigation messages.
_SATELLITE_SIGMA = 1.43
# Smallest sigma of a level, TECU.
_LEVEL_SIGMA_LEAST = 0.01
# Sigma of the noise at first, and its smallest value, TECU.
_NOISE_START, _NOISE_LEAST = 0.05, 0.01
# Sigmas of the scale (relative to the content) and of the gradients (relative, per 1000 km) at
# first; and the value that switches both off.
_GRADIENT_SIGMA = 0.1
_NO_GRADIENT = 1e-6
# Unit of the distance of pierce points, m.
_GRADIENT_UNIT = 1e6
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
    """

    bias_tecu: FloatArray
    sigma_tecu: FloatArray
    altitude: FloatArray
    density: FloatArray
    noise_tecu: float
    satellite_sigma_tecu: float


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
    solution, sigmas = problem.start()
    noise, weight = _NOISE_START, np.ones(int(is_used.sum()))
    # The first solution has no gradients, as their columns need a profile.
    normal = problem.normal(solution, weight / noise**2)
    level = replace(sigmas, scale=_NO_GRADIENT, gradient=_NO_GRADIENT)
    solution = problem.solve(normal, _TOPSIDES[0], level, solution)
    for _ in range(_NORMAL_ITERATIONS):
        residual = problem.residual(solution)
        previous, noise = noise, _scatter(residual)
        weight = np.minimum(1.0, _HUBER * noise / np.maximum(np.abs(residual), _SMALLEST_RESIDUAL))
        variance = noise**2 * problem.inflation(weight * residual)
        normal = problem.normal(solution, weight / variance)
        solution, sigmas = _estimate_sigmas(problem, normal, solution, sigmas)
        if abs(noise / previous - 1.0) < _NOISE_CONVERGED:
            break
    models = []
    for topside in _TOPSIDES:
        solution = problem.solve(normal, topside, sigmas, solution)
        models.append(solution)
    return ProfileBiases(
        bias_tecu=np.array([model.effects[problem.groups] for model in models]),
        sigma_tecu=np.sqrt([model.effect_variance[problem.groups] for model in models]),
        altitude=shell_middles(problem.edges),
        density=np.exp(models[0].log_density),
        noise_tecu=noise,
        satellite_sigma_tecu=math.nan if samples.link is None else sigmas.satellite,
    )


@dataclass(frozen=True)
class _Sigmas:
    """Sigmas of random effects.

    Parameters
    ----------
    satellite : float
        Sigma of the satellite biases, TECU.
    scale : float
        Sigma of the scale, relative to the content.
    gradient : float
        Sigma of the gradients, relative to the content, per 1000 km.
    """

    satellite: float
    scale: float
    gradient: float


class _Problem:
    """Samples, and the columns of the unknowns: shells, then effects.

    The effects are, in this order: scale, gradients to the east and gradients to the north at the
    knots; biases of the groups; errors of the levels of the arcs; errors of the satellite biases of
    the links.
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
        self._knot_weights = knot_weights(samples.time)
        self._pierce_offset = _pierce_offsets(samples, altitude)
        arc = np.unique(samples.arc, return_inverse=True)[1]
        stated = np.zeros(len(self.stec))
        if samples.satellite_sigma_tecu is not None:
            stated = samples.satellite_sigma_tecu
        self._largest_satellite_sigma = max(_SATELLITE_SIGMA, float(np.median(stated)))
        self._level_variance = np.zeros(arc.max() + 1)
        self._level_variance[arc] = np.maximum(
            samples.stec_sigma_tecu**2 - stated**2, _LEVEL_SIGMA_LEAST**2
        )
        numbers: list[IntArray] = [samples.group, arc]
        if samples.link is not None:
            numbers.append(np.unique(samples.link, return_inverse=True)[1])
        self._indicators = _indicator_columns(numbers)
        knots = self._knot_weights.shape[1]
        self.scales, self.gradients = slice(0, knots), slice(knots, 3 * knots)
        self.groups = slice(3 * knots, 3 * knots + int(samples.group.max()) + 1)
        self.levels = slice(self.groups.stop, self.groups.stop + len(self._level_variance))
        self.links = slice(self.levels.stop, self.groups.start + self._indicators.shape[1])
        # Indices of the samples that follow each other in an arc.
        order = np.lexsort((samples.time, arc))
        is_same_arc = np.diff(arc[order]) == 0
        self._neighbours = order[:-1][is_same_arc], order[1:][is_same_arc]

    def start(self) -> tuple[ProfileSolution, _Sigmas]:
        """Return the solution and the sigmas that the search begins with."""
        log_altitude = np.log(shell_middles(self.edges))
        log_density = np.interp(log_altitude, np.log(_START_ALTITUDE), np.log(_START_DENSITY))
        sigmas = _Sigmas(self._largest_satellite_sigma, _GRADIENT_SIGMA, _GRADIENT_SIGMA)
        zeros = np.zeros(self.links.stop)
        return ProfileSolution(log_density, zeros, zeros), sigmas

    def solve(
        self,
        normal: NormalEquations,
        topside: TopsideModel,
        sigmas: _Sigmas,
        start: ProfileSolution,
    ) -> ProfileSolution:
        """Return the solution of normal equations for a topside and sigmas of the effects."""
        if topside not in self._priors:
            self._priors[topside] = log_density_prior(self.edges, self._altitude_high, topside)
        prior = self._priors[topside]
        return solve_profile(normal, *prior, self._precision(sigmas), start.log_density)

    def _precision(self, sigmas: _Sigmas) -> FloatArray:
        """Return one over the variances of the effects."""
        precision = np.full(self.links.stop, 1.0 / _GROUP_SIGMA**2)
        precision[self.scales] = 1.0 / sigmas.scale**2
        precision[self.gradients] = 1.0 / sigmas.gradient**2
        precision[self.levels] = 1.0 / self._level_variance
        precision[self.links] = 1.0 / sigmas.satellite**2
        return precision

    def sigmas(self, second_moment: FloatArray, sigmas: _Sigmas) -> _Sigmas:
        """Return the sigmas that expected squares of the effects imply."""
        satellite = sigmas.satellite
        if self.links.stop > self.links.start:
            satellite = math.sqrt(float(second_moment[self.links].mean()))
        return _Sigmas(
            min(satellite, self._largest_satellite_sigma),
            math.sqrt(float(second_moment[self.scales].mean())),
            math.sqrt(float(second_moment[self.gradients].mean())),
        )

    def normal(self, solution: ProfileSolution, weight: FloatArray) -> NormalEquations:
        """Return the normal equations of weighted samples.

        The columns of scale and gradients are those of the contents of `solution`; `weight` has
        shape (n,).
        """
        gradients, indicators = self._gradient_columns(solution), self._indicators
        weighted_paths = self._paths * weight[:, np.newaxis]
        weighted_gradients = gradients * weight[:, np.newaxis]
        weighted_indicators = indicators.multiply(weight[:, np.newaxis]).tocsr()
        mixed = weighted_indicators.T @ gradients
        return NormalEquations(
            density=weighted_paths.T @ self._paths,
            effects=np.block(
                [
                    [weighted_gradients.T @ gradients, mixed.T],
                    [mixed, (weighted_indicators.T @ indicators).toarray()],
                ]
            ),
            mixed=np.vstack((gradients.T @ weighted_paths, indicators.T @ weighted_paths)),
            density_vector=weighted_paths.T @ self.stec,
            effects_vector=np.concatenate(
                (weighted_gradients.T @ self.stec, weighted_indicators.T @ self.stec)
            ),
        )

    def residual(self, solution: ProfileSolution) -> FloatArray:
        """Return observed minus explained contents, TECU."""
        first = self.groups.start
        explained = self._paths @ np.exp(solution.log_density)
        explained += self._gradient_columns(solution) @ solution.effects[:first]
        return np.asarray(self.stec - explained - self._indicators @ solution.effects[first:])

    def inflation(self, residual: FloatArray) -> float:
        """Return the factor by which correlation increases the variance of weighted residuals.

        The residuals of an arc are taken as a first-order Markov process.
        """
        before, after = self._neighbours
        total = float(residual @ residual)
        correlation = float(residual[before] @ residual[after]) / total if total > 0.0 else 0.0
        correlation = min(max(correlation, 0.0), _LARGEST_CORRELATION)
        return (1.0 + correlation) / (1.0 - correlation)

    def _gradient_columns(self, solution: ProfileSolution) -> FloatArray:
        """Return the columns of scale and gradients for the contents of a solution."""
        content = self._paths @ np.exp(solution.log_density)
        scale = content[:, np.newaxis] * self._knot_weights
        east, north = self._pierce_offset[:, :1], self._pierce_offset[:, 1:]
        return np.hstack((scale, scale * east, scale * north))


def _indicator_columns(numbers: list[IntArray]) -> sparse.csr_matrix:
    """Return one column of zeros and ones for each value of each array of numbers 0, 1, ..."""
    columns, width = [], 0
    for number in numbers:
        columns.append(number + width)
        width += int(number.max()) + 1
    count = len(numbers[0])
    rows = np.tile(np.arange(count), len(numbers))
    ones = np.ones(len(rows))
    return sparse.csr_matrix((ones, (rows, np.concatenate(columns))), shape=(count, width))


def knot_weights(time: FloatArray) -> FloatArray:
    """Return the weights of evenly spaced knots at times, linear in between, shape (n, knots).

    The first and the last knot are at the first and the last time (s); between them is a knot each
    300 s or less, up to 36 knots.
    """
    span = max(float(np.ptp(time)), 1.0)
    intervals = min(math.ceil(span / _KNOT_INTERVAL), _MOST_KNOTS - 1)
    position = (time - time.min()) / span * intervals
    distance = np.abs(position[:, np.newaxis] - np.arange(intervals + 1))
    return np.asarray(np.maximum(0.0, 1.0 - distance))


def _pierce_offsets(samples: BiasSamples, altitude: FloatArray) -> FloatArray:
    """Return the offsets of pierce points from the receivers to the east and north, (n, 2).

    The unit is 1000 km.
    """
    receiver = samples.position_receiver_itrf
    point = pierce_point(receiver, samples.direction_itrf, altitude + 0.5 * shell_height(altitude))
    offset = (point - receiver) / _GRADIENT_UNIT
    east = np.cross([0.0, 0.0, 1.0], receiver)
    east /= np.linalg.norm(east, axis=-1, keepdims=True)
    north = np.cross(receiver, east)
    north /= np.linalg.norm(north, axis=-1, keepdims=True)
    columns = (offset * east).sum(axis=-1), (offset * north).sum(axis=-1)
    return np.asarray(np.stack(columns, axis=-1))


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
        solution = problem.solve(normal, _TOPSIDES[0], sigmas, solution)
        second_moment = solution.effects**2 + solution.effect_variance
        previous, sigmas = sigmas, problem.sigmas(second_moment, sigmas)
        ratio = np.array(astuple(sigmas)) / np.array(astuple(previous))
        if np.abs(np.log(ratio)).max() < _SIGMA_CONVERGED:
            break
    return solution, sigmas

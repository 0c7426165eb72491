"""Receiver biases of an eccentric orbit, together with the density profile that it flies through.

A receiver that climbs and falls sees each ray with the electrons above its own altitude. With the
densities n of shells of altitude, the path lengths P of rays through them and the bias b

    S = b + P n + level of the arc + bias left at the satellite + noise,

and it is the change of S along arcs, good to the phase noise, that tells n and with it what the
levels are: no shell height is assumed. The unknowns are the logarithms of n, so that no density
is negative; smoothness and the decrease far above the orbit are known beforehand
(`vtff_iono.bias.altitude_shells`). Levels are random effects with their sigmas. What is left of the
satellite biases is one with a common sigma, found from the samples, as the sigmas that satellites
state do not tell how large it is (the navigation message says nothing of C1C - C1W).

The ionosphere also changes along the orbit and across it. To first order the content of a ray is
then larger by the factor 1 + a(t) + g(t) d, with d the way of its pierce point from the receiver
to the east and north. a and g are linear between knots and random as well; their sigmas too are
found from the samples. Noise is what remains, taken to be correlated as the residuals of arcs are.

The solution is the maximum of the posterior density, by damped Gauss-Newton steps, its covariance
the inverse of the curvature there. It is repeated for different decreases of the topside.

References
----------
Dempster, Laird and Rubin (1977), J. R. Stat. Soc. B 39, 1 (variances of random effects).
Huber (1964), Ann. Math. Stat. 35, 73 (weights of outliers).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np
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

__all__ = ["ProfileBiases", "profile_biases"]

_TOPSIDES = (TopsideModel(), TopsideModel(exponent=3.0), TopsideModel(exponent=6.0))
# Of many epochs no more than this are used; gradients have a knot each so many seconds, or as
# many knots as this.
_MOST_EPOCHS = 540
_KNOT_INTERVAL = 300.0
_MOST_KNOTS = 36
# TECU: a receiver bias, of which nothing is known; what the navigation message of a satellite is
# believed at first (0.5 ns); a level at best; the noise at first and at best.
_GROUP_SIGMA = 1000.0
_SATELLITE_SIGMA = 1.43
_LEVEL_SIGMA_LEAST = 0.01
_NOISE_START, _NOISE_LEAST = 0.05, 0.01
# Of the content, and of the content per 1000 km.
_GRADIENT_SIGMA = 0.1
_NO_GRADIENT = 1e-6
_GRADIENT_UNIT = 1e6
_HUBER = 3.0
_SMALLEST_RESIDUAL = 1e-12
_MEDIAN_TO_SIGMA = 1.4826
_LARGEST_CORRELATION = 0.95
_NORMAL_ITERATIONS, _SIGMA_ITERATIONS = 8, 8
_NOISE_CONVERGED, _SIGMA_CONVERGED = 0.03, 0.1
_START_ALTITUDE = np.array([100e3, 400e3, 700e3, 1000e3, 20e6])
_START_DENSITY = np.array([1e11, 5e11, 1e11, 3e10, 1e8])


@dataclass(frozen=True, eq=False)
class ProfileBiases:
    """Biases of all groups, for each model of the topside, and the profile.

    Parameters
    ----------
    bias_tecu, sigma_tecu : ndarray, shape (models, groups)
        TECU.
    altitude, density : ndarray, shape (shells,)
        Middles of the shells, m, and electrons per cubic metre, of the first model.
    noise_tecu, satellite_sigma_tecu : float
        What was found for the scatter of single contents and for the satellite biases; the second
        is NaN without links.
    """

    bias_tecu: FloatArray
    sigma_tecu: FloatArray
    altitude: FloatArray
    density: FloatArray
    noise_tecu: float
    satellite_sigma_tecu: float


def profile_biases(samples: BiasSamples, altitude: FloatArray) -> ProfileBiases:
    """Return the biases that one density profile explains best.

    Parameters
    ----------
    samples : BiasSamples
        With arcs.
    altitude : ndarray, shape (n,)
        Of the receiver, m.

    Raises
    ------
    ValueError
        If the samples have no arcs.
    """
    if samples.arc is None:
        raise ValueError("samples: arcs are required")
    epoch = np.unique(samples.time, return_inverse=True)[1]
    kept = epoch % (1 + epoch.max() // _MOST_EPOCHS) == 0
    problem = _Problem(samples.part(kept), altitude[kept])
    solution, sigmas = problem.start()
    noise, weight = _NOISE_START, np.ones(int(kept.sum()))
    # The first time without gradients, as their columns need a profile.
    normal = problem.normal(solution, weight / noise**2)
    level = replace(sigmas, scale=_NO_GRADIENT, gradient=_NO_GRADIENT)
    solution = problem.solve(normal, _TOPSIDES[0], level, solution)
    for _ in range(_NORMAL_ITERATIONS):
        residual = problem.residual(solution)
        previous, noise = noise, _scatter(residual)
        weight = np.minimum(1.0, _HUBER * noise / np.maximum(np.abs(residual), _SMALLEST_RESIDUAL))
        variance = noise**2 * problem.inflation(weight * residual)
        normal = problem.normal(solution, weight / variance)
        solution, sigmas = _with_sigmas(problem, normal, solution, sigmas)
        if abs(noise / previous - 1.0) < _NOISE_CONVERGED:
            break
    models = []
    for topside in _TOPSIDES:
        solution = problem.solve(normal, topside, sigmas, solution)
        models.append(solution)
    return ProfileBiases(
        bias_tecu=np.array([one.effects[problem.groups] for one in models]),
        sigma_tecu=np.sqrt([one.effect_variance[problem.groups] for one in models]),
        altitude=shell_middles(problem.edges),
        density=np.exp(models[0].log_density),
        noise_tecu=noise,
        satellite_sigma_tecu=math.nan if samples.link is None else sigmas.satellite,
    )


@dataclass(frozen=True)
class _Sigmas:
    """Of random effects: TECU, relative, relative per 1000 km."""

    satellite: float
    scale: float
    gradient: float


class _Problem:
    """Samples, and the columns of the unknowns: shells, then effects.

    Effects in their order: scale and gradients to the east and north at the knots, biases of the
    groups, levels of the arcs, biases of the links.
    """

    def __init__(self, samples: BiasSamples, altitude: FloatArray) -> None:
        self.stec = samples.stec_tecu
        self.edges = shell_edges(float(altitude.min()), float(altitude.max()))
        self._altitude_high = float(altitude.max())
        self._paths = shell_paths(
            samples.position_receiver_itrf, samples.direction_itrf, altitude, self.edges
        )
        self._hats = _hats(samples.time)
        self._way = _way(samples, altitude)
        arc = np.unique(samples.arc, return_inverse=True)[1]
        stated = np.zeros(len(self.stec))
        if samples.satellite_sigma_tecu is not None:
            stated = samples.satellite_sigma_tecu
        self._largest_satellite_sigma = max(_SATELLITE_SIGMA, float(np.median(stated)))
        self._level_variance = np.zeros(arc.max() + 1)
        self._level_variance[arc] = np.maximum(
            samples.stec_sigma_tecu**2 - stated**2, _LEVEL_SIGMA_LEAST**2
        )
        numbers = [samples.group, arc]
        if samples.link is not None:
            numbers.append(np.unique(samples.link, return_inverse=True)[1])
        self._indicators = _indicator_columns(numbers)
        knots = self._hats.shape[1]
        self.scales, self.gradients = slice(0, knots), slice(knots, 3 * knots)
        self.groups = slice(3 * knots, 3 * knots + int(samples.group.max()) + 1)
        self.levels = slice(self.groups.stop, self.groups.stop + len(self._level_variance))
        self.links = slice(self.levels.stop, self.groups.start + self._indicators.shape[1])
        # Samples that follow each other in an arc.
        order = np.lexsort((samples.time, arc))
        same = np.diff(arc[order]) == 0
        self._neighbours = order[:-1][same], order[1:][same]

    def start(self) -> tuple[ProfileSolution, _Sigmas]:
        """Return where the search begins."""
        middle = np.log(shell_middles(self.edges))
        guess = np.interp(middle, np.log(_START_ALTITUDE), np.log(_START_DENSITY))
        sigmas = _Sigmas(self._largest_satellite_sigma, _GRADIENT_SIGMA, _GRADIENT_SIGMA)
        nothing = np.zeros(self.links.stop)
        return ProfileSolution(guess, nothing, nothing), sigmas

    def solve(
        self,
        normal: NormalEquations,
        topside: TopsideModel,
        sigmas: _Sigmas,
        start: ProfileSolution,
    ) -> ProfileSolution:
        """Return the solution of normal equations for a topside and sigmas of the effects."""
        prior = log_density_prior(self.edges, self._altitude_high, topside)
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
        """Return the normal equations with the columns of gradients of a solution."""
        gradients = self._gradient_columns(solution)
        weighted, single = self._paths * weight[:, np.newaxis], self._indicators
        both = gradients * weight[:, np.newaxis]
        heavy = single.multiply(weight[:, np.newaxis]).tocsr()
        mixed = heavy.T @ gradients
        return NormalEquations(
            density=weighted.T @ self._paths,
            effects=np.block(
                [[both.T @ gradients, mixed.T], [mixed, (heavy.T @ single).toarray()]]
            ),
            mixed=np.vstack((gradients.T @ weighted, single.T @ weighted)),
            density_vector=weighted.T @ self.stec,
            effects_vector=np.concatenate((both.T @ self.stec, heavy.T @ self.stec)),
        )

    def residual(self, solution: ProfileSolution) -> FloatArray:
        """Return observed less explained contents, TECU."""
        first = self.groups.start
        explained = self._paths @ np.exp(solution.log_density)
        explained += self._gradient_columns(solution) @ solution.effects[:first]
        return np.asarray(self.stec - explained - self._indicators @ solution.effects[first:])

    def inflation(self, residual: FloatArray) -> float:
        """Return by how much correlated residuals count less: that of a first-order process."""
        one, other = self._neighbours
        total = float(residual @ residual)
        correlation = float(residual[one] @ residual[other]) / total if total > 0.0 else 0.0
        correlation = min(max(correlation, 0.0), _LARGEST_CORRELATION)
        return (1.0 + correlation) / (1.0 - correlation)

    def _gradient_columns(self, solution: ProfileSolution) -> FloatArray:
        content = self._paths @ np.exp(solution.log_density)
        scaled = content[:, np.newaxis] * self._hats
        return np.hstack((scaled, scaled * self._way[:, :1], scaled * self._way[:, 1:]))


def _indicator_columns(numbers: list[FloatArray]) -> sparse.csr_matrix:
    """Return one column for each value of each list of numbers 0, 1, ..."""
    columns, first = [], 0
    for number in numbers:
        columns.append(number + first)
        first += int(number.max()) + 1
    count = len(numbers[0])
    rows = np.tile(np.arange(count), len(numbers))
    ones = np.ones(len(rows))
    return sparse.csr_matrix((ones, (rows, np.concatenate(columns))), shape=(count, first))


def _hats(time: FloatArray) -> FloatArray:
    """Return the weights of knots, linear in between, shape (n, knots)."""
    span = max(float(np.ptp(time)), 1.0)
    intervals = min(math.ceil(span / _KNOT_INTERVAL), _MOST_KNOTS - 1)
    place = (time - time.min()) / span * intervals
    return np.maximum(0.0, 1.0 - np.abs(place[:, np.newaxis] - np.arange(intervals + 1)))


def _way(samples: BiasSamples, altitude: FloatArray) -> FloatArray:
    """Return the ways of pierce points from the receivers to the east and north, (n, 2)."""
    receiver = samples.position_receiver_itrf
    point = pierce_point(receiver, samples.direction_itrf, altitude + 0.5 * shell_height(altitude))
    way = (point - receiver) / _GRADIENT_UNIT
    east = np.cross([0.0, 0.0, 1.0], receiver)
    east /= np.linalg.norm(east, axis=-1, keepdims=True)
    north = np.cross(receiver, east)
    north /= np.linalg.norm(north, axis=-1, keepdims=True)
    return np.stack(((way * east).sum(axis=-1), (way * north).sum(axis=-1)), axis=-1)


def _scatter(residual: FloatArray) -> float:
    """Return the standard deviation of residuals, outliers apart."""
    return max(_NOISE_LEAST, _MEDIAN_TO_SIGMA * float(np.median(np.abs(residual))))


def _with_sigmas(
    problem: _Problem,
    normal: NormalEquations,
    solution: ProfileSolution,
    sigmas: _Sigmas,
) -> tuple[ProfileSolution, _Sigmas]:
    """Return the solution together with the sigmas of the random effects that it implies."""
    for _ in range(_SIGMA_ITERATIONS):
        solution = problem.solve(normal, _TOPSIDES[0], sigmas, solution)
        second_moment = solution.effects**2 + solution.effect_variance
        previous, sigmas = sigmas, problem.sigmas(second_moment, sigmas)
        ratio = np.array(astuple(sigmas)) / np.array(astuple(previous))
        if np.abs(np.log(ratio)).max() < _SIGMA_CONVERGED:
            break
    return solution, sigmas

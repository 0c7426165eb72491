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
then larger by the sum over two layers of M (a(t) + g(t) d), and by S c. M is slant over vertical
content in the layer, and d the vector from the receiver to the pierce point to the east and north.
The lower layer is that of the profile, the higher one a thin shell far above it
(`vtff_iono.bias.expected_contents.HorizontalLayers`): in which of both the horizontal structure is,
the samples tell. The vertical content a and its gradient g are a mean over all of the time, and
what differs from it, linear between knots: gradients that were free at each knot would pass for
what is too small for them. S is the content of the ray, and c by what part the ionosphere that one
arc passes differs from that of the others. All are random effects as well, and their sigmas are
estimated from the samples. Without c the noise of a thousand samples would seem to tell the level
of an arc to 0.02 TECU, while the shape of the ionosphere is not known as well as that. What none of
these explain is noise, of which a part lasts for minutes and grows with the slant; how large and
how slow it is, the residuals of arcs tell (`vtff_iono.bias.arc_noise`).

Phases count the turns of the antennas against each other (`vtff_iono.geometry.wind_up`), which in
an arc look like up to 0.1 TECU. Simulators may leave that out. By what part of it the phases are
more is a further effect.

The offset of an arc is what its samples are larger by than its contents: the bias of the receiver,
and the errors of its level and of the satellite bias. The contents of an eccentric orbit tell it
better than the codes do, whose multipath hardly averages out over an arc and whose line biases
drift.

The solution is the maximum of the posterior density, reached by damped Gauss-Newton steps; its
covariance is the inverse of the curvature there. It is repeated for different decreases of the
topside and altitudes of the higher layer, which count alike. Samples of more than four hours are
solved in pieces of equal length, each with a profile of its own; the biases are the weighted means
of theirs.

References
----------
Dempster, Laird and Rubin (1977), J. R. Stat. Soc. B 39, 1 (variances of random effects).
Huber (1964), Ann. Math. Stat. 35, 73 (weights of outliers).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.altitude_shells import (
    TopsideModel,
    log_density_prior,
    shell_edges,
    shell_middles,
    shell_paths,
    vertical_contents,
)
from vtff_iono.bias.arc_noise import ArcNoise, ArcOrder, Whitening, estimate_noise
from vtff_iono.bias.bias_samples import DECIMALS_TECU, BiasSamples
from vtff_iono.bias.expected_contents import (
    GRADIENT_UNIT,
    HIGH_SHELL,
    ExpectedContents,
    HorizontalLayers,
    Knots,
)
from vtff_iono.bias.profile_solver import NormalEquations, ProfileSolution, solve_profile
from vtff_iono.bias.single_columns import SingleColumns

__all__ = ["ProfileBiases", "profile_biases"]

IntArray = npt.NDArray[np.integer]

# Models of the topside and altitudes of the shell of the higher layer, m: electrons that decrease
# slowly are higher.
_MODELS = (
    (TopsideModel(), HIGH_SHELL),
    (TopsideModel(exponent=3.0), 1500e3),
    (TopsideModel(exponent=6.0), 700e3),
)
# Longest time of the samples of one solution, s: that of an online estimate. What a solution costs
# grows with its cube, as each knot has unknowns.
_LONGEST = 4.0 * 3600.0
# Largest number of epochs that are used, of evenly thinned samples.
_MOST_EPOCHS = 540
# Prior sigma of a receiver bias, TECU: nothing is known about it.
_GROUP_SIGMA = 1000.0
# Sigma of the satellite biases at first, TECU: 0.5 ns, the error of navigation messages.
_SATELLITE_SIGMA = 1.43
# Smallest sigma of a level, TECU.
_LEVEL_SIGMA_LEAST = 0.01
# Noise of the samples at first.
_NOISE_START = ArcNoise(0.05, 0.0, 100.0, 0.0)
# Prior sigma of the part of the wind-up that the phases have: none or all of it.
_WIND_UP_SIGMA = 1.0
# Sigmas at first of the vertical content (TECU) and its gradients (TECU per 1000 km), and of what
# is particular to an arc (relative to the content); and the value that switches them off. From a
# large sigma of the arcs the search can end where they take what gradients explain better.
_VERTICAL_SIGMA = 0.5
_ARC_SIGMA = 0.005
_NO_GRADIENT = 1e-6
# Residuals beyond this many sigmas are given less weight (Huber).
_HUBER = 3.0
_SMALLEST_RESIDUAL = 1e-12
# Largest numbers of iterations, and the relative changes of noise and sigmas that end them.
_NORMAL_ITERATIONS, _SIGMA_ITERATIONS = 8, 8
_NOISE_CONVERGED, _SIGMA_CONVERGED = 0.03, 0.1
# Densities that the search begins with, 1/m3, against altitude, m.
_START_ALTITUDE = np.array([100e3, 400e3, 700e3, 1000e3, 20e6])
_START_DENSITY = np.array([1e11, 5e11, 1e11, 3e10, 1e8])


@dataclass(frozen=True)
class _Sigmas:
    """Sigmas of random effects.

    Parameters
    ----------
    satellite : float
        Sigma of the satellite biases, TECU.
    vertical, gradient : tuple of 2 float
        Sigmas of the vertical content, TECU, and of its gradients, TECU per 1000 km, at the knots
        in the lower and in the higher layer, less their means.
    mean : tuple of 4 float
        Sigmas of the means of vertical content and gradient over all of the time in the lower
        layer, then of those in the higher one.
    arc : float
        Sigma of what is particular to an arc, relative to the content.
    level_factor : float
        Sigmas of the levels over those that are stated, 1 at least: codes that err alike for longer
        than was assumed, as by multipath, state too little.
    """

    satellite: float
    vertical: tuple[float, float]
    gradient: tuple[float, float]
    mean: tuple[float, ...]
    arc: float
    level_factor: float

    def logarithms(self) -> FloatArray:
        """Return the natural logarithms of all sigmas, shape (11,)."""
        of_layers = *self.vertical, *self.gradient, *self.mean
        return np.log((self.satellite, *of_layers, self.arc, self.level_factor))


class SearchState(NamedTuple):
    """Where the search for a solution ended, from which that of later samples begins.

    Attributes
    ----------
    altitude, logarithm : ndarray, shape (shells,)
        Altitudes of the middles of shells, m, and logarithms of their densities.
    sigmas : _Sigmas
    noise : ArcNoise
        Noise of single contents.
    """

    altitude: FloatArray
    logarithm: FloatArray
    sigmas: _Sigmas
    noise: ArcNoise

    def log_density(self, altitude: FloatArray) -> FloatArray:
        """Return the logarithms of densities at altitudes, m."""
        return np.interp(np.log(altitude), np.log(self.altitude), self.logarithm)


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
        What the samples of an arc are larger by than its contents and their wind-up, mean of the
        models, and the sigma of its last content, which contains their spread, TECU.
    wind_up : float
        Part of the wind-up of the samples that the phases contain: 1 of a receiver, 0 where a
        simulator leaves it out.
    contents : ExpectedContents
        Contents of rays of other arcs.
    links : int
        Number of the links whose satellite biases were estimated.
    search : SearchState
        Where the search ended.
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
    wind_up: float
    contents: ExpectedContents
    links: int
    search: SearchState


def profile_biases(
    samples: BiasSamples, altitude: FloatArray, before: SearchState | None = None
) -> ProfileBiases:
    """Return the most probable receiver biases together with one density profile.

    Parameters
    ----------
    samples : BiasSamples
        Contents; they must have arcs.
    altitude : ndarray, shape (n,)
        Altitudes of the receiver, m.
    before : SearchState, optional
        Where the search of an earlier solution of the same receiver ended: it begins there.

    Raises
    ------
    ValueError
        If the samples have no arcs.
    """
    groups = int(samples.group.max()) + 1
    elapsed = samples.time - samples.time.min()
    count = max(1, math.ceil(float(elapsed.max()) / _LONGEST))
    piece = np.minimum(elapsed * count // max(float(elapsed.max()), 1.0), count - 1)
    found = [
        _solve(samples.select(piece == number), altitude[piece == number], groups, before)
        for number in range(count)
        if np.count_nonzero(piece == number) > 0
    ]
    return found[0] if len(found) == 1 else _join(found)


def _join(pieces: list[ProfileBiases]) -> ProfileBiases:
    """Return the biases of pieces together, and the profile of the last one.

    The satellite biases err alike in all pieces: the sigma of the receiver biases is not less than
    their mean, nor less than the pieces scatter. An arc in two pieces has the offset that is known
    better.
    """
    bias, sigma = (
        np.array([getattr(p, name) for p in pieces]) for name in ("bias_tecu", "sigma_tecu")
    )
    weight = 1.0 / sigma**2
    mean = (weight * bias).sum(axis=0) / weight.sum(axis=0)
    scatter = (weight * (bias - mean) ** 2).sum(axis=0) / (len(pieces) - 1)
    variance = np.maximum(scatter, 1.0) / weight.sum(axis=0)
    satellite = [piece.satellite_sigma_tecu for piece in pieces]
    links = max(piece.links for piece in pieces)
    if links > 0:
        variance += float(np.mean(np.square(satellite))) / links
    best: dict[int, tuple[float, float]] = {}
    for piece in pieces:
        columns = piece.arc, piece.offset_sigma_tecu, piece.offset_tecu
        for arc, *known in zip(*(column.tolist() for column in columns), strict=True):
            best[arc] = min(best.get(arc, (math.inf, math.nan)), (known[0], known[1]))
    arcs = sorted(best)
    return replace(
        pieces[-1],
        bias_tecu=mean,
        sigma_tecu=np.sqrt(variance),
        noise_tecu=_root_mean_square([piece.noise_tecu for piece in pieces]),
        satellite_sigma_tecu=_root_mean_square(satellite),
        arc=np.array(arcs),
        offset_tecu=np.array([best[arc][1] for arc in arcs]),
        offset_sigma_tecu=np.array([best[arc][0] for arc in arcs]),
        links=links,
    )


def _root_mean_square(values: list[float]) -> float:
    return math.sqrt(float(np.mean(np.square(values))))


def _solve(
    samples: BiasSamples, altitude: FloatArray, groups: int, before: SearchState | None
) -> ProfileBiases:
    """Return the solution of samples of some hours, see `profile_biases`."""
    epoch = np.unique(samples.time, return_inverse=True)[1]
    is_used = epoch % (1 + epoch.max() // _MOST_EPOCHS) == 0
    problem = _Problem(samples.select(is_used), altitude[is_used], groups)
    weight = np.ones(int(is_used.sum()))
    if before is None:
        log_density, sigmas = problem.start()
        noise = _NOISE_START
        # The first solution has no gradients, as their columns need a profile.
        none = (_NO_GRADIENT, _NO_GRADIENT)
        first_sigmas = replace(
            sigmas, vertical=none, gradient=none, mean=2 * none, arc=_NO_GRADIENT
        )
    else:
        log_density = before.log_density(shell_middles(problem.edges))
        sigmas = first_sigmas = before.sigmas
        noise = before.noise
    whitened = problem.whitened(noise, weight)
    normal = problem.normal(problem.effect_columns(log_density), whitened)
    solution = problem.solve(normal, _MODELS[0][0], first_sigmas, log_density)
    for iteration in range(_NORMAL_ITERATIONS):
        columns = problem.effect_columns(solution.log_density)
        residual = problem.residual(solution, columns)
        near = noise if iteration else None
        previous, noise = noise, estimate_noise(residual, problem.order, weight, near)
        alike = Whitening.of(problem.order, noise, np.ones(len(residual)))
        independent = alike.whiten(residual[:, np.newaxis])[:, 0]
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(independent), _SMALLEST_RESIDUAL))
        whitened = problem.whitened(noise, weight)
        normal = problem.normal(columns, whitened)
        solution, sigmas = _estimate_sigmas(problem, normal, solution, sigmas)
        if _change(noise, previous) < _NOISE_CONVERGED:
            break
    models = []
    for topside, shell in _MODELS:
        columns = problem.effect_columns(solution.log_density, shell)
        normal = problem.normal(columns, whitened)
        solution = problem.solve(normal, topside, sigmas, solution.log_density)
        models.append(solution)
    of_models = np.array([problem.offsets(model) for model in models])
    offsets, offset_variances = of_models[:, 0], of_models[:, 1]
    # The departures of contents from a profile are not independent of each other: their scatter
    # does not average out. Single contents of the arc scatter as much, too.
    # The models count alike: their evidence takes residuals for independent, and with hundreds of
    # correlated ones it would leave one model with all the weight.
    offset_variance = np.median(offset_variances, axis=0) + np.var(offsets, axis=0, ddof=1)
    first = models[0]
    residual = problem.residual(first, problem.effect_columns(first.log_density))
    offset_variance += np.maximum(noise.white**2, problem.squares_of_arcs(residual))
    contents = ExpectedContents(
        problem.edges,
        np.exp(first.log_density),
        problem.knots,
        problem.at_knots(first.effects),
        sigmas.arc,
    ).continued_below()
    return ProfileBiases(
        bias_tecu=np.array([model.effects[problem.groups] for model in models]),
        sigma_tecu=np.sqrt([model.shared_variance[problem.groups] for model in models]),
        altitude=shell_middles(problem.edges),
        density=np.exp(first.log_density),
        noise_tecu=math.hypot(noise.white, noise.slow),
        satellite_sigma_tecu=math.nan if samples.link is None else sigmas.satellite,
        vertical_sigma_tecu=round(
            math.hypot(*sigmas.vertical, sigmas.mean[0], sigmas.mean[2]), DECIMALS_TECU
        ),
        gradient_sigma=problem.gradient_sigma(first),
        arc=problem.arc_numbers,
        offset_tecu=np.asarray(offsets.mean(axis=0)).round(DECIMALS_TECU),
        offset_sigma_tecu=np.round(np.sqrt(offset_variance), DECIMALS_TECU),
        wind_up=round(float(np.mean([m.effects[problem.wind_up] for m in models])), DECIMALS_TECU),
        contents=contents,
        links=problem.links.stop - problem.links.start,
        search=SearchState(shell_middles(problem.edges), first.log_density, sigmas, noise),
    )


class _EffectColumns(NamedTuple):
    """Columns of the effects in the equations of n samples.

    Attributes
    ----------
    common : ndarray, shape (n, 6 knots + 7)
        Columns of the vertical contents and their gradients at the knots, in both layers, of their
        means, and of the wind-up.
    single : SingleColumns
        Columns of all other effects.
    """

    common: FloatArray
    single: SingleColumns


class _WhitenedSamples(NamedTuple):
    """Samples with a noise, as independent samples of variance one: what all effects share.

    Attributes
    ----------
    whitening : Whitening
    stec : ndarray, shape (n,)
        Contents.
    paths : ndarray, shape (n, shells)
        Paths through the shells.
    density, density_vector : ndarray, shapes (shells, shells) and (shells,)
        The part of the densities in the normal equations.
    """

    whitening: Whitening
    stec: FloatArray
    paths: FloatArray
    density: FloatArray
    density_vector: FloatArray


class _Problem:
    """Samples, and the columns of the unknowns: shells, then effects.

    The effects are, in this order: vertical content, its gradients to the east and to the north at
    the knots, in the lower and in the higher layer; their six means; the part of the wind-up;
    biases of the groups; errors of the satellite biases of the links; what is particular to each
    arc; errors of the levels of arcs.
    """

    def __init__(self, samples: BiasSamples, altitude: FloatArray, groups: int) -> None:
        if samples.arc is None:
            raise ValueError("samples: arcs are required")
        self.stec = samples.stec_tecu
        self.edges = shell_edges(float(altitude.min()), float(altitude.max()))
        self._altitude_high = float(altitude.max())
        self._priors: dict[TopsideModel, tuple[FloatArray, FloatArray]] = {}
        self._paths = shell_paths(
            samples.position_receiver_itrf, samples.direction_itrf, altitude, self.edges
        )
        self._altitude = altitude
        self.knots = Knots.over(samples.time)
        self._knot_weights = self.knots.weights(samples.time)
        rays = samples.position_receiver_itrf, samples.direction_itrf, altitude
        layers = HorizontalLayers.of_rays(*rays)
        self._layers = {shell: layers.with_shell(*rays, shell) for _, shell in _MODELS}
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
        link = np.zeros((len(arc), 0), dtype=np.int64)
        if samples.link is not None:
            link = np.unique(samples.link, return_inverse=True)[1][:, np.newaxis]
        arcs = len(self.arc_numbers)
        # Ends of the columns of each kind of effect.
        links = int(link.max()) + 1 if link.size else 0
        ends = np.cumsum([6 * self.knots.number + 7, groups, links, arcs, arcs]).tolist()
        # The vertical contents and the gradients of each layer.
        edges = self.knots.number * np.array([[0, 1, 3], [3, 4, 6]])
        self.verticals, self.gradients = (
            tuple(slice(*row[k : k + 2]) for row in edges.tolist()) for k in range(2)
        )
        mean, self.wind_up = 6 * self.knots.number, 6 * self.knots.number + 6
        self.means = tuple(
            slice(mean + begin, mean + end) for begin, end in ((0, 1), (1, 3), (3, 4), (4, 6))
        )
        self.groups, self.links, self.arcs, self.levels = (
            slice(*ends[k : k + 2]) for k in range(4)
        )
        self.effects = ends[-1]
        # Columns with one element in each row, which follow those of the knots: of the group, the
        # link, and what is particular to an arc and its level.
        constant = np.column_stack((samples.group, link + groups, arc + ends[3] - ends[0]))
        self._column = np.insert(constant, -1, arc + ends[2] - ends[0], axis=1)
        self._columns = ends[-1] - ends[0]
        self._column_of_arc = constant[first_of_arc] + ends[0]
        self._arc = arc
        self._wind_up = np.zeros(len(self.stec))
        if samples.wind_up_tecu is not None:
            self._wind_up = samples.wind_up_tecu
        self._last_wind_up = np.zeros(len(self.arc_numbers))
        by_time = np.argsort(samples.time, kind="stable")
        self._last_wind_up[arc[by_time]] = self._wind_up[by_time]
        self.order = ArcOrder.of(arc, samples.time, self._layers[HIGH_SHELL].mapping_high)

    def start(self) -> tuple[FloatArray, _Sigmas]:
        """Return the logarithms of densities and the sigmas that the search begins with."""
        log_altitude = np.log(shell_middles(self.edges))
        log_density = np.interp(log_altitude, np.log(_START_ALTITUDE), np.log(_START_DENSITY))
        both = (_VERTICAL_SIGMA, _VERTICAL_SIGMA)
        return log_density, _Sigmas(
            self._largest_satellite_sigma, both, both, 2 * both, _ARC_SIGMA, 1.0
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
        precision = np.full(self.effects, 1.0 / _GROUP_SIGMA**2)
        for layer in range(2):
            precision[self.verticals[layer]] = 1.0 / sigmas.vertical[layer] ** 2
            precision[self.gradients[layer]] = 1.0 / sigmas.gradient[layer] ** 2
        for of_kind, sigma in zip(self.means, sigmas.mean, strict=True):
            precision[of_kind] = 1.0 / sigma**2
        precision[self.wind_up] = 1.0 / _WIND_UP_SIGMA**2
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
        arc = math.sqrt(float(second_moment[self.arcs].mean()))
        (vertical_low, vertical_high), (gradient_low, gradient_high) = (
            [math.sqrt(float(second_moment[of_layer].mean())) for of_layer in of_kind]
            for of_kind in (self.verticals, self.gradients)
        )
        return _Sigmas(
            min(satellite, self._largest_satellite_sigma),
            (vertical_low, vertical_high),
            (gradient_low, gradient_high),
            tuple(math.sqrt(float(second_moment[of_kind].mean())) for of_kind in self.means),
            arc,
            max(1.0, math.sqrt(level)),
        )

    def effect_columns(
        self, log_density: FloatArray, shell_altitude: float = HIGH_SHELL
    ) -> _EffectColumns:
        """Return the columns of effects for the contents of logarithms of densities.

        `shell_altitude` is that of the higher layer, m.
        """
        density = np.exp(log_density)
        content = self._paths @ density
        mapping = content / vertical_contents(self._altitude, self.edges, density)
        values = np.ones(self._column.shape)
        values[:, -2] = content
        single = SingleColumns(self._column, values, self._columns)
        layers = self._layers[shell_altitude]
        common = layers.columns(self._knot_weights, mapping, 7)
        common[:, -7:-1] = layers.means(mapping)
        common[:, -1] = self._wind_up
        return _EffectColumns(common, single)

    def whitened(self, noise: ArcNoise, weight: FloatArray) -> _WhitenedSamples:
        """Return the samples with a noise; `weight`, shape (n,), is that of `Whitening.of`."""
        whitening = Whitening.of(self.order, noise, weight)
        stec = whitening.whiten(self.stec[:, np.newaxis])[:, 0]
        paths = whitening.whiten(self._paths)
        return _WhitenedSamples(whitening, stec, paths, paths.T @ paths, paths.T @ stec)

    def normal(self, columns: _EffectColumns, samples: _WhitenedSamples) -> NormalEquations:
        """Return the normal equations of samples for columns of their effects."""
        whiten, stec, paths = samples.whitening.whiten, samples.stec, samples.paths
        common = whiten(columns.common)
        # All samples of an arc have their elements in the same columns.
        single = columns.single._replace(value=whiten(columns.single.value))
        knots, shared, arcs = common.shape[1], self.links.stop, len(self.arc_numbers)
        # Shared effects of which a sample has one of each kind; the rest is of arcs.
        some = shared - knots
        squares, by_knots = single.squares(), single.times_rows(common)
        by_paths, by_stec = single.times_rows(paths), single.times_rows(stec[:, np.newaxis])
        joint = np.empty((shared + paths.shape[1] + 1,) * 2)
        joint[:knots, :knots] = common.T @ common
        joint[knots:shared, :knots] = by_knots[:some]
        joint[knots:shared, knots:shared] = squares[:some, :some]
        joint[shared:-1, :knots] = paths.T @ common
        joint[shared:-1, knots:shared] = by_paths[:some].T
        joint[shared:-1, shared:-1] = samples.density
        joint[-1, :knots] = stec @ common
        joint[-1, knots:shared] = by_stec[:some, 0]
        joint[-1, shared:-1] = samples.density_vector
        joint[-1, -1] = stec @ stec
        for first, end in ((0, knots), (knots, shared), (shared, len(joint) - 1)):
            joint[first:end, end:] = joint[end:, first:end].T
        of_arcs = np.hstack(
            (by_knots[some:], squares[some:, :some], by_paths[some:], by_stec[some:])
        )
        content, level = slice(some, some + arcs), slice(some + arcs, None)
        pairs = (content, content), (content, level), (level, level)
        return NormalEquations(
            shared,
            joint,
            np.array([np.diag(squares[pair]) for pair in pairs]),
            of_arcs.reshape(2, arcs, -1),
        )

    def residual(self, solution: ProfileSolution, columns: _EffectColumns) -> FloatArray:
        """Return observed minus explained contents, TECU; the columns are of its densities."""
        common, single = columns
        explained = self._paths @ np.exp(solution.log_density)
        knots = common.shape[1]
        explained += common @ solution.effects[:knots]
        return self.stec - explained - single.times(solution.effects[knots:])

    def offsets(self, solution: ProfileSolution) -> tuple[FloatArray, FloatArray]:
        """Return the offsets of the arcs, TECU, and their variances, shape (arcs,).

        The variances are those of offset and wind-up at the last sample of an arc.
        """
        columns = np.zeros((len(self.arc_numbers), self.effects))
        np.put_along_axis(columns, self._column_of_arc, 1.0, axis=1)
        offsets = columns @ solution.effects
        columns[:, self.wind_up] = self._last_wind_up
        return offsets, solution.variance(columns)

    def gradient_sigma(self, solution: ProfileSolution) -> FloatArray:
        """Return the roots of the expected squares of gradients to east and north, TECU/m, (2,)."""
        squares = self.at_knots(solution.effects) ** 2
        squares += self.at_knots(solution.shared_variance)
        of_direction = np.sum(
            [squares[of_layer].reshape(2, self.knots.number) for of_layer in self.gradients], axis=0
        )
        return np.asarray(np.sqrt(of_direction.mean(axis=1)).round(DECIMALS_TECU) / GRADIENT_UNIT)

    def at_knots(self, effects: FloatArray) -> FloatArray:
        """Return the sums of the effects at the knots and their means, shape (6 knots,)."""
        ends = 6 * self.knots.number
        return effects[:ends] + np.repeat(effects[ends : ends + 6], self.knots.number)

    def squares_of_arcs(self, residual: FloatArray) -> FloatArray:
        """Return the mean squares of residuals of each arc, shape (arcs,)."""
        return np.bincount(self._arc, residual**2) / np.bincount(self._arc)


def _change(noise: ArcNoise, previous: ArcNoise) -> float:
    """Return by how much the noise of contents has changed, relative to it."""
    one, other = (math.hypot(of_time.white, of_time.slow) for of_time in (noise, previous))
    return abs(one / other - 1.0) + abs(noise.slow - previous.slow) / one


def _estimate_sigmas(
    problem: _Problem,
    normal: NormalEquations,
    solution: ProfileSolution,
    sigmas: _Sigmas,
) -> tuple[ProfileSolution, _Sigmas]:
    """Return the solution and the sigmas of the random effects that agree with it."""
    for _ in range(_SIGMA_ITERATIONS):
        solution = problem.solve(normal, _MODELS[0][0], sigmas, solution.log_density)
        second_moment = solution.effects**2 + solution.effect_variance
        previous, sigmas = sigmas, problem.sigmas(second_moment, sigmas)
        if np.abs(sigmas.logarithms() - previous.logarithms()).max() < _SIGMA_CONVERGED:
            break
    return solution, sigmas

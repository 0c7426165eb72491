"""Receiver biases from slant contents alone, with a sigma that contains the spread of the models.

With the bias b of the receiver (TECU, in the slant content) and the mapping factors M, two
satellites of one epoch determine b if the ionosphere above both is the same:

    S_i / M_i - S_j / M_j = b_i / M_i - b_j / M_j + (V_i - V_j).

The last term is the noise of the method. Its variance is a structure function, (g V s)^2: a
relative gradient g times the vertical content V times the separation s of the pierce points. So
pairs whose satellites are near each other count more, and so do the hours before dawn, when the
content is small. The gradient g follows from the residuals. Pairs that do not fit are given less
weight (Huber). Several kinds of signal pairs (GPS L1/L2, Galileo E1/E5a) have a bias each and share
the ionosphere, so that each kind improves the biases of all. The vertical content must not be
negative, which bounds b from above.

Neither the height of the layer nor the lowest useful elevation is known well, and gradients may be
estimated together with the biases or not. Below a crest of the equatorial anomaly the content falls
to the north and to the south, which low satellites see as a bias: then its curvature to the north
tells more than gradients do. Elsewhere it only makes the bias less sure. What the curvature changes
of the bias is therefore a random effect, whose variance is that of its values in all models, less
what the jackknife tells that they scatter by: only the part that the data prove is taken over. The
solution is repeated for several heights, for several elevations, without gradients, with them, and
with the curvature, too; its value is the mean. Its sigma contains the scatter of these solutions,
the scatter of a jackknife over blocks of time (residuals of neighbouring epochs are not
independent, so that a formal sigma would be far too small), and the errors of the levels, each of
which shifts an arc.

In orbit, where the arcs are known, the biases are those of a solution with a density profile
instead, see `vtff_iono.bias.profile_bias`: on a circular orbit too the contents at all elevations
tell what is above by far better than mapping factors for shells of several heights.

References
----------
Gaposchkin and Coster (1993), GPS L1-L2 bias determination, MIT Lincoln Laboratory TR-971 (pairwise
least squares); Vierinen et al. (2016), Atmos. Meas. Tech. 9, 1303 (weights by separation);
Rideout and Coster (2006), GPS Solutions 10, 219 (zero-TEC condition); Efron and Morris (1973),
J. Am. Stat. Assoc. 68, 117 (what is taken over of an effect whose variance the data tell).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.bias_samples import DECIMALS_TECU, BiasSamples, ReceiverBiasError
from vtff_iono.bias.pair_equations import (
    IntArray,
    PairEquations,
    PairSolution,
    count_pairs,
    jackknife_sigma,
    satellite_pairs,
    solve_pairs,
)
from vtff_iono.bias.profile_bias import ProfileBiases, profile_biases
from vtff_iono.geometry.mapping import (
    LOWEST_ORBIT,
    distinct_positions,
    foelsche_kirchengast_mapping,
    shell_height,
    thin_shell_mapping,
)

__all__ = ["BiasEstimate", "ReceiverBias", "content_sigma", "estimate_receiver_biases"]

# Shell heights on the ground, m: from the shell of the Klobuchar model to that of the maps of CODE
# (506.7 km).
_GROUND_SHELLS = (350e3, 400e3, 450e3, 500e3)
# Shell heights in orbit, as multiples of `shell_height`.
_ORBIT_SHELL_FACTORS = (0.8, 0.93, 1.07, 1.25)
# Limits of elevation.
_ELEVATIONS_DEG = (20.0, 25.0, 30.0)
# What is estimated of the horizontal structure, see `solve_pairs`: nothing, gradients, and the
# curvature, too.
_NO_STRUCTURE, _GRADIENTS, _CURVATURE = 0, 2, 3
# Interval of the epochs that are used, and length of the blocks of gradients and jackknife, s.
_GROUND_INTERVALS = (900.0, 3600.0)
_ORBIT_INTERVALS = (20.0, 1200.0)
_SHORTEST_INTERVAL = 20.0
# Short data use more of their epochs: at least this many intervals and this many blocks, so that
# the jackknife can leave some out.
_FEWEST_INTERVALS = 40.0
_FEWEST_BLOCKS = 6.0
_FEWEST_PAIRS = 50
# Fraction of the contents that may be negative for another reason than the bias.
_NEGATIVE_FRACTION = 0.01


@dataclass(frozen=True)
class ReceiverBias:
    """An estimated receiver bias.

    Parameters
    ----------
    bias_tecu, sigma_tecu : float
        Content that the receiver adds to every slant content, and its sigma from sampling and
        spread, TECU.
    sampling_sigma_tecu : float
        Median over the models of the sigma from sampling: jackknife and levels, or the posterior
        density of a profile, TECU.
    spread_tecu : float
        Standard deviation of the solutions of the models, TECU.
    model_tecu : tuple of float
        Solutions of all models, TECU.
    is_bounded : bool
        True if the bias was reduced so that contents are not negative.
    pairs : int
        Number of pairs of samples that the largest solution used.
    satellite_sigma_tecu : float
        Sigma of the satellite biases, estimated from the samples, TECU; NaN if it was not
        estimated.
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
            Factor of the pair of signals, see `vtff_iono.links.geometry_free.tecu_per_metre`.
        """
        scale = 1.0 / (tecu_per_metre * SPEED_OF_LIGHT)
        return -self.bias_tecu * scale, self.sigma_tecu * scale


class BiasEstimate(NamedTuple):
    """Receiver biases, and what they were estimated with.

    Attributes
    ----------
    biases : list of ReceiverBias
        By the numbers of the groups.
    profile : ProfileBiases or None
        The solution with a density profile if the biases are those of it: it also tells the offsets
        of arcs.
    """

    biases: list[ReceiverBias]
    profile: ProfileBiases | None


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
        Sigmas of contents that still contain the bias of the receiver, and the contribution of the
        satellite biases to them as stated by their source. Where a receiver bias comes with an
        estimated sigma of the satellite biases, this replaces the contribution.
    biases : sequence of ReceiverBias or None
        Receiver biases; None has no sigma.
    number : ndarray of int, shape (n,)
        Index in `biases` of the bias of each content; -1 for none.
    """
    no_sigmas = (0.0, math.nan)
    sigmas = [
        no_sigmas if bias is None else (bias.sigma_tecu, bias.satellite_sigma_tecu)
        for bias in biases
    ]
    receiver, estimated = np.array([*sigmas, no_sigmas])[number].T
    replaced = np.where(np.isnan(estimated), 0.0, np.nan_to_num(satellite_sigma_tecu))
    remaining = np.maximum(stec_sigma_tecu**2 - replaced**2, 0.0)
    return np.asarray(np.sqrt(remaining + np.nan_to_num(estimated) ** 2 + receiver**2))


def estimate_receiver_biases(
    samples: BiasSamples, before: ProfileBiases | None = None
) -> BiasEstimate:
    """Return the biases of all groups that make the vertical contents of an epoch agree.

    Parameters
    ----------
    samples : BiasSamples
        Contents of a day on the ground, or of some revolutions in orbit.
    before : ProfileBiases, optional
        Profile of an earlier estimate of the same receiver, from which the search begins.

    Raises
    ------
    ReceiverBiasError
        If there are fewer than 50 pairs of satellites above the highest limit of elevation.
    """
    positions, number = distinct_positions(samples.position_receiver_itrf)
    altitude = geodetic_from_itrf(positions)[number, 2]
    is_ground = len(altitude) > 0 and bool(np.median(altitude) < LOWEST_ORBIT)
    interval, block = _GROUND_INTERVALS if is_ground else _ORBIT_INTERVALS
    duration = float(np.ptp(samples.time)) if len(samples.time) else 0.0
    interval = min(interval, max(_SHORTEST_INTERVAL, duration / _FEWEST_INTERVALS))
    block = min(block, max(interval, duration / _FEWEST_BLOCKS))
    usable = np.isfinite(samples.stec_tecu) & np.isfinite(samples.stec_sigma_tecu)
    chosen = usable & _first_of_interval(samples.time, usable, interval)
    all_elevations, altitude_of_all = samples.select(chosen), altitude[chosen]
    usable &= samples.elevation >= math.radians(min(_ELEVATIONS_DEG))
    chosen = usable & _first_of_interval(samples.time, usable, interval)
    samples, altitude = samples.select(chosen), altitude[chosen]
    order = np.argsort(samples.time, kind="stable")
    samples, altitude = samples.select(order), altitude[order]
    if is_ground or samples.arc is None:
        first, second = satellite_pairs(samples.time)
        models = _models(samples, altitude, is_ground)
        solutions, sigmas = _solve_models(samples, models, first, second, block)
        return BiasEstimate(_combine_models(samples, solutions, sigmas, len(first)), None)
    is_high = samples.elevation >= math.radians(max(_ELEVATIONS_DEG))
    count = count_pairs(samples.time[is_high])
    if count < _FEWEST_PAIRS:
        raise ReceiverBiasError(_describe_few(count, max(_ELEVATIONS_DEG)))
    search = None if before is None else before.search
    profile = profile_biases(all_elevations, altitude_of_all, search)
    biases = _combine_models(
        samples, profile.bias_tecu, profile.sigma_tecu, count_pairs(samples.time)
    )
    satellite_sigma = round(profile.satellite_sigma_tecu, DECIMALS_TECU)
    biases = [replace(bias, satellite_sigma_tecu=satellite_sigma) for bias in biases]
    return BiasEstimate(biases, profile)


def _describe_few(count: int, elevation_deg: float) -> str:
    """Return why no bias is estimated from a number of pairs above an elevation."""
    return (
        f"receiver bias: only {count} pairs of satellites above {elevation_deg:g} deg; "
        f"at least {_FEWEST_PAIRS} are needed"
    )


def _solve_models(
    samples: BiasSamples,
    models: list[tuple[FloatArray, FloatArray]],
    first: IntArray,
    second: IntArray,
    block: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the biases and jackknife sigmas of all models, (models, groups)."""
    plain, gradients, curved = [], [], []
    for mapping, pierce_altitude in models:
        equations = PairEquations(samples, mapping, pierce_altitude, first, second, block)
        for elevation_deg in _ELEVATIONS_DEG:
            above = equations.above(math.radians(elevation_deg))
            count = len(above.difference)
            if count < _FEWEST_PAIRS or above.block[0] == above.block[-1]:
                raise ReceiverBiasError(
                    f"{_describe_few(count, elevation_deg)}, in two blocks of {block:g} s"
                )
            plain.append(solve_pairs(above, _NO_STRUCTURE))
            gradients.append(solve_pairs(above, _GRADIENTS))
            curved.append(solve_pairs(above, _CURVATURE))
    part = _proven_part(gradients, curved)
    structures = plain, gradients, curved
    solutions = np.array([[one.bias_tecu for one in of_kind] for of_kind in structures])
    sigmas = np.array([[one.sigma_tecu for one in of_kind] for of_kind in structures])
    for values in (solutions, sigmas):
        # The sigma of a mean of two values is not larger than the mean of their sigmas.
        values[2] = values[1] + part * (values[2] - values[1])
    groups = solutions.shape[-1]
    return solutions.reshape(-1, groups), sigmas.reshape(-1, groups)


def _proven_part(without: Sequence[PairSolution], having: Sequence[PairSolution]) -> float:
    """Return the part that is taken over of what an effect changes of the biases, 0 to 1.

    Arguments are the solutions of all models without the effect, and having it.
    """
    pairs = list(zip(without, having, strict=True))
    change = np.array([other.bias_tecu - one.bias_tecu for one, other in pairs])
    sigma = np.array(
        [jackknife_sigma(other.left_out_tecu - one.left_out_tecu) for one, other in pairs]
    )
    square, variance = float(np.mean(change**2)), float(np.mean(sigma**2))
    return 1.0 - variance / square if variance < square else 0.0


def _combine_models(
    samples: BiasSamples, solutions: FloatArray, sigmas: FloatArray, pairs: int
) -> list[ReceiverBias]:
    """Return the biases from the solutions of all models, shape (models, groups)."""
    results = []
    for group in range(solutions.shape[1]):
        values = solutions[:, group]
        in_group = samples.group == group
        upper = samples.stec_tecu[in_group] + samples.stec_sigma_tecu[in_group]
        largest = float(np.quantile(upper, _NEGATIVE_FRACTION))
        mean = float(np.mean(values))
        bias = min(mean, largest)
        sampling = float(np.median(sigmas[:, group]))
        spread = float(np.std(values, ddof=1))
        results.append(
            ReceiverBias(
                bias_tecu=round(bias, DECIMALS_TECU),
                sigma_tecu=round(math.hypot(sampling, spread), DECIMALS_TECU),
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
    """Return which samples belong to the first usable epoch of each interval."""
    keys, inverse = np.unique(np.floor(time / interval), return_inverse=True)
    earliest = np.full(len(keys), np.inf)
    np.minimum.at(earliest, inverse[usable], time[usable])
    return np.asarray(time == earliest[inverse])


def _models(
    samples: BiasSamples, altitude: FloatArray, is_ground: bool
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the mapping factors and the altitudes of the pierce points for each shell height."""
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

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
that sigma smaller, see `vtff_iono.bias.profile_bias`.

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
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.bias.pair_equations import IntArray, PairEquations, satellite_pairs, solve_pairs
from vtff_iono.bias.profile_bias import ProfileBiases, profile_biases
from vtff_iono.geometry.mapping import (
    LOWEST_ORBIT,
    foelsche_kirchengast_mapping,
    shell_height,
    thin_shell_mapping,
)

__all__ = ["ReceiverBias", "content_sigma", "estimate_receiver_biases"]

_GROUND_SHELLS = (350e3, 400e3, 450e3, 500e3)
"""m; from the shell of the Klobuchar model to that of the maps of CODE (506.7 km)."""
_ORBIT_SHELL_FACTORS = (0.8, 0.93, 1.07, 1.25)
_ELEVATIONS_DEG = (20.0, 25.0, 30.0)
# Interval of the epochs that are used, and of blocks: gradients, jackknife. s.
_GROUND_INTERVALS = (900.0, 3600.0)
_ORBIT_INTERVALS = (20.0, 1200.0)
_SHORTEST_INTERVAL = 20.0
_FEWEST_PAIRS = 50
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
            Of the pair of signals, see `vtff_iono.links.geometry_free.tecu_per_metre`.
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
    first, second = satellite_pairs(samples.time)
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
        equations = PairEquations(samples, mapping, pierce_altitude, first, second, block)
        for elevation_deg in _ELEVATIONS_DEG:
            part = equations.above(math.radians(elevation_deg))
            if len(part.difference) < _FEWEST_PAIRS or part.block[0] == part.block[-1]:
                raise ReceiverBiasError(
                    f"receiver bias: only {len(part.difference)} pairs of satellites above "
                    f"{elevation_deg:g} deg, {_FEWEST_PAIRS} are needed at two times at least"
                )
            for with_gradients in (False, True):
                biases, sigma = solve_pairs(part, with_gradients)
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

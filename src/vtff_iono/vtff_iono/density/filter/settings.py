"""Assumptions of the density filter, and the numbers that its compiled steps make of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.density.filter.kernels import CHANGE, COMMON, FIRST_SHAPE, LAYER, SHAPE_NUMBERS
from vtff_iono.geometry.satellite_geometry import ELEVATION_MASK_DEG

__all__ = ["DensitySettings", "FilterSettings", "filter_settings"]

# Places of the shape of the layer in the state, and those of all that describes the layer.
_SHAPE = slice(FIRST_SHAPE, FIRST_SHAPE + SHAPE_NUMBERS)
_LAYER = np.array(LAYER)
# Sigma of the shape of the layer, in its units, and of c, of which only the contents tell.
_ANY_SHAPE = 1.0


@dataclass(frozen=True)
class DensitySettings:
    """Assumptions of the filter.

    Parameters
    ----------
    elevation_mask : float
        Lowest elevation of a satellite at both spacecraft, rad.
    bias_sigma_tecu, bias_walk_tecu : float
        Sigma of b at first, TECU, and its random walk, TECU per square root of s. Lines of two
        receivers and two signals that drift smoothly by 0.5 mm in a quarter of an orbit.
    mapping_sigma, mapping_walk : float
        Sigma of a at first, and the random walk of a and c per square root of s.
    change_sigma : float
        Sigma of c, which never exceeds it.
    content_time : float
        Time over which the error of absolute contents is the same, s: that of the receiver bias.
    shape_sigma, shape_walk : float
        Sigma of the logarithms of the scale heights of the model layer below and above its peak,
        and of the altitude of the peak in units of `PEAK_UNIT`; their random walk per square root
        of s. Contents are linear in the shape for changes of this size only.
    mapping_noise : float
        Sigma of the error of G that is not common to all satellites, as a fraction of G.
    separation_minimum : float
        Smallest vertical separation at which a density is estimated, m.
    negative_sigmas : float
        A density this many sigmas below zero is impossible.
    gradient_sigma_tecu_per_deg : float
        Horizontal gradient of the vertical content between the spacecraft, along their track,
        until the contents of all directions have shown how large gradients are.
    outlier_sigmas, outlier_tecu : float
        A content that is off by more than both is none of this satellite with these integers: a
        cycle of both signals is 0.5, other pairs of small integers are 0.24 TECU and more.
    density_sigma : float
        A priori sigma of the density of each epoch, electrons per cubic metre: far more than there
        is, because what all epochs together would learn from it must be nothing.
    largest_sigma : float
        A density with a larger sigma is withheld, electrons per cubic metre.
    spare_satellites : int
        A density is withheld, and nothing is learned from its contents, unless there are so many
        satellites more than states in common that are not known: a single wrong integer could not
        be told from the right ones. A satellite whose noise hides a wrong integer does not count,
        nor does one whose content has just chosen its integers.
        What the past has told to better than `outlier_tecu` is known, as a rule b and a, once as
        many satellites as are needed without a past have agreed.
    """

    elevation_mask: float = math.radians(ELEVATION_MASK_DEG)
    bias_sigma_tecu: float = 100.0
    bias_walk_tecu: float = 1e-4
    mapping_sigma: float = 2.0
    mapping_walk: float = 0.002
    change_sigma: float = 0.1
    content_time: float = 3600.0
    shape_sigma: float = 0.15
    shape_walk: float = 0.003
    mapping_noise: float = 0.01
    separation_minimum: float = 20.0
    negative_sigmas: float = 2.0
    gradient_sigma_tecu_per_deg: float = 0.02
    outlier_sigmas: float = 5.0
    outlier_tecu: float = 0.1
    density_sigma: float = 1e14
    largest_sigma: float = 1e12
    spare_satellites: int = 2


class FilterSettings(NamedTuple):
    """Numbers of `DensitySettings` that compiled functions use, and what follows from them.

    Attributes
    ----------
    elevation_mask, mapping_noise, content_time, negative_sigmas, outlier_sigmas, outlier_tecu,
    largest_sigma : float
    spare_satellites : int
        As in `DensitySettings`.
    density_variance : float
        A priori variance of the density, (TECU/m)^2.
    first_variance : ndarray, shape (5,)
        Variances of what describes the layer before any content.
    loose_sigma : ndarray, shape (COMMON,)
        Sigmas of common states of which only the contents tell.
    walk : ndarray, shape (COMMON + 1,)
        Variance that each common state gains in a second; none that the slow errors gain.
    """

    elevation_mask: float
    mapping_noise: float
    content_time: float
    negative_sigmas: float
    outlier_sigmas: float
    outlier_tecu: float
    largest_sigma: float
    spare_satellites: int
    density_variance: float
    first_variance: FloatArray
    loose_sigma: FloatArray
    walk: FloatArray


def filter_settings(settings: DensitySettings) -> FilterSettings:
    """Return the numbers that compiled functions use."""
    # Variance that each common state gains in a second; none that the slow errors gain.
    walk = np.zeros(COMMON + 1)
    walk[0] = settings.bias_walk_tecu**2
    walk[1] = walk[CHANGE] = settings.mapping_walk**2
    walk[_SHAPE] = settings.shape_walk**2
    sigmas = [settings.mapping_sigma, *[settings.shape_sigma] * 3, settings.change_sigma]
    first_variance = np.array(sigmas) ** 2
    loose_sigma = np.full(COMMON, math.inf)
    loose_sigma[_LAYER] = settings.mapping_sigma, *[_ANY_SHAPE] * 4
    return FilterSettings(
        settings.elevation_mask,
        settings.mapping_noise,
        settings.content_time,
        settings.negative_sigmas,
        settings.outlier_sigmas,
        settings.outlier_tecu,
        settings.largest_sigma,
        settings.spare_satellites,
        (settings.density_sigma / ELECTRONS_PER_TECU) ** 2,
        first_variance,
        loose_sigma,
        walk,
    )

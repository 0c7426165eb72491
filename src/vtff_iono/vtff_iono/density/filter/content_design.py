"""Compiled design of a second: derivatives with respect to the state, and modelled contents.

The equation of the contents, and what its states are, is that of
`vtff_iono.density.electron_density`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.bias.running_profile import CONSTANT, SHAPE, SIZE, mean_between, means_of_samples
from vtff_iono.density.filter.kernels import CHANGE, COMMON, DENSITY, FIRST_SHAPE, SHAPE_NUMBERS
from vtff_iono.geometry.mapping import set_ray_weights

__all__ = [
    "RayTable",
    "content_design",
    "elevation_functions",
    "empty_rays",
    "find_rays",
    "vertical_design",
]

# First row of the shape in `RunningProfile.densities`.
_SHAPE_ROW: int = SHAPE.start
_DENSITIES = 6
# Cosine of the elevation of the zenith.
_COSINE_OF_ZENITH = float(np.cos(0.5 * np.pi))


class RayTable(NamedTuple):
    """Rays of a second, and what each density of a profile adds to their contents.

    Attributes
    ----------
    perigee, radius : ndarray, shape (m,)
        As in `vtff_iono.geometry.mapping.contents_of_rays`, m.
    weight : ndarray, shape (m, n)
        Lengths that the densities are multiplied with, m.
    filled : ndarray of int64, shape (1,)
        Number of rays; the rows behind are free.
    """

    perigee: FloatArray
    radius: FloatArray
    weight: FloatArray
    filled: npt.NDArray[np.int64]


def empty_rays(most: int, altitudes: int) -> RayTable:
    """Return a table with room for some rays through a profile of some altitudes."""
    return RayTable(
        np.zeros(most),
        np.zeros(most),
        np.zeros((most, altitudes)),
        np.zeros(1, dtype=np.int64),
    )


def elevation_functions(
    elevation_chief: FloatArray, elevation_deputy: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the cosines of elevations at both spacecraft, and the sines of their means, (n,).

    They are functions of numpy, whose last bits differ from those of the C library in compiled
    loops where a processor has AVX-512.
    """
    mean = 0.5 * (elevation_chief + elevation_deputy)
    return np.cos(elevation_chief), np.cos(elevation_deputy), np.sin(mean)


@compiled
def _set_layer_design(design, contents, size):  # type: ignore[no-untyped-def]
    """Set the derivatives (COMMON,) of a content of the layer, in place.

    `contents` are those of each of `RunningProfile.densities`, (6,); `size` is a in the state.
    """
    design[0], design[1] = contents[CONSTANT], contents[SIZE]
    design[DENSITY] = 0.0
    # What is not measured is the model, its shape changed, times 1 + a.
    for number in range(SHAPE_NUMBERS):
        design[FIRST_SHAPE + number] = (1.0 + size) * contents[_SHAPE_ROW + number]
    design[CHANGE] = contents[0]


@compiled
def find_rays(rays, perigee, radius, altitude):  # type: ignore[no-untyped-def]
    """Return the rows of rays in a table of rays, (m,), into which new ones are put.

    Rays of an earlier place of the chief are forgotten: the same rays serve for the contents that
    are measured in a second and for those that are predicted of it.

    Parameters
    ----------
    rays : RayTable
        It has room for all rays of a second.
    perigee, radius : ndarray, shape (m,)
        As in `vtff_iono.geometry.mapping.contents_of_rays`; the chief comes first.
    altitude : ndarray, shape (n,)
        Altitudes of the profile, m.
    """
    is_full = rays.filled[0] + len(perigee) > len(rays.perigee)
    if is_full or rays.radius[0] != radius[0]:
        rays.filled[0] = 0
    found = np.empty(len(perigee), dtype=np.int64)
    for ray in range(len(perigee)):
        row = 0
        while row < rays.filled[0] and not (
            rays.perigee[row] == perigee[ray] and rays.radius[row] == radius[ray]
        ):
            row += 1
        if row == rays.filled[0]:
            rays.perigee[row], rays.radius[row] = perigee[ray], radius[ray]
            set_ray_weights(perigee[ray], radius[ray], altitude, rays.weight[row])
            rays.filled[0] += 1
        found[ray] = row
    return found


@compiled
def _set_contents(rays, row, densities, contents):  # type: ignore[no-untyped-def]
    """Set the contents of a ray, TECU, of each row of densities (6, n), in place, (6,)."""
    for kind in range(len(densities)):
        contents[kind] = densities[kind] @ rays.weight[row] / ELECTRONS_PER_TECU


@compiled
def content_design(  # type: ignore[no-untyped-def]
    cosine_chief, cosine_deputy, sine, altitude_chief, altitude_deputy, table, rays, state
):
    """Return the derivatives of differential contents, and the contents that are modelled.

    Parameters
    ----------
    cosine_chief, cosine_deputy, sine : ndarray, shape (n,)
        As of `elevation_functions`.
    altitude_chief, altitude_deputy : float
        m.
    table : ProfileTable
    rays : RayTable
    state : ndarray, shape (m,)

    Returns
    -------
    common : ndarray, shape (n, COMMON)
        Derivatives with respect to the common states. That with respect to c is the modelled
        content: G, and the density of the profile between the spacecraft.
    modelled : ndarray, shape (n,)
        Contents, TECU, of a state that is zero but for the profile's own b: what of the profile
        changes with b is in the product of derivative and state, too.
    """
    count, altitude, densities = len(cosine_chief), table.altitude, table.densities
    perigee, radius = np.empty(2 * count), np.empty(2 * count)
    for row in range(count):
        radius[row] = WGS84_SEMI_MAJOR_AXIS + altitude_chief
        radius[count + row] = WGS84_SEMI_MAJOR_AXIS + altitude_deputy
        perigee[row] = radius[row] * cosine_chief[row]
        perigee[count + row] = radius[count + row] * cosine_deputy[row]
    found = find_rays(rays, perigee, radius, altitude)
    low, high = min(altitude_chief, altitude_deputy), max(altitude_chief, altitude_deputy)
    between = np.empty(_DENSITIES)
    between[0] = mean_between(low, high, altitude, densities[0])
    between[1:] = means_of_samples(low, high, altitude, densities[1:])
    common, modelled = np.empty((count, COMMON)), np.empty(count)
    of_chief, difference = np.empty(_DENSITIES), np.empty(_DENSITIES)
    for row in range(count):
        path = (altitude_deputy - altitude_chief) / sine[row]
        _set_contents(rays, found[row], densities, of_chief)
        _set_contents(rays, found[count + row], densities, difference)
        for kind in range(_DENSITIES):
            difference[kind] -= of_chief[kind]
            difference[kind] += between[kind] / ELECTRONS_PER_TECU * path
        _set_layer_design(common[row], difference, state[1])
        common[row, 0] += 1.0
        common[row, DENSITY] = -path
        modelled[row] = common[row, CHANGE] - (common[row, 0] - 1.0) * state[0]
    return common, modelled


@compiled
def vertical_design(altitude, table, rays, state):  # type: ignore[no-untyped-def]
    """Return the derivatives (1, m) of the vertical content above an altitude, and that content.

    `altitude` is in m, the content in TECU; the other arguments are those of `content_design`.
    """
    radius = np.full(1, WGS84_SEMI_MAJOR_AXIS + altitude)
    found = find_rays(rays, radius * _COSINE_OF_ZENITH, radius, table.altitude)
    contents, design = np.empty(_DENSITIES), np.zeros((1, len(state)))
    _set_contents(rays, found[0], table.densities, contents)
    _set_layer_design(design[0, :COMMON], contents, state[1])
    return design, contents[0] - contents[CONSTANT] * state[0]

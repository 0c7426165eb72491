"""Compiled design of a second: derivatives with respect to the state, and modelled contents.

The equation of the contents, and what its states are, is that of
`vtff_iono.density.electron_density`.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.bias.running_profile import CONSTANT, SHAPE, SIZE, mean_between, means_of_samples
from vtff_iono.density.kernels import CHANGE, COMMON, DENSITY, FIRST_SHAPE, SHAPE_NUMBERS
from vtff_iono.geometry.mapping import contents_of_rays

__all__ = ["content_design", "vertical_design"]

# First row of the shape in `RunningProfile.densities`.
_SHAPE_ROW: int = SHAPE.start
_DENSITIES = 6


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
def content_design(  # type: ignore[no-untyped-def]
    cosine, sine, altitude_chief, altitude_deputy, table, densities, state
):
    """Return the derivatives of differential contents, and the contents that are modelled.

    Parameters
    ----------
    cosine : ndarray, shape (2, n)
        Cosines of the elevations of the satellites at chief and deputy.
    sine : ndarray, shape (n,)
        Sines of the means of both elevations.
    altitude_chief, altitude_deputy : float
        m.
    table, densities : ndarray, shapes (k,), (6, k)
        `RunningProfile.altitude`, m, and `RunningProfile.densities`.
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
    count = cosine.shape[1]
    perigee, radius = np.empty(2 * count), np.empty(2 * count)
    for row in range(count):
        radius[row] = WGS84_SEMI_MAJOR_AXIS + altitude_chief
        radius[count + row] = WGS84_SEMI_MAJOR_AXIS + altitude_deputy
        perigee[row] = radius[row] * cosine[0, row]
        perigee[count + row] = radius[count + row] * cosine[1, row]
    contents = contents_of_rays(perigee, radius, table, densities)
    low, high = min(altitude_chief, altitude_deputy), max(altitude_chief, altitude_deputy)
    between = np.empty(_DENSITIES)
    between[0] = mean_between(low, high, table, densities[0])
    between[1:] = means_of_samples(low, high, table, densities[1:])
    common, modelled = np.empty((count, COMMON)), np.empty(count)
    difference = np.empty(_DENSITIES)
    for row in range(count):
        path = (altitude_deputy - altitude_chief) / sine[row]
        for kind in range(_DENSITIES):
            above = contents[kind, count + row] - contents[kind, row]
            difference[kind] = above + between[kind] / ELECTRONS_PER_TECU * path
        _set_layer_design(common[row], difference, state[1])
        common[row, 0] += 1.0
        common[row, DENSITY] = -path
        modelled[row] = common[row, CHANGE] - (common[row, 0] - 1.0) * state[0]
    return common, modelled


@compiled
def vertical_design(cosine, altitude, table, densities, state):  # type: ignore[no-untyped-def]
    """Return the derivatives (1, m) of the vertical content above an altitude, and that content.

    `cosine` is that of the elevation of the zenith, (1,), `altitude` in m, the content in TECU; the
    other arguments are those of `content_design`.
    """
    radius = np.empty(1)
    radius[0] = WGS84_SEMI_MAJOR_AXIS + altitude
    contents = contents_of_rays(radius * cosine, radius, table, densities)[:, 0].copy()
    design = np.zeros((1, len(state)))
    _set_layer_design(design[0, :COMMON], contents, state[1])
    return design, contents[0] - contents[CONSTANT] * state[0]

"""Density in shells of altitude: paths of rays through the shells, and the prior of the density.

In and near the range of altitudes of an orbit the shells are thin and their densities free. Far
above, the shells widen up to the orbits of the GNSS satellites, and the density is expected to fall
with a power of altitude whose exponent varies slowly. Where O+ dominates (its scale height is some
100 km, at altitudes of 500 to 700 km) the exponent is 4 to 8; in the plasmasphere, which is H+, it
is 2 to 4.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import WGS84_FLATTENING, WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU

__all__ = [
    "TopsideModel",
    "log_density_prior",
    "shell_edges",
    "shell_middles",
    "shell_paths",
    "vertical_contents",
]

# Thickness of the thin shells, m.
_STEP = 5e3
# Altitude of the orbits of GPS, m: the shells end there.
_HIGHEST = 20.2e6
# Ratio of the thicknesses of neighbouring wide shells, and their largest thickness as a fraction of
# the altitude.
_GROWTH = 1.15
_LARGEST_STEP = 0.12
# Highest altitude of the peak of the layer, m: above it the density falls with altitude.
_HIGHEST_PEAK = 500e3
# One sigma of the natural logarithm of the ratio of densities of neighbouring thin shells: bubbles
# have edges.
_THIN_SHELL_SIGMA = 1.0
# Mean and sigma of the natural logarithm of all densities: free within many orders of magnitude.
_LEVEL = math.log(1e11)
_LEVEL_SIGMA = 100.0


@dataclass(frozen=True)
class TopsideModel:
    """Expected decrease of density, as altitude to the power of minus `exponent`.

    Parameters
    ----------
    exponent, exponent_sigma : float
        Mean and one sigma of the exponent.
    correlation_length : float
        Correlation length of the exponent, in the natural logarithm of altitude.
    """

    exponent: float = 4.0
    exponent_sigma: float = 2.5
    correlation_length: float = 0.7


def shell_edges(altitude_low: float, altitude_high: float) -> FloatArray:
    """Return the edges of shells for an orbit between two altitudes (m), in m, increasing."""
    top = max(altitude_high, _HIGHEST_PEAK)
    low = math.floor(altitude_low / _STEP) * _STEP
    edges = np.arange(low, top + _STEP, _STEP).tolist()
    step = _STEP
    while edges[-1] < _HIGHEST:
        step = min(step * _GROWTH, _LARGEST_STEP * edges[-1])
        edges.append(edges[-1] + step)
    return np.array(edges)


def shell_middles(edges: FloatArray) -> FloatArray:
    """Return the altitudes of the middles of shells, m."""
    return 0.5 * (edges[1:] + edges[:-1])


def shell_paths(
    position_receiver_itrf: FloatArray,
    direction_itrf: FloatArray,
    altitude: FloatArray,
    edges: FloatArray,
) -> FloatArray:
    """Return content per density of rays in shells, TECU m^3, shape (n, shells).

    Parameters
    ----------
    position_receiver_itrf, direction_itrf : ndarray, shape (n, 3)
        Positions of the receivers, m, and unit vectors to satellites above the horizon.
    altitude : ndarray, shape (n,)
        Altitudes of the receivers, m.
    edges : ndarray, shape (shells + 1,)
        Edges of the shells, m.
    """
    of_rays = position_receiver_itrf, direction_itrf, altitude
    paths: FloatArray = _paths_through_shells(*map(np.ascontiguousarray, of_rays), edges)
    return paths


@compiled
def _paths_through_shells(position, direction, altitude, edges):  # type: ignore[no-untyped-def]
    """Return the paths that `shell_paths` describes."""
    paths = np.empty((len(position), len(edges) - 1))
    equatorial, polar = np.empty(len(edges)), np.empty(len(edges))
    for number in range(len(edges)):
        half_axis = WGS84_SEMI_MAJOR_AXIS + edges[number]
        equatorial[number] = 1.0 / half_axis**2
        polar[number] = 1.0 / (half_axis - WGS84_SEMI_MAJOR_AXIS * WGS84_FLATTENING) ** 2
    for row in range(len(position)):
        start, along = position[row], direction[row]
        # Squares and products of the components in the plane of the equator, and of the others.
        squares = start[0] ** 2 + start[1] ** 2, start[2] ** 2
        products = start[0] * along[0] + start[1] * along[1], start[2] * along[2]
        of_direction = along[0] ** 2 + along[1] ** 2, along[2] ** 2
        before = 0.0
        for number in range(len(edges)):
            distance = 0.0
            if not edges[number] <= altitude[row]:
                # The equation of `distance_of_ray`, of which it is the same sum.
                excess = squares[0] * equatorial[number] + squares[1] * polar[number] - 1.0
                # An edge within metres above the receiver may be an ellipsoid that passes below it.
                if excess <= 0.0:
                    mixed = products[0] * equatorial[number] + products[1] * polar[number]
                    square = of_direction[0] * equatorial[number] + of_direction[1] * polar[number]
                    distance = (math.sqrt(mixed * mixed - square * excess) - mixed) / square
            if number > 0:
                paths[row, number - 1] = (distance - before) / ELECTRONS_PER_TECU
            before = distance
    return paths


def vertical_contents(altitude: FloatArray, edges: FloatArray, density: FloatArray) -> FloatArray:
    """Return the vertical contents of shells above altitudes, TECU, shape (n,).

    Parameters
    ----------
    altitude : ndarray, shape (n,)
        Altitudes of receivers, m.
    edges, density : ndarray, shapes (shells + 1,) and (shells,)
        Edges of the shells, m, and their densities, electrons per cubic metre.
    """
    of_shells = density * np.diff(edges) / ELECTRONS_PER_TECU
    above_edge = np.concatenate((np.cumsum(of_shells[::-1])[::-1], [0.0]))
    # Linear in each shell; a receiver below all of them has their whole content.
    return np.interp(altitude, edges, above_edge)


def log_density_prior(
    edges: FloatArray, altitude_high: float, topside: TopsideModel
) -> tuple[FloatArray, FloatArray]:
    """Return precision (shells, shells) and precision times mean (shells,) of ln(density m^3).

    Parameters
    ----------
    edges : ndarray, shape (shells + 1,)
        Edges of the shells, m.
    altitude_high : float
        Highest altitude of the orbit, m.
    topside : TopsideModel
        Expected decrease of density above the orbit and the peak.
    """
    topmost = shell_middles(edges)[1:] > max(altitude_high, _HIGHEST_PEAK)
    first_topmost = int(np.count_nonzero(~topmost))
    precision, vector = _log_density_prior(edges.tobytes(), first_topmost, topside)
    return precision.copy(), vector.copy()


# As a rule the samples of a receiver have the shells of those of minutes ago.
@functools.lru_cache(maxsize=8)
def _log_density_prior(
    edges: bytes, first_topmost: int, topside: TopsideModel
) -> tuple[FloatArray, FloatArray]:
    """Return what `log_density_prior` does, always the same arrays.

    `edges` are its bytes, and `first_topmost` is the first of the topmost differences of shells.
    """
    middle = shell_middles(np.frombuffer(edges))
    count = len(middle)
    rise = np.diff(np.log(middle))
    topmost = np.arange(first_topmost, count - 1)
    mean = np.zeros(count - 1)
    mean[topmost] = -topside.exponent * rise[topmost]
    precision = np.eye(count - 1) / _THIN_SHELL_SIGMA**2
    log_altitude = np.log(middle[1:][topmost])
    distance = np.abs(log_altitude[:, np.newaxis] - log_altitude) / topside.correlation_length
    covariance = topside.exponent_sigma**2 * np.exp(-distance)
    covariance *= rise[topmost, np.newaxis] * rise[topmost]
    precision[np.ix_(topmost, topmost)] = np.linalg.inv(covariance)
    level = 1.0 / (count * _LEVEL_SIGMA**2)
    # D' Q D and D' Q times the mean, where D takes the differences of neighbours.
    matrix, vector = level * np.eye(count), np.full(count, level * _LEVEL)
    matrix[1:, 1:] += precision
    matrix[:-1, :-1] += precision
    matrix[1:, :-1] -= precision
    matrix[:-1, 1:] -= precision
    of_mean = precision @ mean
    vector[1:] += of_mean
    vector[:-1] -= of_mean
    return matrix, vector

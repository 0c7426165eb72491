"""Rectangular regions of irregular plasma: which rays cross them, and when.

A region is bounded by two geodetic latitudes, two local times and two geodetic heights. In ITRF
each of these six surfaces is a plane or a quadric, so that the points where a straight ray meets
them are roots of linear and quadratic equations; between two roots the ray is inside or outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import WGS84_FLATTENING, WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["IrregularityRegion", "path_length_in_region"]

BoolArray = npt.NDArray[np.bool_]

_SEMI_MINOR_AXIS = WGS84_SEMI_MAJOR_AXIS * (1.0 - WGS84_FLATTENING)
_ECCENTRICITY_SQUARED = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)


@dataclass(frozen=True)
class IrregularityRegion:
    """A cuboid in latitude, local time and altitude in which signals scintillate.

    Attributes
    ----------
    name : str
        Name in the truth file.
    latitude_south, latitude_north : float
        Geodetic latitudes of its sides, rad.
    local_time_start_hours, local_time_end_hours : float
        Mean solar local times (UT + longitude / 15 deg) of its western and eastern side, hours in
        [0, 24]; the region may span midnight (22 to 2). It stands still relative to the Sun.
    altitude_bottom, altitude_top : float
        Geodetic heights, m. The surfaces are ellipsoids with axes longer by the height, within
        0.5 m of constant height at 350 km and 1.3 m at 1000 km.
    s4 : float
        Amplitude scintillation index on GPS L1 of rays that cross it, 0 to 1.
    decorrelation_time : float
        Decorrelation time tau0 of the complex gain, s.
    taper_length : float
        Length of a ray inside from which on the full index holds, m: walls of the fluctuations.
    correlation : float
        Correlation of the scattered parts that two receivers meet at one point of the track.
    drift_east : float or None
        Speed of the plasma eastward over the Earth at its middle altitude, m/s. The local times are
        then those at the start of the run, and sides and pattern move together. None: the sides
        stand still relative to the Sun, and the pattern over the Earth.
    """

    name: str
    latitude_south: float
    latitude_north: float
    local_time_start_hours: float
    local_time_end_hours: float
    altitude_bottom: float
    altitude_top: float
    s4: float
    decorrelation_time: float
    taper_length: float = 5e3
    correlation: float = 1.0
    drift_east: float | None = None

    def __post_init__(self) -> None:
        """Refuse regions that have no meaning, naming region and field."""
        where = f"region {self.name!r}"
        quarter = 0.5 * math.pi
        if not -quarter <= self.latitude_south < self.latitude_north <= quarter:
            raise ValueError(f"{where}: latitude_south must be below latitude_north, within 90 deg")
        for field in ("local_time_start_hours", "local_time_end_hours"):
            if not 0.0 <= getattr(self, field) <= 24.0:
                raise ValueError(f"{where}: {field} must be within 0 and 24")
        if self.local_time_start_hours == self.local_time_end_hours:
            raise ValueError(f"{where}: local_time_start_hours equals local_time_end_hours")
        if not 0.0 <= self.altitude_bottom < self.altitude_top < math.inf:
            raise ValueError(f"{where}: altitude_bottom must be below altitude_top, not negative")
        if not 0.0 <= self.s4 <= 1.0:
            raise ValueError(f"{where}: s4 must be within 0 and 1, got {self.s4:g}")
        if not 0.0 < self.decorrelation_time < math.inf:
            raise ValueError(f"{where}: decorrelation_time must be positive")
        if not 0.0 < self.taper_length < math.inf:
            raise ValueError(f"{where}: taper_length must be positive")
        if not 0.0 <= self.correlation <= 1.0:
            raise ValueError(
                f"{where}: correlation must be within 0 and 1, got {self.correlation:g}"
            )
        if self.drift_east is not None and not math.isfinite(self.drift_east):
            raise ValueError(f"{where}: drift_east must be finite")

    def longitude_limits(self, time: GpsTime) -> tuple[float, float]:
        """Return the longitude (rad) of the western side at a time and the width (rad > 0)."""
        greenwich_hours = mean_solar_local_time_hours(time, 0.0)
        west = (self.local_time_start_hours - greenwich_hours) * math.pi / 12.0
        width_hours = (self.local_time_end_hours - self.local_time_start_hours) % 24.0
        return west, (width_hours or 24.0) * math.pi / 12.0

    def drift_angle(self, elapsed: npt.ArrayLike) -> FloatArray:
        """Return the longitude by which the plasma has moved east since the start, rad, (...).

        `elapsed` is the time since the start, s, of any shape.
        """
        radius = WGS84_SEMI_MAJOR_AXIS + 0.5 * (self.altitude_bottom + self.altitude_top)
        return np.asarray(elapsed, dtype=float) * (self.drift_east or 0.0) / radius

    def _contains(self, position: FloatArray, west: float, width: float) -> BoolArray:
        x, y, z = position[..., 0], position[..., 1], position[..., 2]
        inside = (np.arctan2(y, x) - west) % (2.0 * math.pi) <= width
        radius_equatorial = np.hypot(x, y)
        for latitude, sign in ((self.latitude_south, 1.0), (self.latitude_north, -1.0)):
            above = (z - _cone_apex(latitude)) * math.cos(latitude) - radius_equatorial * math.sin(
                latitude
            )
            inside &= sign * above >= 0.0
        for altitude, sign in ((self.altitude_bottom, 1.0), (self.altitude_top, -1.0)):
            major, minor = WGS84_SEMI_MAJOR_AXIS + altitude, _SEMI_MINOR_AXIS + altitude
            above = (radius_equatorial / major) ** 2 + (z / minor) ** 2 - 1.0
            inside &= sign * above >= 0.0
        result: BoolArray = inside
        return result


def path_length_in_region(
    region: IrregularityRegion,
    time: GpsTime,
    position_receiver_itrf: npt.ArrayLike,
    position_satellite_itrf: npt.ArrayLike,
) -> FloatArray:
    """Return how much of each straight ray lies inside a region.

    Parameters
    ----------
    region : IrregularityRegion
        The region.
    time : GpsTime
        Time that turns local time into longitude.
    position_receiver_itrf, position_satellite_itrf : array_like, shape (..., 3)
        Ends of the rays in ITRF, m; the shapes are broadcast together.

    Returns
    -------
    ndarray, shape (...)
        Length inside, m; a ray crosses the region if it is greater than zero.
    """
    receiver, satellite = np.broadcast_arrays(
        np.asarray(position_receiver_itrf, dtype=float),
        np.asarray(position_satellite_itrf, dtype=float),
    )
    ray = satellite - receiver
    west, width = region.longitude_limits(time)
    fractions = _surface_fractions(region, receiver, ray, west, width)
    middle = 0.5 * (fractions[1:] + fractions[:-1])
    inside = region._contains(receiver + middle[..., None] * ray, west, width)
    fraction = np.sum((fractions[1:] - fractions[:-1]) * inside, axis=0)
    length: FloatArray = fraction * np.sqrt(np.einsum("...i,...i->...", ray, ray))
    return length


def _cone_apex(latitude: float) -> float:
    """Return where the normals of all points of a geodetic latitude meet the polar axis, m."""
    sine = math.sin(latitude)
    curvature = WGS84_SEMI_MAJOR_AXIS / math.sqrt(1.0 - _ECCENTRICITY_SQUARED * sine * sine)
    return -_ECCENTRICITY_SQUARED * curvature * sine


def _surface_fractions(
    region: IrregularityRegion, receiver: FloatArray, ray: FloatArray, west: float, width: float
) -> FloatArray:
    """Return the sorted parts (k, ...) of the rays, 0 to 1, at which a surface may be crossed."""
    cuts = [np.zeros(ray.shape[:-1]), np.ones(ray.shape[:-1])]
    for longitude in (west, west + width):
        normal = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts.append(-(receiver @ normal) / (ray @ normal))
    for latitude in (region.latitude_south, region.latitude_north):
        # Points of this latitude: (z - apex)^2 cos^2 = (x^2 + y^2) sin^2.
        scale = np.array([-(math.sin(latitude) ** 2)] * 2 + [math.cos(latitude) ** 2])
        apex = np.array([0.0, 0.0, _cone_apex(latitude)])
        cuts += _quadric_fractions(receiver - apex, ray, scale, 0.0)
    for altitude in (region.altitude_bottom, region.altitude_top):
        axes = np.array([WGS84_SEMI_MAJOR_AXIS] * 2 + [_SEMI_MINOR_AXIS]) + altitude
        cuts += _quadric_fractions(receiver, ray, axes**-2.0, 1.0)
    # fmin and fmax also put the NaN of a ray parallel to a plane at an end.
    fractions = np.fmax(np.fmin(np.array(cuts), 1.0), 0.0)
    fractions.sort(axis=0)
    return fractions


def _quadric_fractions(
    start: FloatArray, ray: FloatArray, scale: FloatArray, level: float
) -> list[FloatArray]:
    """Return the two roots t of sum(scale (start + t ray)^2) = level.

    Where there is none the place of the nearest approach is returned, which as a cut does no harm.
    At the equator the cone is a plane and both roots fall together, with either sign of rounding.
    """
    a = (ray * ray) @ scale
    b = (start * ray) @ scale
    c = (start * start) @ scale - level
    with np.errstate(divide="ignore", invalid="ignore"):
        # The sum without cancellation; the other root follows from the product of both.
        q = -(b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b))
        return [q / a, c / q]

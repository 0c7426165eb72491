"""Contents that a density profile with its gradients lets expect of further rays.

A satellite that has just risen has hardly been measured by its codes, while the contents of the
others tell the ionosphere that its ray passes (`vtff_iono.bias.profile_bias`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.bias.altitude_shells import shell_middles, shell_paths, vertical_contents
from vtff_iono.geometry.mapping import pierce_point, shell_height

__all__ = [
    "GRADIENT_UNIT",
    "HIGH_SHELL",
    "ExpectedContents",
    "HorizontalLayers",
    "Knots",
    "pierce_offsets",
]

GRADIENT_UNIT = 1e6
"""Unit of the distance of pierce points, m."""

HIGH_SHELL = 1000e3
"""Altitude of the shell of the higher layer, m."""

# Longest interval of knots, s: an orbit passes 20 deg meanwhile.
_KNOT_INTERVAL = 300.0
# Least height of the shell of the higher layer above a receiver, m.
_HIGH_SHELL_ABOVE = 100e3
# By how much a profile is continued downwards, and the part of it that tells how, m.
_CONTINUED, _LOWEST_PART = 100e3, 50e3


class Knots(NamedTuple):
    """Evenly spaced times, linear in between.

    Attributes
    ----------
    begin, interval : float
        Time of the first knot, and the time from each to the next, s.
    number : int
    """

    begin: float
    interval: float
    number: int

    @classmethod
    def over(cls, time: FloatArray) -> Knots:
        """Return knots from the first to the last time (s), each 300 s or less."""
        span = max(float(np.ptp(time)), 1.0)
        intervals = math.ceil(span / _KNOT_INTERVAL)
        return cls(float(time.min()), span / intervals, intervals + 1)

    def weights(self, time: FloatArray) -> FloatArray:
        """Return the weights of the knots at times (n,), s, shape (n, knots).

        Their sum is one between the first and the last knot. It falls to zero within an interval
        after the last one: nothing is known of the next one, whose expectation is zero.
        """
        position = (time - self.begin) / self.interval
        distance = np.abs(position[:, np.newaxis] - np.arange(self.number))
        return np.asarray(np.maximum(0.0, 1.0 - distance))


@dataclass(frozen=True, eq=False)
class ExpectedContents:
    """Contents of rays by a profile.

    Parameters
    ----------
    edges : ndarray, shape (shells + 1,)
        Edges of the shells of the profile, m.
    density : ndarray, shape (shells,)
        Density of the shells, electrons per cubic metre.
    knots : Knots
    vertical_tecu : ndarray, shape (6 knots,)
        Vertical contents that the shells lack at the knots, TECU, and their gradients to the east
        and to the north, TECU per 1000 km, in the order of `HorizontalLayers.columns`.
    arc_sigma : float
        Sigma of what is particular to an arc, relative to its content.
    """

    edges: FloatArray
    density: FloatArray
    knots: Knots
    vertical_tecu: FloatArray
    arc_sigma: float

    def continued_below(self) -> ExpectedContents:
        """Return the contents of receivers that may fall below the profile, by 100 km at most.

        The density there continues the exponential through the lowest 50 km.
        """
        middle, step = shell_middles(self.edges), self.edges[1] - self.edges[0]
        below = step * np.arange(-math.ceil(_CONTINUED / step), 0)
        lowest = middle < self.edges[0] + _LOWEST_PART
        line = np.polyfit(middle[lowest], np.log(self.density[lowest]), 1)
        density = np.exp(np.polyval(line, middle[0] + below))
        return replace(
            self,
            edges=np.concatenate((self.edges[0] + below, self.edges)),
            density=np.concatenate((density, self.density)),
        )

    def contents(
        self, time: FloatArray, position_receiver_itrf: FloatArray, direction_itrf: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return slant contents, TECU, and slant over vertical contents, shape (n,).

        Parameters
        ----------
        time : ndarray, shape (n,)
            s, counted as that of the samples of the profile.
        position_receiver_itrf, direction_itrf : ndarray, shape (n, 3)
            Positions of the receiver, m, and unit vectors to satellites above the horizon.
        """
        altitude = geodetic_from_itrf(position_receiver_itrf)[:, 2]
        paths = shell_paths(position_receiver_itrf, direction_itrf, altitude, self.edges)
        content = paths @ self.density
        mapping = content / vertical_contents(altitude, self.edges, self.density)
        layers = HorizontalLayers.of_rays(position_receiver_itrf, direction_itrf, altitude)
        columns = layers.columns(self.knots.weights(time), mapping)
        return content + columns @ self.vertical_tecu, mapping


class HorizontalLayers(NamedTuple):
    """Two layers in which the vertical content of n rays departs from that of a profile.

    The lower one has the mapping of the profile. The higher one is a thin shell: electrons high
    above a receiver near the peak are passed by low rays a thousand kilometres farther away.

    Attributes
    ----------
    offset_low, offset_high : ndarray, shape (n, 2)
        Offsets of the pierce points from the receivers to the east and north, 1000 km.
    mapping_high : ndarray, shape (n,)
        Slant over vertical content of the shell.
    """

    offset_low: FloatArray
    offset_high: FloatArray
    mapping_high: FloatArray

    @classmethod
    def of_rays(
        cls,
        position_receiver_itrf: FloatArray,
        direction_itrf: FloatArray,
        altitude: FloatArray,
        shell_altitude: float = HIGH_SHELL,
    ) -> HorizontalLayers:
        """Return the layers that rays pass; arguments as those of `pierce_offsets`.

        `shell_altitude` is that of the higher layer, m; it is 100 km above a higher receiver.
        """
        offset_low = pierce_offsets(position_receiver_itrf, direction_itrf, altitude)
        layers = cls(offset_low, np.zeros((0, 2)), np.zeros(0))
        return layers.with_shell(position_receiver_itrf, direction_itrf, altitude, shell_altitude)

    def with_shell(
        self,
        position_receiver_itrf: FloatArray,
        direction_itrf: FloatArray,
        altitude: FloatArray,
        shell_altitude: float,
    ) -> HorizontalLayers:
        """Return the layers of the same rays with another higher one, as `of_rays`."""
        shell = np.maximum(shell_altitude, altitude + _HIGH_SHELL_ABOVE)
        point = pierce_point(position_receiver_itrf, direction_itrf, shell)
        cosine = np.sum(point * direction_itrf, axis=-1) / np.linalg.norm(point, axis=-1)
        offset_high = _horizontal_offsets(position_receiver_itrf, point)
        return HorizontalLayers(self.offset_low, offset_high, 1.0 / cosine)

    def columns(self, weights: FloatArray, mapping: FloatArray, more: int = 0) -> FloatArray:
        """Return the contents of unit departures, shape (n, 6 knots + more).

        They are, at each knot, of the lower layer the vertical content and its gradients to the
        east and to the north, then those of the higher layer.

        Parameters
        ----------
        weights : ndarray, shape (n, knots)
            Weights of the knots, see `Knots.weights`.
        mapping : ndarray, shape (n,)
            Slant over vertical content of the profile.
        more : int
            Number of columns of zeros that follow, for effects that have no knots.
        """
        columns: FloatArray = _columns_at_knots(
            weights, mapping, self.offset_low, self.mapping_high, self.offset_high, more
        )
        return columns

    def means(self, mapping: FloatArray) -> FloatArray:
        """Return the contents of departures that are the same at all knots, shape (n, 6).

        They are the sums of `columns` over the knots, whose weights have the sum one.
        """
        parts = []
        for factor, offset in ((mapping, self.offset_low), (self.mapping_high, self.offset_high)):
            parts += [factor, factor * offset[:, 0], factor * offset[:, 1]]
        return np.stack(parts, axis=-1)


@compiled
def _columns_at_knots(  # type: ignore[no-untyped-def]
    weights, mapping_low, offset_low, mapping_high, offset_high, more
):
    """Return the columns that `HorizontalLayers.columns` describes, of two mappings and offsets."""
    rows, knots = weights.shape
    columns = np.zeros((rows, 6 * knots + more))
    for row in range(rows):
        for knot in range(knots):
            weight = weights[row, knot]
            # Two knots at most have a weight.
            if weight == 0.0:
                continue
            low, high = mapping_low[row] * weight, mapping_high[row] * weight
            columns[row, knot] = low
            columns[row, knots + knot] = low * offset_low[row, 0]
            columns[row, 2 * knots + knot] = low * offset_low[row, 1]
            columns[row, 3 * knots + knot] = high
            columns[row, 4 * knots + knot] = high * offset_high[row, 0]
            columns[row, 5 * knots + knot] = high * offset_high[row, 1]
    return columns


def pierce_offsets(
    position_receiver_itrf: FloatArray, direction_itrf: FloatArray, altitude: FloatArray
) -> FloatArray:
    """Return the offsets of pierce points from receivers to the east and north, 1000 km, (n, 2).

    Parameters
    ----------
    position_receiver_itrf, direction_itrf : ndarray, shape (n, 3)
        Positions of the receivers, m, and unit vectors to satellites above the horizon.
    altitude : ndarray, shape (n,)
        Altitudes of the receivers, m. Rays pierce the middle of the shell above.
    """
    receiver = position_receiver_itrf
    point = pierce_point(receiver, direction_itrf, altitude + 0.5 * shell_height(altitude))
    return _horizontal_offsets(receiver, point)


def _horizontal_offsets(receiver: FloatArray, point: FloatArray) -> FloatArray:
    """Return the offsets of points (n, 3) from receivers to the east and north, 1000 km, (n, 2)."""
    offset = (point - receiver) / GRADIENT_UNIT
    radius = np.hypot(receiver[:, 0], receiver[:, 1])
    # Unit vectors to the east and to the north, the latter at right angles to the receiver.
    east = np.stack((-receiver[:, 1], receiver[:, 0]), axis=-1) / radius[:, np.newaxis]
    inward = -receiver[:, 2] / radius
    north = np.stack((inward * receiver[:, 0], inward * receiver[:, 1], radius), axis=-1)
    north /= np.linalg.norm(receiver, axis=-1, keepdims=True)
    columns = (offset[:, :2] * east).sum(axis=-1), (offset * north).sum(axis=-1)
    return np.asarray(np.stack(columns, axis=-1))

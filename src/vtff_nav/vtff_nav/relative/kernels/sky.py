"""Contents of the plasma along the rays of an epoch, compiled.

An array operation on a dozen rays costs twenty times what its arithmetic does.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_gnss.constants import DELAY_PER_TECU, ELECTRONS_PER_TECU

__all__ = [
    "DENSITY_UNIT",
    "move_over_ground",
    "north_and_east",
    "plasma_paths",
    "shell_paths",
    "sky_columns",
]

DENSITY_UNIT = 1e12
"""Electrons per m3 in the unit of the states ``("plasma", layer)``."""

_PATH_UNIT = DENSITY_UNIT / ELECTRONS_PER_TECU


@compiled
def plasma_paths(radius, rise, elevation, layers):  # type: ignore[no-untyped-def]
    """Return the differential slant content of layers of constant density, shape (n, layers).

    Parameters
    ----------
    radius : float
        Distance of the chief from the centre of the Earth, m.
    rise : float
        Height of the deputy above the chief, m.
    elevation : ndarray, shape (2, n)
        Elevation at chief and deputy, rad.
    layers : ndarray
        Thicknesses of the layers above the chief, m.

    Returns
    -------
    ndarray
        TECU for a density of `DENSITY_UNIT`: ``sqrt((R + L)^2 - (r cos E)^2) - r sin E``, deputy
        less chief.

    Notes
    -----
    This is the whole effect of a spherical layer that reaches below both receivers. One part is the
    path between the two altitudes, ``-rise / sin E``, which is all at high elevations. The other
    part comes from the path above, which differs because elevation and altitude do. Four layers
    reproduce Chapman and constant profiles above 5 deg to 0.1 mTECU at 250 m and 2 mTECU at 5 km;
    the plane slab alone is wrong by 75 mTECU.
    """
    count = elevation.shape[1]
    columns = np.empty((count, len(layers)))
    for n in range(count):
        chief_across, chief_down = radius * math.cos(elevation[0, n]), math.sin(elevation[0, n])
        deputy_across = (radius + rise) * math.cos(elevation[1, n])
        down = (radius + rise) * math.sin(elevation[1, n]) - radius * chief_down
        for layer in range(len(layers)):
            top = (radius + layers[layer]) ** 2
            path = math.sqrt(top - deputy_across**2) - math.sqrt(top - chief_across**2)
            columns[n, layer] = _PATH_UNIT * (path - down)
    return columns


@compiled
def shell_paths(positions, direction, heights):  # type: ignore[no-untyped-def]
    """Return the differential slant content of shells whose content differs from place to place.

    Parameters
    ----------
    positions : ndarray, shape (2, 3)
        Chief and deputy, m; the third axis is that of the Earth.
    direction : ndarray, shape (2, n, 3)
        Unit vectors to the satellites, same axes.
    heights : ndarray
        Heights of the shells above the chief, m.

    Returns
    -------
    ndarray, shape (n, 3 shells)
        TECU, deputy less chief, of each shell: for a vertical content of 1 TECU everywhere, and for
        one that grows by 1 TECU/deg to north or to east from zero above the chief. The vertical
        content is divided by the sine of the elevation where a ray pierces the shell (single-layer
        model, Schaer 1999, section 2.3.3).
    """
    count = direction.shape[1]
    columns = np.zeros((count, 3 * len(heights)))
    axes = north_and_east(positions[0])
    radius_chief = 0.0
    for receiver in range(2):
        sign = 2.0 * receiver - 1.0
        position = positions[receiver]
        radius = math.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
        if receiver == 0:
            radius_chief = radius
        north = axes[0, 0] * position[0] + axes[0, 1] * position[1] + axes[0, 2] * position[2]
        east = axes[1, 0] * position[0] + axes[1, 1] * position[1] + axes[1, 2] * position[2]
        for n in range(count):
            ray = direction[receiver, n]
            up = (position[0] * ray[0] + position[1] * ray[1] + position[2] * ray[2]) / radius
            ray_north = axes[0, 0] * ray[0] + axes[0, 1] * ray[1] + axes[0, 2] * ray[2]
            ray_east = axes[1, 0] * ray[0] + axes[1, 1] * ray[1] + axes[1, 2] * ray[2]
            for index in range(len(heights)):
                shell = radius_chief + heights[index]
                up_there = math.sqrt(1.0 - (radius / shell) ** 2 * (1.0 - up**2))
                distance = shell * up_there - radius * up
                # Receiver and ray along north and east: their sum is where the ray pierces.
                pierce_north = (north + distance * ray_north) / shell
                pierce_east = (east + distance * ray_east) / shell
                scale = sign / up_there
                columns[n, 3 * index] += scale
                columns[n, 3 * index + 1] += scale * math.degrees(
                    math.asin(min(max(pierce_north, -1.0), 1.0))
                )
                columns[n, 3 * index + 2] += scale * math.degrees(
                    math.asin(min(max(pierce_east, -1.0), 1.0))
                )
    return columns


@compiled
def north_and_east(position):  # type: ignore[no-untyped-def]
    """Return unit vectors to north and east at a position, shape (2, 3), in its axes.

    The third axis is that of the Earth; at the poles, where there is no north, east is zero.
    """
    radius = math.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
    x, y, z = position[0] / radius, position[1] / radius, position[2] / radius
    scale = 1.0 / max(math.sqrt(x * x + y * y), 1e-6)
    east_x, east_y = -scale * y, scale * x
    axes = np.empty((2, 3))
    axes[0, 0], axes[0, 1], axes[0, 2] = -z * east_y, z * east_x, x * east_y - y * east_x
    axes[1, 0], axes[1, 1], axes[1, 2] = east_x, east_y, 0.0
    return axes


@compiled
def move_over_ground(before, after, turn):  # type: ignore[no-untyped-def]
    """Return axes to north and east (2, 3), and by what the zenith has moved over ground, (3,).

    Parameters
    ----------
    before, after : ndarray, shape (3,)
        Positions, m.
    turn : float
        By which the Earth has turned in their axes, rad.
    """
    zenith, moved = np.empty(3), np.empty(3)
    radius = math.sqrt(before[0] * before[0] + before[1] * before[1] + before[2] * before[2])
    radius_after = math.sqrt(after[0] * after[0] + after[1] * after[1] + after[2] * after[2])
    for axis in range(3):
        zenith[axis] = before[axis] / radius
        moved[axis] = after[axis] / radius_after - zenith[axis]
    moved[0] -= turn * -zenith[1]
    moved[1] -= turn * zenith[0]
    return north_and_east(before), moved


@compiled
def sky_columns(  # type: ignore[no-untyped-def]
    columns,
    ranges,
    clock,
    range_rate,
    direction,
    elevation,
    positions,
    radius,
    rise,
    layers,
    shells,
    frequency_hz,
):
    """Return the rays of single differences, out of those to all satellites.

    Parameters
    ----------
    columns : ndarray of int, shape (n,)
        Satellite of each single difference.
    ranges, clock, range_rate, elevation : ndarray, shape (2, m)
        See `Geometry`.
    direction : ndarray, shape (2, m, 3)
        See `Geometry`.
    positions : ndarray, shape (2, 3)
        Chief and deputy, navigation axes, m.
    radius, rise : float
        See `plasma_paths`.
    layers, shells : ndarray
        Thicknesses of layers and heights of shells above the chief, m.
    frequency_hz : ndarray, shape (n,)

    Returns
    -------
    predicted, direction_deputy, direction_chief, range_rate_deputy, ray_turn : ndarray
        As in `Sky`; the range rate in m/s.
    plasma_delay : ndarray, shape (n, layers + 3 shells)
        As in `Sky`.
    elevations : ndarray, shape (2, n)
    """
    count = len(columns)
    predicted, rate, ray_turn = np.empty(count), np.empty(count), np.empty(count)
    rays, elevations = np.empty((2, count, 3)), np.empty((2, count))
    x = positions[1, 0] - positions[0, 0]
    y = positions[1, 1] - positions[0, 1]
    z = positions[1, 2] - positions[0, 2]
    square = x * x + y * y + z * z
    for n in range(count):
        m = columns[n]
        predicted[n] = (ranges[1, m] - ranges[0, m]) - clock[1, m] + clock[0, m]
        rate[n] = range_rate[1, m]
        for receiver in range(2):
            elevations[receiver, n] = elevation[receiver, m]
            for axis in range(3):
                rays[receiver, n, axis] = direction[receiver, m, axis]
        along = rays[1, n, 0] * x + rays[1, n, 1] * y + rays[1, n, 2] * z
        ray_turn[n] = math.sqrt(max(square - along**2, 0.0)) / ranges[1, m]
    plasma = np.empty((count, len(layers) + 3 * len(shells)))
    plasma[:, : len(layers)] = plasma_paths(radius, rise, elevations, layers)
    plasma[:, len(layers) :] = shell_paths(positions, rays, shells)
    for n in range(count):
        delay_of_tecu = DELAY_PER_TECU / frequency_hz[n] ** 2
        for k in range(plasma.shape[1]):
            plasma[n, k] = delay_of_tecu * plasma[n, k]
    return predicted, rays[1], rays[0], rate, ray_turn, plasma, elevations

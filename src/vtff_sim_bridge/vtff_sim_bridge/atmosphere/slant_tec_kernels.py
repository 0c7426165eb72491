"""Arithmetic of `vtff_sim_bridge.atmosphere.slant_tec`, compiled; products of matrices are there.

m receivers, each with n rays; c cells of altitude. Where squares are summed, the order is that of
the numbers that were published before this was compiled, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled

__all__ = ["centred_moments", "ray_geometry", "ray_kernel", "rise_from_perigee"]

_NEAREST = 5e3
_NEAREST_PER_ALTITUDE = 0.01
# Moments are divided by half the width of a cell, which is none where a ray begins at the top.
_NARROWEST_HALF = 1e-3  # m


@compiled
def ray_geometry(receiver, satellite, stretch, radius_top):  # type: ignore[no-untyped-def]
    """Return where rays begin and end, in axes in which surfaces of equal density are spheres.

    Parameters
    ----------
    receiver : ndarray, shape (m, 3)
        m.
    satellite : ndarray, shape (m, n, 3)
        m.
    stretch : ndarray, shape (3,)
        By which these axes are longer.
    radius_top : float
        Where the profile ends, m.

    Returns
    -------
    radius : ndarray, shape (m, 1)
        Distance of the receivers from the centre, m.
    start, end : ndarray, shape (m, n)
        Distances along the rays from their points nearest to the centre, m.
    perigee_squared : ndarray, shape (m, n)
        Square of the distance of those from the centre, m2.
    scale : ndarray, shape (m, n)
        Length of the rays over that in the stretched axes; NaN where they have none.
    is_whole : bool
        Whether all rays are valid, rise from the beginning on and end above the profile.
    """
    is_whole = True
    count, rays = satellite.shape[:2]
    radius = np.empty((count, 1))
    start, end = np.empty((count, rays)), np.empty((count, rays))
    perigee_squared, scale = np.empty((count, rays)), np.empty((count, rays))
    for k in range(count):
        rx, ry, rz = receiver[k, 0], receiver[k, 1], receiver[k, 2]
        sx, sy, sz = rx * stretch[0], ry * stretch[1], rz * stretch[2]
        distance = math.sqrt(sx * sx + sz * sz + sy * sy)
        radius[k, 0] = distance
        for n in range(rays):
            x, y, z = satellite[k, n, 0] - rx, satellite[k, n, 1] - ry, satellite[k, n, 2] - rz
            length = math.sqrt(x * x + y * y + z * z)
            x, y, z = x * stretch[0], y * stretch[1], z * stretch[2]
            stretched = math.sqrt(x * x + y * y + z * z)
            if not 0.0 < length < math.inf:
                start[k, n] = end[k, n] = perigee_squared[k, n] = scale[k, n] = math.nan
                is_whole = False
                continue
            along = (sx * x + sy * y + sz * z) / stretched
            start[k, n] = along
            end[k, n] = along + stretched
            squared = (distance - along) * (distance + along)
            perigee_squared[k, n] = squared
            scale[k, n] = length / stretched
            is_above = math.sqrt(squared + end[k, n] * end[k, n]) >= radius_top
            is_whole = is_whole and along >= 0.0 and is_above
    return radius, start, end, perigee_squared, scale, is_whole


@compiled
def rise_from_perigee(radius, start, radius_zero, bottom, peak, top):  # type: ignore[no-untyped-def]
    """Return how high above their perigee rays are where their content begins.

    Parameters
    ----------
    radius : ndarray, shape (m, 1)
        m.
    start : ndarray, shape (m, n)
        Distance of the beginnings from the perigees, m.
    radius_zero, bottom, peak, top : float
        Radius of altitude zero; altitudes of the profile, m.

    Returns
    -------
    altitude : ndarray, shape (m, 1)
        At least that of the bottom, m.
    nearest : ndarray, shape (m, 1)
        Least distance above the perigee from which cells are fine enough, m.
    is_low : ndarray of bool, shape (m, n)
        Which rays are nearer to their perigee.
    is_any_low : bool
        Whether any is.
    is_above : bool
        Whether any receiver is above the profile.
    """
    is_any_low = is_above = False
    count, rays = start.shape
    altitude, nearest = np.empty((count, 1)), np.empty((count, 1))
    is_low = np.empty((count, rays), dtype=np.bool_)
    for k in range(count):
        r = radius[k, 0]
        height = max(r - radius_zero, bottom)
        near = max(_NEAREST, _NEAREST_PER_ALTITUDE * abs(height - peak))
        altitude[k, 0], nearest[k, 0] = height, near
        is_above = is_above or height >= top
        for n in range(rays):
            s = start[k, n]
            perigee = math.sqrt(max((r - s) * (r + s), 0.0))
            # Without loss of digits.
            distance = s * s / (r + perigee) + (height + radius_zero - r)
            is_low[k, n] = distance < near and height < top
            is_any_low = is_any_low or is_low[k, n]
    return altitude, nearest, is_low, is_any_low, is_above


@compiled
def _cell(low, high):  # type: ignore[no-untyped-def]
    """Return the centre of a cell between two altitudes and half its width, m."""
    return 0.5 * (high + low), max(0.5 * (high - low), _NARROWEST_HALF)


@compiled
def centred_moments(cumulative, edges, peak, unit):  # type: ignore[no-untyped-def]
    """Return moments 0 to 3 of the density about the centres of cells, in half widths, (m, c, 4).

    Parameters
    ----------
    cumulative : ndarray, shape (m, c + 1, 4)
        Moments from the bottom up to the edges, about the peak in units.
    edges : ndarray, shape (m, c + 1)
        m.
    peak, unit : float
        Altitude of the peak, and the unit, m.
    """
    count, cells = len(edges), edges.shape[1] - 1
    moments = np.empty((count, cells, 4))
    for k in range(count):
        for j in range(cells):
            centre, half = _cell(edges[k, j], edges[k, j + 1])
            # Binomial theorem.
            shift, scale = (peak - centre) / half, unit / half
            m0 = cumulative[k, j + 1, 0] - cumulative[k, j, 0]
            m1 = scale * (cumulative[k, j + 1, 1] - cumulative[k, j, 1])
            squared = scale * scale
            m2 = squared * (cumulative[k, j + 1, 2] - cumulative[k, j, 2])
            m3 = squared * scale * (cumulative[k, j + 1, 3] - cumulative[k, j, 3])
            shifted_1 = m1 + shift * m0
            shifted_2 = m1 + shifted_1
            moments[k, j, 0], moments[k, j, 1] = m0, shifted_1
            moments[k, j, 2] = m2 + shift * shifted_2
            moments[k, j, 3] = m3 + shift * (3.0 * m2 + shift * (m1 + shifted_2))
    return moments


@compiled
def ray_kernel(edges, weights, nodes, radius, start, radius_zero):  # type: ignore[no-untyped-def]
    """Return what the content of rays is the product of.

    Parameters
    ----------
    edges : ndarray, shape (m, c + 1)
        m.
    weights : ndarray, shape (m, c, 4)
        Weights of the nodes of the cells.
    nodes : ndarray, shape (4,)
        Places of these nodes in the cell [-1, 1].
    radius : ndarray, shape (m, 1)
        Radii of the receivers, m.
    start : ndarray, shape (m, n)
        Their distances from the perigees, m.
    radius_zero : float
        Radius of altitude zero, m.

    Returns
    -------
    kernel : ndarray, shape (m, n, 4 c)
        Inverse of the distance from the perigee, 1/m; inf or NaN where there is none.
    weights : ndarray, shape (m, 4 c, 1)
        Weights times the radius, m.
    """
    count, rays = start.shape
    cells = edges.shape[1] - 1
    kernel = np.empty((count, rays, 4 * cells))
    products = np.empty((count, 4 * cells, 1))
    risen = np.empty(4 * cells)
    for k in range(count):
        r = radius[k, 0]
        for j in range(cells):
            centre, half = _cell(edges[k, j], edges[k, j + 1])
            for i in range(4):
                rise = centre + half * nodes[i] + (radius_zero - r)
                # r'^2 - p^2 = s^2 + (r' - r)(r' + r)
                risen[4 * j + i] = rise * (rise + 2.0 * r)
                products[k, 4 * j + i, 0] = weights[k, j, i] * (rise + r)
        for n in range(rays):
            squared = start[k, n] * start[k, n]
            for j in range(4 * cells):
                kernel[k, n, j] = np.reciprocal(np.sqrt(risen[j] + squared))
    return kernel, products

"""What the measured contents tell of a wall at best: the bound of Cramer (1946) and Rao (1945).

Both spacecraft show the wall as a change of the slope of their contents, every integer known. The
noise of the column between them is taken as white, as dense as the scatter of its means shows it at
the length of a segment; each spacecraft has half of its variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["WallBound", "wall_bound"]

# s; contents beside a wall that are fitted with it, as `vtff_iono.edges.vertical_edges` does.
_WINDOW = 40.0
# m; step of places and widths for derivatives, and the thinnest wall.
_STEP, _THINNEST = 5.0, 50.0


@dataclass(frozen=True)
class WallBound:
    """Smallest sigmas of an unbiased estimate, m.

    Parameters
    ----------
    width_sigma : float
    lag_sigma : float
        Of the difference of the altitudes at which chief and deputy find the wall.
    """

    width_sigma: float
    lag_sigma: float


def wall_bound(
    width: float,
    separation: float,
    speed: float,
    change: float,
    change_sigma: float,
    segment: float,
) -> WallBound:
    """Return the bound of a wall.

    Parameters
    ----------
    width, separation : float
        Width of the wall and vertical separation, m.
    speed : float
        Vertical speed, m/s.
    change : float
        Change of the density over the wall, 1/m3.
    change_sigma : float
        Sigma of the difference of the mean densities of two segments, 1/m3.
    segment : float
        Length of a segment, s.
    """
    width = max(width, _THINNEST)
    reach = math.ceil(_WINDOW + 0.5 * width / speed)
    height = speed * np.arange(-reach, reach + 1.0)
    half = 0.5 * _STEP
    by_place = (_content(height - half, width) - _content(height + half, width)) / _STEP
    by_width = (_content(height, width + half) - _content(height, width - half)) / _STEP
    # Of the change of density, of that of its slope, of the common width; then places of both.
    shared = [_content(height, width), _content(height, width, 2), change * by_width]
    none = np.zeros_like(height)
    # Two segments differ by this sigma; each is the mean of as many seconds. It is that of both
    # spacecraft.
    sigma = separation * change_sigma * math.sqrt(0.25 * segment)
    smooth, _ = np.linalg.qr(np.vander(height / height[-1], 3))
    rows = []
    for places in ([change * by_place, none], [none, change * by_place]):
        columns = np.column_stack([*shared, *places])
        # What is above a spacecraft changes smoothly.
        rows.append((columns - smooth @ (smooth.T @ columns)) / sigma)
    design = np.vstack(rows)
    scale = np.sqrt((design**2).sum(axis=0))
    spread = np.linalg.inv((design / scale).T @ (design / scale)) / np.outer(scale, scale)
    lag = float(spread[3, 3] + spread[4, 4] - 2.0 * spread[3, 4])
    return WallBound(math.sqrt(float(spread[2, 2])), math.sqrt(lag))


def _content(height: FloatArray, width: float, order: int = 1) -> FloatArray:
    """Return the integral over height of a density that begins at zero, mean over a width, m.

    The density is 1 behind the beginning, or its distance from there for an order of 2.
    """
    upper, lower = (np.maximum(height + side * 0.5 * width, 0.0) for side in (1.0, -1.0))
    power = order + 1
    return np.asarray((upper**power - lower**power) / (order * power * width))

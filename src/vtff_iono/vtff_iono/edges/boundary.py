"""An edge of an irregularity, with the spacecraft that has crossed or seen it."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from vtff_dynamics.vectors import FloatArray

__all__ = ["NO_SYSTEM", "Boundary", "BoundaryKind", "BoundarySource"]

NO_SYSTEM = 255
"""System of an edge that was found without a single satellite."""


class BoundaryKind(enum.IntEnum):
    """Kind of region that an edge bounds; the numbers of ``vtff_msgs/IrregularityBoundary``."""

    VERTICAL = 0
    HORIZONTAL = 1


class BoundarySource(enum.IntEnum):
    """Quantity that shows an edge; the numbers of ``vtff_msgs/IrregularityBoundary``."""

    DENSITY = 0
    S4 = 1
    ROTI = 2
    TEC_GRADIENT = 3


@dataclass(frozen=True, eq=False)
class Boundary:
    """An edge; see ``vtff_msgs/IrregularityBoundary``.

    Parameters
    ----------
    kind : BoundaryKind
    source : BoundarySource
    spacecraft : int
        0 chief, 1 deputy.
    system, prn : int
        Satellite of the ray; `NO_SYSTEM` and 0 for a vertical edge.
    time : int
        GPS time, ns since 1980-01-06.
    time_sigma : float
        s.
    is_entry : bool
        Whether the spacecraft or the ray enters the irregularity.
    position_itrf : ndarray, shape (3,)
        Position of the spacecraft (vertical edge) or of the pierce point of the ray, m.
    confidence : float
        0 to 1.
    width, width_sigma : float
        Width over which the density changes at a vertical edge, that of the straight line of the
        same second moment (see `vtff_iono.edges.wall_width`), and its sigma, m; NaN for a ray. A
        width below about three sigmas is a wall that may as well be thin: it is no wider than the
        width and two sigmas.
    time_covariance : float
        Covariance of the time with that at which the other spacecraft crosses the same vertical
        edge, s^2; 0 for a ray.
    """

    kind: BoundaryKind
    source: BoundarySource
    spacecraft: int
    system: int
    prn: int
    time: int
    time_sigma: float
    is_entry: bool
    position_itrf: FloatArray
    confidence: float
    width: float = math.nan
    width_sigma: float = math.nan
    time_covariance: float = 0.0

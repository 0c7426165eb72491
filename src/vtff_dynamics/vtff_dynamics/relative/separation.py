"""Smallest separation of spacecraft from their relative elements, on a nearly circular orbit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.relative.relative_elements import linear_map_rtn

__all__ = ["SafetyFigures", "closest_on_path", "radial_normal_separation", "safety_figures"]

_SAMPLES = 720


@dataclass(frozen=True)
class SafetyFigures:
    """How far two spacecraft stay apart over one orbit without thrust.

    Attributes
    ----------
    separation
        Smallest distance, m.
    separation_radial_normal
        Smallest distance in the R-N plane, m: what is left whatever happens in-track.
    eccentricity, inclination
        Lengths of the relative eccentricity and inclination vectors, m.
    angle
        Angle between them, rad in [0, pi/2]: 0 is parallel or opposite; NaN without one of them.
    """

    separation: float
    separation_radial_normal: float
    eccentricity: float
    inclination: float
    angle: float


def radial_normal_separation(relative: npt.ArrayLike) -> float:
    """Return the smallest R-N separation over an orbit for equal semi-major axes, m.

    Parameters
    ----------
    relative
        Relative elements of one spacecraft to the other, m, shape (6,); the first two do not count.

    References
    ----------
    D'Amico (2010), eq. (2.22), after Montenbruck et al. (2006).
    """
    _, _, ex, ey, ix, iy = np.asarray(relative, dtype=float).tolist()
    dot = abs(ex * ix + ey * iy)
    squares = ex * ex + ey * ey + ix * ix + iy * iy
    both = np.hypot(ex + ix, ey + iy) * np.hypot(ex - ix, ey - iy)
    total = squares + both
    return float(np.sqrt(2.0) * dot / np.sqrt(total)) if total > 0.0 else 0.0


def safety_figures(
    relative_first: npt.ArrayLike, relative_second: npt.ArrayLike | None = None
) -> SafetyFigures:
    """Return how far a deputy stays from the chief, or two deputies from each other.

    Parameters
    ----------
    relative_first, relative_second
        Relative elements to the chief, m, shape (6,); without the second it is the chief itself.

    Returns
    -------
    SafetyFigures
        Figures of one orbit; a relative semi-major axis drifts on from there.
    """
    relative = np.array(relative_first, dtype=float)
    if relative_second is not None:
        relative = relative - np.asarray(relative_second, dtype=float)
    latitude = np.linspace(0.0, 2.0 * np.pi, _SAMPLES, endpoint=False)
    position = linear_map_rtn(1.0, latitude)[:, :3] @ relative
    position[:, 1] -= 1.5 * relative[0] * latitude
    eccentricity = float(np.hypot(relative[2], relative[3]))
    inclination = float(np.hypot(relative[4], relative[5]))
    angle = float("nan")
    if eccentricity > 0.0 and inclination > 0.0:
        dot = abs(float(relative[2:4] @ relative[4:6])) / (eccentricity * inclination)
        angle = float(np.arccos(min(dot, 1.0)))
    radial_normal = (
        radial_normal_separation(relative)
        if relative[0] == 0.0
        else closest_on_path(position[:, [0, 2]])
    )
    return SafetyFigures(closest_on_path(position), radial_normal, eccentricity, inclination, angle)


def closest_on_path(relative_positions: npt.ArrayLike) -> float:
    """Return the smallest distance from the origin of a polygon through positions, m.

    Parameters
    ----------
    relative_positions
        Positions of one spacecraft relative to the other in order of time, m, shape (n, 2 or 3).
    """
    position = np.asarray(relative_positions, dtype=float)
    start, edge = position[:-1], np.diff(position, axis=0)
    squared = np.maximum((edge**2).sum(axis=1), 1e-30)
    fraction = np.clip(-(start * edge).sum(axis=1) / squared, 0.0, 1.0)
    return float(np.linalg.norm(start + fraction[:, np.newaxis] * edge, axis=1).min())

"""Impulsive control of relative elements on a nearly circular orbit, with least velocity change."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from vtff_dynamics.relative.relative_elements import control_matrix
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "Impulse",
    "InfeasibleChangeError",
    "in_plane_impulses",
    "least_impulses",
    "least_velocity_change",
    "out_of_plane_impulse",
]

_LEAST = 1e-9  # share of the largest impulse below which one is left out


class InfeasibleChangeError(ValueError):
    """A change of relative elements cannot be reached in the given span; the text says why."""


@dataclass(frozen=True, eq=False)
class Impulse:
    """A change of velocity.

    Attributes
    ----------
    mean_latitude
        Mean argument of latitude at which it is given, rad.
    velocity_rtn
        Change of the velocity, m/s, shape (3,).
    """

    mean_latitude: float
    velocity_rtn: FloatArray


def least_velocity_change(change: npt.ArrayLike, mean_motion: float) -> tuple[float, float]:
    """Return the least in-plane and out-of-plane velocity changes for any timing, m/s.

    The relative mean longitude is left to the drift that a free choice of the time gives.

    Parameters
    ----------
    change
        Wanted change of the relative elements, m, shape (6,).
    mean_motion
        rad/s.

    References
    ----------
    Gaias and D'Amico (2015), Impulsive Maneuvers for Formation Reconfiguration Using Relative
    Orbital Elements, J. Guidance Control Dynamics 38(6), table 1.
    """
    da, _, ex, ey, ix, iy = np.asarray(change, dtype=float).tolist()
    in_plane = 0.5 * mean_motion * max(abs(da), math.hypot(ex, ey))
    return in_plane, mean_motion * math.hypot(ix, iy)


def out_of_plane_impulse(change: npt.ArrayLike, mean_motion: float) -> Impulse:
    """Return the one impulse along N that changes the relative inclination vector.

    Parameters
    ----------
    change, mean_motion
        As in `least_velocity_change`; only the last two elements count.
    """
    _, _, _, _, ix, iy = np.asarray(change, dtype=float).tolist()
    size = mean_motion * math.hypot(ix, iy)
    return Impulse(math.atan2(iy, ix) % (2.0 * math.pi), np.array([0.0, 0.0, size]))


def in_plane_impulses(change: npt.ArrayLike, mean_motion: float) -> tuple[Impulse, Impulse]:
    """Return the two impulses along T that change semi-major axis and eccentricity vector.

    They are half an orbit apart; the mean longitude drifts between them.

    Parameters
    ----------
    change, mean_motion
        As in `least_velocity_change`; elements 0, 2 and 3 count.

    References
    ----------
    D'Amico (2010), eq. (4.4): the pair of tangential impulses.
    """
    da, _, ex, ey, _, _ = np.asarray(change, dtype=float).tolist()
    size = math.hypot(ex, ey)
    latitude = math.atan2(ey, ex) % (2.0 * math.pi)
    return tuple(  # type: ignore[return-value]
        Impulse(latitude + half, np.array([0.0, 0.25 * mean_motion * (da + sign * size), 0.0]))
        for half, sign in ((0.0, 1.0), (math.pi, -1.0))
    )


def least_impulses(
    change: npt.ArrayLike,
    mean_motion: float,
    latitude_start: float,
    latitude_end: float,
    samples: int = 181,
    axes: str = "TN",
) -> list[Impulse]:
    """Return impulses of least total size that change all six elements within a span.

    The relative motion is linear and Keplerian; the sum of the absolute values on all axes is the
    least that any impulses on the grid of the span can have (a linear programme).

    Parameters
    ----------
    change
        Wanted change of the relative elements at the end of the span, against free motion, m.
    mean_motion
        rad/s.
    latitude_start, latitude_end
        Span of the mean argument of latitude, rad, not wrapped.
    samples
        Points of the grid.
    axes
        Axes on which there is thrust: some of R, T, N.

    Raises
    ------
    InfeasibleChangeError
        If no impulses on these axes in this span reach the change.
    """
    wanted = np.asarray(change, dtype=float)
    indices = ["RTN".index(axis) for axis in axes]
    latitudes = np.linspace(latitude_start, latitude_end, samples)
    blocks = []
    for latitude in latitudes:
        effect = mean_motion * control_matrix(mean_motion, float(latitude))
        effect[1] -= 1.5 * (latitude_end - latitude) * effect[0]
        blocks.append(effect[:, indices])
    matrix = np.hstack(blocks)
    scale = max(float(np.abs(wanted).max()), 1e-300)
    solution = linprog(
        np.ones(2 * matrix.shape[1]),
        A_eq=np.hstack((matrix, -matrix)),
        b_eq=wanted / scale,
        bounds=(0.0, None),
        method="highs",
    )
    if solution.status != 0:
        raise InfeasibleChangeError(
            f"change: not within reach of impulses along {axes} between latitudes "
            f"{latitude_start:g} and {latitude_end:g} rad: {solution.message}"
        )
    half = matrix.shape[1]
    sizes = (solution.x[:half] - solution.x[half:]).reshape(samples, len(indices))
    least = _LEAST * float(np.abs(sizes).max(initial=0.0))
    impulses = []
    for latitude, size in zip(latitudes, sizes, strict=True):
        if np.abs(size).max() > least:
            velocity = np.zeros(3)
            velocity[indices] = mean_motion * scale * size
            impulses.append(Impulse(float(latitude), velocity))
    return impulses

"""Impulsive control of relative elements on a nearly circular orbit, with least velocity change."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from vtff_dynamics.relative.relative_elements import control_matrix, linear_map_rtn
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
    deviation_price: float = 0.0,
    drift: npt.ArrayLike | None = None,
) -> list[Impulse]:
    """Return impulses of least total size that change all six elements within a span.

    The relative motion is linear and Keplerian; the sum of the absolute values on all axes is the
    least that any impulses on the grid of the span can have (a linear programme). With a price of
    deviations the sum of both is least: impulses then come earlier than where they are cheapest.

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
    deviation_price
        Velocity change that a deviation is worth, as a multiple of the mean motion times the mean
        deviation on the way (the sum of its absolute values in R, T and N).
    drift
        Steady drift of the elements in the span, m, shape (6,), which `change` makes up for; it is
        not part of the Keplerian motion. With a price of deviations the end may be off by half of
        it to both sides: the mean is small where the pulses come in the middle of the drift.
        Default none.

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
    program: dict[str, FloatArray] = {
        "c": np.ones(2 * matrix.shape[1]),
        "A_eq": np.hstack((matrix, -matrix)),
        "b_eq": wanted / scale,
        "bounds": np.array([0.0, np.inf]),
    }
    if deviation_price > 0.0:
        steady = np.zeros(6) if drift is None else np.asarray(drift, dtype=float) / scale
        program = _priced(program, blocks, latitudes, mean_motion, deviation_price, steady)
    solution = linprog(**program, method="highs")
    if solution.status != 0:
        raise InfeasibleChangeError(
            f"change: not within reach of impulses along {axes} between latitudes "
            f"{latitude_start:g} and {latitude_end:g} rad: {solution.message}"
        )
    half = matrix.shape[1]
    sizes = (solution.x[:half] - solution.x[half : 2 * half]).reshape(samples, len(indices))
    least = _LEAST * float(np.abs(sizes).max(initial=0.0))
    impulses = []
    for latitude, size in zip(latitudes, sizes, strict=True):
        if np.abs(size).max() > least:
            velocity = np.zeros(3)
            velocity[indices] = mean_motion * scale * size
            impulses.append(Impulse(float(latitude), velocity))
    return impulses


def _priced(
    program: dict[str, FloatArray],
    blocks: list[FloatArray],
    latitudes: FloatArray,
    mean_motion: float,
    price: float,
    drift: FloatArray,
) -> dict[str, FloatArray]:
    """Return the linear programme with a bound of each deviation on the way as a variable more.

    Parameters
    ----------
    program
        The programme without.
    blocks
        Effects at the end of the span of impulses at each latitude, m for 1 / n, shape (6, axes).
    latitudes
        rad, shape (k,).
    mean_motion
        rad/s.
    price, drift
        See `least_impulses`; the drift in the unit of the programme.
    """
    effects, missing = np.hstack(blocks), program["b_eq"]
    count, width = len(latitudes), blocks[0].shape[1]
    paths, free = [], []
    for index, latitude in enumerate(latitudes.tolist()):
        # From elements at the end of the span to positions at this latitude.
        back = np.eye(6)
        back[1, 0] = 1.5 * (latitudes[-1] - latitude)
        seen = linear_map_rtn(mean_motion, latitude)[:3]
        path = np.zeros((3, effects.shape[1]))
        given = width * (index + 1)
        path[:, :given] = seen @ back @ effects[:, :given]
        paths.append(path)
        left = (latitudes[-1] - latitude) / (latitudes[-1] - latitudes[0])
        free.append(seen @ (back @ -missing - left * drift))
    path, start = np.vstack(paths), np.concatenate(free)
    pulses, deviations = len(program["c"]), 3 * count
    bound, end = -np.eye(deviations), np.zeros((deviations, 6))
    return {
        "c": np.concatenate((program["c"], np.full(deviations, price / count), np.zeros(6))),
        # The last six are the shares of the drift that the end is off, from minus half of it on.
        "A_eq": np.hstack((program["A_eq"], np.zeros((6, deviations)), -np.diag(drift))),
        "b_eq": missing - 0.5 * drift,
        "A_ub": np.block([[path, -path, bound, end], [-path, path, bound, end]]),
        "b_ub": np.concatenate((-start, start)),
        "bounds": np.array([[0.0, np.inf]] * (pulses + deviations) + [[0.0, 1.0]] * 6),
    }

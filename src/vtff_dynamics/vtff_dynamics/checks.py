"""Checks of what people give to the functions for daily use: shape, unit, finiteness."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["check_angle", "check_orbit_state", "check_vector"]

_LOWEST_RADIUS = RADIUS_EARTH_JGM3 - 30e3  # m; the ground at the poles
_HIGHEST_RADIUS = 1e9  # m; beyond the Moon
_SLOWEST = 100.0  # m/s; in km/s no orbit is faster


def check_vector(name: str, value: npt.ArrayLike, size: int, unit: str) -> FloatArray:
    """Return a vector as an array of shape (size,).

    Raises
    ------
    ValueError
        If it has another shape or is not finite; the text names parameter, expected and got.
    """
    expected = f"{name}: expected {size} finite numbers ({unit}), shape ({size},)"
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{expected}; got {value!r}") from None
    if array.shape != (size,):
        raise ValueError(f"{expected}; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{expected}; got {array.tolist()}")
    return array


def check_angle(name: str, value: float, smallest: float, largest: float) -> float:
    """Return an angle in radians that lies within limits.

    Raises
    ------
    ValueError
        If it does not; an angle that fits in degrees is asked about.
    """
    if not (math.isfinite(value) and smallest <= value <= largest):
        hint = " (is it in degrees?)" if math.isfinite(value) and abs(value) > largest else ""
        raise ValueError(
            f"{name}: expected radians from {smallest:.4f} to {largest:.4f}; got {value:g}{hint}"
        )
    return float(value)


def check_orbit_state(name: str, value: npt.ArrayLike) -> FloatArray:
    """Return position (m) and velocity (m/s) of a bound orbit, shape (6,).

    Raises
    ------
    ValueError
        If the shape is another, the position is inside the Earth or further than the Moon, or the
        velocity is none of a bound orbit.
    """
    state = check_vector(name, value, 6, "m and m/s")
    radius, speed = norm(state[:3]), norm(state[3:])
    if not _LOWEST_RADIUS <= radius <= _HIGHEST_RADIUS:
        hint = " (is it in km?)" if _LOWEST_RADIUS <= 1e3 * radius <= _HIGHEST_RADIUS else ""
        raise ValueError(
            f"{name}: expected a distance from the Earth's centre of {_LOWEST_RADIUS:.4g} to "
            f"{_HIGHEST_RADIUS:.4g} m; got {radius:.4g}{hint}"
        )
    escape = math.sqrt(2.0 * GM_EARTH / radius)
    if not _SLOWEST <= speed < escape:
        hint = " (is it in km/s?)" if speed < _SLOWEST else ""
        raise ValueError(
            f"{name}: expected a speed of {_SLOWEST:g} to {escape:.4g} m/s, that of a bound "
            f"orbit; got {speed:.4g}{hint}"
        )
    return state

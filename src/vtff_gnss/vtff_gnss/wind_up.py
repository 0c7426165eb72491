"""Carrier-phase wind-up: circularly polarised antennas count how they turn against each other.

References
----------
Wu, Wu, Hajj, Bertiger and Lichten (1993), Effects of antenna orientation on GPS carrier phase,
Manuscripta Geodaetica 18:91.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.vectors import FloatArray

__all__ = ["wind_up_cycles"]

_EARTH_ROTATION = np.array([0.0, 0.0, EARTH_ROTATION_RATE])


def wind_up_cycles(
    direction_itrf: FloatArray,
    position_satellite_itrf: FloatArray,
    velocity_satellite_itrf: FloatArray,
    axis_x_itrf: FloatArray,
    axis_y_itrf: FloatArray,
) -> FloatArray:
    """Return the wind-up between satellites and receivers, cycles in [-0.5, 0.5], shape (...).

    Parameters
    ----------
    direction_itrf : ndarray, shape (..., 3)
        Unit vectors from the receiver to the satellites.
    position_satellite_itrf : ndarray, shape (..., 3)
        m.
    velocity_satellite_itrf : ndarray, shape (..., 3)
        As seen from the Earth, m/s.
    axis_x_itrf, axis_y_itrf : ndarray, shape (..., 3)
        Axes of the receiver's antenna; with its boresight they are a right-handed system.

    Notes
    -----
    The axes of the satellites are those of their orbits (z to the centre of the Earth, x forward);
    their turns towards the Sun are the same for all receivers near each other.
    """
    to_receiver = -direction_itrf
    velocity = velocity_satellite_itrf + np.cross(_EARTH_ROTATION, position_satellite_itrf)
    down = -position_satellite_itrf / np.linalg.norm(
        position_satellite_itrf, axis=-1, keepdims=True
    )
    side = np.cross(down, velocity)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    sent = _dipole(to_receiver, np.cross(side, down), -side)
    received = _dipole(to_receiver, axis_x_itrf, axis_y_itrf)
    sine = np.einsum("...i,...i->...", to_receiver, np.cross(sent, received))
    cosine = np.einsum("...i,...i->...", sent, received)
    return np.asarray(np.arctan2(sine, cosine) / (2.0 * math.pi))


def _dipole(to_receiver: FloatArray, axis_x: FloatArray, axis_y: FloatArray) -> FloatArray:
    """Return the effective dipole x - k (k x) + k x y of crossed dipoles along x and y."""
    along = np.einsum("...i,...i->...", to_receiver, axis_x)[..., None]
    return np.asarray(axis_x - to_receiver * along + np.cross(to_receiver, axis_y))

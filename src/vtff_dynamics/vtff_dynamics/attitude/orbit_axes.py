"""The local orbital axes of a spacecraft that points at the Earth, and roll, pitch and yaw in them.

Orbit axes: x along-track, y against the orbit normal, z to the Earth's centre. Roll, pitch and yaw
turn orbit axes into body axes in the order pitch (y), roll (x), yaw (z), as on SNAP-1 (Steyn, 2-1-3
angles), so that any pitch is regular; they are singular at a roll of 90 deg.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.quaternion import from_rotation_matrix
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "orbit_rate",
    "quaternion_from_roll_pitch_yaw",
    "roll_pitch_yaw",
    "rotation_gcrf_to_orbit",
]


def rotation_gcrf_to_orbit(state_gcrf: npt.ArrayLike) -> FloatArray:
    """Return the rotation matrix (3, 3) from GCRF to the orbit axes of a state (6,), m and m/s.

    Raises
    ------
    ValueError
        If position and velocity do not span a plane.
    """
    radial, along_track, normal = rotation_gcrf_to_rtn(state_gcrf)
    return np.array([along_track, -normal, -radial])


def orbit_rate(state_gcrf: npt.ArrayLike) -> float:
    """Return the rate at which the orbit axes turn about -y, rad/s."""
    state = np.asarray(state_gcrf, dtype=float)
    return norm(cross(state[:3], state[3:])) / float(state[:3] @ state[:3])


def quaternion_from_roll_pitch_yaw(
    roll: float, pitch: float, yaw: float, rotation_gcrf_to_orbit: FloatArray
) -> FloatArray:
    """Return the attitude (body to GCRF) with given angles to the orbit axes, rad, shape (4,)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_y = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
    about_z = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])
    body_from_gcrf = about_z @ about_x @ about_y @ rotation_gcrf_to_orbit
    quaternion: FloatArray = from_rotation_matrix(np.ascontiguousarray(body_from_gcrf.T))
    return quaternion


def roll_pitch_yaw(rotation_body_from_orbit: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw of a rotation from orbit to body axes (3, 3), rad, shape (3,)."""
    matrix = rotation_body_from_orbit
    return np.array(
        [
            -math.asin(max(-1.0, min(1.0, float(matrix[2, 1])))),
            math.atan2(matrix[2, 0], matrix[2, 2]),
            math.atan2(matrix[0, 1], matrix[1, 1]),
        ]
    )

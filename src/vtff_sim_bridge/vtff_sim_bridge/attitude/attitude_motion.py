"""Attitude of a spacecraft as the motion commands of SimREMOTE hold it."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.attitude.quaternion import (
    from_rotation_matrix,
    rotation_matrix,
    rotation_vector,
    turned_at_rate,
)
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import rotation_itrf_to_enu
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.simremote.motion import angles_of_quaternion

__all__ = ["attitude_motion"]

_NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_DIFFERENCE_TIME = 0.5  # s, on both sides: the axes of the horizon turn by 0.03 deg


def attitude_motion(
    time: GpsTime, state_gcrf: FloatArray, quaternion_gcrf: FloatArray, rate_body: FloatArray
) -> FloatArray:
    """Return the attitude of a spacecraft against the local horizon and how it changes.

    Parameters
    ----------
    time : GpsTime
    state_gcrf : ndarray, shape (6,)
        Position and velocity, m and m/s.
    quaternion_gcrf : ndarray, shape (4,)
        Body to GCRF, x, y, z, w.
    rate_body : ndarray, shape (3,)
        Rate against GCRF, rad/s, body axes.

    Returns
    -------
    ndarray, shape (4, 3)
        Heading, elevation and bank (3-2-1 angles to north, east, down; rad); rate of the body
        against these axes (rad/s, body axes), its derivative (rad/s2), and zero for the second
        derivative. The rate against GCRF counts as constant.
    """
    state_itrf = state_gcrf_to_itrf(time, state_gcrf)

    def rotation_to_horizon(after: float) -> FloatArray:
        """Return the rotation from body axes to north, east, down some seconds later."""
        turned = turned_at_rate(quaternion_gcrf, rate_body, after)
        to_itrf = rotation_gcrf_to_itrf(time + after) @ rotation_matrix(turned)
        horizon = rotation_itrf_to_enu(state_itrf[:3] + after * state_itrf[3:])
        rotation: FloatArray = _NED_FROM_ENU @ horizon @ to_itrf
        return rotation

    now = rotation_to_horizon(0.0)
    behind, ahead = (
        rotation_vector(from_rotation_matrix(now.T @ rotation_to_horizon(after)))
        for after in (-_DIFFERENCE_TIME, _DIFFERENCE_TIME)
    )
    x, y, z, w = from_rotation_matrix(now).tolist()
    return np.array(
        [
            angles_of_quaternion((w, x, y, z)),
            (ahead - behind) / (2.0 * _DIFFERENCE_TIME),
            (ahead + behind) / _DIFFERENCE_TIME**2,
            np.zeros(3),
        ]
    )

"""Attitude of a spacecraft as the viewer shows it: against the RTN axes of its own orbit."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.magnetic_field import check_field_year, magnetic_field_gcrf
from vtff_dynamics.attitude.orbit_axes import roll_pitch_yaw, rotation_gcrf_to_orbit
from vtff_dynamics.attitude.quaternion import from_rotation_matrix, rotation_matrix
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import GpsTime

__all__ = ["attitude_row"]


def attitude_row(
    stamp: int, quaternion: npt.ArrayLike, rate_body: npt.ArrayLike, state_gcrf: npt.ArrayLike
) -> list[float]:
    """Return the columns of an attitude in the scene, but for the wheel.

    Parameters
    ----------
    stamp
        ns since 1970.
    quaternion
        Body to GCRF, x, y, z, w.
    rate_body
        rad/s against GCRF.
    state_gcrf
        Position and velocity of the spacecraft, m and m/s, shape (6,).

    Returns
    -------
    list of float
        Quaternion from the body to RTN; roll, pitch and yaw to the orbit axes, deg; rates, deg/s;
        direction of the magnetic field in RTN.
    """
    state = np.asarray(state_gcrf, dtype=float)
    gcrf_from_body = rotation_matrix(np.asarray(quaternion, dtype=float))
    rtn_from_gcrf = rotation_gcrf_to_rtn(state)
    to_rtn = from_rotation_matrix(np.ascontiguousarray(rtn_from_gcrf @ gcrf_from_body))
    body_from_orbit = gcrf_from_body.T @ rotation_gcrf_to_orbit(state).T
    angles = np.degrees(roll_pitch_yaw(body_from_orbit))
    rates = np.degrees(np.asarray(rate_body, dtype=float))
    field = rtn_from_gcrf @ _field_direction(stamp, state)
    return [*to_rtn.tolist(), *angles.tolist(), *rates.tolist(), *field.tolist()]


def _field_direction(stamp: int, state_gcrf: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the direction of the magnetic field in GCRF; NaN where IGRF does not hold."""
    time = GpsTime.from_unix_nanoseconds(stamp)
    try:
        check_field_year("attitude", time)
    except ValueError:
        return np.full(3, math.nan)
    field = magnetic_field_gcrf(time, state_gcrf[:3])
    return np.asarray(field / np.linalg.norm(field))

"""Closed-form gravity of a point mass and of J2, its derivatives along a motion, and a short step.

These small models serve feedforward, jerk and rates of frames, where microseconds count. Orbits
are propagated with the full harmonics of `vtff_dynamics.orbit.propagator`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH, J2_EARTH
from vtff_dynamics.orbit.free_flight import acceleration_at, fly_states, jerk_at, scale_oblateness
from vtff_dynamics.vectors import FloatArray

__all__ = ["gravity_acceleration", "gravity_jerk", "gravity_jerks", "predict_state"]


def gravity_acceleration(
    position_gcrf: npt.ArrayLike, gravitational_parameter: float = GM_EARTH, j2: float = J2_EARTH
) -> FloatArray:
    """Return the acceleration by a point mass and J2 at a position, m/s2, shape (3,).

    The symmetry axis is the GCRF z axis, which in 2016 is 1.6 mrad from the true pole: the J2 part
    is wrong by about its 0.3 %, 4e-5 m/s2 in low orbit.

    Parameters
    ----------
    position_gcrf : array_like, shape (3,)
        Position, m.
    gravitational_parameter : float
        m3/s2.
    j2 : float
        Second zonal coefficient; 0 leaves the point mass.

    References
    ----------
    Montenbruck and Gill (2000), Satellite Orbits, eq. (3.29) for C20 alone.
    """
    x, y, z = np.asarray(position_gcrf, dtype=float).tolist()
    oblateness = scale_oblateness(j2)
    return np.array(acceleration_at(x, y, z, gravitational_parameter, oblateness))


def gravity_jerk(
    state_gcrf: npt.ArrayLike, gravitational_parameter: float = GM_EARTH, j2: float = J2_EARTH
) -> FloatArray:
    """Return the rate of change of `gravity_acceleration` along a motion, m/s3, shape (3,).

    Parameters
    ----------
    state_gcrf : array_like, shape (6,)
        Position and velocity, m and m/s.
    gravitational_parameter, j2 : float
        As in `gravity_acceleration`.
    """
    states = np.array(state_gcrf, dtype=float, ndmin=2)
    jerk: FloatArray = _jerks(states, np.array([scale_oblateness(j2)]), gravitational_parameter)[0]
    return jerk


def gravity_jerks(states_gcrf: FloatArray, j2: FloatArray) -> FloatArray:
    """Return `gravity_jerk` of many states at once, m/s3, shape (n, 3).

    Parameters
    ----------
    states_gcrf : ndarray, shape (n, 6)
        Positions and velocities, m and m/s.
    j2 : ndarray, shape (n,)
        Second zonal coefficient of each; 0 leaves the point mass.
    """
    jerks: FloatArray = _jerks(
        np.ascontiguousarray(states_gcrf), np.array([*map(scale_oblateness, j2.tolist())]), GM_EARTH
    )
    return jerks


@compiled
def _jerks(states: FloatArray, oblatenesses: FloatArray, gm: float) -> FloatArray:
    """Return what `gravity_jerks` does, with the constants of `fly_states`."""
    jerks = np.empty((len(states), 3))
    for k in range(len(states)):
        jerks[k, 0], jerks[k, 1], jerks[k, 2] = jerk_at(states[k], gm, oblatenesses[k])
    return jerks


def predict_state(state_gcrf: npt.ArrayLike, duration: float, j2: float = J2_EARTH) -> FloatArray:
    """Return the state some seconds later: one fourth-order Runge-Kutta step, shape (6,).

    Parameters
    ----------
    state_gcrf : array_like, shape (6,)
        Position and velocity, m and m/s.
    duration : float
        Time ahead, s; the step is good to a millimetre up to 20 s in low orbit.
    j2 : float
        As in `gravity_acceleration`.
    """
    start = np.array(state_gcrf, dtype=float, ndmin=2)
    times = np.array([0.0, duration])
    end: FloatArray = fly_states(start, times, GM_EARTH, float(scale_oblateness(j2)))[1, 0]
    return end

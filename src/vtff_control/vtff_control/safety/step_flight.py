"""A step of flight with constant thrust: chief in GCRF, deputies in the chief's axes."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import add_thrust
from vtff_dynamics.orbit.gravity import predict_state
from vtff_dynamics.vectors import FloatArray

__all__ = ["advance_deputy", "fly_chief"]


def fly_chief(chief_gcrf: FloatArray, accelerations_rtn: FloatArray, step: float) -> FloatArray:
    """Return a chief of now and after each of k steps with constant thrust.

    Parameters
    ----------
    chief_gcrf
        m and m/s, shape (6,).
    accelerations_rtn
        Acceleration in each step in the axes at its start, m/s2, shape (k, 3).
    step
        s.

    Returns
    -------
    ndarray, shape (k + 1, 6)
        m and m/s in GCRF.

    Raises
    ------
    ValueError
        If position and velocity are parallel, so that there are no axes.
    """
    states = [np.asarray(chief_gcrf, dtype=float)]
    for acceleration_rtn in accelerations_rtn:
        states.append(_fly_step(states[-1], states[-1], acceleration_rtn, step))
    return np.array(states)


def advance_deputy(
    relative_rtn: FloatArray,
    chief_gcrf: FloatArray,
    chief_after_gcrf: FloatArray,
    acceleration_rtn: FloatArray,
    step: float,
) -> FloatArray:
    """Return the relative state of a deputy after a step with constant thrust.

    Parameters
    ----------
    relative_rtn
        Relative state at the start, m and m/s, shape (6,); the frame turns about N alone.
    chief_gcrf, chief_after_gcrf
        Chief at the start and the end of the step, m and m/s, shape (6,).
    acceleration_rtn
        Acceleration in the chief's axes at the start, m/s2, shape (3,).
    step
        s.

    Returns
    -------
    ndarray, shape (6,)
        In the axes of the chief at the end, m and m/s.

    Raises
    ------
    ValueError
        If position and velocity of the chief are parallel.
    """
    deputy = deputy_state_gcrf(chief_gcrf, relative_rtn)
    after = _fly_step(deputy, chief_gcrf, acceleration_rtn, step)
    return relative_state_rtn(chief_after_gcrf, after)


def _fly_step(
    state_gcrf: FloatArray, chief_gcrf: FloatArray, acceleration_rtn: FloatArray, step: float
) -> FloatArray:
    """Return the state (6,) after a step with constant thrust in the axes of the chief."""
    after = predict_state(state_gcrf, step)
    add_thrust(after, rotation_gcrf_to_rtn(chief_gcrf).T @ acceleration_rtn, step)
    return after

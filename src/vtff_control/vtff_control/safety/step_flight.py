"""A step of flight with constant thrust, compiled: chief in GCRF, deputies in the chief's axes.

The numbers are those of `vtff_dynamics.frames.rtn`, `vtff_dynamics.orbit.gravity.predict_state` and
`vtff_dynamics.orbit.free_flight.add_thrust`. A command waits for them, once a second, when no cache
knows them any more: one call costs less than half of what these functions cost.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn_kernels import write_axes, write_deputy_state
from vtff_dynamics.orbit.free_flight import OBLATENESS_EARTH, fly_states
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
    flown: FloatArray = _fly_chief(
        chief_gcrf, accelerations_rtn, step, 0.5 * step**2, GM_EARTH, OBLATENESS_EARTH
    )
    return flown


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
    difference, rotation, rate = _fly_deputy(
        relative_rtn,
        chief_gcrf,
        chief_after_gcrf,
        acceleration_rtn,
        step,
        0.5 * step**2,
        GM_EARTH,
        OBLATENESS_EARTH,
    )
    # Products of numpy, whose sums no loop has.
    x, y, z = (rotation @ difference[:3]).tolist()
    vx, vy, vz = (rotation @ difference[3:]).tolist()
    return np.array([x, y, z, vx + rate * y, vy - rate * x, vz])


@compiled
def _fly_step(
    state_gcrf: FloatArray,
    rotation: FloatArray,
    acceleration_rtn: FloatArray,
    step: float,
    half_square: float,
    gm: float,
    oblateness: float,
    after_gcrf: FloatArray,
) -> None:
    """Write the state (6,) after a step of constant thrust; half of the step's square is in s2."""
    start, times = np.empty((1, 6)), np.zeros(2)
    for k in range(6):
        start[0, k] = state_gcrf[k]
    times[1] = step
    flown = fly_states(start, times, gm, oblateness)
    for k in range(3):
        acceleration = (
            rotation[0, k] * acceleration_rtn[0]
            + rotation[1, k] * acceleration_rtn[1]
            + rotation[2, k] * acceleration_rtn[2]
        )
        after_gcrf[k] = flown[1, 0, k] + half_square * acceleration
        after_gcrf[k + 3] = flown[1, 0, k + 3] + step * acceleration


@compiled
def _fly_chief(
    chief_gcrf: FloatArray,
    accelerations_rtn: FloatArray,
    step: float,
    half_square: float,
    gm: float,
    oblateness: float,
) -> FloatArray:
    """Return what `fly_chief` does, with the constants of the attraction as in `fly_states`."""
    count = len(accelerations_rtn)
    states, rotation = np.empty((count + 1, 6)), np.empty((3, 3))
    for k in range(6):
        states[0, k] = chief_gcrf[k]
    for index in range(count):
        write_axes(states[index], rotation)
        _fly_step(
            states[index],
            rotation,
            accelerations_rtn[index],
            step,
            half_square,
            gm,
            oblateness,
            states[index + 1],
        )
    return states


@compiled
def _fly_deputy(
    relative_rtn: FloatArray,
    chief_gcrf: FloatArray,
    chief_after_gcrf: FloatArray,
    acceleration_rtn: FloatArray,
    step: float,
    half_square: float,
    gm: float,
    oblateness: float,
) -> tuple[FloatArray, FloatArray, float]:
    """Return the difference (6,) to the chief after a step in GCRF, and axes and rate there."""
    rotation, after = np.empty((3, 3)), np.empty(6)
    deputy = np.empty(6)
    rate = write_axes(chief_gcrf, rotation)
    write_deputy_state(chief_gcrf, rotation, rate, relative_rtn, deputy)
    _fly_step(deputy, rotation, acceleration_rtn, step, half_square, gm, oblateness, after)
    for k in range(6):
        after[k] -= chief_after_gcrf[k]
    rate = write_axes(chief_after_gcrf, rotation)
    return after, rotation, rate

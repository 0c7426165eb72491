"""Free flight of several spacecraft under the point mass and J2, compiled: for predictions.

Runge-Kutta 4 with given steps. One spacecraft and step cost about 0.2 us; in low orbit steps of
10 s are good to a millimetre in an hour, and the difference of two spacecraft of a formation to
far less than that with steps of 30 s.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH, J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.vectors import FloatArray

__all__ = ["add_thrust", "fly_states", "free_flight"]


@compiled
def _derivative(state: FloatArray, rate: FloatArray, gm: float, oblateness: float) -> None:
    """Write the rate of a state (6,)."""
    x, y, z = state[0], state[1], state[2]
    r2 = x * x + y * y + z * z
    factor = -gm / (r2 * math.sqrt(r2))
    flattening = oblateness / r2
    sine_squared = z * z / r2
    equatorial = factor * (1.0 + flattening * (1.0 - 5.0 * sine_squared))
    polar = factor * (1.0 + flattening * (3.0 - 5.0 * sine_squared))
    rate[0], rate[1], rate[2] = state[3], state[4], state[5]
    rate[3], rate[4], rate[5] = equatorial * x, equatorial * y, polar * z


@compiled
def fly_states(states: FloatArray, times: FloatArray, gm: float, oblateness: float) -> FloatArray:
    """Return the states (n, m, 6) at n times from those (m, 6) at the first.

    Parameters are those of `free_flight`, with the gravitational parameter, m3/s2, and 1.5 J2 times
    the square of the radius of the Earth, m2; nothing is checked.
    """
    count = len(states)
    flown = np.empty((len(times), count, 6))
    flown[0] = states
    rates = np.empty((4, 6))
    stage = np.empty(6)
    for index in range(1, len(times)):
        step = times[index] - times[index - 1]
        for craft in range(count):
            start = flown[index - 1, craft]
            _derivative(start, rates[0], gm, oblateness)
            for k in range(6):
                stage[k] = start[k] + 0.5 * step * rates[0, k]
            _derivative(stage, rates[1], gm, oblateness)
            for k in range(6):
                stage[k] = start[k] + 0.5 * step * rates[1, k]
            _derivative(stage, rates[2], gm, oblateness)
            for k in range(6):
                stage[k] = start[k] + step * rates[2, k]
            _derivative(stage, rates[3], gm, oblateness)
            for k in range(6):
                flown[index, craft, k] = start[k] + step / 6.0 * (
                    rates[0, k] + 2.0 * rates[1, k] + 2.0 * rates[2, k] + rates[3, k]
                )
    return flown


def free_flight(
    states_gcrf: npt.ArrayLike, times: npt.ArrayLike, j2: float = J2_EARTH
) -> FloatArray:
    """Return the states of spacecraft without thrust at given times.

    Parameters
    ----------
    states_gcrf
        Positions and velocities at the first time, m and m/s, shape (m, 6).
    times
        s, ascending, shape (n,); every interval is one step of the integration.
    j2
        Second zonal coefficient; 0 leaves the point mass.

    Returns
    -------
    ndarray, shape (n, m, 6)
        m and m/s in GCRF.

    Raises
    ------
    ValueError
        If a shape is wrong.
    """
    states = np.ascontiguousarray(states_gcrf, dtype=float)
    instants = np.ascontiguousarray(times, dtype=float)
    if states.ndim != 2 or states.shape[1] != 6:
        raise ValueError(f"states_gcrf: shape (m, 6) expected, got {states.shape}")
    if instants.ndim != 1 or not len(instants):
        raise ValueError(f"times: shape (n,) expected, got {instants.shape}")
    oblateness = 1.5 * j2 * RADIUS_EARTH_JGM3**2
    flown: FloatArray = fly_states(states, instants, GM_EARTH, oblateness)
    return flown


def add_thrust(states_gcrf: FloatArray, accelerations_gcrf: FloatArray, duration: float) -> None:
    """Add a constant thrust over a short time to states after a free flight of that time.

    Gravity at the place that the thrust leads to counts as that of the free flight.

    Parameters
    ----------
    states_gcrf
        Positions and velocities, m and m/s, shape (..., 6); changed in place.
    accelerations_gcrf
        m/s2, of a shape that fits (..., 3).
    duration
        s.
    """
    states_gcrf[..., :3] += 0.5 * duration**2 * accelerations_gcrf
    states_gcrf[..., 3:] += duration * accelerations_gcrf

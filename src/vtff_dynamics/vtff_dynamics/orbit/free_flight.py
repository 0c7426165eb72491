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

__all__ = [
    "acceleration_at",
    "add_thrust",
    "fly_states",
    "free_flight",
    "jerk_at",
    "scale_oblateness",
]


def scale_oblateness(j2: float) -> float:
    """Return 1.5 J2 times the square of the radius of the Earth, m2; 0 for the point mass."""
    return 1.5 * j2 * RADIUS_EARTH_JGM3 * RADIUS_EARTH_JGM3


@compiled
def acceleration_at(
    x: float, y: float, z: float, gm: float, oblateness: float
) -> tuple[float, float, float]:
    """Return the acceleration at a position (m), m/s2; the other parameters as of `fly_states`."""
    r2 = x * x + y * y + z * z
    # Without the branch for a divisor of zero that `/` has, spacecraft are flown side by side.
    factor = np.divide(-gm, r2 * math.sqrt(r2))
    flattening = np.divide(oblateness, r2)
    sine_squared = np.divide(z * z, r2)
    equatorial = factor * (1.0 + flattening * (1.0 - 5.0 * sine_squared))
    polar = factor * (1.0 + flattening * (3.0 - 5.0 * sine_squared))
    return equatorial * x, equatorial * y, polar * z


@compiled
def jerk_at(state: FloatArray, gm: float, oblateness: float) -> tuple[float, float, float]:
    """Return the rate of change of `acceleration_at` along a motion, m/s3.

    `state` is a position (m) and a velocity (m/s), shape (6,).
    """
    x, y, z, vx, vy, vz = state[0], state[1], state[2], state[3], state[4], state[5]
    r2 = x * x + y * y + z * z
    range_rate_ratio = (x * vx + y * vy + z * vz) / r2
    factor = -gm / (r2 * math.sqrt(r2))
    factor_rate = -3.0 * factor * range_rate_ratio
    flattening = oblateness / r2
    flattening_rate = -2.0 * flattening * range_rate_ratio
    sine_squared = z * z / r2
    sine_squared_rate = 2.0 * z * vz / r2 - 2.0 * sine_squared * range_rate_ratio

    common = -5.0 * flattening * sine_squared_rate
    equatorial = 1.0 + flattening * (1.0 - 5.0 * sine_squared)
    equatorial_rate = flattening_rate * (1.0 - 5.0 * sine_squared) + common
    polar = 1.0 + flattening * (3.0 - 5.0 * sine_squared)
    polar_rate = flattening_rate * (3.0 - 5.0 * sine_squared) + common
    along_position = factor_rate * equatorial + factor * equatorial_rate
    along_pole = factor_rate * polar + factor * polar_rate
    return (
        along_position * x + factor * equatorial * vx,
        along_position * y + factor * equatorial * vy,
        along_pole * z + factor * polar * vz,
    )


@compiled
def fly_states(states: FloatArray, times: FloatArray, gm: float, oblateness: float) -> FloatArray:
    """Return the states (n, m, 6) at n times from those (m, 6) at the first.

    Parameters are those of `free_flight`, with the gravitational parameter, m3/s2, and the
    oblateness of `scale_oblateness`, m2; nothing is checked. Eight spacecraft take less time than
    seven: those beyond a multiple of four are flown one by one.
    """
    flown = np.empty((len(times), len(states), 6))
    flown[0] = states
    for n in range(1, len(times)):
        step = times[n] - times[n - 1]
        half, sixth = 0.5 * step, step / 6.0
        for m in range(len(states)):
            x, y, z = flown[n - 1, m, 0], flown[n - 1, m, 1], flown[n - 1, m, 2]
            vx, vy, vz = flown[n - 1, m, 3], flown[n - 1, m, 4], flown[n - 1, m, 5]
            # Velocities and accelerations of the four stages.
            ax, ay, az = acceleration_at(x, y, z, gm, oblateness)
            vx2, vy2, vz2 = vx + half * ax, vy + half * ay, vz + half * az
            ax2, ay2, az2 = acceleration_at(
                x + half * vx, y + half * vy, z + half * vz, gm, oblateness
            )
            vx3, vy3, vz3 = vx + half * ax2, vy + half * ay2, vz + half * az2
            ax3, ay3, az3 = acceleration_at(
                x + half * vx2, y + half * vy2, z + half * vz2, gm, oblateness
            )
            vx4, vy4, vz4 = vx + step * ax3, vy + step * ay3, vz + step * az3
            ax4, ay4, az4 = acceleration_at(
                x + step * vx3, y + step * vy3, z + step * vz3, gm, oblateness
            )
            flown[n, m, 0] = x + sixth * (vx + 2.0 * vx2 + 2.0 * vx3 + vx4)
            flown[n, m, 1] = y + sixth * (vy + 2.0 * vy2 + 2.0 * vy3 + vy4)
            flown[n, m, 2] = z + sixth * (vz + 2.0 * vz2 + 2.0 * vz3 + vz4)
            flown[n, m, 3] = vx + sixth * (ax + 2.0 * ax2 + 2.0 * ax3 + ax4)
            flown[n, m, 4] = vy + sixth * (ay + 2.0 * ay2 + 2.0 * ay3 + ay4)
            flown[n, m, 5] = vz + sixth * (az + 2.0 * az2 + 2.0 * az3 + az4)
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
    flown: FloatArray = fly_states(states, instants, GM_EARTH, scale_oblateness(j2))
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

"""Steps of the errors of the orbits of chief and deputy, and short steps of antennas, compiled.

An array operation on nine numbers costs a hundred times what its arithmetic does.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import GM_EARTH
from vtff_gnss.constants import (
    EARTH_ROTATION_RATE_BROADCAST,
    GRAVITATIONAL_PARAMETER_BROADCAST,
    SYSTEM_GPS,
)

__all__ = [
    "advance_errors",
    "advance_errors_of_pair",
    "empirical_noise",
    "positions_at_reception",
    "transition_matrix",
    "white_acceleration_noise",
]

_GM = GRAVITATIONAL_PARAMETER_BROADCAST[SYSTEM_GPS]
# Receivers that are slower than this over the ground (m/s) stand on it or move near it.
_SLOWEST_ORBITAL_SPEED = 1e3


@compiled
def transition_matrix(position_gcrf, to_gcrf, step, empirical_time):  # type: ignore[no-untyped-def]
    """Return the transition matrix (9, 9) of a short step in the field of a point mass.

    Parameters
    ----------
    position_gcrf : ndarray, shape (3,)
        Position at which the gravity gradient is taken, m.
    to_gcrf : ndarray, shape (3, 3)
        Rotation from the axes of the empirical acceleration (RTN) to GCRF.
    step : float
        Length of the step, s.
    empirical_time : ndarray, shape (3,)
        Correlation time of the empirical acceleration on each axis, s.

    Notes
    -----
    The matrix is of third order in the step. J2 changes the gradient by 0.3 %, which no covariance
    needs; the states themselves are propagated with all forces.
    """
    squared = 0.0
    for i in range(3):
        squared += position_gcrf[i] ** 2
    factor = GM_EARTH / (squared * math.sqrt(squared))
    phi = np.zeros((9, 9))
    for i in range(3):
        for j in range(3):
            unit = 1.0 if i == j else 0.0
            gradient = factor * (3.0 * position_gcrf[i] * position_gcrf[j] / squared - unit)
            phi[i, j] = phi[3 + i, 3 + j] = unit + 0.5 * step**2 * gradient
            phi[i, 3 + j] = step * (unit + step**2 / 6.0 * gradient)
            phi[3 + i, j] = step * gradient
            phi[i, 6 + j] = 0.5 * step**2 * to_gcrf[i, j]
            phi[3 + i, 6 + j] = step * to_gcrf[i, j]
        phi[6 + i, 6 + i] = math.exp(-step / empirical_time[i])
    return phi


@compiled
def empirical_noise(empirical_sigma, empirical_time, to_gcrf, step):  # type: ignore[no-untyped-def]
    """Return the process noise (9, 9) of a Gauss-Markov empirical acceleration over a step.

    Parameters
    ----------
    empirical_sigma, empirical_time : ndarray, shape (3,)
        Steady-state sigma (m/s2) and correlation time (s) on each axis.
    to_gcrf : ndarray, shape (3, 3)
        Rotation from the axes of the empirical acceleration (RTN) to GCRF.
    step : float
        Length of the step, s; short against the correlation times.
    """
    process = np.zeros((9, 9))
    # The white noise that drives the acceleration is integrated once, twice and three times.
    for axis in range(3):
        density = 2.0 * empirical_sigma[axis] ** 2 / empirical_time[axis]
        process[6 + axis, 6 + axis] = density * step
        for i in range(3):
            along = density * to_gcrf[i, axis]
            process[i, 6 + axis] = process[6 + axis, i] = along * step**3 / 6.0
            process[3 + i, 6 + axis] = process[6 + axis, 3 + i] = along * step**2 / 2.0
            for j in range(3):
                both = density * (to_gcrf[i, axis] * to_gcrf[j, axis])
                process[i, j] += both * step**5 / 20.0
                process[i, 3 + j] += both * step**4 / 8.0
                process[3 + i, j] += both * step**4 / 8.0
                process[3 + i, 3 + j] += both * step**3 / 3.0
    return process


@compiled
def white_acceleration_noise(root_density, step):  # type: ignore[no-untyped-def]
    """Return the process noise (9, 9) of white acceleration over a step.

    Parameters
    ----------
    root_density : float
        Root of the spectral density on each axis, m/s2/sqrt(Hz).
    step : float
        Length of the step, s.
    """
    density = root_density**2
    process = np.zeros((9, 9))
    for i in range(3):
        process[i, i] = density * step**3 / 3.0
        process[i, 3 + i] = process[3 + i, i] = density * step**2 / 2.0
        process[3 + i, 3 + i] = density * step
    return process


@compiled
def advance_errors(  # type: ignore[no-untyped-def]
    position_gcrf, to_gcrf, step, empirical_sigma, empirical_time, white_density, transition, noise
):
    """Carry transition matrix and process noise (9, 9) of a motion over a step, in place.

    Parameters
    ----------
    position_gcrf, to_gcrf, step, empirical_time
        See `transition_matrix`.
    empirical_sigma : ndarray, shape (3,)
        See `empirical_noise`.
    white_density : float
        See `white_acceleration_noise`.
    transition, noise : ndarray, shape (9, 9)
        From the begin of the epoch to that of the step; afterwards, to its end.

    Returns
    -------
    ndarray, shape (9, 9)
        Transition matrix of the step.
    """
    phi = transition_matrix(position_gcrf, to_gcrf, step, empirical_time)
    process = empirical_noise(empirical_sigma, empirical_time, to_gcrf, step)
    if white_density > 0.0:
        process += white_acceleration_noise(white_density, step)
    transition[:] = phi @ transition
    noise[:] = phi @ noise @ phi.T + process
    return phi


@compiled
def advance_errors_of_pair(  # type: ignore[no-untyped-def]
    chief,
    relative,
    to_gcrf,
    step,
    sigma_chief,
    time_chief,
    sigma_relative,
    time_relative,
    white_chief,
    white_relative,
    transition_chief,
    noise_chief,
    transition_relative,
    noise_relative,
):
    """Carry the errors of the motions of chief and difference over a step, in place.

    Parameters
    ----------
    chief, relative : ndarray, shape (9,)
        Position, velocity (GCRF) and empirical acceleration (RTN) at the begin of the step,
        deputy less chief.
    to_gcrf, ..., noise_relative
        See `advance_errors`, of both.

    Returns
    -------
    ndarray, shape (9, 9)
        Transition matrix of the difference over the step.
    """
    middle = np.empty(3)
    for axis in range(3):
        middle[axis] = chief[axis] + 0.5 * relative[axis]
    advance_errors(
        chief,
        to_gcrf,
        step,
        sigma_chief,
        time_chief,
        white_chief,
        transition_chief,
        noise_chief,
    )
    return advance_errors(
        middle,
        to_gcrf,
        step,
        sigma_relative,
        time_relative,
        white_relative,
        transition_relative,
        noise_relative,
    )


@compiled
def positions_at_reception(states_itrf, delays):  # type: ignore[no-untyped-def]
    """Return positions some time later, ITRF, m, shape (n, 3).

    They move on by the velocity and, but for receivers on the ground, free fall: point mass,
    Coriolis and centrifugal acceleration.

    Parameters
    ----------
    states_itrf : ndarray, shape (n, 6)
        Positions and Earth-fixed velocities, m and m/s.
    delays : ndarray, shape (n,)
        s, so short that the acceleration is constant.
    """
    later = np.empty((len(states_itrf), 3))
    rate = EARTH_ROTATION_RATE_BROADCAST
    for n in range(len(states_itrf)):
        x, y, z, vx, vy, vz = states_itrf[n]
        delay, ax, ay, az = delays[n], 0.0, 0.0, 0.0
        if math.sqrt(vx * vx + vy * vy + vz * vz) > _SLOWEST_ORBITAL_SPEED:
            radius = math.sqrt(x * x + y * y + z * z)
            pull = -_GM / radius**3
            ax = (pull + rate**2) * x + 2.0 * rate * vy
            ay = (pull + rate**2) * y - 2.0 * rate * vx
            az = pull * z
        later[n, 0] = x + delay * (vx + 0.5 * delay * ax)
        later[n, 1] = y + delay * (vy + 0.5 * delay * ay)
        later[n, 2] = z + delay * (vz + 0.5 * delay * az)
    return later

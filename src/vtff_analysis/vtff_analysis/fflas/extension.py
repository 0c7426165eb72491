"""Extension and disposal of paper 002: phasing (figures 4 to 6), tables 3 and 5, the deorbit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from vtff_analysis.studies.formation_designs import FFLAS_AXIS
from vtff_control.guidance.phasing import Phasing
from vtff_dynamics.constants import GM_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "BUDGET",
    "TABLE_3",
    "TABLE_5",
    "Deorbit",
    "PhasingFlight",
    "deorbit",
    "extension_years",
    "fly_phasing",
    "separation_inputs",
]

BUDGET = 2300.0  # m/s, table 1
TABLE_3 = {2: 11, 5: 11, 10: 14, 15: 18, 30: 22}
"""Angle (deg) and extension (months) until two satellites are 100 m apart."""
TABLE_5 = {1: 2, 2: 4, 3: 10, 4: 20, 5: 25}
"""Propellant left (per cent) and extension (years) at about 30 mm/s a day."""
THRESHOLD = 100.0  # m, of table 3
DEORBIT_ALTITUDE = 120e3  # m
_DAYS_PER_YEAR = 365.25
_MONTH = _DAYS_PER_YEAR / 12.0 * 86400.0


@dataclass(frozen=True, eq=False)
class PhasingFlight:
    """A phasing flown by equation (1) of the paper, in the orbital plane and without J2.

    Attributes
    ----------
    times
        s, shape (k,).
    semi_major_axis
        Osculating, m, shape (k,).
    angle
        Ahead of the reference, rad, shape (k,).
    eccentricity
        Eccentricity of the orbit at the end.
    """

    times: FloatArray
    semi_major_axis: FloatArray
    angle: FloatArray
    eccentricity: float


@dataclass(frozen=True)
class Deorbit:
    """A spiral from the reference orbit down.

    Attributes
    ----------
    velocity_change
        m/s.
    days
        With the thrust on all the time.
    """

    velocity_change: float
    days: float


def fly_phasing(phasing: Phasing, samples: int = 1500) -> PhasingFlight:
    """Integrate equation (1) of the paper with the thrust of a phasing that gets ahead.

    Parameters
    ----------
    phasing
        Legs as `vtff_control.guidance.phasing.phase` returns them.
    samples
        Number of samples of the result.
    """
    mean_motion = math.sqrt(GM_EARTH / FFLAS_AXIS**3)
    thrust, coast = phasing.thrust_time, phasing.coast_time
    sign = math.copysign(1.0, phasing.semi_major_axis_change)
    state = np.array([FFLAS_AXIS, 0.0, 0.0, math.sqrt(GM_EARTH / FFLAS_AXIS)])
    times, states = [np.zeros(1)], [state[:, np.newaxis]]
    begin = 0.0
    total = 2.0 * thrust + coast
    for length, acceleration in (
        (thrust, sign * phasing.acceleration),
        (coast, 0.0),
        (thrust, -sign * phasing.acceleration),
    ):

        def rate(_: float, y: FloatArray, held: float = acceleration) -> list[float]:
            radius, _angle, radial, tangential = y.tolist()
            return [
                radial,
                tangential / radius,
                tangential**2 / radius - GM_EARTH / radius**2,
                -radial * tangential / radius + held,
            ]

        grid = np.linspace(0.0, length, max(2, int(samples * length / total)))
        solution = solve_ivp(
            rate, (0.0, length), state, method="DOP853", t_eval=grid, rtol=1e-11, atol=1e-6
        )
        times.append(begin + grid[1:])
        states.append(solution.y[:, 1:])
        state = solution.y[:, -1]
        begin += length
    moments = np.concatenate(times)
    radius, angle, radial, tangential = np.hstack(states)
    axis = 1.0 / (2.0 / radius - (radial**2 + tangential**2) / GM_EARTH)
    momentum = radius[-1] * tangential[-1]
    eccentricity = math.sqrt(max(0.0, 1.0 - momentum**2 / (GM_EARTH * axis[-1])))
    return PhasingFlight(moments, axis, angle - mean_motion * moments, eccentricity)


def extension_years(percent: float, velocity_change_per_day: float) -> float:
    """Return the years of keeping that a share of the propellant allows.

    Parameters
    ----------
    percent
        Share of the budget of table 1, in per cent.
    velocity_change_per_day
        m/s.
    """
    return 0.01 * percent * BUDGET / velocity_change_per_day / _DAYS_PER_YEAR


def separation_inputs(angle_deg: float, months: float) -> tuple[float, float]:
    """Return what would bring two satellites together to 100 m in a time of table 3.

    The paper gives neither the differential drag nor the error of the semi-major axes; each entry
    of the table follows from either.

    Returns
    -------
    axis_difference : float
        A constant difference of the semi-major axes, m.
    acceleration_difference : float
        A constant differential drag, m/s2.
    """
    arc = math.radians(angle_deg) * FFLAS_AXIS - THRESHOLD
    time = months * _MONTH
    mean_motion = math.sqrt(GM_EARTH / FFLAS_AXIS**3)
    return arc / (1.5 * mean_motion * time), arc / (1.5 * time**2)


def deorbit(thrust: float, mass: float, altitude: float = DEORBIT_ALTITUDE) -> Deorbit:
    """Return velocity change and time of a low-thrust spiral down to an altitude.

    Parameters
    ----------
    thrust
        N, against the motion.
    mass
        kg; the propellant used is left out.
    altitude
        m, at the end.

    References
    ----------
    Edelbaum (1961), Propulsion Requirements for Controllable Satellites, ARS J. 31: without a
    change of the plane the velocity change is the difference of the circular speeds.
    """
    speeds = [math.sqrt(GM_EARTH / r) for r in (FFLAS_AXIS, RADIUS_EARTH_JGM3 + altitude)]
    change = speeds[1] - speeds[0]
    return Deorbit(change, change * mass / thrust / 86400.0)

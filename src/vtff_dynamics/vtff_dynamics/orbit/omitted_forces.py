"""Accelerations that a model of gravity leaves out: harmonics by Kaula's rule, other forces.

Navigation filters have it in the prior of unmodelled accelerations, and covariance bounds of
worlds with real gravity count it as unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from vtff_dynamics.constants import GM_EARTH, RADIUS_EARTH_JGM3

__all__ = ["OmittedGravity", "omitted_gravity", "other_forces"]

# Kaula 1966, Theory of Satellite Geodesy, section 5.2: RMS of a normalised coefficient of degree n,
# as a multiple of 1 / n^2. He gives 1e-5; those of JGM-3 above degree 8 are 0.7 of it.
_KAULA = 7e-6
_HIGHEST_DEGREE = 300  # above it nothing is left in orbit
# Harmonics of degree n stay alike over an angle of this / n, where the Bessel function J0 is 1/e.
_ALIKE_ANGLE = 1.75

# Accelerations of a spacecraft with 0.01 m2/kg besides the gravity of the Earth, m/s2: Moon, Sun
# and radiation together in low orbit, and drag under an active Sun at a height (m), with the scale
# height (m) there (Montenbruck and Gill 2000, figure 3.1 and section 3.5). The exponent of the
# drag is limited where orbits end.
_MOON_SUN_AND_RADIATION = 1.5e-6
_DRAG, _DRAG_HEIGHT, _DRAG_SCALE_HEIGHT = 1e-6, 550e3, 65e3
_LARGEST_DRAG_EXPONENT = 7.0


@dataclass(frozen=True)
class OmittedGravity:
    """Accelerations that a model of gravity leaves out in a circular orbit, RMS over the globe.

    Parameters
    ----------
    acceleration_sigma : float
        On each axis, m/s2.
    acceleration_time : float
        Correlation time along the orbit, s.
    gradient_sigma : float
        Difference of the accelerations at two points on each axis, for each metre between them,
        1/s2.
    gradient_time : float
        Correlation time of that difference, s.
    """

    acceleration_sigma: float
    acceleration_time: float
    gradient_sigma: float
    gradient_time: float


@cache
def omitted_gravity(degree: int, radius: float) -> OmittedGravity:
    """Return what the harmonics beyond a degree do in a circular orbit.

    The square of the gradient of a solid harmonic of degree n, r^-(n+1), has the mean
    (n + 1) (2 n + 1) / r^2 times that of the harmonic itself; its components are harmonics of
    degree n + 1, so that the second gradient follows in the same way.

    Parameters
    ----------
    degree : int
        Highest degree of the model, 2 or more: the flattening of the Earth does not follow the
        rule.
    radius : float
        Radius of the orbit, m; below the ground that of the Earth is taken.

    Raises
    ------
    ValueError
        If the degree is below 2.
    """
    if degree < 2:
        raise ValueError(f"degree {degree}: 2 or more expected")
    radius = max(radius, RADIUS_EARTH_JGM3)
    n = np.arange(degree + 1, max(_HIGHEST_DEGREE, degree + 1) + 1, dtype=float)
    potential = (GM_EARTH / radius) ** 2 * (RADIUS_EARTH_JGM3 / radius) ** (2.0 * n)
    potential *= (2.0 * n + 1.0) * (_KAULA / n**2) ** 2
    acceleration = potential * (n + 1.0) * (2.0 * n + 1.0) / radius**2
    gradient = acceleration * (n + 2.0) * (2.0 * n + 3.0) / radius**2
    angular_rate = math.sqrt(GM_EARTH / radius**3)

    def time(power: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
        mean_degree = float(n @ power / power.sum())
        return _ALIKE_ANGLE / (mean_degree * angular_rate)

    return OmittedGravity(
        acceleration_sigma=math.sqrt(float(acceleration.sum()) / 3.0),
        acceleration_time=time(acceleration),
        gradient_sigma=math.sqrt(float(gradient.sum()) / 9.0),
        gradient_time=time(gradient),
    )


def other_forces(radius: float) -> float:
    """Return the size of the accelerations of a satellite besides the gravity of the Earth, m/s2.

    They change as the satellite goes round its orbit.

    Parameters
    ----------
    radius : float
        Distance from the centre of the Earth, m.
    """
    exponent = (_DRAG_HEIGHT - (radius - RADIUS_EARTH_JGM3)) / _DRAG_SCALE_HEIGHT
    drag = _DRAG * math.exp(min(exponent, _LARGEST_DRAG_EXPONENT))
    return math.hypot(_MOON_SUN_AND_RADIATION, drag)

"""Mean elements under J2: osculating to mean and back, and their secular rates.

The elements are quasi-nonsingular (semi-major axis, mean argument of latitude, eccentricity vector,
inclination, node), as arrays of shape (6,), m and rad. Gauss's equations with the acceleration of
J2 are averaged over the mean argument of latitude by quadrature, at fixed elements: the mean is the
secular rate, the periodic rest integrated is the short-period part. This is the first order of the
method of averaging for any eccentricity, without the series of Brouwer and Lyddane in the
eccentricity and without their long-period terms, which have the critical inclination as a pole.
What is left out is of the second order in J2: some metres in the orbit of one spacecraft, but for
the difference of two only their distance times 1e-6 for each radian of motion.

References
----------
Battin (1999), An Introduction to the Mathematics and Methods of Astrodynamics, section 10.3, for
Gauss's equations; Sanders, Verhulst and Murdock (2007), Averaging Methods, chapter 2; Brouwer
(1959), Astron. J. 64, and Lyddane (1963), Astron. J. 68, for the theory that this replaces.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.orbit.elements import ClassicalElements, QuasiNonsingularElements
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "elements_from_state",
    "mean_elements",
    "osculating_elements",
    "secular_rates",
    "short_period_elements",
    "state_from_elements",
]

_SAMPLES = 64
"""Samples of an orbit; the harmonics that matter fall with the eccentricity: 1e-13 m at 0.1."""
_LARGEST_ECCENTRICITY = 0.5
_ITERATIONS = 30
_TOLERANCE = 1e-15  # of the elements in radians: some nanometres


def elements_from_state(state_gcrf: npt.ArrayLike) -> FloatArray:
    """Return the osculating elements of a state (6,), shape (6,).

    Raises
    ------
    ValueError
        If the state is not on an ellipse.
    """
    elements = QuasiNonsingularElements.from_classical(ClassicalElements.from_state(state_gcrf))
    return np.array(list(vars(elements).values()))


def state_from_elements(elements: npt.ArrayLike) -> FloatArray:
    """Return position and velocity in GCRF (m, m/s) of osculating elements, both shape (6,)."""
    values = np.asarray(elements, dtype=float).tolist()
    return QuasiNonsingularElements(*values).to_classical().to_state()


def _j2_rates(elements: FloatArray, mean_latitude: FloatArray) -> FloatArray:
    """Return the rates of the elements by J2 along an orbit, without the mean motion, (6, n).

    Parameters
    ----------
    elements
        Elements, shape (6,); the mean argument of latitude is not used.
    mean_latitude
        Mean arguments of latitude, rad, shape (n,).
    """
    axis, _, ex, ey, inclination, _ = elements.tolist()
    # Kepler's equation for the eccentric argument of latitude.
    eccentric = mean_latitude + ex * np.sin(mean_latitude) - ey * np.cos(mean_latitude)
    for _ in range(_ITERATIONS):
        sine, cosine = np.sin(eccentric), np.cos(eccentric)
        change = (eccentric - ex * sine + ey * cosine - mean_latitude) / (
            1.0 - ex * cosine - ey * sine
        )
        eccentric = eccentric - change
        if np.abs(change).max() < 1e-15:
            break
    sine, cosine = np.sin(eccentric), np.cos(eccentric)
    eta = math.sqrt(1.0 - ex * ex - ey * ey)
    radius = axis * (1.0 - ex * cosine - ey * sine)
    projected = (ex * sine - ey * cosine) / (1.0 + eta)
    cos_true = axis / radius * (cosine - ex + ey * projected)
    sin_true = axis / radius * (sine - ey - ex * projected)

    sin_i, cos_i = math.sin(inclination), math.cos(inclination)
    strength = -1.5 * J2_EARTH * GM_EARTH * RADIUS_EARTH_JGM3**2 / radius**4
    force_r = strength * (1.0 - 3.0 * sin_i**2 * sin_true**2)
    force_t = strength * 2.0 * sin_i**2 * sin_true * cos_true
    force_n = strength * 2.0 * sin_i * cos_i * sin_true

    parameter = axis * eta * eta
    momentum = math.sqrt(GM_EARTH * parameter)
    ratio = parameter / radius
    e_cos = ex * cos_true + ey * sin_true
    e_sin = ex * sin_true - ey * cos_true
    # force_n / sin i: finite on equatorial orbits, where the node itself is not.
    normal = radius / momentum * sin_true * strength * 2.0 * cos_i * sin_true
    scale = parameter / momentum
    along = force_t / ratio
    return np.array(
        [
            2.0 * axis**2 / momentum * (e_sin * force_r + ratio * force_t),
            -force_r * (parameter * e_cos / (1.0 + eta) + 2.0 * eta * radius) / momentum
            + force_t * (parameter + radius) * e_sin / ((1.0 + eta) * momentum)
            - normal * cos_i,
            scale * (sin_true * force_r + ((ratio + 1.0) * cos_true + ex) * along)
            + ey * cos_i * normal,
            scale * (-cos_true * force_r + ((ratio + 1.0) * sin_true + ey) * along)
            - ex * cos_i * normal,
            radius / momentum * cos_true * force_n,
            normal,
        ]
    )


def secular_rates(elements_mean: npt.ArrayLike) -> FloatArray:
    """Return the rates of mean elements by J2 in closed form, with the mean motion, shape (6,).

    Parameters
    ----------
    elements_mean
        Mean elements, m and rad, shape (6,).

    Returns
    -------
    ndarray, shape (6,)
        m/s, rad/s and 1/s; the semi-major axis and the inclination stay.

    References
    ----------
    Koenig, Guffanti and D'Amico (2017), J. Guidance Control Dynamics 40(7), eqs. (14) and (15).
    """
    axis, _, ex, ey, inclination, _ = np.asarray(elements_mean, dtype=float).tolist()
    mean_motion = math.sqrt(GM_EARTH / axis**3)
    eta = math.sqrt(1.0 - ex * ex - ey * ey)
    kappa = 0.75 * J2_EARTH * (RADIUS_EARTH_JGM3 / axis) ** 2 * mean_motion / eta**4
    cosine = math.cos(inclination)
    perigee_rate = kappa * (5.0 * cosine**2 - 1.0)
    return np.array(
        [
            0.0,
            mean_motion + kappa * eta * (3.0 * cosine**2 - 1.0) + perigee_rate,
            -ey * perigee_rate,
            ex * perigee_rate,
            0.0,
            -2.0 * kappa * cosine,
        ]
    )


def short_period_elements(elements_mean: npt.ArrayLike) -> FloatArray:
    """Return what J2 adds to mean elements within an orbit, m and rad, shape (6,).

    Parameters
    ----------
    elements_mean
        Mean elements, m and rad, shape (6,).
    """
    elements = np.asarray(elements_mean, dtype=float)
    axis = float(elements[0])
    mean_motion = math.sqrt(GM_EARTH / axis**3)
    latitude = 2.0 * math.pi * np.arange(_SAMPLES) / _SAMPLES
    spectrum = np.fft.rfft(_j2_rates(elements, latitude), axis=1) / (_SAMPLES * mean_motion)
    order = np.arange(spectrum.shape[1])
    integral = np.zeros_like(spectrum)
    integral[:, 1:] = spectrum[:, 1:] / (1j * order[1:])
    # A larger semi-major axis slows the mean motion: that is integrated once more.
    integral[1, 1:] -= 1.5 / axis * integral[0, 1:] / (1j * order[1:])
    phase = np.exp(1j * order * float(elements[1]))
    phase[1:-1] *= 2.0  # the negative frequencies
    periodic: FloatArray = (integral @ phase).real
    return periodic


def osculating_elements(elements_mean: npt.ArrayLike) -> FloatArray:
    """Return osculating elements of mean ones, both m and rad, shape (6,)."""
    mean = np.asarray(elements_mean, dtype=float)
    return mean + short_period_elements(mean)


def mean_elements(elements_osculating: npt.ArrayLike) -> FloatArray:
    """Return mean elements of osculating ones; the inverse of `osculating_elements`.

    Raises
    ------
    ValueError
        If the eccentricity is beyond 0.5, or the iteration does not converge.
    """
    osculating = np.asarray(elements_osculating, dtype=float)
    eccentricity = math.hypot(float(osculating[2]), float(osculating[3]))
    if not eccentricity <= _LARGEST_ECCENTRICITY:
        raise ValueError(
            f"elements_osculating: eccentricity up to {_LARGEST_ECCENTRICITY:g} expected, "
            f"got {eccentricity:g}"
        )
    scale = np.array([osculating[0], 1.0, 1.0, 1.0, 1.0, 1.0])
    mean = osculating
    for _ in range(_ITERATIONS):
        previous, mean = mean, osculating - short_period_elements(mean)
        if np.abs((mean - previous) / scale).max() < 8.0 * _TOLERANCE:
            return mean
    raise ValueError("elements_osculating: the iteration for mean elements does not converge")

"""Error of a model of the Earth's magnetic field, as a process along an orbit.

The error is the gradient of a potential, and that ties its components together. For a potential V
of degree n at a radius r the radial component is (n + 1) V / r, that along the track -dV / ds: the
component along the track is minus the derivative of the radial one, over n + 1. So it has no mean
over long arcs, and an error of the pitch, which lasts, is not taken for an error of the field.
Along a track through an isotropic field V has the mean square frequency n (n + 1) / 2, in turns an
orbit; the component across the track, which is independent of both others, has n (n + 1) / 4.

The error is fixed to the Earth, and an orbit later the track is 25 deg further west or nearer: what
the model erred by there comes again, with a correlation of 0.54 on average over the orbit, 0.25
after two and 0.14 after three (degrees 1 to 8). The processes forget within an orbit, so the filter
would take the orbits for independent and be too sure by their number. Their variance is larger by
what that makes of the mean of two orbits.

Each process has a correlation close to a Gaussian function: a field has no higher frequency than
its degree, and processes of low order, with their tails of high frequencies, forget too fast.

References
----------
Lowes (1966), Mean-square values on sphere of spherical harmonic vector fields, J. Geophys. Res. 71.
Lowes (2000), An estimate of the errors of the IGRF/DGRF fields, Geophys. J. Int. 142, 946-947.
Hartikainen and Sarkka (2010), Kalman filtering and smoothing solutions to temporal Gaussian process
regression models, section 4.2: the Gaussian function by a process of finite order.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = ["FIELD_STATES", "REPEATED_ORBIT", "FieldErrorModel", "track_rate"]

_ORDER = 4
_GROUPS = 2
_ALONG, _ACROSS = 2, 3
_PROCESSES = 4
FIELD_STATES = _PROCESSES * _ORDER
"""Value and three scaled derivatives of each of four processes: the radial component of the low
degrees, that of the high ones, what of the component along the track does not follow from them
(degrees of one group differ), and the component across the track."""

REPEATED_ORBIT = 1.54
"""Variance of the mean of the error over two orbits, over that of two independent orbits."""


class FieldErrorModel:
    """The processes of an error of given size and degrees.

    The default takes equal mean squares of the degrees 1 to 8. IGRF has more degrees, but what it
    errs by in orbit are the long waves: it predicts the secular variation of these degrees for five
    years ahead, the ring current is of the first, and a harmonic of degree n fades with height by
    (n + 2) times its share of the radius. A spectrum with more of the high degrees is the less safe
    choice: short waves average out along an orbit, so it states too small an error of the attitude.

    Parameters
    ----------
    sigma : float
        Root mean square of a component, T; the radial one is larger, the others smaller.
    low_degrees, high_degrees : tuple of int
        First and last degree of the two groups.
    """

    def __init__(
        self,
        sigma: float,
        low_degrees: tuple[int, int] = (1, 2),
        high_degrees: tuple[int, int] = (3, 8),
    ) -> None:
        groups = [np.arange(first, last + 1.0) for first, last in (low_degrees, high_degrees)]
        degrees = np.concatenate(groups)
        power = 3.0 / len(degrees)  # of all components, of each degree, over sigma^2
        form = _unit_process()
        self._numbers = np.empty(_PROCESSES)  # 1/rad of the track, by which derivatives are scaled
        self._sigmas = np.empty(_PROCESSES)
        self._follow = np.empty(_GROUPS)  # rad
        rest, across = np.zeros(2), np.zeros(2)
        for index, degree in enumerate(groups):
            potential = power / ((degree + 1.0) * (2.0 * degree + 1.0))  # V2 / r2
            square = degree * (degree + 1.0)
            radial, slope = (degree + 1.0) ** 2 * potential, 0.5 * square * potential
            self._sigmas[index] = math.sqrt(radial.sum())
            frequency = math.sqrt(float((0.5 * square * radial).sum() / radial.sum()))
            self._numbers[index] = frequency / form.frequency
            # Regression of the component along the track on the derivative of the radial one.
            follow = ((degree + 1.0) * slope).sum() / ((degree + 1.0) ** 2 * slope).sum()
            self._follow[index] = follow
            left = slope * (1.0 - follow * (degree + 1.0)) ** 2
            rest += np.array([left.sum(), (0.75 * square * left).sum()])
            # The component across has the mean square of that along.
            across += np.array([slope.sum(), (0.25 * square * slope).sum()])
        for place, (size, squared) in ((_ALONG, rest), (_ACROSS, across)):
            self._sigmas[place] = math.sqrt(size)
            self._numbers[place] = math.sqrt(squared / size) / form.frequency
        self._sigmas *= sigma * math.sqrt(REPEATED_ORBIT)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the states without measurements, T2, shape (16, 16)."""
        covariance = np.zeros((FIELD_STATES, FIELD_STATES))
        for index, sigma in enumerate(self._sigmas):
            part = slice(index * _ORDER, (index + 1) * _ORDER)
            covariance[part, part] = sigma**2 * _unit_process().covariance
        return covariance

    def transition(self, turn: float) -> FloatArray:
        """Return the transition over an angle of the track, rad, shape (16, 16)."""
        transition = np.zeros((FIELD_STATES, FIELD_STATES))
        for index, number in enumerate(self._numbers):
            part = slice(index * _ORDER, (index + 1) * _ORDER)
            transition[part, part] = _unit_process().transition(turn * number)
        return transition

    def partial(self, position_gcrf: FloatArray, velocity_gcrf: FloatArray) -> FloatArray:
        """Return the derivatives of the error in GCRF axes by the states, shape (3, 16).

        Parameters
        ----------
        position_gcrf, velocity_gcrf : ndarray, shape (3,)
            m and m/s. The track is that over the Earth, which turns with the field.
        """
        along = velocity_gcrf - _velocity_of_the_ground(position_gcrf)
        radial, track, across = rotation_gcrf_to_rtn(np.concatenate((position_gcrf, along)))
        partial = np.zeros((3, FIELD_STATES))
        for index in range(_GROUPS):
            first = index * _ORDER
            partial[:, first] = radial
            partial[:, first + 1] = -self._follow[index] * self._numbers[index] * track
        partial[:, _ALONG * _ORDER] = track
        partial[:, _ACROSS * _ORDER] = across
        return partial


def track_rate(position_gcrf: FloatArray, velocity_gcrf: FloatArray) -> float:
    """Return the rate of the track over the Earth, rad/s."""
    along = velocity_gcrf - _velocity_of_the_ground(position_gcrf)
    return norm(cross(position_gcrf, along)) / float(position_gcrf @ position_gcrf)


def _velocity_of_the_ground(position_gcrf: FloatArray) -> FloatArray:
    return EARTH_ROTATION_RATE * np.array([-position_gcrf[1], position_gcrf[0], 0.0])


class _UnitProcess:
    """Process of order 4 and unit variance whose spectrum is close to exp(-w2 / 2).

    Attributes
    ----------
    covariance
        Covariance of value and derivatives, shape (4, 4).
    frequency
        Root of its mean square frequency.
    """

    def __init__(self) -> None:
        from scipy.linalg import solve_continuous_lyapunov

        # 1 / spectrum = sum of (w2 / 2)^k / k!; with s = i w, w2 = -s2. The stable half of the
        # poles makes the process.
        powers = np.zeros(2 * _ORDER + 1)
        for k in range(_ORDER + 1):
            powers[2 * k] = (-0.5) ** k / math.factorial(k)
        poles = np.roots(powers[::-1])
        polynomial = np.real(np.poly(poles[poles.real < 0.0]))
        self._matrix = np.diag(np.ones(_ORDER - 1), 1)
        self._matrix[-1] = -polynomial[:0:-1]
        drive = np.zeros((_ORDER, _ORDER))
        drive[-1, -1] = 1.0
        covariance = solve_continuous_lyapunov(self._matrix, -drive)
        covariance = 0.5 * (covariance + covariance.T)
        self.covariance: FloatArray = covariance / covariance[0, 0]
        self.frequency = math.sqrt(float(self.covariance[1, 1]))

    def transition(self, time: float) -> FloatArray:
        """Return the transition over a time, shape (4, 4)."""
        from scipy.linalg import expm

        return np.asarray(expm(time * self._matrix))


@functools.cache
def _unit_process() -> _UnitProcess:
    return _UnitProcess()

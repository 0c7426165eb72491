"""Error of a model of the Earth's magnetic field, as the harmonics of a potential.

The error is the gradient of a potential that turns with the Earth. So its components are tied to
each other, it has no mean over long arcs (an error of the pitch, which lasts, is not taken for an
error of the field), and it comes again where a later orbit passes near an earlier one: each pass
tells of the same coefficients, and the filter neither takes the orbits for independent nor forgets
what it has learned of the field. The coefficients change slowly in time.

The degrees 1 to 12 are assumed to have equal mean squares. In orbit they hold the error of IGRF: a
harmonic of degree n fades with height by (n + 2) times its share of the radius. Degrees that are
left out would be taken for noise of the sensor, which a minute averages.

References
----------
Lowes (1966), Mean-square values on sphere of spherical harmonic vector fields, J. Geophys. Res. 71.
Lowes (2000), An estimate of the errors of the IGRF/DGRF fields, Geophys. J. Int. 142, 946-947.
Winch, Ivers, Turner and Stening (2005), Geomagnetism and Schmidt quasi-normalization, Geophys. J.
Int. 160, 487-504.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.vectors import FloatArray, norm

__all__ = ["FIELD_STATES", "FieldErrorModel"]

_DEGREE = 12
FIELD_STATES = _DEGREE * (_DEGREE + 2)
"""Coefficients of the degrees 1 to 12."""


class FieldErrorModel:
    """The coefficients of an error of given size.

    The axes of the coefficients turn with the Earth from those of GCRF at the start: the error is
    as likely in any direction, so the Greenwich angle need not be known.

    Parameters
    ----------
    sigma : float
        Root mean square of a component at the orbit, T; the radial one is larger, the others
        smaller.
    """

    def __init__(self, sigma: float) -> None:
        self._radius = math.nan
        variances = []
        for degree in range(1, _DEGREE + 1):
            # The mean square of all components of a degree is (n + 1) times the sum of the squares
            # of its coefficients (Lowes 1966).
            power = 3.0 * sigma**2 / _DEGREE / ((degree + 1.0) * (2.0 * degree + 1.0))
            variances += [power] * (2 * degree + 1)
        self.variances: FloatArray = np.array(variances)
        """Variances of the coefficients, T2, shape (168,)."""

    def partial(self, position_gcrf: FloatArray, elapsed: float) -> FloatArray:
        """Return the derivatives of the error in GCRF axes by the coefficients, shape (3, 168).

        Parameters
        ----------
        position_gcrf : ndarray, shape (3,)
            m. The sigma holds at the distance of the first position from the Earth's centre.
        elapsed : float
            Time since the start, s.
        """
        if math.isnan(self._radius):
            self._radius = norm(position_gcrf)
        partial: FloatArray = _fields_of_harmonics(
            np.asarray(position_gcrf, dtype=float), EARTH_ROTATION_RATE * elapsed, self._radius
        )
        return partial


@compiled
def _fields_of_harmonics(position, angle, reference_radius):  # type: ignore[no-untyped-def]
    """Return the field of each harmonic of unit coefficient, in the axes of the position, (3, 168).

    The axes of the harmonics are turned about z by `angle`. The functions are Schmidt's; those of
    order 1 and more are divided by the sine of the colatitude, so that the poles are no exception.
    """
    radius = math.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
    across = math.sqrt(position[0] ** 2 + position[1] ** 2)
    cosine, sine = position[2] / radius, across / radius
    longitude = math.atan2(position[1], position[0])
    up = position / radius
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    south = np.array([cosine * math.cos(longitude), cosine * math.sin(longitude), -sine])
    # Functions of order 0, and of the others over the sine.
    functions = np.zeros((_DEGREE + 1, _DEGREE + 1))
    functions[0, 0] = 1.0
    functions[1, 1] = 1.0
    for order in range(2, _DEGREE + 1):
        functions[order, order] = (
            math.sqrt((2.0 * order - 1.0) / (2.0 * order)) * sine * functions[order - 1, order - 1]
        )
    for order in range(_DEGREE + 1):
        for degree in range(order + 1, _DEGREE + 1):
            value = (2.0 * degree - 1.0) * cosine * functions[degree - 1, order]
            if degree > order + 1:
                value -= math.sqrt((degree - 1.0) ** 2 - order**2) * functions[degree - 2, order]
            functions[degree, order] = value / math.sqrt(float(degree**2 - order**2))
    fields = np.empty((3, _DEGREE * (_DEGREE + 2)))
    column = 0
    for degree in range(1, _DEGREE + 1):
        fade = (reference_radius / radius) ** (degree + 2)
        for order in range(degree + 1):
            function = functions[degree, order]
            if order == 0:
                value = function
                slope = -math.sqrt(0.5 * degree * (degree + 1.0)) * sine * functions[degree, 1]
            else:
                value = sine * function
                slope = degree * cosine * function
                if degree > order:
                    slope -= math.sqrt(float(degree**2 - order**2)) * functions[degree - 1, order]
            phase = order * (longitude - angle)
            for wave in range(2 if order else 1):
                now = math.cos(phase) if wave == 0 else math.sin(phase)
                turned = -math.sin(phase) if wave == 0 else math.cos(phase)
                for axis in range(3):
                    fields[axis, column] = fade * (
                        (degree + 1.0) * value * now * up[axis]
                        - slope * now * south[axis]
                        - order * function * turned * east[axis]
                    )
                column += 1
    return fields

"""Classical and quasi-nonsingular orbital elements, and relative orbital elements.

All angles are in rad, all elements osculating, all states in an inertial equatorial frame (GCRF).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.angles import wrap_angle
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.vectors import FloatArray, cross, norm

__all__ = [
    "ClassicalElements",
    "QuasiNonsingularElements",
    "RelativeOrbitalElements",
    "deputy_elements",
    "mean_anomaly_from_true",
    "osculating_mean_motion",
    "relative_orbital_elements",
    "true_anomaly_from_mean",
]

_TWO_PI = 2.0 * math.pi
# Newton's method doubles its digits; more passes than this would mean that it does not converge.
_MAXIMUM_KEPLER_ITERATIONS = 50
# Below this the direction of perigee or of the node is only rounding.
_SINGULAR = 1e-11


def mean_anomaly_from_true(true_anomaly: float, eccentricity: float) -> float:
    """Return the mean anomaly (rad, same revolution) of an elliptic orbit.

    Raises
    ------
    ValueError
        If the eccentricity is not in [0, 1).

    Examples
    --------
    >>> round(mean_anomaly_from_true(1.0, 0.1), 6)
    0.838479
    >>> round(true_anomaly_from_mean(0.838479, 0.1), 5)
    1.0
    """
    _check_eccentricity(eccentricity)
    beta = eccentricity / (1.0 + math.sqrt(1.0 - eccentricity * eccentricity))
    # This form of tan(E/2) keeps the revolution and is smooth at every anomaly.
    eccentric_anomaly = true_anomaly - 2.0 * math.atan2(
        beta * math.sin(true_anomaly), 1.0 + beta * math.cos(true_anomaly)
    )
    return eccentric_anomaly - eccentricity * math.sin(eccentric_anomaly)


def true_anomaly_from_mean(mean_anomaly: float, eccentricity: float) -> float:
    """Return the true anomaly (rad, same revolution) of an elliptic orbit.

    Raises
    ------
    ValueError
        If the eccentricity is not in [0, 1).

    Notes
    -----
    Kepler's equation is solved by Newton's method, kept in the interval that brackets the root.
    """
    _check_eccentricity(eccentricity)
    revolution = _TWO_PI * round(mean_anomaly / _TWO_PI)
    mean = mean_anomaly - revolution
    low, high = mean - eccentricity, mean + eccentricity
    eccentric = mean + eccentricity * math.sin(mean)
    for _ in range(_MAXIMUM_KEPLER_ITERATIONS):
        residual = eccentric - eccentricity * math.sin(eccentric) - mean
        low, high = (low, eccentric) if residual > 0.0 else (eccentric, high)
        previous = eccentric
        eccentric -= residual / (1.0 - eccentricity * math.cos(eccentric))
        if not low <= eccentric <= high:
            eccentric = 0.5 * (low + high)
        if abs(eccentric - previous) <= 1e-15 * max(1.0, abs(eccentric)):
            break
    beta = eccentricity / (1.0 + math.sqrt(1.0 - eccentricity * eccentricity))
    true = eccentric + 2.0 * math.atan2(
        beta * math.sin(eccentric), 1.0 - beta * math.cos(eccentric)
    )
    return true + revolution


def _check_eccentricity(eccentricity: float) -> None:
    """Raise ValueError unless the orbit is an ellipse."""
    if not 0.0 <= eccentricity < 1.0:
        raise ValueError(f"eccentricity {eccentricity}: must be in [0, 1)")


@dataclass(frozen=True)
class ClassicalElements:
    """Classical elements of an elliptic orbit.

    Parameters
    ----------
    semi_major_axis : float
        m, positive.
    eccentricity : float
        In [0, 1).
    inclination : float
        rad, in [0, pi].
    right_ascension : float
        Right ascension of the ascending node, rad. For a node given as Earth-fixed longitude see
        `vtff_dynamics.frames.earth.right_ascension_from_longitude`.
    argument_of_perigee : float
        rad.
    true_anomaly : float
        rad.

    Raises
    ------
    ValueError
        If a value is out of range; the message names it.
    """

    semi_major_axis: float
    eccentricity: float
    inclination: float
    right_ascension: float
    argument_of_perigee: float
    true_anomaly: float

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise ValueError(f"{name} {value}: must be finite")
        if not self.semi_major_axis > 0.0:
            raise ValueError(f"semi_major_axis {self.semi_major_axis}: must be positive")
        _check_eccentricity(self.eccentricity)
        if not 0.0 <= self.inclination <= math.pi:
            raise ValueError(f"inclination {self.inclination}: must be in [0, pi] rad")

    @property
    def mean_anomaly(self) -> float:
        """Mean anomaly, rad, in the revolution of the true anomaly."""
        return mean_anomaly_from_true(self.true_anomaly, self.eccentricity)

    @property
    def mean_motion(self) -> float:
        """Keplerian mean motion, rad/s."""
        return math.sqrt(GM_EARTH / self.semi_major_axis**3)

    def to_state(self) -> FloatArray:
        """Return position and velocity in GCRF, m and m/s, shape (6,)."""
        cos_node, sin_node = math.cos(self.right_ascension), math.sin(self.right_ascension)
        cos_incl, sin_incl = math.cos(self.inclination), math.sin(self.inclination)
        latitude = self.argument_of_perigee + self.true_anomaly
        cos_lat, sin_lat = math.cos(latitude), math.sin(latitude)
        radial = np.array(
            [
                cos_node * cos_lat - sin_node * sin_lat * cos_incl,
                sin_node * cos_lat + cos_node * sin_lat * cos_incl,
                sin_lat * sin_incl,
            ]
        )
        along_track = np.array(
            [
                -cos_node * sin_lat - sin_node * cos_lat * cos_incl,
                -sin_node * sin_lat + cos_node * cos_lat * cos_incl,
                cos_lat * sin_incl,
            ]
        )
        parameter = self.semi_major_axis * (1.0 - self.eccentricity**2)
        cos_true = math.cos(self.true_anomaly)
        radius = parameter / (1.0 + self.eccentricity * cos_true)
        speed = math.sqrt(GM_EARTH / parameter)
        radial_velocity = speed * self.eccentricity * math.sin(self.true_anomaly)
        along_track_velocity = speed * (1.0 + self.eccentricity * cos_true)
        return np.concatenate(
            (radius * radial, radial_velocity * radial + along_track_velocity * along_track)
        )

    @classmethod
    def from_state(cls, state_gcrf: npt.ArrayLike) -> ClassicalElements:
        """Return the osculating elements of a state (6,), angles in [0, 2 pi).

        For an equatorial orbit the node is put on the x axis, for a circular one perigee on the
        node; the sums of the angles remain right.

        Raises
        ------
        ValueError
            If the state is not on an ellipse, or has no orbital plane.
        """
        state = np.asarray(state_gcrf, dtype=float)
        position, velocity = state[:3], state[3:]
        radius = norm(position)
        momentum = cross(position, velocity)
        momentum_magnitude = norm(momentum)
        if not momentum_magnitude > 0.0:
            raise ValueError("state_gcrf: position and velocity do not span an orbital plane")
        inverse_axis = 2.0 / radius - float(velocity @ velocity) / GM_EARTH
        if not inverse_axis > 0.0:
            raise ValueError("state_gcrf: not on an ellipse, the energy is not negative")
        normal = momentum / momentum_magnitude
        eccentricity_vector = cross(velocity, momentum) / GM_EARTH - position / radius
        eccentricity = norm(eccentricity_vector)

        node = np.array([-momentum[1], momentum[0], 0.0])
        is_equatorial = norm(node) <= _SINGULAR * momentum_magnitude
        node = np.array([1.0, 0.0, 0.0]) if is_equatorial else node / norm(node)
        ahead_of_node = cross(normal, node)
        latitude = math.atan2(float(position @ ahead_of_node), float(position @ node))
        perigee = 0.0
        if eccentricity > _SINGULAR:
            perigee = math.atan2(
                float(eccentricity_vector @ ahead_of_node), float(eccentricity_vector @ node)
            )
        return cls(
            semi_major_axis=1.0 / inverse_axis,
            eccentricity=eccentricity,
            inclination=math.atan2(math.hypot(momentum[0], momentum[1]), momentum[2]),
            right_ascension=math.atan2(node[1], node[0]) % _TWO_PI,
            argument_of_perigee=perigee % _TWO_PI,
            true_anomaly=(latitude - perigee) % _TWO_PI,
        )


@dataclass(frozen=True)
class QuasiNonsingularElements:
    """Elements that stay regular on circular orbits (D'Amico 2010, section 2.1).

    Parameters
    ----------
    semi_major_axis : float
        m.
    mean_argument_of_latitude : float
        Argument of perigee plus mean anomaly, rad.
    eccentricity_x, eccentricity_y : float
        Eccentricity vector: e cos(argument of perigee), e sin(argument of perigee).
    inclination, right_ascension : float
        rad.
    """

    semi_major_axis: float
    mean_argument_of_latitude: float
    eccentricity_x: float
    eccentricity_y: float
    inclination: float
    right_ascension: float

    @classmethod
    def from_classical(cls, elements: ClassicalElements) -> QuasiNonsingularElements:
        """Return the same orbit in quasi-nonsingular elements."""
        return cls(
            elements.semi_major_axis,
            elements.argument_of_perigee + elements.mean_anomaly,
            elements.eccentricity * math.cos(elements.argument_of_perigee),
            elements.eccentricity * math.sin(elements.argument_of_perigee),
            elements.inclination,
            elements.right_ascension,
        )

    def to_classical(self) -> ClassicalElements:
        """Return the same orbit in classical elements; on a circle perigee is at the node."""
        eccentricity = math.hypot(self.eccentricity_x, self.eccentricity_y)
        perigee = math.atan2(self.eccentricity_y, self.eccentricity_x)
        return ClassicalElements(
            self.semi_major_axis,
            eccentricity,
            self.inclination,
            self.right_ascension,
            perigee,
            true_anomaly_from_mean(self.mean_argument_of_latitude - perigee, eccentricity),
        )


@dataclass(frozen=True)
class RelativeOrbitalElements:
    """Quasi-nonsingular relative orbital elements of a deputy, without dimension.

    Multiplied by the chief's semi-major axis they are lengths in m (`to_lengths`).

    Parameters
    ----------
    semi_major_axis : float
        delta a = (a_d - a_c) / a_c.
    mean_longitude : float
        delta lambda = u_d - u_c + (node_d - node_c) cos i_c, u the mean argument of latitude.
    eccentricity_x, eccentricity_y : float
        Difference of the eccentricity vectors.
    inclination_x, inclination_y : float
        i_d - i_c and (node_d - node_c) sin i_c.

    References
    ----------
    D'Amico (2010), Autonomous Formation Flying in Low Earth Orbit, PhD thesis, eq. (2.2).
    """

    semi_major_axis: float
    mean_longitude: float
    eccentricity_x: float
    eccentricity_y: float
    inclination_x: float
    inclination_y: float

    def to_lengths(self, semi_major_axis_chief: float) -> FloatArray:
        """Return the six elements times the chief's semi-major axis, m, shape (6,)."""
        return semi_major_axis_chief * np.array(list(vars(self).values()))


def relative_orbital_elements(
    chief: ClassicalElements, deputy: ClassicalElements
) -> RelativeOrbitalElements:
    """Return the relative orbital elements of a deputy; angles wrapped to [-pi, pi)."""
    c = QuasiNonsingularElements.from_classical(chief)
    d = QuasiNonsingularElements.from_classical(deputy)
    node = wrap_angle(d.right_ascension - c.right_ascension)
    latitude = wrap_angle(d.mean_argument_of_latitude - c.mean_argument_of_latitude)
    return RelativeOrbitalElements(
        (d.semi_major_axis - c.semi_major_axis) / c.semi_major_axis,
        latitude + node * math.cos(c.inclination),
        d.eccentricity_x - c.eccentricity_x,
        d.eccentricity_y - c.eccentricity_y,
        d.inclination - c.inclination,
        node * math.sin(c.inclination),
    )


def deputy_elements(
    chief: ClassicalElements, relative: RelativeOrbitalElements
) -> ClassicalElements:
    """Return the deputy's elements; the inverse of `relative_orbital_elements`.

    Raises
    ------
    ValueError
        If the chief's orbit is equatorial, where the node is undefined, or if the deputy's
        elements are out of range.
    """
    c = QuasiNonsingularElements.from_classical(chief)
    sin_inclination = math.sin(c.inclination)
    if abs(sin_inclination) < _SINGULAR:
        raise ValueError("chief: relative orbital elements are singular on an equatorial orbit")
    node = relative.inclination_y / sin_inclination
    return QuasiNonsingularElements(
        c.semi_major_axis * (1.0 + relative.semi_major_axis),
        c.mean_argument_of_latitude + relative.mean_longitude - node * math.cos(c.inclination),
        c.eccentricity_x + relative.eccentricity_x,
        c.eccentricity_y + relative.eccentricity_y,
        c.inclination + relative.inclination_x,
        c.right_ascension + node,
    ).to_classical()


def osculating_mean_motion(state_gcrf: npt.ArrayLike) -> float:
    """Return the mean motion of the two-body orbit through a state (6,), rad/s.

    Raises
    ------
    ValueError
        If the state is not on an ellipse.
    """
    state = np.asarray(state_gcrf, dtype=float)
    speed_squared = float(state[3:] @ state[3:])
    inverse_semi_major_axis = 2.0 / norm(state[:3]) - speed_squared / GM_EARTH
    if not inverse_semi_major_axis > 0.0:
        raise ValueError("state_gcrf: not on an elliptic orbit")
    return math.sqrt(GM_EARTH * inverse_semi_major_axis**3)

"""Orbit and clock of satellites from broadcast ephemerides (IS-GPS-200, Galileo OS SIS ICD)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.angles import wrap_angle
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    EARTH_ROTATION_RATE_BROADCAST,
    GRAVITATIONAL_PARAMETER_BROADCAST,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import satellite_name

__all__ = [
    "EphemerisTable",
    "SatelliteStates",
    "ephemeris_with_reference",
]

# Most iterations of Kepler's equation.
_KEPLER_ITERATIONS = 10
# rad; Newton's correction is quadratic: after one below this, the next is below rounding.
_KEPLER_TOLERANCE = 1e-8

_COLUMNS = (
    "af0",
    "af1",
    "af2",
    "semi_major_axis",
    "eccentricity",
    "inclination",
    "inclination_rate",
    "longitude_of_ascending_node",
    "right_ascension_rate",
    "argument_of_perigee",
    "mean_anomaly",
    "mean_motion_difference",
    "cuc",
    "cus",
    "crc",
    "crs",
    "cic",
    "cis",
)


@dataclass(frozen=True, eq=False)
class SatelliteStates:
    """Orbit and clock of satellites; leading axes as the times asked for, n satellites.

    Parameters
    ----------
    position_itrf : ndarray, shape (..., n, 3)
        Antenna phase centre, m, in the Earth-fixed axes of the time of the state.
    velocity_itrf : ndarray, shape (..., n, 3)
        Earth-fixed, m/s: the exact derivative of the position.
    acceleration_itrf : ndarray, shape (..., n, 3)
        Earth-fixed, m/s2: the derivative of the velocity, but for the square of the inclination
        rate (below 1e-10 m/s2).
    clock_offset : ndarray, shape (..., n)
        Satellite clock minus GPS time, s: polynomial and periodic relativistic term. Group delays
        are not in it: it is the clock of the ionosphere-free pair of the message (GPS L1/L2
        P(Y); Galileo E1/E5b in I/NAV, E1/E5a in F/NAV).
    clock_drift : ndarray, shape (..., n)
        Derivative of the clock offset, s/s.
    """

    position_itrf: FloatArray
    velocity_itrf: FloatArray
    acceleration_itrf: FloatArray
    clock_offset: FloatArray
    clock_drift: FloatArray


@dataclass(frozen=True, eq=False)
class _PlaneMotion:
    """Motion in the orbital plane: radius, argument of latitude, inclination, derivatives."""

    radius: FloatArray
    radius_rate: FloatArray
    radius_acceleration: FloatArray
    latitude_argument: FloatArray
    latitude_argument_rate: FloatArray
    latitude_argument_acceleration: FloatArray
    inclination: FloatArray
    inclination_rate: FloatArray
    inclination_acceleration: FloatArray


class EphemerisTable:
    """Broadcast ephemerides of n satellites as columns, evaluated for all of them at once.

    Parameters
    ----------
    ephemerides : sequence of BroadcastEphemeris
        GPS and Galileo; usually one of each satellite (see `EphemerisStore.table`).

    Attributes
    ----------
    ephemerides : tuple of BroadcastEphemeris
        Row i of every column is ``ephemerides[i]``.
    system, prn : ndarray of uint8, shape (n,)
    source : ndarray of uint8, shape (n,)
        ``EPHEMERIS_SOURCE_*``.
    group_delay, group_delay_secondary : ndarray, shape (n,)
        As in `BroadcastEphemeris`, s.

    Raises
    ------
    ValueError
        If a satellite is of another system or its elements do not describe an ellipse.
    """

    def __init__(self, ephemerides: Sequence[BroadcastEphemeris]) -> None:
        for ephemeris in ephemerides:
            _require_ellipse(ephemeris)
        self.ephemerides = tuple(ephemerides)
        self.system = np.array([e.system for e in ephemerides], dtype=np.uint8)
        self.prn = np.array([e.prn for e in ephemerides], dtype=np.uint8)
        self.source = np.array([e.source for e in ephemerides], dtype=np.uint8)
        self.group_delay = self._column("group_delay")
        self.group_delay_secondary = self._column("group_delay_secondary")
        self._columns = {name: self._column(name) for name in _COLUMNS}
        self._sine_terms = np.array([self._columns[name] for name in ("cus", "crs", "cis")])
        self._cosine_terms = np.array([self._columns[name] for name in ("cuc", "crc", "cic")])
        # Reference times are kept as integers: week and seconds of week lose nothing.
        self._toe = np.array([e.time_of_ephemeris.nanoseconds for e in ephemerides], np.int64)
        self._toc = np.array([e.time_of_clock.nanoseconds for e in ephemerides], np.int64)
        gm = np.array([GRAVITATIONAL_PARAMETER_BROADCAST[e.system] for e in ephemerides])
        axis = self._columns["semi_major_axis"]
        self._mean_motion = np.sqrt(gm / axis**3) + self._columns["mean_motion_difference"]
        eccentricity = self._columns["eccentricity"]
        self._relativistic_amplitude = -2.0 * np.sqrt(gm * axis) * eccentricity / SPEED_OF_LIGHT**2
        self._minor_axis_ratio = np.sqrt(1.0 - eccentricity**2)
        time_of_week = np.array([e.toe for e in ephemerides], dtype=float)
        self._node_at_toe = (
            self._columns["longitude_of_ascending_node"]
            - EARTH_ROTATION_RATE_BROADCAST * time_of_week
        )
        self._node_rate = self._columns["right_ascension_rate"] - EARTH_ROTATION_RATE_BROADCAST
        # The rows that were selected last, and their table.
        self._selection: tuple[bytes, EphemerisTable] | None = None

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self.ephemerides)

    def select(self, rows: npt.NDArray[np.intp]) -> EphemerisTable:
        """Return a table of some rows; the same rows again are the same object."""
        key = rows.tobytes()
        if self._selection is None or self._selection[0] != key:
            self._selection = key, EphemerisTable([self.ephemerides[row] for row in rows.tolist()])
        return self._selection[1]

    def _column(self, name: str) -> FloatArray:
        return np.array([getattr(e, name) for e in self.ephemerides], dtype=float)

    def states(self, time: GpsTime, offset: npt.ArrayLike = 0.0) -> SatelliteStates:
        """Return orbit and clock of all satellites at ``time + offset``.

        Parameters
        ----------
        time : GpsTime
            Reference; the times are formed from it without loss of digits.
        offset : array_like, shape (..., 1) or (..., n)
            s, GPS time of the state less `time`, per time and satellite; a scalar gives shape
            (n,). Digits are lost in float: 1e-11 s at 1e5 s.

        Returns
        -------
        SatelliteStates
            With leading axes ``(..., n)``.

        References
        ----------
        IS-GPS-200, 20.3.3.4.3 (position) and 20.3.3.3.3.1 (clock); Galileo OS SIS ICD 5.1.1 and
        5.1.4. Velocity and acceleration are the derivatives of those formulas.
        """
        column = self._columns
        offset = np.asarray(offset, dtype=float)
        since_toe = (time.nanoseconds - self._toe) / NANOSECONDS_PER_SECOND + offset
        since_toc = (time.nanoseconds - self._toc) / NANOSECONDS_PER_SECOND + offset
        mean_anomaly = column["mean_anomaly"] + self._mean_motion * since_toe
        eccentricity = column["eccentricity"]
        sine, cosine = _eccentric_anomaly(mean_anomaly, eccentricity)
        # dE/dM and the rate of E.
        inverse = 1.0 / (1.0 - eccentricity * cosine)
        anomaly_rate = self._mean_motion * inverse
        plane = self._plane_motion(since_toe, sine, cosine, inverse, anomaly_rate)
        node = self._node_at_toe + self._node_rate * since_toe
        position, velocity, acceleration = _rotate_to_earth(plane, node, self._node_rate)
        amplitude = self._relativistic_amplitude
        polynomial = column["af0"] + since_toc * (column["af1"] + since_toc * column["af2"])
        polynomial_rate = column["af1"] + 2.0 * column["af2"] * since_toc
        return SatelliteStates(
            position_itrf=position,
            velocity_itrf=velocity,
            acceleration_itrf=acceleration,
            clock_offset=polynomial + amplitude * sine,
            clock_drift=polynomial_rate + amplitude * cosine * anomaly_rate,
        )

    def _plane_motion(
        self,
        since_toe: FloatArray,
        sine: FloatArray,
        cosine: FloatArray,
        inverse: FloatArray,
        anomaly_rate: FloatArray,
    ) -> _PlaneMotion:
        """Return the motion in the orbital plane from sine, cosine and rate of E."""
        column = self._columns
        axis, eccentricity = column["semi_major_axis"], column["eccentricity"]
        ratio = self._minor_axis_ratio
        argument = np.arctan2(ratio * sine, cosine - eccentricity) + column["argument_of_perigee"]
        rate = ratio * anomaly_rate * inverse
        acceleration = -2.0 * rate * eccentricity * sine * inverse * anomaly_rate
        sine_2, cosine_2 = np.sin(2.0 * argument), np.cos(2.0 * argument)

        # Harmonics of the argument of latitude, of the radius and of the inclination.
        axes = (3, *(1,) * (argument.ndim - 1), len(self))
        of_sine, of_cosine = self._sine_terms.reshape(axes), self._cosine_terms.reshape(axes)
        value = of_sine * sine_2 + of_cosine * cosine_2
        derivative = 2.0 * (of_sine * cosine_2 - of_cosine * sine_2)
        du, dr, di = value
        du_rate, dr_rate, di_rate = derivative * rate
        du_acceleration, dr_acceleration, di_acceleration = (
            derivative * acceleration - 4.0 * rate**2 * value
        )
        stretch = axis * eccentricity
        stretch_rate = stretch * sine * anomaly_rate
        return _PlaneMotion(
            radius=axis * (1.0 - eccentricity * cosine) + dr,
            radius_rate=stretch_rate + dr_rate,
            # The rate of E changes by -e sin E (dE/dt)^2 / (1 - e cos E).
            radius_acceleration=anomaly_rate**2
            * (stretch * cosine - stretch * eccentricity * sine**2 * inverse)
            + dr_acceleration,
            latitude_argument=argument + du,
            latitude_argument_rate=rate + du_rate,
            latitude_argument_acceleration=acceleration + du_acceleration,
            inclination=column["inclination"] + column["inclination_rate"] * since_toe + di,
            inclination_rate=column["inclination_rate"] + di_rate,
            inclination_acceleration=di_acceleration,
        )


def ephemeris_with_reference(
    ephemeris: BroadcastEphemeris, time_of_ephemeris: GpsTime
) -> BroadcastEphemeris:
    """Return the same orbit and clock referred to another time of ephemeris and clock.

    The orbit and clock that it describes do not change (the digits of a navigation message are
    not kept); a set can so be carried on beyond its fit interval, as a simulator does.

    Parameters
    ----------
    ephemeris : BroadcastEphemeris
    time_of_ephemeris : GpsTime
        New `toe` and `toc`.
    """
    step = time_of_ephemeris - ephemeris.time_of_ephemeris
    clock_step = time_of_ephemeris - ephemeris.time_of_clock
    gm = GRAVITATIONAL_PARAMETER_BROADCAST[ephemeris.system]
    mean_motion = np.sqrt(gm / ephemeris.semi_major_axis**3) + ephemeris.mean_motion_difference
    toe = time_of_ephemeris.time_of_week
    # The node is counted from the Greenwich meridian at the start of the week.
    node = (
        ephemeris.longitude_of_ascending_node
        + ephemeris.right_ascension_rate * step
        - EARTH_ROTATION_RATE_BROADCAST * (step - (toe - ephemeris.toe))
    )
    return replace(
        ephemeris,
        gps_week=time_of_ephemeris.week,
        toe=toe,
        toc=toe,
        af0=ephemeris.af0 + clock_step * (ephemeris.af1 + clock_step * ephemeris.af2),
        af1=ephemeris.af1 + 2.0 * ephemeris.af2 * clock_step,
        inclination=ephemeris.inclination + ephemeris.inclination_rate * step,
        longitude_of_ascending_node=wrap_angle(node),
        mean_anomaly=wrap_angle(ephemeris.mean_anomaly + mean_motion * step),
    )


def _require_ellipse(ephemeris: BroadcastEphemeris) -> None:
    name = satellite_name(ephemeris.system, ephemeris.prn)
    if ephemeris.system not in GRAVITATIONAL_PARAMETER_BROADCAST:
        raise ValueError(f"{name}: only GPS and Galileo ephemerides give an orbit here")
    if not ephemeris.semi_major_axis > 0.0:
        raise ValueError(f"{name}: semi_major_axis {ephemeris.semi_major_axis} is not positive")
    if not 0.0 <= ephemeris.eccentricity < 1.0:
        raise ValueError(f"{name}: eccentricity {ephemeris.eccentricity} is not within [0, 1)")


def _eccentric_anomaly(
    mean_anomaly: FloatArray, eccentricity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine of the solution E of Kepler's equation M = E - e sin E."""
    anomaly = mean_anomaly + eccentricity * np.sin(mean_anomaly)
    for _ in range(_KEPLER_ITERATIONS):
        sine, cosine = np.sin(anomaly), np.cos(anomaly)
        correction = (mean_anomaly - anomaly + eccentricity * sine) / (1.0 - eccentricity * cosine)
        anomaly = anomaly + correction
        if correction.size == 0 or float(np.max(np.abs(correction))) < _KEPLER_TOLERANCE:
            break
    # The last correction is so small that its first order is exact.
    return sine + cosine * correction, cosine - sine * correction


def _rotate_to_earth(
    plane: _PlaneMotion, node: FloatArray, node_rate: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and acceleration in ITRF, shape (..., n, 3).

    P points to the ascending node, Q is 90 deg ahead in the orbital plane, W is its normal; the
    plane turns about P with the inclination rate and about the Earth's axis with the node rate.
    """
    sine_u, cosine_u = np.sin(plane.latitude_argument), np.cos(plane.latitude_argument)
    sine_i, cosine_i = np.sin(plane.inclination), np.cos(plane.inclination)
    sine_o, cosine_o = np.sin(node), np.cos(node)
    radius, u_rate = plane.radius, plane.latitude_argument_rate
    i_rate = plane.inclination_rate
    # Components along radius and transverse in the plane, then along P and Q.
    transverse = radius * u_rate
    radial_2 = plane.radius_acceleration - transverse * u_rate
    transverse_2 = radius * plane.latitude_argument_acceleration + 2.0 * plane.radius_rate * u_rate
    p_0, q_0 = radius * cosine_u, radius * sine_u
    p_1 = plane.radius_rate * cosine_u - transverse * sine_u
    q_1 = plane.radius_rate * sine_u + transverse * cosine_u
    p_2 = radial_2 * cosine_u - transverse_2 * sine_u
    q_2 = radial_2 * sine_u + transverse_2 * cosine_u
    w_1 = q_0 * i_rate
    w_2 = 2.0 * q_1 * i_rate + q_0 * plane.inclination_acceleration

    # Components along the node, across it in the equator, and north.
    across_0, north_0 = q_0 * cosine_i, q_0 * sine_i
    across_1, north_1 = q_1 * cosine_i - w_1 * sine_i, q_1 * sine_i + w_1 * cosine_i
    across_2, north_2 = q_2 * cosine_i - w_2 * sine_i, q_2 * sine_i + w_2 * cosine_i
    # The node itself turns: transport terms of the rotation about the Earth's axis.
    along_2 = p_2 - 2.0 * node_rate * across_1 - node_rate**2 * p_0
    across_2 = across_2 + 2.0 * node_rate * p_1 - node_rate**2 * across_0
    along_1, across_1 = p_1 - node_rate * across_0, across_1 + node_rate * p_0

    # Position and derivatives; components first, since arithmetic on a last axis of three is slow.
    along = np.array((p_0, along_1, along_2))
    across = np.array((across_0, across_1, across_2))
    itrf = np.array(
        (
            along * cosine_o - across * sine_o,
            along * sine_o + across * cosine_o,
            (north_0, north_1, north_2),
        )
    )
    position, velocity, acceleration = itrf.transpose(1, *range(2, itrf.ndim), 0)
    return position, velocity, acceleration

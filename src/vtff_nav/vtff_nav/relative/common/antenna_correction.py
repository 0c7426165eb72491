"""Antennas that are not in the centre of mass: lever arms, phase centres and attitude.

The filter's states are those of the centres of mass. Lines of sight begin at the reference point of
each antenna; what its phase centre lies elsewhere, or moves with the direction, is taken off codes
and phases. The error of a lever arm that is stated becomes a state of the filter: it is constant in
the axes of the body.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, is_finite, norm, skew
from vtff_gnss.antex import PhaseCentre, antex_frequency
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_nav.relative.common.body_attitude import BodyAttitude
from vtff_nav.relative.common.measurements import Geometry, SignalTable

__all__ = [
    "ATTITUDE_FRAMES",
    "UNCALIBRATED",
    "Antenna",
    "AntennaPair",
    "AttitudeFrame",
    "Attitudes",
    "check_frequencies",
]

AttitudeFrame = Literal["north_east_down", "rtn", "gcrf", "estimated"]
ATTITUDE_FRAMES: tuple[AttitudeFrame, ...] = ("north_east_down", "rtn", "gcrf", "estimated")
"""Axes to which an attitude can be fixed: the local horizon, the own orbit, and inertial space; an
estimated attitude is given from time to time, and is that of the local horizon until then."""

_UNKNOWN_ATTITUDE_SIGMA = 1.0  # rad, before the first attitude

Attitudes = tuple[BodyAttitude | None, BodyAttitude | None]
"""Newest estimates of chief and deputy."""

# North, east and up of an antenna are x, y and -z of the body.
_ANTENNA_AXES = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Antenna:
    """Antenna of one receiver.

    Parameters
    ----------
    lever_arm_body : tuple of 3 float
        From the centre of mass to the reference point of the antenna in body axes, m.
    lever_arm_sigma : float
        Error of the lever arm on each axis, m; with 0 it is taken as exact.
    phase_centre : PhaseCentre or None
        Offset and variation of the phase centre from the reference point. North, east and up of the
        antenna are x, y and -z of the body.
    phase_map_sigma : float
        Error of offset and variation in a range, m, root mean square over the directions. What of
        it is as that of an offset is estimated with the error of the lever arm; what else is left
        is as slow as multipath.
    attitude_frame : {"north_east_down", "rtn", "gcrf", "estimated"}
        Axes to which the body is fixed; "estimated": the attitude is given as it is estimated, and
        its error, which moves the antenna by the lever arm, is a state of the filter.
    quaternion : tuple of 4 float
        x, y, z, w: turns components along the body axes into those along the axes of
        `attitude_frame`. By default the axes of the two coincide.

    Raises
    ------
    ValueError
        If a number is not finite or negative, or the quaternion has no direction.
    """

    lever_arm_body: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_arm_sigma: float = 0.0
    phase_centre: PhaseCentre | None = None
    phase_map_sigma: float = 0.0
    attitude_frame: AttitudeFrame = "north_east_down"
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Check the fields."""
        if len(self.lever_arm_body) != 3 or not np.isfinite(self.lever_arm_body).all():
            raise ValueError(f"lever_arm: three numbers (m) expected, got {self.lever_arm_body}")
        for name in ("lever_arm_sigma", "phase_map_sigma"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name}: 0 m or more expected, got {value}")
        if self.attitude_frame not in ATTITUDE_FRAMES:
            names = ", ".join(ATTITUDE_FRAMES)
            raise ValueError(
                f"attitude_frame: one of {names} expected, got {self.attitude_frame!r}"
            )
        values = np.asarray(self.quaternion, dtype=float)
        if values.shape != (4,) or not np.isfinite(values).all() or not values.any():
            raise ValueError(
                f"quaternion: four numbers x, y, z, w, not all zero, expected, "
                f"got {list(self.quaternion)}"
            )

    @property
    def offset_sigma(self) -> float:
        """Error of the phase centre that is constant in the body, on each axis, m."""
        return math.hypot(self.lever_arm_sigma, self.phase_map_sigma)

    @property
    def is_turned_by_estimate(self) -> bool:
        """Whether the body has the error of an estimated attitude, which moves a lever arm."""
        return self.attitude_frame == "estimated"

    def rotation_body_to_itrf(
        self, time: GpsTime, state_itrf: FloatArray, attitude: BodyAttitude | None = None
    ) -> FloatArray:
        """Return the rotation from body axes to ITRF, shape (3, 3).

        Parameters
        ----------
        time : GpsTime
        state_itrf : ndarray, shape (6,)
            Position and Earth-fixed velocity of the centre of mass, m and m/s.
        attitude : BodyAttitude, optional
            The newest estimate, where the attitude is estimated.
        """
        if self.attitude_frame == "estimated" and attitude is not None:
            return rotation_gcrf_to_itrf(time) @ attitude.rotation_gcrf_from_body(time)
        from_body = _rotation_of_quaternion(self.quaternion)
        if self.attitude_frame in ("north_east_down", "estimated"):
            up = ellipsoid_normal(state_itrf[:3])
            east = np.cross((0.0, 0.0, 1.0), up)
            east /= np.linalg.norm(east)
            to_itrf = np.column_stack((np.cross(up, east), east, -up))
        else:
            to_itrf = rotation_gcrf_to_itrf(time)
            if self.attitude_frame == "rtn":
                state_gcrf = state_itrf_to_gcrf(time, state_itrf)
                to_itrf = to_itrf @ rotation_gcrf_to_rtn(state_gcrf).T
        return np.asarray(to_itrf @ from_body)


def _rotation_of_quaternion(quaternion: tuple[float, float, float, float]) -> FloatArray:
    """Return the rotation matrix of x, y, z, w; `scipy.spatial` would make nodes start later."""
    vector, scalar = np.array(quaternion[:3]), quaternion[3]
    squared = float(vector @ vector)
    rotation = (scalar**2 - squared) * np.eye(3) + 2.0 * np.outer(vector, vector)
    return np.asarray((rotation + 2.0 * scalar * skew(vector)) / (scalar**2 + squared))


UNCALIBRATED = Antenna(phase_map_sigma=0.002)
"""An antenna of which nothing is known: patch antennas have variations of some millimetres."""


@dataclass(frozen=True)
class AntennaPair:
    """Antennas of chief and deputy; by default exact, in the centres of mass."""

    chief: Antenna = Antenna()
    deputy: Antenna = Antenna()

    @property
    def are_central(self) -> bool:
        """Whether both are in the centres of mass, but for the error of their phase centres."""
        return all(
            antenna.phase_centre is None
            and antenna.lever_arm_sigma == 0.0
            and not any(antenna.lever_arm_body)
            for antenna in self.both
        )

    @property
    def both(self) -> tuple[Antenna, Antenna]:
        """Chief and deputy."""
        return self.chief, self.deputy

    def rotations_body_to_itrf(
        self, time: GpsTime, states_itrf: FloatArray, attitudes: Attitudes = (None, None)
    ) -> FloatArray:
        """Return the rotations from the body axes of both to ITRF, shape (2, 3, 3)."""
        return np.array(
            [
                antenna.rotation_body_to_itrf(time, state, attitude)
                for antenna, state, attitude in zip(self.both, states_itrf, attitudes, strict=True)
            ]
        )

    def states_itrf(self, states_itrf: FloatArray, rotations: FloatArray) -> FloatArray:
        """Return the states of the reference points of the antennas, shape (2, 6).

        The velocity stays that of the centre of mass: that of a lever arm of 1 m, some mm/s, moves
        it by nanometres between an epoch and its reception.

        Parameters
        ----------
        states_itrf : ndarray, shape (2, 6)
            Centres of mass.
        rotations : ndarray, shape (2, 3, 3)
            See `rotations_body_to_itrf`.
        """
        moved: FloatArray = states_itrf.copy()
        for receiver, antenna in enumerate(self.both):
            moved[receiver, :3] += rotations[receiver] @ np.array(antenna.lever_arm_body)
        return moved

    def corrected(
        self,
        signals: SignalTable,
        receiver: int,
        seen: Geometry,
        rotation_body_to_navigation: FloatArray,
    ) -> SignalTable:
        """Return the signals as the reference point of an antenna would receive them.

        Parameters
        ----------
        signals : SignalTable
        receiver : int
            0 for the chief, 1 for the deputy.
        seen : Geometry
        rotation_body_to_navigation : ndarray, shape (3, 3)
            From body axes to those of the directions of `seen`.
        """
        phase_centre = self.both[receiver].phase_centre
        if phase_centre is None:
            return signals
        directions = seen.direction[receiver, seen.columns(signals.satellite)]
        directions = (directions @ rotation_body_to_navigation) * _ANTENNA_AXES
        delay = np.zeros(len(signals))
        carriers = np.stack((signals.system, signals.band), axis=1)
        for system, band in np.unique(carriers, axis=0).tolist():
            rows = np.flatnonzero((carriers == (system, band)).all(axis=1))
            delay[rows] = phase_centre.maps[antex_frequency(system, band)].delay(directions[rows])
        return dataclasses.replace(
            signals,
            pseudorange=signals.pseudorange - delay,
            carrier_range=signals.carrier_range - delay,
        )

    def offset_variances(self) -> dict[tuple[str, int, int], float]:
        """Return the variance of each component of the offsets that are not exact, m2, by label."""
        return {
            ("antenna_offset", receiver, axis): antenna.offset_sigma**2
            for receiver, antenna in enumerate(self.both)
            if antenna.offset_sigma > 0.0
            for axis in range(3)
        }

    def attitude_variances(self, attitudes: Attitudes) -> dict[tuple[str, int, int], float]:
        """Return the variances of the errors of estimated attitudes, rad2, body axes, by label."""
        unknown = np.full(3, _UNKNOWN_ATTITUDE_SIGMA**2)
        return {
            ("attitude_error", receiver, axis): float(variance)
            for receiver, (antenna, attitude) in enumerate(zip(self.both, attitudes, strict=True))
            if antenna.is_turned_by_estimate
            for axis, variance in enumerate(
                unknown if attitude is None else np.diagonal(attitude.covariance)
            )
        }

    def attitude_turns(
        self,
        time: GpsTime,
        before: Attitudes,
        attitudes: Attitudes,
        corrections: Sequence[FloatArray],
    ) -> dict[tuple[str, int, int], float]:
        """Return by how much measurements have turned attitudes since those before, by label.

        In rad, body axes. Receivers whose attitude has become known, or is no longer, are left out.

        Parameters
        ----------
        time : GpsTime
        before, attitudes : tuple of BodyAttitude or None
            Attitudes used before, and now.
        corrections : sequence of ndarray, shape (3,)
            Corrections that the estimators tell, rad, see `EstimatorInputs`; where a correction is
            nan the attitude is compared with the attitude before.
        """
        turns: dict[tuple[str, int, int], float] = {}
        for receiver, antenna in enumerate(self.both):
            first, second = before[receiver], attitudes[receiver]
            if antenna.is_turned_by_estimate and (first is None) == (second is None):
                turn = np.zeros(3)
                if first is not None and second is not None and first is not second:
                    turn = corrections[receiver]
                    if not is_finite(turn):
                        turn = second.turn_from(first, time)
                for axis in range(3):
                    turns["attitude_error", receiver, axis] = float(turn[axis])
        return turns

    def attitude_columns(
        self, directions: FloatArray, rotations: FloatArray, attitudes: Attitudes
    ) -> FloatArray:
        """Return the derivatives of single differences by errors of estimated attitudes, (n, 3 k).

        A small rotation a of the body moves the antenna by a x l. An attitude that is not known is
        no small rotation: it moves the antenna along l too, so its error is taken as an offset of
        the length of l along any axis. Other parameters are those of `offset_columns`.
        """
        columns = []
        for sign, antenna, rotation, attitude in zip(
            (1.0, -1.0), self.both, rotations, attitudes, strict=True
        ):
            if antenna.is_turned_by_estimate:
                lever_arm = np.array(antenna.lever_arm_body)
                moved = -skew(lever_arm) if attitude is not None else norm(lever_arm) * np.eye(3)
                columns.append(np.asarray(sign * (directions @ rotation) @ moved))
        return np.concatenate([np.zeros((len(directions), 0)), *columns], axis=1)

    def offset_columns(self, directions: FloatArray, rotations: FloatArray) -> FloatArray:
        """Return the derivatives of single differences by the errors of lever arms, (n, 3 k).

        Parameters
        ----------
        directions : ndarray, shape (n, 3)
            Unit vectors to the satellites, navigation axes.
        rotations : ndarray, shape (2, 3, 3)
            From the body axes of chief and deputy to the navigation axes.
        """
        columns = [
            np.asarray(sign * (directions @ rotation))
            for sign, antenna, rotation in zip((1.0, -1.0), self.both, rotations, strict=True)
            if antenna.offset_sigma > 0.0
        ]
        return np.concatenate([np.zeros((len(directions), 0)), *columns], axis=1)


def check_frequencies(antenna: Antenna, bands: Mapping[int, Iterable[int]]) -> None:
    """Refuse an antenna without phase centres of carriers that are used.

    Parameters
    ----------
    antenna : Antenna
    bands : mapping of int to iterable of int
        RINEX frequency digits of each system.

    Raises
    ------
    ValueError
        If a frequency is missing; the text names antenna and frequency.
    """
    if antenna.phase_centre is None:
        return
    for system, digits in bands.items():
        for band in digits:
            frequency = antex_frequency(system, band)
            if frequency not in antenna.phase_centre.maps:
                raise ValueError(
                    f"antenna {antenna.phase_centre.antenna!r} has no frequency {frequency}, "
                    "which is used: choose signals that it has"
                )

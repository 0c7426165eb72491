"""Motion of a simulated vehicle as SimREMOTE commands it, and its Taylor extrapolation.

SimGEN holds the last motion command of a vehicle and extrapolates it with the derivatives that
came with it until the next command takes effect (no derivatives: the vehicle stands still between
commands and jumps at each). Everything here is plain floats: the emulator handles two commands in
a few microseconds and starts without numpy.
"""

from __future__ import annotations

import bisect
import math
from typing import NamedTuple

from vtff_dynamics.constants import (
    NANOSECONDS_PER_SECOND,
    WGS84_FLATTENING,
    WGS84_SEMI_MAJOR_AXIS,
)

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

ZERO_VECTOR: Vector = (0.0, 0.0, 0.0)
"""The vector of `MotionState` and `GeodeticMotionState` for a derivative that is not given."""

_ECCENTRICITY_SQUARED = WGS84_FLATTENING * (2.0 - WGS84_FLATTENING)

MAXIMUM_STORED_COMMANDS = 10_000
"""Most commands that a vehicle keeps; a client that runs further ahead is refused."""


class MotionError(ValueError):
    """A motion command cannot be kept, or no motion is known for a time."""


class MotionState(NamedTuple):
    """The 24 numbers of a MOT command, in its order.

    Attributes
    ----------
    position_itrf, velocity_itrf, acceleration_itrf, jerk_itrf : tuple of 3 floats
        Earth-fixed (WGS-84) position in m and its Earth-fixed derivatives, m/s, m/s2, m/s3.
    heading_elevation_bank : tuple of 3 floats
        Attitude of the body relative to local north-east-down, 3-2-1 angles, rad.
    angular_velocity_body, angular_acceleration_body, angular_jerk_body : tuple of 3 floats
        Rotation rate about the body axes and its derivatives, rad/s, rad/s2, rad/s3.
    """

    position_itrf: Vector
    velocity_itrf: Vector = ZERO_VECTOR
    acceleration_itrf: Vector = ZERO_VECTOR
    jerk_itrf: Vector = ZERO_VECTOR
    heading_elevation_bank: Vector = ZERO_VECTOR
    angular_velocity_body: Vector = ZERO_VECTOR
    angular_acceleration_body: Vector = ZERO_VECTOR
    angular_jerk_body: Vector = ZERO_VECTOR

    def extrapolate(self, seconds: float) -> MotionState:
        """Return the motion a time later, extrapolated with the given derivatives.

        Position is the third-order Taylor polynomial. Attitude is turned by the rotation vector of
        the rate polynomial, to third order (Magnus expansion; Blanes et al. 2009, Physics Reports
        470, section 2), so that a rotation about a fixed axis is exact.

        Parameters
        ----------
        seconds : float
            Time since the validity of this motion, s; may be negative.

        Raises
        ------
        MotionError
            If the rotation is not finite.
        """
        if seconds == 0.0:
            return self
        position, velocity, acceleration, jerk = self[:4]
        return MotionState(
            _polynomial(seconds, position, velocity, acceleration, jerk),
            _polynomial(seconds, velocity, acceleration, jerk),
            _polynomial(seconds, acceleration, jerk),
            jerk,
            _rotate(seconds, *self[4:]),
            _polynomial(seconds, *self[5:]),
            _polynomial(seconds, *self[6:]),
            self.angular_jerk_body,
        )


class GeodeticMotionState(NamedTuple):
    """The 24 numbers of a MOTB command, in its order.

    Attributes
    ----------
    latitude_longitude_height : tuple of 3 floats
        Geodetic (WGS-84) latitude and longitude in rad and height in m.
    velocity_ned, acceleration_ned, jerk_ned : tuple of 3 floats
        Earth-fixed derivatives of position, m/s, m/s2, m/s3, resolved in the north-east-down axes
        at the position. (That acceleration and jerk are the derivatives of the vector, and not of
        its NED components, is an assumption: no public source says.)
    heading_elevation_bank, angular_velocity_body, angular_acceleration_body, angular_jerk_body
        As in `MotionState`.
    """

    latitude_longitude_height: Vector
    velocity_ned: Vector = ZERO_VECTOR
    acceleration_ned: Vector = ZERO_VECTOR
    jerk_ned: Vector = ZERO_VECTOR
    heading_elevation_bank: Vector = ZERO_VECTOR
    angular_velocity_body: Vector = ZERO_VECTOR
    angular_acceleration_body: Vector = ZERO_VECTOR
    angular_jerk_body: Vector = ZERO_VECTOR

    def to_earth_fixed(self) -> MotionState:
        """Return the same motion in Earth-fixed axes (conversion of NIMA TR8350.2, section 4)."""
        latitude, longitude, height = self.latitude_longitude_height
        sin_latitude, cos_latitude = math.sin(latitude), math.cos(latitude)
        sin_longitude, cos_longitude = math.sin(longitude), math.cos(longitude)
        prime_vertical = WGS84_SEMI_MAJOR_AXIS / math.sqrt(
            1.0 - _ECCENTRICITY_SQUARED * sin_latitude * sin_latitude
        )
        horizontal = (prime_vertical + height) * cos_latitude

        def rotate_to_itrf(vector_ned: Vector) -> Vector:
            north, east, down = vector_ned
            outward = -sin_latitude * north - cos_latitude * down
            return (
                cos_longitude * outward - sin_longitude * east,
                sin_longitude * outward + cos_longitude * east,
                cos_latitude * north - sin_latitude * down,
            )

        return MotionState(
            (
                horizontal * cos_longitude,
                horizontal * sin_longitude,
                (prime_vertical * (1.0 - _ECCENTRICITY_SQUARED) + height) * sin_latitude,
            ),
            rotate_to_itrf(self.velocity_ned),
            rotate_to_itrf(self.acceleration_ned),
            rotate_to_itrf(self.jerk_ned),
            *self[4:],
        )


class VehicleMotion:
    """Motion commands of one vehicle, ordered by the time from which they hold.

    The motion at a time is the newest command at or before it, extrapolated. Commands for later
    times are kept until then; a command replaces an earlier command for the same time. Times are
    integer nanoseconds into the run, so that a time stamp compares equal however it was written.
    """

    def __init__(self) -> None:
        self._times: list[int] = []
        self._states: list[MotionState] = []

    def __len__(self) -> int:
        """Return how many commands are kept."""
        return len(self._times)

    def command(self, time_nanoseconds: int, state: MotionState) -> None:
        """Keep a motion that holds from a time on.

        Raises
        ------
        MotionError
            If too many commands wait already.
        """
        times = self._times
        if not times or time_nanoseconds > times[-1]:
            index = len(times)
        else:
            index = bisect.bisect_left(times, time_nanoseconds)
            if times[index] == time_nanoseconds:
                self._states[index] = state
                return
        if len(times) >= MAXIMUM_STORED_COMMANDS:
            raise MotionError(f"{MAXIMUM_STORED_COMMANDS} motion commands are waiting already")
        times.insert(index, time_nanoseconds)
        self._states.insert(index, state)

    def has_command_at(self, time_nanoseconds: int) -> bool:
        """Return whether a command is kept that holds from exactly this time on."""
        index = bisect.bisect_left(self._times, time_nanoseconds)
        return index < len(self._times) and self._times[index] == time_nanoseconds

    def command_times_after(self, time_nanoseconds: int) -> list[int]:
        """Return the times of the commands later than a time, in order."""
        return self._times[bisect.bisect_right(self._times, time_nanoseconds) :]

    def at(self, time_nanoseconds: int) -> MotionState:
        """Return the motion at a time into the run.

        Raises
        ------
        MotionError
            If no command holds at that time.
        """
        since, state = self.command_at(time_nanoseconds)
        return state.extrapolate((time_nanoseconds - since) / NANOSECONDS_PER_SECOND)

    def command_at(self, time_nanoseconds: int) -> tuple[int, MotionState]:
        """Return the command that holds at a time, and the time since which it does, ns.

        Raises
        ------
        MotionError
            If no command holds at that time.
        """
        index = bisect.bisect_right(self._times, time_nanoseconds) - 1
        if index < 0:
            seconds = time_nanoseconds / NANOSECONDS_PER_SECOND
            raise MotionError(f"no motion command holds at {seconds:.3f} s into the run")
        return self._times[index], self._states[index]

    def commands_between(self, first: int, last: int) -> list[tuple[int, MotionState]]:
        """Return the commands that hold at some time of a span, and the times from which they do.

        Parameters
        ----------
        first, last : int
            Begin and end of the span, ns into the run.

        Raises
        ------
        MotionError
            If no command holds at its begin.
        """
        begin = self.command_at(first)
        low, high = (bisect.bisect_right(self._times, time) for time in (first, last))
        return [begin, *zip(self._times[low:high], self._states[low:high], strict=True)]

    def forget_before(self, time_nanoseconds: int) -> None:
        """Drop the commands that no time from this one on needs."""
        index = bisect.bisect_right(self._times, time_nanoseconds) - 1
        if index > 0:
            del self._times[:index]
            del self._states[:index]

    def clear(self) -> None:
        """Drop every command."""
        self._times.clear()
        self._states.clear()


def _polynomial(
    seconds: float,
    value: Vector,
    first: Vector,
    second: Vector = ZERO_VECTOR,
    third: Vector = ZERO_VECTOR,
) -> Vector:
    """Return the Taylor polynomial of a vector with its derivatives (Horner's form)."""
    half, third_part = seconds / 2.0, seconds / 3.0
    x, y, z = (
        value[i] + seconds * (first[i] + half * (second[i] + third_part * third[i]))
        for i in (0, 1, 2)
    )
    return (x, y, z)


def _rotate(
    seconds: float,
    heading_elevation_bank: Vector,
    rate: Vector,
    acceleration: Vector,
    jerk: Vector,
) -> Vector:
    """Return the attitude angles after turning with the given body rates and derivatives."""
    if rate == acceleration == jerk == ZERO_VECTOR:
        return heading_elevation_bank
    cubed = seconds * seconds * seconds / 12.0
    angle = _polynomial(seconds, ZERO_VECTOR, rate, acceleration, jerk)
    # The second Magnus term: the rotation axis itself turns when the rate changes direction.
    rotation_vector = (
        angle[0] + cubed * (rate[1] * acceleration[2] - rate[2] * acceleration[1]),
        angle[1] + cubed * (rate[2] * acceleration[0] - rate[0] * acceleration[2]),
        angle[2] + cubed * (rate[0] * acceleration[1] - rate[1] * acceleration[0]),
    )
    magnitude = math.hypot(*rotation_vector)
    if not math.isfinite(magnitude):
        raise MotionError("the commanded rotation rates give a rotation that is not finite")
    if magnitude == 0.0:
        return heading_elevation_bank
    scale = math.sin(magnitude / 2.0) / magnitude
    x, y, z = rotation_vector
    turn = (math.cos(magnitude / 2.0), scale * x, scale * y, scale * z)
    return angles_of_quaternion(_product(_quaternion_of(heading_elevation_bank), turn))


def _quaternion_of(heading_elevation_bank: Vector) -> Quaternion:
    """Return the unit quaternion (scalar first) that turns body axes into north-east-down."""
    heading, elevation, bank = (angle / 2.0 for angle in heading_elevation_bank)
    ch, sh = math.cos(heading), math.sin(heading)
    ce, se = math.cos(elevation), math.sin(elevation)
    cb, sb = math.cos(bank), math.sin(bank)
    return (
        ch * ce * cb + sh * se * sb,
        ch * ce * sb - sh * se * cb,
        ch * se * cb + sh * ce * sb,
        sh * ce * cb - ch * se * sb,
    )


def _product(left: Quaternion, right: Quaternion) -> Quaternion:
    """Return the Hamilton product of two quaternions."""
    a, b, c, d = left
    e, f, g, h = right
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def angles_of_quaternion(quaternion: Quaternion) -> Vector:
    """Return heading, elevation and bank, rad, of a unit quaternion (scalar first).

    It turns body axes into north-east-down. Where the elevation is 90 deg either way, bank is 0.
    """
    w, x, y, z = quaternion
    sin_elevation = 2.0 * (w * y - x * z)
    if abs(sin_elevation) > 1.0 - 1e-12:
        # Heading and bank turn about the same axis here; only their difference is defined.
        heading = math.atan2(2.0 * (w * z - x * y), w * w - x * x + y * y - z * z)
        return (heading, math.copysign(math.pi / 2.0, sin_elevation), 0.0)
    return (
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        math.asin(sin_elevation),
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
    )

"""Motion of a vehicle at the epochs of a second, from its motion commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_sim_bridge.noise.random_streams import EPOCH_NANOSECONDS, EPOCHS_PER_SECOND
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion

__all__ = ["VehicleTrack", "vehicle_track"]

_EPOCHS = np.arange(1, EPOCHS_PER_SECOND + 1)
_DIFFERENCE_TIME = 0.01  # s, on both sides of an epoch, over which axes turn evenly


@dataclass(frozen=True, eq=False)
class VehicleTrack:
    """Motion of a vehicle at the 20 time tags of a second.

    Parameters
    ----------
    position_itrf, velocity_itrf, acceleration_itrf : ndarray, shape (20, 3)
        Earth-fixed, m, m/s, m/s2.
    boresight_itrf : ndarray, shape (20, 3), or None
        Unit vectors along the boresight of the antenna, which is the negative z axis of the body;
        None for a body that is aligned with north-east-down: then it is the local zenith.
    body_axes_itrf : ndarray, shape (20, 3, 3), or None
        Rows are the x, y and z axes of the body; only in tracks of an antenna.
    """

    position_itrf: FloatArray
    velocity_itrf: FloatArray
    acceleration_itrf: FloatArray
    boresight_itrf: FloatArray | None = None
    body_axes_itrf: FloatArray | None = None

    def before(self, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return position and velocity, shape (20, 3), earlier by times (20,), s.

        These are those of reception where a clock is ahead by so much.
        """
        late = -offset[:, np.newaxis]
        velocity = self.velocity_itrf + late * self.acceleration_itrf
        return self.position_itrf + 0.5 * late * (self.velocity_itrf + velocity), velocity


def vehicle_track(
    motion: VehicleMotion,
    second: int,
    emitted: slice,
    antenna_body: npt.ArrayLike | None = None,
) -> VehicleTrack:
    """Return the motion at the time tags of a second; outside `emitted` the nearest of those.

    Parameters
    ----------
    motion : VehicleMotion
    second : int
        Number of the second: its epochs are those after ``second - 1`` s.
    emitted : slice
        Which of the 20 epochs are wanted.
    antenna_body : array_like, shape (3,), optional
        Point of the body whose motion is returned, in body axes from the centre of mass, m.
    """
    indices = range(EPOCHS_PER_SECOND)[emitted]
    times = _EPOCHS * EPOCH_NANOSECONDS + (second - 1) * NANOSECONDS_PER_SECOND
    if len(indices) < EPOCHS_PER_SECOND:
        times = np.clip(times, times[indices[0]], times[indices[-1]])
    commands = motion.commands_between(int(times[0]), int(times[-1]))
    vectors = _extrapolate(
        times,
        np.array([since for since, _ in commands]),
        np.array([state[:4] for _, state in commands]),
    )
    boresight = None
    if any(any(map(any, state[4:])) for _, state in commands):
        angles = np.array([motion.at(time).heading_elevation_bank for time in times.tolist()])
        boresight = _boresight_itrf(angles, vectors[:, 0])
    axes = None
    if antenna_body is not None:
        axes, moved = _antenna_motion(
            [motion.command_at(time) for time in times.tolist()],
            times,
            np.asarray(antenna_body, dtype=float),
        )
        vectors[:, :2] += moved
    return VehicleTrack(vectors[:, 0], vectors[:, 1], vectors[:, 2], boresight, axes)


def _extrapolate(
    times: npt.NDArray[np.int64], command_times: npt.NDArray[np.int64], states: FloatArray
) -> FloatArray:
    """Return position, velocity, acceleration (k, 3, 3), as `MotionState.extrapolate` does.

    Parameters
    ----------
    times : ndarray of int64, shape (k,)
        In order, ns into the run.
    command_times : ndarray of int64, shape (c,)
        From when each command holds, ns; the first one at the first time.
    states : ndarray, shape (c, 4, 3)
        Position and its derivatives of each command.
    """
    command = np.searchsorted(command_times, times, side="right") - 1
    seconds = ((times - command_times[command]) / NANOSECONDS_PER_SECOND)[:, np.newaxis]
    position, velocity, acceleration, jerk = np.moveaxis(states[command], 1, 0)
    half, third = seconds / 2.0, seconds / 3.0
    return np.stack(
        (
            position + seconds * (velocity + half * (acceleration + third * jerk)),
            velocity + seconds * (acceleration + half * jerk),
            acceleration + seconds * jerk,
        ),
        axis=1,
    )


def _antenna_motion(
    commands: list[tuple[int, MotionState]], times: npt.NDArray[np.int64], antenna: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return body axes (k, 3, 3), and position and velocity of a point less the centre's (k, 2, 3).

    The acceleration of a lever arm is left out: in orbit it is below 1e-6 m/s2 for each metre.
    """
    seconds = (times - [since for since, _ in commands]) / NANOSECONDS_PER_SECOND
    around = []
    for shift in (-_DIFFERENCE_TIME, 0.0, _DIFFERENCE_TIME):
        states = [
            state.extrapolate(float(time) + shift)
            for (_, state), time in zip(commands, seconds, strict=True)
        ]
        angles = np.array([state.heading_elevation_bank for state in states])
        position = np.array([state.position_itrf for state in states])
        around.append(_body_axes_itrf(angles, position))
    before, axes, after = around
    lever = np.einsum("j,kji->ki", antenna, axes)
    rate = np.einsum("j,kji->ki", antenna, after - before) / (2.0 * _DIFFERENCE_TIME)
    return axes, np.stack((lever, rate), axis=1)


def _body_axes_itrf(heading_elevation_bank: FloatArray, position_itrf: FloatArray) -> FloatArray:
    """Return the axes of bodies with 3-2-1 angles to north-east-down as rows, (k, 3, 3)."""
    down = -ellipsoid_normal(position_itrf)
    east = np.cross((0.0, 0.0, 1.0), -down)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(east, down)
    to_ned = Rotation.from_euler("ZYX", heading_elevation_bank).as_matrix()
    axes_ned_itrf = np.stack((north, east, down), axis=1)
    return np.asarray(np.einsum("knj,kni->kji", to_ned, axes_ned_itrf))


def _boresight_itrf(
    heading_elevation_bank: FloatArray, position_itrf: FloatArray
) -> npt.NDArray[np.float64]:
    """Return the negative z axis of bodies (k, 3) with 3-2-1 angles to north-east-down (k, 3)."""
    sine, cosine = np.sin(heading_elevation_bank).T, np.cos(heading_elevation_bank).T
    sin_heading, sin_elevation, sin_bank = sine
    cos_heading, cos_elevation, cos_bank = cosine
    north = cos_heading * sin_elevation * cos_bank + sin_heading * sin_bank
    east = sin_heading * sin_elevation * cos_bank - cos_heading * sin_bank
    up_itrf = ellipsoid_normal(position_itrf)
    east_itrf = np.cross((0.0, 0.0, 1.0), up_itrf)
    east_itrf /= np.linalg.norm(east_itrf, axis=1, keepdims=True)
    north_itrf = np.cross(up_itrf, east_itrf)
    up = cos_elevation * cos_bank
    return np.asarray(
        up[:, None] * up_itrf - north[:, None] * north_itrf - east[:, None] * east_itrf
    )

"""Motion of a vehicle at the epochs of a second, from its motion commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.line_of_sight import ellipsoid_normal
from vtff_sim_bridge.gnss.random_streams import EPOCH_NANOSECONDS, EPOCHS_PER_SECOND
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion

__all__ = ["VehicleTrack", "vehicle_track"]


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
    """

    position_itrf: FloatArray
    velocity_itrf: FloatArray
    acceleration_itrf: FloatArray
    boresight_itrf: FloatArray | None = None


def vehicle_track(motion: VehicleMotion, second: int, emitted: slice) -> VehicleTrack:
    """Return the motion at the time tags of a second; outside `emitted` the nearest of those."""
    end = second * EPOCHS_PER_SECOND
    indices = range(EPOCHS_PER_SECOND)[emitted]
    times = [(end - EPOCHS_PER_SECOND + 1 + index) * EPOCH_NANOSECONDS for index in indices]
    commands = [motion.command_at(time) for time in times]
    elapsed = np.array([time - since for time, (since, _) in zip(times, commands, strict=True)])
    parts, first = [], 0
    # Mostly one command holds for the whole second.
    while first < len(times):
        state = commands[first][1]
        count = next(
            (k for k in range(first, len(times)) if commands[k][1] is not state), len(times)
        )
        parts.append(_extrapolate(state, elapsed[first:count] / NANOSECONDS_PER_SECOND))
        first = count
    vectors = parts[0] if len(parts) == 1 else np.concatenate(parts)
    nearest = np.clip(np.arange(EPOCHS_PER_SECOND), indices[0], indices[-1]) - indices[0]
    boresight = None
    if any(any(map(any, state[4:])) for _, state in commands):
        angles = np.array([motion.at(time).heading_elevation_bank for time in times])
        boresight = _boresight_itrf(angles, vectors[:, 0])[nearest]
    vectors = vectors[nearest]
    return VehicleTrack(vectors[:, 0], vectors[:, 1], vectors[:, 2], boresight)


def _extrapolate(state: MotionState, seconds: FloatArray) -> FloatArray:
    """Return position, velocity, acceleration (k, 3, 3), as `MotionState.extrapolate` does."""
    position, velocity, acceleration, jerk = np.array(state[:4])
    seconds = seconds[:, None]
    half, third = seconds / 2.0, seconds / 3.0
    vectors = np.empty((len(seconds), 3, 3))
    vectors[:, 0] = position + seconds * (velocity + half * (acceleration + third * jerk))
    vectors[:, 1] = velocity + seconds * (acceleration + half * jerk)
    vectors[:, 2] = acceleration + seconds * jerk
    return vectors


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

"""Geometry that is drawn by the seed of a run: epoch, node and place on the orbit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vtff_dynamics.vectors import FloatArray

__all__ = ["GeometryDraw"]

_STREAM = 3
"""Stream of the draws, after those of `thruster_errors`; its number is part of every seed."""
_SECONDS_PER_DAY = 86400


@dataclass(frozen=True)
class GeometryDraw:
    """Quantities that a scenario leaves to the seed; all are drawn uniformly.

    Parameters
    ----------
    epoch_days : float
        The epoch moves by whole seconds within this many days after that of the file.
    node : bool
        All orbits turn by the same angle about the axis of the Earth.
    place_on_orbit : bool
        All orbits turn by the same angle about the normal of the chief's orbit, so that relative
        positions and velocities stay as they are.

    Raises
    ------
    ValueError
        If the number of days is not between 0 and 36525.
    """

    epoch_days: float = 0.0
    node: bool = False
    place_on_orbit: bool = False

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not 0.0 <= self.epoch_days <= 36525.0:
            raise ValueError(f"epoch_days: between 0 and 36525 expected, got {self.epoch_days}")

    def draw(self, seed: int) -> DrawnGeometry:
        """Return the geometry of a seed; what is not left to it does not change the rest."""
        epoch, node, place = np.random.default_rng(np.random.SeedSequence((seed, _STREAM))).random(
            3
        )
        return DrawnGeometry(
            delay=int(epoch * self.epoch_days * _SECONDS_PER_DAY),
            node_angle=2.0 * np.pi * float(node) if self.node else 0.0,
            orbit_angle=2.0 * np.pi * float(place) if self.place_on_orbit else 0.0,
        )


@dataclass(frozen=True)
class DrawnGeometry:
    """Geometry of one run.

    Parameters
    ----------
    delay : int
        By which the epoch is later, s.
    node_angle, orbit_angle : float
        Rotations about the axis of the Earth and the normal of the chief's orbit, rad.
    """

    delay: int
    node_angle: float
    orbit_angle: float

    def turned(self, state_gcrf: FloatArray, state_chief_gcrf: FloatArray) -> FloatArray:
        """Return a state (6,) with the orbits turned; `state_chief_gcrf` is that of the file."""
        normal = np.cross(state_chief_gcrf[:3], state_chief_gcrf[3:])
        along = Rotation.from_rotvec(self.orbit_angle * normal / np.linalg.norm(normal))
        rotation = Rotation.from_rotvec([0.0, 0.0, self.node_angle]) * along
        return np.asarray(np.concatenate(rotation.apply(state_gcrf.reshape(2, 3))))

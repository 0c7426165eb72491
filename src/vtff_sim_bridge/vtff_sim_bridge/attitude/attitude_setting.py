"""What a scenario says of the attitude of a spacecraft: body, module, start, faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.orbit_axes import (
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import check_quaternion
from vtff_dynamics.attitude.rigid_body import AttitudeState
from vtff_dynamics.attitude.spacecraft import SpacecraftBody
from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.attitude.adcs_module import AdcsModuleModel
from vtff_sim_bridge.attitude.magnetometer import MagnetometerModel

__all__ = [
    "ATTITUDE_FAULTS",
    "AttitudeEnvironment",
    "AttitudeFault",
    "AttitudeSetting",
    "AttitudeStart",
    "AttitudeThruster",
    "BodyThrusters",
]

ATTITUDE_FAULTS = (
    "magnetometer_silent",
    "magnetometer_stuck",
    "magnetometer_saturated",
    "wheel_stuck",
)
"""What a scenario can let go wrong in the module."""


@dataclass(frozen=True)
class AttitudeStart:
    """Attitude at the epoch: `quaternion_gcrf`, `roll_pitch_yaw_deg`, or a drawn one.

    Parameters
    ----------
    roll_pitch_yaw_deg : array_like, shape (3,), optional
        To the orbit axes (`vtff_dynamics.attitude.orbit_axes`), deg.
    quaternion_gcrf : array_like, shape (4,), optional
        Body to GCRF, x, y, z, w.
    rate_body : array_like, shape (3,), optional
        rad/s against GCRF.
    tumble_rpm : float
        Without `rate_body`: rate about an axis that the seed draws.
    wheel_speed_rpm : float

    Raises
    ------
    ValueError
        One line that names the field.
    """

    roll_pitch_yaw_deg: npt.ArrayLike | None = None
    quaternion_gcrf: npt.ArrayLike | None = None
    rate_body: npt.ArrayLike | None = None
    tumble_rpm: float = 0.0
    wheel_speed_rpm: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        if self.roll_pitch_yaw_deg is not None and self.quaternion_gcrf is not None:
            raise ValueError("roll_pitch_yaw_deg, quaternion_gcrf: one of them expected, got both")
        if self.roll_pitch_yaw_deg is not None:
            check_vector("roll_pitch_yaw_deg", self.roll_pitch_yaw_deg, 3, "deg")
        if self.quaternion_gcrf is not None:
            check_quaternion("quaternion_gcrf", self.quaternion_gcrf)
        if self.rate_body is not None:
            check_vector("rate_body", self.rate_body, 3, "rad/s")
            if self.tumble_rpm:
                raise ValueError("rate_body, tumble_rpm: one of them expected, got both")

    def state(
        self, body: SpacecraftBody, state_gcrf: FloatArray, generator: np.random.Generator
    ) -> AttitudeState:
        """Return the attitude at the epoch.

        Parameters
        ----------
        body : SpacecraftBody
        state_gcrf : ndarray, shape (6,)
            Orbit at the epoch, m and m/s.
        generator : numpy.random.Generator
            Source of what is drawn.

        Raises
        ------
        ValueError
            If the wheel does not reach its speed.
        """
        quaternion = generator.standard_normal(4)
        axis = generator.standard_normal(3)
        if self.quaternion_gcrf is not None:
            quaternion = check_quaternion("quaternion_gcrf", self.quaternion_gcrf)
        elif self.roll_pitch_yaw_deg is not None:
            roll, pitch, yaw = np.radians(np.asarray(self.roll_pitch_yaw_deg, dtype=float))
            quaternion = quaternion_from_roll_pitch_yaw(
                roll, pitch, yaw, rotation_gcrf_to_orbit(state_gcrf)
            )
        rate = 2.0 * math.pi / 60.0 * self.tumble_rpm * axis / np.linalg.norm(axis)
        if self.rate_body is not None:
            rate = np.asarray(self.rate_body, dtype=float)
        try:
            momentum = body.wheel_momentum(self.wheel_speed_rpm)
        except ValueError as error:
            raise ValueError(f"wheel_speed_rpm: {error}") from None
        return AttitudeState(quaternion / np.linalg.norm(quaternion), rate, momentum)


@dataclass(frozen=True)
class AttitudeEnvironment:
    """What acts on the attitude besides the module.

    Parameters
    ----------
    field_error_sigma : float
        Sigma of each axis of the true field less IGRF, T.
    drag_pressure : float
        Drag force over the square of the speed against the air, N s2/m2: rho C_D A / 2.
    """

    field_error_sigma: float = 0.0
    drag_pressure: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        for name in ("field_error_sigma", "drag_pressure"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected 0 or more; got {getattr(self, name)!r}")


@dataclass(frozen=True)
class AttitudeThruster:
    """The thruster that the module fires: its force turns the spacecraft.

    Parameters
    ----------
    force_body : array_like, shape (3,)
        N; a misalignment is a force that is not along its axis.
    point_body : array_like, shape (3,)
        Where it acts, m from the centre of mass.
    """

    force_body: npt.ArrayLike = (0.0, 0.0, 0.0)
    point_body: npt.ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the fields."""
        check_vector("force_body", self.force_body, 3, "N")
        check_vector("point_body", self.point_body, 3, "m")


@dataclass(frozen=True)
class BodyThrusters:
    """The thrusters of a formation flight, fixed in the body: one along each of its axes.

    With them the thrust of a spacecraft acts along the axes of its body, wherever they point, and
    a thruster whose line of force misses the centre of mass turns the spacecraft.

    Parameters
    ----------
    mass : float
        Mass of the spacecraft, kg: the force of an acceleration.
    points_body : array_like, shape (3, 3)
        Row i is where the thruster of axis i acts, m from the centre of mass.
    """

    mass: float
    points_body: npt.ArrayLike = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        """Check the fields."""
        if not 0.0 < self.mass < math.inf:
            raise ValueError(f"mass: expected a positive number (kg); got {self.mass!r}")
        points = np.array(self.points_body, dtype=float)
        if points.shape != (3, 3) or not np.isfinite(points).all():
            raise ValueError("points_body: expected 3 x 3 finite numbers (m)")
        object.__setattr__(self, "points_body", points)

    def torque(self, accelerations: FloatArray) -> FloatArray:
        """Return the torque of the thrusters, N m, body axes, shape (3,).

        Parameters
        ----------
        accelerations : ndarray, shape (3, 3)
            Row i is the acceleration that the thruster of axis i gives, m/s2, body axes.
        """
        torque: FloatArray = self.mass * np.cross(np.asarray(self.points_body), accelerations).sum(
            axis=0
        )
        return torque


@dataclass(frozen=True)
class AttitudeFault:
    """A fault of the module for a while.

    Parameters
    ----------
    kind : str
        One of `ATTITUDE_FAULTS`.
    start, end : float
        s since the epoch; it holds in periods that begin between them.
    """

    kind: str
    start: float
    end: float = math.inf

    def __post_init__(self) -> None:
        """Check the fields."""
        if self.kind not in ATTITUDE_FAULTS:
            raise ValueError(f"kind: one of {', '.join(ATTITUDE_FAULTS)} expected; got {self.kind}")
        if not self.start < self.end:
            raise ValueError(
                f"start, end: an end after the start expected; got {self.start}, {self.end}"
            )

    def holds_at(self, time: float) -> bool:
        """Return whether the fault holds at a time, s since the epoch."""
        return self.start <= time < self.end


@dataclass(frozen=True)
class AttitudeSetting:
    """The attitude of a spacecraft in a scenario.

    Parameters
    ----------
    period : float
        Period of the ADCS, s.
    body, magnetometer, module, start, environment, thruster
        Their parts; see their classes.
    faults : tuple of AttitudeFault
    propulsion : BodyThrusters, optional
        Thrusters of the formation flight that are fixed in the body. Without them thrust acts along
        the axes of the orbit and does not turn the spacecraft.
    """

    period: float = 5.0
    body: SpacecraftBody = field(default_factory=SpacecraftBody)
    magnetometer: MagnetometerModel = field(default_factory=MagnetometerModel)
    module: AdcsModuleModel = field(default_factory=AdcsModuleModel)
    start: AttitudeStart = field(default_factory=AttitudeStart)
    environment: AttitudeEnvironment = field(default_factory=AttitudeEnvironment)
    thruster: AttitudeThruster = field(default_factory=AttitudeThruster)
    faults: tuple[AttitudeFault, ...] = ()
    propulsion: BodyThrusters | None = None

    def __post_init__(self) -> None:
        """Check the period against the module."""
        if not self.module.quiet_window < self.period < math.inf:
            raise ValueError(
                f"period: expected more than the quiet window of {self.module.quiet_window:g} s; "
                f"got {self.period!r}"
            )
        if max(self.module.sample_times) >= self.period:
            raise ValueError(
                f"period: expected more than the time of the first sample before its end, "
                f"{max(self.module.sample_times):g} s; got {self.period!r}"
            )

    def period_in_steps(self, step: float) -> int:
        """Return how many steps of the simulation a period has.

        Raises
        ------
        ValueError
            If it is not one or more whole steps.
        """
        steps = self.period / step
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-9 * steps:
            raise ValueError(
                f"period: one or more whole steps of {step:g} s expected; got {self.period:g} s"
            )
        return round(steps)

"""What the attitude filters believe of spacecraft, sensor and disturbances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.rigid_body import check_inertia
from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import FloatArray

__all__ = ["AttitudeFilterConfiguration", "BodyModel"]


@dataclass(frozen=True)
class BodyModel:
    """The spacecraft as the filters and controllers know it.

    Parameters
    ----------
    inertia : array_like, shape (3, 3) or (3,)
        kg m2.
    wheel_axis : array_like, shape (3,)
    wheel_inertia : float
        kg m2.
    torquer_moment : float
        Moment of a rod that is on, A m2.
    torquer_coupling : array_like, shape (3, 3)
        Moment of the spacecraft over the moments of the rods.

    Raises
    ------
    ValueError
        One line that names the parameter.
    """

    inertia: npt.ArrayLike = (0.055, 0.058, 0.056)
    wheel_axis: npt.ArrayLike = (0.0, 1.0, 0.0)
    wheel_inertia: float = 0.01 / (5000.0 * 2.0 * math.pi / 60.0)
    torquer_moment: float = 0.127
    torquer_coupling: npt.ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        """Check the parameters and turn them into arrays."""
        object.__setattr__(self, "inertia", check_inertia("inertia", self.inertia))
        object.__setattr__(
            self, "wheel_axis", check_vector("wheel_axis", self.wheel_axis, 3, "axis in the body")
        )
        for name in ("wheel_inertia", "torquer_moment"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected a positive number; got {getattr(self, name)!r}")
        coupling = np.array(self.torquer_coupling, dtype=float)
        if coupling.shape != (3, 3) or not np.isfinite(coupling).all():
            raise ValueError("torquer_coupling: expected 3 x 3 finite numbers")
        object.__setattr__(self, "torquer_coupling", coupling)

    @property
    def inertia_matrix(self) -> FloatArray:
        """Inertia, kg m2, shape (3, 3)."""
        return np.ascontiguousarray(self.inertia, dtype=float)


@dataclass(frozen=True)
class AttitudeFilterConfiguration:
    """Noise that the multiplicative filter counts with, and what it estimates.

    Parameters
    ----------
    magnetometer_sigma : float
        White noise of each axis, T.
    initial_rotation_sigma_deg, initial_rate_sigma, initial_dipole_sigma : float
        Sigmas of the start: deg, rad/s, A m2.
    estimates_dipole : bool
        Without, the dipole is what `initial_dipole` says.
    initial_dipole : array_like, shape (3,)
        A m2.
    torque_noise : float
        White torque that no model knows, N m sqrt(s).
    torque_sigma, torque_time : float
        Torque that no model knows and that stays alike for a while, on each axis of the body, N m,
        and how long, s; that of drag while pointing. A sigma of 0: not estimated.
    dipole_drift_sigma, dipole_drift_time : float
        Change of the dipole in time on each axis, A m2/s, and how long it stays alike, s. By
        default a change by a tenth of 0.15 A m2 in a day is two sigma. 0: the dipole is constant.
    bias_sigma, bias_walk : float
        Magnetometer bias, T, and its walk, T/sqrt(s). A sigma of 0: not estimated.
    inertia_sigma : float
        Share by which each principal moment may be wrong. 0: not estimated.
    field_sigma, field_time : float
        Error of the field model on each axis, T, see `vtff_nav.attitude.field_error`, and how long
        it stays alike at a place, s. A sigma of 0: the field is perfect.
    wheel_sigma : float
        Sigma of the momentum of the wheel at the end of a period about what it was told, N m s.
    torquer_sigma : float
        Share by which the moment of a pulse may be wrong.
    thruster_offset_sigma : float
        Distance by which the line of force of each thruster may miss the centre of mass, along each
        of the two axes across it, m. SNAP-1's missed it by 4 mm (Steyn and Hashida 2001). 0: not
        estimated, and forces of thrusters do not turn the spacecraft.
    gate : float
        Samples with a normalised innovation squared (3 numbers) above it are not used.
    longest_step : float
        Longest step of the prediction, s; steps end too where a pulse does.

    Raises
    ------
    ValueError
        If a number is negative or not finite; the message names it.
    """

    magnetometer_sigma: float = 60e-9
    initial_rotation_sigma_deg: float = 40.0
    initial_rate_sigma: float = 0.005
    initial_dipole_sigma: float = 0.2
    estimates_dipole: bool = True
    initial_dipole: npt.ArrayLike = (0.0, 0.0, 0.0)
    torque_noise: float = 1e-8
    torque_sigma: float = 0.0
    torque_time: float = 3000.0
    dipole_drift_sigma: float = 5e-8
    dipole_drift_time: float = 86400.0
    bias_sigma: float = 0.0
    bias_walk: float = 0.0
    inertia_sigma: float = 0.0
    field_sigma: float = 0.0
    field_time: float = 86400.0
    wheel_sigma: float = 1e-7
    torquer_sigma: float = 0.0
    thruster_offset_sigma: float = 0.0
    gate: float = math.inf
    longest_step: float = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in (
            "magnetometer_sigma",
            "torque_time",
            "dipole_drift_time",
            "field_time",
            "longest_step",
            "gate",
        ):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: expected a positive number; got {getattr(self, name)!r}")
        for name in (
            "initial_rotation_sigma_deg",
            "initial_rate_sigma",
            "initial_dipole_sigma",
            "torque_noise",
            "torque_sigma",
            "dipole_drift_sigma",
            "bias_sigma",
            "bias_walk",
            "inertia_sigma",
            "field_sigma",
            "wheel_sigma",
            "torquer_sigma",
            "thruster_offset_sigma",
        ):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected 0 or more; got {getattr(self, name)!r}")
        check_vector("initial_dipole", self.initial_dipole, 3, "A m2")

    def noise(self) -> FloatArray:
        """Return the process noise in the order of the kernels, shape (9,)."""
        return np.array(
            [
                self.torque_noise,
                self.dipole_drift_sigma if self.estimates_dipole else 0.0,
                self.dipole_drift_time,
                self.bias_walk,
                self.wheel_sigma,
                self.torquer_sigma,
                self.field_time,
                self.torque_sigma,
                self.torque_time,
            ]
        )

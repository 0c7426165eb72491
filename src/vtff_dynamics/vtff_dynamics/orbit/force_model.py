"""The forces on a spacecraft: their choice, their brahe configuration and their sum at a state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import brahe
import numpy as np

from vtff_dynamics.constants import J2_EARTH
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.earth_environment import (
    brahe_constants,
    ensure_earth_orientation,
    ensure_space_weather,
    jgm3_gravity_model,
)
from vtff_dynamics.orbit.gravity import gravity_acceleration, gravity_jerk
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["DRAG_MODELS", "GRAVITY_MODELS", "MAXIMUM_DEGREE", "THIRD_BODIES", "ForceModel"]

GRAVITY_MODELS = ("two_body", "spherical_harmonics")
"""Accepted values of `ForceModel.gravity`."""

DRAG_MODELS = ("harris_priester", "nrlmsise00")
"""Accepted values of `ForceModel.drag` beside None."""

THIRD_BODIES = ("sun", "moon")
"""Accepted members of `ForceModel.third_bodies`."""

MAXIMUM_DEGREE = 70
"""Highest degree and order of JGM-3."""

# Solar radiation pressure at 1 au, N/m2 (Montenbruck and Gill 2000, eq. 3.69).
_SOLAR_PRESSURE = 4.56e-6


@dataclass(frozen=True)
class ForceModel:
    """Which forces act on a spacecraft, and its properties that matter to them.

    Parameters
    ----------
    gravity : str
        ``two_body`` or ``spherical_harmonics`` (JGM-3).
    degree, order : int
        Truncation of the harmonics; 2 <= degree <= 70, 0 <= order <= degree. Not used by two_body.
    drag : str or None
        ``harris_priester``, ``nrlmsise00`` or None.
    solar_radiation_pressure : bool
        Cannonball model with a conical Earth shadow.
    third_bodies : tuple of str
        Any of ``sun`` and ``moon``, with low-precision analytic ephemerides.
    mass : float
        kg. Matters, like the following, only to drag and radiation pressure.
    drag_area, radiation_area : float
        Cross-sections, m2.
    drag_coefficient, radiation_coefficient : float
        Cd and Cr.

    Raises
    ------
    ValueError
        If a value is not allowed; the message names the parameter.
    """

    gravity: str = "spherical_harmonics"
    degree: int = 8
    order: int = 8
    drag: str | None = None
    solar_radiation_pressure: bool = False
    third_bodies: tuple[str, ...] = ()
    mass: float = 100.0
    drag_area: float = 1.0
    drag_coefficient: float = 2.2
    radiation_area: float = 1.0
    radiation_coefficient: float = 1.3

    def __post_init__(self) -> None:
        """Check every value."""
        if self.gravity not in GRAVITY_MODELS:
            raise ValueError(
                f"gravity {self.gravity!r}: must be one of {', '.join(GRAVITY_MODELS)}"
            )
        if self.gravity == "spherical_harmonics":
            if not 2 <= self.degree <= MAXIMUM_DEGREE:
                raise ValueError(f"degree {self.degree}: must be from 2 to {MAXIMUM_DEGREE}")
            if not 0 <= self.order <= self.degree:
                raise ValueError(f"order {self.order}: must be from 0 to the degree {self.degree}")
        if self.drag is not None and self.drag not in DRAG_MODELS:
            raise ValueError(f"drag {self.drag!r}: must be None or one of {', '.join(DRAG_MODELS)}")
        object.__setattr__(self, "third_bodies", tuple(self.third_bodies))
        for body in self.third_bodies:
            if body not in THIRD_BODIES:
                raise ValueError(f"third_bodies {body!r}: must be among {', '.join(THIRD_BODIES)}")
        if not 0.0 < self.mass < float("inf"):
            raise ValueError(f"mass {self.mass}: must be positive and finite")
        for name in ("drag_area", "drag_coefficient", "radiation_area", "radiation_coefficient"):
            value = getattr(self, name)
            if not 0.0 <= value < float("inf"):
                raise ValueError(f"{name} {value}: must be finite and not negative")

    @property
    def is_gravity_alone(self) -> bool:
        """Whether no force but the gravity of the Earth acts."""
        return self.drag is None and not self.solar_radiation_pressure and not self.third_bodies

    def prepare_environment(self) -> None:
        """Load the offline tables that these forces need, once per process."""
        ensure_earth_orientation()
        if self.drag == "nrlmsise00":
            ensure_space_weather()

    def to_brahe(self) -> Any:
        """Return the brahe `ForceModelConfig` of these forces."""
        value = brahe.ParameterSource.value
        options: dict[str, Any] = {"mass": value(self.mass)}
        if self.gravity == "two_body":
            options["gravity"] = brahe.GravityConfiguration.point_mass()
        else:
            options["gravity"] = brahe.GravityConfiguration.spherical_harmonic(
                self.degree, self.order, brahe_constants.GravityModelType.JGM3
            )
        if self.drag is not None:
            options["drag"] = brahe.DragConfiguration(
                getattr(brahe_constants.AtmosphericModel, self.drag.upper()),
                value(self.drag_area),
                value(self.drag_coefficient),
            )
        elif self.gravity == "two_body":
            # Nothing depends on the orientation of the Earth: spare its computation.
            options["frame_transform"] = (
                brahe_constants.FrameTransformationModel.EARTH_ROTATION_ONLY
            )
        if self.solar_radiation_pressure:
            options["srp"] = brahe.SolarRadiationPressureConfiguration(
                value(self.radiation_area),
                value(self.radiation_coefficient),
                brahe_constants.EclipseModel.CONICAL,
            )
        if self.third_bodies:
            options["third_body"] = [
                brahe.ThirdBodyConfiguration(
                    getattr(brahe_constants.ThirdBody, body.upper()),
                    brahe_constants.EphemerisSource.LowPrecision,
                )
                for body in self.third_bodies
            ]
        return brahe.ForceModelConfig(**options)

    def acceleration(self, time: GpsTime, state_gcrf: FloatArray) -> FloatArray:
        """Return the sum of these forces per mass in GCRF, m/s2, shape (3,).

        Parameters
        ----------
        time : GpsTime
            Time of the state.
        state_gcrf : ndarray, shape (6,)
            Position and velocity, m and m/s.
        """
        self.prepare_environment()
        if self.gravity == "two_body":
            total = gravity_acceleration(state_gcrf[:3], j2=0.0)
        else:
            total = np.array(
                brahe.accel_gravity_spherical_harmonics(
                    state_gcrf[:3],
                    rotation_gcrf_to_itrf(time),
                    jgm3_gravity_model(),
                    self.degree,
                    self.order,
                )
            )
        if self.is_gravity_alone:
            return total
        return total + self._perturbation(time, state_gcrf)

    def jerk(self, state_gcrf: FloatArray) -> FloatArray:
        """Return the jerk by gravity in GCRF, m/s3, shape (3,).

        It is that of the point mass, with harmonics also of J2. What is left out is below
        2e-6 m/s3 in low orbit (0.3 um over one second).

        Parameters
        ----------
        state_gcrf : ndarray, shape (6,)
            Position and velocity, m and m/s.
        """
        return gravity_jerk(state_gcrf, j2=self.j2_of_jerk)

    @property
    def j2_of_jerk(self) -> float:
        """Second zonal coefficient of `jerk`."""
        return 0.0 if self.gravity == "two_body" else J2_EARTH

    def _perturbation(self, time: GpsTime, state_gcrf: FloatArray) -> FloatArray:
        """Return the acceleration by drag, radiation and third bodies, m/s2, shape (3,)."""
        epoch = time.to_brahe_epoch()
        total = np.zeros(3)
        if "sun" in self.third_bodies:
            total += brahe.accel_third_body_sun(epoch, state_gcrf[:3])
        if "moon" in self.third_bodies:
            total += brahe.accel_third_body_moon(epoch, state_gcrf[:3])
        if self.solar_radiation_pressure:
            sun = brahe.sun_position(epoch)
            total += brahe.eclipse_conical(
                state_gcrf[:3], sun
            ) * brahe.accel_solar_radiation_pressure(
                state_gcrf[:3],
                sun,
                self.mass,
                self.radiation_coefficient,
                self.radiation_area,
                _SOLAR_PRESSURE,
            )
        if self.drag is not None:
            total += self._drag(time, epoch, state_gcrf)
        return total

    def _drag(
        self,
        time: GpsTime,
        epoch: Any,
        state_gcrf: FloatArray,
    ) -> FloatArray:
        """Return the acceleration by drag, m/s2, shape (3,)."""
        to_true_of_date = brahe.bias_precession_nutation(epoch)
        if self.drag == "harris_priester":
            density = brahe.density_harris_priester(
                to_true_of_date @ state_gcrf[:3], to_true_of_date @ brahe.sun_position(epoch)
            )
        else:
            density = brahe.density_nrlmsise00(epoch, rotation_gcrf_to_itrf(time) @ state_gcrf[:3])
        return np.asarray(
            brahe.accel_drag(
                state_gcrf,
                density,
                self.mass,
                self.drag_area,
                self.drag_coefficient,
                to_true_of_date,
            )
        )

"""Vertical TEC that differs from place to place: gradients and travelling disturbances.

Both are added to the TEC of the spherical profile on a thin shell above the receivers, where a ray
pierces it, as in the obliquity factor of single-layer models (Schaer 1999, section 2.3.3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import RADIUS_EARTH_JGM3
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.noise.random_streams import Effect, generator

__all__ = ["HorizontalGradient", "HorizontalStructure", "TravellingDisturbance"]


@dataclass(frozen=True)
class HorizontalGradient:
    """Vertical TEC that grows along a direction.

    Parameters
    ----------
    tecu_per_deg : float
        Growth with the geocentric angle, TECU/deg.
    azimuth_deg : float
        Direction of the growth, from north over east, below the first vehicle at the start.
    shell_altitude : float
        Altitude of the shell, m; above the receivers.
    extent_deg : float
        Angle from the start of the run at which the growth ends on either side, deg.
    content_tecu : float
        Vertical TEC above the first vehicle at the start, TECU. Where the whole TEC of a ray would
        be negative it is zero, which ends the gradient there.
    """

    tecu_per_deg: float
    azimuth_deg: float
    shell_altitude: float
    extent_deg: float = 20.0
    content_tecu: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not math.isfinite(self.tecu_per_deg):
            raise ValueError(f"tecu_per_deg: a finite number expected, got {self.tecu_per_deg}")
        if not 0.0 < self.extent_deg <= 90.0:
            raise ValueError(
                f"extent_deg: more than 0 and at most 90 expected, got {self.extent_deg}"
            )
        if not (math.isfinite(self.content_tecu) and self.content_tecu >= 0.0):
            raise ValueError(f"content_tecu: 0 or more expected, got {self.content_tecu}")

    def vertical_tecu(self, angle: FloatArray, elapsed: FloatArray, phase: float) -> FloatArray:
        """Return the vertical TEC at angles in rad along the direction; see the waves below."""
        extent = self.extent_deg
        grown = self.tecu_per_deg * np.clip(np.degrees(angle), -extent, extent)
        return np.asarray(self.content_tecu + grown)


@dataclass(frozen=True)
class TravellingDisturbance:
    """A wave of vertical TEC that travels along a direction; its phase is drawn by seed.

    Parameters
    ----------
    amplitude_tecu : float
        Half of peak to peak, TECU.
    wavelength : float
        On the shell, m.
    period : float
        s.
    azimuth_deg : float
        Direction of travel, from north over east, below the first vehicle at the start.
    shell_altitude : float
        Altitude of the shell, m; above the receivers.
    """

    amplitude_tecu: float
    wavelength: float
    period: float
    azimuth_deg: float
    shell_altitude: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not self.amplitude_tecu >= 0.0:
            raise ValueError(f"amplitude_tecu: 0 or more expected, got {self.amplitude_tecu}")
        for name in ("wavelength", "period"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: more than 0 expected, got {getattr(self, name)}")

    def vertical_tecu(self, angle: FloatArray, elapsed: FloatArray, phase: float) -> FloatArray:
        """Return the vertical TEC.

        Parameters
        ----------
        angle : ndarray, shape (k, n)
            Geocentric angle of the pierce points along the direction, rad.
        elapsed : ndarray, shape (k, 1)
            Time into the run, s.
        phase : float
            Phase of the wave at the start, rad.
        """
        distance = (RADIUS_EARTH_JGM3 + self.shell_altitude) * angle
        turns = distance / self.wavelength - elapsed / self.period
        return np.asarray(self.amplitude_tecu * np.sin(2.0 * math.pi * turns + phase))


class HorizontalStructure:
    """All horizontal structures of a run, shared by its receivers.

    Parameters
    ----------
    structures : sequence of HorizontalGradient or TravellingDisturbance
    seed : int
        Seed of the run.
    position_itrf : array_like, shape (3,)
        First vehicle at the start, m: angles count from below it.

    Raises
    ------
    ValueError
        If a shell is not above that vehicle.
    """

    def __init__(
        self,
        structures: Sequence[HorizontalGradient | TravellingDisturbance],
        seed: int,
        position_itrf: npt.ArrayLike,
    ) -> None:
        position = np.asarray(position_itrf, dtype=float)
        radius = float(np.linalg.norm(position))
        up = position / radius
        east = np.cross((0.0, 0.0, 1.0), up)
        east /= np.linalg.norm(east)
        north = np.cross(up, east)
        self._structures = tuple(structures)
        self._axes, self._phases = [], []
        for number, structure in enumerate(structures):
            altitude = radius - RADIUS_EARTH_JGM3
            if not structure.shell_altitude > altitude:
                raise ValueError(
                    f"shell_altitude: above the receivers expected ({altitude / 1e3:.0f} km), "
                    f"got {structure.shell_altitude / 1e3:g} km"
                )
            azimuth = math.radians(structure.azimuth_deg)
            self._axes.append(math.cos(azimuth) * north + math.sin(azimuth) * east)
            stream = generator(seed, Effect.IONOSPHERIC_WAVE, number)
            self._phases.append(2.0 * math.pi * float(stream.random()))

    def slant_tec_tecu(
        self, position_itrf: FloatArray, direction_itrf: FloatArray, elapsed: FloatArray
    ) -> FloatArray:
        """Return what the structures add to the slant TEC, TECU, shape (k, n).

        Parameters
        ----------
        position_itrf : ndarray, shape (k, 3)
            Receiver, m.
        direction_itrf : ndarray, shape (k, n, 3)
            Unit vectors to the satellites.
        elapsed : ndarray, shape (k,)
            Time into the run, s.
        """
        position = position_itrf[:, None]
        radius = np.linalg.norm(position, axis=-1)
        sine = (
            np.einsum(
                "kni,kni->kn", np.broadcast_to(position, direction_itrf.shape), direction_itrf
            )
            / radius
        )
        total = np.zeros(sine.shape)
        for structure, axis, phase in zip(self._structures, self._axes, self._phases, strict=True):
            shell = RADIUS_EARTH_JGM3 + structure.shell_altitude
            # Sine of the elevation at the pierce point, by the law of sines.
            sine_there = np.sqrt(1.0 - (radius / shell) ** 2 * (1.0 - sine**2))
            distance = shell * sine_there - radius * sine
            pierce = position + distance[..., None] * direction_itrf
            angle = np.arcsin(np.clip(pierce @ axis / shell, -1.0, 1.0))
            total += structure.vertical_tecu(angle, elapsed[:, None], phase) / sine_there
        return total

"""Errors of a thruster against the thrust that it reports: scale, direction, noise and bias.

The model is that of Gates (1963), A simplified model of midcourse maneuver execution errors,
JPL TR 32-504: errors in proportion to the thrust (scale, direction, noise) and a fixed one (bias).
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from vtff_dynamics.vectors import FloatArray

__all__ = ["ThrusterErrorModel", "ThrusterErrors"]

_AXIS_STREAM, _NOISE_STREAM = 1, 2
"""What a random stream is for; the numbers are part of every seed and must not change."""


@dataclass(frozen=True)
class ThrusterErrorModel:
    """Errors of the thruster of one spacecraft; the defaults are a perfect one.

    Parameters
    ----------
    scale : float
        True over reported thrust.
    misalignment_deg : float
        Angle of the rotation from reported to true thrust. Its axis is drawn once for a run,
        uniformly on the sphere and fixed in the axes of the thrust, RTN or the body, so the
        direction of a thrust is off by at most this angle.
    noise : float
        Sigma of each axis of the true thrust over the length of the reported thrust, drawn anew in
        every step.
    bias : tuple of float
        Added to the thrust in its axes while the thruster fires, m/s2.

    Raises
    ------
    ValueError
        If a value is out of range; the message names the parameter.
    """

    scale: float = 1.0
    misalignment_deg: float = 0.0
    noise: float = 0.0
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("scale", "noise"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name}: 0 or more expected, got {value}")
        if not 0.0 <= self.misalignment_deg <= 180.0:
            raise ValueError(
                f"misalignment_deg: between 0 and 180 expected, got {self.misalignment_deg}"
            )
        is_numeric = all(
            isinstance(value, (int, float)) and not isinstance(value, bool) for value in self.bias
        )
        if len(self.bias) != 3 or not is_numeric or not np.isfinite(self.bias).all():
            raise ValueError(f"bias: three numbers (m/s2) expected, got {list(self.bias)}")


class ThrusterErrors:
    """The true thrust of one spacecraft in each step of a run.

    Parameters
    ----------
    model : ThrusterErrorModel
    seed : int
        Seed of the run.
    spacecraft : str
        Name of the spacecraft: its errors do not depend on which others fly.
    """

    def __init__(self, model: ThrusterErrorModel, seed: int, spacecraft: str) -> None:
        self._model = model
        self._address = (seed, zlib.crc32(spacecraft.encode()))
        axis = self._generator(_AXIS_STREAM).standard_normal(3)
        angle = math.radians(model.misalignment_deg)
        self._scaled_rotation: FloatArray = (
            model.scale * Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        )

    def _generator(self, *stream: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence((*self._address, *stream)))

    def true_acceleration(self, step: int, reported: npt.ArrayLike) -> FloatArray:
        """Return the acceleration that acts in a step, m/s2, shape (3,).

        Parameters
        ----------
        step : int
            Number of the step since the epoch; it addresses the noise, so that the acceleration of
            a step is the same however often it is asked for.
        reported : array_like, shape (3,)
            Acceleration that the thruster reports, m/s2, in the axes that it is fixed in: the RTN
            axes of the chief, or those of the body.
        """
        given = np.asarray(reported, dtype=float)
        if not given.any():
            return given
        return np.asarray(self._scaled_rotation @ given + self._additions(step, given))

    def accelerations_of_thrusters(self, step: int, reported: npt.ArrayLike) -> FloatArray:
        """Return what the thrusters of the three axes give in a step, m/s2, shape (3, 3).

        Row i is what the thruster of axis i gives; their sum is `true_acceleration`. Noise and bias
        along an axis are those of its own thruster.
        """
        given = np.asarray(reported, dtype=float)
        if not given.any():
            return np.zeros((3, 3))
        return np.asarray((self._scaled_rotation * given).T + np.diag(self._additions(step, given)))

    def _additions(self, step: int, reported: FloatArray) -> FloatArray:
        """Return bias and noise of a step in which the thruster fires, m/s2, shape (3,)."""
        added = np.array(self._model.bias, dtype=float)
        if self._model.noise > 0.0:
            draws = self._generator(_NOISE_STREAM, step).standard_normal(3)
            added = added + self._model.noise * float(np.linalg.norm(reported)) * draws
        return added

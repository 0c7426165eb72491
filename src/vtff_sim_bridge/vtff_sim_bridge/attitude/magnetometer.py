"""An emulated three-axis magnetometer: noise, bias, range, the rods that it sees, faults."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import FloatArray

__all__ = ["FAULTS", "Magnetometer", "MagnetometerModel"]

FAULTS = ("none", "stuck", "saturated", "silent")
"""What can be wrong: it repeats its last sample, shows its range on every axis, or nothing."""


@dataclass(frozen=True)
class MagnetometerModel:
    """Errors of a magnetometer; the defaults are SNAP-1's (table 1 of the paper), without bias.

    Parameters
    ----------
    noise : float
        White noise of each axis, T.
    bias : array_like, shape (3,)
        T, body axes.
    largest_field : float
        Range of each axis, T; beyond it shows the range.
    resolution : float
        Step of the converter, T; 0 has none.
    torquer_field : array_like, shape (3, 3)
        Field at the sensor over the moment of the rods, T/(A m2). By default that of dipoles some
        16 cm away: 50 uT for a rod along its own axis.

    Raises
    ------
    ValueError
        One line that names the parameter.
    """

    noise: float = 60e-9
    bias: npt.ArrayLike = (0.0, 0.0, 0.0)
    largest_field: float = 60e-6
    resolution: float = 0.0
    torquer_field: npt.ArrayLike = ((4e-4, 1e-4, 0.0), (1e-4, 4e-4, 1e-4), (0.0, 1e-4, 4e-4))

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("noise", "resolution"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: expected 0 or more (T); got {getattr(self, name)!r}")
        if not self.largest_field > 0.0:
            raise ValueError(
                f"largest_field: expected a positive number (T); got {self.largest_field!r}"
            )
        object.__setattr__(self, "bias", check_vector("bias", self.bias, 3, "T"))
        coupling = np.array(self.torquer_field, dtype=float)
        if coupling.shape != (3, 3) or not np.isfinite(coupling).all():
            raise ValueError("torquer_field: expected 3 x 3 finite numbers (T/(A m2))")
        object.__setattr__(self, "torquer_field", coupling)


class Magnetometer:
    """Samples of one magnetometer.

    Parameters
    ----------
    model : MagnetometerModel
    seed : int or sequence of int
        Seed of the noise; every sample draws three numbers, whatever its fault.
    """

    def __init__(self, model: MagnetometerModel, seed: int | tuple[int, ...]) -> None:
        self._model = model
        self._generator = np.random.default_rng(seed)
        self._last: FloatArray = np.zeros(3)
        self._fault = "none"

    @property
    def fault(self) -> str:
        """What is wrong with it, one of `FAULTS`."""
        return self._fault

    @fault.setter
    def fault(self, name: str) -> None:
        if name not in FAULTS:
            raise ValueError(f"fault: one of {', '.join(FAULTS)} expected, got {name!r}")
        self._fault = name

    def sample(self, field_body: FloatArray, rod_moment: FloatArray) -> FloatArray | None:
        """Return a sample, T, body axes, shape (3,); None from a silent one.

        Parameters
        ----------
        field_body : ndarray, shape (3,)
            Field of the Earth, T.
        rod_moment : ndarray, shape (3,)
            Moment of the rods at this time, A m2; zero in the quiet window.
        """
        model = self._model
        noise = model.noise * self._generator.standard_normal(3)
        if self._fault == "silent":
            return None
        if self._fault == "stuck":
            return np.array(self._last)
        if self._fault == "saturated":
            return np.full(3, model.largest_field)
        shown = (
            field_body
            + np.asarray(model.torquer_field) @ rod_moment
            + np.asarray(model.bias)
            + noise
        )
        if model.resolution > 0.0:
            shown = model.resolution * np.round(shown / model.resolution)
        self._last = np.clip(shown, -model.largest_field, model.largest_field)
        return np.array(self._last)

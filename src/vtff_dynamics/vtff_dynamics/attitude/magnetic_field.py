"""The Earth's magnetic field along an orbit: IGRF-14 of brahe, and models of its error.

IGRF holds the field of the core; what an orbit meets besides (crust, ring current, the secular
variation that the model did not foresee) is some hundreds of nanotesla, smooth over thousands of
kilometres and fixed to the Earth. `DrawnFieldError` is a potential field of that kind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import brahe
import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import RADIUS_EARTH_JGM3
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.earth_environment import brahe_constants
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "FIRST_YEAR",
    "LAST_YEAR",
    "DrawnFieldError",
    "FieldError",
    "check_field_year",
    "magnetic_field_gcrf",
]

FIRST_YEAR, LAST_YEAR = 1900, 2030
"""Years that IGRF-14 covers, from the start of the first to the start of the last."""

_NANOTESLA = 1e-9


class FieldError(Protocol):
    """True field less that of the model, fixed to the Earth."""

    def field_itrf(self, position_itrf: npt.ArrayLike) -> FloatArray:
        """Return the error at a position (3,), m, in ITRF axes, T, shape (3,)."""
        ...


def check_field_year(name: str, time: GpsTime) -> None:
    """Refuse a time that IGRF-14 does not cover.

    Raises
    ------
    ValueError
        One line with the name of the field.
    """
    year = int(time.isoformat("UTC")[:4])
    if not FIRST_YEAR <= year < LAST_YEAR:
        raise ValueError(
            f"{name}: the magnetic field model IGRF-14 holds from {FIRST_YEAR} to {LAST_YEAR}; "
            f"got {time.isoformat('UTC')}"
        )


def magnetic_field_gcrf(
    time: GpsTime, position_gcrf: npt.ArrayLike, error: FieldError | None = None
) -> FloatArray:
    """Return the magnetic field at a position, in GCRF axes, T, shape (3,).

    Parameters
    ----------
    time : GpsTime
    position_gcrf : array_like, shape (3,)
        Position, m.
    error : FieldError, optional
        Added to IGRF.

    Raises
    ------
    RuntimeError
        If IGRF does not cover the time; `check_field_year` asks before.
    """
    rotation = rotation_gcrf_to_itrf(time)
    position_itrf = rotation @ np.asarray(position_gcrf, dtype=float)
    latitude, longitude, height = geodetic_from_itrf(position_itrf).tolist()
    field_itrf = _NANOTESLA * np.asarray(
        brahe.igrf_ecef(
            time.to_brahe_epoch(),
            np.array([longitude, latitude, height]),
            brahe_constants.AngleFormat.RADIANS,
        )
    )
    if error is not None:
        field_itrf = field_itrf + error.field_itrf(position_itrf)
    field: FloatArray = rotation.T @ field_itrf
    return field


@dataclass(frozen=True)
class DrawnFieldError:
    """Error of a field model: a drawn potential field of the Earth, fixed to it.

    The field is that of magnetic dipoles drawn inside the Earth, so it has no divergence and no
    curl. Coefficients of field models have about equal errors at all degrees (Lowes 2000, Geophys.
    J. Int. 142, 946-947), so most of their error in orbit is of the degrees 3 to 8; dipoles at 0.6
    to 0.8 of the Earth's radius have such a spectrum. It is scaled so that the root mean square of
    each component over the sphere of the orbit is `sigma`.

    Parameters
    ----------
    sigma : float
        Root mean square of each component, T.
    seed : int
    radius : float
        Distance from the Earth's centre at which sigma holds, m.
    sources : int
        Number of dipoles.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    sigma: float
    seed: int
    radius: float = RADIUS_EARTH_JGM3 + 700e3
    sources: int = 60

    def __post_init__(self) -> None:
        """Draw the dipoles and scale them."""
        if not 0.0 <= self.sigma < math.inf:
            raise ValueError(f"sigma: 0 or more (T) expected, got {self.sigma}")
        if not self.radius > RADIUS_EARTH_JGM3 or self.sources < 1:
            raise ValueError(
                f"radius, sources: an orbit above the ground and one source or more expected, got "
                f"{self.radius:g} m and {self.sources}"
            )
        generator = np.random.default_rng((self.seed, 0xB))
        positions = generator.standard_normal((self.sources, 3))
        depths = RADIUS_EARTH_JGM3 * generator.uniform(0.6, 0.8, self.sources)
        positions *= (depths / np.linalg.norm(positions, axis=1))[:, None]
        moments = generator.standard_normal((self.sources, 3))
        # A Fibonacci lattice: equal areas, so that its mean is that of the sphere.
        count = 1000
        number = np.arange(count)
        z = 1.0 - (2.0 * number + 1.0) / count
        angle = number * math.pi * (3.0 - math.sqrt(5.0))
        rho = np.sqrt(1.0 - z * z)
        lattice = self.radius * np.stack((rho * np.cos(angle), rho * np.sin(angle), z), axis=1)
        squares = [np.mean(_field_of_dipoles(positions, moments, point) ** 2) for point in lattice]
        scale = self.sigma / math.sqrt(float(np.mean(squares)))
        object.__setattr__(self, "_positions", positions)
        object.__setattr__(self, "_moments", scale * moments)

    def field_itrf(self, position_itrf: npt.ArrayLike) -> FloatArray:
        """Return the error at a position (3,), m, in ITRF axes, T, shape (3,)."""
        positions: FloatArray = object.__getattribute__(self, "_positions")
        moments: FloatArray = object.__getattribute__(self, "_moments")
        return _field_of_dipoles(positions, moments, np.asarray(position_itrf, dtype=float))


def _field_of_dipoles(positions: FloatArray, moments: FloatArray, point: FloatArray) -> FloatArray:
    """Return the sum of dipole fields at a point, without the constant mu0 / 4 pi."""
    offsets = point - positions
    distances = np.sqrt(np.einsum("ij,ij->i", offsets, offsets))
    along = np.einsum("ij,ij->i", moments, offsets)
    fields = 3.0 * (along / distances**5)[:, None] * offsets - moments / distances[:, None] ** 3
    total: FloatArray = fields.sum(axis=0)
    return total

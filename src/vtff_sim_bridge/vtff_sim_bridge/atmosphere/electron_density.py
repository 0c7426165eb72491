"""Vertical electron-density profiles as frozen tables, and what can be integrated from them.

Every profile, whatever it was built from, is a table of altitudes and densities that is linear in
between and zero outside. Its vertical integrals are therefore exact: no step size is chosen.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU

__all__ = [
    "MOMENT_LENGTH",
    "ElectronDensityProfile",
    "ProfileError",
    "read_profile",
    "write_profile",
]

MOMENT_LENGTH = 1e5
"""Unit of length of the altitude in `ElectronDensityProfile.cumulative_moments`, m."""

_MOMENTS = 4
_ALTITUDE_COLUMNS = {"altitude_m": 1.0, "altitude_km": 1e3, "alt_km": 1e3}


class ProfileError(ValueError):
    """A profile or a profile file cannot be used."""


class ElectronDensityProfile:
    """An electron-density profile, piecewise linear in altitude.

    Parameters
    ----------
    altitude : array_like, shape (n,)
        Altitudes of the table, m, strictly increasing, n >= 2.
    density_per_m3 : array_like, shape (n,)
        Electrons per cubic metre, not negative. Below the first and above the last altitude the
        density is zero.

    Attributes
    ----------
    altitude, density_per_m3 : ndarray, shape (n,)
        The table, read-only.
    altitude_peak : float
        Altitude of the largest density, m.

    Raises
    ------
    ProfileError
        If the table is too short, not increasing, not finite or has a negative density.
    """

    def __init__(self, altitude: npt.ArrayLike, density_per_m3: npt.ArrayLike) -> None:
        self.altitude = np.array(altitude, dtype=float)
        self.density_per_m3 = np.array(density_per_m3, dtype=float)
        _check_table(self.altitude, self.density_per_m3)
        self.altitude.flags.writeable = False
        self.density_per_m3.flags.writeable = False
        self.altitude_peak = float(self.altitude[np.argmax(self.density_per_m3)])
        self._coefficients = self._moment_coefficients()
        self._content = float(self._coefficients[-1, 0, 0])

    @property
    def altitude_bottom(self) -> float:
        """Altitude below which the density is zero, m."""
        return float(self.altitude[0])

    @property
    def altitude_top(self) -> float:
        """Altitude above which the density is zero, m."""
        return float(self.altitude[-1])

    def density(self, altitude: npt.ArrayLike) -> FloatArray:
        """Return the electrons per cubic metre at altitudes (m), in the shape of `altitude`."""
        return np.asarray(
            np.interp(np.asarray(altitude), self.altitude, self.density_per_m3, left=0.0, right=0.0)
        )

    def vtec_above_tecu(self, altitude: npt.ArrayLike) -> FloatArray:
        """Return the vertical TEC above altitudes (m), TECU, in the shape of `altitude`."""
        below = self.cumulative_moments(altitude)[..., 0]
        above: FloatArray = (self._content - below) / ELECTRONS_PER_TECU
        return above

    def mean_density(self, altitude_low: npt.ArrayLike, altitude_high: npt.ArrayLike) -> FloatArray:
        """Return the density averaged between two altitudes (m), electrons per cubic metre.

        This is the truth for an estimate from the TEC difference of two spacecraft.
        """
        low = np.asarray(altitude_low, dtype=float)
        high = np.asarray(altitude_high, dtype=float)
        content = (self.cumulative_moments(high) - self.cumulative_moments(low))[..., 0]
        mean: FloatArray = content / (high - low)
        return mean

    def scaled(self, factor: float) -> ElectronDensityProfile:
        """Return the profile with all densities multiplied by a factor >= 0."""
        return ElectronDensityProfile(self.altitude, factor * self.density_per_m3)

    def cumulative_moments(self, altitude: npt.ArrayLike) -> FloatArray:
        """Return the moments 0 to 3 of the density from the bottom up to altitudes.

        Parameters
        ----------
        altitude : array_like, shape (...)
            Upper limits h of the integrals, m.

        Returns
        -------
        ndarray, shape (..., 4)
            Integral of N(h') ((h' - altitude_peak) / MOMENT_LENGTH)^j dh' for j = 0 ... 3,
            electrons per square metre. Exact for the linear table.
        """
        height = np.asarray(altitude, dtype=float)
        coefficients, powers = _moment_factors(
            np.ascontiguousarray(height).reshape(-1), self.altitude, self._coefficients
        )
        moments: FloatArray = (coefficients @ powers)[..., 0]
        return moments.reshape(*height.shape, _MOMENTS)

    def _moment_coefficients(self) -> FloatArray:
        """Return the polynomials (n, 4, 6) of the cumulative moments above each table altitude.

        The argument is the height above the table altitude in units of MOMENT_LENGTH. The last
        row, of degree 0, holds the moments of the whole profile.
        """
        x = (self.altitude - self.altitude_peak) / MOMENT_LENGTH
        interval = np.diff(x)
        density = self.density_per_m3
        slope = np.diff(density) / interval
        coefficients = np.zeros((len(x), _MOMENTS, _MOMENTS + 2))
        for j in range(_MOMENTS):
            for k in range(j + 1):
                binomial = math.comb(j, k) * x[:-1] ** (j - k) * MOMENT_LENGTH
                coefficients[:-1, j, k + 1] += binomial * density[:-1] / (k + 1)
                coefficients[:-1, j, k + 2] += binomial * slope / (k + 2)
        powers = interval[:, None] ** np.arange(_MOMENTS + 2)
        increments = np.einsum("njk,nk->nj", coefficients[:-1], powers)
        coefficients[1:, :, 0] = np.cumsum(increments, axis=0)
        return coefficients


def _check_table(altitude: FloatArray, density_per_m3: FloatArray) -> None:
    """Raise ProfileError unless the table is one that can be integrated."""
    if altitude.ndim != 1 or altitude.shape != density_per_m3.shape or len(altitude) < 2:
        raise ProfileError(
            "altitude, density_per_m3: two one-dimensional tables of equal length >= 2 are "
            f"required, got shapes {altitude.shape} and {density_per_m3.shape}"
        )
    if not (np.isfinite(altitude).all() and np.isfinite(density_per_m3).all()):
        raise ProfileError("altitude, density_per_m3: values must be finite")
    falling = np.flatnonzero(np.diff(altitude) <= 0.0)
    if falling.size:
        raise ProfileError(
            f"altitude: must increase strictly, got {altitude[falling[0]]:g} then "
            f"{altitude[falling[0] + 1]:g} m"
        )
    negative = np.flatnonzero(density_per_m3 < 0.0)
    if negative.size:
        raise ProfileError(
            f"density_per_m3: must not be negative, got {density_per_m3[negative[0]]:g} at "
            f"{altitude[negative[0]]:g} m"
        )


def read_profile(
    path: str | Path, density_column: str = "density_per_m3"
) -> ElectronDensityProfile:
    """Read a profile from a CSV file with a header line.

    Parameters
    ----------
    path : path-like
        File whose first column is ``altitude_m`` (or ``altitude_km``, ``alt_km``). Lines that
        start with ``#`` and empty lines are skipped.
    density_column : str
        Name of the column of electrons per cubic metre.

    Raises
    ------
    ProfileError
        If the header, a column or a number is wrong; the message names the file and the line.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    with path.open(newline="", encoding="utf-8") as stream:
        numbered = [
            (number, next(csv.reader([line])))
            for number, line in enumerate(stream, start=1)
            if line.strip() and not line.startswith("#")
        ]
    if not numbered:
        raise ProfileError(f"{path}: no header line")
    header = [name.strip() for name in numbered[0][1]]
    if header[0] not in _ALTITUDE_COLUMNS:
        raise ProfileError(
            f"{path}: first column must be one of {', '.join(_ALTITUDE_COLUMNS)}, got {header[0]!r}"
        )
    if density_column not in header[1:]:
        raise ProfileError(
            f"{path}: no column {density_column!r}; there are {', '.join(header[1:])}"
        )
    column = header.index(density_column)
    table = [_table_row(path, number, row, column) for number, row in numbered[1:]]
    values = np.array(table, dtype=float).reshape(-1, 2)
    try:
        return ElectronDensityProfile(values[:, 0] * _ALTITUDE_COLUMNS[header[0]], values[:, 1])
    except ProfileError as error:
        raise ProfileError(f"{path}: {error}") from error


def _table_row(path: Path, number: int, row: list[str], column: int) -> tuple[float, float]:
    """Return altitude and density of one line of a profile file."""
    try:
        return float(row[0]), float(row[column])
    except (ValueError, IndexError) as error:
        raise ProfileError(f"{path}, line {number}: not a row of numbers: {row}") from error


def write_profile(path: str | Path, profile: ElectronDensityProfile, comment: str = "") -> None:
    """Write a profile as the CSV file that `read_profile` reads, with all digits.

    Parameters
    ----------
    path : path-like
        File to write.
    profile : ElectronDensityProfile
        The profile to freeze.
    comment : str
        Description of the profile, written as ``#`` lines in front; may be empty.
    """
    lines = [f"# {line}" for line in comment.splitlines()]
    lines.append("altitude_m,density_per_m3")
    pairs = zip(profile.altitude.tolist(), profile.density_per_m3.tolist(), strict=True)
    lines.extend(f"{altitude!r},{density!r}" for altitude, density in pairs)
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


@compiled
def _moment_factors(height, altitude, coefficients):  # type: ignore[no-untyped-def]
    """Return the polynomials of the moments at heights (n,), and the powers to multiply them with.

    The table has its altitudes and, for each, `coefficients` (4, 6). Shapes (n, 4, 6), (n, 6, 1).
    """
    count, degrees = len(height), coefficients.shape[2]
    chosen = np.empty((count, coefficients.shape[1], degrees))
    powers = np.empty((count, degrees, 1))
    for k in range(count):
        limited = min(max(height[k], altitude[0]), altitude[-1])
        low, high = 0, len(altitude)
        while high - low > 1:
            middle = (low + high) // 2
            if altitude[middle] <= limited:
                low = middle
            else:
                high = middle
        step = (limited - altitude[low]) / MOMENT_LENGTH
        chosen[k] = coefficients[low]
        powers[k, 0, 0] = 1.0
        for power in range(1, degrees):
            powers[k, power, 0] = powers[k, power - 1, 0] * step
    return chosen, powers

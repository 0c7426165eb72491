"""Phase centres of antennas: offsets and variations, as ANTEX files tell them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_LETTERS

__all__ = ["AntexError", "PhaseCentre", "PhaseCentreMap", "antex_frequency", "read_antex"]


class AntexError(ValueError):
    """An ANTEX file that cannot be used; the message names the file, and the line if it has one."""


@dataclass(frozen=True, eq=False)
class PhaseCentreMap:
    """Mean phase centre of one frequency and its variation with the direction.

    Parameters
    ----------
    offset : ndarray, shape (3,)
        From the reference point of the antenna to its mean phase centre along its north, east and
        up axes, m.
    zenith : ndarray, shape (z,)
        Angles from the up axis, rad, rising in equal steps.
    azimuth : ndarray, shape (a,)
        Angles from the north over the east axis, rad, from 0 to 2 pi in equal steps; one value
        where the variation does not depend on them.
    variation : ndarray, shape (a, z)
        m.
    """

    offset: FloatArray
    zenith: FloatArray
    azimuth: FloatArray
    variation: FloatArray

    def delay(self, direction: npt.ArrayLike) -> FloatArray:
        """Return what a range is longer by than that from the reference point, m, shape (...).

        It is the variation less the projection of the offset (Rothacher and Schmid 2010, ANTEX
        1.4); beyond the last zenith angle the variation is that of the last.

        Parameters
        ----------
        direction : array_like, shape (..., 3)
            Unit vectors to satellites along the north, east and up axes of the antenna.
        """
        unit = np.asarray(direction, dtype=float)
        zenith = np.arccos(np.clip(unit[..., 2], -1.0, 1.0))
        row, row_part = _position(self.zenith, zenith)
        if len(self.azimuth) == 1:
            along = self.variation[0]
            variation = (1.0 - row_part) * along[row] + row_part * along[row + 1]
        else:
            azimuth = np.arctan2(unit[..., 1], unit[..., 0]) % (2.0 * np.pi)
            column, column_part = _position(self.azimuth, azimuth)
            below, above = (
                (1.0 - row_part) * self.variation[index, row]
                + row_part * self.variation[index, row + 1]
                for index in (column, column + 1)
            )
            variation = (1.0 - column_part) * below + column_part * above
        return np.asarray(variation - unit @ self.offset)


@dataclass(frozen=True, eq=False)
class PhaseCentre:
    """Phase centres of an antenna: its type, and a map by RINEX frequency, as ``G01``."""

    antenna: str
    maps: dict[str, PhaseCentreMap]


def antex_frequency(system: int, band: int) -> str:
    """Return how ANTEX files call the carrier with a RINEX frequency digit, as ``G01``."""
    return f"{SYSTEM_LETTERS[system]}{band:02d}"


def _position(grid: FloatArray, value: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return the grid point below each value and the part of the way to the next."""
    place = np.clip((value - grid[0]) / (grid[1] - grid[0]), 0.0, len(grid) - 1.0)
    index = np.minimum(place.astype(np.intp), len(grid) - 2)
    return index, place - index


def read_antex(path: str | Path, antenna: str) -> PhaseCentre:
    """Read the phase centres of one receiver antenna from an ANTEX 1.4 file.

    Parameters
    ----------
    path : path-like
    antenna : str
        Type and radome as in the file; the number of spaces between them does not matter.

    Raises
    ------
    AntexError
        If the antenna is not in the file or its entry cannot be read.
    OSError
        If the file cannot be read.
    """
    lines = Path(path).read_text(encoding="ascii", errors="replace").splitlines()
    wanted = antenna.split()
    start = None
    for number, line in enumerate(lines):
        label = line[60:].strip()
        if label == "START OF ANTENNA":
            start = number
        elif label == "TYPE / SERIAL NO" and start is not None and line[:20].split() == wanted:
            return _Entry(path, lines, start).read(" ".join(wanted))
    raise AntexError(f"{path}: there is no antenna {' '.join(wanted)!r}")


class _Entry:
    """Reads the entry of one antenna."""

    def __init__(self, path: str | Path, lines: list[str], start: int) -> None:
        self._path = path
        self._lines = lines
        self._number = start

    def _error(self, problem: str) -> AntexError:
        return AntexError(f"{self._path}, line {self._number + 1}: {problem}")

    def _numbers(self, text: str) -> list[float]:
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            raise self._error(f"numbers expected, got {text.strip()!r}") from None
        if not np.isfinite(values).all():
            raise self._error("finite numbers expected")
        return values

    def _labelled_lines(self) -> Iterator[tuple[str, str]]:
        """Yield content and label of the lines that follow, up to the end of the antenna."""
        while self._number + 1 < len(self._lines):
            self._number += 1
            line = self._lines[self._number]
            label = line[60:].strip()
            if label == "END OF ANTENNA":
                return
            yield line, label
        raise self._error("the file ends within an antenna")

    def read(self, antenna: str) -> PhaseCentre:
        """Return the phase centres of the entry."""
        azimuth_step, zenith = 0.0, np.zeros(0)
        maps: dict[str, PhaseCentreMap] = {}
        lines = self._labelled_lines()
        for line, label in lines:
            if label == "DAZI":
                (azimuth_step,) = self._exactly(1, line[:60])
            elif label == "ZEN1 / ZEN2 / DZEN":
                zenith = self._grid(*self._exactly(3, line[:60]))
            elif label == "START OF FREQUENCY":
                if not len(zenith):
                    raise self._error("ZEN1 / ZEN2 / DZEN is missing before the frequency")
                frequency = line[:60].strip()
                maps[frequency] = self._frequency(lines, azimuth_step, zenith)
        if not maps:
            raise self._error(f"antenna {antenna!r} has no frequency")
        return PhaseCentre(antenna, maps)

    def _exactly(self, count: int, text: str) -> list[float]:
        values = self._numbers(text)
        if len(values) != count:
            raise self._error(f"{count} numbers expected, got {len(values)}")
        return values

    def _grid(self, first: float, last: float, step: float) -> FloatArray:
        """Return angles of a grid given in deg, rad."""
        count = round((last - first) / step) + 1 if step > 0.0 else 0
        if not 2 <= count <= 1000 or abs(first + (count - 1) * step - last) > 1e-6:
            raise self._error(f"no grid goes from {first:g} to {last:g} in steps of {step:g}")
        return np.radians(np.linspace(first, last, count))

    def _frequency(
        self, lines: Iterator[tuple[str, str]], azimuth_step: float, zenith: FloatArray
    ) -> PhaseCentreMap:
        offset: list[float] | None = None
        mean: list[float] | None = None
        rows: list[list[float]] = []
        azimuth = np.zeros(1)
        if azimuth_step > 0.0:
            azimuth = self._grid(0.0, 360.0, azimuth_step)
        for line, label in lines:
            if label == "END OF FREQUENCY":
                break
            if label == "NORTH / EAST / UP":
                offset = self._exactly(3, line[:60])
            elif line.strip().startswith("NOAZI"):
                mean = self._exactly(len(zenith), line.replace("NOAZI", "", 1))
            else:
                rows.append(self._exactly(len(zenith) + 1, line)[1:])
        if offset is None or mean is None:
            raise self._error("the frequency has no NORTH / EAST / UP or no NOAZI")
        if azimuth_step == 0.0:
            rows = [mean]
        if len(rows) != len(azimuth):
            raise self._error(f"{len(azimuth)} azimuths expected, got {len(rows)}")
        return PhaseCentreMap(1e-3 * np.array(offset), zenith, azimuth, 1e-3 * np.array(rows))

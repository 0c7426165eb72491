"""Orbit and clock of satellites from tables of positions, interpolated between their epochs."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import EARTH_ROTATION_RATE_BROADCAST, SYSTEM_LETTERS
from vtff_gnss.orbits.broadcast_orbit import SatelliteStates
from vtff_gnss.orbits.sp3 import Sp3File

__all__ = ["InterpolatedTrack", "InterpolationError", "PreciseOrbits", "PreciseTable"]

_POINTS = 11
"""Epochs of one polynomial; its degree is 10 (Schenewerk 2003)."""
_HALF = _POINTS // 2


class InterpolationError(ValueError):
    """A table of positions is too short or uneven to be interpolated; the text names it."""


@functools.lru_cache(maxsize=_POINTS)
def _coefficients_of_nodes(middle: int) -> FloatArray:
    """Return the matrix from values at the nodes to polynomial coefficients; node `middle` is 0."""
    nodes = np.arange(_POINTS, dtype=float) - middle
    return np.linalg.inv(np.vander(nodes, increasing=True))


class InterpolatedTrack:
    """Positions of m bodies between even epochs, by polynomials of degree 10.

    The polynomials are those of inertial positions: over the hours that they span, the rotation of
    the Earth bends a path in Earth-fixed axes too much.

    Parameters
    ----------
    name : str
        Source, for messages.
    time_nanoseconds : ndarray of int64, shape (n,)
        GPS time, increasing, even up to gaps.
    position_itrf : ndarray, shape (n, m, 3)
        m; NaN where not known.

    Raises
    ------
    InterpolationError
        With fewer than 11 epochs.
    """

    def __init__(
        self, name: str, time_nanoseconds: npt.NDArray[np.int64], position_itrf: FloatArray
    ) -> None:
        if len(time_nanoseconds) < _POINTS:
            raise InterpolationError(
                f"{name}: {len(time_nanoseconds)} epochs; {_POINTS} at least are needed"
            )
        step = int(np.median(np.diff(time_nanoseconds)))
        slot = np.round((time_nanoseconds - time_nanoseconds[0]) / step).astype(np.int64)
        if (
            len(np.unique(slot)) < len(slot)
            or np.abs(time_nanoseconds - time_nanoseconds[0] - slot * step).max() > 0.001 * step
        ):
            raise InterpolationError(f"{name}: epochs are not even steps of {step * 1e-9:g} s")
        self.start = GpsTime(int(time_nanoseconds[0]))
        self.step = step / NANOSECONDS_PER_SECOND
        self.slot = slot
        # Gaps are filled with NaN, so that no polynomial reaches over them.
        even = np.full((int(slot[-1]) + 1, *position_itrf.shape[1:]), np.nan)
        even[slot] = position_itrf
        self._coefficients = self._fit(even)
        self.is_known: npt.NDArray[np.bool_] = np.asarray(
            np.isfinite(self._coefficients).all(axis=(2, 3))
        )

    def __len__(self) -> int:
        """Return the number of even epochs, gaps included."""
        return len(self._coefficients)

    def _fit(self, position: FloatArray) -> FloatArray:
        """Return coefficients, shape (epochs, m, 11, 3); the variable counts steps."""
        count = len(position)
        index = np.arange(count)
        first = np.clip(index - _HALF, 0, max(count - _POINTS, 0))
        middle = index - first
        window = first[:, None] + np.arange(_POINTS)
        # Rotated to the Earth-fixed axes of the epoch of each polynomial.
        steps = (window - index[:, None]).astype(float)
        angle: FloatArray = EARTH_ROTATION_RATE_BROADCAST * self.step * steps
        inertial = _rotate(position[window], angle[..., None])
        matrices = np.array([_coefficients_of_nodes(int(m)) for m in range(_POINTS)])
        return np.asarray(np.einsum("ijk,ikmx->imjx", matrices[middle], inertial))

    def states(
        self, time: GpsTime, offset: npt.ArrayLike, bodies: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions, velocities and accelerations in Earth-fixed axes, (..., k, 3) each.

        Parameters
        ----------
        time : GpsTime
        offset : array_like, shape (..., 1) or (..., k)
            s after `time`.
        bodies : ndarray of int, shape (k,)
        """
        offset = np.asarray(offset, dtype=float)
        shape = np.broadcast_shapes(offset.shape, bodies.shape)
        steps = np.broadcast_to(((time - self.start) + offset) / self.step, shape)
        node = np.clip(np.round(steps).astype(np.int64), 0, len(self) - 1)
        s = (steps - node)[..., None]
        coefficients = self._coefficients[node, np.broadcast_to(bodies, shape)]
        position = np.zeros((*shape, 3))
        velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
        # Horner's scheme with two derivatives.
        for j in range(_POINTS - 1, -1, -1):
            acceleration = acceleration * s + 2.0 * velocity
            velocity = velocity * s + position
            position = position * s + coefficients[..., j, :]
        velocity, acceleration = velocity / self.step, acceleration / self.step**2
        rate = EARTH_ROTATION_RATE_BROADCAST
        angle = -rate * self.step * s[..., 0]
        position, velocity, acceleration = (
            _rotate(vector, angle) for vector in (position, velocity, acceleration)
        )
        spin = np.array([0.0, 0.0, rate])
        velocity_fixed = velocity - np.cross(spin, position)
        acceleration_fixed = (
            acceleration
            - 2.0 * np.cross(spin, velocity_fixed)
            - np.cross(spin, np.cross(spin, position))
        )
        return position, velocity_fixed, acceleration_fixed

    def interpolation_error(self, position_itrf: FloatArray) -> float:
        """Return the RMS error of interpolation, m, from the loss with every second epoch.

        The error of a polynomial of 11 points falls with the 11th power of the step.
        `position_itrf` is the array that the track was made of; NaN with too few epochs.
        """
        if len(self.slot) < 2 * _POINTS + 1 or len(self) != len(self.slot):
            return float("nan")
        times = self.start.nanoseconds + self.slot * round(self.step * NANOSECONDS_PER_SECOND)
        coarse = InterpolatedTrack("", times[::2], position_itrf[::2])
        # Away from the ends, whose polynomials are not centred.
        inner = slice(_POINTS, len(times) - _POINTS if len(times) > 3 * _POINTS else _POINTS + 2, 2)
        offset = (self.slot[inner] * self.step)[:, None]
        bodies = np.arange(position_itrf.shape[1])
        error = coarse.states(self.start, offset, bodies)[0] - position_itrf[inner]
        squared = np.sum(error**2, axis=-1)
        squared = squared[np.isfinite(squared)]
        if not len(squared):
            return float("nan")
        return float(np.sqrt(np.mean(squared))) / 2.0**_POINTS


def _rotate(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """Return vectors (..., 3) turned about the z axis by angles (...), rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return np.stack((cosine * x - sine * y, sine * x + cosine * y, vector[..., 2]), axis=-1)


@dataclass(frozen=True, eq=False)
class _Clocks:
    """Clocks of m satellites at even epochs, s, shape (n, m); NaN where not known."""

    value: FloatArray

    def at(self, steps: FloatArray, column: npt.NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return clocks between epochs, linear, and their change over one step."""
        first = np.clip(np.floor(steps).astype(np.int64), 0, len(self.value) - 2)
        before, after = self.value[first, column], self.value[first + 1, column]
        change = after - before
        return before + (steps - first) * change, change


class PreciseOrbits:
    """Orbits and clocks of an SP3 file or of several that follow one another.

    It answers the same questions as `EphemerisStore`, so that it can stand in its place.

    Parameters
    ----------
    files : sequence of Sp3File
        In any order; of an epoch that is in two files the later file counts.
    needs_clocks : bool
        Whether a satellite is left out while its clock is not known.

    Attributes
    ----------
    systems : tuple of int
        ``SYSTEM_*`` of its satellites.

    Raises
    ------
    InterpolationError
        If the files do not make one even table of 11 epochs.
    """

    def __init__(self, files: Sequence[Sp3File], needs_clocks: bool = False) -> None:
        self._files = tuple(files)
        self.name = ", ".join(file.name for file in files)
        names = sorted({n for file in files for n in file.satellites if n[0] in SYSTEM_LETTERS})
        if not names:
            raise InterpolationError(f"{self.name}: no GNSS satellite in it")
        time, position, clock = _join(files, names)
        self._track = InterpolatedTrack(self.name, time, position)
        self.system = np.array([SYSTEM_LETTERS.index(n[0]) for n in names], dtype=np.uint8)
        self.prn = np.array([int(n[1:]) for n in names], dtype=np.uint8)
        order = np.lexsort((self.prn, self.system))
        self._order = order
        self.systems = tuple(np.unique(self.system).tolist())
        even = np.full((len(self._track), len(names)), np.nan)
        even[self._track.slot] = clock
        self._clocks = _Clocks(even)
        self.start, self.end = GpsTime(int(time[0])), GpsTime(int(time[-1]))
        self.orbit_error = self._track.interpolation_error(position)
        self.clock_error = _clock_error(clock)
        self._tables: dict[bytes, PreciseTable] = {}
        # A satellite is known between two epochs if the polynomials of both are.
        is_known = self._track.is_known
        self._known = is_known[:-1] & is_known[1:]
        if needs_clocks:
            has_clock = np.isfinite(even)
            self._known &= has_clock[:-1] & has_clock[1:]
        changes = np.flatnonzero((self._known[1:] != self._known[:-1]).any(axis=1)) + 1
        self._changes = [self.start + float(index) * self._track.step for index in changes]

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self.prn)

    def with_clocks(self) -> PreciseOrbits:
        """Return the orbits of the satellites while their clocks are known.

        Raises
        ------
        InterpolationError
            If no clock is known.
        """
        orbits = PreciseOrbits(self._files, needs_clocks=True)
        if not orbits._known.any():
            raise InterpolationError(f"{self.name}: no satellite clocks in it")
        return orbits

    def describe(self) -> str:
        """Return span, step and errors of interpolation in one line."""
        clock = (
            f"clocks to {1e9 * self.clock_error:.2f} ns"
            if np.isfinite(self.clock_error)
            else "without clocks"
        )
        orbit = (
            f"orbits interpolated to {1e3 * self.orbit_error:.1g} mm"
            if np.isfinite(self.orbit_error)
            else "too short to tell how well orbits are interpolated"
        )
        span = f"{self.start} to {self.end}, every {self._track.step:g} s"
        return f"{self.name}: {span}, {orbit}, {clock}"

    def table(self, time: GpsTime) -> PreciseTable:
        """Return the satellites whose orbit is known at a time; none outside of the files."""
        steps = (time - self.start) / self._track.step
        # The end itself counts.
        interval = min(int(np.floor(steps)), len(self._known) - 1)
        if steps < 0.0 or time > self.end:
            known = np.zeros(len(self), dtype=bool)
        else:
            known = self._known[interval]
        key = known.tobytes()
        if key not in self._tables:
            rows = self._order[known[self._order]]
            self._tables[key] = PreciseTable(self, rows)
        return self._tables[key]

    def next_change(self, time: GpsTime) -> GpsTime | None:
        """Return until when `table` gives the object of `time`; None if for ever."""
        bounds = [self.start, *self._changes, self.end]
        return next((bound for bound in bounds if bound > time), None)

    def states(
        self, time: GpsTime, offset: npt.ArrayLike, rows: npt.NDArray[np.intp]
    ) -> SatelliteStates:
        """Return states of some satellites; see `PreciseTable.states`."""
        position, velocity, acceleration = self._track.states(time, offset, rows)
        shape = position.shape[:-1]
        steps = np.broadcast_to(
            ((time - self.start) + np.asarray(offset, dtype=float)) / self._track.step, shape
        )
        clock, change = self._clocks.at(steps, np.broadcast_to(rows, shape))
        # Clocks of SP3 lack the periodic relativistic term -2 r v / c2 (Hilla 2016).
        spin = np.array([0.0, 0.0, EARTH_ROTATION_RATE_BROADCAST])
        inertial = velocity + np.cross(spin, position)
        relativity = -2.0 * np.einsum("...i,...i->...", position, inertial) / SPEED_OF_LIGHT**2
        return SatelliteStates(
            position_itrf=position,
            velocity_itrf=velocity,
            acceleration_itrf=acceleration,
            clock_offset=clock + relativity,
            clock_drift=change / self._track.step,
        )


class PreciseTable:
    """Satellites whose orbit is known at a time; used in place of `EphemerisTable`.

    Attributes
    ----------
    system, prn, source : ndarray of uint8, shape (n,)
        `source` is that of no message: 255.
    group_delay, group_delay_secondary : ndarray, shape (n,)
        Zero: the clocks are those of the ionosphere-free pair.
    """

    SOURCE = 255

    def __init__(self, orbits: PreciseOrbits, rows: npt.NDArray[np.intp]) -> None:
        self._orbits = orbits
        self._rows = rows
        self.system, self.prn = orbits.system[rows], orbits.prn[rows]
        self.source = np.full(len(rows), self.SOURCE, dtype=np.uint8)
        self.group_delay = np.zeros(len(rows))
        self.group_delay_secondary = np.zeros(len(rows))

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self._rows)

    def select(self, rows: npt.NDArray[np.intp]) -> PreciseTable:
        """Return a table of some rows."""
        return PreciseTable(self._orbits, self._rows[rows])

    def states(self, time: GpsTime, offset: npt.ArrayLike = 0.0) -> SatelliteStates:
        """Return orbit and clock of all satellites at ``time + offset``.

        Parameters and result are those of `EphemerisTable.states`. The positions are those of the
        centres of mass. A clock that is not known is NaN.
        """
        return self._orbits.states(time, offset, self._rows)


def _join(
    files: Sequence[Sp3File], names: Sequence[str]
) -> tuple[npt.NDArray[np.int64], FloatArray, FloatArray]:
    """Return times, positions and clocks of all files in the order of time."""
    time = np.unique(np.concatenate([file.time_nanoseconds for file in files]))
    position = np.full((len(time), len(names), 3), np.nan)
    clock = np.full((len(time), len(names)), np.nan)
    column = {name: index for index, name in enumerate(names)}
    for file in files:
        rows = np.searchsorted(time, file.time_nanoseconds)
        wanted = [i for i, name in enumerate(file.satellites) if name in column]
        columns = np.array([column[file.satellites[i]] for i in wanted], dtype=np.intp)
        position[rows[:, None], columns] = file.position_itrf[:, wanted]
        clock[rows[:, None], columns] = file.clock_offset[:, wanted]
    return time, position, clock


def _clock_error(clock: FloatArray) -> float:
    """Return the RMS error of linear interpolation, s, as for a clock that walks at random."""
    middle = clock[1:-1] - 0.5 * (clock[2:] + clock[:-2])
    middle = middle[np.isfinite(middle)]
    if not len(middle):
        return float("nan")
    # The walk over half the distance has half the variance.
    return float(np.sqrt(0.5 * np.mean(middle**2)))

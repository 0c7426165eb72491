"""Positions of a moving receiver: from an orbit file, from its own fixes, or from its codes."""

from __future__ import annotations

import contextlib
import math
import pathlib
from collections.abc import Callable, Mapping, Sequence

import brahe.ccsds
import numpy as np
import numpy.typing as npt
from brahe import BraheError
from scipy.interpolate import CubicSpline

from vtff_analysis.tec.errors import TecError
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_gnss.fix import STATUS_NONE, Fix
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.orbits.precise_orbit import InterpolatedTrack, InterpolationError
from vtff_gnss.orbits.satellite_table import SatelliteOrbits
from vtff_gnss.orbits.sp3 import Sp3File, is_sp3, parse_sp3
from vtff_gnss.rinex.compressed_file import read_decompressed
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.signals import satellite_number
from vtff_nav.relative.common.measurements import MeasurementNoise, SignalReader, satellite_mask
from vtff_nav.relative.common.orbit_single_point import (
    SinglePoint,
    form_combinations,
    solve_single_point,
)

__all__ = ["ReceiverOrbit", "open_receiver_orbit", "orbit_from_fixes", "positions_from_codes"]

_BANDS = {SYSTEM_GPS: (1, 2), SYSTEM_GALILEO: (1, 5)}
# s between positions from code. In orbit a cubic spline over two minutes is good to some metres,
# and the motion on the ground is not known.
_INTERVAL_ON_GROUND, _INTERVAL_IN_ORBIT = 30.0, 120.0
_LOWEST_ORBIT_RADIUS = 6.5e6
_ELEVATION_MASK = math.radians(5.0)
_FEWEST_POINTS, _POINTS_WANTED = 4, 20
_EARTH_FIXED_FRAMES = ("ITRF", "ECEF", "WGS84", "IGS")
_INERTIAL_FRAMES = ("GCRF", "ICRF", "EME2000", "J2000")
_OEM_MARK = b"CCSDS_OEM_VERS"


def _fit_spline(seconds: FloatArray, positions: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the cubic spline through positions, shape (n, 3), at increasing times, shape (n,)."""
    spline: Callable[[FloatArray], FloatArray] = CubicSpline(seconds, positions)
    return spline


class ReceiverOrbit:
    """Positions of a receiver over a span of time.

    Parameters
    ----------
    name : str
        Source, for messages.
    time_nanoseconds : ndarray of int64, shape (n,)
        GPS time, increasing.
    position_itrf : ndarray, shape (n, 3)
        m.
    is_noisy : bool
        Whether the positions have noise, which splines do not amplify.

    Raises
    ------
    TecError
        With fewer than four positions.
    """

    def __init__(
        self,
        name: str,
        time_nanoseconds: npt.NDArray[np.int64],
        position_itrf: FloatArray,
        is_noisy: bool = False,
    ) -> None:
        self.name = name
        known = np.isfinite(position_itrf).all(axis=1)
        times, positions = time_nanoseconds[known], position_itrf[known]
        if len(times) < _FEWEST_POINTS:
            raise TecError(f"{name}: {len(times)} positions; {_FEWEST_POINTS} at least are needed")
        self.start, self.end = GpsTime(int(times[0])), GpsTime(int(times[-1]))
        self._times = times
        self._positions = positions
        self._track: InterpolatedTrack | None = None
        if not is_noisy:
            # Uneven or few positions: splines do with any times.
            with contextlib.suppress(InterpolationError):
                self._track = InterpolatedTrack(name, times, positions[:, None, :])
        if self._track is None:
            self._spline = _fit_spline(self._seconds(times), positions)

    def _seconds(self, times: npt.NDArray[np.int64]) -> FloatArray:
        return np.asarray((times - self._times[0]) / NANOSECONDS_PER_SECOND)

    def positions(self, time_nanoseconds: npt.NDArray[np.int64]) -> FloatArray:
        """Return positions at some times, ITRF, m, shape (k, 3); NaN outside of the orbit.

        Raises
        ------
        TecError
            If no time is inside of the orbit.
        """
        inside = (time_nanoseconds >= self._times[0]) & (time_nanoseconds <= self._times[-1])
        if not inside.any():
            first, last = (GpsTime(int(time_nanoseconds[index])) for index in (0, -1))
            raise TecError(
                f"{self.name}: orbit from {self.start} to {self.end}, observations from {first} "
                f"to {last}"
            )
        seconds = self._seconds(time_nanoseconds[inside])
        result = np.full((len(time_nanoseconds), 3), np.nan)
        if self._track is None:
            result[inside] = self._spline(seconds)
        else:
            body = np.zeros(1, dtype=np.intp)
            result[inside] = self._track.states(self.start, seconds[:, None], body)[0][:, 0]
        return result


def open_receiver_orbit(path: pathlib.Path) -> ReceiverOrbit:
    """Read the orbit of a spacecraft from an SP3 or OEM file, told apart by content.

    Raises
    ------
    TecError
        If the file is neither, damaged, or holds several spacecraft.
    OSError
        If the file cannot be read.
    """
    try:
        content = read_decompressed(path)
        if is_sp3(content):
            return _from_sp3(parse_sp3(content, path))
    except RinexError as error:
        raise TecError(str(error)) from None
    if _OEM_MARK in content[:1000]:
        return _from_oem(path, content)
    raise TecError(f"{path}: neither an SP3 nor an OEM file (begins with {content[:16]!r})")


def _from_sp3(file: Sp3File) -> ReceiverOrbit:
    if len(file.satellites) != 1:
        shown = ", ".join(file.satellites[:4])
        raise TecError(
            f"{file.name}: {len(file.satellites)} satellites ({shown}, ...); the orbit of a "
            "receiver is a file of one"
        )
    return ReceiverOrbit(file.name, file.time_nanoseconds, file.position_itrf[:, 0])


def _from_oem(path: pathlib.Path, content: bytes) -> ReceiverOrbit:
    try:
        segments = brahe.ccsds.OEM.from_str(content.decode("ascii", "replace")).segments
        if len({segment.object_id for segment in segments}) != 1:
            raise TecError(f"{path}: OEM of several objects; the orbit of a receiver is one")
        states: dict[int, FloatArray] = {}
        for segment in segments:
            frame = str(segment.ref_frame).upper()
            is_fixed = frame.startswith(_EARTH_FIXED_FRAMES)
            if not is_fixed and frame not in _INERTIAL_FRAMES:
                raise TecError(f"{path}: REF_FRAME {segment.ref_frame} is not known")
            for state in segment.states:
                # A float holds 0.1 microseconds of GPS time.
                time = GpsTime(round(state.epoch.gps_nanoseconds() / 1e3) * 1000)
                vector = np.concatenate((state.position, state.velocity))
                fixed = vector if is_fixed else state_gcrf_to_itrf(time, vector)
                states[time.nanoseconds] = fixed[:3]
    except BraheError as error:  # type: ignore[misc] # untyped, of a compiled module
        raise TecError(f"{path}: {' '.join(str(error).split())}") from None
    times = sorted(states)
    position = np.array([states[time] for time in times]).reshape(-1, 3)
    return ReceiverOrbit(str(path), np.array(times, dtype=np.int64), position)


def orbit_from_fixes(name: str, fixes: Sequence[Fix]) -> ReceiverOrbit | None:
    """Return the track of a receiver's own fixes; None with fewer than four."""
    good = {fix.time.nanoseconds: fix.position for fix in fixes if fix.status != STATUS_NONE}
    if len(good) < _FEWEST_POINTS:
        return None
    times = np.array(sorted(good), dtype=np.int64)
    # One in 30 s: the noise of each would bend a polynomial, and adds nothing to elevations.
    slot = times // round(_INTERVAL_ON_GROUND * NANOSECONDS_PER_SECOND)
    kept = np.append(np.flatnonzero(np.diff(slot, prepend=slot[0] - 1)), len(times) - 1)
    thinned = times[np.unique(kept)]
    if len(thinned) < _FEWEST_POINTS:
        thinned = times
    return ReceiverOrbit(name, thinned, np.array([good[t] for t in thinned.tolist()]), True)


def positions_from_codes(
    table: ObservationTable, orbits: Mapping[int, SatelliteOrbits]
) -> FloatArray:
    """Return the positions of a moving receiver at all epochs, ITRF, m, shape (m, 3).

    Positions from code every 30 s, or every 2 min in orbit, are joined by cubic splines. In orbit
    the noise of the codes, some metres, remains, which is negligible for elevations.

    Parameters
    ----------
    table : ObservationTable
    orbits : mapping of int to SatelliteOrbits
        By ``SYSTEM_*``; the first of GPS and Galileo is used.

    Raises
    ------
    TecError
        If fewer than four epochs give a position.
    """
    system = next((system for system in _BANDS if system in orbits), None)
    if system is None:
        raise TecError("no orbits of GPS or Galileo, from which the receiver is located")
    reader = SignalReader(MeasurementNoise(), {system: _BANDS[system]})
    seconds = 1e-9 * (table.time_nanoseconds - table.time_nanoseconds[0])
    points: list[tuple[float, SinglePoint]] = []
    due, interval = 0.0, _INTERVAL_ON_GROUND
    in_orbit = float(np.clip(seconds[-1] / _POINTS_WANTED, interval, _INTERVAL_IN_ORBIT))
    for index, now in enumerate(seconds.tolist()):
        if now < due and index + 1 < len(table):
            continue
        nearby = points[-1][1].position_itrf if points and now - points[-1][0] < 300.0 else None
        point = _position_from_codes(table, index, orbits[system], reader, nearby)
        if point is None:
            continue
        points.append((now, point))
        is_in_orbit = np.linalg.norm(point.position_itrf) > _LOWEST_ORBIT_RADIUS
        interval = in_orbit if is_in_orbit else _INTERVAL_ON_GROUND
        # On the grid of intervals, so that the epochs do not depend on the first one.
        due = interval * (math.floor(now / interval) + 1)
    if len(points) < _FEWEST_POINTS:
        raise TecError("the position of the receiver is not stated and cannot be computed")
    times = [now for now, _ in points]
    spline = _fit_spline(np.array(times), np.array([point.position_itrf for _, point in points]))
    inside = (seconds >= times[0] - _INTERVAL_ON_GROUND) & (
        seconds <= times[-1] + _INTERVAL_ON_GROUND
    )
    return np.asarray(np.where(inside[:, np.newaxis], spline(seconds), np.nan))


def _position_from_codes(
    table: ObservationTable,
    index: int,
    orbits: SatelliteOrbits,
    reader: SignalReader,
    nearby: FloatArray | None,
) -> SinglePoint | None:
    epoch = table.epoch(index)
    satellites = orbits.table(epoch.time)
    if len(satellites) == 0:
        return None
    has_clock = np.isfinite(satellites.states(epoch.time).clock_offset)
    if not has_clock.all():
        satellites = satellites.select(np.flatnonzero(has_clock))
    with_orbit = satellite_number(satellites.system, satellites.prn)
    signals = reader.read(epoch, satellite_mask(with_orbit))
    if len(signals) == 0:
        return None
    satellites = satellites.select(np.flatnonzero(np.isin(with_orbit, signals.satellite)))
    measured = form_combinations(signals, satellites)
    return solve_single_point(measured, satellites, epoch.time, _ELEVATION_MASK, False, nearby)

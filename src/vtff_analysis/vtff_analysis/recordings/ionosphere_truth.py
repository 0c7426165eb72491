"""True ionosphere of a simulated run: density profile, altitudes, contents, S4."""

from __future__ import annotations

import json
import pathlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.errors import RecordingError
from vtff_analysis.recordings.history import TimeArray, interpolate
from vtff_analysis.recordings.orbits import Orbit, read_orbits
from vtff_analysis.recordings.settings import read_settings
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import RunDescription
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import satellite_number
from vtff_node.executables import ExecutableNotFoundError, share_file
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import GnssConfiguration, load_gnss_configuration
from vtff_sim_bridge.gnss.signal_table import satellite_from_name
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

__all__ = ["Crossing", "IonosphereTruth", "SatelliteTruth", "read_ionosphere_truth"]

GNSS_ARGUMENT = "gnss"
TRUTH_FILE = "gnss_truth.jsonl"

_TRUE_ORBIT = "truth"  # source of an orbit


@dataclass(frozen=True)
class Crossing:
    """A spacecraft crosses an altitude.

    Attributes
    ----------
    time
        ns since 1970.
    vertical_speed
        m/s, positive when rising.
    """

    time: int
    vertical_speed: float


@dataclass(frozen=True, eq=False)
class SatelliteTruth:
    """True content and S4 of the rays to one receiver, as columns of equal length.

    Attributes
    ----------
    time
        ns since 1970.
    satellite
        `vtff_gnss.signals.satellite_number`.
    stec_tecu, s4
        Slant content of the ray, and amplitude scintillation of L1.
    """

    time: TimeArray
    satellite: npt.NDArray[np.int64]
    stec_tecu: FloatArray
    s4: FloatArray


@dataclass(frozen=True, eq=False)
class IonosphereTruth:
    """True ionosphere and true positions of the spacecraft of a run.

    Attributes
    ----------
    profile
        Vertical density that the receivers saw.
    time, altitude
        ns since 1970 and m above the ellipsoid by spacecraft, shape (n,).
    latitude_deg, longitude_deg
        Geodetic position by spacecraft, shape (n,).
    regions
        Irregularity regions.
    satellites
        Rays by receiver; empty where the run folder has no truth file.
    """

    profile: ElectronDensityProfile
    time: dict[str, TimeArray]
    altitude: dict[str, FloatArray]
    latitude_deg: dict[str, FloatArray]
    longitude_deg: dict[str, FloatArray]
    regions: tuple[IrregularityRegion, ...] = ()
    satellites: dict[str, SatelliteTruth] = field(default_factory=dict)

    @property
    def region_altitudes(self) -> tuple[float, float] | None:
        """Lower and upper edge of the irregularity regions, m; None without regions."""
        if not self.regions:
            return None
        return (
            min(region.altitude_bottom for region in self.regions),
            max(region.altitude_top for region in self.regions),
        )

    def altitude_at(self, craft: str, time: npt.ArrayLike) -> FloatArray:
        """Return the altitude of a spacecraft at times (ns since 1970), m; NaN outside the run."""
        return self._interpolate(craft, time, self.altitude[craft])

    def separation_at(self, chief: str, deputy: str, time: npt.ArrayLike) -> FloatArray:
        """Return the altitude of the deputy less that of the chief, m."""
        return self.altitude_at(deputy, time) - self.altitude_at(chief, time)

    def place_at(self, craft: str, time: int) -> tuple[float, float]:
        """Return latitude and longitude at a time (ns since 1970), deg."""
        east = np.unwrap(np.radians(self.longitude_deg[craft]))
        longitude = float(np.degrees(self._interpolate(craft, time, east)))
        latitude = float(self._interpolate(craft, time, self.latitude_deg[craft]))
        return latitude, (longitude + 180.0) % 360.0 - 180.0

    def mean_density(self, chief: str, deputy: str, time: npt.ArrayLike) -> FloatArray:
        """Return the density averaged between two spacecraft, electrons per cubic metre."""
        altitudes = self.altitude_at(chief, time), self.altitude_at(deputy, time)
        return self.profile.mean_density(np.minimum(*altitudes), np.maximum(*altitudes))

    def crossings(self, craft: str, altitude: float) -> list[Crossing]:
        """Return the crossings of an altitude (m) by a spacecraft, in the order of time."""
        time, height = self.time[craft], self.altitude[craft] - altitude
        before = np.flatnonzero(np.diff(height > 0.0))
        step = np.diff(time)[before] / NANOSECONDS_PER_SECOND
        speed = np.diff(height)[before] / step
        return [
            Crossing(int(time[i] - height[i] / v * NANOSECONDS_PER_SECOND), float(v))
            for i, v in zip(before, speed, strict=True)
        ]

    def _interpolate(self, craft: str, time: npt.ArrayLike, values: FloatArray) -> FloatArray:
        return interpolate(time, self.time[craft], values, outside=np.nan)


def _simulated_gnss(described: RunDescription) -> GnssConfiguration | None:
    """Return the configuration of the simulated receivers of a run.

    Parameters
    ----------
    described
        The run; its argument ``gnss`` names the file of the GNSS simulator. It is looked for
        under that path and among the installed files.

    Returns
    -------
    GnssConfiguration or None
        None where the run names no file, or the file is not on this machine or cannot be read.
    """
    named = described.arguments.get(GNSS_ARGUMENT)
    if not named:
        return None
    path = pathlib.Path(str(named))
    if not path.is_file() and path.parent.name == "gnss":
        try:
            path = share_file("vtff_bringup", f"config/gnss/{path.name}")
        except ExecutableNotFoundError:
            return None
    try:
        return load_gnss_configuration(path, read_settings(described).seed)
    except (ScenarioError, OSError):
        return None


def read_ionosphere_truth(
    reader: BagReader, described: RunDescription, run_folder: pathlib.Path | None = None
) -> IonosphereTruth | None:
    """Return the true ionosphere of a simulated run.

    Parameters
    ----------
    reader
        The bag of the run, with <craft>/truth/orbit.
    described
        The run.
    run_folder
        Folder with ``gnss_truth.jsonl``; without it contents and S4 of the rays are missing.

    Returns
    -------
    IonosphereTruth or None
        None where the profile or the true orbits are not recorded.
    """
    simulated = _simulated_gnss(described)
    if simulated is None or simulated.profile is None:
        return None
    try:
        orbits = [orbit for orbit in read_orbits(reader) if orbit.source == _TRUE_ORBIT]
    except RecordingError:
        return None
    if not orbits:
        return None
    geodetic = {orbit.name: geodetic_from_itrf(orbit.state_itrf[:, :3]) for orbit in orbits}
    times = {orbit.name: _unix_nanoseconds(orbit) for orbit in orbits}
    start = min(time[0] for time in times.values())
    file = None if run_folder is None else run_folder / TRUTH_FILE
    return IonosphereTruth(
        profile=simulated.profile,
        time=times,
        altitude={name: position[:, 2] for name, position in geodetic.items()},
        latitude_deg={name: np.degrees(position[:, 0]) for name, position in geodetic.items()},
        longitude_deg={name: np.degrees(position[:, 1]) for name, position in geodetic.items()},
        regions=simulated.regions,
        satellites={} if file is None or not file.is_file() else _read_satellites(file, int(start)),
    )


def _unix_nanoseconds(orbit: Orbit) -> TimeArray:
    return np.array([time.to_unix_nanoseconds() for time in orbit.time], dtype=np.int64)


def _read_satellites(file: pathlib.Path, start: int) -> dict[str, SatelliteTruth]:
    """Read the seconds of a truth file up to its end, or up to a line that was cut off."""
    columns: dict[str, list[list[Any]]] = {}
    with file.open(encoding="utf-8") as lines:
        for line in lines:
            if not line.startswith('{"record":"second"'):
                continue
            try:
                record = json.loads(line)
            except ValueError:
                break
            names = record["satellites"]
            times, satellites, contents, indices = columns.setdefault(
                record["receiver"], [[], [], [], []]
            )
            times += [start + record["time"] * NANOSECONDS_PER_SECOND] * len(names)
            satellites += [int(satellite_number(*satellite_from_name(name))) for name in names]
            contents += record["slant_tec_tecu"]
            indices += record["s4_l1"]
    return {
        name: SatelliteTruth(
            np.array(time, dtype=np.int64), np.array(satellite), np.array(stec), np.array(s4)
        )
        for name, (time, satellite, stec, s4) in columns.items()
    }

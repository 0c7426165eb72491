"""Topics of a run beside formation and receivers: ionosphere, health, timing."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from vtff_analysis.recordings.history import (
    Boundary,
    DensityHistory,
    HealthItem,
    PairIonosphere,
    SatelliteColumns,
)
from vtff_analysis.recordings.topics import DEPUTY
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.msg import IrregularityBoundary
from vtff_node.stamps import to_nanoseconds
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC
from vtff_node.step_moments import COMMAND_SENT, SECOND_RECEIVED, read_moments

STEP_TOPIC = "/sim/step_done"

_SLANT_TEC = re.compile(r"/(?:iono/slant_tec|gnss/ism/slant_tec|differential_tec)$")
_SCINTILLATION = re.compile(r"/(?:iono|gnss/ism)/scintillation$")
_DENSITY = re.compile(r"/electron_density$")
_BOUNDARY = re.compile(r"boundar")

_SLANT_TEC_COLUMNS = (
    "stec_tecu",
    "stec_sigma_tecu",
    "vtec_tecu",
    "elevation",
    "azimuth",
    "band_first",
    "band_second",
    "rejected",
)
_SATELLITE_DENSITY_COLUMNS = ("density", "density_sigma", "altitude")
_SCINTILLATION_COLUMNS = (
    "band",
    "attribute",
    "s4",
    "s4_corrected",
    "sigma_phi",
    "roti_tecu_per_minute",
    "cn0_dbhz",
    "elevation",
    "azimuth",
)

_KINDS = {
    IrregularityBoundary.KIND_VERTICAL: "vertical",
    IrregularityBoundary.KIND_HORIZONTAL: "horizontal",
}
_SOURCES = {
    IrregularityBoundary.SOURCE_DENSITY: "density",
    IrregularityBoundary.SOURCE_S4: "S4",
    IrregularityBoundary.SOURCE_ROTI: "ROTI",
    IrregularityBoundary.SOURCE_TEC_GRADIENT: "TEC gradient",
}

_LEVELS = 4  # diagnostic_msgs/DiagnosticStatus: OK, WARN, ERROR, STALE

Handler = Callable[[Any], None]


class _Columns:
    """Collects messages of columns, and joins their columns."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._times: list[Any] = []
        self._columns: dict[str, list[Any]] = {name: [] for name in ("system", "prn", *names)}

    def add(self, message: Any) -> None:
        count = len(message.system)
        self._times.append(np.full(count, to_nanoseconds(message.header.stamp), dtype=np.int64))
        for name, collected in self._columns.items():
            column = np.asarray(getattr(message, name))
            if column.ndim == 0:
                column = np.full(count, column)  # one value that holds for all rows
            # A message of another program may leave columns out.
            collected.append(column if len(column) == count else np.full(count, np.nan))

    def columns(self) -> SatelliteColumns:
        joined = {
            name: np.concatenate([np.empty(0), *collected])
            for name, collected in self._columns.items()
        }
        return SatelliteColumns(
            time=np.concatenate([np.empty(0, np.int64), *self._times]),
            system=joined.pop("system").astype(np.uint8),
            prn=joined.pop("prn").astype(np.uint8),
            values={name: column.astype(float) for name, column in joined.items()},
        )


class _Pair:
    """Collects the ionosphere between the chief and one deputy."""

    def __init__(self) -> None:
        self._boundaries: list[Boundary] = []
        self._density: list[tuple[float, ...]] = []
        self._density_time: list[int] = []
        self._satellite_density = _Columns(_SATELLITE_DENSITY_COLUMNS)

    def add_density(self, message: Any) -> None:
        self._satellite_density.add(message)
        # The last row combines all satellites.
        if len(message.density) and math.isfinite(message.density[-1]):
            self._density_time.append(to_nanoseconds(message.header.stamp))
            self._density.append(
                (
                    message.altitude,
                    message.vertical_separation,
                    message.density[-1],
                    message.density_sigma[-1],
                    *message.position,
                )
            )

    def add_boundary(self, message: Any) -> None:
        self._boundaries.append(
            Boundary(
                time=to_nanoseconds(message.header.stamp),
                kind=_KINDS.get(message.kind, str(message.kind)),
                source=_SOURCES.get(message.source, str(message.source)),
                entry=bool(message.entry),
                spacecraft=message.spacecraft,
                system=message.system,
                prn=message.prn,
                latitude_deg=message.latitude_deg,
                longitude_deg=message.longitude_deg,
                altitude=message.altitude,
                width=message.width,
                width_sigma=message.width_sigma,
            )
        )

    def ionosphere(self) -> PairIonosphere:
        return PairIonosphere(
            self._density_history(), self._satellite_columns(), tuple(self._boundaries)
        )

    def _density_history(self) -> DensityHistory | None:
        if not self._density:
            return None
        altitude, separation, density, sigma, *position = np.array(self._density).T
        geodetic = np.degrees(geodetic_from_itrf(np.stack(position, axis=-1))[:, :2])
        return DensityHistory(
            time=np.array(self._density_time, dtype=np.int64),
            altitude=altitude,
            separation=separation,
            latitude_deg=geodetic[:, 0],
            longitude_deg=geodetic[:, 1],
            density=density,
            sigma=sigma,
        )

    def _satellite_columns(self) -> SatelliteColumns | None:
        columns = self._satellite_density.columns()
        kept = (columns.prn > 0) & np.isfinite(columns.values["density"])
        if not kept.any():
            return None
        values = {name: column[kept] for name, column in columns.values.items()}
        return SatelliteColumns(columns.time[kept], columns.system[kept], columns.prn[kept], values)


class _Health:
    """Collects the reports of one name on /diagnostics."""

    def __init__(self) -> None:
        self.counts = [0] * _LEVELS
        self.changes: list[tuple[int, str]] = []
        self.last: Any = None
        self._state: tuple[int, str] = (0, "")

    def add(self, time: int, status: Any) -> None:
        level = min(_level(status), _LEVELS - 1)
        self.counts[level] += 1
        if level and (level, status.message) != self._state:
            if len(self.changes) < HealthItem.LONGEST_CHANGES:
                self.changes.append((time, status.message))
        self._state = (level, status.message)
        self.last = status


def _level(status: Any) -> int:
    """Return the level of a report as a number: rclpy gives a byte as bytes of length one."""
    level = status.level
    return int.from_bytes(level, "little") if isinstance(level, bytes) else int(level)


class _LatencyCollector:
    """Collects when the last bytes of seconds were read and when commands were on their bus."""

    def __init__(self) -> None:
        self._received: dict[tuple[str, int], float] = {}
        self._sent: dict[str, dict[tuple[str, int], float]] = {}

    def add(self, status: Any) -> None:
        for pair in status.values:
            if pair.key == SECOND_RECEIVED:
                for step, moment in read_moments(pair.value).items():
                    # A command needs the bytes of both receivers: the later one counts.
                    self._received[step] = max(moment, self._received.get(step, moment))
            elif pair.key == COMMAND_SENT:
                self._sent.setdefault(status.hardware_id, {}).update(read_moments(pair.value))

    def latency(self) -> dict[str, FloatArray]:
        latency = {
            thruster: np.array(
                [sent[step] - self._received[step] for step in sorted(sent.keys() & self._received)]
            )
            for thruster, sent in sorted(self._sent.items())
        }
        return {thruster: values for thruster, values in latency.items() if values.size}


class DetailCollector:
    """Sorts the messages of ionosphere, health and timing while the bag is read."""

    def __init__(self) -> None:
        self._pairs: dict[str, _Pair] = {}
        self._slant_tec: dict[str, _Columns] = {}
        self._scintillation: dict[str, _Columns] = {}
        self._health: dict[str, _Health] = {}
        self._compute_time: dict[str, list[float]] = {}
        self._latency = _LatencyCollector()

    def handler(self, topic: str) -> Handler | None:
        """Return the function that takes the messages of a topic; None for an unused topic."""
        if topic == STEP_TOPIC:
            return self._add_step
        if topic == DIAGNOSTICS_TOPIC:
            return self._add_diagnostics
        if _SLANT_TEC.search(topic):
            return self._slant_tec.setdefault(topic, _Columns(_SLANT_TEC_COLUMNS)).add
        if _SCINTILLATION.search(topic):
            return self._scintillation.setdefault(topic, _Columns(_SCINTILLATION_COLUMNS)).add
        if _DENSITY.search(topic):
            return lambda message: self._pair(message).add_density(message)
        if _BOUNDARY.search(topic):
            return lambda message: self._pair(message).add_boundary(message)
        return None

    def slant_tec(self) -> dict[str, SatelliteColumns]:
        """Return slant TEC by topic, of topics that have any."""
        return _join_topics(self._slant_tec)

    def scintillation(self) -> dict[str, SatelliteColumns]:
        """Return scintillation indices by topic, of topics that have any."""
        return _join_topics(self._scintillation)

    def pairs(self) -> dict[str, PairIonosphere]:
        """Return the ionosphere of the chief with each deputy, by the deputy's name."""
        return {name: pair.ionosphere() for name, pair in sorted(self._pairs.items())}

    def health(self) -> tuple[HealthItem, ...]:
        """Return the reports on /diagnostics in the order of their names."""
        return tuple(
            HealthItem(
                name=name,
                hardware_id=reports.last.hardware_id,
                counts=tuple(reports.counts),
                changes=tuple(reports.changes),
                level=min(_level(reports.last), _LEVELS - 1),
                message=reports.last.message,
                values={pair.key: pair.value for pair in reports.last.values},
            )
            for name, reports in sorted(self._health.items())
        )

    def compute_time(self) -> dict[str, FloatArray]:
        """Return the wall time of each acknowledged step in s, by node."""
        return {node: np.array(times) for node, times in sorted(self._compute_time.items())}

    def command_latency(self) -> dict[str, FloatArray]:
        """Return the wall time from the last byte of a second to its command, s, by thruster."""
        return self._latency.latency()

    def _add_step(self, message: Any) -> None:
        self._compute_time.setdefault(message.node, []).append(message.compute_time)

    def _add_diagnostics(self, message: Any) -> None:
        time = to_nanoseconds(message.header.stamp)
        for status in message.status:
            # Two spacecraft may have nodes of the same name.
            name = f"{status.name} ({status.hardware_id})" if status.hardware_id else status.name
            self._health_of(name).add(time, status)
            self._latency.add(status)

    def _health_of(self, name: str) -> _Health:
        """Return the reports of a name, and take over those from before its device was known.

        A receiver is its port at first, and its port with a serial number once it has answered.
        """
        if name not in self._health:
            earlier = [key for key in self._health if name.startswith(f"{key.removesuffix(')')} ")]
            self._health[name] = self._health.pop(earlier[0]) if earlier else _Health()
        return self._health[name]

    def _pair(self, message: Any) -> _Pair:
        # Another program may leave the name out.
        return self._pairs.setdefault(message.child_frame_id or DEPUTY, _Pair())


def _join_topics(collected: dict[str, _Columns]) -> dict[str, SatelliteColumns]:
    """Return the columns of each topic that has any rows."""
    joined = {topic: columns.columns() for topic, columns in sorted(collected.items())}
    return {topic: columns for topic, columns in joined.items() if columns.time.size}

"""Scene of the viewer: a recorded or live run as named series that become JSON.

All positions are in ITRF, so that the page needs no Earth rotation; times are s after the start of
the scene. A series grows only at its end, so that a live page gets just the new samples.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

SCENE_VERSION = 2

#: Columns of each kind of series, with the decimals that are sent.
COLUMNS: dict[str, dict[str, int]] = {
    "orbit": {"x": 1, "y": 1, "z": 1, "vx": 3, "vy": 3, "vz": 3},
    "satellite": {"x": 0, "y": 0, "z": 0},
    "link": {"cn0_dbhz": 1},
    "pierce": {"latitude_deg": 4, "longitude_deg": 4, "stec_tecu": 3, "vtec_tecu": 3},
    "relative": {"radial": 7, "in_track": 7, "cross_track": 7},
    "covariance": {"rr": 14, "rt": 14, "rn": 14, "tt": 14, "tn": 14, "nn": 14},
    "solution": {"solution": 0},
    "thrust": {"radial": 9, "in_track": 9, "cross_track": 9},
    "scintillation": {"s4": 4, "sigma_phi": 4},
    "density": {"latitude_deg": 4, "longitude_deg": 4, "altitude": 0, "per_cm3": 1, "sigma": 1},
    "boundary": {"latitude_deg": 4, "longitude_deg": 4, "altitude": 0, "entry": 0},
    "wall": {"longitude_deg": 4, "rate_deg": 8, "sigma_deg": 4},
    "safety": {"mode": 0, "isolated_axes": 0},
    "attitude": {
        **{"qx": 6, "qy": 6, "qz": 6, "qw": 6},
        **{"roll_deg": 4, "pitch_deg": 4, "yaw_deg": 4},
        **{"rate_x_deg": 5, "rate_y_deg": 5, "rate_z_deg": 5},
        **{"field_radial": 4, "field_in_track": 4, "field_cross_track": 4, "wheel_rpm": 1},
    },
}
_TIME_DECIMALS = 3
_TIME_TOLERANCE = 1e-6  # s


@dataclasses.dataclass
class Series:
    """Values over time.

    Attributes
    ----------
    kind
        A key of `COLUMNS`.
    labels
        What the values belong to, by ``craft``, ``satellite``, ``source``, ``deputy``.
    time
        s after the start of the scene, increasing.
    values
        One list for each column of the kind, as long as `time`; in m, m/s, m/s2 or the unit in the
        name of the column. Relative positions, their covariance (m2) and thrust are in the RTN axes
        of the chief; a density has its sigma in the same unit. An attitude is the rotation from the
        body to the RTN axes of the spacecraft itself (qx, qy, qz, qw), with the angles to the orbit
        axes, the rates against GCRF in body axes (deg/s), the direction of the magnetic field in
        RTN (NaN where IGRF does not cover the time), and the speed of the wheel. A wall of plasma
        that a survey knows drifts with its rate, deg/s; its source is its number.
    """

    kind: str
    labels: dict[str, str]
    time: list[float] = dataclasses.field(default_factory=list)
    values: list[list[float]] = dataclasses.field(default_factory=list)

    def __post_init__(self) -> None:
        """Begin with empty columns."""
        self.values = self.values or [[] for _ in COLUMNS[self.kind]]

    @property
    def name(self) -> str:
        """Name within the scene, for example ``link/chief/G05``."""
        return "/".join((self.kind, *self.labels.values()))

    def at(self, time: float, hold: float = math.inf) -> dict[str, float] | None:
        """Return the newest sample at a time, by column.

        Parameters
        ----------
        time
            s after the start of the scene.
        hold
            Age in s from which a sample no longer counts.

        Returns
        -------
        dict or None
            None before the first sample, or if the newest is too old.
        """
        index = bisect.bisect_right(self.time, time + _TIME_TOLERANCE) - 1
        if index < 0 or time - self.time[index] > hold:
            return None
        columns = zip(COLUMNS[self.kind], self.values, strict=True)
        return {name: column[index] for name, column in columns}

    def as_json(self, first: int = 0) -> dict[str, Any]:
        """Return the samples from `first` on; numbers that are not finite become None."""
        decimals = COLUMNS[self.kind].values()
        columns = {
            name: [_round_finite(value, places) for value in column[first:]]
            for name, places, column in zip(COLUMNS[self.kind], decimals, self.values, strict=True)
        }
        time = [round(value, _TIME_DECIMALS) for value in self.time[first:]]
        return {"name": self.name, "kind": self.kind, **self.labels, "time": time, **columns}


def _round_finite(value: float, places: int) -> float | None:
    return round(float(value), places) if math.isfinite(value) else None


@dataclasses.dataclass(frozen=True)
class Region:
    """A cell of ionospheric irregularities that stands still relative to the Sun.

    Attributes
    ----------
    name
        Name in the simulator's configuration.
    latitude_south_deg, latitude_north_deg
        Geodetic latitudes of the sides, deg.
    longitude_west_deg, width_deg
        Western side at the start of the scene and extent to the east, deg.
    longitude_rate_deg
        Motion of its sides, deg/s; negative is westward.
    altitude_bottom, altitude_top
        Altitudes of the edges in m above the ellipsoid.
    s4
        Amplitude scintillation of rays on GPS L1 that cross the region.
    """

    name: str
    latitude_south_deg: float
    latitude_north_deg: float
    longitude_west_deg: float
    width_deg: float
    longitude_rate_deg: float
    altitude_bottom: float
    altitude_top: float
    s4: float


@dataclasses.dataclass(frozen=True)
class Event:
    """A thing that happened at a time, as a mark of the timeline.

    Attributes
    ----------
    time
        s after the start of the scene.
    kind
        ``manoeuvre``, ``solution`` (navigation lost its fix or has it again), ``edge``, ``survey``
        (a plan or another phase), ``safety`` or ``fault``.
    text
        One line for the user.
    """

    time: float
    kind: str
    text: str


@dataclasses.dataclass
class Scene:
    """A run in the form that the page shows.

    Attributes
    ----------
    name
        Name of the run.
    start
        ns since 1970 of time 0, in the scale of the ROS stamps; 0 until the first message.
    duration
        s from the start to the newest sample, or to the end of a bag.
    live
        Whether the scene still grows.
    regions
        Irregularities of the simulated ionosphere.
    notes
        One line for each thing that is missing or could not be read.
    events
        What happened, in the order in which it was seen; without manoeuvres, which `all_events`
        finds in the series of thrust.
    hard_radius
        Distance in m below which no pair of spacecraft may come; 0 if nothing says it.
    dip_equator
        Longitude and latitude, deg, of points where the magnetic field of the Earth is level.
    beside
        A second run to compare with.
    """

    name: str
    start: int = 0
    duration: float = 0.0
    live: bool = False
    regions: tuple[Region, ...] = ()
    notes: list[str] = dataclasses.field(default_factory=list)
    events: list[Event] = dataclasses.field(default_factory=list)
    hard_radius: float = 0.0
    dip_equator: list[list[float]] = dataclasses.field(default_factory=list)
    beside: Scene | None = None
    series: dict[str, Series] = dataclasses.field(default_factory=dict)

    def add(self, kind: str, stamp: int, row: Sequence[float], **labels: str) -> None:
        """Append a sample to a series; a sample that is not after the newest is left out.

        Parameters
        ----------
        kind
            A key of `COLUMNS`.
        stamp
            ns since 1970.
        row
            One value for each column.
        labels
            Labels of the series.

        Raises
        ------
        ValueError
            If the row has another number of values than columns.
        """
        if len(row) != len(COLUMNS[kind]):
            raise ValueError(f"a sample of '{kind}' has {len(COLUMNS[kind])} values: {row}")
        name = "/".join((kind, *labels.values()))
        series = self.series.get(name)
        if series is None:
            series = self.series[name] = Series(kind, labels)
        time = self.seconds(stamp)
        if series.time and time <= series.time[-1]:
            return
        series.time.append(time)
        for column, value in zip(series.values, row, strict=True):
            column.append(value)

    def note_event(self, stamp: int, kind: str, text: str) -> None:
        """Add an event at a time, ns since 1970."""
        self.events.append(Event(round(self.seconds(stamp), _TIME_DECIMALS), kind, text))

    def seconds(self, stamp: int) -> float:
        """Return the time of a stamp (ns since 1970) in s after the start."""
        return (stamp - self.start) / NANOSECONDS_PER_SECOND

    def of_kind(self, kind: str) -> list[Series]:
        """Return the series of a kind in the order of their names."""
        return [self.series[name] for name in sorted(self.series) if name.startswith(f"{kind}/")]

    def as_json(self, sent: Mapping[str, int] | None = None) -> dict[str, Any]:
        """Return the scene with the samples that the page does not have yet.

        Parameters
        ----------
        sent
            Number of samples of each series that the page has; none if it is not given.
        """
        counts = sent or {}
        beside = {} if self.beside is None else {"beside": self.beside.as_json()}
        return {
            **beside,
            "version": SCENE_VERSION,
            "name": self.name,
            "start_unix": self.start / NANOSECONDS_PER_SECOND,
            "duration": round(self.duration, _TIME_DECIMALS),
            "live": self.live,
            "regions": [dataclasses.asdict(region) for region in self.regions],
            "notes": list(self.notes),
            "hard_radius": self.hard_radius,
            "dip_equator": self.dip_equator,
            "events": [dataclasses.asdict(event) for event in all_events(self)],
            "series": [
                series.as_json(counts.get(name, 0))
                for name, series in sorted(self.series.items())
                if len(series.time) > counts.get(name, 0)
            ],
        }

    def counts(self) -> dict[str, int]:
        """Return the number of samples by series, which `as_json` takes as `sent`."""
        return {name: len(series.time) for name, series in self.series.items()}


#: A manoeuvre is thrust above this share of the largest thrust of the spacecraft in the scene; it
#: ends with a pause of this length, s.
_MANOEUVRE_SHARE, _MANOEUVRE_PAUSE = 0.1, 30.0


def find_manoeuvres(series: Series) -> list[Event]:
    """Return the manoeuvres in a series of thrust: begin, length and velocity change.

    Parameters
    ----------
    series
        Accelerations of a thruster, m/s2; each holds until the next sample.
    """
    sizes = [math.hypot(*row) for row in zip(*series.values, strict=True)]
    largest = max(sizes, default=0.0)
    burning = [
        index
        for index, size in enumerate(sizes)
        if largest > 0.0 and size > _MANOEUVRE_SHARE * largest
    ]
    groups: list[list[int]] = []
    for index in burning:
        if groups and series.time[index] - series.time[groups[-1][-1]] <= _MANOEUVRE_PAUSE:
            groups[-1].append(index)
        else:
            groups.append([index])
    events = []
    for group in groups:
        first, last = group[0], min(group[-1] + 1, len(sizes) - 1)
        change = sum(
            sizes[index] * (series.time[index + 1] - series.time[index])
            for index in range(first, last)
        )
        text = (
            f"{series.labels['deputy']}: thrust for "
            f"{series.time[last] - series.time[first]:.0f} s, {change:.3g} m/s"
        )
        events.append(Event(series.time[first], "manoeuvre", text))
    return events


def all_events(scene: Scene) -> list[Event]:
    """Return the events of a scene with the manoeuvres of every thruster, in order of time."""
    thrusts = scene.of_kind("thrust")
    applied = [series for series in thrusts if series.labels["source"] == "applied"]
    manoeuvres = [event for series in applied for event in find_manoeuvres(series)]
    return sorted([*scene.events, *manoeuvres], key=lambda event: event.time)

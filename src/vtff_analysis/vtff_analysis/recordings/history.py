"""What a run recorded, as arrays. Times are ns since 1970 in the scale of the ROS header stamps."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from vtff_gnss.ephemeris import BroadcastEphemeris

FloatArray = npt.NDArray[np.float64]
TimeArray = npt.NDArray[np.int64]

AXES = ("radial", "in_track", "cross_track")
"""Names of the RTN axes R, T, N in keys, in the order of the array columns."""


@dataclass(frozen=True, eq=False)
class RelativeStateHistory:
    """Relative states of one deputy from one source.

    Attributes
    ----------
    time
        Time of validity in ns since 1970, shape (n,).
    position_rtn
        Position relative to the chief in m, shape (n, 3).
    velocity_rtn
        Rotating-frame velocity relative to the chief in m/s, shape (n, 3).
    """

    time: TimeArray
    position_rtn: FloatArray
    velocity_rtn: FloatArray


@dataclass(frozen=True, eq=False)
class NavigationHistory:
    """What navigation says of its own solution, for each usable estimate.

    Attributes
    ----------
    time
        ns since 1970, shape (n,).
    position_sigma_rtn, velocity_sigma_rtn
        One sigma in m and m/s, shape (n, 3); zero where none was given.
    solution
        ``vtff_msgs/RelativeState.SOLUTION_*``, shape (n,).
    satellites_used, ambiguities_fixed
        Shape (n,).
    ratio
        Ratio of the ambiguity test, shape (n,); 0 where not tested.
    innovation_rms
        In units of its predicted sigma, shape (n,).
    """

    time: TimeArray
    position_sigma_rtn: FloatArray
    velocity_sigma_rtn: FloatArray
    solution: npt.NDArray[np.uint8]
    satellites_used: npt.NDArray[np.uint8]
    ambiguities_fixed: npt.NDArray[np.uint16]
    ratio: FloatArray
    innovation_rms: FloatArray


@dataclass(frozen=True, eq=False)
class AccelerationHistory:
    """Commanded or applied accelerations of one deputy.

    Attributes
    ----------
    time
        Start of each application in ns since 1970, shape (n,).
    acceleration_rtn
        m/s2, shape (n, 3).
    """

    time: TimeArray
    acceleration_rtn: FloatArray


@dataclass(frozen=True, eq=False)
class DeputyHistory:
    """Everything about one deputy; None where the bag has nothing.

    Attributes
    ----------
    name
        Name of the spacecraft.
    truth
        True relative state.
    estimate
        Relative state from navigation.
    command
        Thrust as commanded.
    applied
        Thrust as applied; each acceleration acts for one step from its time on.
    target
        Targets published during the run, each in force from its time on.
    navigation
        What navigation says of its solution, at the times of `estimate`.
    """

    name: str
    truth: RelativeStateHistory | None = None
    estimate: RelativeStateHistory | None = None
    command: AccelerationHistory | None = None
    applied: AccelerationHistory | None = None
    target: RelativeStateHistory | None = None
    navigation: NavigationHistory | None = None


@dataclass(frozen=True, eq=False)
class ReceiverHistory:
    """What one GNSS receiver observed, as columns over all epochs.

    Attributes
    ----------
    name
        Spacecraft, the namespace of the receiver's topics.
    epoch_time
        ns since 1970, shape (n,).
    observations_per_epoch
        Shape (n,); the columns below have their sum as length.
    system, prn, band, attribute, flags
        As in ``vtff_msgs/GnssObservations``.
    cn0_dbhz
        Carrier to noise density.
    fix_time
        Position solutions in ns since 1970, shape (m,).
    fix_status
        ``vtff_msgs/GnssFix.STATUS_*``, shape (m,).
    ephemeris_system, ephemeris_prn
        One entry per ephemeris message.
    fix_position_itrf
        m, shape (m, 3).
    ephemerides
        Those with Keplerian elements, as received.
    """

    name: str
    epoch_time: TimeArray
    observations_per_epoch: npt.NDArray[np.int64]
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    band: npt.NDArray[np.uint8]
    attribute: npt.NDArray[np.uint8]
    flags: npt.NDArray[np.uint16]
    cn0_dbhz: npt.NDArray[np.float32]
    fix_time: TimeArray
    fix_status: npt.NDArray[np.uint8]
    ephemeris_system: npt.NDArray[np.uint8]
    ephemeris_prn: npt.NDArray[np.uint8]
    fix_position_itrf: FloatArray = dataclasses.field(default_factory=lambda: np.empty((0, 3)))
    ephemerides: tuple[BroadcastEphemeris, ...] = ()


@dataclass(frozen=True, eq=False)
class SatelliteColumns:
    """Values per satellite and time, as columns of equal length.

    Attributes
    ----------
    time
        ns since 1970.
    system, prn
        As in ``vtff_msgs/GnssObservations``.
    values
        Columns by the name of their field in the message.
    """

    time: TimeArray
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    values: dict[str, FloatArray]


@dataclass(frozen=True)
class HealthItem:
    """What one part of the system reported on /diagnostics.

    Attributes
    ----------
    name
        ``<node>: <subject>``.
    hardware_id
        Device or spacecraft.
    counts
        Reports by level: OK, WARN, ERROR, STALE.
    changes
        Scenario time (ns since 1970; 0 before the start) and text of each first report of a
        state other than OK, at most `LONGEST_CHANGES`.
    level, message, values
        The last report.
    """

    LONGEST_CHANGES: ClassVar[int] = 20

    name: str
    hardware_id: str
    counts: tuple[int, int, int, int]
    changes: tuple[tuple[int, str], ...]
    level: int
    message: str
    values: dict[str, str]


@dataclass(frozen=True)
class Boundary:
    """A crossed edge of an ionospheric irregularity; fields as in the message."""

    time: int
    kind: str
    source: str
    entry: bool
    spacecraft: str
    system: int
    prn: int
    latitude_deg: float
    longitude_deg: float
    altitude: float


@dataclass(frozen=True, eq=False)
class DensityHistory:
    """Electron density between two spacecraft, all satellites combined; arrays of shape (n,).

    Attributes
    ----------
    time
        ns since 1970.
    altitude, separation
        Of the middle, and deputy less chief, m.
    latitude_deg, longitude_deg
        Of the middle, geodetic.
    density, sigma
        Electrons per cubic metre, finite.
    """

    time: TimeArray
    altitude: FloatArray
    separation: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    density: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class SimulatorReport:
    """The last /sim/status of a run.

    Attributes
    ----------
    scenario
        Name of the scenario.
    pacing
        ``lockstep`` or ``realtime``.
    complete
        Whether the run came to its planned end.
    time_into_run
        Scenario time since the start in s.
    late_commands
        Thrust messages that missed their step.
    real_time_factor
        Scenario seconds per wall second.
    """

    scenario: str
    pacing: str
    complete: bool
    time_into_run: float
    late_commands: int
    real_time_factor: float


@dataclass(frozen=True, eq=False)
class RunHistory:
    """A run as recorded.

    Attributes
    ----------
    start_time, end_time
        First and last time in the bag, ns since 1970.
    message_counts
        Messages by topic.
    deputies, receivers
        By name, in alphabetical order.
    simulator
        None where no simulator took part.
    slant_tec, scintillation
        By topic.
    density
        None where no density was measured.
    satellite_density
        Density from each satellite by itself; its values are ``altitude`` (m), ``density`` and
        ``density_sigma``.
    boundaries
        In the order of time.
    health
        By name of the node.
    compute_time
        Wall time in s of each acknowledged step, by name of the node.
    notes
        One line for each thing that could not be read.
    """

    start_time: int
    end_time: int
    message_counts: dict[str, int]
    deputies: dict[str, DeputyHistory] = dataclasses.field(default_factory=dict)
    receivers: dict[str, ReceiverHistory] = dataclasses.field(default_factory=dict)
    simulator: SimulatorReport | None = None
    slant_tec: dict[str, SatelliteColumns] = dataclasses.field(default_factory=dict)
    scintillation: dict[str, SatelliteColumns] = dataclasses.field(default_factory=dict)
    density: DensityHistory | None = None
    satellite_density: SatelliteColumns | None = None
    boundaries: tuple[Boundary, ...] = ()
    health: tuple[HealthItem, ...] = ()
    compute_time: dict[str, FloatArray] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

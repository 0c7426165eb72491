"""Recorded values of a run as arrays; times are ns since 1970 in the scale of the header stamps."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.attitude import AttitudeRecording
from vtff_analysis.recordings.guidance import GuidanceHistory
from vtff_analysis.recordings.safety import SafetyHistory
from vtff_analysis.recordings.topics import CHIEF, DEPUTY
from vtff_analysis.survey.recording import SurveyHistory
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris

TimeArray = npt.NDArray[np.int64]
"""Times in ns since 1970."""

AXES = ("radial", "in_track", "cross_track")
"""Names of the RTN axes R, T, N in keys, in the order of the array columns."""


def seconds_since(start: int, time: TimeArray) -> FloatArray:
    """Return times in s since a start (ns since 1970).

    The difference is taken before it becomes a float: a double does not hold ns since 1970.
    """
    return np.asarray((time - start) * 1e-9)


def interpolate(
    time: npt.ArrayLike,
    sample_time: TimeArray,
    values: FloatArray,
    outside: float | None = None,
) -> FloatArray:
    """Return values at times, linear between samples.

    Parameters
    ----------
    time
        ns since 1970.
    sample_time, values
        Samples, shape (n,), at increasing times in ns since 1970.
    outside
        Value before the first and after the last sample; that of the nearest one if not given.
    """
    origin = sample_time[0]
    wanted = (np.asarray(time, dtype=np.int64) - origin) / NANOSECONDS_PER_SECOND
    samples = (sample_time - origin) / NANOSECONDS_PER_SECOND
    return np.asarray(np.interp(wanted, samples, values, left=outside, right=outside))


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
    """Statements of navigation about its own solution, for each usable estimate.

    Attributes
    ----------
    time
        Times of the estimates in ns since 1970, shape (n,).
    position_sigma_rtn, velocity_sigma_rtn
        One sigma in m and m/s, shape (n, 3); zero where none was given.
    solution
        ``vtff_msgs/RelativeState.SOLUTION_*``, shape (n,).
    satellites_used, ambiguities_fixed
        Numbers of satellites and of fixed ambiguities, shape (n,).
    ratio
        Ratio of the ambiguity test, shape (n,); 0 where not tested.
    innovation_rms
        RMS of the innovations in units of their predicted sigmas, shape (n,).
    position_covariance_rtn
        m2, shape (n, 3, 3); zero where none was given.
    """

    time: TimeArray
    position_sigma_rtn: FloatArray
    velocity_sigma_rtn: FloatArray
    solution: npt.NDArray[np.uint8]
    satellites_used: npt.NDArray[np.uint8]
    ambiguities_fixed: npt.NDArray[np.uint16]
    ratio: FloatArray
    innovation_rms: FloatArray
    position_covariance_rtn: FloatArray


@dataclass(frozen=True, eq=False)
class AccelerationHistory:
    """Commanded or applied accelerations of one deputy.

    Attributes
    ----------
    time
        Start of each application in ns since 1970, shape (n,).
    acceleration_rtn
        Accelerations in m/s2, shape (n, 3).
    """

    time: TimeArray
    acceleration_rtn: FloatArray


@dataclass(frozen=True, eq=False)
class DeputyHistory:
    """Recorded states and thrust of one deputy; None where the bag has no such topic.

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
        Statements of navigation about its solution, at the times of `estimate`.
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
    """Observations, fixes and ephemerides of one GNSS receiver, as columns over all epochs.

    Attributes
    ----------
    name
        Name of the spacecraft, which is the namespace of the receiver's topics.
    epoch_time
        Times of the epochs in ns since 1970, shape (n,).
    observations_per_epoch
        Number of observations of each epoch, shape (n,); their sum is the length of the
        observation columns.
    system, prn, band, attribute, flags
        Observation columns as in ``vtff_msgs/GnssObservations``.
    cn0_dbhz
        Carrier to noise density of each observation.
    fix_time
        Times of the position solutions in ns since 1970, shape (m,).
    fix_status
        ``vtff_msgs/GnssFix.STATUS_*``, shape (m,).
    ephemeris_system, ephemeris_prn
        Satellite of each ephemeris message.
    fix_position_itrf
        Positions of the solutions in m, shape (m, 3).
    ephemerides
        Ephemerides with Keplerian elements, as received.
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
        Satellites, numbered as in ``vtff_msgs/GnssObservations``.
    values
        Columns by the name of their field in the message.
    """

    time: TimeArray
    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    values: dict[str, FloatArray]


@dataclass(frozen=True)
class HealthItem:
    """Reports of one name on /diagnostics.

    Attributes
    ----------
    name
        ``<node>: <subject>``.
    hardware_id
        Device or spacecraft.
    counts
        Number of reports by level: OK, WARN, ERROR, STALE; shape (4,).
    changes
        Scenario time (ns since 1970; 0 before the start) and text of each first report of a
        state other than OK, at most `LONGEST_CHANGES`.
    level, message, values
        Content of the last report.
    """

    LONGEST_CHANGES: ClassVar[int] = 20

    name: str
    hardware_id: str
    counts: tuple[int, ...]
    changes: tuple[tuple[int, str], ...]
    level: int
    message: str
    values: dict[str, str]


@dataclass(frozen=True)
class Boundary:
    """A crossed edge of an ionospheric irregularity; fields as in the message.

    The width and its sigma are NaN for an edge of a ray.
    """

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
    width: float = math.nan
    width_sigma: float = math.nan


@dataclass(frozen=True, eq=False)
class DensityHistory:
    """Electron density between two spacecraft, all satellites combined; arrays of shape (n,).

    Attributes
    ----------
    time
        ns since 1970.
    altitude, separation
        Altitude of the middle between the spacecraft, and altitude of the deputy less that of the
        chief, m.
    latitude_deg, longitude_deg
        Geodetic position of the middle between the spacecraft.
    density, sigma
        Density and its sigma in electrons per cubic metre, finite.
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
class PairIonosphere:
    """What a bag holds of the ionosphere between the chief and one deputy.

    Attributes
    ----------
    density, satellite_density, boundaries
        As in `RunHistory`.
    """

    density: DensityHistory | None = None
    satellite_density: SatelliteColumns | None = None
    boundaries: tuple[Boundary, ...] = ()


@dataclass(frozen=True, eq=False)
class RunHistory:
    """Everything that reports and comparisons use of a recorded run.

    Attributes
    ----------
    start_time, end_time
        First and last time in the bag, ns since 1970.
    message_counts
        Messages by topic.
    deputies, receivers
        Histories by name, in alphabetical order.
    simulator
        Last report of the simulator; None where no simulator took part.
    slant_tec, scintillation
        Values of each topic, by its name.
    chief, deputy
        Names of the chief, and of the deputy whose pair the next three are of.
    density
        Density from all satellites; None where none was measured.
    satellite_density
        Density from each satellite by itself; its values are ``altitude`` (m), ``density`` and
        ``density_sigma``.
    boundaries
        Edges that chief or deputy have crossed, in the order of time.
    pairs
        The ionosphere of the chief with each deputy that has any, by the deputy's name.
    health
        Reports on /diagnostics in the order of their names.
    safety
        What the safety monitor has said; None in a run without one.
    attitude
        Attitude of each spacecraft that has one, by name.
    guidance
        What formation_guidance wanted; None in a run without it.
    survey
        What survey_guidance has learnt and decided; None in a run without it.
    compute_time
        Wall time in s of each acknowledged step, by name of the node.
    command_latency
        In real time, wall time in s from the last byte of a second that the receivers sent to its
        command on the CAN bus, by spacecraft of the thruster.
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
    chief: str = CHIEF
    deputy: str = DEPUTY
    density: DensityHistory | None = None
    satellite_density: SatelliteColumns | None = None
    boundaries: tuple[Boundary, ...] = ()
    pairs: dict[str, PairIonosphere] = dataclasses.field(default_factory=dict)
    health: tuple[HealthItem, ...] = ()
    safety: SafetyHistory | None = None
    attitude: dict[str, AttitudeRecording] = dataclasses.field(default_factory=dict)
    guidance: GuidanceHistory | None = None
    survey: SurveyHistory | None = None
    compute_time: dict[str, FloatArray] = dataclasses.field(default_factory=dict)
    command_latency: dict[str, FloatArray] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def of_pair(self, deputy: str) -> RunHistory:
        """Return the history with the ionosphere of the chief and one deputy.

        Parameters
        ----------
        deputy
            Name of a deputy; one without an entry in `pairs` has no ionosphere.
        """
        pair = self.pairs.get(deputy, PairIonosphere())
        return dataclasses.replace(
            self,
            deputy=deputy,
            density=pair.density,
            satellite_density=pair.satellite_density,
            boundaries=pair.boundaries,
        )

    def pair_histories(self) -> list[RunHistory]:
        """Return `of_pair` of each deputy with an ionosphere; else this history alone."""
        return [self.of_pair(deputy) for deputy in self.pairs] or [self]

"""Broadcast ephemerides as dataclasses, and the accuracy and fit-interval tables behind them."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_WEEK
from vtff_dynamics.time.timescales import GpsTime

__all__ = [
    "BroadcastEphemeris",
    "GlonassEphemeris",
    "galileo_accuracy",
    "lnav_accuracy",
    "lnav_fit_interval",
    "nearest_time_of_week",
]

DEFAULT_FIT_INTERVAL = 4 * 3600.0
"""s; curve-fit interval of GPS in normal operations and validity of a Galileo data set."""


@dataclass(frozen=True)
class BroadcastEphemeris:
    """Broadcast ephemeris of one satellite with Keplerian elements.

    The parameters are those of IS-GPS-200 table 20-III and of the Galileo OS SIS ICD (ephemeris).
    Names and units are those of ``vtff_msgs/GnssEphemeris``: SI units and rad.

    Parameters
    ----------
    time : GpsTime
        Time of reception, as far as the log tells it.
    system, prn, source : int
        ``SYSTEM_*``, RINEX satellite number, ``EPHEMERIS_SOURCE_*``.
    issue_of_data_ephemeris, issue_of_data_clock : int
        IODE and IODC; IODnav for Galileo.
    health : int
        0 = healthy, else the broadcast bits (Galileo: E5b health << 7 | E5b DVS << 6 | E5a health
        << 4 | E5a DVS << 3 | E1b health << 1 | E1b DVS, as in RINEX 3).
    gps_week : int
        Full GPS week of `toe`.
    toe, toc : float
        Reference times of ephemeris and clock, s of week.
    af0, af1, af2 : float
        Clock polynomial, s, s/s, s/s^2.
    group_delay, group_delay_secondary : float
        s; TGD, or Galileo BGD E1-E5a and E1-E5b.
    accuracy : float
        One-sigma user range accuracy, m; NaN if the satellite gives no prediction.
    fit_interval : float
        s.
    """

    time: GpsTime
    system: int
    prn: int
    source: int
    issue_of_data_ephemeris: int
    issue_of_data_clock: int
    health: int
    gps_week: int
    toe: float
    toc: float
    af0: float
    af1: float
    af2: float
    semi_major_axis: float
    eccentricity: float
    inclination: float
    inclination_rate: float
    longitude_of_ascending_node: float
    right_ascension_rate: float
    argument_of_perigee: float
    mean_anomaly: float
    mean_motion_difference: float
    cuc: float
    cus: float
    crc: float
    crs: float
    cic: float
    cis: float
    group_delay: float
    group_delay_secondary: float
    accuracy: float
    fit_interval: float

    @functools.cached_property
    def time_of_ephemeris(self) -> GpsTime:
        """Ephemeris reference time."""
        return GpsTime.from_week_tow(self.gps_week, self.toe)

    @property
    def time_of_clock(self) -> GpsTime:
        """Clock reference time: the occurrence of `toc` nearest to the ephemeris reference."""
        return nearest_time_of_week(self.toc, self.time_of_ephemeris)


@dataclass(frozen=True)
class GlonassEphemeris:
    """Broadcast ephemeris of one GLONASS satellite: a state vector (GLONASS ICD, immediate data).

    Parameters
    ----------
    time : GpsTime
        Time of reception, as far as the log tells it.
    prn : int
        Orbital slot.
    glonass_channel : int
        Frequency channel -7..+6.
    issue_of_data : int
        As in the log (NovAtel: the 15-minute interval of the day that the data are for).
    health : int
        0 = healthy, else the broadcast bits.
    time_of_ephemeris : GpsTime
        Reference time of the state.
    position, velocity, acceleration : tuple of 3 float
        PZ-90, Earth-fixed; m, m/s; the acceleration is that of Sun and Moon, m/s^2.
    clock_offset : float
        s, as broadcast: tau_n, GLONASS time less satellite time.
    relative_frequency_offset : float
        gamma_n.
    """

    time: GpsTime
    prn: int
    glonass_channel: int
    issue_of_data: int
    health: int
    time_of_ephemeris: GpsTime
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    acceleration: tuple[float, float, float]
    clock_offset: float
    relative_frequency_offset: float


def nearest_time_of_week(time_of_week: float, reference: GpsTime) -> GpsTime:
    """Return the time with the given seconds of week that is nearest to `reference`."""
    time = GpsTime.from_week_tow(reference.week, time_of_week)
    week = SECONDS_PER_WEEK * NANOSECONDS_PER_SECOND
    after = time.nanoseconds - reference.nanoseconds
    if 2 * after >= week:
        return GpsTime(time.nanoseconds - week)
    return GpsTime(time.nanoseconds + week) if 2 * after < -week else time


def lnav_accuracy(user_range_accuracy_index: int) -> float:
    """Return the nominal user range accuracy of an LNAV URA index (IS-GPS-200, 20.3.3.3.1.3).

    Returns
    -------
    float
        m; NaN for index 15 (no prediction).
    """
    rounded = {1: 2.8, 3: 5.7, 5: 11.3}
    if user_range_accuracy_index in rounded:
        return rounded[user_range_accuracy_index]
    if user_range_accuracy_index <= 6:
        return float(2.0 ** (1.0 + user_range_accuracy_index / 2.0))
    if user_range_accuracy_index < 15:
        return float(2.0 ** (user_range_accuracy_index - 2.0))
    return float("nan")


def lnav_fit_interval(fit_interval_flag: int, issue_of_data_clock: int) -> float:
    """Return the curve-fit interval in s from flag and IODC (IS-GPS-200, table 20-XII)."""
    if not fit_interval_flag:
        return DEFAULT_FIT_INTERVAL
    if 240 <= issue_of_data_clock <= 247:
        return 8 * 3600.0
    if 248 <= issue_of_data_clock <= 255 or issue_of_data_clock == 496:
        return 14 * 3600.0
    if 497 <= issue_of_data_clock <= 503 or 1021 <= issue_of_data_clock <= 1023:
        return 26 * 3600.0
    return 6 * 3600.0


def galileo_accuracy(signal_in_space_accuracy_index: int) -> float:
    """Return the signal-in-space accuracy of a SISA index (Galileo OS SIS ICD, section SISA).

    Returns
    -------
    float
        m; NaN for the spare indices and for 255 (no accuracy prediction available).
    """
    starts: npt.NDArray[np.int64] = np.array([0, 50, 75, 100])
    steps = (0.01, 0.02, 0.04, 0.16)
    origins = (0.0, 0.5, 1.0, 2.0)
    if not 0 <= signal_in_space_accuracy_index <= 125:
        return float("nan")
    segment = int(np.searchsorted(starts, signal_in_space_accuracy_index, side="right")) - 1
    offset = signal_in_space_accuracy_index - int(starts[segment])
    return origins[segment] + steps[segment] * offset

"""Ephemerides, observations and whole logs that the tests of encoders and decoders send."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris, galileo_accuracy
from vtff_gnss.fix import STATUS_SINGLE, Fix, ReceiverTime
from vtff_gnss.novatel.encode.ephemeris import (
    encode_galileo_ephemeris,
    encode_gpsephem,
    encode_rawephem,
)
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.novatel.encode.range import encode_range, encode_rangecmp
from vtff_gnss.novatel.encode.rangecmp4 import RangeCmp4Encoder
from vtff_gnss.novatel.encode.solution import (
    ComponentVersion,
    IonosphereUtc,
    encode_bestxyz,
    encode_ionutc,
    encode_receiver_time,
    encode_version,
)
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.signals import carrier_wavelength

TIME = GpsTime.from_week_tow(1889, 90000.0)
ALL_VALID = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN


def nominal_ephemeris() -> BroadcastEphemeris:
    """Return an ephemeris of a GPS satellite that is on no grid of the broadcast message."""
    return BroadcastEphemeris(
        time=TIME, system=c.SYSTEM_GPS, prn=7, source=c.EPHEMERIS_SOURCE_LNAV,
        issue_of_data_ephemeris=5, issue_of_data_clock=261, health=0, gps_week=1889, toe=93600.0,
        toc=93600.0, af0=1e-5, af1=-2e-12, af2=0.0, semi_major_axis=26.56e6, eccentricity=0.01,
        inclination=0.96, inclination_rate=1e-10, longitude_of_ascending_node=-2.0,
        right_ascension_rate=-8e-9, argument_of_perigee=0.5, mean_anomaly=3.0,
        mean_motion_difference=4.5e-9, cuc=1e-6, cus=2e-6, crc=200.0, crs=-50.0, cic=1e-7,
        cis=-1e-7, group_delay=-1e-8, group_delay_secondary=0.0, accuracy=2.0,
        fit_interval=14400.0)  # fmt: skip


def observation_epoch(
    signals: list[tuple[int, int, int, int]], time: GpsTime = TIME, seed: int = 0, **columns: Any
) -> ObservationEpoch:
    """Return plausible observations of (system, prn, band, attribute) signals."""
    generator = np.random.default_rng(seed)
    count = len(signals)
    system, prn, band, attribute = (
        (np.array([s[k] for s in signals], dtype=np.uint8) for k in range(4))
        if count
        else (np.zeros(0, np.uint8) for _ in range(4))
    )
    channel = np.where(system == c.SYSTEM_GLONASS, prn % 14 - 7.0, 0)
    pseudorange = generator.uniform(1.9e7, 2.7e7, count)
    satellites = {}
    for index in range(count):
        key = (int(system[index]), int(prn[index]))
        base = satellites.setdefault(key, pseudorange[index])
        pseudorange[index] = base + generator.uniform(-20.0, 20.0)
    wavelength = carrier_wavelength(system, band, channel)
    values = {
        "system": system,
        "prn": prn,
        "band": band,
        "attribute": attribute,
        "glonass_channel": channel,
        "pseudorange": pseudorange,
        "carrier_phase_cycles": pseudorange / wavelength + generator.uniform(-500, 500, count),
        "doppler_hz": generator.uniform(-3000.0, 3000.0, count),
        "cn0_dbhz": generator.uniform(25.0, 50.0, count),
        "pseudorange_sigma": generator.uniform(0.03, 0.9, count),
        "carrier_phase_sigma_cycles": generator.uniform(0.004, 0.02, count),
        "lock_time": generator.uniform(0.0, 5000.0, count),
        "flags": np.full(count, ALL_VALID),
    } | columns
    typed = {n: np.asarray(values[n]).astype(kind) for n, kind in OBSERVATION_COLUMNS.items()}
    return ObservationEpoch(
        time=time, time_status=180, receiver_status=0x100, log_name="RANGE", **typed
    )


def gps_observation_epoch(satellite_count: int = 12, **options: Any) -> ObservationEpoch:
    """Return L1 C/A, L2P(Y) and L2C of some GPS satellites."""
    return observation_epoch(
        [
            (c.SYSTEM_GPS, prn, band, ord(attribute))
            for prn in range(1, satellite_count + 1)
            for band, attribute in ((1, "C"), (2, "W"), (2, "S"))
        ],
        **options,
    )


def fix_at(time: GpsTime, **changes: Any) -> Fix:
    """Return a single-point fix in low orbit."""
    values: dict[str, Any] = dict(
        time=time, status=STATUS_SINGLE, receiver_solution_type=16,
        position=(6.6e6, -1.2e6, 3.4e5), velocity=(10.5, 7400.25, -800.125),
        position_sigma=(1.5, 2.25, 1.75), velocity_sigma=(0.125, 0.25, 0.5), velocity_latency=0.0,
        satellites_tracked=12, satellites_used=11, clock_offset=math.nan,
        clock_offset_sigma=math.nan)  # fmt: skip
    return Fix(**values | changes)


def receiver_log(seconds: int, satellite_count: int = 12) -> bytes:
    """Return what a receiver sends in some seconds: every log of the encoders, with an answer.

    The first second holds ephemerides of GPS and Galileo, ionosphere and version; each second the
    three range logs, a fix and the time.
    """
    settings, rangecmp4 = HeaderSettings(), RangeCmp4Encoder()
    gps = nominal_ephemeris()
    galileo = replace(
        gps, system=c.SYSTEM_GALILEO, source=c.EPHEMERIS_SOURCE_INAV, prn=11, toe=90000.0,
        toc=90000.0, issue_of_data_clock=5, accuracy=galileo_accuracy(107),
    )  # fmt: skip
    content = b"\r\n<OK\r\n[COM1]" + b"".join(
        (
            encode_version([ComponentVersion()], TIME, settings),
            encode_gpsephem(gps, settings),
            encode_rawephem(replace(gps, prn=8), settings),
            encode_galileo_ephemeris(galileo, settings),
            encode_ionutc(IonosphereUtc.at(TIME), TIME, settings),
        )
    )
    for second in range(seconds):
        time = TIME + second
        epoch = gps_observation_epoch(satellite_count, time=time, seed=second)
        content += encode_range(epoch, settings) + encode_rangecmp(epoch, settings)
        content += rangecmp4.encode(epoch, settings) + encode_bestxyz(fix_at(time), settings)
        content += encode_receiver_time(ReceiverTime(time, True, 0.0, 1e-9, -17.0), settings)
    return content

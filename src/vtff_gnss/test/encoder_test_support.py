"""An ephemeris and observations that the tests of the encoders send."""

from __future__ import annotations

from typing import Any

import numpy as np

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
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

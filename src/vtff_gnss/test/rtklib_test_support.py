"""Observations and ephemerides of RTKLIB's decoder, a decoder that is not ours, as plain values."""

from __future__ import annotations

from typing import Any

import pytest

from vtff_gnss import constants as c

pyrtklib = pytest.importorskip("pyrtklib", reason="the referee decoder is not installed")

UNIX_TIME_OF_GPS_EPOCH = 315_964_800
SYSTEMS = {1: c.SYSTEM_GPS, 2: c.SYSTEM_SBAS, 4: c.SYSTEM_GLONASS}


def gps_seconds(time: Any) -> float:
    """Return RTKLIB's time in seconds since the GPS epoch."""
    return time.time - UNIX_TIME_OF_GPS_EPOCH + time.sec


def satellite_of(sat: int) -> tuple[int, int]:
    """Return system and PRN of RTKLIB's satellite number."""
    prn = pyrtklib.Arr1Dint(1)
    system = SYSTEMS[pyrtklib.satsys(sat, prn)]
    return system, prn[0] - (100 if system == c.SYSTEM_SBAS else 0)


def rtklib_epoch(raw: Any) -> tuple[float, dict]:
    """Return the time and, by (system, PRN, code), the observations that RTKLIB just decoded."""
    signals = {}
    for i in range(raw.obs.n):
        observation = raw.obs.data[i]
        for j in range(pyrtklib.NFREQ + pyrtklib.NEXOBS):
            if observation.code[j]:
                key = (*satellite_of(observation.sat), pyrtklib.code2obs(observation.code[j]))
                signals[key] = {
                    "pseudorange": observation.P[j],
                    "carrier_phase_cycles": observation.L[j],
                    "doppler_hz": observation.D[j],
                    "cn0_dbhz": observation.SNR[j] * 0.001,
                    "lli": observation.LLI[j],
                }
    return gps_seconds(raw.obs.data[0].time), signals


EPHEMERIS_FIELDS = {
    "issue_of_data_ephemeris": "iode",
    "issue_of_data_clock": "iodc",
    "health": "svh",
    "af0": "f0",
    "af1": "f1",
    "af2": "f2",
    "semi_major_axis": "A",
    "eccentricity": "e",
    "inclination": "i0",
    "inclination_rate": "idot",
    "longitude_of_ascending_node": "OMG0",
    "right_ascension_rate": "OMGd",
    "argument_of_perigee": "omg",
    "mean_anomaly": "M0",
    "mean_motion_difference": "deln",
    "cuc": "cuc",
    "cus": "cus",
    "crc": "crc",
    "crs": "crs",
    "cic": "cic",
    "cis": "cis",
}


def rtklib_ephemeris(raw: Any) -> dict:
    """Return the ephemeris that RTKLIB just decoded."""
    system, prn = satellite_of(raw.ephsat)
    if system == c.SYSTEM_GLONASS:
        source = raw.nav.geph[prn - 1]
        return {
            "satellite": (system, prn),
            "toe": gps_seconds(source.toe),
            "glonass_channel": source.frq,
            "health": source.svh,
            "clock_offset": source.taun,
            "relative_frequency_offset": source.gamn,
            "position": tuple(source.pos[k] for k in range(3)),
            "velocity": tuple(source.vel[k] for k in range(3)),
            "acceleration": tuple(source.acc[k] for k in range(3)),
        }
    source = raw.nav.eph[raw.ephsat - 1]
    fields = {ours: getattr(source, theirs) for ours, theirs in EPHEMERIS_FIELDS.items()}
    return {
        "satellite": (system, prn),
        "toe": gps_seconds(source.toe),
        "toc": gps_seconds(source.toc),
        "ura_index": source.sva,
        "group_delay": source.tgd[0],
        "fit_hours": source.fit,
        **fields,
    }

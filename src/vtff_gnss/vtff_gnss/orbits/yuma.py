"""YUMA almanacs of GPS (U.S. Coast Guard Navigation Center format): reader and writer."""

from __future__ import annotations

import math
import pathlib
import re

from vtff_dynamics.constants import SECONDS_PER_WEEK
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import EPHEMERIS_SOURCE_LNAV, SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris

__all__ = ["AlmanacError", "read_yuma"]

DEFAULT_ALMANAC_INTERVAL = 14 * 86400.0
"""s; validity given to an almanac: one week before and after its time of applicability."""

_WEEK_MODULUS = 1024

# Label as written, its pattern (writers abbreviate differently), and the attribute.
_FIELDS = (
    ("ID", r"ID", "prn"),
    ("Health", r"Health", "health"),
    ("Eccentricity", r"Eccentricity", "eccentricity"),
    ("Time of Applicability(s)", r"Time of Applicability.*", "toe"),
    ("Orbital Inclination(rad)", r"Orbital Inclination.*", "inclination"),
    ("Rate of Right Ascen(r/s)", r"Rate of Right Ascen.*", "right_ascension_rate"),
    ("SQRT(A)  (m 1/2)", r"SQRT\(A\).*", "square_root_of_semi_major_axis"),
    ("Right Ascen at Week(rad)", r"Right Ascen at Week.*", "longitude_of_ascending_node"),
    ("Argument of Perigee(rad)", r"Argument of Perigee.*", "argument_of_perigee"),
    ("Mean Anom(rad)", r"Mean Anom.*", "mean_anomaly"),
    ("Af0(s)", r"Af0.*", "af0"),
    ("Af1(s/s)", r"Af1.*", "af1"),
    ("week", r"week", "gps_week"),
)


class AlmanacError(ValueError):
    """A YUMA file is malformed; the message names file, line and field."""


def read_yuma(
    path: str | pathlib.Path,
    near: GpsTime | None = None,
    fit_interval: float = DEFAULT_ALMANAC_INTERVAL,
) -> tuple[BroadcastEphemeris, ...]:
    """Read a YUMA almanac as ephemerides without harmonic terms and group delays.

    Parameters
    ----------
    path : path
    near : GpsTime, optional
        A time within 9 years of the almanac, which resolves week numbers modulo 1024. Without
        it weeks are taken as written.
    fit_interval : float
        s; validity of the sets, centred on the time of applicability. With
        `vtff_gnss.orbits.broadcast_orbit.ephemeris_with_reference` they become sets of two hours.

    Raises
    ------
    AlmanacError
        If a field is unknown, missing, double or not a number.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    blocks: list[tuple[int, dict[str, float]]] = []
    for number, text in enumerate(path.read_text(encoding="ascii").splitlines(), start=1):
        if not text.strip() or text.lstrip().startswith("*"):
            continue
        name, value = _field(f"{path}:{number}", text)
        if name == "prn":
            blocks.append((number, {}))
        if not blocks:
            raise AlmanacError(f"{path}:{number}: ID is required before {name}")
        if name in blocks[-1][1]:
            raise AlmanacError(f"{path}:{number}: {name}: given twice")
        blocks[-1][1][name] = value
    if not blocks:
        raise AlmanacError(f"{path}: no almanac entry")
    return tuple(_ephemeris(f"{path}:{n}", block, near, fit_interval) for n, block in blocks)


def _field(place: str, text: str) -> tuple[str, float]:
    label, separator, value = text.partition(":")
    label = label.strip()
    name = next((n for _, pattern, n in _FIELDS if re.fullmatch(pattern, label, re.I)), None)
    if name is None or not separator:
        raise AlmanacError(f"{place}: {label!r}: not a field of a YUMA almanac")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise AlmanacError(f"{place}: {label}: {value.strip()!r} is not a number")
    return name, number


def _ephemeris(
    place: str, value: dict[str, float], near: GpsTime | None, fit_interval: float
) -> BroadcastEphemeris:
    missing = [label for label, _, name in _FIELDS if name not in value]
    if missing:
        raise AlmanacError(f"{place}: {', '.join(missing)}: missing")
    if not 0.0 <= value["toe"] < SECONDS_PER_WEEK:
        raise AlmanacError(f"{place}: Time of Applicability: {value['toe']:g} is not in a week")
    week = int(value["gps_week"])
    if near is not None:
        week += _WEEK_MODULUS * round((near.week - week) / _WEEK_MODULUS)
    axis_root = value["square_root_of_semi_major_axis"]
    return BroadcastEphemeris(
        time=GpsTime.from_week_tow(week, value["toe"]),
        system=SYSTEM_GPS,
        prn=int(value["prn"]),
        source=EPHEMERIS_SOURCE_LNAV,
        issue_of_data_ephemeris=0,
        issue_of_data_clock=0,
        health=int(value["health"]),
        gps_week=week,
        toe=value["toe"],
        toc=value["toe"],
        af0=value["af0"],
        af1=value["af1"],
        af2=0.0,
        semi_major_axis=axis_root * axis_root,
        eccentricity=value["eccentricity"],
        inclination=value["inclination"],
        inclination_rate=0.0,
        longitude_of_ascending_node=value["longitude_of_ascending_node"],
        right_ascension_rate=value["right_ascension_rate"],
        argument_of_perigee=value["argument_of_perigee"],
        mean_anomaly=value["mean_anomaly"],
        mean_motion_difference=0.0,
        cuc=0.0,
        cus=0.0,
        crc=0.0,
        crs=0.0,
        cic=0.0,
        cis=0.0,
        group_delay=0.0,
        group_delay_secondary=0.0,
        accuracy=math.nan,
        fit_interval=fit_interval,
    )

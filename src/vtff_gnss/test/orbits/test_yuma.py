"""YUMA almanacs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable, ephemeris_with_reference
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.nominal_constellation import (
    nominal_gps_constellation,
)
from vtff_gnss.orbits.yuma import AlmanacError, read_yuma

START = parse_epoch("2016-03-21T01:00:00 GPS")
GPS = nominal_gps_constellation(START, START)

# Layout of the files of the U.S. Coast Guard Navigation Center, values made up.
ENTRY = """\
******** Week 866 almanac for PRN-01 ********
ID:                         01
Health:                     000
Eccentricity:               0.5190372467E-002
Time of Applicability(s):  589824.0000
Orbital Inclination(rad):   0.9663738561
Rate of Right Ascen(r/s):  -0.7931758961E-008
SQRT(A)  (m 1/2):           5153.650879
Right Ascen at Week(rad):  -0.1230151411E+001
Argument of Perigee(rad):   0.479811423
Mean Anom(rad):            -0.2094471346E+001
Af0(s):                    -0.9536743164E-005
Af1(s/s):                  -0.3637978807E-011
week:                        866
"""


# Label of each line and the field of an ephemeris that it holds.
FIELDS = {
    "ID": "prn",
    "Health": "health",
    "Eccentricity": "eccentricity",
    "Time of Applicability(s)": "toe",
    "Orbital Inclination(rad)": "inclination",
    "Rate of Right Ascen(r/s)": "right_ascension_rate",
    "SQRT(A)  (m 1/2)": "semi_major_axis",
    "Right Ascen at Week(rad)": "longitude_of_ascending_node",
    "Argument of Perigee(rad)": "argument_of_perigee",
    "Mean Anom(rad)": "mean_anomaly",
    "Af0(s)": "af0",
    "Af1(s/s)": "af1",
    "week": "gps_week",
}


def format_yuma(ephemerides):
    """Return a YUMA file of GPS ephemerides; harmonic terms and clock acceleration are lost."""
    blocks = []
    for e in ephemerides:
        values = {
            "ID": f"{e.prn:02d}",
            "Health": f"{e.health:03d}",
            "Time of Applicability(s)": f"{e.toe:.4f}",
            "SQRT(A)  (m 1/2)": f"{math.sqrt(e.semi_major_axis):.9f}",
            "week": str(e.gps_week),
        }
        lines = [f"******** Week {e.gps_week} almanac for PRN-{e.prn:02d} ********"]
        for label, name in FIELDS.items():
            value = values.get(label, f"{getattr(e, name): .12E}")
            lines.append(f"{label + ':':<27}{value}")
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def test_round_trip(tmp_path):
    path = tmp_path / "almanac.yuma"
    path.write_text(format_yuma(GPS))
    read = read_yuma(path, fit_interval=4 * 3600.0)
    assert len(read) == 31
    names = (
        "prn",
        "health",
        "gps_week",
        "toe",
        "toc",
        "af0",
        "af1",
        "eccentricity",
        "inclination",
        "longitude_of_ascending_node",
        "right_ascension_rate",
        "argument_of_perigee",
        "mean_anomaly",
        "semi_major_axis",
    )
    for before, after in zip(GPS, read, strict=True):
        for name in names:
            assert getattr(after, name) == pytest.approx(
                getattr(before, name), rel=1e-12, abs=1e-23
            )
    path.write_text(format_yuma(read))
    assert read_yuma(path, fit_interval=4 * 3600.0) == read


def test_almanac_of_the_navigation_center(tmp_path):
    path = tmp_path / "almanac.alm"
    path.write_text(ENTRY + "\n" + ENTRY.replace("PRN-01", "PRN-02").replace("  01", "  02"))
    first, second = read_yuma(path, near=START)
    assert (first.prn, second.prn) == (1, 2)
    assert first.gps_week == 1890
    assert first.semi_major_axis == 5153.650879 * 5153.650879
    assert first.af1 == -0.3637978807e-11
    assert first.longitude_of_ascending_node == -1.230151411
    assert read_yuma(path)[0].gps_week == 866
    states = EphemerisTable([first]).states(first.time_of_ephemeris)
    assert np.linalg.norm(states.position_itrf[0]) == pytest.approx(first.semi_major_axis, rel=6e-3)


def test_sets_of_two_hours_follow_the_almanac(tmp_path):
    path = tmp_path / "almanac.alm"
    path.write_text(format_yuma(GPS))
    almanac = read_yuma(path)
    later = START + 3 * 86400
    sets = [
        dataclasses.replace(ephemeris_with_reference(e, later), fit_interval=14400.0)
        for e in almanac
    ]
    here, there = (
        EphemerisStore(s).table(later + 600).states(later + 600) for s in (almanac, sets)
    )
    assert np.abs(here.position_itrf - there.position_itrf).max() < 1e-6


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("ID:  ", "Number:  ", r"almanac.alm:2: 'Number': not a field"),
        ("5153.650879", "five", r"almanac.alm:8: SQRT\(A\)  \(m 1/2\): 'five' is not a number"),
        ("Health:                     000\n", "", r"almanac.alm:2: Health: missing"),
        ("week:  ", "ID: 3\nweek:  ", r"almanac.alm:2: week: missing"),
        ("week:  ", "Health: 3\nweek:  ", r"almanac.alm:14: health: given twice"),
        ("ID:                         01\n", "", r"almanac.alm:2: ID is required before health"),
        ("589824.0000", "700000", r"almanac.alm:2: Time of Applicability: 700000 is not in a week"),
    ],
)
def test_errors_name_file_line_and_field(old, new, text, tmp_path):
    path = tmp_path / "almanac.alm"
    path.write_text(ENTRY.replace(old, new))
    with pytest.raises(AlmanacError, match=text):
        read_yuma(path)


def test_empty_file(tmp_path):
    path = tmp_path / "almanac.alm"
    path.write_text("\n")
    with pytest.raises(AlmanacError, match="no almanac entry"):
        read_yuma(path)

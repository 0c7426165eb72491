"""RINEX navigation files against RTKLIB's reader, and as text in all versions."""

from __future__ import annotations

import dataclasses
import gzip
import math

import pytest
from constellation_test_support import (
    BRDC,
    SPIRENT,
    drawn_navigation_file,
    navigation,
    seconds_of,
    shared_file,
)

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.files.observation_files import ObservationFileError, open_ephemerides
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation import parse_rinex_navigation, read_rinex_navigation

RTKLIB_SYSTEMS = {1: c.SYSTEM_GPS, 8: c.SYSTEM_GALILEO}
RTKLIB_NAMES = {
    "issue_of_data_ephemeris": "iode",
    "health": "svh",
    "toe": "toes",
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
    **{name: name for name in ("cuc", "cus", "crc", "crs", "cic", "cis")},
}


def gps_seconds(time: GpsTime) -> float:
    return time.nanoseconds / 1e9


def test_every_field_equals_rtklib(tmp_path):
    assert_fields_equal_rtklib(drawn_navigation_file(), {0: 31}, tmp_path)


def test_every_field_of_real_files_equals_rtklib(tmp_path):
    assert_fields_equal_rtklib(SPIRENT, {0: 31}, tmp_path)
    assert_fields_equal_rtklib(BRDC, {0: 435, 3: 9784}, tmp_path)


def assert_fields_equal_rtklib(path, counts, tmp_path):
    pyrtklib = pytest.importorskip("pyrtklib")
    plain = shared_file(path)
    if path.suffix == ".gz":
        plain = tmp_path / "navigation.rnx"
        plain.write_bytes(gzip.decompress(path.read_bytes()))
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    assert pyrtklib.readrnx(str(plain), 1, "", obs, nav, station) == 1
    prn = pyrtklib.Arr1Dint(1)
    theirs = []
    for i in range(nav.n):
        eph = nav.eph[i]
        system = RTKLIB_SYSTEMS.get(pyrtklib.satsys(eph.sat, prn))
        if system is not None:
            theirs.append((system, prn[0], eph))
    ours = navigation(path).ephemerides
    assert {s: sum(e.system == s for e in ours) for s in counts} == counts
    assert len(ours) == len(theirs)
    for mine, (system, number, eph) in zip(ours, theirs, strict=True):
        assert (mine.system, mine.prn) == (system, number)
        for name, their_name in RTKLIB_NAMES.items():
            assert getattr(mine, name) == getattr(eph, their_name), name
        assert gps_seconds(mine.time_of_ephemeris) == seconds_of(eph.toe)
        assert gps_seconds(mine.time_of_clock) == seconds_of(eph.toc)
        assert gps_seconds(mine.time) == pytest.approx(seconds_of(eph.ttr), abs=1e-6)
        assert mine.group_delay == eph.tgd[0]
        if system == c.SYSTEM_GPS:
            assert mine.issue_of_data_clock == eph.iodc
            assert mine.fit_interval == eph.fit * 3600.0
        else:
            assert mine.group_delay_secondary == eph.tgd[1]
            is_fnav = bool(eph.code & 1 << 8)
            assert mine.source == (c.EPHEMERIS_SOURCE_FNAV if is_fnav else c.EPHEMERIS_SOURCE_INAV)


def test_header_and_skipped_records():
    day = navigation(BRDC)
    assert day.version == 3.04
    assert day.skipped_records == {"C": 1082, "I": 143, "J": 100, "R": 1219, "S": 11199}
    assert day.klobuchar.alpha == (2.2352e-08, 0.0, -5.9605e-08, 1.1921e-07)
    assert day.klobuchar.beta == (145410.0, -196610.0, 0.0, 196610.0)
    assert day.nequick.effective_ionisation == (146.5, -0.63672, 0.002533)
    assert day.leap_seconds == 18
    assert navigation(SPIRENT).klobuchar.beta == (79872.0, 65536.0, -65536.0, -393220.0)


def header(version: str, *lines: str) -> str:
    first = f"{version:>9}{'':11}{'N: GNSS NAV DATA':20}{'M: MIXED':20}RINEX VERSION / TYPE"
    return "\n".join([first, *lines, f"{'':60}END OF HEADER"]) + "\n"


def record(e: BroadcastEphemeris, version: int, **changes: str) -> list[str]:
    """Write an ephemeris as RINEX, with fields replaced by `changes`."""
    is_gps = e.system == c.SYSTEM_GPS
    source = {c.EPHEMERIS_SOURCE_INAV: 517.0, c.EPHEMERIS_SOURCE_FNAV: 258.0}.get(e.source, 1.0)
    rows = [
        {"af0": e.af0, "af1": e.af1, "af2": e.af2},
        {
            "iode": float(e.issue_of_data_ephemeris),
            "crs": e.crs,
            "deln": e.mean_motion_difference,
            "m0": e.mean_anomaly,
        },
        {"cuc": e.cuc, "e": e.eccentricity, "cus": e.cus, "a": math.sqrt(e.semi_major_axis)},
        {"toe": e.toe, "cic": e.cic, "omega0": e.longitude_of_ascending_node, "cis": e.cis},
        {
            "i0": e.inclination,
            "crc": e.crc,
            "omega": e.argument_of_perigee,
            "omegadot": e.right_ascension_rate,
        },
        {"idot": e.inclination_rate, "code": source, "week": float(e.gps_week), "spare": 0.0},
        {
            "accuracy": e.accuracy,
            "health": float(e.health),
            "tgd": e.group_delay,
            "last": float(e.issue_of_data_clock) if is_gps else e.group_delay_secondary,
        },
        {"transmission": e.time.time_of_week, "fit": e.fit_interval / 3600.0},
    ]
    texts = ["".join(changes.get(n, f"{v:19.12E}") for n, v in row.items()) for row in rows]
    stamp = e.time_of_clock.isoformat().replace("-", " ").replace("T", " ").replace(":", " ")
    stamp = stamp.removesuffix(" GPS")
    if version == 2:
        first = f"{e.prn:2d} {stamp[2:]:>17}.0"
        return [(first + texts[0]).replace("E", "D"), *("   " + text for text in texts[1:])]
    name = f"{c.SYSTEM_LETTERS[e.system]}{e.prn:02d}"
    lines = [f"{name} {stamp}{texts[0]}", *("    " + text for text in texts[1:])]
    if version == 4:
        message = {c.EPHEMERIS_SOURCE_LNAV: "LNAV", c.EPHEMERIS_SOURCE_INAV: "INAV"}[e.source]
        lines.insert(0, f"> EPH {name} {message}")
    return lines


START = parse_epoch("2016-03-21T01:00:00 GPS")
GPS = nominal_gps_constellation(START, START)
GALILEO = nominal_galileo_constellation(START, START)


def rounded(e: BroadcastEphemeris) -> BroadcastEphemeris:
    """Round floats to the 13 digits of a RINEX field."""
    values = {}
    for field in dataclasses.fields(e):
        value = getattr(e, field.name)
        if isinstance(value, float):
            values[field.name] = float(f"{value:.12E}")
    axis_root = float(f"{math.sqrt(e.semi_major_axis):.12E}")
    values["semi_major_axis"] = axis_root * axis_root
    return dataclasses.replace(e, **values)


@pytest.mark.parametrize("version", [2, 3, 4])
def test_written_ephemerides_are_read_back(version, tmp_path):
    ephemerides = GPS if version == 2 else GPS + GALILEO
    lines = [line for e in ephemerides for line in record(e, version)]
    path = tmp_path / "nav.rnx"
    path.write_text(header({2: "2.11", 3: "3.05", 4: "4.01"}[version]) + "\n".join(lines))
    assert read_rinex_navigation(path).ephemerides == tuple(rounded(e) for e in ephemerides)


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize("systems", ["G", "E", "GE", "R"])
def test_only_chosen_systems_are_read(version, systems, tmp_path):
    ephemerides = GPS if version == 2 else GALILEO[:1] + GPS + GALILEO[1:]
    lines = [line for e in ephemerides for line in record(e, version)]
    path = tmp_path / "nav.rnx"
    path.write_text(header({2: "2.11", 3: "3.05", 4: "4.01"}[version]) + "\n".join(lines))
    chosen = [rounded(e) for e in ephemerides if c.SYSTEM_LETTERS[e.system] in systems]
    found = parse_rinex_navigation(path.read_bytes(), path, systems)
    assert found.ephemerides == tuple(chosen)
    assert found.skipped_records == read_rinex_navigation(path).skipped_records
    if not chosen:
        with pytest.raises(ObservationFileError, match=f"no ephemerides of systems {systems}"):
            open_ephemerides(path, systems)


def test_rinex_2_ionosphere_and_century(tmp_path):
    lines = [
        "    0.1118D-07  0.2235D-07 -0.5960D-07 -0.1192D-06".ljust(60) + "ION ALPHA",
        "    0.9011D+05  0.6554D+05 -0.1311D+06 -0.4588D+06".ljust(60) + "ION BETA",
        "    13".ljust(60) + "LEAP SECONDS",
    ]
    old = parse_epoch("1999-08-20T12:00:00 GPS")
    sets = nominal_gps_constellation(old, old)
    path = tmp_path / "old.99n"
    path.write_text(header("2.10", *lines) + "\n".join(record(sets[0], 2)))
    content = read_rinex_navigation(path)
    assert content.klobuchar.alpha == (1.118e-8, 2.235e-8, -5.96e-8, -1.192e-7)
    assert content.klobuchar.beta == (90110.0, 65540.0, -131100.0, -458800.0)
    assert content.leap_seconds == 13
    assert content.ephemerides[0].time_of_ephemeris == sets[0].time_of_ephemeris


def test_rinex_4_other_records(tmp_path):
    lines = [
        "> STO G01 LNAV",
        "    2016 03 21 00 00 00 GPUT",
        "     4.0E+04 0.0E+00 0.0E+00 0.0E+00",
        "> ION G05 LNAV",
        "    2016 03 21 00 00 00 1.000000000000E-08 2.000000000000E-08-3.000000000000E-08",
        "    -4.000000000000E-08 5.000000000000E+04 6.000000000000E+04-7.000000000000E+04",
        "     8.000000000000E+04 0.000000000000E+00",
        "> ION E05 IFNV",
        "    2016 03 21 00 00 00 1.465000000000E+02-6.367200000000E-01 2.533000000000E-03",
        "     0.000000000000E+00",
        "> EPH C20 D1",
        "C20 2016 03 21 00 00 00 0.0",
        *record(GPS[4], 4),
    ]
    path = tmp_path / "nav.rnx.gz"
    path.write_bytes(gzip.compress((header("4.00") + "\n".join(lines)).encode()))
    content = read_rinex_navigation(path)
    assert content.ephemerides == (rounded(GPS[4]),)
    assert content.klobuchar.alpha == (1e-8, 2e-8, -3e-8, -4e-8)
    assert content.klobuchar.beta == (5e4, 6e4, -7e4, 8e4)
    assert content.nequick.effective_ionisation == (146.5, -0.63672, 0.002533)
    assert content.skipped_records == {"C EPH D1": 1, "G STO LNAV": 1}


@pytest.mark.parametrize(
    ("changes", "attribute", "value"),
    [
        ({"fit": " " * 19}, "fit_interval", 4 * 3600.0),
        ({"fit": f"{1.0:19.12E}"}, "fit_interval", 6 * 3600.0),
        ({"fit": f"{6.0:19.12E}"}, "fit_interval", 6 * 3600.0),
        ({"transmission": " " * 19}, "time", GPS[0].time_of_clock),
        ({"transmission": f"{9.999e8:19.12E}"}, "time", GPS[0].time_of_clock),
        ({"week": f"{0.0:19.12E}"}, "gps_week", GPS[0].gps_week),
    ],
)
def test_fields_that_writers_differ_in(changes, attribute, value, tmp_path):
    path = tmp_path / "nav.rnx"
    path.write_text(header("3.04") + "\n".join(record(GPS[0], 3, **changes)))
    assert getattr(read_rinex_navigation(path).ephemerides[0], attribute) == value


@pytest.mark.parametrize(("accuracy", "system"), [(8192.0, GPS), (-1.0, GALILEO)])
def test_no_accuracy_prediction(accuracy, system, tmp_path):
    path = tmp_path / "nav.rnx"
    lines = record(dataclasses.replace(system[0], accuracy=accuracy), 3)
    path.write_text(header("3.04") + "\n".join(lines))
    assert math.isnan(read_rinex_navigation(path).ephemerides[0].accuracy)


def test_time_of_transmission_before_the_turn_of_the_week(tmp_path):
    sunday = parse_epoch("2016-03-27T00:30:00 GPS")
    ephemeris = nominal_galileo_constellation(sunday, sunday)[0]
    path = tmp_path / "nav.rnx"
    lines = record(ephemeris, 3, transmission=f"{-600.0:19.12E}")
    path.write_text(header("3.04") + "\n".join(lines))
    assert read_rinex_navigation(path).ephemerides[0].time == ephemeris.time_of_ephemeris - 600


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"crs": " " * 19}, r"nav.rnx:4: G01 crs: blank"),
        ({"a": "  5.15x".ljust(19)}, r"nav.rnx:5: G01 square_root_of_semi_major_axis: '5.15x'"),
        ({"toe": f"{7e5:19.12E}"}, r"nav.rnx:6: G01 toe: 700000 s is not within a week"),
        ({"m0": "nan".rjust(19)}, r"nav.rnx:4: G01 mean_anomaly: 'nan' is not a number"),
    ],
)
def test_errors_name_file_line_and_field(changes, text, tmp_path):
    path = tmp_path / "nav.rnx"
    path.write_text(header("3.04") + "\n".join(record(GPS[0], 3, **changes)))
    with pytest.raises(RinexError, match=text):
        read_rinex_navigation(path)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", "nav.rnx:1: not a RINEX file"),
        (header("3.04").replace("N: GNSS", "O: GNSS"), "nav.rnx:1: file type 'O'"),
        (header("5.00"), "nav.rnx:1: RINEX version 5 is not supported"),
        (header("3.04").splitlines()[0], "END OF HEADER is missing"),
        (header("3.04") + "    1.0", "nav.rnx:3: record: no satellite"),
        (header("3.04") + "\n".join(record(GPS[0], 3)[:6]), "nav.rnx:8: G01: 6 lines"),
        (header("3.04") + "\n".join(record(GPS[0], 3)).replace("2016 03", "2016 13"), "epoch"),
        (header("4.00") + "> EPH", "nav.rnx:3: record: '> type satellite message'"),
    ],
)
def test_malformed_files(content, text, tmp_path):
    path = tmp_path / "nav.rnx"
    path.write_text(content)
    with pytest.raises(RinexError, match=text):
        read_rinex_navigation(path)


def test_truncated_gzip(tmp_path):
    path = tmp_path / "nav.rnx.gz"
    path.write_bytes(gzip.compress(header("3.04").encode())[:-6])
    with pytest.raises(RinexError, match="compressed file is damaged or incomplete"):
        read_rinex_navigation(path)


@pytest.mark.parametrize("satellite", ["G07", "E11"])
def test_a_rinex_4_record_without_lines_is_named(satellite, tmp_path):
    path = tmp_path / "some.rnx"
    message = "LNAV" if satellite[0] == "G" else "INAV"
    path.write_text(header("4.00") + f"> EPH {satellite} {message}\n", encoding="ascii")
    with pytest.raises(RinexError, match=rf":3: {satellite}: the record ends early"):
        read_rinex_navigation(path)

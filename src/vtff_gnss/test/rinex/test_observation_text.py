"""Small observation files as text: versions, flags, events, time systems, and error messages."""

from __future__ import annotations

import bz2
import gzip
import zipfile

import hatanaka
import numpy as np
import pytest
from rinex_test_support import (
    epoch_3,
    header_2,
    header_3,
    header_line,
    names,
    read_text,
    types_3,
    value,
)

from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss import constants as c
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.observation import read_rinex_observation

TYPES = types_3("G", "C1C", "L1C", "D1C", "S1C")
VALID = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN


def satellite(name, code=2.0e7, phase=1.0e8, doppler=-12.5, cn0=45.25, lock=" ", strength=" "):
    cells = value(code) + value(phase, lock, strength) + value(doppler) + value(cn0)
    return f"{name}{cells}".rstrip() + "\n"


def two_lines_2(*cells):
    """Return a satellite's lines of RINEX 2: five values to a line."""
    lines = ["".join(cells[i : i + 5]).rstrip() + "\n" for i in range(0, len(cells), 5)]
    return "".join(lines)


@pytest.mark.parametrize("version", ["3.00", "3.05", "4.00", "4.02"])
def test_values_of_versions_3_and_4(version, tmp_path):
    text = header_3(TYPES, version=version) + epoch_3(0.0, 1) + satellite("G05")
    result = read_text(tmp_path, text)
    epoch = result.table.epoch(0)
    assert epoch.time == parse_epoch("2024-01-10T00:00:00 GPS")
    assert (epoch.log_name, names(result.table)) == ("RINEX", ["G05 1C"])
    assert epoch.pseudorange[0] == 2.0e7 and epoch.carrier_phase_cycles[0] == 1.0e8
    assert epoch.doppler_hz[0] == -12.5 and epoch.cn0_dbhz[0] == 45.25
    assert epoch.flags[0] == VALID and epoch.lock_time[0] == 0.0
    assert np.isnan(epoch.pseudorange_sigma[0]) and np.isnan(epoch.carrier_phase_sigma_cycles[0])


def test_missing_values_are_nan_and_flagged(tmp_path):
    rows = [
        satellite("G01", code=None),
        satellite("G02", phase=None, doppler=None, cn0=None),
        satellite("G03", code=0.0, phase=0.0),
        satellite("G04", code=0.0, phase=0.0, doppler=0.0),
    ]
    table = read_text(tmp_path, header_3(TYPES) + epoch_3(0.0, 4) + "".join(rows)).table
    # Without code, phase and Doppler there is no observation: G04 has a strength only.
    assert names(table) == ["G01 1C", "G02 1C", "G03 1C"]
    columns = table.columns
    assert columns["flags"].tolist() == [VALID & ~c.FLAG_CODE_VALID, c.FLAG_CODE_VALID, 0]
    assert np.isnan(columns["pseudorange"][[0, 2]]).all()
    assert np.isnan(columns["carrier_phase_cycles"][1:]).all()
    assert np.isnan(columns["doppler_hz"][1]) and np.isnan(columns["cn0_dbhz"][1])


def test_strength_digit_stands_in_for_a_missing_strength(tmp_path):
    rows = [
        satellite("G01", cn0=None, strength=5),
        satellite("G02", cn0=41.0, strength=5),
        satellite("G03", cn0=None),
    ]
    table = read_text(tmp_path, header_3(TYPES) + epoch_3(0.0, 3) + "".join(rows)).table
    np.testing.assert_array_equal(table.columns["cn0_dbhz"], [33.0, 41.0, np.nan])


def test_loss_of_lock_digits_and_lock_times(tmp_path):
    digits = {"G01": "     ", "G02": "  1  ", "G03": "  2  ", "G04": "  3  ", "G05": "4    "}
    text = header_3(TYPES)
    for second in range(5):
        text += epoch_3(second, len(digits))
        text += "".join(satellite(name, lock=lock[second]) for name, lock in digits.items())
    table = read_text(tmp_path, text).table
    _, flags = table.by_satellite("flags", c.SYSTEM_GPS, 1, "C")
    _, lock_time = table.by_satellite("lock_time", c.SYSTEM_GPS, 1, "C")
    expected = np.full((5, 5), VALID)
    expected[2, [1, 3]] |= c.FLAG_LOCK_LOST
    expected[2, [2, 3]] &= ~c.FLAG_PARITY_KNOWN
    np.testing.assert_array_equal(flags, expected)
    np.testing.assert_array_equal(lock_time[:, 0], [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(lock_time[:, 1], [0, 1, 0, 1, 2])
    np.testing.assert_array_equal(lock_time[:, 2], [0, 1, 2, 3, 4])


def test_gaps_power_failure_and_reported_slips_end_an_arc(tmp_path):
    text = header_3(TYPES)
    for second in range(12):
        present = [f"G{n:02d}" for n in (1, 2, 3) if not (n == 2 and second == 3)]
        if second == 9:  # cycle-slip records: three cycles on G03
            text += epoch_3(9.0, 1, kind=6) + satellite("G03", None, 3.0, None, None)
        text += epoch_3(second, len(present), kind=int(second == 6))
        text += "".join(satellite(name) for name in present)
    table = read_text(tmp_path, text).table
    _, flags = table.by_satellite("flags", c.SYSTEM_GPS, 1, "C")
    _, lock_time = table.by_satellite("lock_time", c.SYSTEM_GPS, 1, "C")
    is_lost = flags & c.FLAG_LOCK_LOST != 0
    assert [np.flatnonzero(column).tolist() for column in is_lost.T] == [[6], [4, 6], [6, 9]]
    np.testing.assert_array_equal(lock_time[:, 1], [0, 1, 2, np.nan, 0, 1, 0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(lock_time[8:, 2], [2, 0, 1, 2])


def test_events_are_kept_and_new_types_count_from_there(tmp_path):
    later = types_3("G", "L2W", "C2W")
    text = header_3(TYPES) + epoch_3(0.0, 1) + satellite("G05")
    text += epoch_3(0.5, 2, kind=4) + later + header_line("new site", "COMMENT")
    text += epoch_3(1.0, 1) + "G05" + value(9.0e7, 1, 7) + value(2.1e7) + "\n"
    text += epoch_3(1.5, 0, kind=5)
    text += ">" + " " * 30 + "3  1\n" + header_line("SITE 2", "MARKER NAME")
    text += epoch_3(2.0, 1) + "G05" + value(9.1e7) + "\n"
    result = read_text(tmp_path, text)
    assert names(result.table) == ["G05 1C", "G05 2W", "G05 2W"]
    np.testing.assert_array_equal(result.table.columns["pseudorange"], [2.0e7, 2.1e7, np.nan])
    assert [(event.kind, len(event.records)) for event in result.events] == [(4, 2), (5, 0), (3, 1)]
    assert result.events[1].time == parse_epoch("2024-01-10T00:00:01.5 GPS")
    assert result.events[2].time is None
    # The header is that of the start of the file.
    assert result.header.observation_types == {"G": ("C1C", "L1C", "D1C", "S1C")}
    assert result.header.marker_name == ""


def test_header(tmp_path):
    text = header_3(
        header_line("BELE", "MARKER NAME"),
        header_line("  4228139.0476 -4772752.0834  -155761.3808", "APPROX POSITION XYZ"),
        header_line("        0.0080        0.0100        0.0000", "ANTENNA: DELTA H/E/N"),
        header_line("number              TRIMBLE NETR9       5.60", "REC # / TYPE / VERS"),
        header_line("  2 R01  1 R02 -4", "GLONASS SLOT / FRQ #"),
        header_line("G L2X -0.25000", "SYS / PHASE SHIFT"),
        header_line("    30.000", "INTERVAL"),
        header_line("    18    18  2185     7", "LEAP SECONDS"),
        header_line("     1", "RCV CLOCK OFFS APPL"),
        types_3("R", "C1C", "L1C"),
    )
    text += epoch_3(0.0, 2, clock="       0.000000123456") + "R02" + value(2.0e7) + value(1.0e8)
    text += "\nR03" + value(2.0e7) + value(1.0e8) + "\n"
    result = read_text(tmp_path, text)
    header = result.header
    assert (header.marker_name, header.interval, header.leap_seconds) == ("BELE", 30.0, 18)
    assert header.approximate_position == (4228139.0476, -4772752.0834, -155761.3808)
    assert header.antenna_delta_hen == (0.008, 0.01, 0.0)
    assert header.receiver == ("number", "TRIMBLE NETR9", "5.60")
    assert header.glonass_channels == {1: 1, 2: -4}
    assert header.phase_shifts == {"G L2X": -0.25}
    assert header.clock_offset_applied
    assert result.table.receiver_clock_offset.tolist() == [1.23456e-7]
    channels = result.table.columns["glonass_channel"].tolist()
    assert channels == [-4, c.GLONASS_CHANNEL_UNKNOWN]


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        ("GPS", "2024-01-10T00:00:00 GPS"),
        ("GAL", "2024-01-10T00:00:00 GPS"),
        ("GLO", "2024-01-10T00:00:00 UTC"),
        ("UTC", "2024-01-10T00:00:00 UTC"),
        ("BDT", "2024-01-10T00:00:14 GPS"),
    ],
)
def test_time_systems(system, expected, tmp_path):
    first = header_line(
        f"  2024     1    10     0     0    0.0000000     {system}", "TIME OF FIRST OBS"
    )
    result = read_text(tmp_path, header_3(TYPES, first) + epoch_3(0.0, 1) + satellite("G05"))
    assert result.table.time(0) == result.header.first_time == parse_epoch(expected)


def test_leap_second_of_a_glonass_file(tmp_path):
    text = header_3(types_3("R", "C1C"), system="R")
    for line in ("2016 12 31 23 59 59.0000000", "2016 12 31 23 59 60.0000000",
                 "2017 01 01 00 00  0.0000000"):  # fmt: skip
        text += f"> {line}  0  1\nR01{value(2.0e7)}\n"
    table = read_text(tmp_path, text).table
    assert np.diff(table.time_nanoseconds).tolist() == [1_000_000_000] * 2
    assert table.time(0) == parse_epoch("2016-12-31T23:59:59 UTC")


def test_scale_factors_and_old_beidou_names(tmp_path):
    scale = header_line("G  100   1 L1C", "SYS / SCALE FACTOR")
    text = header_3(TYPES, types_3("C", "C1I", "L1I"), scale, version="3.02")
    text += epoch_3(0.0, 2) + satellite("G05") + "C06" + value(2.2e7) + value(1.1e8) + "\n"
    table = read_text(tmp_path, text).table
    assert names(table) == ["G05 1C", "C06 2I"]
    assert table.columns["carrier_phase_cycles"].tolist() == [1.0e6, 1.1e8]
    assert table.columns["pseudorange"].tolist() == [2.0e7, 2.2e7]


TYPES_2 = ("C1", "P1", "L1", "D1", "S1", "P2", "L2", "D2", "S2", "C2", "C5", "L5")


def record_2(offset=0.0):
    numbers = [2.0e7, 2.1e7, 1.0e8, 10.0, 45.0, 2.2e7, 8.0e7, 8.0, 40.0, 2.3e7, 2.4e7, 7.0e7]
    return two_lines_2(*(value(number + offset) for number in numbers))


def test_version_2_names_signals_and_joins_lines(tmp_path):
    satellites = ["G05", " 07", "R03", "E11"]
    text = header_2(*TYPES_2)
    text += " 24  1 10  0  0  0.0000000  0  4" + "".join(satellites) + "\n"
    text += record_2() * 4
    result = read_text(tmp_path, text)
    expected_gps = ["1C", "1W", "2W", "2X", "5X"]
    assert names(result.table) == [
        *(f"G05 {signal}" for signal in expected_gps),
        *(f"G07 {signal}" for signal in expected_gps),
        *(f"R03 {signal}" for signal in ("1C", "1P", "2P", "2C")),
        *(f"E11 {signal}" for signal in ("1X", "5X")),
    ]
    columns = {name: column[:5] for name, column in result.table.columns.items()}
    np.testing.assert_array_equal(columns["pseudorange"], [2.0e7, 2.1e7, 2.2e7, 2.3e7, 2.4e7])
    # L1 belongs to C1, L2 to P2: the other codes of the band have no phase of their own.
    phases = columns["carrier_phase_cycles"]
    np.testing.assert_array_equal(phases, [1.0e8, np.nan, 8.0e7, np.nan, 7.0e7])
    assert columns["flags"].tolist() == [VALID, 1, VALID, 1, VALID]
    assert result.table.time(0) == parse_epoch("2024-01-10T00:00:00 GPS")


def test_version_2_many_satellites_events_and_power_failure(tmp_path):
    numbers = range(1, 15)
    text = header_2("C1", "L1", system="G")
    for second, kind in ((0, 0), (1, 1), (2, 0)):
        listed = [f"G{n:2d}" for n in numbers]
        text += f" 99 12 31 23 59 {second:2d}.0000000  {kind} 14" + "".join(listed[:12]) + "\n"
        text += " " * 32 + "".join(listed[12:]) + "\n"
        text += "".join(value(2.0e7 + n) + value(1.0e8 + n) + "\n" for n in numbers)
        if second == 0:
            text += " " * 28 + "4  1\n" + header_line("moved", "COMMENT")
    result = read_text(tmp_path, text)
    prn, phase = result.table.by_satellite("carrier_phase_cycles", c.SYSTEM_GPS, 1, "C")
    assert prn.tolist() == list(numbers)
    np.testing.assert_array_equal(phase, np.tile(1.0e8 + np.arange(1, 15), (3, 1)))
    _, flags = result.table.by_satellite("flags", c.SYSTEM_GPS, 1, "C")
    assert ((flags & c.FLAG_LOCK_LOST) != 0).all(axis=1).tolist() == [False, True, False]
    assert result.table.time(0) == parse_epoch("1999-12-31T23:59:00 GPS")
    assert [event.records[0][:5] for event in result.events] == ["moved"]


def test_version_2_blank_observation_lines_at_the_end(tmp_path):
    text = header_2(*TYPES_2) + " 24  1 10  0  0  0.0000000  0  1G05\n"
    text += value(2.0e7) + "\n\n\n"
    table = read_text(tmp_path, text).table
    assert names(table) == ["G05 1C"]


def test_version_2_attributes_can_be_chosen(tmp_path):
    text = header_2("C1", "C2", "L2") + " 24  1 10  0  0  0.0000000  0  1G05\n"
    text += value(2.0e7) + value(2.1e7) + value(8.0e7) + "\n"
    chosen = {"G": {"C1": "1C", "C2": "2L"}}
    assert names(read_text(tmp_path, text).table) == ["G05 1C", "G05 2X"]
    assert names(read_text(tmp_path, text, rinex2_attributes=chosen).table) == ["G05 1C", "G05 2L"]


def test_types_of_low_orbit_missions(tmp_path):
    """RINEX 2.20: LA is the phase of C/A, L1 then that of P."""
    text = header_2("L1", "L2", "LA", "C1", "P1", "P2", "SA", version="2.20", system="G")
    text += " 24  1 10  0  0  0.0000000  0  1G05\n"
    cells = [value(x) for x in (1.1e8, 8.0e7, 1.0e8, 2.0e7, 2.1e7, 2.2e7, 45.0)]
    table = read_text(tmp_path, text + two_lines_2(*cells)).table
    found = dict(zip(names(table), table.columns["carrier_phase_cycles"], strict=True))
    assert found == {"G05 1W": 1.1e8, "G05 2W": 8.0e7, "G05 1C": 1.0e8}


@pytest.mark.parametrize("compression", ["none", "gz", "bz2", "Z"])
@pytest.mark.parametrize("version", [2, 3])
def test_compressed_files_give_the_same(version, compression, tmp_path):
    text = header_3(TYPES) + epoch_3(0.0, 1) + satellite("G05") + epoch_3(1.0, 0)
    text += epoch_3(2.0, 1) + satellite("G05", 2.1e7, lock=1)
    if version == 2:
        text = header_2(*TYPES_2, system="G")
        for second in range(2):
            text += f" 24  1 10  0  0  {second}.0000000  0  1G05\n" + record_2(second)
    plain = read_text(tmp_path, text)
    path = tmp_path / "some.file"
    first = header_line("", "PGM / RUN BY / DATE")
    lines = text.splitlines(keepends=True)
    path.write_bytes(
        hatanaka.compress("".join([lines[0], first, *lines[1:]]).encode(), compression=compression)
    )
    packed = read_rinex_observation(path)
    assert packed.header.observation_types == plain.header.observation_types
    assert list(packed.epochs()) == list(plain.epochs())


GOOD = header_3(TYPES) + epoch_3(0.0, 1) + satellite("G05")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"some.rnx: the file is empty"),
        ("\n \n", r"some.rnx: the file is empty"),
        ("hello\n", r"some.rnx:1: not a RINEX file"),
        (GOOD.replace("3.05", "5.00"), r":1: RINEX version 5 is not supported"),
        (GOOD.replace("3.05", "x.05"), r":1: version: 'x.05' is not a number"),
        (GOOD.replace("OBSERVATION DATA", "NAVIGATION DATA "), r":1: file type 'N'"),
        (GOOD.replace("END OF HEADER", "END OF HEDAER"), r"END OF HEADER is missing"),
        (header_3() + epoch_3(0.0, 0), r"lists no observation types"),
        (header_3(TYPES.replace("    4", "    5")), r":2: SYS / # / OBS TYPES: .*three characters"),
        (header_3(TYPES.replace("G", "Q")), r":2: .*satellite system 'Q' is unknown"),
        (GOOD.replace("> 2024 01 10", "> 2024 13 10"), r":4: epoch: .*month must be"),
        (GOOD.replace("00  0.0000000", "00 60.0000000"), r":4: epoch: .*second 60 does not exist"),
        (GOOD.replace("  0  1", "  9  1"), r":4: epoch: flag and number of records"),
        (GOOD.replace("  0  1", "  0 -1"), r":4: epoch: flag and number of records"),
        (GOOD.replace("  0  1", "  0  2"), r":4: epoch: the file ends inside it: 3 lines"),
        (GOOD + "G06\n", r":6: epoch: '>' is required"),
        (GOOD + epoch_3(0.0, 0), r":6: epoch: .* is not after"),
        (GOOD.replace("G05", "X05"), r":5: satellite b'X05' is unknown"),
        (GOOD.replace("G05", "R05"), r":5: no types for system R"),
        (GOOD.replace("100000000.000", "1000o0000.000"), r":5: G05 L1C: .* is not F14.3"),
        (GOOD.replace("100000000.000", "1-0000000.000"), r":5: G05 L1C: .* is not F14.3"),
        (GOOD.replace("100000000.000 ", "100000000.000x"), r":5: G05 L1C: .* is not F14.3"),
        (GOOD.replace("45.250", "45.250" + value(1.0)), r":5: more values than the 4 types"),
        (GOOD[:-2], r":5: the file ends inside this line"),
        (GOOD.replace("45.250", "45.2"), r":5: G05 S1C: .* is not F14.3"),
        (GOOD + GOOD[len(header_3(TYPES)) :], r":6: epoch: .* is not after"),
        (header_3(TYPES) + epoch_3(0.0, 2) + satellite("G05") * 2, r":6: .*listed twice"),
        (GOOD + epoch_3(1.0, 1, clock="      x") + satellite("G05"), r":6: receiver clock offset"),
    ],
)  # fmt: skip
def test_error_names_file_line_and_field(text, message, tmp_path):
    with pytest.raises(RinexError, match=message):
        read_text(tmp_path, text)


def test_partial_reading_stops_before_the_damage(tmp_path):
    text = GOOD + epoch_3(1.0, 1) + satellite("G05") + epoch_3(2.0, 1) + satellite("G05")
    damaged = text[: text.rindex("G05")] + "G05 2000x000\n" + epoch_3(3.0, 1)
    result = read_text(tmp_path, damaged, partial=True)
    assert len(result.table) == 2
    assert ":9: G05 C1C" in str(result.error)
    assert read_text(tmp_path, text, partial=True).error is None


def test_a_number_in_another_format_is_read(tmp_path):
    text = GOOD.replace("  20000000.000", "   2.00000e+07")
    assert read_text(tmp_path, text).table.columns["pseudorange"].tolist() == [2.0e7]


def test_damaged_compression(tmp_path):
    path = tmp_path / "some.rnx.gz"
    path.write_bytes(gzip.compress(GOOD.encode())[:-9])
    with pytest.raises(RinexError, match=r"some\.rnx\.gz: compressed file is damaged"):
        read_rinex_observation(path)
    lines = GOOD.splitlines(keepends=True)
    text = "".join([lines[0], header_line("", "PGM / RUN BY / DATE"), *lines[1:]])
    compact = hatanaka.rnx2crx(text.encode())
    path.write_bytes(compact[:-30])
    with pytest.raises(RinexError, match=r"damaged or incomplete|ends inside"):
        read_rinex_observation(path)


def test_header_without_observations_is_an_empty_table(tmp_path):
    result = read_text(tmp_path, header_3(TYPES))
    assert len(result.table) == 0 and list(result.epochs()) == []


END = header_line("", "END OF HEADER")


@pytest.mark.parametrize(
    ("content", "label"),
    [
        (header_3(header_2("C1").splitlines(keepends=True)[1]), "# / TYPES OF OBSERV"),
        (
            header_2("C1").replace(END, types_3("G", "C1C") + END),
            "SYS / # / OBS TYPES",
        ),
    ],
)
def test_types_of_another_version_are_refused(content, label, tmp_path):
    with pytest.raises(RinexError, match=f"{label}: not in RINEX"):
        read_text(tmp_path, content)


@pytest.mark.parametrize("kind", ["gz", "bz2", "zip"])
def test_a_file_that_expands_without_measure_is_refused(kind, tmp_path):
    path = tmp_path / f"some.{kind}"
    zeros = bytes(60_000_000)
    if kind == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("some.rnx", zeros)
    else:
        path.write_bytes(gzip.compress(zeros) if kind == "gz" else bz2.compress(zeros))
    with pytest.raises(RinexError, match="compressed file of .* that is no RINEX file"):
        read_rinex_observation(path)

"""Bias files written here line by line: every field, validity, and what is left out."""

import math

import pytest
from bias_file_support import sinex_file, sinex_line

from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GLONASS, SYSTEM_GPS
from vtff_iono.bias.bias_files import read_code_biases
from vtff_iono.bias.code_biases import BiasFileError

NOON = parse_epoch("2024-01-10T12:00:00 GPS")


@pytest.mark.parametrize("name", ["test.BIA", "test.BIA.gz"])
def test_fields_of_bias_sinex(tmp_path, name):
    path = sinex_file(
        tmp_path,
        sinex_line("DSB", "G07", "", "C1C", "C2W", -3.25, 0.5),
        sinex_line("OSB", "E11", "", "C1C", "", 4.5, 0.25),
        sinex_line("DSB", "G", "BELE", "C1C", "C2W", 12.125, 0.125),
        sinex_line("OSB", "G07", "", "L1C", "", 1.0, 0.1),
        sinex_line("DSB", "G07", "", "C1C", "C5Q", 1.0, 0.1, unit="cyc"),
        sinex_line("ISB", "G07", "", "C1C", "C5Q", 1.0, 0.1),
        name=name,
    )
    table = read_code_biases(path)
    assert table.origin == str(path)
    satellite, absolute, receiver = table.biases
    assert (satellite.system, satellite.prn, satellite.station) == (SYSTEM_GPS, 7, "")
    assert (satellite.first, satellite.second) == ("C1C", "C2W")
    assert (satellite.value, satellite.sigma) == pytest.approx((-3.25e-9, 0.5e-9))
    assert satellite.start == parse_epoch("2024-01-10T00:00:00 GPS")
    assert satellite.end == parse_epoch("2024-01-11T00:00:00 GPS")
    assert (absolute.system, absolute.prn, absolute.second) == (SYSTEM_GALILEO, 11, "")
    assert (receiver.prn, receiver.station) == (0, "BELE")
    assert table.receiver_bias("BELE", SYSTEM_GPS, "C1C", "C2W", NOON) == pytest.approx(
        (12.125e-9, 0.125e-9)
    )


def test_an_open_end_and_seconds_of_the_day(tmp_path):
    line = sinex_line("DSB", "G07", "", "C1C", "C2W", 1.0, 0.1, end="0000:000:00000")
    (bias,) = read_code_biases(sinex_file(tmp_path, line)).biases
    assert bias.end > NOON + 50 * 365 * 86400
    line = sinex_line("DSB", "G07", "", "C1C", "C2W", 1.0, 0.1, end="2024:366:03661")
    (bias,) = read_code_biases(sinex_file(tmp_path, line)).biases
    assert bias.end == parse_epoch("2024-12-31T01:01:01 GPS")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (sinex_line("DSB", "X07", "", "C1C", "C2W", 1.0, 0.1), "satellite 'X07': unknown system"),
        (
            sinex_line("DSB", "G", "", "C1C", "C2W", 1.0, 0.1),
            "names neither a satellite nor a station",
        ),
        (sinex_line("DSB", "GAB", "", "C1C", "C2W", 1.0, 0.1), "satellite 'AB': not a number"),
        (sinex_line("DSB", "G07", "", "C1C", "C2W", math.inf, 0.1), "ESTIMATED_VALUE 'inf': not f"),
        (sinex_line("DSB", "G07", "", "C1C", "C2W", 1.0, math.nan), "STD_DEV 'nan': not finite"),
        (
            sinex_line("DSB", "G07", "", "C1C", "C2W", 1.0, 0.1, end="2024:1:00000"),
            "BIAS_END '2024:1:00000': expected YYYY:DDD:SSSSS",
        ),
    ],
)
def test_a_broken_line_is_named(tmp_path, line, message):
    good = sinex_line("DSB", "G07", "", "C1C", "C2W", 1.0, 0.1)
    with pytest.raises(BiasFileError, match=rf"test.BIA:5: {message}"):
        read_code_biases(sinex_file(tmp_path, good, line))


def test_a_block_must_be_there_and_closed(tmp_path):
    path = tmp_path / "cut.BIA"
    path.write_text("%=BIA 1.00 TST\n+BIAS/SOLUTION\n")
    with pytest.raises(BiasFileError, match="BIAS/SOLUTION is not closed: the file is cut off"):
        read_code_biases(path)
    path.write_text("%=BIA 1.00 TST\n")
    with pytest.raises(BiasFileError, match="BIAS/SOLUTION is missing"):
        read_code_biases(path)


def dcb_file(folder, title, pair="P1-C1"):
    path = folder / "test.DCB"
    path.write_text(
        f"CODE DCB SOLUTION, {title}\n\nDIFFERENTIAL ({pair}) CODE BIASES FOR SATELLITES\n\n"
        "G31                          -1.500     0.250\n"
        "R24                           2.500\n"
        "R     ONSA 10402M004          4.000     0.125\n"
    )
    return path


def test_fields_of_a_dcb_file(tmp_path):
    table = read_code_biases(dcb_file(tmp_path, "YEAR-MONTH: 24-02"))
    gps, glonass, receiver = table.biases
    assert (gps.system, gps.prn, gps.first, gps.second) == (SYSTEM_GPS, 31, "C1W", "C1C")
    assert (gps.value, gps.sigma) == pytest.approx((-1.5e-9, 0.25e-9))
    assert (glonass.system, glonass.prn, glonass.first) == (SYSTEM_GLONASS, 24, "C1P")
    assert (glonass.value, glonass.sigma) == pytest.approx((2.5e-9, 0.0))
    assert (receiver.prn, receiver.station) == (0, "ONSA")
    # The whole February of a leap year.
    for bias in table.biases:
        assert bias.start == parse_epoch("2024-02-01T00:00:00 GPS")
        assert bias.end == parse_epoch("2024-03-01T00:00:00 GPS")


@pytest.mark.parametrize(
    ("title", "start", "end"),
    [
        ("YEAR-MONTH: 99-12", "1999-12-01", "2000-01-01"),
        ("YEAR-MONTH: 80-02", "1980-02-01", "1980-03-01"),
        ("YEAR-MONTH: 79-01", "2079-01-01", "2079-02-01"),
        # Thirty days that end with the day that is named.
        ("ENDING DAY 060, 2024", "2024-01-31", "2024-03-01"),
    ],
)
def test_validity_of_a_dcb_file(tmp_path, title, start, end):
    bias = read_code_biases(dcb_file(tmp_path, title)).biases[0]
    assert bias.start == parse_epoch(f"{start}T00:00:00 GPS")
    assert bias.end == parse_epoch(f"{end}T00:00:00 GPS")


@pytest.mark.parametrize(
    ("title", "pair", "message"),
    [
        ("YEAR-MONTH: 24-00", "P1-C1", "title: month 00"),
        ("OF A MONTH", "P1-C1", "neither YEAR-MONTH nor ENDING DAY"),
        ("YEAR-MONTH: 24-02", "P1-P9", "title: unknown signal 'P9'"),
    ],
)
def test_a_title_that_says_too_little(tmp_path, title, pair, message):
    with pytest.raises(BiasFileError, match=rf"test.DCB: .*{message}"):
        read_code_biases(dcb_file(tmp_path, title, pair))

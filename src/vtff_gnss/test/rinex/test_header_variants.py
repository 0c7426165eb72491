"""Headers as archives and receivers write them: other digits, and optional lines that are bad."""

from __future__ import annotations

import pytest
from rinex_test_support import epoch_3, header_2, header_3, header_line, names, types_3, value

from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.observation import parse_rinex_observation

END = header_line("", "END OF HEADER")
EPOCH = epoch_3(30.0, 1) + f"G05{value(2.0e7)}{value(1.0e8)}\n"


def parsed(*lines: str):
    text = header_3(types_3("G", "C1C", "L1C"), *lines) + EPOCH
    return parse_rinex_observation(text.encode("ascii"), "sample")


@pytest.mark.parametrize(
    "date",
    [
        "  2024     1    10     0     0   30.0000000     GPS",  # RINEX: 5I6, F13.7
        "  2024     1    10     0     0   30.0000000",
        "  2024     1    10     0     0   30.000000      GPS",  # six digits
        "  2024     1    10     0     0   30.000",
        "  2024     1    10     0     0   30.00000000    GPS",
        "  2024     1    10     0     0   30",
        "  2024     1    10     0     0    30.0000000    GPS",  # one column further
        "  2024    01    10    00    00   30.0000000     GPS",
        "    24     1    10     0     0   30.0000000     GPS",
        " 2024 1 10 0 0 30.0000000                       GPS",
    ],
)
def test_first_time_in_any_digits(date):
    result = parsed(header_line(date, "TIME OF FIRST OBS"))
    assert result.remarks == ()
    assert result.header.first_time == result.table.time(0)


def test_time_system_behind_a_shifted_date():
    line = header_line("  2024     1    10     0     0   30.0000000     BDT", "TIME OF FIRST OBS")
    result = parsed(line)
    assert (result.header.time_system, result.header.first_time) == ("BDT", result.table.time(0))
    with pytest.raises(RinexError, match="time system 'XYZ' is unknown"):
        parsed(line.replace("BDT", "XYZ"))


@pytest.mark.parametrize(
    ("text", "label"),
    [
        ("     x.000", "INTERVAL"),
        ("  6378137.0000        x.0000        0.0000", "APPROX POSITION XYZ"),
        ("        0.0000", "ANTENNA: DELTA H/E/N"),
        ("     x", "LEAP SECONDS"),
        ("  1 R01 99", "GLONASS SLOT / FRQ #"),
        ("G L1C  x.00000", "SYS / PHASE SHIFT"),
        ("  2024    13    10     0     0   30.0000000     GPS", "TIME OF FIRST OBS"),
        ("  2024     1    10     0     0                  GPS", "TIME OF LAST OBS"),
    ],
)
def test_a_bad_optional_line_is_a_remark_and_costs_nothing(text, label):
    result = parsed(header_line(text, label))
    assert len(result.table) == 1
    (remark,) = result.remarks
    assert remark.startswith(f"header line is not used: sample:3: {label}") or ":3: GLO" in remark


@pytest.mark.parametrize(
    ("text", "label"),
    [
        ("G    x C1C L1C", "SYS / # / OBS TYPES"),
        ("G    0  1 L1C", "SYS / SCALE FACTOR"),
    ],
)
def test_a_bad_line_that_changes_values_is_an_error(text, label):
    with pytest.raises(RinexError, match=f"sample:3: {label}"):
        parsed(header_line(text, label))


@pytest.mark.parametrize(
    ("types", "signals"),
    [
        # Space-borne receivers: C/A code and both P codes, one phase for each carrier.
        (("L1", "L2", "C1", "P1", "P2"), ["G05 1C", "G05 2W", "G05 1W"]),
        (("L1", "L2", "LA", "CA", "P1", "P2"), ["G05 1W", "G05 2W", "G05 1C"]),
        (("L1", "L2", "P1", "P2"), ["G05 1W", "G05 2W"]),
    ],
)
@pytest.mark.parametrize("version", ["2.10", "2.11", "2.20"])
def test_codes_of_rinex_2(types, signals, version):
    cells = [value(2.0e7 + i) for i in range(len(types))]
    text = header_2(*types, version=version, system="G")
    text += f" 10  7 22  0  0{0.0:11.7f}  0  1G05\n" + "".join(cells[:5]) + "\n"
    text += "".join(cells[5:]) + "\n" if cells[5:] else ""
    result = parse_rinex_observation(text.encode("ascii"), "sample")
    assert sorted(names(result.table)) == sorted(signals)
    assert str(result.table.time(0)).startswith("2010-07-22")

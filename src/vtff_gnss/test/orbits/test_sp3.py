"""SP3 files written here: names, units, epochs, gaps, and lines that are named when damaged."""

import numpy as np
import pytest

from vtff_gnss.orbits.sp3 import parse_sp3
from vtff_gnss.rinex.errors import RinexError

FILE = """\
#cP2020 10 15  0  0  0.00000000       2 ORBIT IGS14 FIT TST
%c G  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
*  2020 10 15  0  0  0.00000000
P  5  12345.678901 -23456.789012      1.000000    123.456789
PG12  -1000.000000   2000.000000   3000.000000 999999.999999
PE 3      0.000000      0.000000      0.000000     10.000000
*  2020 10 15  0 15  0.00000000
PG12  -1001.000000   2001.000000   3001.000000     -1.500000
EOF
"""


def parse(text=FILE):
    return parse_sp3(text.encode(), "file.sp3")


def test_names_units_and_epochs():
    file = parse()
    assert file.satellites == ("E03", "G05", "G12")
    assert len(file) == 2
    assert np.diff(file.time_nanoseconds).tolist() == [900 * 10**9]
    assert file.position_itrf[0, 1].tolist() == pytest.approx([12345678.901, -23456789.012, 1e3])
    assert file.clock_offset[0, 1] == pytest.approx(123.456789e-6, rel=1e-12)
    assert file.clock_offset[1, 2] == pytest.approx(-1.5e-6, rel=1e-12)


def test_what_is_not_known_is_nan():
    file = parse()
    assert np.isnan(file.position_itrf[0, 0]).all() and np.isfinite(file.clock_offset[0, 0])
    assert np.isnan(file.clock_offset[0, 2]) and np.isfinite(file.position_itrf[0, 2]).all()
    assert np.isnan(file.position_itrf[1, :2]).all()


def test_times_of_other_systems_are_gps_time():
    utc = parse(FILE.replace(" cc GPS ", " cc UTC "))
    assert (utc.time_nanoseconds - parse().time_nanoseconds).tolist() == [18 * 10**9] * 2


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("#cP", "#eP", "1: not an SP3 file"),
        ("EOF\n", "", "8: the file ends without EOF"),
        ("0 15  0.0", "0  0  0.0", "7: epoch: not after the one before"),
        ("*  2020 10 15  0  0", "+  2020 10 15  0  0", "4: position: no epoch before it"),
        ("12345.678901", "12345.67890x", "4:   5 x: '12345.67890x' is not a number"),
        ("*  2020 10 15  0 15", "*  2020 13 15  0 15", "7: epoch: "),
        ("%c G  cc GPS", "%c G  cc XYZ", "2: "),
    ],
)
def test_damage_is_named_with_its_line(old, new, reason):
    with pytest.raises(RinexError, match="file.sp3:") as error:
        parse(FILE.replace(old, new, 1))
    assert f"file.sp3:{reason}" in str(error.value)

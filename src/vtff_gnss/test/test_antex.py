"""Phase centres from ANTEX files."""

import math
import pathlib

import numpy as np
import pytest

from vtff_gnss.antex import AntexError, read_antex


def labelled(content: str, label: str) -> str:
    """Return a line of an ANTEX file."""
    return f"{content:<60}{label}\n"


def antex(azimuth_step: float = 0.0, name: str = "PATCH           NONE") -> str:
    """Return a file with two antennas; the second has variations of 10 sin2(zenith) mm."""

    def antenna(antenna_name: str, size: float) -> str:
        zenith_deg = np.arange(0.0, 91.0, 5.0)
        text = labelled("", "START OF ANTENNA") + labelled(antenna_name, "TYPE / SERIAL NO")
        text += labelled(f"  {azimuth_step:6.1f}", "DAZI")
        text += labelled(f"  {0.0:6.1f}{90.0:6.1f}{5.0:6.1f}", "ZEN1 / ZEN2 / DZEN")
        text += labelled(f"{2:6d}", "# OF FREQUENCIES")
        for frequency, factor in (("G01", 1.0), ("G02", 2.0)):
            text += labelled(f"   {frequency}", "START OF FREQUENCY")
            text += labelled(f"{1.0:10.2f}{-2.0:10.2f}{factor * 50:10.2f}", "NORTH / EAST / UP")
            radial = size * factor * np.sin(np.radians(zenith_deg)) ** 2
            text += "   NOAZI" + "".join(f"{value:8.2f}" for value in radial) + "\n"
            if azimuth_step:
                for azimuth_deg in np.arange(0.0, 360.1, azimuth_step):
                    values = radial * math.cos(math.radians(azimuth_deg))
                    text += f"{azimuth_deg:8.1f}" + "".join(f"{v:8.2f}" for v in values) + "\n"
            text += labelled(f"   {frequency}", "END OF FREQUENCY")
        return text + labelled("", "END OF ANTENNA")

    header = labelled("     1.4            M", "ANTEX VERSION / SYST") + labelled(
        "", "END OF HEADER"
    )
    return header + antenna("OTHER           NONE", 1.0) + antenna(name, 10.0)


def written(tmp_path: pathlib.Path, content: str) -> pathlib.Path:
    """Return a file with a content."""
    path = tmp_path / "antennas.atx"
    path.write_text(content, encoding="ascii")
    return path


def direction(zenith_deg: float, azimuth_deg: float = 0.0) -> np.ndarray:
    """Return a unit vector along north, east and up of the antenna."""
    zenith, azimuth = math.radians(zenith_deg), math.radians(azimuth_deg)
    sine = math.sin(zenith)
    return np.array([sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(zenith)])


def test_delay_is_variation_less_projected_offset(tmp_path: pathlib.Path) -> None:
    read = read_antex(written(tmp_path, antex()), "PATCH NONE")
    assert read.antenna == "PATCH NONE" and sorted(read.maps) == ["G01", "G02"]
    assert read.maps["G02"].delay(direction(0.0)) == pytest.approx(-0.100, abs=1e-9)
    for azimuth in (0.0, 77.0, 300.0):
        towards = direction(30.0, azimuth)
        expected = 0.0025 - towards @ [0.001, -0.002, 0.050]
        assert read.maps["G01"].delay(towards) == pytest.approx(expected, abs=1e-8)
    between = direction(32.5)
    mean = 0.5 * (math.sin(math.radians(30.0)) ** 2 + math.sin(math.radians(35.0)) ** 2)
    expected = 0.01 * mean - between @ [0.001, -0.002, 0.050]
    assert read.maps["G01"].delay(between) == pytest.approx(expected, abs=1e-5)
    # Below the last zenith angle it is that of the last.
    low = direction(100.0)
    expected = 0.010 - low @ [0.001, -0.002, 0.050]
    assert read.maps["G01"].delay(low) == pytest.approx(expected, abs=1e-8)


def test_variation_with_azimuth_is_interpolated_across_north(tmp_path: pathlib.Path) -> None:
    read = read_antex(written(tmp_path, antex(azimuth_step=5.0)), "PATCH   NONE").maps["G01"]
    towards = np.array([direction(60.0, azimuth) for azimuth in (0.0, 90.0, 182.5, 357.5)])
    expected = 0.0075 * np.array([1.0, 0.0, -0.999, 0.999]) - towards @ read.offset
    np.testing.assert_allclose(read.delay(towards), expected, atol=2e-5)


@pytest.mark.parametrize(
    ("content", "antenna", "problem"),
    [
        (antex(), "CHOKE NONE", r"antennas.atx: there is no antenna 'CHOKE NONE'"),
        (antex().replace("    2.50", "     abc"), "PATCH NONE", "line [0-9]+: numbers expected"),
        (antex().replace("   5.0 ", "   7.0 "), "PATCH NONE", "line [0-9]+: no grid goes from"),
        (antex().rsplit("   NOAZI", 1)[0], "PATCH NONE", "the file ends within an antenna"),
        (antex(5.0).replace("   355.0", "   NOAZI"), "PATCH NONE", "73 azimuths expected, got 72"),
        (antex().replace("DZEN", "D"), "PATCH NONE", "ZEN1 / ZEN2 / DZEN is missing"),
    ],
)
def test_files_that_cannot_be_used_are_refused_in_one_line(
    tmp_path: pathlib.Path, content: str, antenna: str, problem: str
) -> None:
    with pytest.raises(AntexError, match=problem) as caught:
        read_antex(written(tmp_path, content), antenna)
    assert "\n" not in str(caught.value)

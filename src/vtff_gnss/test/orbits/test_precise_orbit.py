"""SP3 files: what is read, and orbits and clocks between the epochs."""

from __future__ import annotations

import numpy as np
import pytest
from emulated_day import START, write_day

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss.files.navigation_files import open_navigation
from vtff_gnss.files.observation_files import ObservationFileError
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.orbits.precise_orbit import InterpolatedTrack, InterpolationError
from vtff_gnss.orbits.sp3 import parse_sp3, read_sp3
from vtff_gnss.rinex.errors import RinexError


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    return write_day(tmp_path_factory.mktemp("day"), epochs=3)


@pytest.fixture(scope="module")
def truth():
    return EphemerisStore(nominal_gps_constellation(START - 7200.0, START + 93600.0))


def test_orbits_and_clocks_between_epochs(day, truth):
    """To a millimetre and a picosecond; at the ends of the file to some millimetres."""
    orbits = open_navigation([day.orbits]).precise_orbits
    for offset in (0.0, 450.0, 3000.5, 5400.0, 7777.0):
        ours = orbits.table(START + offset).states(START + offset)
        theirs = truth.table(START + offset).states(START + offset)
        error = np.abs(ours.position_itrf - theirs.position_itrf).max()
        assert error < (1e-3 if 3000.0 < offset < 7000.0 else 2e-2)
        assert np.abs(ours.velocity_itrf - theirs.velocity_itrf).max() < 1e-4
        # The file has 1 ps; broadcast clocks are polynomials of hours.
        assert np.abs(ours.clock_offset - theirs.clock_offset).max() < 1e-3 / SPEED_OF_LIGHT + 2e-12
    assert orbits.systems == (0,)


def test_derivatives_are_those_of_the_positions(day):
    orbits = open_navigation([day.orbits]).precise_orbits
    middle, step = START + 5000.0, 1.0
    table = orbits.table(middle)
    before, at, after = (table.states(middle, offset) for offset in (-step, 0.0, step))
    velocity = (after.position_itrf - before.position_itrf) / (2.0 * step)
    np.testing.assert_allclose(at.velocity_itrf, velocity, atol=1e-4)
    acceleration = (after.velocity_itrf - before.velocity_itrf) / (2.0 * step)
    np.testing.assert_allclose(at.acceleration_itrf, acceleration, atol=1e-6)


def test_nothing_is_known_outside_of_the_file(day):
    orbits = open_navigation([day.orbits]).precise_orbits
    assert len(orbits.table(orbits.start)) == len(orbits.table(orbits.end)) > 20
    assert len(orbits.table(orbits.start - 1.0)) == len(orbits.table(orbits.end + 1.0)) == 0
    assert orbits.next_change(orbits.start - 1.0) == orbits.start
    assert orbits.next_change(orbits.start) == orbits.end


def test_a_satellite_without_position_is_left_out_around_the_gap(day):
    """Five polynomials on either side of the gap would reach over it."""
    text = day.orbits.read_text().splitlines()
    row = [i for i, line in enumerate(text) if line.startswith("PG05")][6]
    text[row] = "PG05" + "".join(f"{0.0:14.6f}" for _ in range(3)) + " 999999.999999"
    file = parse_sp3("\n".join(text).encode(), "gap.sp3")
    assert np.isnan(file.position_itrf).any(axis=2).sum() == np.isnan(file.clock_offset).sum() == 1
    track = InterpolatedTrack("gap", file.time_nanoseconds, file.position_itrf)
    column = file.satellites.index("G05")
    assert not track.is_known[6, column] and track.is_known[:, column - 1].all()


def test_the_error_of_interpolation_is_stated(day, tmp_path):
    (remark,) = open_navigation([day.orbits]).remarks
    assert "too short to tell" in remark
    (remark,) = open_navigation([write_day(tmp_path, epochs=3, hours=10).orbits]).remarks
    assert "every 900 s" in remark and "orbits interpolated to" in remark and "clocks to" in remark


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-4], "ends without EOF"),
        (lambda text: text.replace("PG05  ", "PG05 x", 1), r":\d+: G05 x: .* is not a number"),
        (lambda text: text.replace("cc GPS", "cc XYZ"), "time system 'XYZ' is unknown"),
        (lambda text: text.replace("*  2010  7 22", "*  2010 13 22"), "is not a date and time"),
        (lambda text: "#x" + text[2:], "not an SP3 file"),
        (lambda text: text[: text.index("*  ")] + "EOF\n", "no position in this file"),
    ],
)
def test_damaged_files_are_named(day, tmp_path, change, message):
    path = tmp_path / "some.sp3"
    path.write_text(change(day.orbits.read_text()))
    with pytest.raises(RinexError, match=message) as caught:
        read_sp3(path)
    assert "some.sp3" in str(caught.value)


def test_too_few_epochs_are_refused(day, tmp_path):
    lines = day.orbits.read_text().splitlines()
    starts = [i for i, line in enumerate(lines) if line.startswith("*")]
    path = tmp_path / "short.sp3"
    path.write_text("\n".join([*lines[: starts[10]], "EOF", ""]))
    with pytest.raises(ObservationFileError, match="10 epochs; 11 at least"):
        open_navigation([path])
    with pytest.raises(InterpolationError, match="not even steps"):
        times = np.cumsum(np.arange(20)) * 10**9
        InterpolatedTrack("uneven", times, np.zeros((20, 1, 3)))


def test_an_unusable_file_beside_a_good_one_is_a_remark(day, tmp_path):
    bad = tmp_path / "bad.nav"
    bad.write_text("nothing\n")
    found = open_navigation([bad, day.orbits])
    assert found.precise_orbits is not None
    assert found.remarks[0].startswith("not used: ") and "bad.nav" in found.remarks[0]
    with pytest.raises(ObservationFileError, match=r"bad\.nav"):
        open_navigation([bad])


def test_orbits_of_another_day_are_named(day):
    navigation = open_navigation([day.orbits])
    later = np.array([(START + 10 * 86400.0 + k).nanoseconds for k in range(3)])
    with pytest.raises(
        ObservationFileError,
        match=r"gps15935\.sp3: valid from 2010-07-22 00:00 to 2010-07-22 03:00, the observations "
        "of some are of 2010-08-01 00:00",
    ):
        navigation.require_coverage(later, "some")


def test_a_satellite_without_a_clock_is_left_out_where_clocks_are_needed(day, tmp_path):
    lines = day.orbits.read_text().splitlines()
    path = tmp_path / "clocks.sp3"
    path.write_text(
        "\n".join(
            line[:46] + " 999999.999999" if line.startswith("PG05") else line for line in lines
        )
    )
    orbits = open_navigation([path]).precise_orbits
    whole, clocks = orbits.table(START), orbits.with_clocks().table(START)
    assert set(whole.prn.tolist()) - set(clocks.prn.tolist()) == {5}
    assert np.isfinite(clocks.states(START).clock_offset).all()
    with pytest.raises(InterpolationError, match="no satellite clocks"):
        path.write_text(day.own_orbit.read_text().replace("L01", "G01"))
        open_navigation([path]).precise_orbits.with_clocks()

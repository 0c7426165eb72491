"""Electron-density profiles: integrals, models, files."""

from __future__ import annotations

import math
import pathlib
import sys
import types

import numpy as np
import pytest
from scipy.integrate import quad

from vtff_dynamics.time.timescales import parse_epoch
from vtff_sim_bridge.atmosphere.density_models import (
    PLUMEX_BUBBLES,
    ChapmanLayer,
    Depletion,
    bubble_profile,
    chapman_profile,
    constant_profile,
    depleted_profile,
    irregular_profile,
    plumex_like_profile,
    pyiri_profile,
)
from vtff_sim_bridge.atmosphere.electron_density import (
    MOMENT_LENGTH,
    ElectronDensityProfile,
    ProfileError,
    read_profile,
    write_profile,
)


@pytest.fixture(scope="module")
def jicamarca():
    """PyIRI over Jicamarca at 2016-03-21 01:00 UTC, F10.7 = 90: one column of its output."""
    table = pathlib.Path(__file__).with_name("pyiri_jicamarca_20160321T01.csv")
    return read_profile(table, "90_SH URSI SHU2015")


def test_vtec_of_the_model_table(jicamarca):
    # Values of the model integrated elsewhere, TECU to one or two decimals.
    expected = {250e3: 17.3, 300e3: 16.3, 350e3: 13.2, 400e3: 8.9, 470e3: 4.8}
    for altitude, vtec in expected.items():
        assert jicamarca.vtec_above_tecu(altitude) == pytest.approx(vtec, abs=0.05)


def test_vtec_between_table_points_is_the_quadrature(jicamarca):
    for altitude in (123e3, 291.7e3, 352e3, 1998e3):
        points = jicamarca.altitude[
            (jicamarca.altitude > altitude) & (jicamarca.altitude < altitude + 60e3)
        ]
        expected, _ = quad(
            jicamarca.density, altitude, altitude + 60e3, points=points, limit=200, epsabs=1.0
        )
        content = jicamarca.mean_density(altitude, altitude + 60e3) * 60e3
        assert content == pytest.approx(expected, rel=1e-10)
        difference = np.subtract(*jicamarca.vtec_above_tecu([altitude, altitude + 60e3]))
        assert difference * 1e16 == pytest.approx(expected, rel=1e-8)


def test_moments_are_the_quadrature():
    profile = ElectronDensityProfile([100e3, 180e3, 250e3, 700e3], [0.0, 4e11, 1e12, 1e10])
    moments = profile.cumulative_moments(421e3)
    for j in range(4):
        expected, _ = quad(
            lambda h, j=j: profile.density(h) * ((h - 250e3) / MOMENT_LENGTH) ** j,
            100e3,
            421e3,
            points=[180e3, 250e3],
        )
        assert moments[j] == pytest.approx(expected, rel=1e-10)


def test_outside_the_table_nothing_is_added(jicamarca):
    assert jicamarca.density([0.0, 79e3, 30000e3]) == pytest.approx([0.0, 0.0, 0.0], abs=0.0)
    whole = jicamarca.vtec_above_tecu(jicamarca.altitude_bottom)
    assert jicamarca.vtec_above_tecu([-1e3, 0.0]) == pytest.approx([whole, whole], rel=1e-15)
    assert jicamarca.vtec_above_tecu([20200e3, 40000e3]) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_chapman_content_is_the_analytic_one():
    # The integral of exp((1 - z - exp(-z)) / 2) over all z is sqrt(2 pi e).
    profile = chapman_profile([ChapmanLayer(1e12, 350e3, 40e3, 40e3)])
    expected = math.sqrt(2.0 * math.pi * math.e) * 1e12 * 40e3 / 1e16
    assert profile.vtec_above_tecu(0.0) == pytest.approx(expected, rel=1e-6)


def test_chapman_layers_add():
    layers = [ChapmanLayer(1e12, 350e3, 40e3, 60e3), ChapmanLayer(1e11, 110e3, 8e3, 12e3)]
    both = chapman_profile(layers)
    assert both.density(350e3) == pytest.approx(1e12 + layers[1].density(350e3), rel=1e-9)
    assert both.altitude_peak == pytest.approx(350e3, abs=300.0)


def test_constant_profile():
    profile = constant_profile(5e11, 200e3, 800e3)
    assert profile.vtec_above_tecu(500e3) == pytest.approx(15.0, rel=1e-12)
    assert profile.density([199e3, 200e3, 800e3, 801e3]) == pytest.approx([0, 5e11, 5e11, 0])


def test_bubble_meets_both_values(jicamarca):
    profile = bubble_profile(jicamarca)
    assert profile.vtec_above_tecu([290e3, 350e3]) == pytest.approx([30.17, 30.10], abs=1e-9)
    # The factor for F10.7 = 90 and the density inside of the facts.
    assert profile.density(400e3) / jicamarca.density(400e3) == pytest.approx(2.27, abs=0.01)
    assert profile.density(320e3) == pytest.approx(1.2e10, rel=0.1)
    for edge in (290e3, 350e3):
        inside, outside = sorted(profile.density([edge - 50.0, edge + 50.0]))
        assert inside == pytest.approx(profile.density(320e3), rel=1e-12)
        assert outside > 20.0 * inside
        assert profile.density(edge) == pytest.approx(0.5 * (inside + outside), rel=1e-9)


def test_bubble_that_cannot_be_is_refused(jicamarca):
    with pytest.raises(ProfileError, match="bubble: VTEC of 30 and 31 TECU"):
        bubble_profile(jicamarca, vtec_bottom_tecu=30.0, vtec_top_tecu=31.0)
    with pytest.raises(ProfileError, match="no electrons above"):
        bubble_profile(constant_profile(1e12, 100e3, 200e3))


def test_depletion_takes_its_depth():
    background = constant_profile(1e12, 200e3, 800e3)
    profile = depleted_profile(background, [Depletion(300e3, 340e3, 0.7, 100.0)])
    missing = background.vtec_above_tecu(0.0) - profile.vtec_above_tecu(0.0)
    assert missing == pytest.approx(0.7 * 1e12 * 40e3 / 1e16, rel=1e-9)
    assert profile.density([299.9e3, 320e3, 340.1e3]) == pytest.approx([1e12, 3e11, 1e12])


@pytest.mark.parametrize(
    ("depth", "edge_width", "message"), [(1.5, 100.0, "depth"), (0.5, 50e3, "edge_width")]
)
def test_impossible_depletion_is_refused(depth, edge_width, message):
    with pytest.raises(ProfileError, match=message):
        Depletion(300e3, 340e3, depth, edge_width)


def test_irregularities_have_their_rms_and_spectrum():
    smooth = constant_profile(1e12, 100e3, 700e3)
    slopes = []
    for seed in range(8):
        profile = irregular_profile(smooth, 200e3, 600e3, 0.05, seed)
        relative = profile.density(np.arange(200e3, 600e3, 50.0)) / 1e12 - 1.0
        assert math.sqrt(np.mean(relative**2)) == pytest.approx(0.05, rel=1e-9)
        power = np.abs(np.fft.rfft(relative)) ** 2
        wavelength = 400e3 / np.arange(1, len(power))
        used = (wavelength < 25e3) & (wavelength > 200.0)
        slope, _ = np.polyfit(-np.log(wavelength[used]), np.log(power[1:][used]), 1)
        slopes.append(slope)
    assert np.mean(slopes) == pytest.approx(-2.5, abs=0.05)


def test_irregularities_are_seeded():
    smooth = constant_profile(1e12, 100e3, 700e3)
    first, again, other = (irregular_profile(smooth, 200e3, 600e3, 0.05, s) for s in (1, 1, 2))
    assert np.array_equal(first.density_per_m3, again.density_per_m3)
    assert not np.allclose(first.density_per_m3, other.density_per_m3)


def test_plumex_like_profile():
    smooth = plumex_like_profile(1, rms_relative=0.0)
    assert smooth.density(388e3) == pytest.approx(1.3e12, rel=0.05)
    for bubble in PLUMEX_BUBBLES:
        middle = 0.5 * (bubble.altitude_bottom + bubble.altitude_top)
        rims = smooth.density([bubble.altitude_bottom - 2e3, bubble.altitude_top + 2e3])
        assert smooth.density(middle) < (1.0 - 0.8 * bubble.depth) * rims.max()
    # The ledge: the density rises by more than a factor of five within 20 km.
    assert smooth.density(270e3) > 5.0 * smooth.density(250e3)
    rough = plumex_like_profile(1)
    altitude = np.arange(236e3, 567e3, 100.0)
    relative = rough.density(altitude) / smooth.density(altitude) - 1.0
    assert 0.03 < math.sqrt(np.mean(relative**2)) < 0.07


def test_pyiri_absent_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "PyIRI", None)
    with pytest.raises(ProfileError, match="optional package PyIRI"):
        pyiri_profile(parse_epoch("2016-03-21T01:00:00 UTC"), -0.2, -1.3, 90.0)


def test_pyiri_is_asked_in_its_units(monkeypatch):
    asked = {}

    def density_1day(year, month, day, hours, longitude, latitude, altitude, f10_7):
        asked.update(date=(year, month, day), hours=hours, place=(latitude, longitude), f=f10_7)
        # Layers and geometry come first, the density (times, altitudes, places) last.
        return {}, {}, {}, (altitude * 1e9)[None, :, None]

    package = types.ModuleType("PyIRI")
    package.sh_library = types.SimpleNamespace(IRI_density_1day=density_1day)
    monkeypatch.setitem(sys.modules, "PyIRI", package)
    monkeypatch.setitem(sys.modules, "PyIRI.sh_library", package.sh_library)
    time = parse_epoch("2016-03-21T01:30:00 UTC")
    profile = pyiri_profile(time, math.radians(-12.0), math.radians(-77.0), 90.0)
    assert asked["date"] == (2016, 3, 21)
    assert asked["hours"] == pytest.approx([1.5])
    assert np.concatenate(asked["place"]) == pytest.approx([-12.0, -77.0])
    assert asked["f"] == 90.0
    assert profile.density(300e3) == pytest.approx(300e9)


def test_written_profile_is_read_back(tmp_path):
    profile = plumex_like_profile(4)
    path = tmp_path / "profile.csv"
    write_profile(path, profile, "PLUMEX-like, synthetic\nseed 4")
    again = read_profile(path)
    assert np.array_equal(again.altitude, profile.altitude)
    assert np.array_equal(again.density_per_m3, profile.density_per_m3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no header line"),
        ("height,density_per_m3\n1,2\n", "first column must be one of altitude_m"),
        ("altitude_m,ne\n1,2\n", "no column 'density_per_m3'; there are ne"),
        ("altitude_m,density_per_m3\n1,2\n# remark\n2,x\n", "line 4: not a row of numbers"),
        ("altitude_m,density_per_m3\n1,2\n2\n", "line 3: not a row of numbers"),
        ("altitude_m,density_per_m3\n1,2\n", "length >= 2"),
        ("altitude_m,density_per_m3\n2,2\n1,2\n", "must increase strictly, got 2 then 1 m"),
        ("altitude_m,density_per_m3\n1,2\n2,-2\n", "must not be negative, got -2 at 2 m"),
        ("altitude_m,density_per_m3\n1,2\n2,nan\n", "must be finite"),
    ],
)
def test_bad_file_is_named(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ProfileError, match=message) as caught:
        read_profile(path)
    assert str(path) in str(caught.value)

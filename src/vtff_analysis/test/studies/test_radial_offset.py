"""`vtff study radial_offset`: the paper's ordering and the scales at which spectra depart."""

from __future__ import annotations

import csv
import math
import pathlib

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from full_run_samples import SECOND, START, BagOfMessages  # noqa: E402
from rich.console import Console  # noqa: E402

from vtff_analysis.studies.radial_offset import (  # noqa: E402
    OFFSETS,
    OffsetError,
    flown_offset,
    run_offsets,
)
from vtff_analysis.studies.radial_offset_output import (  # noqa: E402
    results_table,
    write_csv,
    write_profiles_plot,
    write_spectra_plot,
)
from vtff_bag.file.errors import BagReadError  # noqa: E402
from vtff_bag.run.description import RunDescription  # noqa: E402
from vtff_iono.density.density_profile import COMPARISON_ALTITUDES  # noqa: E402
from vtff_msgs.msg import ElectronDensity, OrbitState  # noqa: E402
from vtff_sim_bridge.atmosphere.electron_density import read_profile  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[4]
TABLE = ROOT / "config" / "ionosphere" / "plumex.csv"
SAMPLE = ROOT / "bags" / "sample"


@pytest.fixture(scope="module")
def results():
    return run_offsets(read_profile(TABLE))


def test_noise_falls_with_the_offset_as_in_the_paper(results):
    errors = [result.mean_error for result in results]
    assert errors == sorted(errors, reverse=True)
    # Section 4.4 of the paper: 75 dB on 30 TECU give about 6e4 cm-3 at 1 km.
    assert errors[1] == pytest.approx(6e10, rel=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_spectra_depart_at_twice_the_offset_and_deconvolved_ones_nearer_to_it(seed):
    for result in run_offsets(read_profile(TABLE), [3000.0, 10_000.0], seed=seed):
        assert result.departure == pytest.approx(2.0 * result.offset, rel=0.15)
        assert result.departure_deconvolved < result.departure


def test_what_noise_hides_is_told_as_such(results):
    """At 100 m of the model even the bubbles, 30 to 60 km, are near the noise (section 4.4)."""
    smallest = results[0]
    assert math.isnan(smallest.departure)
    assert 20e3 < smallest.resolved < 60e3
    assert smallest.resolved > max(result.resolved for result in results[1:])


def test_the_best_offsets_are_those_of_the_paper(results):
    """1 and 3 km resolve finer structures than 100 m, in the noise, and 10 km, the average."""
    best = sorted(results, key=lambda result: result.resolved)[:2]
    assert {result.offset for result in best} == {1000.0, 3000.0}


POLAR_RADIUS = 6_356_752.3  # m
GNSS_FILE = ROOT / "config" / "gnss" / "plumex.yaml"
RATE = 800.0
"""Vertical velocity of the drawn flight, m/s."""
SIGMA = 1e10
"""Noise of the drawn densities, electrons per cubic metre."""


def write_flight(folder, offset, lowest=COMPARISON_ALTITUDES[0]):
    """Write a drawn flight above the pole, which falls and rises again; return its folder.

    On the falling leg, and for single satellites, the densities are nonsense.
    """
    profile, generator = read_profile(TABLE), np.random.default_rng(1)
    described = RunDescription(arguments={"gnss": str(GNSS_FILE)})
    bag = BagOfMessages(folder, described.as_custom_data())
    falling = 40
    rising = math.ceil((COMPARISON_ALTITUDES[1] + 2.0 * offset - lowest) / RATE)
    for second in range(falling + rising):
        time = START + second * SECOND
        chief = lowest + RATE * abs(second - falling) + offset
        for craft, altitude in (("chief", chief), ("deputy", chief - offset)):
            orbit = OrbitState(child_frame_id=craft)
            orbit.header.frame_id = "gcrf"
            orbit.position = [0.0, 0.0, POLAR_RADIUS + altitude]
            bag.add(f"/{craft}/truth/orbit", time, orbit)
        true = float(profile.mean_density(np.array([chief - offset]), np.array([chief]))[0])
        measured = true + SIGMA * generator.standard_normal() if second > falling else 9e12
        message = ElectronDensity(altitude=chief - 0.5 * offset, vertical_separation=-offset)
        message.system, message.prn = [0, 255], [7, 0]
        message.density, message.density_sigma = [5e12, measured], [1e9, SIGMA]
        bag.add("/deputy/iono/electron_density", time, message)
    bag.writer.close()
    return folder


@pytest.mark.parametrize("offset", [3000.0, 10_000.0])
def test_a_drawn_flight_shows_the_scales_of_the_paper(offset, tmp_path):
    """The short form of test_graph_radial_offset.py, which flies an hour for each offset."""
    result = flown_offset(write_flight(tmp_path / "run", offset), offset)
    assert (result.source, result.offset) == ("flown", offset)
    # The middles of all pairs of spacecraft between the altitudes of the paper's comparison.
    lowest, highest = COMPARISON_ALTITUDES
    assert 0.0 <= result.altitude[0] - (lowest + 0.5 * offset) < 1.1 * RATE
    assert 0.0 <= highest - 0.5 * offset - result.altitude[-1] < 2.0 * RATE
    assert result.departure == pytest.approx(2.0 * offset, rel=0.15)
    assert result.departure_deconvolved < 0.85 * result.departure
    assert result.mean_error == pytest.approx(math.sqrt(2.0 / math.pi) * SIGMA, rel=0.15)


def test_a_flight_with_few_densities_on_its_rising_leg_is_refused(tmp_path):
    run = write_flight(tmp_path / "run", 1000.0, lowest=420e3)
    with pytest.raises(OffsetError, match="densities between 236 and 567 km .* 200 are needed"):
        flown_offset(run, 1000.0)


def test_a_run_that_is_not_of_the_study_is_refused():
    with pytest.raises(BagReadError, match="/deputy/iono/electron_density"):
        flown_offset(SAMPLE, 1000.0)


def test_table_and_plots(results, tmp_path):
    write_csv(results, tmp_path / "radial_offset.csv")
    rows = list(csv.DictReader((tmp_path / "radial_offset.csv").open()))
    assert [float(row["offset_m"]) for row in rows] == list(OFFSETS)
    assert rows[0]["departure_m"] == ""
    console = Console(width=100, record=True)
    console.print(results_table(results))
    assert "in noise" in console.export_text()
    for write, name in ((write_profiles_plot, "profiles.png"), (write_spectra_plot, "spectra.png")):
        write(results, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 10_000

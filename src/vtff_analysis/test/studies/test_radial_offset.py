"""`vtff study radial_offset`: the paper's ordering and the scales at which spectra depart."""

from __future__ import annotations

import csv
import math
import pathlib

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from rich.console import Console  # noqa: E402

from vtff_analysis.studies.radial_offset import OFFSETS, flown_offset, run_offsets  # noqa: E402
from vtff_analysis.studies.radial_offset_output import (  # noqa: E402
    results_table,
    write_csv,
    write_profiles_plot,
    write_spectra_plot,
)
from vtff_bag.file.errors import BagReadError  # noqa: E402
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


def test_a_run_that_is_not_of_the_study_is_refused():
    with pytest.raises(BagReadError, match="/formation/electron_density"):
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

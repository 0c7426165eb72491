"""`vtff study radial_offset`: the paper's ordering and the scales at which spectra depart."""

from __future__ import annotations

import csv
import pathlib

import pytest

from vtff_bringup.studies.radial_offset import OFFSETS, run_offsets, write_csv, write_plot
from vtff_sim_bridge.atmosphere.electron_density import read_profile

TABLE = pathlib.Path(__file__).resolve().parents[3] / "config" / "ionosphere" / "plumex.csv"


@pytest.fixture(scope="module")
def results():
    return run_offsets(read_profile(TABLE))


def test_noise_falls_with_the_offset_as_in_the_paper(results):
    errors = [result.mean_error for result in results]
    assert errors == sorted(errors, reverse=True)
    # Section 4.4 of the paper: 75 dB on 30 TECU give about 6e4 cm-3 at 1 km.
    assert errors[1] == pytest.approx(6e10, rel=0.1)


def test_spectra_depart_at_twice_the_offset_and_deconvolved_ones_nearer_to_it(results):
    for result in results:
        if result.offset >= 3000.0:
            assert result.departure == pytest.approx(2.0 * result.offset, rel=0.15)
            assert result.offset < result.departure_deconvolved < result.departure


def test_table_and_plot(results, tmp_path):
    write_csv(results, tmp_path / "radial_offset.csv")
    rows = list(csv.DictReader((tmp_path / "radial_offset.csv").open()))
    assert [float(row["offset_m"]) for row in rows] == list(OFFSETS)
    write_plot(results, tmp_path / "radial_offset.png")
    assert (tmp_path / "radial_offset.png").stat().st_size > 10_000

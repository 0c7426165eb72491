"""`vtff study radial_offset` with flights: the scales that the paper's figure 13 shows."""

from __future__ import annotations

import csv

import pytest
from graph_support import run_vtff

OFFSETS = (3000, 10_000)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "out"
    options = [option for offset in OFFSETS for option in ("--offset", offset)]
    outcome = run_vtff("study", "radial_offset", *options, "--out", folder, timeout=1800.0)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    return folder


def rows_of(folder):
    with (folder / "radial_offset.csv").open() as stream:
        return {(row["source"], float(row["offset_m"])): row for row in csv.DictReader(stream)}


@pytest.mark.slow
@pytest.mark.parametrize("offset", OFFSETS)
def test_flown_spectra_depart_at_twice_the_offset(study, offset):
    flown = rows_of(study)["flown", offset]
    assert float(flown["departure_m"]) == pytest.approx(2.0 * offset, rel=0.15)
    assert float(flown["departure_deconvolved_m"]) < 0.85 * float(flown["departure_m"])


@pytest.mark.slow
def test_flown_noise_falls_with_the_offset(study):
    rows = rows_of(study)
    errors = [float(rows["flown", offset]["mean_error_per_m3"]) for offset in OFFSETS]
    assert errors == sorted(errors, reverse=True)
    for offset in OFFSETS:
        assert float(rows["flown", offset]["mean_error_per_m3"]) <= 2e10


@pytest.mark.slow
def test_a_complete_flight_is_not_flown_again(study, tmp_path):
    again = tmp_path / "again"
    outcome = run_vtff(
        "study", "radial_offset", "--offset", 3000, "--runs", study / "runs", "--out", again
    )
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    assert "1 of 1 cases are finished already" in outcome.stdout
    assert rows_of(again)["flown", 3000.0] == rows_of(study)["flown", 3000.0]

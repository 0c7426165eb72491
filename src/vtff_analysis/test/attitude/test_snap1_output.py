"""Table and figures of the SNAP-1 study."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from vtff_analysis.attitude.snap1 import fly_dipole_estimation
from vtff_analysis.attitude.snap1_output import run_snap1


def test_dipole_of_a_log_is_found_and_is_that_of_its_seed():
    first, again = (fly_dipole_estimation(0.0, 240, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first.dipole, again.dipole)
    error = np.abs(first.dipole - first.true_dipole)
    assert (error[120:] < 10e-3).all()
    assert (error[-1] < 4.0 * first.sigma[-1]).all()


@pytest.mark.slow
def test_study_writes_every_figure_and_the_table(tmp_path):
    found = run_snap1(tmp_path, hours=5.0, say=lambda _: None)
    rows = found.rows
    assert "paper 55" in found.sentence
    names = {path.name for path in tmp_path.iterdir()}
    # Beside each figure stand its lines, for the page of the study.
    endings = ("png", "lines.json")
    figures = {f"figure_{number}.{ending}" for number in range(2, 12) for ending in endings}
    assert names == {"snap1.csv"} | figures
    with (tmp_path / "snap1.csv").open() as stream:
        table = list(csv.DictReader(stream))
    assert len(table) == len(rows)
    assert {"paper", "measured"} <= set(table[0])

"""`vtff study fflas` as a whole; its parts have tests of their own."""

import csv

import pytest

from vtff_analysis.fflas.output import run_fflas


@pytest.mark.slow
def test_table_and_figures(tmp_path):
    found = run_fflas(tmp_path, days=0.1, say=lambda _: None)
    rows = found.rows
    assert "mm/s a day" in found.sentence
    numbers = (4, 5, 6, 9, 10, 11, 12, 13, 14, 15)
    names = {path.name for path in tmp_path.iterdir() if not path.name.endswith(".lines.json")}
    assert names == {"fflas.csv", "figure_4.csv", *(f"figure_{n}.png" for n in numbers)}
    with (tmp_path / "fflas.csv").open() as stream:
        written = list(csv.DictReader(stream))
    assert [row["measured"] for row in written] == [row.measured for row in rows]
    assert any("impossible" in row.measured for row in rows)

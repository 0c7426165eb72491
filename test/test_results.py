"""Results on the pages are those of the fragments, and each row says how to measure it again."""

from __future__ import annotations

import json
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
FRAGMENTS = sorted((ROOT / "benchmarks/results").glob("*.json"))
sys.path.insert(0, str(ROOT / "benchmarks"))

import tables  # noqa: E402
from bench_flights import flight_row, ionosphere_rows, truth_fed_row  # noqa: E402
from tables import markdown_table, write_rows  # noqa: E402


def test_pages_are_written_from_the_fragments():
    """`python benchmarks/write_results.py` brings both pages up to date."""
    script = ROOT / "benchmarks/write_results.py"
    checked = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda path: path.stem)
def test_every_row_has_what_repeats_it(fragment):
    content = json.loads(fragment.read_text(encoding="utf-8"))
    assert not content["script"] or (ROOT / "benchmarks" / content["script"]).is_file()
    names = [row["cells"][0] for row in content["rows"]]
    assert len(names) == len(set(names))
    for row in content["rows"]:
        assert len(row["cells"]) == len(content["columns"])
        assert row["conditions"] and row["seeds"] and row["date"], row["cells"][0]
        if row["version"]:  # a figure of vtff, not of a paper
            assert row["machine"], row["cells"][0]
            program, *_ = row["command"].split()
            assert program in {"python", "vtff"}, row["command"]


@pytest.fixture
def results(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    row = {"cells": ["a", "1"], "conditions": "ideal", "command": "", "seeds": "1"}
    fragment = {"title": "T", "script": "", "note": "", "columns": ["what", "mm"], "rows": [row]}
    (tmp_path / "t.json").write_text(json.dumps(fragment))
    return tmp_path


def test_a_row_replaces_the_one_of_its_name(results, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["benchmarks/bench_x.py", "--seeds", "3", "--write"])
    write_rows("t", ("what", "mm"), [["a", "2"], ["b", "3"]], "1 to 3")
    first, second = json.loads((results / "t.json").read_text())["rows"]
    assert first["cells"] == ["a", "2"] and first["conditions"] == "ideal"
    assert first["command"] == "python benchmarks/bench_x.py --seeds 3"
    assert first["seeds"] == "1 to 3" and first["version"] and first["machine"]
    assert second["cells"] == ["b", "3"]


def test_other_columns_are_refused(results):
    with pytest.raises(ValueError, match="columns"):
        write_rows("t", ("what", "m"), [["a", "2"]])


def test_bars_in_cells_do_not_end_them():
    assert markdown_table(("a",), [["x | y"]]).splitlines()[2] == "| x \\| y |"


def test_figures_of_flights_come_from_their_summaries():
    axes = ("radial", "in_track", "cross_track")
    summary = {f"settled_keeping_{axis}_rms_m": 1e-3 * n for n, axis in enumerate(axes, 1)}
    summary |= {"navigation_error_settled_3d_rms_m": 1.5e-3, "minimum_in_track_m": 38.2}
    row = flight_row("realistic", summary)
    assert row[:3] == ["realistic", "1.00 / 2.00 / 3.00", "-"] and row[4] == "1.50"
    assert truth_fed_row("x", summary)[1:4] == ["38.20", "-", "-"]
    summary = {
        "ionosphere_separation_rising_m": 1014.0,
        "ionosphere_true_separation_rising_m": 1000.0,
        "ionosphere_chief_slant_tec_error_rms_tecu": 0.14,
        "ionosphere_deputy_slant_tec_error_rms_tecu": 0.28,
    }
    rows = {row[0]: row[1] for row in ionosphere_rows("esf", summary)}
    assert rows["separation in altitude from edges, esf"].startswith("1.4 %")
    assert rows["absolute slant TEC, esf"] == "0.14 and 0.28 TECU RMS"
    assert "electron density, esf" not in rows

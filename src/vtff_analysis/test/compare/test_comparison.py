"""Comparison of runs: the numbers of each, parts that only one has, equal names."""

import dataclasses
import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

import full_run_samples  # noqa: E402

from vtff_analysis.compare.common_epochs import summarise_common_epochs  # noqa: E402
from vtff_analysis.compare.comparison import (  # noqa: E402
    comparison_rows,
    comparison_table,
    names_of_runs,
    read_compared_run,
)
from vtff_analysis.compare.page import render_comparison  # noqa: E402
from vtff_analysis.evaluation.navigation import NavigationError  # noqa: E402
from vtff_bringup.cli import make_app  # noqa: E402

BIAS = 0.25  # m, of the navigated in-track position of the second run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    first = full_run_samples.write_full_run(folder / "good", seconds=150)
    second = full_run_samples.write_full_run(folder / "biased", seconds=150, bias=BIAS)
    return first, second


def row(runs, label):
    for _, rows in comparison_rows(runs):
        for shown, values in rows:
            if shown.label.strip() == label:
                return values
    raise AssertionError(label)


def test_numbers_of_each_run_stand_side_by_side(runs):
    compared = [read_compared_run(path, path.name) for path in runs]
    good, biased = row(compared, "RMS in-track, mm")
    # Squares of the same noise with and without the bias differ by its square.
    assert biased**2 - good**2 == pytest.approx(BIAS**2, rel=0.3)
    assert row(compared, "closest approach, m")[0] == row(compared, "closest approach, m")[1]
    fixed = row(compared, "fixed, % of the time")
    assert fixed == pytest.approx([100.0 * 90 / 145] * 2)
    assert row(compared, "first fixed, s") == pytest.approx([61.0, 61.0])
    # The medians of the two nodes that acknowledge every step.
    latency = row(compared, "of a step, sum of nodes, median, ms")
    assert latency == pytest.approx([2.1, 2.1], rel=0.1)
    assert row(compared, "mean vertical TEC, TECU") == pytest.approx([13.5, 13.5], abs=0.01)


def error_of(time, position, settled_from=0.0):
    count = len(time)
    return NavigationError(
        np.asarray(time, dtype=float),
        np.asarray(position, dtype=float),
        *(np.zeros((count, 3)) for _ in range(3)),
        np.asarray(time) >= settled_from,
        np.zeros((count, 3, 3)),
    )


def test_a_filter_that_leaves_the_hard_epochs_out_does_not_look_better():
    """One of the misleading cases: RMS over 141 epochs beside RMS over 80, unmarked."""
    time = np.arange(141.0)
    hard = time >= 80.0
    steady = np.where(hard, 0.2, 0.01)[:, np.newaxis] * np.ones(3)
    worse = np.full((80, 3), 0.02)
    whole, partial = summarise_common_epochs([error_of(time, steady), error_of(time[:80], worse)])
    assert (whole["navigation_epochs"], partial["navigation_epochs"]) == (141, 80)
    assert whole["navigation_common_epochs"] == partial["navigation_common_epochs"] == 80
    # Over its own epochs the first has 0.13 m.
    assert whole["navigation_common_radial_rms_m"] == pytest.approx(0.01)
    assert partial["navigation_common_radial_rms_m"] == pytest.approx(0.02)


def test_settled_figures_are_of_epochs_that_are_settled_in_every_run():
    time = np.arange(100.0)
    starting = np.where(time < 60.0, 5.0, 1.0)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    early, late = summarise_common_epochs(
        [error_of(time, starting, 10.0), error_of(time + 3e-5, starting, 60.0)]
    )
    assert early["navigation_common_settled_epochs"] == 40
    for summary in (early, late):
        assert summary["navigation_common_settled_3d_rms_m"] == pytest.approx(1.0)


def test_runs_without_a_common_epoch_have_no_error():
    (first, _) = summarise_common_epochs(
        [error_of([0.0], [[1, 1, 1]]), error_of([1.0], [[1, 1, 1]])]
    )
    assert first["navigation_common_radial_rms_m"] is None
    assert first["navigation_common_maximum_m"] is None


def test_the_difference_of_two_runs_has_its_sign(runs):
    heads, sections = comparison_table([read_compared_run(path, path.name) for path in runs])
    assert heads[:3] == ["good", "biased", "difference"]
    texts = {label.strip(): texts for _, rows in sections for label, texts in rows}
    good, biased, difference = texts["RMS in-track, mm"][:3]
    assert float(difference) == pytest.approx(float(biased) - float(good), abs=2e-3)
    assert difference.startswith("+")


def test_flights_of_different_lengths_are_compared_over_what_both_have(runs):
    whole, other = (read_compared_run(path, path.name) for path in runs)
    cut = {name: flight.until(130.0) for name, flight in other.flights.items()}
    short = dataclasses.replace(other, flights=cut)
    assert row([whole, short], "compared, s") == [130.0, 130.0]
    lengths = [run.flights["deputy"].time[-1] for run in (whole, short)]
    assert lengths[0] > lengths[1] == 130.0
    rows = [row for _, rows in comparison_rows([whole, short]) for row in rows]
    for shown, values in rows:
        if shown.key.startswith(("keeping_", "delta_v_", "minimum_")):
            assert values[0] == pytest.approx(values[1]), shown.key


def test_numbers_of_the_paper_stand_in_their_rows_alone(runs):
    """Three sections have a row "radial": none may take the total dv of the paper for its own."""
    run = read_compared_run(runs[0], "run")
    run.summary["scenario"] = "reference"
    run.summary["run_duration_s"] = 3600.0
    heads, sections = comparison_table([run])
    paper = heads.index("paper HIL")
    texts = {(head, label): row[paper] for head, rows in sections for label, row in rows}
    assert texts["dv total, m/s", "  radial"] == "5.63"
    assert texts["dv acquisition, m/s", "  radial"] == ""
    assert texts["dv acquisition, m/s", "  in-track"] == "75.45"
    assert texts["dv keeping, m/s", "  in-track"] == "1.44"
    run.summary["run_duration_s"] = 600.0  # too short for totals
    assert dict(comparison_table([run])[1])["dv total, m/s"][0][1][paper] == ""


def test_thrust_is_summed_per_axis_and_phase(runs):
    compared = [read_compared_run(path, path.name) for path in runs]
    sections = dict(comparison_rows(compared))
    spent = {row.label.strip(): values for row, values in sections["dv acquisition, m/s"]}
    assert spent["in-track"] == pytest.approx([5.0, 5.0])  # 0.5 m/s2 for ten steps of 1 s
    assert spent["radial"] == [0.0, 0.0]


def test_command_prints_writes_and_draws(runs, tmp_path):
    arguments = ["compare", *map(str, runs), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(make_app(), arguments)
    assert result.exit_code == 0, result.output
    assert "good" in result.output and "biased" in result.output
    content = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert set(content) == {"good", "biased"}
    page = (tmp_path / "out" / "comparison.html").read_text()
    assert page.count("data:image/png") == 3 and "epochs that all have" in page
    assert "paper software" in page and "<script src" not in page
    pictures = sorted(path.name for path in (tmp_path / "out").glob("*.png"))
    assert pictures == [
        "compare_delta_v.png",
        "compare_navigation_error.png",
        "compare_position.png",
    ]


def test_runs_of_one_name_are_numbered(runs):
    assert names_of_runs([runs[0], runs[0], runs[1]]) == ["good (1)", "good (2)", "biased"]


def test_one_bag_or_none_is_a_usage_error(runs, tmp_path):
    for paths in ([runs[0]], [runs[0], tmp_path / "nothing"]):
        result = CliRunner().invoke(make_app(), ["compare", *map(str, paths)])
        assert result.exit_code == 2
        assert "error:" in result.output and "Traceback" not in result.output


def test_a_shorter_run_takes_figures_of_the_common_time_alone(runs, tmp_path):
    """Keeping begins at 125 s: a run of 100 s has none, and nothing to compare it with."""
    short = full_run_samples.write_full_run(tmp_path / "short", seconds=100)
    compared = [read_compared_run(path, path.name) for path in (runs[0], short)]
    labels = [shown.label for _, rows in comparison_rows(compared) for shown, _ in rows]
    assert "closest approach, m" in labels
    assert not [label for label in labels if label.startswith("keeping RMS")]


def test_the_page_opens_with_the_result_and_with_what_else_differs(runs):
    good, biased = (read_compared_run(path, path.name) for path in runs)
    page = render_comparison([good, biased], [], "vtff compare good biased")
    assert "vtff compare good biased" in page
    lead = re.search(r'class="sentence">([^<]*)<', page)[1]
    errors = re.search(r"errs by ([\d.]+) (m?m) in good and ([\d.]+) (m?m) in biased", lead)
    first, second = (float(errors[n]) * (1e-3 if errors[n + 1] == "mm" else 1.0) for n in (1, 3))
    assert second**2 - first**2 == pytest.approx(BIAS**2, rel=0.3)
    assert "differ" not in lead
    other = dataclasses.replace(biased, summary={**biased.summary, "run_seed": 99})
    page = render_comparison([good, other], [])
    lead = re.search(r'class="sentence">([^<]*)<', page)[1]
    assert "differ in seed" in lead and "verdict bad" in page

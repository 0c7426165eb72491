"""The studies of the paper as commands: campaigns with plots and tables."""

from __future__ import annotations

import csv

import pytest
from campaign_samples import ROOT
from typer.testing import CliRunner

pytest.importorskip("rclpy", reason="needs ROS 2")

from vtff_analysis.plot_style import make_figure, save_figure  # noqa: E402
from vtff_bringup.commands import study  # noqa: E402
from vtff_bringup.commands.study import app  # noqa: E402


def test_radial_offset_with_the_model_alone(tmp_path):
    arguments = ["radial_offset", "--model", "--offset", "3000", "--out", str(tmp_path / "study")]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 0, outcome.output
    assert "retrieved 1 of 1 offsets" in outcome.output  # also without a terminal
    names = {path.name for path in (tmp_path / "study").iterdir()}
    # Lines of pictures may stand beside them.
    names = {name for name in names if not name.endswith(".lines.json")}
    pictures = {"profiles_model.png", "spectra_model.png"}
    assert names == {"radial_offset.csv", "radial_offset.html", *pictures}
    page = (tmp_path / "study/radial_offset.html").read_text(encoding="utf-8")
    assert "Spectra of the retrieved densities" in page and "10.1002/navi.354" in page
    sentence = page[page.index('class="sentence"') :].partition("</p>")[0]
    assert "3 km" in sentence


def test_figures_stand_in_their_order_with_what_they_show(tmp_path):
    for name, title in (
        ("decay", "The other chaser"),
        ("figure_10", "Figure 10: distances"),
        ("figure_4", "Figure 4: impulsive phasing"),
    ):
        save_figure(make_figure(3.0), tmp_path / f"{name}.png", title)
    paths = study._in_order(tmp_path.glob("*.png"))
    assert [study._caption(path, "002") for path in paths] == [
        "Figure 4 of paper 002, as computed here: impulsive phasing.",
        "Figure 10 of paper 002, as computed here: distances.",
        "Distance of the other chaser from the lead when one fails and decays.",
    ]


def test_radial_offset_refuses_an_offset_above_the_chief(tmp_path):
    arguments = ["radial_offset", "--offset", "-3", "--out", str(tmp_path / "study")]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 2
    assert "--offset" in outcome.output


def test_a_scenario_that_cannot_be_flown_is_named_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    scenario = tmp_path / "bad.yaml"
    scenario.write_text("name: bad\n")
    out = tmp_path / "study"
    arguments = ["thrust_cap", "--scenario", str(scenario), "--out", str(out)]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 2
    assert outcome.output.startswith("error: ") and "spacecraft" in outcome.output
    assert not out.exists()


@pytest.mark.slow
def test_thrust_cap_finds_the_landmarks_of_the_paper(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    out = tmp_path / "study"
    outcome = CliRunner().invoke(app, ["thrust_cap", "--out", str(out)])
    assert outcome.exit_code == 0, outcome.output
    assert "69.03" in outcome.output and "75.41" in outcome.output
    with (out / "thrust_cap.csv").open() as stream:
        rows = {float(row["cap_m_per_s2"]): row for row in csv.DictReader(stream)}
    assert len(rows) == 67
    assert float(rows[1.95]["minimum_in_track_m"]) == pytest.approx(69.03, abs=0.01)
    assert (out / "thrust_cap.png").is_file() and (out / "thrust_cap.html").is_file()
    again = CliRunner().invoke(app, ["thrust_cap", "--out", str(out)])
    assert "67 of 67 cases are finished already" in again.output

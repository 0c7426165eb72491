"""Everything that can be wrong with a campaign is one line with file and field, before a flight."""

from __future__ import annotations

import pytest
from campaign_samples import ROOT, changed, prepared, write_campaign
from typer.testing import CliRunner

pytest.importorskip("rclpy", reason="needs ROS 2")

from vtff_bringup import cli  # noqa: E402
from vtff_bringup.campaign.campaign_file import CampaignError  # noqa: E402

RUN = changed(
    "vary/cap/sets",
    ["sdre_controller.acceleration_cap"],
    changed("system", "reference", changed("loop", "run")),
)
SPACECRAFT = "scenario.spacecraft"

WRONG = [
    (changed("sample", 3), "sample: unknown field"),
    (changed("system", None), "system: field is missing"),
    (changed("system", "refrence"), "system: no system file 'refrence'; there are: "),
    (changed("loop", "fast"), "loop: one of run, library expected"),
    (changed("duration", -1), "duration: more than 0 expected"),
    (changed("duration", 0.3), "duration: one or more whole steps"),
    (changed("timeout", "long"), "timeout: a number expected"),
    (changed("seed", -1), "seed: a whole number"),
    (changed("seeds", []), "seeds: a count or a list of whole numbers"),
    (changed("seeds", 0), "seeds: 1 or more"),
    (changed("samples", None), "samples: field is missing"),
    (changed("samples", 5, changed("design", "sobol")), "samples: a power of two"),
    (changed("vary", {"sdre_controller.design": ["paper"]}), "samples: only with a distribution"),
    (changed("design", "halton"), "design: one of random, latin_hypercube, sobol"),
    (changed("composed", 1), "composed: true or false expected"),
    (changed("figures", None), "figures: field is missing"),
    (changed("figures", ["settling_tme_s"]), "figures: there is no figure 'settling_tme_s'; did"),
    (changed("figures", ["message_count"]), "figures: there is no figure 'message_count'"),
    (changed("figures", ["final_radial_m"] * 2), "figures: 'final_radial_m' is given twice"),
    (changed("must/settling_time_s", {"at_most": 9, "fracton": 1}), "fracton: unknown field"),
    (changed("must/settling_time_s", {}), "must.settling_time_s: at_least, at_most or both"),
    (changed("must/settling_time_s", {"at_most": 9, "fraction": 1.5}), "fraction: more than 0"),
    (changed("must/settling_time_s", {"at_most": 9, "confidence": 1}), "confidence: between"),
    (changed("must/settling_time_s", {"at_most": 1, "at_least": 2}), "at_least: not above"),
    (changed("must/final_radial_m", {"at_most": 9}), "must.final_radial_m: the figure of a bound"),
    (changed("vary/x", {"values": [1], "with": "start"}), "vary.x.with: 'start' is no list"),
    (changed("vary/x", {"values": [1], "with": "cap"}), "vary.x.values: 2 values expected"),
    (changed("vary/settling_time_s", [1]), "vary.settling_time_s: a variable may not have"),
    (changed("vary/status", [1]), "vary.status: the table has a column of this name"),
    (
        changed("vary/x", {"values": [1], "sets": ["thruster.acceleration_cap"]}),
        "vary.x: 'thruster.acceleration_cap' is set by cap already",
    ),
    (
        changed("fixed/thruster.acceleration_cap", 1.0),
        "vary.cap: 'thruster.acceleration_cap' stands under 'fixed' as well",
    ),
    (changed("vary/controller.design", ["paper"]), "vary.controller.design: reference_software"),
    (
        changed("fixed/scenaro", "x"),
        "fixed.scenaro: 'scenaro:=x': reference_software.yaml has no",
    ),
    (changed("fixed/scenario", "absent.yaml"), "fixed.scenario: no file 'absent.yaml'"),
    (
        changed("vary/sdre_controller.feed_forward", [True]),
        "vary.sdre_controller.feed_forward: node 'sdre_controller' has no parameter "
        "'feed_forward'; did you mean: feedforward",
    ),
    (
        changed("vary/sdre_controller.design", ["paper", "best"]),
        "vary.sdre_controller.design: parameter 'design' is 'best'; choose one of",
    ),
    (changed("vary/cap/values", [1.0, -1.0]), "vary.cap: parameter 'acceleration_cap' is -1.0"),
    (changed("vary/cap/values", [1.0, "much"]), "'acceleration_cap' is 'much'; its type is float"),
    (changed("fixed/thruster.delay_steps", 1.5), "fixed.thruster.delay_steps: parameter"),
    (
        changed("fixed/sdre_controller.maximum_lag", 3.0),
        "fixed.sdre_controller.maximum_lag: loop library cannot set",
    ),
    (
        changed(f"vary/{SPACECRAFT}.deputy_2.orbit.x", [1]),
        f"vary.{SPACECRAFT}.deputy_2.orbit.x: there is no entry 'spacecraft.deputy_2'",
    ),
    (
        changed(f"fixed/{SPACECRAFT}.deputy.orbit", {"same_orbit": 3}),
        "fixed: reference.yaml: spacecraft[1].orbit: exactly one of",
    ),
    (
        changed("vary/scenario.step", [1.0, 0.0]),
        "vary.scenario.step: reference.yaml: step: at least 1e-09 expected",
    ),
    (
        changed("vary/start", {"distribution": "pareto", "b": 1e-3}, changed("samples", 64)),
        "vary: start: the distribution gives a value that is not finite",
    ),
    (changed("system", "reference"), "loop: library flies truth, controller and thruster alone"),
    (
        changed("vary/gnss.receiver_defaults.noise.phase_sgma", [1e-3], RUN),
        "vary.gnss.receiver_defaults.noise.phase_sgma: reference.yaml: ",
    ),
    (
        changed("vary/relative_ekf.estimator", ["papr"], RUN),
        "vary.relative_ekf.estimator: parameter 'estimator' is 'papr'; choose",
    ),
]


@pytest.mark.parametrize(("content", "problem"), WRONG, ids=[problem for _, problem in WRONG])
def test_what_is_wrong_is_one_line_with_file_and_field(content, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises(CampaignError) as caught:
        prepared(tmp_path, content)
    text = str(caught.value)
    assert text.startswith(f"{tmp_path / 'small.yaml'}: ")
    assert problem in text and "\n" not in text


@pytest.mark.parametrize("name", ["example", "thrust_cap", "radial_offset"])
def test_the_campaigns_that_come_with_vtff_can_be_flown(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    result = CliRunner().invoke(cli.make_app(), ["campaign", name, "--dry-run"])
    assert result.exit_code == 0, result.output
    first, *rest = result.output.splitlines()
    assert first.startswith("case\tseed\t")
    assert [int(line.split("\t")[0]) for line in rest] == list(range(1, len(rest) + 1))


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["nosuch"], "no campaign file 'nosuch'; there are: "),
        (["FILE", "--resume"], "--resume: give the folder"),
        (["FILE", "--scheduler", "localhost"], "--scheduler: tcp://HOST:PORT or tls://"),
        (["FILE", "--tls-key", "FILE"], "--tls-key: only with --scheduler tls://"),
        (["FILE", "--scheduler", "tls://h:1", "--tls-key", "FILE"], "--tls-ca-file: missing"),
        (["FILE", "--case", "9"], "--case: the campaign has 8 cases, got 9"),
    ],
)
def test_wrong_options_are_one_line_and_leave_nothing(arguments, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    file = str(write_campaign(tmp_path))
    arguments = [file if argument == "FILE" else argument for argument in arguments]
    out = tmp_path / "out"
    if "--resume" not in arguments:
        arguments += ["--out", str(out)]
    result = CliRunner().invoke(cli.make_app(), ["campaign", *arguments])
    assert result.exit_code == 2
    assert result.output.startswith("error: ") and result.output.count("\n") == 1
    assert problem in result.output
    assert not out.exists()


def test_a_file_that_is_no_yaml_is_named(tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text("vary: [1, 2\n")
    result = CliRunner().invoke(cli.make_app(), ["campaign", str(path), "--dry-run"])
    assert result.exit_code == 2
    assert result.output.startswith(f"error: {path}: not readable as YAML")


def test_help_teaches():
    output = CliRunner().invoke(cli.make_app(), ["campaign", "--help"]).output
    assert "vtff campaign example --dry-run" in output and "docs/campaigns.md" in output

"""What there is, from the command line: list, node, topic, --version, completion."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys

import pytest
import typer.main
from typer.testing import CliRunner

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from bag_samples import sample_messages, write_bag  # noqa: E402

from vtff_bag.file.message_definitions import message_class  # noqa: E402
from vtff_bringup.cli import make_app  # noqa: E402
from vtff_bringup.discover.installed import config_files, nodes  # noqa: E402
from vtff_bringup.run import on_console  # noqa: E402
from vtff_bringup.system.system_file import find_system_file  # noqa: E402
from vtff_msgs.msg import RelativeState  # noqa: E402
from vtff_node.message_text import message_lines  # noqa: E402


def run(*arguments):
    return CliRunner().invoke(make_app(), [str(argument) for argument in arguments])


def test_everything_that_is_listed_has_a_description():
    result = run("list")
    assert result.exit_code == 0, result.output
    lines = [line for line in result.output.splitlines() if line.startswith("  ")]
    assert all(re.match(r"  \S+ +\S", line) for line in lines)
    names = {line.split()[0] for line in lines}
    assert {"reference", "esf", "realistic", "thrust_cap", "relative_ekf"} <= names
    assert len(lines) > 40


def test_a_kind_that_cannot_be_listed_is_refused():
    result = run("list", "planets")
    assert result.exit_code == 2 and "choose one of: systems" in result.output


def test_the_parameters_of_every_node_are_shown():
    for name, _, _ in nodes():
        for arguments in ((name,), (name, "--help")):
            result = run("node", *arguments)
            assert result.exit_code == 0, result.output
        assert "default:" in result.output and "lockstep" in result.output
    assert "[m/s^2] (at least" in run("node", "thruster_model").output


def test_an_unknown_node_names_the_others():
    result = run("node", "relative_ukf")
    assert result.exit_code == 2 and "relative_ekf" in result.output


def test_topics_of_a_bag(tmp_path):
    write_bag(tmp_path / "bag", sample_messages(30, topics=2), topics=2)
    listed = run("topic", "list", "--bag", tmp_path / "bag")
    assert re.search(r"/topic_0 +std_msgs/msg/String +15 +1\.\d+ Hz", listed.output)
    echoed = run("topic", "echo", "/topic_1", "--bag", tmp_path / "bag", "--count", 2)
    assert echoed.output.count("---") == 2 and "data: 1 x" in echoed.output
    assert "1.000 Hz" in run("topic", "hz", "/topic_0", "--bag", tmp_path / "bag").output
    missing = run("topic", "echo", "/topic", "--bag", tmp_path / "bag")
    assert missing.exit_code == 2 and "did you mean: /topic_" in missing.output
    assert run("topic", "list", "--bag", tmp_path / "nothing").exit_code == 2


def test_fields_have_the_units_of_their_definition():
    message = RelativeState(position=[1.0, 2.0, 3.0])
    lines = list(message_lines(message))
    assert "position: [1.0, 2.0, 3.0]    # m" in lines
    assert any(line.startswith("covariance: [0.0,") and "(36 values)" in line for line in lines)
    assert "  stamp:" in [line.rstrip() for line in lines]


def test_accelerations_have_units_that_their_definition_lacks():
    acceleration = message_class("geometry_msgs/msg/AccelStamped")
    lines = [line.strip() for line in message_lines(acceleration())]
    assert "linear:    # m/s2" in lines and "angular:    # rad/s2" in lines


def test_the_version_is_told():
    assert re.match(r"vtff \d+\.\d+", run("--version").output)


def complete(monkeypatch, words):
    """Return what bash offers for the last word."""
    monkeypatch.setenv("_VTFF_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
    return CliRunner().invoke(make_app(), prog_name="vtff").stdout.split()


def test_a_shell_that_asks_is_answered():
    variables = {"_VTFF_COMPLETE": "complete_bash", "COMP_WORDS": "vtff rep", "COMP_CWORD": "1"}
    result = subprocess.run(
        [sys.executable, "-m", "vtff_bringup.cli"],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
    )
    assert result.stdout.split() == ["replay", "reprocess", "report"]


def test_the_shell_completes_names(monkeypatch):
    systems = [path.stem for path in config_files("systems") if path.stem.startswith("realis")]
    assert complete(monkeypatch, "vtff run realis") == systems != []
    assert complete(monkeypatch, "vtff reprocess a --system navi") == ["navigation_only"]
    assert complete(monkeypatch, "vtff campaign thrust") == ["thrust_cap"]
    assert complete(monkeypatch, "vtff study fo") == ["formation_designs"]
    assert complete(monkeypatch, "vtff node relative_e") == ["relative_ekf"]
    assert complete(monkeypatch, "vtff list wor") == ["worlds"]
    assert complete(monkeypatch, "vtff guidance mode f") == ["free_drift"]
    assert complete(monkeypatch, "vtff tec file --format c") == ["csv"]


def test_the_shell_completes_what_a_system_lets_its_user_set(monkeypatch):
    asked = "vtff run reference "
    assert "chief_port:=" in complete(monkeypatch, asked)
    assert {"sdre_controller.", "simgen_bridge."} <= set(complete(monkeypatch, f"{asked}s"))
    assert complete(monkeypatch, f"{asked}relative_ekf.est") == ["relative_ekf.estimator:="]
    # The only node that begins so: what it has.
    assert "sdre_controller.design:=" in complete(monkeypatch, f"{asked}sdre")
    assert complete(monkeypatch, "vtff run no_such_system c") == []
    settings = complete(monkeypatch, "vtff reprocess a --set relative_ekf.est")
    assert settings == ["relative_ekf.estimator:="]


def test_the_shell_completes_runs_and_topics(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "bags/mine/bag", sample_messages(3, topics=2), topics=2)
    write_bag(tmp_path / "bags/my_bag", sample_messages(3, topics=2), topics=2)
    (tmp_path / "bags/my_notes").mkdir()
    for command in ("report", "view", "bag info", "replay", "export", "topic list --bag"):
        found = complete(monkeypatch, f"vtff {command} bags/m")
        assert found == ["bags/mine", "bags/my_bag"], command
    assert complete(monkeypatch, "vtff report elsewhere/") == []  # the shell completes files
    assert complete(monkeypatch, "vtff topic echo --bag bags/mine /topic_1") == ["/topic_1"]
    assert complete(monkeypatch, "vtff topic echo --bag bags /topic_1") == []


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("sdre_controller.desing:=paper", "has no parameter 'desing'; did you mean: design"),
        ("sdre_controller.xyzzy:=1", "has no parameter 'xyzzy'; it has: acceleration_cap"),
        ("sdre_controller.design:=best", "'best'; choose one of: "),
        ("thruster.start_timeout:=-1", "it must be at least"),
        ("simgen_bridge.maximum_lag:=two", "it must be a whole number"),
        (
            "relative_ekf.deputy_lever_arm:=[0.1, 0.0, 0.0]",
            "deputy_lever_arm needs the name of its",
        ),
        (
            "relative_ekf.deputy_antenna:=NONE",
            "antex_file: the file that has deputy_antenna 'NONE'",
        ),
        ("deputy/relative_ekf.estimator:=paper", ""),
    ],
)
def test_parameters_are_checked_before_anything_starts(override, expected, tmp_path, monkeypatch):
    """One line, exit code 2 and no folder, in the time of an import."""

    def start(*arguments, **options):
        raise AssertionError("it started")

    monkeypatch.setattr(on_console, "run_system", start)
    result = run("run", "reference", override, "--out", tmp_path / "run")
    if expected:
        assert result.exit_code == 2, result.output
        assert expected in result.output.replace("\n", " ")
        assert not (tmp_path / "run").exists()
    else:
        assert isinstance(result.exception, AssertionError)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (("hard_radius: 30.0", "hard_radius: 500.0"), "inside the hard radius of 500 m"),
        (("name: bravo", "name: formation"), "spacecraft[1].name: 'formation' is the namespace"),
        (("name: bravo", "name: charlie"), "spacecraft: 'charlie' is listed twice"),
        (("position_relative_rtn: [0.0,", "position_relative_rtn: [.nan,"), "three numbers"),
        (("position_relative_rtn:", "position_relative_gcrf:"), "position_relative_rtn"),
    ],
)
def test_a_scenario_is_checked_before_anything_starts(changed, expected, tmp_path, monkeypatch):
    monkeypatch.setattr(on_console, "run_system", lambda *_, **__: pytest.fail("it started"))
    scenario = find_system_file("formation_three").parents[1] / "scenario/formation_three.yaml"
    text = scenario.read_text(encoding="utf-8")
    assert changed[0] in text
    file = tmp_path / "wrong.yaml"
    file.write_text(text.replace(*changed), encoding="utf-8")
    result = run("run", "formation_three", f"scenario:={file}", "--out", tmp_path / "run")
    assert result.exit_code == 2, result.output
    line = result.output.replace("\n", " ")
    assert "wrong.yaml" in line and expected in line
    assert not (tmp_path / "run").exists()


def test_a_wrong_scenario_is_named_by_shipped_and_own_system_files(tmp_path, monkeypatch):
    monkeypatch.setattr(on_console, "run_system", lambda *_, **__: pytest.fail("it started"))
    config = tmp_path / "config"
    shutil.copytree(find_system_file("formation_three").resolve().parents[1], config)
    text = (config / "scenario/formation_three.yaml").read_text(encoding="utf-8")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(
        text.replace("position_relative_rtn: [0.0,", "position_relative_rtn: [.nan,", 1),
        encoding="utf-8",
    )
    own = (config / "system/formation_three.yaml").rename(config / "system/own.yaml")
    outputs = set()
    for system in ("formation_three", own):
        result = run("run", system, f"scenario:={wrong}", "--out", tmp_path / "run")
        assert result.exit_code == 2, result.output
        outputs.add(result.output)
    (line,) = outputs
    assert "wrong.yaml" in line and "position_relative_rtn" in line


def test_a_wrong_parameter_of_a_system_file_names_file_node_and_parameter(tmp_path, monkeypatch):
    monkeypatch.setattr(on_console, "run_system", lambda *_, **__: pytest.fail("it started"))
    config = tmp_path / "config"
    shutil.copytree(find_system_file("reference_software").resolve().parents[1], config)
    own = config / "system/own.yaml"
    shipped = (config / "system/reference_software.yaml").read_text(encoding="utf-8")
    line = "      target_position_rtn: ${deputy.target.position_relative_rtn}\n"
    assert line in shipped
    own.write_text(shipped.replace(line, f"{line}      acceleration_cap: -1.0\n"), encoding="utf-8")
    result = run("run", own, "--out", tmp_path / "run")
    assert result.exit_code == 2, result.output
    for part in ("own.yaml", "/deputy/sdre_controller", "acceleration_cap", "-1.0"):
        assert part in result.output.replace("\n", "")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (
            ("stated_sigma_factor: 0.7", "stated_sigma_factor: -0.7"),
            "stated_sigma_factor: more than",
        ),
        (("VTFF PATCH 2 NONE", "VTFF PATCH 9 NONE"), "receivers[1].phase_centre.antenna: "),
    ],
)
def test_receivers_are_checked_before_anything_starts(changed, expected, tmp_path, monkeypatch):
    monkeypatch.setattr(on_console, "run_system", lambda *_, **__: pytest.fail("it started"))
    world = find_system_file("realistic").resolve().parents[1] / "gnss/realistic.yaml"
    text = world.read_text(encoding="utf-8").replace(
        "./realistic.atx", f"{world.parent}/realistic.atx"
    )
    assert changed[0] in text
    file = tmp_path / "wrong.yaml"
    file.write_text(text.replace(*changed), encoding="utf-8")
    result = run("run", "realistic", f"gnss:={file}", "--out", tmp_path / "run")
    assert result.exit_code == 2, result.output
    line = result.output.replace("\n", " ")
    assert "wrong.yaml" in line and expected in line
    assert not (tmp_path / "run").exists()


def test_short_help_of_every_command_is_whole():
    """A new user reads these lines first; a line that is too long ends in dots."""
    group = typer.main.get_command(make_app())

    def lines(group, prefix=()):
        width = 78 - 6 - max(map(len, group.commands))  # what click leaves on 80 columns
        for name, command in group.commands.items():
            yield " ".join((*prefix, name)), command.get_short_help_str(width)
            if hasattr(command, "commands"):
                yield from lines(command, (*prefix, name))

    assert [line for line in lines(group) if line[1].endswith("...") or not line[1]] == []


def test_descriptions_of_files_are_whole_sentences():
    found = run("list", "worlds").output
    assert "12 satellites (6 GPS and" in found and "6 Galileo" in found.replace("\n", " ")
    assert "vtff topic list" in run("list", "topics").output


@pytest.mark.parametrize("command", [("info",), ("recover",)])
def test_what_is_no_bag_is_a_usage_error_as_elsewhere(tmp_path, command):
    (tmp_path / "random").write_bytes(bytes(range(256)) * 20)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "random", tmp_path / "pipe", tmp_path / ("x" * 300), "/etc"):
        answer = run("bag", *command, str(path))
        assert answer.exit_code == 2 and "error: " in answer.output, path
        assert run("topic", "list", "--bag", str(path)).exit_code == 2


def test_a_refused_run_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.yaml").write_text("- 1\n")
    assert run("run", "list.yaml").exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["list.yaml"]
    (tmp_path / "bags").mkdir()
    assert run("run", "list.yaml").exit_code == 2
    assert (tmp_path / "bags").is_dir()  # that of the user stays

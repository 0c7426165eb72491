"""Recorded runs through their nodes again: the same bytes, or others with other parameters."""

import json
import re
import shutil

import pytest
from typer.testing import CliRunner

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from vtff_bag.file.reader import BagReader  # noqa: E402
from vtff_bag.file.recover import recover  # noqa: E402
from vtff_bringup.cli import make_app  # noqa: E402
from vtff_bringup.run.reprocess import compare_outputs  # noqa: E402
from vtff_node.executables import ExecutableNotFoundError, executable_path  # noqa: E402

COMMAND_TOPIC = "/deputy/control/thrust_command"
APPLIED_TOPIC = "/deputy/propulsion/thrust_applied"
NAVIGATION_TOPICS = (
    "/deputy/relative_state",
    "/deputy/ambiguities",
    "/deputy/differential_tec",
)
SECONDS = 25


def invoke(*arguments):
    result = CliRunner().invoke(make_app(), [str(argument) for argument in arguments])
    assert "Traceback" not in result.output
    return result


def run(folder, system, seconds=SECONDS):
    try:
        executable_path("vtff_bag", "bag_player")
    except ExecutableNotFoundError:
        pytest.skip("the workspace is not built")
    arguments = ["--duration", seconds, "--seed", 3, "--composed", "--no-report", "--out", folder]
    result = invoke("run", system, *arguments)
    assert result.exit_code == 0, result.output
    return folder


def payloads(path, topic):
    return [(raw.log_time, raw.serialized) for raw in BagReader(path).raw_messages([topic])]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return run(tmp_path_factory.mktemp("recorded") / "run", "reference_software")


@pytest.mark.parametrize("mode", [[], ["--distributed"]])
def test_unchanged_parameters_give_the_recorded_bytes(recorded, tmp_path, mode):
    out = tmp_path / "again"
    arguments = ["--system", "control_only", "--out", out, "--no-report", *mode]
    result = invoke("reprocess", recorded, *arguments)
    assert result.exit_code == 0, result.output
    assert len(re.findall(r"\bidentical\b", result.output)) == 2
    for topic in (COMMAND_TOPIC, APPLIED_TOPIC, "/clock", "/deputy/relative_state_truth"):
        assert payloads(out, topic) == payloads(recorded, topic), topic
    assert json.loads((out / "run.json").read_text())["system"] == "control_only"


def test_other_parameters_give_other_commands(recorded, tmp_path):
    out = tmp_path / "other"
    change = "sdre_controller.design:=delay_aware"
    arguments = ["--system", "control_only", "--set", change, "--duration", 10]
    result = invoke("reprocess", recorded, *arguments, "--out", out, "--no-report")
    assert result.exit_code == 0, result.output
    assert "differ, the first at" in result.output
    assert len(payloads(out, COMMAND_TOPIC)) == 11
    # The parameters of the nodes that did not run again came along.
    assert "simgen_bridge.yaml" in {path.name for path in (out / "parameters").iterdir()}


def test_a_recovered_bag_alone_is_reprocessed_as_far_as_it_goes(recorded, tmp_path):
    shutil.copytree(recorded / "bag", tmp_path / "cut")
    (file,) = (tmp_path / "cut").glob("*.mcap")
    file.write_bytes(file.read_bytes()[: 3 * file.stat().st_size // 4])
    recovered = recover(tmp_path / "cut").output
    out = tmp_path / "again"
    arguments = ["--system", "control_only", "--out", out, "--no-report"]
    result = invoke("reprocess", recovered, *arguments)
    assert result.exit_code == 0, result.output
    again, before = payloads(out, COMMAND_TOPIC), payloads(recorded, COMMAND_TOPIC)
    assert 0 < len(again) and again == before[: len(again)]


def test_usage_errors_are_one_line(recorded, tmp_path):
    for arguments, named in (
        ([tmp_path / "nothing"], "no such bag"),
        ([recorded, "--system", "nowhere"], "no system file 'nowhere'"),
        ([recorded, "--system", "control_only", "--set", "a.b:=1"], "no argument or node 'a'"),
        ([recorded, "--system", "reference_software"], "no argument or node 'bag'"),
    ):
        result = invoke("reprocess", *arguments, "--out", tmp_path / "out")
        assert result.exit_code == 2 and named in result.output, result.output


def test_differences_are_counted_and_dated(recorded, tmp_path):
    shutil.copytree(recorded, tmp_path / "copy")
    bags = BagReader(recorded), BagReader(tmp_path / "copy")
    (same,) = compare_outputs(*bags, [COMMAND_TOPIC])
    assert same.identical and same.recorded == SECONDS + 1
    (absent,) = compare_outputs(*bags, ["/nothing"])
    assert (absent.recorded, absent.recomputed) == (0, 0)


@pytest.mark.slow
def test_navigation_on_recorded_observations_gives_the_recorded_bytes(tmp_path):
    recorded = run(tmp_path / "recorded", "reference", seconds=120)
    result = invoke("reprocess", recorded, "--out", tmp_path / "again", "--no-report")
    assert result.exit_code == 0, result.output
    for topic in NAVIGATION_TOPICS:
        assert payloads(tmp_path / "again", topic) == payloads(recorded, topic), topic


@pytest.mark.slow
def test_a_recorded_chief_beside_a_live_deputy_flies_the_same(tmp_path):
    """As the paper ran with one receiver: nothing in the graph can tell the difference."""
    both = run(tmp_path / "both", "reference", seconds=60)
    arguments = ["--duration", 60, "--seed", 3, "--composed", "--no-report"]
    out = tmp_path / "one"
    result = invoke("run", "recorded_chief", f"bag:={both}", *arguments, "--out", out)
    assert result.exit_code == 0, result.output
    for topic in ("/chief/gnss/epoch", "/deputy/gnss/epoch", *NAVIGATION_TOPICS, APPLIED_TOPIC):
        assert payloads(out, topic) == payloads(both, topic), topic

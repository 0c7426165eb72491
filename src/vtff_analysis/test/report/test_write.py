"""Reports of small bags: files, documented keys, tables, and parts that a run does not have."""

import io
import json
import pathlib
import re

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

pytest.importorskip("rclpy", reason="needs ROS 2")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402

from vtff_analysis.paper_reference import paper_columns  # noqa: E402
from vtff_analysis.report import write_report  # noqa: E402
from vtff_analysis.report.tables import print_formation  # noqa: E402
from vtff_bag.file.errors import BagReadError  # noqa: E402
from vtff_bag.file.writer import BagWriter  # noqa: E402
from vtff_msgs.msg import (  # noqa: E402
    GnssEphemeris,
    GnssFix,
    GnssObservations,
    RelativeState,
    SimulatorStatus,
)
from vtff_node.plain_yaml import format_yaml
from vtff_node.stamps import to_stamp  # noqa: E402

REPOSITORY = pathlib.Path(__file__).resolve().parents[4]
START = 1_458_522_000_000_000_000
SECOND = 1_000_000_000


class BagOfMessages:
    """Writes messages stamped with seconds since `START`."""

    def __init__(self, run_directory):
        self._writer = BagWriter(run_directory / "bag")
        self._topics = {}

    def add(self, topic, seconds, message):
        time = START + round(seconds * SECOND)
        if topic not in self._topics:
            package = type(message).__module__.partition(".")[0]
            type_name = f"{package}/msg/{type(message).__name__}"
            self._topics[topic] = self._writer.add_topic(topic, type_name)
        message.header.stamp = to_stamp(time)
        self._writer.write(self._topics[topic], serialize_message(message), time)

    def close(self):
        self._writer.close()


def acceleration(rtn):
    message = AccelStamped()
    message.accel.linear.x, message.accel.linear.y, message.accel.linear.z = map(float, rtn)
    return message


def relative_state(deputy, position, solution=RelativeState.SOLUTION_TRUTH):
    message = RelativeState(child_frame_id=deputy, solution=solution)
    message.position = np.asarray(position, dtype=float)
    return message


def write_formation(
    run_directory, deputies=("deputy",), seconds=200, navigation=False, thrust=True
):
    """In-track from 1000 m to 100 m with a dip; 0.5 m/s2 in-track from 1 s to 11 s."""
    bag = BagOfMessages(run_directory)
    for t in range(seconds + 1):
        in_track = 100.0 + 900.0 * np.exp(-t / 8.0) - (60.0 if t == 54 else 0.0)
        for deputy in deputies:
            state = relative_state(deputy, [0.0, in_track, 0.0])
            bag.add(f"/{deputy}/relative_state_truth", t, state)
            if navigation:
                solution = RelativeState.SOLUTION_FIXED if t > 3 else RelativeState.SOLUTION_NONE
                state = relative_state(deputy, [0.01, in_track, 0.0], solution)
                bag.add(f"/{deputy}/relative_state", t, state)
            if not thrust:
                continue
            bag.add(f"/{deputy}/control/thrust_command", t, acceleration([0.0, 0.0, 0.0]))
            push = [0.0, -0.5 if t < 10 else 0.0, 0.0]
            bag.add(f"/{deputy}/propulsion/thrust_applied", t + 1, acceleration(push))
        state = SimulatorStatus.STATE_ENDED if t == seconds else SimulatorStatus.STATE_RUNNING
        status = SimulatorStatus(scenario="reference", state=state, time_into_run=float(t))
        bag.add("/sim/status", t, status)
    bag.close()
    folder = run_directory / "parameters"
    folder.mkdir()
    for deputy in deputies:
        parameters = {
            "deputy": deputy,
            "target_position_rtn": [0.0, 100.0, 0.0],
            "acceleration_cap": 0.5,
            "design": "paper",
            "feedforward": False,
        }
        content = {f"/{deputy}_controller": {"ros__parameters": parameters}}
        (folder / f"{deputy}.yaml").write_text(format_yaml(content))
    scenario = run_directory / "scenario.yaml"
    scenario.write_text("seed: 42\n")
    content = {"/simgen_bridge": {"ros__parameters": {"scenario_file": str(scenario)}}}
    (folder / "simgen_bridge.yaml").write_text(format_yaml(content))


def write_receivers(run_directory, crafts=("chief", "deputy")):
    bag = BagOfMessages(run_directory)
    for craft in crafts:
        for t in [*range(10), *range(15, 20)]:
            message = GnssObservations(
                system=[0, 0, 1],
                prn=[5, 5, 7],
                band=[1, 2, 1],
                attribute=[67, 87, 67],
                cn0_dbhz=[45.0, 40.0, 42.0],
                flags=[7, 7, 7],
            )
            bag.add(f"/{craft}/gnss/epoch", t, message)
            bag.add(f"/{craft}/gnss/fix", t, GnssFix(status=1))
        bag.add(f"/{craft}/gnss/ephemeris", 5, GnssEphemeris(system=0, prn=5))
    bag.close()


def report(run_directory, **arguments):
    """Write the report; return folder, summary and what the console showed."""
    console = Console(file=io.StringIO(), width=80)
    folder = write_report(run_directory, console, {"system": "test", "port": [1, 2], **arguments})
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return folder, summary, console.file.getvalue()


@pytest.fixture
def run_directory(tmp_path):
    folder = tmp_path / "some_run"
    folder.mkdir()
    return folder


def documented_keys():
    """Patterns of the keys in the first column of the tables of docs/summary.md."""
    text = (REPOSITORY / "docs" / "summary.md").read_text(encoding="utf-8")
    keys = [key for key in re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE) if ".png" not in key]
    choices = {
        "<axis>": "(radial|in_track|cross_track)",
        "<system>": "(gps|glonass|sbas|galileo|beidou|qzss|navic)",
        "<signal>": "[a-z][0-9][a-z]",
    }
    patterns = []
    for key in keys:
        for name, pattern in choices.items():
            key = key.replace(name, pattern)
        patterns.append(re.sub("<(craft|deputy|name|topic)>", "[a-z0-9_]+", key))
    return patterns


def assert_documented(summary, prefixes=()):
    patterns = documented_keys()
    assert len(patterns) > 60
    for key, value in summary.items():
        assert value is None or isinstance(value, (str, int, float, bool)), key
        names = [key, *[key.removeprefix(prefix) for prefix in prefixes]]
        assert any(re.fullmatch(pattern, name) for pattern in patterns for name in names), key


@pytest.fixture(scope="module")
def formation_report(tmp_path_factory):
    run_directory = tmp_path_factory.mktemp("runs") / "some_run"
    run_directory.mkdir()
    write_formation(run_directory)
    return (run_directory, *report(run_directory))


def test_formation_summary(formation_report):
    run_directory, folder, summary, _ = formation_report
    assert folder == run_directory / "report"
    assert summary["minimum_in_track_time_s"] == 54.0
    assert summary["delta_v_total_in_track_m_per_s"] == pytest.approx(5.0)
    assert summary["run_seed"] == 42
    assert summary["controller_design"] == "paper"
    assert summary["acceleration_cap_m_per_s2"] == 0.5
    assert summary["control_input"] == "truth"
    assert summary["run_complete"] is True
    assert summary["argument_port"] == "[1, 2]"
    assert summary["message_count_sim_status"] == 201
    assert_documented(summary)


def test_formation_table_shows_the_paper_within_80_columns(formation_report):
    shown = formation_report[-1]
    assert "38.17" in shown and "fed with truth, like 'paper software'" in shown
    assert "…" not in shown
    # The path of the report is as long as it is.
    lines = [line for line in shown.splitlines() if not line.startswith("report: ")]
    assert not [line for line in lines if len(line) > 80]


def printed_table(summary):
    console = Console(file=io.StringIO(), width=80)
    print_formation(console, summary, ["deputy"], "some_run")
    return console.file.getvalue()


def test_totals_of_a_short_run_are_not_beside_those_of_the_papers_hour(formation_report):
    summary = formation_report[2]
    shown = printed_table(summary)
    assert shown.splitlines()[0].rstrip() == "some_run, 200 s"
    assert "whole run, 200 s" in shown
    assert "75.48" not in shown  # total in-track of the paper's hour
    assert "1.44" not in shown  # its part while keeping
    assert "75.45" in shown  # its part of the acquisition, which this run has
    whole = printed_table({**summary, "run_duration_s": 3600.0})
    assert "75.48" in whole and "1.44" in whole
    shorter = printed_table({**summary, "run_duration_s": 60.0})
    assert "acquisition, 60 s" in shorter and "75.45" not in shorter
    assert "not yet" in printed_table({**summary, "settling_time_in_track_s": None})
    unsettled = {**summary, "settling_time_in_track_s": None, "run_duration_s": 3600.0}
    assert "never" in printed_table(unsettled)


def test_an_interrupted_run_says_so(formation_report):
    shown = printed_table({**formation_report[2], "run_complete": False})
    assert shown.splitlines()[0].rstrip() == "some_run, interrupted after 200 s"


def test_formation_plots_are_wide_enough_and_not_empty(formation_report):
    folder = formation_report[1]
    names = {path.name for path in folder.glob("*.png")}
    expected = {"relative_position_and_thrust.png", "relative_position.png", "keeping_error.png"}
    assert names == expected
    for name in names:
        with Image.open(folder / name) as image:
            assert image.width == 1600
            assert len(image.convert("RGB").getcolors(maxcolors=2**24)) > 10


def test_navigation_is_compared_with_truth(run_directory):
    write_formation(run_directory, navigation=True)
    _, summary, shown = report(run_directory)
    assert summary["control_input"] == "navigation"
    assert summary["navigation_error_samples"] == 197  # without the four that have no solution
    assert summary["navigation_error_radial_rms_m"] == pytest.approx(0.01)
    assert_documented(summary)
    assert "like 'paper HIL'" in shown


@pytest.mark.parametrize(
    ("ports", "receivers"),
    [
        (("serial:///runs/some_run/ports/chief",) * 2, "emulated"),
        (("/dev/ttyUSB0", "tcp://192.0.2.7:3001"), "real"),
        (("serial://${run_directory}/ports/chief", "/dev/ttyUSB0"), "emulated and real"),
    ],
)
def test_receivers_are_called_emulated_or_real(run_directory, ports, receivers, monkeypatch):
    # The pictures are those of the test before; drawing them takes most of the time.
    monkeypatch.setattr("vtff_analysis.report.write.draw_pictures", lambda *arguments: [])
    write_formation(run_directory, navigation=True)
    for spacecraft, port in zip(("chief", "deputy"), ports, strict=True):
        content = {f"/{spacecraft}/receiver_driver": {"ros__parameters": {"port": port}}}
        file = run_directory / "parameters" / f"{spacecraft}_receiver_driver.yaml"
        file.write_text(format_yaml(content))
    _, summary, shown = report(run_directory, gnss="gnss/evening.yaml")
    assert summary["receivers"] == receivers
    assert_documented(summary)
    assert f"GNSS navigation of {receivers} receivers" in " ".join(shown.split())
    assert ("world 'evening'" in " ".join(shown.split())) == (receivers != "real")


def test_two_deputies(run_directory):
    write_formation(run_directory, deputies=("deputy_1", "deputy_2"))
    folder, summary, shown = report(run_directory)
    assert summary["deputy_1_target_in_track_m"] == summary["deputy_2_target_in_track_m"] == 100.0
    assert (folder / "deputy_2_relative_position.png").is_file()
    assert "some_run: deputy_2" in shown
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<figcaption>deputy_2: relative position by axis." in page
    assert_documented(summary, ("deputy_1_", "deputy_2_"))


def test_a_flight_without_thrust_has_no_panel_of_it(run_directory, formation_report):
    write_formation(run_directory, thrust=False)
    folder = report(run_directory)[0]
    name = "relative_position_and_thrust.png"
    with Image.open(folder / name) as alone, Image.open(formation_report[1] / name) as both:
        assert alone.height < 0.6 * both.height


def test_run_shorter_than_the_acquisition(run_directory):
    write_formation(run_directory, seconds=60)
    folder, summary, shown = report(run_directory)
    assert "keeping_in_track_mean_m" not in summary
    assert not (folder / "keeping_error.png").exists()
    assert "keeping, from then on" not in shown
    assert "acquisition" in shown


def test_receiver_report(run_directory):
    write_receivers(run_directory)
    folder, summary, shown = report(run_directory)
    assert summary["chief_gnss_epochs"] == 15
    assert summary["chief_gnss_missing_epochs"] == 5
    assert summary["deputy_gnss_observations_g2w"] == 15
    assert summary["deputy_gnss_ephemerides"] == 1
    assert summary["run_duration_s"] == pytest.approx(19.0)
    assert "minimum_in_track_m" not in summary
    assert (folder / "chief_gnss_tracking.png").is_file()
    assert_documented(summary)
    assert "GNSS observations" in shown and "G2W" in shown


def test_run_without_known_topics_lists_messages(run_directory):
    bag = BagOfMessages(run_directory)
    bag.add("/something/else", 1, acceleration([0, 0, 0]))
    bag.close()
    folder, summary, shown = report(run_directory)
    assert summary["message_count"] == 1
    assert "/something/else" in shown
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "summary.json"]


def test_empty_bag(run_directory):
    BagOfMessages(run_directory).close()
    _, summary, _ = report(run_directory)
    assert summary["message_count"] == 0
    assert summary["run_duration_s"] == 0.0


def test_unreadable_parameters_and_messages_are_noted(run_directory):
    write_receivers(run_directory, crafts=("chief",))
    (run_directory / "parameters").mkdir()
    (run_directory / "parameters" / "broken.yaml").write_text("a: [")
    _, summary, shown = report(run_directory)
    assert summary["chief_gnss_epochs"] == 15
    assert "broken.yaml" in shown.replace("\n", "")


def test_report_can_be_written_again(run_directory):
    write_receivers(run_directory, crafts=("chief",))
    _, first, _ = report(run_directory)
    _, second, _ = report(run_directory)
    assert first == second


def test_missing_bag_is_named(run_directory):
    with pytest.raises(BagReadError, match="bag"):
        report(run_directory)


def test_paper_columns_use_documented_keys():
    patterns = documented_keys()
    for scenario in ("reference", "remote_sensing"):
        for column in paper_columns(scenario):
            for key in column.values:
                assert any(re.fullmatch(pattern, key) for pattern in patterns), key
    assert paper_columns("another") == ()
    assert paper_columns(None) == ()

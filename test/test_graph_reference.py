"""The reference formation over the real topics and TCP: numbers of paper 000, appendix A.1."""

from __future__ import annotations

import json

import numpy as np
import pytest
from graph_support import ROOT

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_bag.file.reader import BagReader
from vtff_control.tracking.sdre import SdreDesign
from vtff_sim_bridge.truth.scenario import load_scenario

SYSTEM = "reference_software.yaml"


@pytest.fixture(scope="module")
def reference(runs):
    return runs.make("composed_hour", SYSTEM, "--composed")[0]


@pytest.fixture(scope="module")
def summary(reference):
    return json.loads((reference / "report" / "summary.json").read_text())


def test_paper_numbers(summary):
    assert summary["run_duration_s"] == 3600.0
    assert summary["minimum_in_track_m"] == pytest.approx(38.2, abs=0.5)
    assert 54.0 <= summary["minimum_in_track_time_s"] <= 56.0
    assert summary["delta_v_total_radial_m_per_s"] == pytest.approx(2.48, rel=0.03)
    assert summary["delta_v_total_in_track_m_per_s"] == pytest.approx(75.47, rel=0.003)
    assert summary["delta_v_total_cross_track_m_per_s"] < 1e-3


def test_every_plot_is_there(reference):
    names = {path.name for path in (reference / "report").glob("*.png")}
    assert {"relative_position_and_thrust.png", "keeping_error.png"} <= names


def test_graph_reproduces_the_in_process_loop(reference):
    """Topics, messages and recorder add nothing: the fast twin gives the same bits."""
    scenario = load_scenario(ROOT / "config/scenario/reference.yaml")
    design = SdreDesign(design="paper", acceleration_cap=1.4)
    expected = simulate_closed_loop(scenario, design)
    history = expected.deputies["deputy"]
    messages = [
        item.message for item in BagReader(reference).messages("/deputy/relative_state_truth")
    ]
    recorded = np.array([[*message.position, *message.velocity] for message in messages])
    np.testing.assert_array_equal(recorded, history.state_relative_rtn)


def test_log_times_are_scenario_times(reference):
    reader = BagReader(reference)
    epoch = 1458522000 * 10**9 - 17 * 10**9  # 2016-03-21 01:00:00 GPS, shown as UTC
    clock = [raw.log_time for raw in reader.raw_messages(["/clock"])]
    assert (clock[0], clock[-1]) == (epoch, epoch + 3600 * 10**9)
    # The thrust computed in the last second would start one second later.
    thrust = [raw.log_time for raw in reader.raw_messages(["/deputy/propulsion/thrust_applied"])]
    assert (thrust[0], thrust[-1]) == (epoch + 10**9, epoch + 3601 * 10**9)


def test_the_bag_holds_what_each_publisher_counted(reference):
    published: dict[str, int] = {}
    for path in (reference / "nodes").glob("*.json"):
        for topic, count in json.loads(path.read_text())["published"].items():
            published[topic] = published.get(topic, 0) + count
    topics = BagReader(reference).topics
    assert published["/deputy/relative_state_truth"] == 3601
    assert {topic: topics[topic].message_count for topic in published if published[topic]} == {
        topic: count for topic, count in published.items() if count
    }


def test_the_bag_opens_with_rosbags(reference):
    rosbags = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    with rosbags.AnyReader([reference / "bag"]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        connections = [c for c in reader.connections if c.topic == "/chief/truth/orbit"]
        first = next(reader.messages(connections=connections))
        message = reader.deserialize(first[2], connections[0].msgtype)
    assert counts["/clock"] == 3601
    assert message.position[0] == 6928137.0

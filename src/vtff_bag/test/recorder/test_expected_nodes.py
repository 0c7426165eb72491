"""When a recorder hears all topics of the nodes of a run; without ROS."""

from hypothesis import given
from hypothesis import strategies as st

from vtff_bag.recorder.expected_nodes import (
    COMPILE_PATIENCE,
    STATEMENT_PATIENCE,
    ExpectedNodes,
)
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC

RECORDER = "/bag_recorder"


def make(names, wants=lambda topic: True):
    warnings = []
    return ExpectedNodes(names, RECORDER, wants, warnings.append), warnings


def test_a_topic_is_heard_when_both_sides_have_discovered_each_other():
    nodes, _ = make(["/a"])
    assert nodes.missing() == ["node /a"]
    nodes.discover("/x", ["/a"], 0.0)
    assert nodes.missing() == ["node /a"]
    nodes.state("/a", {"/x": [], "/y": [RECORDER]})
    assert nodes.missing() == ["/x, /y of node /a"]
    nodes.state("/a", {"/x": [RECORDER], "/y": [RECORDER]})
    assert nodes.missing() == ["/y of node /a"]  # its publisher was not discovered
    nodes.discover("/y", ["/other"], 0.0)
    assert nodes.missing() == ["/y of node /a"]
    nodes.discover("/y", ["/other", "/a"], 0.0)
    assert nodes.missing() == [] and nodes.are_heard(0.0)


def test_topics_that_are_not_recorded_are_not_waited_for():
    nodes, _ = make(["/a"], lambda topic: topic != "/unwanted")
    nodes.state("/a", {"/unwanted": [], "/refused": []})
    assert nodes.missing() == ["/refused of node /a"]
    nodes.ignore("/refused")
    assert nodes.are_heard(0.0)


def test_a_node_that_states_nothing_is_named_once_and_not_waited_for_without_end():
    nodes, warnings = make(["/foreign", "/absent"])
    nodes.discover("/x", ["/foreign"], 5.0)
    assert not nodes.are_heard(5.0 + STATEMENT_PATIENCE)
    assert warnings == []
    for _ in range(3):
        assert not nodes.are_heard(5.1 + STATEMENT_PATIENCE)
    assert len(warnings) == 1 and "/foreign" in warnings[0]
    assert nodes.missing() == ["node /absent"]


def test_a_node_that_compiles_at_its_first_start_is_waited_for():
    nodes, warnings = make(["/slow"])
    nodes.discover(DIAGNOSTICS_TOPIC, ["/slow"], 0.0)
    nodes.discover("/x", ["/slow"], 0.0)
    assert not nodes.are_heard(4.0 * STATEMENT_PATIENCE)
    assert warnings == []
    assert nodes.are_heard(1.0 + COMPILE_PATIENCE)
    assert len(warnings) == 1


@given(st.permutations([("/a", "/x"), ("/a", "/y"), ("/b", "/x")]), st.integers(0, 5))
def test_the_order_of_discovery_does_not_matter(pairs, statements_after):
    """As long as one half of one pair is missing, not all is heard."""
    nodes, _ = make(["/a", "/b"])
    steps = [
        lambda node=node, topic=topic: nodes.discover(topic, [node], 0.0) for node, topic in pairs
    ]
    states = [
        lambda: nodes.state("/a", {"/x": [RECORDER], "/y": [RECORDER]}),
        lambda: nodes.state("/b", {"/x": [RECORDER]}),
    ]
    steps[statements_after:statements_after] = states
    for step in steps:
        assert not nodes.are_heard(0.0)
        step()
    assert nodes.are_heard(0.0)

"""Statements of a node about its listeners: repeated on each change, read back as they were."""

import types

import pytest

from vtff_node.start.listeners import (
    UNNAMED_NODE,
    WATCH_TIME,
    ListenerWatch,
    listener_values,
    read_listeners,
    status_name,
)


class Graph:
    """Subscriptions of a node's topics, as its process has discovered them."""

    def __init__(self):
        self.listeners = {"/a": [], "/b": []}
        self.matched = None
        self.published = []
        self.looks = 0
        self.now = 0.0
        self.watch = ListenerWatch(self.counts, self.find, self.published.append, lambda: self.now)

    def counts(self):
        return self.matched or [len(names) for names in self.listeners.values()]

    def find(self):
        self.looks += 1
        return {topic: list(names) for topic, names in self.listeners.items()}


def test_each_change_is_published_once():
    graph = Graph()
    for _ in range(3):
        graph.watch.look()
    assert graph.published == [{"/a": [], "/b": []}] and graph.looks == 1
    graph.listeners["/b"] = ["/viewer", "/bag_recorder"]
    for _ in range(3):
        graph.watch.look()
    assert graph.published[1:] == [{"/a": [], "/b": ["/bag_recorder", "/viewer"]}]
    assert graph.looks == 2


def test_a_name_that_comes_after_its_subscription_is_published():
    graph = Graph()
    graph.listeners["/a"] = [f"/{UNNAMED_NODE}"]
    graph.watch.look()
    graph.listeners["/a"] = ["/bag_recorder"]
    graph.watch.look()
    assert graph.published[-1]["/a"] == ["/bag_recorder"]


def test_a_match_before_the_graph_knows_it_is_looked_at_again():
    graph = Graph()
    graph.matched = [1, 0]
    graph.watch.look()
    graph.listeners["/a"] = ["/bag_recorder"]
    graph.watch.look()
    assert graph.published[-1]["/a"] == ["/bag_recorder"]


def test_the_watch_is_over_after_the_start():
    graph = Graph()
    assert not graph.watch.is_over
    graph.now = WATCH_TIME + 1.0
    assert graph.watch.is_over


@pytest.mark.parametrize("listeners", [{}, {"/a": set()}, {"/a": {"/x", "/n/y"}, "/b": {"/x"}}])
def test_statements_are_read_as_they_were_written(listeners):
    values = [
        types.SimpleNamespace(key=key, value=value)
        for key, value in listener_values(listeners).items()
    ]
    status = types.SimpleNamespace(name=status_name("/deputy/thruster"), values=values)
    assert read_listeners(status) == ("/deputy/thruster", listeners)


@pytest.mark.parametrize("name", ["simgen_bridge: run", "bag_recorder: topics", "/x: running"])
def test_other_reports_are_no_statements(name):
    assert read_listeners(types.SimpleNamespace(name=name, values=[])) is None

"""Two runs of one scenario with one seed: the same messages, topic by topic, byte for byte."""

from __future__ import annotations

import itertools

import pytest
from graph_support import serialized, topics

SYSTEM = "reference_software.yaml"


@pytest.fixture(scope="module")
def four_runs(runs):
    return {
        "distributed_1": runs.make("distributed_1", SYSTEM)[0],
        "distributed_2": runs.make("distributed_2", SYSTEM, "--no-report")[0],
        "composed_1": runs.make("composed_1", SYSTEM, "--composed", "--no-report")[0],
        "composed_2": runs.make("composed_2", SYSTEM, "--composed", "--no-report")[0],
    }


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("distributed_1", "distributed_2"),
        ("composed_1", "composed_2"),
        ("distributed_1", "composed_1"),
    ],
)
def test_runs_are_equal_byte_for_byte(four_runs, first, second):
    names = topics(four_runs[first])
    assert names == topics(four_runs[second])
    assert len(names) >= 8
    for topic in sorted(names):
        pairs = itertools.zip_longest(
            serialized(four_runs[first], topic), serialized(four_runs[second], topic)
        )
        for number, (left, right) in enumerate(pairs):
            assert left == right, f"{topic}: message {number} differs"


def test_another_controller_gives_other_messages(runs, four_runs):
    """The comparison can fail."""
    other = runs.make(
        "other", SYSTEM, "sdre_controller.design:=delay_aware", "--duration", 60, "--no-report"
    )[0]
    topic = "/deputy/control/thrust_command"
    first = serialized(four_runs["composed_1"], topic)[:60]
    assert first != serialized(other, topic)[:60]


def test_the_ionosphere_is_equal_byte_for_byte(runs):
    """With receivers in the loop, down to densities and contents."""
    short = "esf.yaml", "--duration", 12, "--composed", "--no-report"
    first, second = (runs.make(name, *short)[0] for name in ("esf_short", "esf_short_again"))
    names = {name for name in topics(first) if "iono/" in name or name.startswith("/formation/")}
    assert {"/chief/iono/slant_tec", "/formation/electron_density"} <= names <= topics(second)
    for topic in sorted(names):
        assert serialized(first, topic) == serialized(second, topic), topic
    assert len(serialized(first, "/formation/electron_density")) >= 9

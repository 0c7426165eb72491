"""Two runs of one scenario with one seed: the same messages, topic by topic, byte for byte."""

from __future__ import annotations

import pytest
from graph_support import assert_equal_messages, serialized_topics, topics

from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

SYSTEM = "reference_software.yaml"
#: Scenario time of the repetitions, s. The hour that is compared with them here is compared with
#: the loop without ROS in test_graph_reference.py, bit for bit.
SHORT = 600


@pytest.fixture(scope="module")
def make_run(runs):
    """Return a function from the name of a run to its folder."""
    short = ("--duration", SHORT, "--no-report")
    arguments = {
        "composed_hour": ("--composed",),
        "composed": ("--composed", *short),
        "distributed_1": ("--distributed", *short),
        "distributed_2": ("--distributed", *short),
        "distributed_hour": ("--distributed", "--no-report"),
    }
    return lambda name: runs.make(name, SYSTEM, *arguments[name])[0]


@pytest.mark.parametrize(
    ("first", "second", "duration"),
    [
        ("composed_hour", "distributed_1", SHORT),
        ("composed_hour", "composed", SHORT),
        ("distributed_1", "distributed_2", None),
        ("distributed_1", "composed", None),
        pytest.param("composed_hour", "distributed_hour", None, marks=pytest.mark.slow),
    ],
)
def test_runs_are_equal_byte_for_byte(make_run, first, second, duration):
    first_run, second_run = make_run(first), make_run(second)
    names = topics(first_run)
    assert names == topics(second_run)
    assert len(names) >= 8
    end = None
    if duration is not None:
        end = BagReader(first_run).start_time + duration * NANOSECONDS_PER_SECOND
        names.remove("/sim/status")  # tells how long the run is to last
    compared = assert_equal_messages(first_run, second_run, names, end)
    assert compared > 6 * SHORT


def test_another_controller_gives_other_messages(runs, make_run):
    """The comparison can fail."""
    other = runs.make(
        "other", SYSTEM, "sdre_controller.design:=delay_aware", "--duration", 60, "--composed",
        "--no-report",
    )[0]  # fmt: skip
    topic = "/deputy/control/thrust_command"
    first, second = (
        serialized_topics(run, [topic])[topic][:60] for run in (make_run("composed"), other)
    )
    assert len(first) == len(second) == 60
    assert first != second

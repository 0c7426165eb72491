"""Two runs of one scenario with one seed: the same messages, topic by topic, byte for byte."""

from __future__ import annotations

import pytest
from graph_support import assert_equal_messages, serialized_topics, topics

from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

SYSTEM = "reference_software.yaml"
#: Scenario time of the repetitions, s. An hour is compared once, between the two arrangements.
SHORT = 600


@pytest.fixture(scope="module")
def four_runs(runs):
    short = ("--duration", SHORT, "--no-report")
    return {
        "distributed_1": runs.make("distributed_1", SYSTEM)[0],
        "distributed_2": runs.make("distributed_2", SYSTEM, *short)[0],
        "composed_1": runs.make("composed_1", SYSTEM, "--composed", "--no-report")[0],
        "composed_2": runs.make("composed_2", SYSTEM, "--composed", *short)[0],
    }


@pytest.mark.parametrize(
    ("first", "second", "duration"),
    [
        ("distributed_1", "distributed_2", SHORT),
        ("composed_1", "composed_2", SHORT),
        ("distributed_1", "composed_1", None),
        ("distributed_2", "composed_2", None),
    ],
)
def test_runs_are_equal_byte_for_byte(four_runs, first, second, duration):
    names = topics(four_runs[first])
    assert names == topics(four_runs[second])
    assert len(names) >= 8
    end = None
    if duration is not None:
        end = BagReader(four_runs[first]).start_time + duration * NANOSECONDS_PER_SECOND
        names.remove("/sim/status")  # tells how long the run is to last
    compared = assert_equal_messages(four_runs[first], four_runs[second], names, end)
    assert compared > 6 * SHORT


def test_another_controller_gives_other_messages(runs, four_runs):
    """The comparison can fail."""
    other = runs.make(
        "other", SYSTEM, "sdre_controller.design:=delay_aware", "--duration", 60, "--composed",
        "--no-report",
    )[0]  # fmt: skip
    topic = "/deputy/control/thrust_command"
    first, second = (
        serialized_topics(run, [topic])[topic][:60] for run in (four_runs["composed_1"], other)
    )
    assert len(first) == len(second) == 60
    assert first != second


def test_the_ionosphere_is_equal_byte_for_byte(runs):
    """With receivers in the loop, down to densities and contents."""
    short = "esf.yaml", "--duration", 12, "--composed", "--no-report"
    first, second = (runs.make(name, *short)[0] for name in ("esf_short", "esf_short_again"))
    names = {name for name in topics(first) if "iono/" in name or name.startswith("/formation/")}
    assert {"/chief/iono/slant_tec", "/formation/electron_density"} <= names <= topics(second)
    assert_equal_messages(first, second, names)
    assert BagReader(first).topics["/formation/electron_density"].message_count >= 9

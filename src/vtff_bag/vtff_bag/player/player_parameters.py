"""Parameters of the node `bag_player`."""

from __future__ import annotations

from dataclasses import dataclass

from vtff_bag.player.messages_in_order import CLOCK_TOPIC
from vtff_bag.player.replay_clock import LARGEST_RATE, SMALLEST_RATE
from vtff_node.parameters import REQUIRED, parameter, with_default
from vtff_node.step_source import StepSourceParameters

__all__ = ["BagPlayerParameters"]

PACINGS = ("wall", "steps", "clock")


@dataclass(frozen=True)
class BagPlayerParameters(StepSourceParameters):
    """Parameters of `bag_player`; with pacing steps it is the step source of the run."""

    bag: str = parameter(REQUIRED, "bag directory, run folder or .mcap file")
    pacing: str = parameter(
        "wall",
        "what the messages wait for: the wall clock, acknowledged steps, or a live /clock",
        choices=PACINGS,
    )
    topics: list[str] = parameter([], "full names of the topics to replay; all if empty")
    exclude_topics: list[str] = parameter([], "full names of topics to leave out")
    publish_clock: bool = parameter(
        True, "publish /clock where no recorded /clock is replayed; never with pacing clock"
    )
    rate: float = parameter(
        1.0,
        "pacing wall: recorded seconds per second",
        minimum=SMALLEST_RATE,
        maximum=LARGEST_RATE,
    )
    start_offset: float = parameter(
        0.0, "pacing wall: where to begin, after the first message", unit="s", minimum=0.0
    )
    loop: bool = parameter(False, "pacing wall: begin again at the end")
    start_paused: bool = parameter(False, "pacing wall: wait for ~/resume or ~/step")
    delay: float = parameter(
        0.5, "pacing wall: time for readers to find the topics", unit="s", minimum=0.0
    )
    step_topic: str = parameter(CLOCK_TOPIC, "pacing steps: topic whose stamps are the steps")
    duration: float | None = parameter(
        None, "pacing steps: recorded time to replay; without it all", unit="s", minimum=0.0
    )
    stands_for: list[str] = parameter(
        [],
        "pacing steps: nodes whose recorded work is replayed; each step is acknowledged for them",
    )
    step_timeout: float = with_default(StepSourceParameters, "step_timeout", 10.0)

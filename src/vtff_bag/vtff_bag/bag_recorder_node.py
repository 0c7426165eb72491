"""Node `bag_recorder`: records every topic of the graph into an MCAP bag that `ros2 bag` opens."""

from __future__ import annotations

import dataclasses
import os
import pathlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.subscription import Subscription

from vtff_bag.file.errors import BagWriteError
from vtff_bag.file.writer import COMPRESSIONS, DEFAULT_CHUNK_SIZE, BagWriter
from vtff_bag.recorder.recorder import GATHER_LIMIT, SEARCH_INTERVAL, Recorder
from vtff_bag.recorder.recording_rules import Acknowledger, GatherPace, TopicSelection
from vtff_bag.run.description import describe_run_folder
from vtff_bag.run.environment import describe_environment
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import EXIT_FAILURE, VtffNode
from vtff_node.parameters import REQUIRED, ParameterError, parameter
from vtff_node.process.run_environment import RUN_DIRECTORY_VARIABLE
from vtff_node.stamps import to_stamp
from vtff_node.start.unannounced import take_unannounced

ALIVE_INTERVAL = 0.5  # s of wall time between signs of life
GATHER_TIME = 0.01  # s of wall time between looks at what has come
DRAIN_QUIET = 0.2  # s of wall time without a message, after which draining ends
DRAIN_LIMIT = 5.0  # s of wall time after which draining ends in any case


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of `bag_recorder`."""

    output: str = parameter(REQUIRED, "directory of the bag, made by the recorder")
    compression: str = parameter("zstd", "compression of the chunks", choices=tuple(COMPRESSIONS))
    chunk_size: int = parameter(
        DEFAULT_CHUNK_SIZE,
        "size of a chunk before compression",
        unit="bytes",
        minimum=1024,
        maximum=64 * 1024 * 1024,
    )
    include: str = parameter("", "regular expression: record only topics that match somewhere")
    exclude_topics: list[str] = parameter([], "full names of topics that are not recorded")
    include_hidden: bool = parameter(False, "record hidden topics and /parameter_events as well")
    acknowledge_every: int = parameter(
        10, "in lockstep, steps between acknowledgements", minimum=1, maximum=1000
    )
    wait_for_nodes: list[str] = parameter(
        [], "in lockstep, full names of nodes to hear, each topic, before the first acknowledgement"
    )
    custom_data: list[str] = parameter([], "texts for the metadata of the bag, each key=value")

    def __post_init__(self) -> None:
        """Check the regular expression and the form of the texts."""
        self.selection()
        self.custom_metadata()

    def selection(self) -> TopicSelection:
        """Return the topics that are recorded."""
        return TopicSelection(self.include, tuple(self.exclude_topics), self.include_hidden)

    def custom_metadata(self) -> dict[str, str]:
        """Return `custom_data` as a mapping.

        Raises
        ------
        ValueError
            If an entry has no equals sign.
        """
        pairs = {}
        for entry in self.custom_data:
            key, separator, value = entry.partition("=")
            if not key or not separator:
                raise ValueError(f"parameter 'custom_data': '{entry}' is not of the form key=value")
            pairs[key] = value
        return pairs


class BagRecorderNode(VtffNode):
    """Record every topic into an MCAP bag, stamped with scenario time, until SIGINT or SIGTERM."""

    Parameters = BagRecorderParameters
    yields_to_others = True
    #: What acts on messages goes before what keeps them.
    niceness = 5

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("bag_recorder", **node_arguments)
        table: BagRecorderParameters = self.parameters
        try:
            self._writer = BagWriter(
                table.output,
                {**_run_texts(), **table.custom_metadata()},
                table.chunk_size,
                table.compression,
            )
        except BagWriteError as error:
            raise ParameterError(f"parameter 'output': {error}") from error
        self._failure: BagWriteError | None = None
        self._acknowledger = (
            Acknowledger(self._acknowledge, table.acknowledge_every) if self.lockstep else None
        )
        self._recorder = Recorder(
            self,
            self._writer,
            table.selection(),
            self._acknowledger,
            table.wait_for_nodes,
            self._end_recording,
            self._ask_for_end,
        )
        self._gather_pace = GatherPace(GATHER_LIMIT)
        self._alive_next = 0.0
        self._was_stable = False
        self._timer = self.create_timer(SEARCH_INTERVAL, self._tick, clock=self.steady_clock)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions whose messages the executor takes; the recorder takes those of others."""
        recorder: Recorder | None = getattr(self, "_recorder", None)
        gathered = [] if recorder is None else recorder.gathered_subscriptions
        return (each for each in super().subscriptions if each not in gathered)

    def _tick(self) -> None:
        self._recorder.tick()
        now = time.monotonic()
        # Told at once: the flight begins with it, and `vtff run` has something to lose from then.
        if now >= self._alive_next or self._recorder.stable != self._was_stable:
            self._alive_next = now + ALIVE_INTERVAL
            if self._recorder.stable and not self._was_stable:
                self.destroy_timer(self._timer)
                self._timer = self.create_timer(GATHER_LIMIT, self._tick, clock=self.steady_clock)
            self._was_stable = self._recorder.stable
            self.report_alive(self._recorder.stable)

    def choose_gather_time(self) -> float:
        """Return the time until the next look: nobody waits for a single message to be recorded."""
        if self._acknowledger is None or not self._recorder.stable:
            return GATHER_TIME
        return self._gather_pace.choose(time.monotonic(), self._acknowledger.steps)

    def _acknowledge(self, stamp_nanoseconds: int) -> None:
        # What is acknowledged is in the file, also if this process is killed at once.
        self._recorder.flush()
        self.acknowledge_step(to_stamp(stamp_nanoseconds), time.perf_counter())

    def _end_recording(self, error: BagWriteError) -> None:
        self._failure = error
        self.get_logger().fatal(f"recording ends: {error}")
        self.finish(EXIT_FAILURE)

    def _ask_for_end(self, reason: str) -> None:
        # `vtff run` ends the run at this line. The recorder goes on until then.
        self.get_logger().fatal(f"end the run: {reason}")

    def health(self) -> list[DiagnosticStatus]:
        """Report the number of topics and messages, or why recording has ended."""
        recorder = self._recorder
        self.scenario_nanoseconds = recorder.scenario_nanoseconds
        values = {
            "bag": self._writer.directory,
            "topics": len(recorder.topic_names),
            "messages": recorder.received,
        }
        name = f"{self.get_name()}: recording"
        if self._failure is not None:
            return [diagnostics.status(name, diagnostics.ERROR, str(self._failure), values)]
        if self._writer.disk_alarm:
            return [diagnostics.status(name, diagnostics.ERROR, self._writer.disk_alarm, values)]
        if recorder.missing:
            text = f"not heard yet: {', '.join(recorder.missing)}"
            return [diagnostics.status(name, diagnostics.WARN, text, values)]
        if not recorder.topic_names:
            return [diagnostics.status(name, diagnostics.WARN, "no topic yet", values)]
        return [diagnostics.status(name, diagnostics.OK, "recording", values)]

    def awaited_inputs(self) -> list[str]:
        """Return what is not heard yet of the nodes of the run."""
        return self._recorder.missing

    def on_stop(self) -> None:
        """Stop acknowledging, record the messages that are on their way, and close the bag."""
        if self._acknowledger is not None:
            self._acknowledger.stopped = True
        if self._failure is None:
            self._drain()
            self._close_bag()
        counts = self._writer.message_counts
        for topic in sorted(counts):
            print(f"{counts[topic]:10d}  {topic}")
        print(f"{sum(counts.values()):10d}  messages in {self._writer.directory}", flush=True)

    def _drain(self) -> None:
        executor = self.executor
        if executor is None:
            return
        # Its subscriptions are made at any time of a run.
        take_unannounced(self.subscriptions)
        started = quiet_since = time.monotonic()
        received = self._recorder.received
        while self.context.ok() and time.monotonic() - started < DRAIN_LIMIT:
            executor.spin_once(timeout_sec=DRAIN_QUIET / 4)
            self._recorder.take_gathered()
            now = time.monotonic()
            if self._recorder.received != received:
                received, quiet_since = self._recorder.received, now
            elif now - quiet_since >= DRAIN_QUIET:
                return

    def _close_bag(self) -> None:
        try:
            self._recorder.finish()
            # The texts are read again: by now every node has written its parameters.
            self._writer.add_custom_metadata(_run_texts())
            self._writer.close()
        except BagWriteError as error:
            self._end_recording(error)


def _run_texts() -> dict[str, str]:
    """Return the description of the run as texts for the metadata; empty outside `vtff run`."""
    directory = os.environ.get(RUN_DIRECTORY_VARIABLE)
    if not directory:
        return {}
    described = describe_run_folder(pathlib.Path(directory))
    complete = dataclasses.replace(described, environment=describe_environment())
    return complete.as_custom_data(directory, str(pathlib.Path.cwd()))


NODE_CLASS = BagRecorderNode


def main() -> None:
    """Run the recorder until a signal ends it."""
    run_node(BagRecorderNode)


if __name__ == "__main__":
    main()

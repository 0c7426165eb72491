"""Base class of every vtff node: parameters, counted publishers, diagnostics, lockstep."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import pathlib
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from vtff_msgs.msg import StepDone
from vtff_node import diagnostics, parameters, qos
from vtff_node.plugins.loading import Plugin, PluginError, PluginGroup, load_plugin
from vtff_node.process.run_environment import PROGRESS_VARIABLE, RUN_DIRECTORY_VARIABLE
from vtff_node.samples import SampleError, SampleReader
from vtff_node.stamps import to_nanoseconds, to_stamp
from vtff_node.start.awaited_inputs import AwaitedInputs
from vtff_node.start.listeners import (
    DIAGNOSTICS_TOPIC,
    TOPICS_OF_ALL_NODES,
    ListenerWatch,
    listener_values,
    status_name,
)
from vtff_node.start.unannounced import take_unannounced

#: Topic on which nodes acknowledge steps to the step source, and report that they are ready.
STEP_DONE_TOPIC = "/sim/step_done"

#: Topics of the run itself: a node without them works with what it has.
RUN_TOPICS = ("/clock", STEP_DONE_TOPIC)

#: Exit codes of a node executable: it failed, or a parameter or a ROS argument is wrong.
EXIT_FAILURE = 1
EXIT_USAGE = 2

PROGRESS_INTERVAL = 0.2  # s of wall time between progress lines
LISTENER_INTERVAL = 0.05  # s of wall time between looks at the listeners while a run starts
#: Time that the nodes of a closing process wait for readers of their last messages, s. With the
#: 5 s after which a step is given up it is longer than the 10 s after which `vtff run` lets a
#: stopped recorder go on: that still gets what the nodes hold for it.
ACKNOWLEDGE_TIMEOUT = 8.0


@dataclass(frozen=True)
class CommonParameters:
    """Parameters that every vtff node has."""

    lockstep: bool = parameters.parameter(
        False, "run in lockstep; otherwise the wall clock or the hardware paces"
    )
    acknowledge_steps: bool = parameters.parameter(
        False, "in lockstep, acknowledge each step to the step source on /sim/step_done"
    )
    reports_ready: bool = parameters.parameter(
        False, "report on /sim/step_done, with a zero stamp, that this node is ready for the run"
    )


class CountingPublisher(Publisher):
    """A publisher that counts the messages it has sent."""

    published = 0

    def publish(self, msg: Any) -> None:
        """Publish a message or serialised bytes and count it."""
        self.published += 1
        super().publish(msg)


class VtffNode(Node):
    """A thin ROS node.

    A subclass names its parameter table in `Parameters`, creates publishers with
    `publisher` and subscriptions with `subscribe`, acknowledges each step with
    `acknowledge_step` and describes its health in `health`. A subclass whose work is done by a
    plug-in names the group in `Plugins`; `plugin` and `plugin_parameters` are then set.
    """

    Parameters: ClassVar[type | None] = None
    Plugins: ClassVar[PluginGroup | None] = None
    #: Whether a process of such nodes alone never interrupts the work of another process.
    yields_to_others: ClassVar[bool] = False
    #: Niceness in real time where the system permits it: other work of the machine waits then, so
    #: that it does not come between a measurement and its command. Below 0 such a process also asks
    #: for a real-time priority.
    niceness: ClassVar[int] = -10

    def __init__(self, name: str, **node_arguments: Any) -> None:
        super().__init__(name, **node_arguments)
        self.common = parameters.declare(self, CommonParameters)
        #: In lockstep, subscriptions also receive what was published before their discovery.
        self.lockstep: bool = self.common.lockstep
        self.parameters: Any = (
            parameters.declare(self, self.Parameters) if self.Parameters is not None else None
        )
        self.plugin_parameters: Any = None
        if self.Plugins is not None:
            self.plugin = load_plugin(
                self.Plugins, getattr(self.parameters, self.Plugins.parameter)
            )
            self.plugin_parameters = self._declare_plugin_parameters(self.plugin)
        parameters.refuse_unknown(self)
        self.warm_up()
        #: Newest scenario time this node has seen, ns since 1970; 0 before the first message.
        self.scenario_nanoseconds = 0
        self._first_scenario_nanoseconds = 0
        self.finished = False
        #: Called when this node finishes; the main loop of its process sets it.
        self.on_finish: Callable[[], object] = lambda: None
        self.exit_code = 0
        #: Why this node cannot go on, one line; empty while it can.
        self.problem = ""
        self._counted: list[CountingPublisher] = []
        self._progress_next = 0.0
        self._progress_descriptor = _find_progress_descriptor()
        self._qualified_name = self.get_fully_qualified_name()
        self._step_done = StepDone(node=self._qualified_name)
        self._acknowledges_steps = self.lockstep and self.common.acknowledge_steps
        publishes_step_done = self._acknowledges_steps or self.common.reports_ready
        self._step_publisher = (
            self.publisher(StepDone, STEP_DONE_TOPIC) if publishes_step_done else None
        )
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics_publisher = self.publisher(DiagnosticArray, DIAGNOSTICS_TOPIC)
        self._closing = False
        self._required_topics: list[str] = []
        self._awaited_inputs = AwaitedInputs(self.awaited_inputs, self._say)
        self._listeners = ListenerWatch(
            self._count_listeners, self._find_listeners, self._publish_listeners
        )
        self._listener_timer: Timer | None = None
        self._has_told_lateness = False
        #: Samples that were no messages, by topic.
        self._dropped_samples: dict[str, int] = {}
        self.create_timer(1.0, self._on_diagnostics_timer, clock=self.steady_clock)

    def warm_up(self) -> None:
        """Call the algorithm once on a small synthetic input, so that the first step is not late.

        A first run compiles here for up to a minute. Called with the parameters declared and before
        the node has any topic: `unready_nodes` names it until then. Subclasses replace this method;
        the instance that they call is used for nothing else.
        """

    def _declare_plugin_parameters(self, plugin: Plugin) -> Any:
        table = plugin.parameter_table
        if table is None:
            return None
        for field in dataclasses.fields(table):
            if self.has_parameter(field.name):
                problem = f"its parameter '{field.name}' is one of {self.get_name()}"
                raise PluginError(plugin.describe(problem))
        return parameters.declare(self, table)

    def publisher(
        self, message_type: type, topic: str, profile: QoSProfile = qos.PUBLISH
    ) -> CountingPublisher:
        """Create a publisher that counts; the counts are compared with the bag after a run."""
        publisher = self.create_publisher(
            message_type, topic, profile, publisher_class=CountingPublisher
        )
        assert isinstance(publisher, CountingPublisher)
        self._counted.append(publisher)
        return publisher

    def subscribe(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        *,
        latched: bool = False,
        required: bool = True,
    ) -> Subscription:
        """Create a subscription with the profile of the pacing in force.

        A sample that is no message of the type, such as one cut short, is dropped and counted.

        Parameters
        ----------
        message_type, topic, callback
            As for ``create_subscription``.
        latched
            Values of the topic hold until they are replaced (ephemerides, status): receive also
            those that were published before discovery.
        required
            Whether the node says that it waits for a publisher. Of a topic of the run itself,
            such as /clock, it does not.
        """
        reader = SampleReader(message_type)

        def take(sample: bytes) -> None:
            try:
                message = reader.read(sample)
            except SampleError as error:
                self._drop_sample(subscription.topic_name, error)
            else:
                callback(message)

        subscription = self.create_subscription(
            message_type, topic, take, qos.subscribe(self.lockstep or latched), raw=True
        )
        if required and subscription.topic_name not in RUN_TOPICS:
            self._required_topics.append(subscription.topic_name)
        return subscription

    def _drop_sample(self, topic: str, error: SampleError) -> None:
        self._dropped_samples[topic] = self._dropped_samples.get(topic, 0) + 1
        self.get_logger().warning(
            f"a sample of {topic} is dropped: {error}", throttle_duration_sec=5.0
        )

    def is_of_deputy(self, message: Any, deputy: str, topic: str) -> bool:
        """Return whether a message names the deputy that this node works for; warn if it does not.

        Parameters
        ----------
        message
            Message with a ``child_frame_id``.
        deputy
            Name of the deputy.
        topic
            Topic of the message, for the warning.
        """
        if message.child_frame_id == deputy:
            return True
        self.get_logger().warning(
            f"{topic} names '{message.child_frame_id}', not the deputy '{deputy}': ignored",
            throttle_duration_sec=5.0,
        )
        return False

    def acknowledge_step(self, stamp: Any, started: float) -> None:
        """Note that this node has finished a step; acknowledge it if `acknowledge_steps` is set.

        Parameters
        ----------
        stamp : builtin_interfaces.msg.Time
            Stamp of the step.
        started
            ``time.perf_counter()`` when the work on the step began.
        """
        self.scenario_nanoseconds = to_nanoseconds(stamp)
        if self._step_publisher is not None and self._acknowledges_steps:
            self._step_done.header.stamp = stamp
            self._step_done.compute_time = time.perf_counter() - started
            self._step_publisher.publish(self._step_done)

    def report_ready(self) -> None:
        """Report that this node has prepared what it needs, if `reports_ready` is set.

        The report is a StepDone with a zero stamp, which names no step.
        """
        if self._step_publisher is not None and self.common.reports_ready:
            self._step_publisher.publish(StepDone(node=self._qualified_name))

    def absent_nodes(self, expected: Sequence[str]) -> list[str]:
        """Return those of the expected fully qualified node names that are not in the graph."""
        present = {
            f"{namespace.rstrip('/')}/{name}"
            for name, namespace in self.get_node_names_and_namespaces()
        }
        return [name for name in expected if name not in present]

    def unready_nodes(self, expected: Sequence[str]) -> list[str]:
        """Return those of the expected nodes that are absent, or have no topic of their own yet."""
        unready = self.absent_nodes(expected)
        for name in set(expected).difference(unready):
            namespace, _, node = name.rpartition("/")
            topics = []
            with contextlib.suppress(RuntimeError):  # it has just gone
                topics += self.get_publisher_names_and_types_by_node(node, namespace or "/")
                topics += self.get_subscriber_names_and_types_by_node(node, namespace or "/")
            if {topic for topic, _ in topics} <= TOPICS_OF_ALL_NODES:
                unready.append(name)
        return unready

    def awaited_inputs(self) -> list[str]:
        """Return one text for each input that is not there; subclasses add their devices."""
        return [
            f"a publisher of {topic}"
            for topic in self._required_topics
            if not self.count_publishers(topic)
        ]

    def choose_gather_time(self) -> float:
        """Return for how long messages may gather before a process of such nodes takes them.

        It is asked for before each wait, and in s of wall time; 0 to take each at once.
        """
        return 0.0

    def begin(self) -> None:
        """Say that this node begins; called once its process handles callbacks."""
        self._say("begins")
        self._listeners.look()
        self._listener_timer = self.create_timer(
            LISTENER_INTERVAL, self._watch_listeners, clock=self.steady_clock
        )

    def _say(self, text: str) -> None:
        self.get_logger().info(text)

    def health(self) -> list[DiagnosticStatus]:
        """Return the diagnostic states of the node; subclasses replace this method."""
        return [diagnostics.status(f"{self.get_name()}: running", diagnostics.OK, "running")]

    def _on_diagnostics_timer(self) -> None:
        # A recorder that is closing could no longer record its own diagnostics.
        if not self._closing:
            self.publish_diagnostics()
            self._awaited_inputs.look()
            self._listeners.look()

    def _watch_listeners(self) -> None:
        if not self._closing:
            self._listeners.look()
            # Subscriptions are made before time runs; only then can a message be overlooked.
            take_unannounced(self.subscriptions)
        # Once scenario time runs, the recorder hears this node, or this is not a lockstep run.
        if self._listener_timer is not None and (self._listeners.is_over or self._time_has_run()):
            self._listener_timer.cancel()

    def _time_has_run(self) -> bool:
        """Return whether scenario time has gone on after its first value."""
        self._first_scenario_nanoseconds = (
            self._first_scenario_nanoseconds or self.scenario_nanoseconds
        )
        return self.scenario_nanoseconds > self._first_scenario_nanoseconds

    def _count_listeners(self) -> list[int]:
        return [publisher.get_subscription_count() for publisher in self._counted]

    def _find_listeners(self) -> dict[str, list[str]]:
        return {
            topic: [
                f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
                for endpoint in self.get_subscriptions_info_by_topic(topic)
            ]
            for topic in {publisher.topic_name for publisher in self._counted}
        }

    def _publish_listeners(self, listeners: Mapping[str, Collection[str]]) -> None:
        name, text = status_name(self._qualified_name), f"{len(listeners)} topics"
        values = listener_values(listeners)
        self.publish_reports([diagnostics.status(name, diagnostics.OK, text, values)])

    def publish_diagnostics(self) -> None:
        """Publish `health` on /diagnostics; called once a second of wall time."""
        self.publish_reports([*self.health(), *self._plugin_reports(), *self._sample_reports()])

    def _sample_reports(self) -> list[DiagnosticStatus]:
        """Return a report on samples that were no messages; empty if there were none."""
        if not self._dropped_samples:
            return []
        text = f"{sum(self._dropped_samples.values())} samples dropped"
        name = f"{self.get_name()}: samples"
        place = self.get_namespace().strip("/")
        counts = self._dropped_samples
        return [diagnostics.status(name, diagnostics.WARN, text, counts, hardware_id=place)]

    def _plugin_reports(self) -> list[DiagnosticStatus]:
        """Return a report on a plug-in that is slower than real time; empty for a fast one."""
        late = self.plugin.lateness if self.Plugins is not None else ""
        if not late:
            return []
        if not self._has_told_lateness:
            self._has_told_lateness = True
            self.get_logger().warning(late)
        counts = {
            "calls": self.plugin.calls,
            "late calls": self.plugin.late_calls,
            "longest call, s": f"{self.plugin.longest_call:.3f}",
        }
        name = f"{self.get_name()}: plug-in"
        place = self.get_namespace().strip("/")
        return [diagnostics.status(name, diagnostics.WARN, late, counts, hardware_id=place)]

    def publish_reports(self, reports: list[DiagnosticStatus]) -> None:
        """Publish reports on /diagnostics."""
        message = DiagnosticArray(status=reports)
        message.header.stamp = to_stamp(self.scenario_nanoseconds)
        self._diagnostics_publisher.publish(message)

    def report_progress(
        self, done: float, total: float, *, urgent: bool = False, **shown: Any
    ) -> None:
        """Write a progress line for `vtff run`, at most a few times a second.

        Parameters
        ----------
        done, total
            Seconds of scenario time, or bytes of a file.
        urgent
            Write the line however short ago the last one was.
        shown
            Further values that the progress bar shows.
        """
        if not (urgent or done >= total or self.is_progress_due()):
            return
        self._progress_next = time.monotonic() + PROGRESS_INTERVAL
        self._write_to_runner({"node": self._qualified_name, "done": done, "total": total, **shown})

    def is_progress_due(self) -> bool:
        """Return whether somebody waits for a progress line, and the last one is old enough."""
        return self._progress_descriptor is not None and time.monotonic() >= self._progress_next

    def report_alive(self, ready: bool) -> None:
        """Tell `vtff run` that this node goes on; to be called about once a second of wall time.

        Parameters
        ----------
        ready
            Whether the node does all that a run needs of it.
        """
        self._write_to_runner({"alive": self._qualified_name, "ready": ready})

    def _write_to_runner(self, report: Mapping[str, Any]) -> None:
        if self._progress_descriptor is None:
            return
        try:
            os.write(self._progress_descriptor, json.dumps(report).encode() + b"\n")
        except BlockingIOError:
            return  # the pipe is full; a later line replaces this one
        except OSError:
            self._progress_descriptor = None  # the runner has gone

    def finish(self, exit_code: int = 0) -> None:
        """End this node's process (or its part of a composed run) after the current callback."""
        self.finished = True
        self.on_finish()
        self.exit_code = max(self.exit_code, exit_code)

    def fail(self, problem: str) -> None:
        """End this node with a failure; log its reason and keep it in `problem`."""
        self.problem = problem
        self.get_logger().error(problem)
        if not self._closing:
            self.publish_diagnostics()
        self.finish(EXIT_FAILURE)

    def on_stop(self) -> None:
        """Put hardware into a safe state; called once before the node is destroyed."""

    def close(self, patience: float = ACKNOWLEDGE_TIMEOUT) -> None:
        """Stop, wait until readers have the last messages, and write the message counts.

        Parameters
        ----------
        patience
            Longest wait for readers, s of wall time.
        """
        self._closing = True
        self.on_stop()
        deadline = time.monotonic() + patience
        for publisher in self._counted:
            remaining = max(0.0, deadline - time.monotonic())
            publisher.wait_for_all_acked(Duration(seconds=remaining))
        self._write_counts()

    def _write_counts(self) -> None:
        directory = os.environ.get(RUN_DIRECTORY_VARIABLE)
        if not directory:
            return
        counts: dict[str, int] = {}
        for publisher in self._counted:
            topic = publisher.topic_name
            counts[topic] = counts.get(topic, 0) + publisher.published
        record = {
            "node": self._qualified_name,
            "exit_code": self.exit_code,
            "process_cpu_time_s": round(time.process_time(), 3),
            "published": counts,
            "dropped_samples": self._dropped_samples,
        }
        folder = pathlib.Path(directory) / "nodes"
        name = self._qualified_name.strip("/").replace("/", "__")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps(record, indent=1) + "\n"
            (folder / f"{name}.json").write_text(text, encoding="utf-8")
        except OSError as error:
            self.get_logger().error(f"the message counts cannot be written: {error}")


def _find_progress_descriptor() -> int | None:
    text = os.environ.get(PROGRESS_VARIABLE, "")
    return int(text) if text.isdigit() else None

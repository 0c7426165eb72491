"""`vtff topic`: topics of a running graph or of a bag, where no ros2 command is installed."""

from __future__ import annotations

import pathlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from rich.console import Console

from vtff_bag.file.errors import BagError, UnknownTypeError
from vtff_bringup.discover.completion import complete_run, complete_topic
from vtff_bringup.discover.running_graph import domain_text, running_graph
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE

if TYPE_CHECKING:
    from vtff_node.process.stop_signals import StopRequest

app = typer.Typer(
    help="Look at the topics of a running graph, or of a bag.\n\nThe graph is that of"
    " ROS_DOMAIN_ID (0 if it is not set).",
    no_args_is_help=True,
)

DISCOVERY_TIME = 2.0  # s of wall time in which programs of a graph are found
WAIT = 10.0  # s of wall time for a topic or its first message

Bag = Annotated[
    Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
    typer.Option(
        "--bag",
        help="Bag directory, run folder or .mcap file instead of a graph.",
        autocompletion=complete_run,
    ),
]
Topic = Annotated[
    str,
    typer.Argument(help="Full name, e.g. /deputy/relative_state", autocompletion=complete_topic),
]


@app.command("list")
def list_topics(bag: Bag = None) -> None:
    """List topics with their types.

    A bag also tells the number of messages and their rate.
    """
    console = make_console()
    if bag is not None:
        reader = _open(console, bag)
        seconds = max(1e-9, (reader.end_time - reader.start_time) * 1e-9)
        for name, topic in sorted(reader.topics.items()):
            rate = topic.message_count / seconds
            text = f"{name:40} {topic.type:36} {topic.message_count:8d} {rate:9.3f} Hz"
            console.print(text, markup=False, soft_wrap=True)
        return
    with running_graph() as (node, _, stop):
        deadline = time.monotonic() + DISCOVERY_TIME
        while time.monotonic() < deadline and not stop.requested:
            time.sleep(0.05)
        topics = [
            (name, types)
            for name, types in sorted(node.get_topic_names_and_types())
            if node.count_publishers(name) and name not in ("/parameter_events", "/rosout")
        ]
    if not topics:
        raise exit_with_error(console, f"no topic in {domain_text()}", EXIT_FAILURE)
    for name, types in topics:
        console.print(f"{name:40} {', '.join(types)}", markup=False, soft_wrap=True)


@app.command("echo", no_args_is_help=True)
def echo(
    topic: Topic,
    bag: Bag = None,
    count: Annotated[int, typer.Option(help="Messages; 0: all.", min=0)] = 0,
) -> None:
    """Print messages field by field, with units.

    Units are those that the message definition gives.
    """
    from vtff_node.message_text import message_lines

    console = make_console()
    shown = 0
    for message in _messages(console, topic, bag):
        for line in message_lines(message):
            console.print(line, markup=False, soft_wrap=True)
        console.print("---", markup=False)
        shown += 1
        if shown == count:
            return


@app.command("hz", no_args_is_help=True)
def hz(
    topic: Topic,
    bag: Bag = None,
    window: Annotated[int, typer.Option(help="Messages of a mean.", min=2)] = 100,
) -> None:
    """Print how often messages come.

    A running graph is watched in wall time until Ctrl-C; a bag tells its recorded time, once.
    """
    console = make_console()
    if bag is not None:
        reader = _open(console, bag)
        if topic not in reader.topics:
            raise exit_with_error(console, _no_topic(topic, reader.topics), EXIT_USAGE)
        times = [raw.log_time * 1e-9 for raw in reader.raw_messages([topic])]
        console.print(_rate_text(times), markup=False)
        return
    times = []
    printed = time.monotonic()
    for _ in _messages(console, topic, None):
        times = [*times, time.monotonic()][-window:]
        if times[-1] - printed >= 1.0 and len(times) > 1:
            printed = times[-1]
            console.print(_rate_text(times), markup=False)


def _rate_text(times: list[float]) -> str:
    if len(times) < 2 or times[-1] == times[0]:
        return f"{len(times)} messages, no rate"
    intervals = [later - earlier for earlier, later in zip(times, times[1:], strict=False)]
    mean = (times[-1] - times[0]) / len(intervals)
    return (
        f"{1.0 / mean:.3f} Hz; interval {mean:.6f} s, "
        f"from {min(intervals):.6f} to {max(intervals):.6f} s, {len(times)} messages"
    )


def _messages(console: Console, topic: str, bag: pathlib.Path | None) -> Iterator[Any]:
    """Yield deserialised messages of a bag, or of the graph until Ctrl-C."""
    if bag is not None:
        reader = _open(console, bag)
        if topic not in reader.topics:
            raise exit_with_error(console, _no_topic(topic, reader.topics), EXIT_USAGE)
        try:
            for decoded in reader.messages(topic):
                yield decoded.message
        except BagError as error:
            raise exit_with_error(console, error, EXIT_FAILURE) from error
        return
    with running_graph() as (node, executor, stop):
        message_type = _wait_for_type(console, node, topic, stop)
        if message_type is None:
            return
        from vtff_bag.file.message_definitions import message_class
        from vtff_node import qos

        received: list[Any] = []
        offers = node.get_publishers_info_by_topic(topic)
        profile = qos.subscribe(with_history=False)
        if any(offer.qos_profile.reliability.name == "BEST_EFFORT" for offer in offers):
            profile.reliability = type(profile.reliability).BEST_EFFORT
        try:
            kind = message_class(message_type)
        except UnknownTypeError as error:
            raise exit_with_error(console, f"{topic}: {error}", EXIT_FAILURE) from error
        node.create_subscription(kind, topic, received.append, profile)
        while not stop.requested:
            executor.spin_once(timeout_sec=0.1)
            yield from received
            received.clear()


def _wait_for_type(console: Console, node: Any, topic: str, stop: StopRequest) -> str | None:
    """Return the type of a topic that is published, or None after Ctrl-C."""
    deadline = time.monotonic() + WAIT
    while not stop.requested:
        types = dict(node.get_topic_names_and_types())
        if topic in types and node.count_publishers(topic):
            return str(types[topic][0])
        if time.monotonic() > deadline:
            text = f"{_no_topic(topic, types)}; looked in {domain_text()} for {WAIT:g} s"
            raise exit_with_error(console, text, EXIT_FAILURE)
        time.sleep(0.05)
    return None


def _open(console: Console, bag: pathlib.Path) -> Any:
    from vtff_bag.file.reader import BagReader

    try:
        return BagReader(bag)
    except BagError as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error


def _no_topic(topic: str, topics: Any) -> str:
    import difflib

    near = difflib.get_close_matches(topic, list(topics), n=3)
    return f"no topic '{topic}'" + (f"; did you mean: {', '.join(near)}?" if near else "")

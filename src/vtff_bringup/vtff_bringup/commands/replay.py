"""`vtff replay`: publish the messages of a bag."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from rich.console import Console

from vtff_bringup.commands.command_line import RecordedRun
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import print_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE

if TYPE_CHECKING:
    from vtff_bag.bag_player_node import BagPlayerNode


def replay(
    bag: RecordedRun,
    rate: Annotated[float, typer.Option(help="Recorded seconds per second of wall time.")] = 1.0,
    start_offset: Annotated[
        float, typer.Option(help="Where to begin, s after the first message.", min=0.0)
    ] = 0.0,
    topics: Annotated[
        Optional[list[str]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(metavar="TOPIC", help="Only these topics, full names; may be repeated."),
    ] = None,
    exclude_topics: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="TOPIC", help="Not these topics, full names; may be repeated."),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", "-l", help="Begin again at the end.")] = False,
    start_paused: Annotated[
        bool, typer.Option("--start-paused", "-p", help="Wait for a key or a service call.")
    ] = False,
    clock: Annotated[
        bool,
        typer.Option("--clock/--no-clock", help="Publish /clock where the bag has none."),
    ] = True,
    delay: Annotated[
        float, typer.Option(help="Wall time for readers to find the topics, s.", min=0.0)
    ] = 0.5,
) -> None:
    """Publish the messages of a bag again.

    Every message comes once, in order, with its bytes unchanged. /clock goes out as recorded, or
    before each message where the bag has none. Keys: space pauses and resumes, right arrow
    publishes the next message, up and down change the rate, left goes back 10 s, page down forward
    10 s, 0 to the start, q ends. The node /bag_player offers the same as services: ~/pause,
    ~/resume, ~/step, ~/seek, ~/set_rate. Messages are published in ROS_DOMAIN_ID (0 if it is not
    set).

    Example: vtff replay bags/mine --rate 10 --exclude-topics /deputy/relative_state
    """
    console = make_console()
    parameters = {
        "bag": str(bag),
        "rate": rate,
        "start_offset": start_offset,
        "topics": topics or [],
        "exclude_topics": exclude_topics or [],
        "loop": loop,
        "start_paused": start_paused,
        "publish_clock": clock,
        "delay": delay,
    }
    raise typer.Exit(_play(console, parameters))


def _play(console: Console, parameters: dict[str, Any]) -> int:
    # Imported here, because rclpy takes a while.
    import rclpy
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions

    from vtff_bag.bag_player_node import BagPlayerNode
    from vtff_node.main import USAGE_ERRORS
    from vtff_node.process.stop_signals import StopRequest

    stop = StopRequest()
    stop.install()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    # ROS cannot read the type of an empty list: it is left out, which means the default.
    overrides = [Parameter(name, value=value) for name, value in parameters.items() if value != []]
    node: BagPlayerNode | None = None
    try:
        node = BagPlayerNode(parameter_overrides=overrides)
        return _spin(console, node, stop)
    except USAGE_ERRORS as error:
        print_error(console, error)
        return EXIT_USAGE if node is None else EXIT_FAILURE
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _spin(console: Console, node: BagPlayerNode, stop: Any) -> int:
    """Play to the end with progress and keys; return the exit code."""
    from vtff_bringup.commands.replay_terminal import HELP, Keyboard, ReplayProgress, apply_action
    from vtff_node.main import make_executor

    count = len(node.selection.topics)
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    console.print(f"{node.reader.path}: {count} topics, ROS_DOMAIN_ID {domain}", markup=False)
    executor = make_executor()
    executor.add_node(node)
    try:
        with ReplayProgress(console) as progress, Keyboard() as keyboard:
            if keyboard.present:
                console.print(HELP, markup=False)
            while not stop.requested and not node.finished:
                executor.spin_once(timeout_sec=0.1)
                for action in keyboard.actions():
                    apply_action(action, node)
                progress.update(node)
    finally:
        node.close()
        executor.shutdown()
    assert node.replay is not None
    console.print(f"{node.replay.published} messages published")
    return EXIT_INTERRUPTED if stop.requested else node.exit_code

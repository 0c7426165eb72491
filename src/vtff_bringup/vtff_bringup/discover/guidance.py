"""`vtff guidance`: modes and reconfigurations of a running formation."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from vtff_bringup.discover.running_graph import domain_text, running_graph
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE

if TYPE_CHECKING:
    from vtff_node.process.stop_signals import StopRequest

app = typer.Typer(
    help="Modes of formation_guidance in a running graph in ROS_DOMAIN_ID (0 if it is not set).",
    no_args_is_help=True,
)

WAIT = 10.0  # s of wall time for the node
ANSWER_WAIT = 90.0  # s of wall time for an answer: a plan is made before it
SHOW_INTERVAL = 1.0  # s of wall time between lines of a reconfiguration under way
MODE_SERVICE = "/formation/guidance/mode"
RECONFIGURE_ACTION = "/formation/guidance/reconfigure"


@app.command("mode", no_args_is_help=True)
def set_mode(
    mode: Annotated[str, typer.Argument(help="hold, keep, phase, free_drift or abort")],
    formation: Annotated[str, typer.Argument(help="keep: name of the formation")] = "",
    angle_deg: Annotated[float, typer.Option(help="phase: ahead; negative: behind")] = 0.0,
    orbits: Annotated[float, typer.Option(help="phase: duration")] = 0.0,
) -> None:
    """Set the mode."""
    console = Console(highlight=False)
    with running_graph() as (node, executor, stop):
        from vtff_msgs.srv import SetGuidanceMode

        client = node.create_client(SetGuidanceMode, MODE_SERVICE)
        wait_until(console, executor, stop, client.service_is_ready, WAIT)
        request = SetGuidanceMode.Request(
            mode=mode, formation=formation, angle_deg=angle_deg, orbits=orbits
        )
        future = client.call_async(request)
        wait_until(console, executor, stop, future.done, ANSWER_WAIT)
        answer = future.result()
    if not answer.success:
        raise exit_with_error(console, answer.message, EXIT_FAILURE)
    console.print(f"mode {mode} {formation}".rstrip(), markup=False)


@app.command("reconfigure", no_args_is_help=True)
def reconfigure(
    formation: Annotated[str, typer.Argument(help="Formation to reach.")],
    duration: Annotated[float, typer.Option(help="From now to the arrival, s.")],
    closest_approach: Annotated[
        float, typer.Option(help="Smallest distance of any pair, m; 0: as the node is set.")
    ] = 0.0,
    acceleration_cap: Annotated[
        float, typer.Option(help="On each axis, m/s2; 0: as the node is set.")
    ] = 0.0,
    axes: Annotated[str, typer.Option(help="With thrust, some of RTN.")] = "RTN",
    objective: Annotated[str, typer.Option(help="norms, axes or energy")] = "norms",
    passive_safety_orbits: Annotated[
        float, typer.Option(help="Orbits in which a loss of thrust is safe; 0: not asked.")
    ] = 0.0,
    preempt: Annotated[
        bool, typer.Option("--preempt", help="End a reconfiguration that runs.")
    ] = False,
) -> None:
    """Bring the formation into another one; Ctrl-C ends it in a free drift."""
    console = Console(highlight=False)
    objectives = ("norms", "axes", "energy")
    if objective not in objectives:
        text = f"objective: one of {', '.join(objectives)} expected, got '{objective}'"
        raise exit_with_error(console, text, EXIT_USAGE)
    with running_graph() as (node, executor, stop):
        from rclpy.action import ActionClient

        from vtff_msgs.action import Reconfigure

        client = ActionClient(node, Reconfigure, RECONFIGURE_ACTION)
        wait_until(console, executor, stop, client.server_is_ready, WAIT)
        goal = Reconfigure.Goal(
            formation=formation,
            duration=duration,
            closest_approach=closest_approach,
            acceleration_cap=acceleration_cap,
            axes=axes,
            objective=objectives.index(objective),
            passive_safety_orbits=passive_safety_orbits,
            preempt=preempt,
        )
        show = _Feedback(console)
        sent = client.send_goal_async(goal, feedback_callback=show.take)
        wait_until(console, executor, stop, sent.done, WAIT)
        handle = sent.result()
        future = handle.get_result_async()
        cancelled = False
        with contextlib.suppress(KeyboardInterrupt):
            while not future.done():
                executor.spin_once(timeout_sec=0.1)
                if stop.requested and not cancelled:
                    cancelled = True
                    handle.cancel_goal_async()
                    deadline = time.monotonic() + WAIT
                if cancelled and time.monotonic() > deadline:
                    break
        result = future.result().result if future.done() else None
    if result is None:
        raise exit_with_error(console, "no answer to the cancellation", EXIT_FAILURE)
    if not result.success:
        code = EXIT_INTERRUPTED if cancelled else EXIT_FAILURE
        raise exit_with_error(console, result.message, code)
    for name, change in zip(result.spacecraft, result.velocity_change, strict=True):
        console.print(f"{name:12} {100.0 * change:8.3f} cm/s", markup=False)
    console.print(f"closest approach {result.closest_approach:.2f} m", markup=False)


class _Feedback:
    """Prints what a reconfiguration under way reports, now and then."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._printed = 0.0

    def take(self, message: Any) -> None:
        feedback = message.feedback
        now = time.monotonic()
        if feedback.phase == "planning" or now - self._printed < SHOW_INTERVAL:
            return
        self._printed = now
        left = 100.0 * sum(feedback.velocity_change_left)
        self._console.print(
            f"{feedback.phase}: {feedback.time_left:.0f} s and {left:.2f} cm/s left, "
            f"closest approach {feedback.closest_approach:.2f} m planned",
            markup=False,
        )


def wait_until(
    console: Console,
    executor: Any,
    stop: StopRequest,
    is_done: Any,
    patience: float,
    node: str = "formation_guidance",
) -> None:
    """Spin until something is done; end the command on a signal or when the patience is over."""
    deadline = time.monotonic() + patience
    while not is_done():
        if stop.requested:
            raise typer.Exit(EXIT_INTERRUPTED)
        if time.monotonic() > deadline:
            text = f"no answer of {node} in {domain_text()} within {patience:g} s"
            raise exit_with_error(console, text, EXIT_FAILURE)
        executor.spin_once(timeout_sec=0.1)

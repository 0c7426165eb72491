"""`vtff survey`: what a running survey samples."""

from __future__ import annotations

import contextlib
import time
from typing import Annotated, Any

import typer
from rich.console import Console

from vtff_bringup.discover.guidance import WAIT, wait_until
from vtff_bringup.discover.running_graph import running_graph
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED

SURVEY_ACTION = "/formation/survey/goal"
NODE = "survey_guidance"


def survey(
    kind: Annotated[
        str, typer.Argument(help="edge_altitudes, both_walls, profile, or default: safe ellipse")
    ],
    altitude_difference: Annotated[
        float, typer.Option(help="Of the spacecraft at a crossing, m.")
    ] = 2000.0,
) -> None:
    """Ask survey_guidance of a running graph to sample plasma; prints what it decides.

    The goal runs until Ctrl-C, or until another goal replaces it. The graph is that of
    ROS_DOMAIN_ID (0 if it is not set).
    """
    console = Console(highlight=False)
    with running_graph() as (node, executor, stop):
        from rclpy.action import ActionClient

        from vtff_msgs.action import Survey

        client = ActionClient(node, Survey, SURVEY_ACTION)
        wait_until(console, executor, stop, client.server_is_ready, WAIT, NODE)
        goal = Survey.Goal(kind=kind, altitude_difference=altitude_difference)

        def show(message: Any) -> None:
            feedback = message.feedback
            console.print(
                f"{feedback.phase}: {feedback.reason}; {feedback.walls} walls, drift "
                f"{feedback.drift:.0f} +- {feedback.drift_sigma:.0f} m/s",
                markup=False,
            )

        sent = client.send_goal_async(goal, feedback_callback=show)
        wait_until(console, executor, stop, sent.done, WAIT, NODE)
        handle = sent.result()
        future = handle.get_result_async()
        deadline = None
        with contextlib.suppress(KeyboardInterrupt):
            while not future.done():
                executor.spin_once(timeout_sec=0.1)
                if stop.requested and deadline is None:
                    handle.cancel_goal_async()
                    deadline = time.monotonic() + WAIT
                if deadline is not None and time.monotonic() > deadline:
                    break
        result = future.result().result if future.done() else None
    if result is None:
        raise exit_with_error(console, "no answer to the cancellation", EXIT_FAILURE)
    if not result.success:
        raise exit_with_error(console, result.message, EXIT_FAILURE)
    console.print(
        f"{result.message}: {result.plans} changes of ellipse, {result.velocity_change:.2f} m/s",
        markup=False,
    )
    if deadline is not None:
        raise typer.Exit(EXIT_INTERRUPTED)

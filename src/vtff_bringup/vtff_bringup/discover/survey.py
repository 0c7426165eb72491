"""`vtff survey`: what a running survey samples."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer

from vtff_bringup.discover.running_graph import running_graph
from vtff_bringup.discover.waiting import GraphWaiter
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED

SURVEY_ACTION = "/formation/survey/goal"
NODE = "survey_guidance"

Kind = Literal["edge_altitudes", "both_walls", "profile", "default"]


def survey(
    kind: Annotated[
        Kind, typer.Argument(help="What is sampled; default: nothing, a safe ellipse is kept.")
    ],
    altitude_difference: Annotated[
        float, typer.Option(help="Of the spacecraft at a crossing, m.")
    ] = 2000.0,
) -> None:
    """Ask survey_guidance of a running graph to sample plasma.

    Its decisions are printed. The goal runs until Ctrl-C, or until another goal replaces it. The
    graph is that of ROS_DOMAIN_ID (0 if it is not set).

    For example: vtff survey edge_altitudes --altitude-difference 2000
    """
    console = make_console()
    with running_graph() as (node, executor, stop):
        from vtff_msgs.action import Survey

        goal = Survey.Goal(kind=kind, altitude_difference=altitude_difference)

        def show(message: Any) -> None:
            feedback = message.feedback
            console.print(
                f"{feedback.phase}: {feedback.reason}; {feedback.walls} walls, drift "
                f"{feedback.drift:.0f} +- {feedback.drift_sigma:.0f} m/s",
                markup=False,
            )

        waiter = GraphWaiter(console, node, executor, stop, NODE)
        result, cancelled = waiter.follow_goal(Survey, SURVEY_ACTION, goal, show)
    if not result.success:
        raise exit_with_error(console, result.message, EXIT_FAILURE)
    console.print(
        f"{result.message}: {result.plans} changes of ellipse, {result.velocity_change:.2f} m/s",
        markup=False,
    )
    if cancelled:
        raise typer.Exit(EXIT_INTERRUPTED)

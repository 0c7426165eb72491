"""`vtff guidance`: modes and reconfigurations of a running formation."""

from __future__ import annotations

import time
from typing import Annotated, Any, Literal, get_args

import typer
from rich.console import Console

from vtff_bringup.discover.running_graph import running_graph
from vtff_bringup.discover.waiting import GraphWaiter
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED

app = typer.Typer(
    help="Ask formation_guidance of a running graph.\n\nThe graph is that of ROS_DOMAIN_ID (0 if it"
    " is not set).",
    no_args_is_help=True,
)

ANSWER_WAIT = 90.0  # s of wall time for an answer: a plan is made before it
SHOW_INTERVAL = 1.0  # s of wall time between lines of a reconfiguration under way
NODE = "formation_guidance"
MODE_SERVICE = "/formation/guidance/mode"
RECONFIGURE_ACTION = "/formation/guidance/reconfigure"

Mode = Literal["hold", "keep", "phase", "free_drift", "abort"]
Objective = Literal["norms", "axes", "energy"]  # in the order of the action's numbers


@app.command("mode", no_args_is_help=True)
def set_mode(
    mode: Annotated[Mode, typer.Argument(help="What the formation does from now on.")],
    formation: Annotated[str, typer.Argument(help="With keep: its name.")] = "",
    angle_deg: Annotated[
        float, typer.Option(help="With phase: degrees ahead; negative: behind.")
    ] = 0.0,
    orbits: Annotated[float, typer.Option(help="With phase: its duration.")] = 0.0,
) -> None:
    """Set the mode.

    hold and keep keep the formation, keep that of the name; phase moves all along the orbit;
    free_drift ends thrust; abort also drops the requests that wait.

    For example: vtff guidance mode keep helix
    """
    console = make_console()
    with running_graph() as (node, executor, stop):
        from vtff_msgs.srv import SetGuidanceMode

        request = SetGuidanceMode.Request(
            mode=mode, formation=formation, angle_deg=angle_deg, orbits=orbits
        )
        waiter = GraphWaiter(console, node, executor, stop, NODE)
        answer = waiter.call_service(SetGuidanceMode, MODE_SERVICE, request, ANSWER_WAIT)
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
    objective: Annotated[
        Objective,
        typer.Option(help="Least sum of norms, of the axes' amounts, or of squares."),
    ] = "norms",
    passive_safety_orbits: Annotated[
        float, typer.Option(help="Orbits in which a loss of thrust is safe; 0: not asked.")
    ] = 0.0,
    preempt: Annotated[
        bool, typer.Option("--preempt", help="End a reconfiguration that runs.")
    ] = False,
) -> None:
    """Bring the formation into another one.

    The plan is printed while it is flown. Ctrl-C ends it in a free drift. The names are those of
    the file of formations that the node has (config/formation).

    For example: vtff guidance reconfigure helix --duration 4560
    """
    console = make_console()
    with running_graph() as (node, executor, stop):
        from vtff_msgs.action import Reconfigure

        goal = Reconfigure.Goal(
            formation=formation,
            duration=duration,
            closest_approach=closest_approach,
            acceleration_cap=acceleration_cap,
            axes=axes,
            objective=get_args(Objective).index(objective),
            passive_safety_orbits=passive_safety_orbits,
            preempt=preempt,
        )
        waiter = GraphWaiter(console, node, executor, stop, NODE)
        result, cancelled = waiter.follow_goal(
            Reconfigure, RECONFIGURE_ACTION, goal, _Feedback(console).take
        )
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

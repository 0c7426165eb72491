"""Answers of a node of a running graph: waited for, and given up in order."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from vtff_bringup.discover.running_graph import domain_text
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED

if TYPE_CHECKING:
    from vtff_node.process.stop_signals import StopRequest

__all__ = ["WAIT", "GraphWaiter"]

WAIT = 10.0  # s of wall time for a node
#: s of wall time for the result of a node that is no longer in the graph: it may be on its way.
_LAST_RESULT_WAIT = 1.0


class GraphWaiter:
    """Waits for one node of a running graph.

    Parameters
    ----------
    console
        For errors.
    node, executor, stop
        As `vtff_bringup.discover.running_graph.running_graph` gives them.
    awaited
        Name of the node that shall answer, for errors.
    """

    def __init__(
        self, console: Console, node: Any, executor: Any, stop: StopRequest, awaited: str
    ) -> None:
        self._console = console
        self._node = node
        self._executor = executor
        self._stop = stop
        self._awaited = awaited

    def wait_until(
        self, is_done: Callable[[], bool], patience: float = WAIT, lacking: str = "no answer of"
    ) -> None:
        """Spin until something is done.

        Parameters
        ----------
        is_done
            Whether it is done.
        patience
            Longest wait, s of wall time.
        lacking
            Words of the error for what the awaited node did not do in time.

        Raises
        ------
        typer.Exit
            On a signal, or with one line when the patience (s of wall time) is over.
        """
        deadline = time.monotonic() + patience
        while not is_done():
            if self._stop.requested:
                raise typer.Exit(EXIT_INTERRUPTED)
            if time.monotonic() > deadline:
                text = f"{lacking} {self._awaited} in {domain_text()} within {patience:g} s"
                raise exit_with_error(self._console, text, EXIT_FAILURE)
            self._executor.spin_once(timeout_sec=0.1)

    def follow_goal(
        self, action: Any, name: str, goal: Any, take_feedback: Callable[[Any], None]
    ) -> tuple[Any, bool]:
        """Send a goal and follow it to its end; a signal cancels it.

        Parameters
        ----------
        action, name
            Type and name of the action.
        goal
            Goal message.
        take_feedback
            Takes each message of feedback.

        Returns
        -------
        result, bool
            Result of the action, and whether a signal has cancelled it.

        Raises
        ------
        typer.Exit
            With one line if there is no answer, or if the node leaves the graph before the goal
            has ended.
        """
        from rclpy.action import ActionClient

        client = ActionClient(self._node, action, name)
        self.wait_until(client.server_is_ready, lacking="no")
        sent = client.send_goal_async(goal, feedback_callback=take_feedback)
        self.wait_until(sent.done)
        handle = sent.result()
        future = handle.get_result_async()
        is_cancelled = is_gone = False
        deadline = math.inf
        with contextlib.suppress(KeyboardInterrupt):
            while not future.done() and time.monotonic() <= deadline:
                self._executor.spin_once(timeout_sec=0.1)
                if not is_gone and not client.server_is_ready():
                    is_gone, deadline = True, time.monotonic() + _LAST_RESULT_WAIT
                elif self._stop.requested and not is_gone and not is_cancelled:
                    handle.cancel_goal_async()
                    is_cancelled, deadline = True, time.monotonic() + WAIT
        if not future.done():
            text = f"no answer of {self._awaited} to the cancellation"
            if is_gone:
                text = f"{self._awaited} has left {domain_text()}: the run ended before the goal"
            raise exit_with_error(self._console, text, EXIT_FAILURE)
        return future.result().result, is_cancelled

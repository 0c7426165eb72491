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
#: s of wall time for the answer of a node that is no longer in the graph: it may be on its way.
_LAST_ANSWER_WAIT = 1.0


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
        self,
        is_done: Callable[[], bool],
        patience: float = WAIT,
        lacking: str = "no answer of",
        is_there: Callable[[], bool] = lambda: True,
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
        is_there
            Whether the awaited node is in the graph.

        Raises
        ------
        typer.Exit
            On a signal, or with one line when the patience is over or the node has left.
        """
        self._spin(lambda: is_done() or self._stop.requested, patience, is_there)
        if not is_done():
            if self._stop.requested:
                raise typer.Exit(EXIT_INTERRUPTED)
            raise self._give_up(patience, lacking)

    def call_service(self, service: Any, name: str, request: Any, patience: float = WAIT) -> Any:
        """Return the response of a service of the awaited node.

        Parameters
        ----------
        service, name
            Type and name of the service.
        request
            Request message.
        patience
            Longest wait for the response, s of wall time.

        Raises
        ------
        typer.Exit
            On a signal, or with one line if there is no response, or if the node leaves the graph
            before it.
        """
        client = self._node.create_client(service, name)
        self.wait_until(client.service_is_ready)
        future = client.call_async(request)
        self.wait_until(future.done, patience, is_there=client.service_is_ready)
        return future.result()

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
        # No signal ends this wait: the goal may be flown by now. It is cancelled below.
        self._spin(sent.done, WAIT, client.server_is_ready)
        if not sent.done():
            raise self._give_up(WAIT)
        handle = sent.result()
        future = handle.get_result_async()
        is_cancelled = False
        with contextlib.suppress(KeyboardInterrupt):
            self._spin(
                lambda: future.done() or self._stop.requested, math.inf, client.server_is_ready
            )
            if not future.done():
                handle.cancel_goal_async()
                is_cancelled = True
                self._spin(future.done, WAIT, client.server_is_ready)
        if not future.done():
            text = f"no answer of {self._awaited} to the cancellation"
            raise exit_with_error(self._console, text, EXIT_FAILURE)
        return future.result().result, is_cancelled

    def _spin(
        self, is_done: Callable[[], bool], patience: float, is_there: Callable[[], bool]
    ) -> None:
        """Spin until something is done or the patience is over, whatever signals ask for.

        Parameters as in `wait_until`. Raises typer.Exit, with one line, when the awaited node has
        left and nothing more has come of it.
        """
        deadline = time.monotonic() + patience
        is_gone = False
        while not is_done() and time.monotonic() <= deadline:
            self._executor.spin_once(timeout_sec=0.1)
            if not is_gone and not is_there():
                is_gone, deadline = True, time.monotonic() + _LAST_ANSWER_WAIT
        if is_gone and not is_done():
            text = f"{self._awaited} has left {domain_text()}: the run has ended"
            raise exit_with_error(self._console, text, EXIT_FAILURE)

    def _give_up(self, patience: float, lacking: str = "no answer of") -> typer.Exit:
        text = f"{lacking} {self._awaited} in {domain_text()} within {patience:g} s"
        return exit_with_error(self._console, text, EXIT_FAILURE)

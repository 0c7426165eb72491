"""A command that follows a goal ends with one line when the node that flies it leaves the graph."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from domain_coordinator import domain_id  # noqa: E402
from rclpy.action import ActionServer, GoalResponse  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.task import Future  # noqa: E402

from vtff_msgs.action import Survey  # noqa: E402


class _LeftGraphError(Exception):
    """Ends the node before it has answered."""


@pytest.mark.parametrize("answers", [True, False])
def test_a_survey_whose_run_ends_says_so(answers):
    context = rclpy.Context()
    with domain_id() as domain:
        rclpy.init(context=context, domain_id=domain)
        executor = SingleThreadedExecutor(context=context)
        node = rclpy.create_node("survey_guidance", context=context)
        executor.add_node(node)
        goals = []

        def decide(request):
            goals.append(request.kind)
            if not answers:
                raise _LeftGraphError
            return GoalResponse.ACCEPT

        accepted = []

        async def follow(handle):
            accepted.append(handle)
            await Future(executor=executor)  # until cancelled

        server = ActionServer(node, Survey, "/formation/survey/goal", follow, goal_callback=decide)
        command = subprocess.Popen(
            [sys.executable, "-m", "vtff_bringup.cli", "survey", "profile"],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            with contextlib.suppress(_LeftGraphError):
                while not accepted and command.poll() is None:
                    executor.spin_once(timeout_sec=0.1)
            server.destroy()
            executor.shutdown()
            node.destroy_node()
            rclpy.shutdown(context=context)
            output, _ = command.communicate(timeout=60.0)
        finally:
            command.kill()
            command.wait()
    assert goals == ["profile"]
    assert command.returncode == 1
    text = f"survey_guidance has left ROS_DOMAIN_ID {domain}: the run has ended"
    assert output == f"error: {text}\n"

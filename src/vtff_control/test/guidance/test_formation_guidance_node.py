"""The node formation_guidance: timeline, services, the action, and what it does without states."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.action import ActionClient  # noqa: E402
from rclpy.experimental import EventsExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from vtff_control.formation_guidance_node import FormationGuidanceNode  # noqa: E402
from vtff_dynamics.orbit.mean_elements import (  # noqa: E402
    osculating_elements,
    state_from_elements,
)
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements  # noqa: E402
from vtff_msgs.action import Reconfigure  # noqa: E402
from vtff_msgs.msg import FormationGuidance, RelativeState  # noqa: E402
from vtff_msgs.srv import SetGuidanceMode  # noqa: E402
from vtff_node import diagnostics  # noqa: E402
from vtff_node.parameters import ParameterError  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

EPOCH = 1_458_521_983 * 10**9
STEP = 10
CHIEF_MEAN = np.array([7.1531e6, 0.4, 0.0, 0.0, math.radians(98.51), 1.0])
CHIEF = state_from_elements(osculating_elements(CHIEF_MEAN))
FORMATIONS = """
row:
  chief: [0, 0, 0, 0, 0, 0]
  deputy: [0, 25, 0, 0, 0, 0]
wide:
  chief: [0, 0, 0, 0, 0, 0]
  deputy: [0, 26, 0, 0, 0, 0]
"""


@pytest.fixture
def make_node(tmp_path, ros_context) -> Iterator:
    """A function that makes a node in lockstep, and the list of messages of each topic."""
    nodes = []
    (tmp_path / "formations.yaml").write_text(FORMATIONS)

    def make(**parameters):
        values = {
            "lockstep": True,
            "deputies": ["deputy"],
            "formations": str(tmp_path / "formations.yaml"),
            "formation": "row",
            "sample_time": float(STEP),
            "commands_thrust": True,
            **parameters,
        }
        node = FormationGuidanceNode(
            context=ros_context,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        nodes.append(node)
        published: dict[str, list] = {}
        for publisher in node._counted:
            messages = published.setdefault(publisher.topic_name, [])
            publisher.publish = messages.append
        return node, published

    yield make
    for node in nodes:
        node.destroy_node()


def state(step, solution=RelativeState.SOLUTION_TRUTH):
    message = RelativeState(child_frame_id="deputy", solution=solution)
    message.header.stamp = to_stamp(EPOCH + step * STEP * 10**9)
    message.header.frame_id = "chief/rtn"
    relative = relative_state_of_mean_elements(CHIEF_MEAN, [0.0, 25.0, 0.0, 0.0, 0.0, 0.0])
    message.position, message.velocity = relative[:3], relative[3:]
    message.position_chief_gcrf, message.velocity_chief_gcrf = CHIEF[:3], CHIEF[3:]
    return message


def test_every_step_is_answered_with_targets_and_thrust_of_all(make_node):
    node, published = make_node(timeline=["20 reconfigure wide duration=4560", "40 abort"])
    for step in range(8):
        node._on_state("deputy", state(step))
    reports = published["/formation/guidance"]
    modes = [report.mode for report in reports]
    keep, plan, end = (
        FormationGuidance.MODE_KEEP,
        FormationGuidance.MODE_RECONFIGURE,
        FormationGuidance.MODE_ABORT,
    )
    assert modes == [keep] * 3 + [plan] * 2 + [end] * 3
    assert list(reports[3].spacecraft) == ["chief", "deputy"]
    assert reports[3].closest_approach > 10.0
    assert sum(reports[3].velocity_change_left) > 0.0
    for name in ("chief", "deputy"):
        for topic in ("target", "control/feedforward", "control/thrust_command"):
            stamps = [message.header.stamp for message in published[f"/{name}/{topic}"]]
            assert stamps == [report.header.stamp for report in reports]
    target = published["/deputy/target"][0]
    np.testing.assert_allclose(target.position, state(0).position, atol=1e-3)
    assert (target.child_frame_id, target.header.frame_id) == ("deputy", "chief/rtn")


def test_without_a_state_there_is_no_thrust_and_the_reason_is_told(make_node):
    node, published = make_node(timeline=["0 reconfigure wide duration=1000"], lead_time=10.0)
    for step in range(9):
        node._on_state("deputy", state(step))
    assert any(any(report.acceleration) for report in published["/formation/guidance"])
    node._on_state("deputy", state(9, RelativeState.SOLUTION_NONE))
    report = published["/formation/guidance"][-1]
    assert not any(report.acceleration)
    assert report.reason == "navigation of deputy has no solution"
    (health,) = node.health()
    assert health.level == diagnostics.WARN
    broken = state(10)
    broken.position = np.full(3, np.nan)
    node._on_state("deputy", broken)
    assert published["/formation/guidance"][-1].reason == "a state is not finite"


def test_service_sets_the_mode_or_says_why_not(make_node):
    node, published = make_node()
    node._on_state("deputy", state(0))
    answer = node._on_mode(
        SetGuidanceMode.Request(mode="keep", formation="moon"), SetGuidanceMode.Response()
    )
    assert not answer.success
    assert answer.message == "no formation 'moon'; there are: row, wide"
    answer = node._on_mode(SetGuidanceMode.Request(mode="free_drift"), SetGuidanceMode.Response())
    assert answer.success
    node._on_state("deputy", state(1))
    assert published["/formation/guidance"][-1].mode == FormationGuidance.MODE_FREE_DRIFT


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"timeline": ["0 keep moon"]}, "parameter 'timeline': no formation 'moon'"),
        ({"timeline": ["0 dance"]}, "parameter 'timeline': timeline, '0 dance': mode: one of"),
        ({"formations": "nowhere.yaml"}, "parameter 'formations': .*nowhere.yaml"),
        ({"deputies": ["other"]}, "row: the spacecraft chief, other expected"),
        ({"formation": "moon"}, "no formation 'moon'"),
        ({"smallest_thrust": 1.0}, "step, smallest, largest"),
    ],
)
def test_wrong_parameters_are_named(make_node, parameters, reason):
    with pytest.raises((ParameterError, ValueError), match=reason):
        make_node(**parameters)


def test_action_gives_feedback_and_is_refused_preempted_and_cancelled(make_node):
    node, _ = make_node()
    asker = rclpy.create_node("asker", context=node.context, enable_rosout=False)
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    executor.add_node(asker)
    steps = iter(range(100_000))
    feedback = []

    def until(is_done, stepping=False):
        for _ in range(6000):
            if is_done():
                return
            executor.spin_once(timeout_sec=0.02)
            if stepping:
                node._on_state("deputy", state(next(steps)))
        raise AssertionError("no answer")

    def send(**fields):
        goal = Reconfigure.Goal(formation="wide", duration=4560.0, **fields)
        sent = client.send_goal_async(goal, feedback_callback=feedback.append)
        until(sent.done)
        return sent.result(), sent.result().get_result_async()

    try:
        client = ActionClient(asker, Reconfigure, "/formation/guidance/reconfigure")
        until(client.server_is_ready)
        node._on_state("deputy", state(next(steps)))
        _, first = send()
        until(
            lambda: any(message.feedback.phase == "manoeuvre" for message in feedback),
            stepping=True,
        )
        moving = next(m.feedback for m in feedback if m.feedback.phase == "manoeuvre")
        assert moving.closest_approach >= 10.0
        assert list(moving.spacecraft) == ["chief", "deputy"]
        assert sum(moving.velocity_change_left) > 0.0
        _, second = send()
        until(second.done)
        assert not second.result().result.success
        assert "refused: a reconfiguration to 'wide' runs for" in second.result().result.message
        handle, third = send(preempt=True)
        until(first.done, stepping=True)
        assert "preempted by a reconfiguration to 'wide'" in first.result().result.message
        handle.cancel_goal_async()
        until(third.done, stepping=True)
        assert third.result().result.message == "ended by mode free_drift"
    finally:
        executor.shutdown()
        asker.destroy_node()

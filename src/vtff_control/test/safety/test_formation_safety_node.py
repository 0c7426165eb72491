"""The node formation_safety: what passes on, what is replaced, and what waits for what."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from safety_samples import CHIEF, COVARIANCE, relative  # noqa: E402

from vtff_control.formation_safety_node import FormationSafetyNode  # noqa: E402
from vtff_msgs.msg import FormationSafety, RelativeState  # noqa: E402
from vtff_msgs.srv import ResetSafety  # noqa: E402
from vtff_node import diagnostics  # noqa: E402
from vtff_node.parameters import ParameterError  # noqa: E402
from vtff_node.stamps import to_nanoseconds, to_stamp  # noqa: E402

EPOCH = 1_458_521_983 * 10**9

Published = dict[str, list[object]]
NodeMaker = Callable[..., tuple[FormationSafetyNode, Published]]


@pytest.fixture
def make_node(ros_context: rclpy.Context) -> Iterator[NodeMaker]:
    """A function that makes a node in lockstep, and lists of what it publishes by topic."""
    nodes: list[FormationSafetyNode] = []

    def make(**parameters: object) -> tuple[FormationSafetyNode, Published]:
        values = {
            "lockstep": True,
            "deputies": ["deputy"],
            "hard_radius": 30.0,
            "acceleration_cap": 1.4,
            **parameters,
        }
        node = FormationSafetyNode(
            context=ros_context,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        nodes.append(node)
        published: Published = {}
        for publisher in node._counted:
            messages = published.setdefault(publisher.topic_name, [])
            publisher.publish = messages.append  # type: ignore[method-assign]
        return node, published

    yield make
    for node in nodes:
        node.destroy_node()


def state(second: int, values: np.ndarray, solution: int = RelativeState.SOLUTION_FIXED):
    message = RelativeState(child_frame_id="deputy", solution=solution)
    message.header.stamp = to_stamp(EPOCH + second * 10**9)
    message.position, message.velocity = values[:3], values[3:]
    message.position_chief_gcrf, message.velocity_chief_gcrf = CHIEF[:3], CHIEF[3:]
    message.covariance = COVARIANCE.ravel()
    return message


def acceleration(second: int, r: float = 0.0, t: float = 0.0, n: float = 0.0) -> AccelStamped:
    message = AccelStamped()
    message.header.stamp = to_stamp(EPOCH + second * 10**9)
    message.header.frame_id = "chief/rtn"
    message.accel.linear.x, message.accel.linear.y, message.accel.linear.z = r, t, n
    return message


def send(node: FormationSafetyNode, topic: str, message: object, deputy: str = "deputy") -> None:
    """Call the callback of a subscription, as an executor would."""
    (subscription,) = (
        found for found in node.subscriptions if found.topic_name == f"/{deputy}/{topic}"
    )
    subscription.callback(serialize_message(message))


def fly_second(node: FormationSafetyNode, second: int, values: np.ndarray, t: float = 0.0) -> None:
    send(node, "propulsion/thrust_applied", acceleration(second))
    send(node, "relative_state", state(second, values))
    send(node, "control/thrust_command", acceleration(second, t=t))


CHECKED = "/deputy/control/thrust_command_checked"
ISOLATION = "/deputy/propulsion/isolation"
SAFETY = "/formation/safety"


def test_a_command_that_may_pass_is_published_as_it_came(make_node: NodeMaker) -> None:
    node, published = make_node()
    command = acceleration(0, r=1e-5)
    send(node, "relative_state", state(0, relative(t=100.0)))
    assert published[CHECKED] == []
    send(node, "control/thrust_command", command)
    assert published[CHECKED] == [command]
    (message,) = published[SAFETY]
    assert isinstance(message, FormationSafety)
    assert message.spacecraft == ["deputy"]
    assert list(message.mode) == [FormationSafety.MODE_MONITOR]
    assert (message.first[0], message.second[0]) == ("chief", "deputy")
    assert 90.0 < message.separation[0] <= 100.0
    assert to_nanoseconds(message.header.stamp) == EPOCH
    assert node.health()[0].level == diagnostics.OK
    assert "chief-deputy stay" in node.health()[0].message


def test_repeated_and_overtaken_messages_are_not_judged_again(make_node: NodeMaker) -> None:
    node, published = make_node()
    for second in range(2):
        fly_second(node, second, relative(t=100.0))
    for second in (1, 0):
        fly_second(node, second, relative(t=100.0))
    assert len(published[CHECKED]) == 2
    assert "messages out of order" in {value.key for value in node.health()[0].values}


def test_a_command_waits_for_the_report_of_the_one_before(make_node: NodeMaker) -> None:
    node, published = make_node()
    fly_second(node, 0, relative(t=100.0))
    send(node, "relative_state", state(1, relative(t=100.0)))
    send(node, "control/thrust_command", acceleration(1))
    assert len(published[CHECKED]) == 1
    send(node, "propulsion/thrust_applied", acceleration(1))
    assert len(published[CHECKED]) == 2


def test_a_step_that_is_never_complete_is_judged_before_the_next(make_node: NodeMaker) -> None:
    """Its state was lost; a run that begins anew is judged from its first second on."""
    node, published = make_node()
    fly_second(node, 0, relative(t=100.0))
    send(node, "relative_state", state(2, relative(t=100.0)))
    send(node, "control/thrust_command", acceleration(1))
    send(node, "propulsion/thrust_applied", acceleration(2))
    assert len(published[SAFETY]) == 1
    send(node, "control/thrust_command", acceleration(2))
    send(node, "relative_state", state(3, relative(t=100.0)))
    fly_second(node, -100, relative(t=100.0))
    seconds = [(to_nanoseconds(each.header.stamp) - EPOCH) // 10**9 for each in published[SAFETY]]
    assert seconds == [0, 1, 2, -100]


def test_all_deputies_are_judged_together(make_node: NodeMaker) -> None:
    node, published = make_node(deputies=["deputy", "other"])
    send(node, "relative_state", state(0, relative(t=100.0)))
    send(node, "control/thrust_command", acceleration(0))
    assert published[SAFETY] == []
    message = state(0, relative(t=-200.0))
    message.child_frame_id = "other"
    send(node, "relative_state", message, "other")
    send(node, "control/thrust_command", acceleration(0), "other")
    assert len(published[CHECKED]) == len(published["/other/control/thrust_command_checked"]) == 1
    assert list(published[SAFETY][0].second) == ["deputy", "other", "other"]


def test_what_is_missing_is_not_waited_for_for_ever(make_node: NodeMaker) -> None:
    node, published = make_node(lockstep=False, wait=0.0)
    send(node, "control/thrust_command", acceleration(0, t=0.1))
    node._watch()
    assert len(published[CHECKED]) == 1
    assert len(published[SAFETY]) == 1
    # In lockstep nodes may take their time for the first step.
    node, published = make_node(lockstep_wait=0.0)
    send(node, "control/thrust_command", acceleration(0, t=0.1))
    node._watch()
    assert published[CHECKED] == []


def test_a_node_that_is_slow_is_waited_for_longer_than_one_that_failed(make_node, monkeypatch):
    """In lockstep time stands still: a machine that is busy for some seconds loses no command."""
    node, published = make_node()
    fly_second(node, 0, relative(t=100.0))
    send(node, "relative_state", state(1, relative(t=100.0)))
    send(node, "propulsion/thrust_applied", acceleration(1))
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 8.0)
    node._watch()
    send(node, "control/thrust_command", acceleration(1))
    assert len(published[CHECKED]) == 2
    # A command that never comes ends the wait for its step, and the next ones are waited for less.
    judged = []
    for second in (2, 3):
        send(node, "propulsion/thrust_applied", acceleration(second))
        send(node, "relative_state", state(second, relative(t=100.0)))
        began = node._pending[EPOCH + second * 10**9].since
        for later in (3.0, 3.5, 9.5, 10.5):
            monkeypatch.setattr(time, "monotonic", lambda moment=began + later: moment)
            node._watch()
            if len(published[SAFETY]) > second:
                judged.append(later)
                break
    assert judged == [10.5, 3.5]


def test_a_stuck_thruster_is_taken_over_isolated_and_given_back(make_node: NodeMaker) -> None:
    node, published = make_node()
    fly_second(node, 0, relative(t=100.0))
    send(node, "propulsion/thrust_applied", acceleration(1, t=-0.9))
    send(node, "relative_state", state(1, relative(t=100.0)))
    send(node, "control/thrust_command", acceleration(1, t=0.2))
    (isolation,) = published[ISOLATION]
    assert isolation.axes == 2
    assert published[CHECKED][-1].accel.linear.y == 0.0
    message = published[SAFETY][-1]
    assert message.mode[0] >= FormationSafety.MODE_EVADE
    assert message.isolated_axes[0] == 2
    assert "stuck on along T" in message.reason[0]
    health = node.health()[0]
    assert health.level == diagnostics.ERROR
    assert "stuck on along T" in health.message

    refused = node._on_reset(ResetSafety.Request(spacecraft="nobody"), ResetSafety.Response())
    assert not refused.success
    assert refused.message == "unknown spacecraft 'nobody'; guarded: deputy"
    assert node._on_reset(ResetSafety.Request(), ResetSafety.Response()).success
    fly_second(node, 2, relative(t=100.0), t=1e-3)
    assert published[ISOLATION][-1].axes == 0
    assert published[CHECKED][-1].accel.linear.y == 1e-3


def test_states_without_solution_or_of_another_deputy_do_not_count(make_node: NodeMaker) -> None:
    node, published = make_node(lockstep=False, wait=0.0)
    wrong = state(0, relative(t=40.0, vt=-20.0))
    wrong.child_frame_id = "another"
    send(node, "relative_state", wrong)
    send(node, "control/thrust_command", acceleration(0))
    node._watch()
    send(node, "propulsion/thrust_applied", acceleration(1))
    send(node, "relative_state", state(1, relative(t=40.0, vt=-20.0), RelativeState.SOLUTION_NONE))
    send(node, "control/thrust_command", acceleration(1))
    assert [len(message.first) for message in published[SAFETY]] == [0, 0]
    assert len(published[CHECKED]) == 2


def test_wrong_names_are_refused(make_node: NodeMaker) -> None:
    with pytest.raises(ParameterError, match="different names expected"):
        make_node(deputies=["a", "a"])


def test_a_chief_that_thrusts_is_waited_for_and_isolated(make_node: NodeMaker) -> None:
    node, published = make_node(deputies=["deputy", "other"], chief_thrusts=True)

    def fly(second: int, reported_chief: float = 0.0) -> None:
        for name, distance in (("deputy", 100.0), ("other", -100.0)):
            message = state(second, relative(t=distance))
            message.child_frame_id = name
            send(node, "relative_state", message, name)
            send(node, "control/thrust_command", acceleration(second), name)
            if second:
                send(node, "propulsion/thrust_applied", acceleration(second), name)
        send(node, "control/thrust_command", acceleration(second), "chief")
        if second:
            # The report of the chief is waited for as those of the deputies are.
            assert len(published[CHECKED]) == second
            report = acceleration(second, n=reported_chief)
            send(node, "propulsion/thrust_applied", report, "chief")
        assert len(published[CHECKED]) == second + 1
        assert len(published["/chief/control/thrust_command_checked"]) == second + 1

    fly(0)
    fly(1)
    message = published[SAFETY][-1]
    assert list(message.spacecraft) == ["deputy", "other", "chief"]
    assert not any(message.mode)
    fly(2, reported_chief=0.9)
    message = published[SAFETY][-1]
    assert list(message.isolated_axes) == [0, 0, 4]
    assert "stuck on along N" in message.reason[2]
    assert [item.axes for item in published["/chief/propulsion/isolation"]] == [4]
    assert published[ISOLATION] == []
    assert [status.hardware_id for status in node.health()] == ["deputy", "other", "chief"]
    answer = node._on_reset(ResetSafety.Request(spacecraft="chief"), ResetSafety.Response())
    assert answer.success

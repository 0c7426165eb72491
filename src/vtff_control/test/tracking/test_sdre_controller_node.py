"""The node sdre_controller: what it makes of solutions, their age and their covariance."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from vtff_control.sdre_controller_node import SdreControllerNode  # noqa: E402
from vtff_control.tracking.controller import ControlResult  # noqa: E402
from vtff_control.tracking.sdre import SdreController, SdreDesign  # noqa: E402
from vtff_dynamics.orbit.elements import ClassicalElements  # noqa: E402
from vtff_msgs.msg import RelativeState  # noqa: E402
from vtff_node import diagnostics  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

EPOCH = 1_458_521_983 * 10**9
CHIEF = ClassicalElements(6928137.0, 1e-9, np.pi / 3.0, 0.0, 0.0, 0.0).to_state()
TARGET = np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0])
CLOSING = np.array([0.0, 300.0, 0.0, 0.0, -20.0, 0.0])

NodeMaker = Callable[..., tuple[SdreControllerNode, list[AccelStamped]]]


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch, ros_context: rclpy.Context) -> Iterator[NodeMaker]:
    """A function that makes a node in lockstep, and the list of its commands."""
    nodes: list[SdreControllerNode] = []

    def make(**parameters: object) -> tuple[SdreControllerNode, list[AccelStamped]]:
        values = {"lockstep": True, "acceleration_cap": 1.4, **parameters}
        node = SdreControllerNode(
            context=ros_context,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        nodes.append(node)
        commands: list[AccelStamped] = []
        monkeypatch.setattr(node._publisher, "publish", lambda message: commands.append(message))
        return node, commands

    yield make
    for node in nodes:
        node.destroy_node()


def state(second: int, solution: int, sigma: float, age: float = 0.0) -> RelativeState:
    message = RelativeState(child_frame_id="deputy", solution=solution, age=age)
    message.header.stamp = to_stamp(EPOCH + second * 10**9)
    message.position, message.velocity = CLOSING[:3], CLOSING[3:]
    message.position_chief_gcrf, message.velocity_chief_gcrf = CHIEF[:3], CHIEF[3:]
    variances = [sigma**2] * 3 + [(0.05 * sigma) ** 2] * 3
    message.covariance = np.diag(variances).ravel()
    return message


def in_track(commands: list[AccelStamped]) -> float:
    return float(commands[-1].accel.linear.y)


def test_a_prediction_is_judged_by_its_covariance_not_by_its_age(make_node: NodeMaker) -> None:
    node, commands = make_node()
    expected = SdreController(SdreDesign("paper", acceleration_cap=1.4)).control(
        CLOSING, CHIEF, TARGET
    )
    node._on_relative_state(state(0, RelativeState.SOLUTION_PREDICTED, 1.0, age=500.0))
    assert in_track(commands) == expected.acceleration_rtn[1] != 0.0
    assert node.health()[0].level == diagnostics.OK


def test_out_of_bounds_it_brakes_and_says_so(make_node: NodeMaker) -> None:
    node, commands = make_node(design="navigation_aware")
    node._on_relative_state(state(0, RelativeState.SOLUTION_PREDICTED, 90.0))
    assert in_track(commands) == pytest.approx(1.4)
    health = node.health()[0]
    assert health.level == diagnostics.WARN
    assert "braking, not tracking: sigma of the position is 90 m" in health.message
    # The bounds are parameters.
    node, commands = make_node(design="navigation_aware", maximum_sigma_ratio=0.5)
    node._on_relative_state(state(0, RelativeState.SOLUTION_PREDICTED, 90.0))
    assert node.health()[0].level == diagnostics.OK


def test_an_option_that_is_switched_off_is_off(make_node: NodeMaker) -> None:
    shipped = SdreDesign("navigation_aware").options
    node, _ = make_node(design="navigation_aware", braking_share=0.0, quantum=0.0)
    assert node._controller.design.options == shipped._replace(braking_share=0.0, quantum=0.0)
    node, _ = make_node(design="navigation_aware", tolerated_deviation=0.0)
    assert node._controller.design.options == shipped._replace(tolerated_deviation=0.0)
    node, _ = make_node(design="navigation_aware")
    assert node._controller.design.options == shipped


def test_the_covariance_of_the_truth_does_not_count(make_node: NodeMaker) -> None:
    node, commands = make_node()
    node._on_relative_state(state(0, RelativeState.SOLUTION_TRUTH, 1e9))
    assert in_track(commands) != 0.0 and node.health()[0].level == diagnostics.OK


def test_no_solution_gives_no_thrust(make_node: NodeMaker) -> None:
    node, commands = make_node()
    node._on_relative_state(state(0, RelativeState.SOLUTION_NONE, 1e-3))
    assert in_track(commands) == 0.0
    assert "navigation has no solution" in node.health()[0].message


def test_a_covariance_that_is_not_finite_gives_no_thrust(make_node: NodeMaker) -> None:
    node, commands = make_node()
    node._on_relative_state(state(0, RelativeState.SOLUTION_FLOAT, float("nan")))
    assert in_track(commands) == 0.0
    assert "covariance: not finite" in node.health()[0].message


class FourArguments:
    """A controller of a laboratory that was written before states had a covariance."""

    def __init__(self) -> None:
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def control(self, relative_state_rtn, state_chief_gcrf, target_rtn, stamp=None):  # type: ignore[no-untyped-def]
        return ControlResult(np.array([0.0, 0.5, 0.0]), False, True)


@pytest.mark.parametrize(
    ("sigma", "thrust", "text"),
    [
        (1.0, 0.5, "controlling"),
        (90.0, 0.0, "more than 0.25 of the distance"),
        (float("nan"), 0.0, "covariance: not finite"),
    ],
)
def test_a_controller_without_covariance_acts_within_the_bounds(
    make_node: NodeMaker, sigma: float, thrust: float, text: str
) -> None:
    node, commands = make_node()
    node._controller, node._takes_covariance = FourArguments(), False
    node._on_relative_state(state(0, RelativeState.SOLUTION_PREDICTED, sigma))
    assert in_track(commands) == thrust
    assert text in node.health()[0].message


def test_guided_it_waits_for_target_and_feedforward_of_the_same_time(make_node: NodeMaker) -> None:
    node, commands = make_node(guided=True, acceleration_cap=50.0)
    target = state(0, RelativeState.SOLUTION_PREDICTED, 0.0)
    target.header.frame_id = "chief/rtn"
    target.position, target.velocity = CLOSING[:3] - [0.0, 10.0, 0.0], CLOSING[3:]
    thrust = AccelStamped()
    thrust.header.stamp = target.header.stamp
    thrust.accel.linear.z = 0.25
    measured = state(0, RelativeState.SOLUTION_TRUTH, 0.0)
    measured.header.frame_id = "chief/rtn"
    node._on_relative_state(measured)
    node._on_target(target)
    # The feedforward of another time is not that of this state.
    early = AccelStamped()
    early.header.stamp = to_stamp(EPOCH - 10**9)
    node._on_feedforward(early)
    assert not commands
    node._on_feedforward(thrust)
    expected = SdreController(SdreDesign("paper", acceleration_cap=50.0)).control(
        CLOSING, CHIEF, np.concatenate((target.position, target.velocity))
    )
    linear = commands[-1].accel.linear
    np.testing.assert_allclose(
        [linear.x, linear.y, linear.z], expected.acceleration_rtn + [0.0, 0.0, 0.25], atol=1e-15
    )
    assert len(commands) == 1
    # Without a solution there is no feedforward either.
    target.header.stamp = thrust.header.stamp = to_stamp(EPOCH + 10**9)
    node._on_relative_state(state(1, RelativeState.SOLUTION_NONE, 0.0))
    node._on_target(target)
    node._on_feedforward(thrust)
    assert len(commands) == 2
    assert commands[-1].accel.linear.z == 0.0

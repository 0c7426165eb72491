"""The node relative_ekf where its inputs are wrong."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from vtff_msgs.msg import RelativeState  # noqa: E402
from vtff_nav.relative.shipped_estimators import make_cdgps  # noqa: E402
from vtff_nav.relative_ekf_node import (  # noqa: E402
    RelativeEkfNode,
    RelativeEkfParameters,
    estimator_setting,
)
from vtff_node import qos  # noqa: E402
from vtff_node.parameters import ParameterError  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

DOMAIN = 117
SECOND = 10**9
EPOCH = 1_458_521_983 * SECOND
PATIENCE = 20.0  # s of wall time, ends a test that would hang


class Bench:
    """The node, and publishers of its thrust and clock."""

    def __init__(self, context: rclpy.Context, **parameters: object) -> None:
        self.node = RelativeEkfNode(
            context=context,
            parameter_overrides=[Parameter(name, value=v) for name, v in parameters.items()],
        )
        self.probe = rclpy.create_node("probe", context=context)
        self.thrust = self.probe.create_publisher(
            AccelStamped, "/deputy/propulsion/thrust_applied", qos.PUBLISH
        )
        self.clock = self.probe.create_publisher(Clock, "/clock", qos.PUBLISH)
        self.states: list[RelativeState] = []
        self.probe.create_subscription(
            RelativeState, "/formation/relative_state", self.states.append, qos.subscribe(True)
        )
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.probe)

    def spin_until(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "waited too long"
            self.executor.spin_once(timeout_sec=0.05)

    def count(self, name: str) -> int:
        """Return a number of the diagnostics."""
        (status,) = self.node.health()
        return int({pair.key: pair.value for pair in status.values}[name])

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.probe.destroy_node()


@pytest.fixture
def bench() -> Iterator[Bench]:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    made = Bench(context, estimator="paper", patience=0.01)
    yield made
    made.close()
    rclpy.shutdown(context=context)


def test_thrust_that_is_not_finite_is_refused(bench: Bench):
    """The refused thrust is counted, and the node goes on."""
    for second, value in enumerate((math.nan, math.inf, 0.1)):
        message = AccelStamped()
        message.header.stamp = to_stamp(EPOCH + second * SECOND)
        message.accel.linear.y = value
        bench.thrust.publish(message)
    bench.spin_until(lambda: bench.count("thrust not finite") == 2)
    bench.clock.publish(Clock(clock=to_stamp(EPOCH + 3 * SECOND)))
    bench.spin_until(lambda: bool(bench.states))
    assert bench.states[0].solution == RelativeState.SOLUTION_NONE


def test_integrator_reaches_the_filter():
    given = RelativeEkfParameters(integrator="euler", longest_step=0.5)
    configuration = make_cdgps(estimator_setting(given)).configuration
    assert (configuration.integrator, configuration.longest_step) == ("euler", 0.5)


def test_wrong_integrator_is_refused():
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    try:
        with pytest.raises(ParameterError, match="integrator"):
            RelativeEkfNode(
                context=context, parameter_overrides=[Parameter("integrator", value="rk5")]
            )
    finally:
        rclpy.shutdown(context=context)

"""The node attitude_estimator where relative navigation tells it where the spacecraft is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from node_bench import NodeBench  # noqa: E402

from vtff_dynamics.frames.rtn import deputy_state_gcrf  # noqa: E402
from vtff_msgs.msg import AdcsReport, AttitudeState, RelativeState  # noqa: E402
from vtff_nav.attitude_estimator_node import AttitudeEstimatorNode  # noqa: E402
from vtff_node import qos  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

SECOND = 10**9
EPOCH = 1_458_521_983 * SECOND
CHIEF = np.array([7.0e6, 0.0, 0.0, 0.0, 5.3e3, 5.3e3])
RELATIVE = np.array([20.0, 1000.0, -300.0, 0.01, -0.02, 0.1])


class Bench(NodeBench):
    """The node, and publishers of what it hears."""

    def __init__(self, context: rclpy.Context) -> None:
        super().__init__(
            context, AttitudeEstimatorNode, spacecraft="deputy", orbit_source="navigation"
        )
        self.states = self.probe.create_publisher(
            RelativeState, "/deputy/relative_state", qos.PUBLISH
        )
        self.reports = self.probe.create_publisher(AdcsReport, "/deputy/adcs/report", qos.PUBLISH)
        self.answers: list[AttitudeState] = []
        self.probe.create_subscription(
            AttitudeState, "/deputy/attitude", self.answers.append, qos.subscribe(True)
        )

    def navigate(self, second: float, solution: int, child: str = "deputy") -> None:
        message = RelativeState(child_frame_id=child, solution=solution)
        message.header.stamp = to_stamp(EPOCH + round(second * SECOND))
        message.header.frame_id = "chief/rtn"
        known = solution != RelativeState.SOLUTION_NONE
        chief, relative = (CHIEF, RELATIVE) if known else np.full((2, 6), np.nan)
        message.position_chief_gcrf, message.velocity_chief_gcrf = chief[:3], chief[3:]
        message.position, message.velocity = relative[:3], relative[3:]
        self.states.publish(message)

    def report(self, second: float) -> None:
        message = AdcsReport(child_frame_id="deputy", period=5.0, heard=True, pulse_step=0.01)
        message.header.stamp = to_stamp(EPOCH + round(second * SECOND))
        message.sample_times = [0.8, 0.0]
        message.field_body = np.full(6, 1.7e-5)
        self.reports.publish(message)


@pytest.fixture
def bench(ros_context: rclpy.Context) -> Iterator[Bench]:
    made = Bench(ros_context)
    publishers = (made.states, made.reports)
    made.spin_until(lambda: all(one.get_subscription_count() for one in publishers))
    made.spin_until(lambda: made.probe.count_publishers("/deputy/attitude"))
    yield made
    made.close()


def test_the_orbit_is_that_of_relative_navigation(bench):
    heard = {
        name
        for name, _ in bench.probe.get_subscriber_names_and_types_by_node(
            "attitude_estimator", "/deputy"
        )
    }
    assert {"/deputy/relative_state", "/deputy/adcs/report"} <= heard
    assert not [name for name in heard if "truth" in name or name.endswith("/orbit")]
    for second in range(6):
        bench.navigate(second, RelativeState.SOLUTION_FLOAT)
    bench.report(5.0)
    bench.spin_until(lambda: bench.answers)
    answer = bench.answers[-1]
    state = np.concatenate((answer.position_gcrf, answer.velocity_gcrf))
    np.testing.assert_allclose(state, deputy_state_gcrf(CHIEF, RELATIVE), rtol=1e-14)
    assert answer.source == AttitudeState.SOURCE_ESTIMATE
    assert "orbit" not in answer.reason
    assert np.isnan(answer.correction).all()


def test_before_navigation_each_report_is_answered_at_once(bench):
    bench.report(5.0)
    bench.navigate(5.0, RelativeState.SOLUTION_NONE)
    bench.spin_until(lambda: bench.answers)
    assert bench.answers[-1].reason == "orbit not known"
    assert not bench.answers[-1].valid


def test_without_navigation_for_a_while_the_orbit_is_predicted(bench):
    for second in (0.0, 5.0):
        bench.navigate(second, RelativeState.SOLUTION_CODE)
    bench.report(10.0)
    bench.navigate(10.0, RelativeState.SOLUTION_NONE)
    bench.spin_until(lambda: bench.answers)
    moved = bench.answers[-1].position_gcrf - deputy_state_gcrf(CHIEF, RELATIVE)[:3]
    assert np.linalg.norm(moved) == pytest.approx(5.0 * np.hypot(5.3e3, 5.3e3), rel=1e-2)


def test_the_state_of_another_deputy_is_not_its_orbit(bench):
    for second in (0.0, 5.0):
        bench.navigate(second, RelativeState.SOLUTION_FIXED, child="other")
    bench.report(5.0)
    bench.navigate(5.0, RelativeState.SOLUTION_NONE)
    bench.spin_until(lambda: bench.answers)
    assert bench.answers[-1].reason == "orbit not known"

"""Node cluster_guidance in this process: what it hears, answers and refuses."""

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseArray
from rclpy.parameter import Parameter

from vtff_control.cluster.timeline import MemberTimeline
from vtff_control.cluster_guidance_node import ClusterGuidanceNode
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import GnssFix
from vtff_node.parameters import ParameterError
from vtff_node.stamps import to_stamp

STEP = 10
EPOCH = GpsTime.from_week_tow(1889, 90_000.0).to_unix_nanoseconds()
START = np.array([6678e3, 0.0, 0.0, 0.0, 4798.888, 6054.69])
OWN = free_flight(START[np.newaxis], np.arange(0.0, 400.0, STEP))[:, 0]


@pytest.fixture
def make_node(ros_context):
    nodes = []

    def make(**parameters):
        values = {"lockstep": True, "station_period": 5419.2, **parameters}
        node = ClusterGuidanceNode(
            context=ros_context,
            namespace="/chaser",
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        nodes.append(node)
        commands = []
        node._publisher.publish = commands.append
        return node, commands

    yield make
    for node in nodes:
        node.destroy_node()


def fix(step, status=GnssFix.STATUS_SINGLE):
    stamp = EPOCH + step * STEP * 10**9
    state = state_gcrf_to_itrf(GpsTime.from_unix_nanoseconds(stamp), OWN[step])
    message = GnssFix(status=status, position=state[:3], velocity=state[3:])
    message.header.stamp = to_stamp(stamp)
    return message


def look(step, *positions):
    message = PoseArray(poses=[Pose(position=Point(x=x, y=y, z=z)) for x, y, z in positions])
    message.header.stamp = to_stamp(EPOCH + step * STEP * 10**9)
    return message


def give(node, steps, *positions, status=GnssFix.STATUS_SINGLE):
    for step in steps:
        node._on_message("neighbours", look(step, *positions))
        node._on_message("gnss/fix", fix(step, status))


def thrusts(commands):
    linear = [command.accel.linear for command in commands]
    return np.array([(each.x, each.y, each.z) for each in linear])


def test_hears_only_its_own_fix_and_sensor(make_node):
    node, _ = make_node()
    heard = {subscription.topic_name for subscription in node.subscriptions}
    assert heard - {"/parameter_events"} == {"/chaser/gnss/fix", "/chaser/neighbours"}


def test_every_look_is_answered_and_a_neighbour_too_near_is_left(make_node):
    node, commands = make_node(largest_acceleration=0.05)
    give(node, range(10), (600.0, 0.0, 0.0))
    given = thrusts(commands)
    assert [command.header.stamp for command in commands] == [
        look(k).header.stamp for k in range(10)
    ]
    assert {command.header.frame_id for command in commands} == {"chief/rtn"}
    # It decides every 30 s, and the well pushes it away, down.
    assert [k for k in range(10) if given[k].any()] == [3, 6, 9]
    assert given[3, 0] < 0.0
    assert np.abs(given).max() <= 0.05


def test_bad_looks_and_no_fix_give_no_thrust(make_node):
    node, commands = make_node()
    bad = [(float("nan"), 0.0, 0.0), (0.0, 0.0, 0.0), (float("inf"), 1.0, 1.0)]
    give(node, range(7), *bad)
    assert not thrusts(commands[:3]).any()
    assert "sees no neighbour" in node.health()[0].message
    give(node, range(7, 14), (600.0, 0.0, 0.0), status=GnssFix.STATUS_NONE)
    assert len(commands) == 14
    assert not thrusts(commands[7:]).any()
    assert node.health()[0].message == "no thrust: no fix"


def test_timeline_and_a_jump_back(make_node):
    node, commands = make_node(timeline=["100 gather", "200 free_drift"])
    give(node, range(30), (600.0, 0.0, 0.0))
    fired = np.flatnonzero(thrusts(commands).any(axis=1)) * STEP
    assert fired.min() >= 100 and fired.max() < 200
    give(node, range(12), (600.0, 0.0, 0.0))
    np.testing.assert_array_equal(thrusts(commands[30:]), thrusts(commands[:12]))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("gather", "time and mode"),
        ("x gather", "a number expected"),
        ("-1 gather", "0 s or more"),
        ("nan gather", "a number expected"),
        ("0 keep", "gather, orbits, free_drift"),
        ("0 gather now", "time and mode"),
    ],
)
def test_bad_lines_of_a_timeline_are_named(line, reason):
    with pytest.raises(ValueError, match=reason) as told:
        MemberTimeline.read(["0 free_drift", line])
    assert f"'{line}'" in str(told.value)


def test_bad_parameters_are_named(make_node):
    with pytest.raises(ParameterError, match="timeline, '0 keep'"):
        make_node(timeline=["0 keep"])
    with pytest.raises(ParameterError, match="decision_interval"):
        make_node(decision_interval=5.0)

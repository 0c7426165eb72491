"""The node by itself, without lockstep: late subscribers, end of a log, errors, diagnostics."""

from __future__ import annotations

import socket
import time

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
import rclpy.executors
from encoder_test_support import receiver_log
from rclpy.parameter import Parameter

from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel import read_log
from vtff_gnss.novatel.message_ids import ID_BESTXYZ
from vtff_msgs.msg import GnssEphemeris
from vtff_nav.receiver_driver_node import ReceiverDriverNode
from vtff_node import diagnostics, qos
from vtff_node.conversions.gnss import ephemeris_from_message
from vtff_node.parameters import ParameterError

SECONDS = 100


@pytest.fixture()
def log(tmp_path):
    """A log with three ephemerides, and an epoch and a fix in each second."""
    path = tmp_path / "receiver.gps"
    path.write_bytes(receiver_log(SECONDS))
    return path


def driver(context, namespace, **values):
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    return ReceiverDriverNode(context=context, namespace=namespace, parameter_overrides=overrides)


def run_to_end(node):
    """Call what the node's timer calls until the node has ended."""
    for _ in range(10_000):
        node._feed.pump()
        if node.finished:
            return
    pytest.fail("the node did not end")


def test_a_late_subscriber_gets_every_current_ephemeris(ros_context, log):
    node = driver(ros_context, "late_chief", port=str(log), replay_rate=0.0)
    run_to_end(node)
    assert node.exit_code == 0
    received = []
    listener = rclpy.create_node("listener", context=ros_context)
    listener.create_subscription(
        GnssEphemeris, "/late_chief/gnss/ephemeris", received.append, qos.subscribe(True)
    )
    expected = [event for event in read_log(log) if isinstance(event, BroadcastEphemeris)]
    executor = rclpy.executors.SingleThreadedExecutor(context=ros_context)
    executor.add_node(listener)
    deadline = time.monotonic() + 20.0
    while len(received) < len(expected) and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
    listener.destroy_node()
    assert [ephemeris_from_message(message) for message in received] == expected
    assert len(expected) == 3


def test_without_lockstep_the_wall_clock_paces(ros_context, log):
    node = driver(ros_context, "slow", port=str(log), replay_rate=1e-6)
    for _ in range(50):
        node._feed.pump()
    assert not node.finished
    # What has the time of the first second, and nothing of the next.
    published = node._publisher.published
    assert (published["epochs"], published["fixes"]) == (1, 1)
    node.on_stop()
    node.destroy_node()


def test_a_follower_waits_for_the_clock_and_says_so(ros_context, log):
    node = driver(ros_context, "follower", port=str(log), lockstep=True, start_timeout=0.1)
    node._feed.pump()
    assert not node.finished
    time.sleep(0.15)
    node._feed.pump()
    assert node.finished
    assert node.exit_code == 1
    assert node.health()[0].message == "no /clock to follow within 0 s"
    node.destroy_node()


def test_in_real_time_the_epoch_of_a_second_comes_after_its_fix_and_its_ephemerides(ros_context):
    """As in lockstep: who acts on the epoch has all of its second."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        node = driver(ros_context, "live", port=port, silence_timeout=1e6)
        order = []
        for name in ("epoch", "fix", "ephemeris"):
            publisher = getattr(node._publisher, f"_{name}")

            def publish(message, name=name, publish=publisher.publish):
                order.append(name)
                publish(message)

            publisher.publish = publish
        try:
            node._feed.pump()
            receiver, _ = server.accept()
            with receiver:
                receiver.sendall(receiver_log(1))
                deadline = time.monotonic() + 20.0
                while "epoch" not in order and time.monotonic() < deadline:
                    node._feed.pump()
        finally:
            node.on_stop()
            node.destroy_node()
    assert order == ["ephemeris"] * 3 + ["fix", "epoch"]


def fix_in_the_middle(content):
    """Return the place of a byte of a BESTXYZ log near the middle."""
    start = content.find(b"\xaa\x44\x12", len(content) // 2)
    while int.from_bytes(content[start + 4 : start + 6], "little") != ID_BESTXYZ:
        start = content.find(b"\xaa\x44\x12", start + 3)
    return start + 40


def test_health(ros_context, log, tmp_path):
    damaged = bytearray(log.read_bytes())
    damaged[fix_in_the_middle(damaged)] ^= 0xFF
    path = tmp_path / "damaged.gps"
    path.write_bytes(damaged)
    node = driver(ros_context, "health", port=str(path), replay_rate=0.0)
    assert node.health()[0].message == "reading"
    while not node._feed.at_end and not node._stream.counters.frames_crc_bad:
        node._feed.pump()
    first, second = node.health()[0], node.health()[0]
    assert first.level == diagnostics.WARN
    assert first.message == "1 damaged logs since the last report"
    assert first.hardware_id == str(path)
    assert second.level == diagnostics.OK
    run_to_end(node)
    values = {pair.key: pair.value for pair in node.health()[0].values}
    assert values["frames_crc_bad"] == "1"
    assert (int(values["epochs"]), int(values["fixes"])) == (SECONDS, SECONDS - 1)
    node.destroy_node()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "no NovAtel log that vtff reads was found in"),
        (bytes(range(256)) * 400, "no NovAtel log that vtff reads was found in"),
        (b"\r\n<OK\r\n[COM1]", "(1 logs or answers without a time)"),
    ],
)
def test_a_file_without_logs_fails_in_one_line(ros_context, tmp_path, content, expected):
    path = tmp_path / "other.bin"
    path.write_bytes(content)
    node = driver(ros_context, "wrong", port=f"file://{path}")
    run_to_end(node)
    assert node.exit_code == 1
    message = node.health()[0].message
    assert expected in message
    assert str(path) in message
    assert "\n" not in message
    node.destroy_node()


def test_a_missing_log_is_a_wrong_parameter(ros_context):
    with pytest.raises(ParameterError, match="nowhere.gps: No such file"):
        driver(ros_context, "missing", port="file://nowhere.gps")

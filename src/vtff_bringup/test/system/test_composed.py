"""Nodes that share a process hear each other and others, each message once."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from domain_coordinator import domain_id
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String

from vtff_bringup.run.domain import PROFILES_VARIABLE
from vtff_node import qos

PROFILE = pathlib.Path(__file__).resolve().parents[4] / "config/dds/fastdds.xml"
LIMIT = 60.0  # s after which a test gives up

PROGRAM = """
    import sys
    from std_msgs.msg import String
    from vtff_node.main import run_nodes
    from vtff_node.node import VtffNode

    class Speaker(VtffNode):
        def __init__(self):
            super().__init__("speaker")
            self.words = self.publisher(String, "words")
            self.words.publish(String(data="made"))
            self.said = 0
            self.subscribe(String, "heard", self.on_heard)
            self.create_timer(0.02, self.say, clock=self.steady_clock)

        def say(self):
            # Once the other process hears.
            if self.count_subscribers("heard") < 2 or self.said == 3:
                return
            self.said += 1
            self.words.publish(String(data=str(self.said)))

        def on_heard(self, message):
            print("back", message.data, self.words.get_subscription_count(), flush=True)
            if message.data == "end":
                self.finish()

    class Listener(VtffNode):
        def __init__(self):
            super().__init__("listener")
            self.heard = self.publisher(String, "heard")
            self.subscribe(String, "words", self.on_word, latched=True)

        def on_word(self, message):
            print("heard", message.data, flush=True)
            if message.data == "{broken}":
                raise KeyError("broken")
            self.heard.publish(String(data=message.data))

    sys.exit(run_nodes([Speaker, Listener], sys.argv[:1]))
"""


def start(folder: pathlib.Path, domain: int, *, broken: str = "") -> subprocess.Popen[str]:
    """Start the process of both nodes."""
    program = textwrap.dedent(PROGRAM).format(broken=broken)
    return subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain), PROFILES_VARIABLE: str(PROFILE)},
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


class Other:
    """A node of another process, which hears and speaks as well."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("other", context=self._context)
        self.heard: list[str] = []
        self._node.create_subscription(
            String, "heard", lambda message: self.heard.append(message.data), qos.subscribe(True)
        )
        self._words = self._node.create_publisher(String, "words", qos.PUBLISH)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def say(self, word: str) -> None:
        self._words.publish(String(data=word))

    def until_heard(self, word: str) -> None:
        deadline = time.monotonic() + LIMIT
        while self.heard[-1:] != [word] and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def other(monkeypatch) -> Iterator[Other]:
    monkeypatch.setenv(PROFILES_VARIABLE, str(PROFILE))
    with domain_id() as domain:
        made = Other(domain)
        yield made
        made.close()


def test_each_message_comes_once_within_the_process_and_to_and_from_others(other, tmp_path):
    process = start(tmp_path, other.domain)
    try:
        other.until_heard("3")
        other.say("end")
        other.until_heard("end")
        output, errors = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    heard = other.heard
    assert process.returncode == 0, errors
    assert heard == ["made", "1", "2", "3", "end"]
    lines = output.splitlines()
    assert [line for line in lines if line.startswith("heard")] == [f"heard {w}" for w in heard]
    # The subscription of the process counts. "made" may be overlooked.
    assert [line for line in lines if line.startswith("back")][-4:] == [
        f"back {word} 1" for word in heard[1:]
    ]


@pytest.mark.parametrize("broken", ["made", "1"])
def test_a_callback_that_fails_ends_the_process(other, tmp_path, broken):
    """Also that of a message from before the first callback."""
    process = start(tmp_path, other.domain, broken=broken)
    try:
        _, errors = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 1
    assert errors.strip().endswith("KeyError: 'broken'")

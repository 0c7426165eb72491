"""Nodes that share a process hear each other without the middleware, and all others with it."""

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

from vtff_bag.bag_recorder_node import BagRecorderNode
from vtff_bringup.system import composed
from vtff_control.sdre_controller_node import SdreControllerNode
from vtff_control.survey_guidance_node import SurveyGuidanceNode
from vtff_node import qos
from vtff_node.node import VtffNode
from vtff_node.process.run_environment import PROFILES_VARIABLE

PROFILE = pathlib.Path(__file__).resolve().parents[4] / "config/dds/fastdds.xml"
DEFAULT_PROFILES = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="own" is_default_profile="true"><rtps/></participant>
</profiles>
"""
LIMIT = 60.0  # s after which a test gives up

PROGRAM = """
    import pathlib, sys
    from rcl_interfaces.msg import Log
    from rclpy.action import ActionClient
    from std_msgs.msg import String
    from std_srvs.srv import Trigger
    from vtff_bringup.system.composed import deliver_locally
    from vtff_msgs.action import Reconfigure
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

    class Asking(Listener):
        def __init__(self):
            super().__init__()
            self.create_client(Trigger, "service")

    class Commanding(Listener):
        def __init__(self):
            super().__init__()
            ActionClient(self, Reconfigure, "action")

    class Reading(Listener):
        def __init__(self):
            super().__init__()
            self.create_subscription(Log, "/rosout", print, 10)

    assert deliver_locally([Speaker, Listener], pathlib.Path(sys.argv[1])) is {is_local}
    sys.exit(run_nodes([Speaker, {listener}], sys.argv[:1]))
"""


def start(
    folder: pathlib.Path,
    domain: int,
    *,
    broken: str = "",
    listener: str = "Listener",
    is_local: bool = True,
) -> subprocess.Popen[str]:
    """Start the process of both nodes."""
    program = textwrap.dedent(PROGRAM).format(broken=broken, listener=listener, is_local=is_local)
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        PROFILES_VARIABLE: str(PROFILE),
        composed.LOCAL_DELIVERY_VARIABLE: "" if is_local else "0",
    }
    return subprocess.Popen(
        [sys.executable, "-c", program, str(folder)],
        env=environment,
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


@pytest.mark.parametrize("case", ["local", "middleware", "another profile holds"])
def test_each_message_comes_once_within_the_process_and_to_and_from_others(other, tmp_path, case):
    is_local = case != "middleware"
    if case == "another profile holds":
        # Fast DDS finds it in the working directory, and it goes before that of the environment.
        (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text(DEFAULT_PROFILES)
    process = start(tmp_path, other.domain, is_local=is_local)
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
    # The subscription of the process counts, as without local delivery. "made" may be overlooked.
    assert [line for line in lines if line.startswith("back")][-4:] == [
        f"back {word} 1" for word in heard[1:]
    ]
    assert (tmp_path / composed.PROFILE_FILE).exists() is is_local


@pytest.mark.parametrize("broken", ["made", "1"])
def test_a_callback_that_fails_ends_the_process(other, tmp_path, broken):
    """Also that of a message that no callback has published."""
    process = start(tmp_path, other.domain, broken=broken)
    try:
        _, errors = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 1
    assert errors.strip().endswith("KeyError: 'broken'")


@pytest.mark.parametrize(
    ("listener", "what"),
    [("Asking", "calls services"), ("Commanding", "calls actions"), ("Reading", "hears /rosout")],
)
def test_a_node_that_needs_the_middleware_must_say_so(tmp_path, listener, what):
    with domain_id() as domain:
        process = start(tmp_path, domain, listener=listener)
        _, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 1
    assert f"{listener} {what}: its class must set needs_middleware = True" in errors


@pytest.fixture
def undelivered(monkeypatch):
    """The class without a delivery, whatever a test sets, and the profile of vtff."""
    monkeypatch.setattr(VtffNode, "local_delivery", None)
    monkeypatch.setenv(PROFILES_VARIABLE, str(PROFILE))
    monkeypatch.delenv(composed.LOCAL_DELIVERY_VARIABLE, raising=False)


def test_the_profile_is_that_of_vtff_with_one_property(undelivered, tmp_path):
    assert composed.deliver_locally([SdreControllerNode], tmp_path)
    changed = (tmp_path / composed.PROFILE_FILE).read_text()
    assert os.environ[PROFILES_VARIABLE] == str(tmp_path / composed.PROFILE_FILE)
    assert changed.replace(composed._IGNORES_OWN_ENDPOINTS, "") == PROFILE.read_text()
    participant = changed.index("vtff_participant")
    assert participant < changed.index("fastdds.ignore_local_endpoints") < len(changed)


@pytest.mark.parametrize("node_class", [BagRecorderNode, SurveyGuidanceNode])
def test_with_a_node_that_needs_the_middleware_all_messages_go_through_it(
    undelivered, tmp_path, node_class
):
    assert not composed.deliver_locally([SdreControllerNode, node_class], tmp_path)
    assert VtffNode.local_delivery is None
    assert os.environ[PROFILES_VARIABLE] == str(PROFILE)


@pytest.mark.parametrize("profile", ["", "absent.xml", "own.xml", "properties.xml"])
def test_a_profile_of_the_user_stays_as_it_is(undelivered, tmp_path, monkeypatch, profile):
    (tmp_path / "own.xml").write_text("<dds><profiles><participant/></profiles></dds>")
    properties = "<rtps><propertiesPolicy><properties/></propertiesPolicy>"
    (tmp_path / "properties.xml").write_text(PROFILE.read_text().replace("<rtps>", properties))
    chosen = str(tmp_path / profile) if profile else ""
    monkeypatch.setenv(PROFILES_VARIABLE, chosen)
    assert not composed.deliver_locally([SdreControllerNode], tmp_path)
    assert os.environ[PROFILES_VARIABLE] == chosen


def test_another_middleware_is_left_alone(undelivered, tmp_path, monkeypatch):
    monkeypatch.setattr(composed, "get_rmw_implementation_identifier", lambda: "rmw_cyclonedds_cpp")
    assert not composed.deliver_locally([SdreControllerNode], tmp_path)

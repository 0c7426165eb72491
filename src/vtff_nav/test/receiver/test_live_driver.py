"""The node on a live port: order of topics, lockstep, readiness, send_command, diagnostics."""

from __future__ import annotations

import contextlib
import threading
import time

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
import rclpy.executors
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
from rclpy.parameter import Parameter
from receiver_port_support import COMMANDS, PATIENCE, START, Outputs, serving
from rosgraph_msgs.msg import Clock

from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import GnssFix, GnssObservations, StepDone
from vtff_msgs.srv import SendCommand
from vtff_nav.receiver_driver_node import ReceiverDriverNode
from vtff_node import diagnostics, qos
from vtff_node.main import make_executor
from vtff_node.parameters import ParameterError
from vtff_node.stamps import to_nanoseconds, to_stamp
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware

BAUD = 460800


@pytest.fixture()
def ros():
    """A context of this test alone, in a DDS domain that no other process uses."""
    with domain_id() as free_domain:
        rclpy.init(domain_id=free_domain)
        yield
        rclpy.shutdown()


class Bench:
    """A driver node in the executor that it runs in, and a listener in one of its own."""

    def __init__(self, port: str, commands=COMMANDS, **values):
        values = {"port": port, "commands": list(commands), **values}
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        self.node = ReceiverDriverNode(namespace="chief", parameter_overrides=overrides)
        self.listener = rclpy.create_node("listener")
        self.received: list[tuple[str, object]] = []
        for kind, topic in (
            (GnssObservations, "/chief/gnss/high_rate"), (GnssObservations, "/chief/gnss/epoch"),
            (GnssFix, "/chief/gnss/fix"), (StepDone, "/sim/step_done"),
            (DiagnosticArray, "/diagnostics"),
        ):  # fmt: skip
            self.listener.create_subscription(
                kind, topic, lambda m, t=topic: self.received.append((t, m)), qos.subscribe(True)
            )
        self.clock = self.listener.create_publisher(Clock, "/clock", qos.PUBLISH)
        self.executor = make_executor()
        self.executor.add_node(self.node)
        self.executor.add_node(self.listener)

    def until(self, is_reached) -> None:
        deadline = time.monotonic() + PATIENCE
        while not is_reached():
            assert time.monotonic() < deadline, self.node.health()
            self.executor.spin_once(timeout_sec=0.02)

    def until_acknowledged(self, second: int) -> None:
        """Wait for the acknowledgement of a second; the first StepDone says that it is ready."""
        self.until(lambda: len(self.on("/sim/step_done")) == second + 2)

    def on(self, topic: str) -> list:
        return [message for name, message in self.received if name == topic]

    def tick(self, second: int) -> None:
        nanoseconds = GpsTime(START.nanoseconds + second * 10**9).to_unix_nanoseconds()
        self.clock.publish(Clock(clock=to_stamp(nanoseconds)))

    def close(self) -> None:
        self.node.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.listener.destroy_node()


@contextlib.contextmanager
def bench_on(*arguments, **values):
    bench = Bench(*arguments, **values)
    try:
        yield bench
    finally:
        bench.close()


@pytest.fixture()
def served(tmp_path):
    with serving(ReceiverFirmware(baud=BAUD), symlink=tmp_path / "receiver") as served:
        served.name = f"serial://{tmp_path / 'receiver'}"
        yield served


def values_of(status) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


LOCKSTEP = {"lockstep": True, "acknowledge_steps": True, "reports_ready": True}


def seconds_of(messages) -> list[int]:
    start = START.to_unix_nanoseconds()
    return [(to_nanoseconds(m.header.stamp) - start) // 10**9 for m in messages]


def test_lockstep_acknowledges_what_was_read(ros, served):
    with bench_on(served.name, **LOCKSTEP) as bench:
        bench.until(lambda: bench.on("/sim/step_done"))
        ready = bench.on("/sim/step_done")[0]
        assert (to_nanoseconds(ready.header.stamp), ready.node) == (0, "/chief/receiver_driver")
        served.advance(1, Outputs(signals=36))
        for second in range(4):
            bench.tick(second)
            bench.until_acknowledged(second)
            assert len(bench.on("/chief/gnss/high_rate")) <= 20 * second + 1
            served.advance(20, Outputs(signals=36))
        bench.until(lambda: len(bench.on("/chief/gnss/epoch")) == 5)
        assert seconds_of(bench.on("/sim/step_done")[1:]) == [0, 1, 2, 3]
        topics = [name.split("/")[-1] for name, _ in bench.received if "gnss" in name]
        assert topics[-22:] == ["epoch", *20 * ["high_rate"], "fix", "epoch"][-22:]
        assert seconds_of(bench.on("/chief/gnss/epoch")) == [0, 1, 2, 3, 4]


def test_a_silent_second_is_acknowledged_after_a_while(ros, served):
    with bench_on(served.name, silence_timeout=0.05, **LOCKSTEP) as bench:
        bench.until(lambda: bench.on("/sim/step_done"))
        served.advance(1, Outputs())
        for second in range(3):
            bench.tick(second)
            bench.until_acknowledged(second)
        assert len(bench.on("/chief/gnss/epoch")) == 1


def test_a_power_cycle_costs_seconds_and_is_over_before_the_next_one(ros, served):
    with bench_on(served.name, silence_timeout=0.05, **LOCKSTEP) as bench:
        bench.until(lambda: bench.on("/sim/step_done"))
        served.receiver.receive(b"SAVECONFIG\r\n")
        with served.lock:
            served.receiver._saved = ({}, BAUD, 10)
            served.port.send(served.receiver.power_cycle())
        served.epoch = 1
        for second in range(6):
            if second:
                served.advance(20, Outputs())
            bench.tick(second)
            bench.until_acknowledged(second)
        assert len(served.receiver.active_logs) == 3
        assert seconds_of(bench.on("/chief/gnss/epoch"))[-1] == 5
        status = values_of(bench.node.health()[0])
        assert status["configured"] == "2"
        assert "s of scenario time" in status["last problem"]


def test_in_real_time_every_second_has_its_epoch_and_its_fix(ros, served):
    """Their order is that of `test_receiver_driver_node`; here three seconds may come at once."""
    with bench_on(served.name) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        served.advance(41, Outputs())
        bench.until(lambda: len(bench.on("/chief/gnss/high_rate")) == 41)
        for topic in ("epoch", "fix"):
            bench.until(lambda topic=topic: len(bench.on(f"/chief/gnss/{topic}")) == 3)
        assert not bench.on("/sim/step_done")


def test_an_epoch_without_its_end_log_is_not_kept_for_ever(ros, served):
    commands = (*COMMANDS[:2],)
    with bench_on(served.name, commands, silence_timeout=0.05) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        served.advance(1, Outputs())
        bench.until(lambda: len(bench.on("/chief/gnss/epoch")) == 1)


def send_command(bench, command):
    client = bench.listener.create_client(SendCommand, "/chief/send_command")
    bench.until(client.service_is_ready)
    future = client.call_async(SendCommand.Request(command=command))
    bench.until(future.done)
    bench.listener.destroy_client(client)
    return future.result()


@pytest.mark.parametrize(
    ("command", "success", "expected"),
    [
        ("LOG BESTXYZB ONTIME 5", True, "OK"),
        ("  unlogall  ", True, "OK"),
        ("LOG NOTHING", False, "ERROR:Invalid Message. Field = NOTHING"),
        ("", False, "one command of printable ASCII characters is expected"),
        ("LOG A\r\nLOG B", False, "one command of printable ASCII characters is expected"),
    ],
)
def test_send_command(ros, served, command, success, expected):
    with bench_on(served.name) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        answer = send_command(bench, command)
        assert (answer.success, answer.response) == (success, expected)


def test_send_command_says_when_there_is_no_answer(ros, served):
    with bench_on(served.name) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        with served.lock:
            served.port.unplug()
        answer = send_command(bench, "LOG VERSION")
        assert not answer.success
        assert answer.response.startswith("no answer within 2 s; no connection (cannot open ")


def test_the_port_is_read_while_a_command_waits_for_its_answer(ros, served):
    with bench_on(served.name) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        with served.lock:
            original = served.receiver.receive
            served.receiver.receive = lambda content: b""

        def answer_late() -> None:
            served.advance(40, Outputs())
            with served.lock:
                served.receiver.receive = original
                served.port.send(original(b"LOG NOTHING\r\n"))

        threading.Timer(0.3, answer_late).start()
        answer = send_command(bench, "LOG NOTHING")
        assert answer.response == "ERROR:Invalid Message. Field = NOTHING"
        bench.until(lambda: len(bench.on("/chief/gnss/high_rate")) == 40)


def test_diagnostics(ros, served):
    with bench_on(served.name, reports_ready=True) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        served.advance(60, Outputs(signals=36))
        bench.until(lambda: len(bench.on("/chief/gnss/high_rate")) == 60)
        stream, tracking = bench.node.health()
        assert stream.level == diagnostics.OK
        assert stream.message == "running"
        assert stream.hardware_id == f"{served.name} EMULATED VTFF00000000"
        values = values_of(stream)
        assert values["epochs/s"] == "20.00"
        # 20 epochs of 1620 bytes, and BESTXYZ and TIME, at 460800 baud (interfaces.md 2.3: 70 %).
        assert 69.0 < float(values["link load %"]) < 73.0
        assert values["reconnects"] == "0"
        assert values["CRC-bad"] == "0"
        assert int(values["good"]) >= 60
        assert (values["unknown"], values["dropped"]) == ("0", "0")
        values = values_of(tracking)
        assert values["satellites"] == "31"
        assert values["C/N0 mean dB-Hz"] == "45.0"
        assert values["C/N0 least dB-Hz"] == "45.0"
        assert values["time status"] == "fine steering"
        assert values["clock model"] == "valid"


def test_diagnostics_of_a_receiver_that_sends_nothing(ros, served):
    with bench_on(served.name, silence_timeout=0.02, **LOCKSTEP) as bench:
        bench.until(lambda: bench.on("/sim/step_done"))
        bench.tick(0)
        bench.until_acknowledged(0)
        status = bench.node.health()[0]
        assert status.level == diagnostics.WARN
        assert status.message == "nothing received for 1 s of scenario time"


def test_diagnostics_of_a_receiver_that_is_not_there(ros, tmp_path):
    with bench_on(f"serial://{tmp_path / 'nowhere'}", reports_ready=True) as bench:
        bench.until(lambda: bench.node.health()[0].level == diagnostics.ERROR)
        assert "nowhere: no such device" in bench.node.health()[0].message
        assert bench.node.health()[1].level == diagnostics.WARN
        assert not bench.on("/sim/step_done")
        assert not bench.node.finished


def test_a_refused_command_is_an_error_in_diagnostics(ros, served):
    with bench_on(served.name, (*COMMANDS, "LOG NOTHING ONTIME 1")) as bench:
        bench.until(lambda: bench.node._feed._session.is_running)
        status = bench.node.health()[0]
        assert status.level == diagnostics.ERROR
        assert status.message == "'LOG NOTHING ONTIME 1': ERROR:Invalid Message. Field = NOTHING"


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"port": "tcp://nowhere"}, "parameter 'port': port 'tcp://nowhere': use tcp://"),
        ({"port": "serial:///dev/ttyS0", "publish_clock": True}, "parameter 'publish_clock'"),
        ({"port": "serial:///dev/ttyS0", "end_of_second_log": "RAWEPHEM"}, "choose one of: TIME"),
    ],
)
def test_wrong_parameters(ros, values, expected):
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    with pytest.raises(ParameterError, match=expected):
        ReceiverDriverNode(parameter_overrides=overrides)

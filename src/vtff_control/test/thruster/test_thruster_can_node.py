"""The node thruster_can on a virtual bus: what it publishes, acknowledges and reports."""

from __future__ import annotations

import functools
import pathlib
import threading
import time
from collections.abc import Callable, Iterator

import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from vtff_control.thruster_can_node import ThrusterCanNode  # noqa: E402
from vtff_msgs.msg import StepDone  # noqa: E402
from vtff_node import diagnostics, qos  # noqa: E402
from vtff_node.can_bus.connection import open_bus  # noqa: E402
from vtff_node.parameters import ParameterError  # noqa: E402
from vtff_node.stamps import to_nanoseconds, to_stamp  # noqa: E402
from vtff_sim_bridge.thruster.can_thruster_emulator import CanThruster, serve  # noqa: E402

DBC_FILE = pathlib.Path(__file__).resolve().parents[4] / "config" / "can" / "vtff_thruster.dbc"
SECOND = 10**9
EPOCH = 1_458_521_983 * SECOND
PATIENCE = 20.0  # s of wall time, ends a test that would hang


class Bench:
    """The node, a controller's publisher, and lists of what the node has published."""

    def __init__(self, context: rclpy.Context, channel: str, **parameters: object) -> None:
        values = {"dbc_file": str(DBC_FILE), "interface": "virtual", "channel": channel}
        self.node = ThrusterCanNode(
            context=context,
            namespace="deputy",
            parameter_overrides=[
                Parameter(name, value=value) for name, value in (values | parameters).items()
            ],
        )
        self.probe = rclpy.create_node("probe", context=context)
        self.commands = self.probe.create_publisher(
            AccelStamped, "/deputy/control/thrust_command", qos.PUBLISH
        )
        self.applied: list[AccelStamped] = []
        self.done: list[int] = []
        self.probe.create_subscription(
            AccelStamped,
            "/deputy/propulsion/thrust_applied",
            self.applied.append,
            qos.subscribe(True),
        )
        self.probe.create_subscription(
            StepDone, "/sim/step_done", self._on_done, qos.subscribe(True)
        )
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.probe)
        self.spin_until(lambda: self.commands.get_subscription_count() == 1)

    def _on_done(self, message: StepDone) -> None:
        self.done.append(to_nanoseconds(message.header.stamp))

    def command(self, second: int, *acceleration: float) -> None:
        message = AccelStamped()
        message.header.frame_id = "chief/rtn"
        message.header.stamp = to_stamp(EPOCH + second * SECOND)
        linear = message.accel.linear
        linear.x, linear.y, linear.z = acceleration
        self.commands.publish(message)

    def spin_until(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "waited too long"
            self.executor.spin_once(timeout_sec=0.05)

    def thrust(self) -> list[tuple[int, list[float]]]:
        """Return what was applied: start in seconds from the epoch, acceleration."""
        return [
            (
                (to_nanoseconds(message.header.stamp) - EPOCH) // SECOND,
                [message.accel.linear.x, message.accel.linear.y, message.accel.linear.z],
            )
            for message in self.applied
        ]

    def diagnosis(self, subject: str) -> tuple[bytes, str, dict[str, str]]:
        (status,) = [s for s in self.node.health() if s.name == f"thruster: {subject}"]
        return status.level, status.message, {pair.key: pair.value for pair in status.values}

    def close(self) -> None:
        self.node.on_stop()
        self.executor.shutdown()
        self.node.destroy_node()
        self.probe.destroy_node()


BenchMaker = Callable[..., Bench]


@pytest.fixture
def make_bench(request: pytest.FixtureRequest, ros_context: rclpy.Context) -> Iterator[BenchMaker]:
    benches: list[Bench] = []

    def make(**parameters: object) -> Bench:
        parameters = {"acknowledge_steps": bool(parameters.get("lockstep", False)), **parameters}
        benches.append(Bench(ros_context, request.node.name, **parameters))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


@pytest.fixture
def thruster(request: pytest.FixtureRequest) -> Iterator[CanThruster]:
    """An emulated thruster on the virtual bus of the test."""
    unit = CanThruster(DBC_FILE, acceleration_cap=1.4, quantum=1e-4)
    stop = threading.Event()
    open_one = functools.partial(open_bus, "virtual", request.node.name)
    thread = threading.Thread(target=serve, args=(unit, open_one, stop.is_set))
    thread.start()
    yield unit
    stop.set()
    thread.join()


def test_lockstep_publishes_the_report_and_acknowledges(
    make_bench: BenchMaker, thruster: CanThruster
) -> None:
    bench = make_bench(lockstep=True)
    for second in range(20):
        bench.command(second, 0.01 * second, 3.0, -1.00004)
        bench.spin_until(lambda: len(bench.done) == len(bench.applied) == second + 1)  # noqa: B023
    assert bench.done == [EPOCH + second * SECOND for second in range(20)]
    expected = [(s + 1, [s * 1000 * 1e-5, 140000 * 1e-5, -100000 * 1e-5]) for s in range(20)]
    assert bench.thrust() == expected
    assert bench.applied[0].header.frame_id == "chief/rtn"
    level, text, values = bench.diagnosis("thrust")
    assert (level, text) == (diagnostics.OK, "thrusting")
    assert values["commands"] == values["saturated"] == "20"
    level, text, values = bench.diagnosis("CAN link")
    assert (level, text) == (diagnostics.OK, "connected")
    assert (values["timeouts"], values["sequence gaps"], values["bus errors"]) == ("0", "0", "0")
    assert thruster.commands == 20


def test_delay_is_a_parameter_and_commands_out_of_order_are_dropped(
    make_bench: BenchMaker, thruster: CanThruster
) -> None:
    bench = make_bench(lockstep=True, delay_steps=3)
    for second in (5, 4, 5, 6):
        bench.command(second, 0.1, 0.0, 0.0)
    bench.spin_until(lambda: len(bench.applied) == 2)
    assert [start for start, _ in bench.thrust()] == [8, 9]
    assert bench.diagnosis("thrust")[2]["out of order"] == "2"


def test_command_that_is_not_finite_means_no_thrust(
    make_bench: BenchMaker, thruster: CanThruster
) -> None:
    bench = make_bench(lockstep=True)
    bench.command(0, float("nan"), 1.0, 1.0)
    bench.spin_until(lambda: len(bench.done) == len(bench.applied) == 1)
    assert bench.thrust() == [(1, [0.0, 0.0, 0.0])]
    assert bench.diagnosis("thrust")[1] == "zero thrust: thrust command: not finite"


def test_lockstep_without_a_thruster_ends_each_step_with_no_thrust(
    make_bench: BenchMaker, request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str]
) -> None:
    bench = make_bench(lockstep=True, start_timeout=0.3)
    for second in range(3):
        bench.command(second, 1.0, 1.0, 1.0)
        bench.spin_until(lambda: len(bench.done) == len(bench.applied) == second + 1)  # noqa: B023
    assert bench.thrust() == [(second + 1, [0.0, 0.0, 0.0]) for second in range(3)]
    assert bench.diagnosis("thrust")[:2] == (
        diagnostics.WARN,
        "zero thrust: no report from the thruster",
    )
    level, text, values = bench.diagnosis("CAN link")
    assert level == diagnostics.WARN and text == "nothing heard from the thruster yet"
    assert values["timeouts"] == "3"
    # One line where the silence begins, one where it ends.
    request.getfixturevalue("thruster")
    for second in range(3, 20):
        bench.command(second, 1.0, 0.0, 0.0)
        bench.spin_until(lambda: len(bench.done) == len(bench.applied) == second + 1)  # noqa: B023
        if bench.thrust()[-1][1] == [1.0, 0.0, 0.0]:
            break
    lines = [line.partition("]: ")[2] for line in capfd.readouterr().err.splitlines()]
    silences = [line for line in lines if "report" in line]
    assert len(silences) == 2
    assert silences[0].endswith("no report from the thruster: zero thrust till then")
    assert silences[1].startswith("the thruster reports again; ")


def test_lockstep_waits_for_a_thruster_that_starts_late(
    make_bench: BenchMaker, request: pytest.FixtureRequest
) -> None:
    bench = make_bench(lockstep=True)
    bench.command(0, 1.0, 0.0, 0.0)
    for _ in range(10):
        bench.executor.spin_once(timeout_sec=0.05)
    assert bench.applied == [] and bench.done == []
    request.getfixturevalue("thruster")
    bench.spin_until(lambda: len(bench.done) == len(bench.applied) == 1)
    assert bench.thrust() == [(1, [1.0, 0.0, 0.0])]


def test_watchdog_in_real_time_switches_the_thruster_off(
    make_bench: BenchMaker, thruster: CanThruster
) -> None:
    bench = make_bench(lockstep=False, watchdog_timeout=0.5)
    bench.command(0, 1.0, 0.0, 0.0)
    bench.spin_until(lambda: len(bench.applied) == 2)
    assert bench.thrust()[0] == (1, [1.0, 0.0, 0.0])
    start, acceleration = bench.thrust()[1]
    assert start >= 2 and acceleration == [0.0, 0.0, 0.0]
    level, text, values = bench.diagnosis("thrust")
    assert level == diagnostics.WARN and text == "zero thrust: no command for more than 0.5 s"
    assert values["watchdog trips"] == "1" and thruster.commands == 2
    bench.command(30, 1.0, 0.0, 0.0)
    bench.spin_until(lambda: (31, [1.0, 0.0, 0.0]) in bench.thrust())
    assert bench.done == []


@pytest.mark.parametrize(
    ("parameters", "name"),
    [({"dbc_file": "missing.dbc"}, "dbc_file"), ({"interface": "semaphore"}, "interface")],
)
def test_wrong_parameters_are_named(
    make_bench: BenchMaker, parameters: dict[str, str], name: str
) -> None:
    with pytest.raises(ParameterError, match=f"^parameter '{name}': "):
        make_bench(**parameters)


def test_stopping_switches_the_thruster_off(make_bench: BenchMaker, thruster: CanThruster) -> None:
    bench = make_bench(lockstep=True)
    bench.command(0, 1.0, 0.0, 0.0)
    bench.spin_until(lambda: len(bench.applied) == 1)
    bench.node.on_stop()
    end = time.monotonic() + PATIENCE
    while thruster.commands < 2:
        assert time.monotonic() < end, "no command to switch off"
        time.sleep(0.01)

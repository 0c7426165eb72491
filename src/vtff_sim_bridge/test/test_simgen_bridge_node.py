"""simgen_bridge waits for the nodes that prepare something before it starts SimGEN."""

from __future__ import annotations

import pathlib
import time

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import rclpy
from domain_coordinator import domain_id
from rclpy.parameter import Parameter

from vtff_msgs.msg import SimulatorStatus, StepDone
from vtff_node import qos
from vtff_node.main import make_executor
from vtff_sim_bridge.simgen_bridge_node import SimgenBridgeNode

SCENARIO = pathlib.Path(__file__).resolve().parents[3] / "config/scenario/reference.yaml"
DRIVERS = ["/chief/receiver_driver", "/deputy/receiver_driver"]
PATIENCE = 20.0


@pytest.fixture()
def ros():
    """Start ROS in a DDS domain that no other process uses."""
    with domain_id() as free_domain:
        rclpy.init(domain_id=free_domain)
        yield
        rclpy.shutdown()


def bridge(**values) -> SimgenBridgeNode:
    values = {
        "scenario_file": str(SCENARIO),
        "simgen_host": "",
        "coasting": ["deputy"],
        "lockstep_preparing": DRIVERS,
        **values,
    }
    return SimgenBridgeNode(
        parameter_overrides=[Parameter(name, value=value) for name, value in values.items()]
    )


def ready(node: str) -> StepDone:
    return StepDone(node=node)


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_run_starts_when_all_are_ready(ros, lockstep):
    node = bridge(lockstep=lockstep)
    node._start()
    node._step_source.acknowledge(ready(DRIVERS[0]))
    node._step_source.acknowledge(ready(DRIVERS[0]))
    node._step_source.acknowledge(ready("/somebody/else"))
    node._start()
    assert node._state == SimulatorStatus.STATE_IDLE
    node._step_source.acknowledge(ready(DRIVERS[1]))
    deadline = time.monotonic() + PATIENCE
    while node._state != SimulatorStatus.STATE_RUNNING:  # real time settles for half a second
        assert time.monotonic() < deadline
        node._start()
    node.destroy_node()


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_missing_one_is_named(ros, lockstep):
    node = bridge(lockstep=lockstep, start_timeout=0.1)
    node._step_source.acknowledge(ready(DRIVERS[0]))
    time.sleep(0.12)
    node._start()
    assert (node.finished, node.exit_code) == (True, 1)
    assert "/deputy/receiver_driver is not in the graph" in node.problem
    assert "/chief" not in node.problem
    node.destroy_node()


@pytest.mark.parametrize("lockstep", [True, False])
def test_who_was_ready_before_the_bridge_was_there_counts(ros, lockstep):
    driver = rclpy.create_node("receiver_driver", namespace="chief")
    driver.create_publisher(StepDone, "/sim/step_done", qos.PUBLISH).publish(ready(DRIVERS[0]))
    node = bridge(lockstep=lockstep, lockstep_preparing=DRIVERS[:1])
    executor = make_executor()
    executor.add_node(node)
    deadline = time.monotonic() + PATIENCE
    while node._state != SimulatorStatus.STATE_RUNNING:
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
    driver.destroy_node()

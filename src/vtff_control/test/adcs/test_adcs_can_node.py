"""The node adcs_can: frames that are sent before its bus is open would be lost."""

from __future__ import annotations

import pathlib

import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.parameter import Parameter  # noqa: E402

from vtff_control.adcs_can_node import AdcsCanNode  # noqa: E402
from vtff_node.can_bus import node_bus  # noqa: E402

DBC_FILE = pathlib.Path(__file__).resolve().parents[4] / "config" / "can" / "vtff_adcs.dbc"


def test_it_is_ready_once_its_bus_is_open(monkeypatch, ros_context):
    events = []
    open_bus = node_bus.open_bus

    def open_noted(*arguments):
        bus = open_bus(*arguments)
        events.append("bus open")
        return bus

    monkeypatch.setattr(node_bus, "open_bus", open_noted)
    monkeypatch.setattr(AdcsCanNode, "report_ready", lambda node: events.append("ready"))
    values = {"dbc_file": str(DBC_FILE), "interface": "virtual", "channel": "ready"}
    node = AdcsCanNode(
        context=ros_context,
        parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
    )
    node.on_stop()
    node.destroy_node()
    assert events == ["bus open", "ready"]

"""A node of this package and a probe that talks to it, spun by hand in a domain of their own."""

from __future__ import annotations

import time
from collections.abc import Callable

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from vtff_node.node import VtffNode

PATIENCE = 20.0  # s of wall time, ends a test that would hang


class NodeBench:
    """A node in the namespace deputy, and the node `probe` for what its test publishes and hears.

    Parameters
    ----------
    context : rclpy.Context
    kind : type of VtffNode
    **parameters
        Parameters of the node.
    """

    def __init__(self, context: rclpy.Context, kind: type[VtffNode], **parameters: object) -> None:
        self.node = kind(
            context=context,
            namespace="deputy",
            parameter_overrides=[Parameter(name, value=v) for name, v in parameters.items()],
        )
        self.probe = rclpy.create_node("probe", context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.probe)

    def spin_until(self, condition: Callable[[], object]) -> None:
        """Spin both nodes until a condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "waited too long"
            self.executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Stop both nodes."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.probe.destroy_node()

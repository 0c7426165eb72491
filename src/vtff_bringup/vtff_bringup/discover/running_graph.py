"""A node in a running graph, for commands that look at it or ask it for something."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vtff_node.process.stop_signals import StopRequest


@contextlib.contextmanager
def running_graph() -> Iterator[tuple[Any, Any, StopRequest]]:
    """Yield a node that listens in the graph, its executor, and a request to end by a signal."""
    from vtff_bringup.run.domain import add_dds_settings

    environment = dict(os.environ)
    add_dds_settings(environment)
    os.environ.update(environment)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from vtff_node.main import make_executor
    from vtff_node.process.stop_signals import StopRequest

    stop = StopRequest()
    stop.install()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    name = f"_vtff_command_{os.getpid()}"
    node = rclpy.create_node(name, start_parameter_services=False, enable_rosout=False)
    executor = make_executor()
    executor.add_node(node)
    try:
        yield node, executor, stop
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def domain_text() -> str:
    """Return the domain of the graph, for messages."""
    return f"ROS_DOMAIN_ID {os.environ.get('ROS_DOMAIN_ID', '0') or '0'}"

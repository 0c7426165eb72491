"""Looks who is in a DDS domain: ``python -m vtff_bringup.run.domain_probe NODE...``.

Prints one line if a program publishes /clock or a node has one of the names, else nothing. It
listens for a moment and publishes nothing: no parameters, no log.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence

import rclpy
from rclpy.signals import SignalHandlerOptions

LISTEN = 1.5  # s of wall time; programs answer a newcomer within a fraction of it
# Publishers without a name are reported from this time (s) before the end of listening on.
_NAME_PATIENCE = 0.3
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # rmw's name of a node that is not yet discovered


def find_occupant(nodes: Sequence[str], listen: float = LISTEN) -> str:
    """Return who publishes /clock or has one of the names; empty if nobody does."""
    probe = rclpy.create_node(
        f"_vtff_domain_probe_{os.getpid()}", start_parameter_services=False, enable_rosout=False
    )
    try:
        deadline = time.monotonic() + listen
        while time.monotonic() < deadline:
            publishers = probe.get_publishers_info_by_topic("/clock")
            # A publisher is discovered before the name of its node.
            is_named = publishers and publishers[0].node_name != _UNKNOWN_NODE
            if is_named or (publishers and time.monotonic() > deadline - _NAME_PATIENCE):
                first = publishers[0]
                name = f"{first.node_namespace.rstrip('/')}/{first.node_name}"
                return f"{name} publishes /clock there"
            present = {
                f"{namespace.rstrip('/')}/{name}"
                for name, namespace in probe.get_node_names_and_namespaces()
            }
            common = sorted(present & set(nodes))
            if common:
                return f"a node {common[0]} is there already"
            time.sleep(0.05)
    finally:
        probe.destroy_node()
    return ""


def main() -> None:
    """Print the occupant."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        print(find_occupant(sys.argv[1:]), flush=True)
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()

"""Run several nodes in one process: ``python -m vtff_bringup.system.composed FILE``.

FILE is the JSON list that `vtff run --composed` writes: package, executable and ROS
arguments of each node.

Where it can be, messages between these nodes do not go through the middleware
(`vtff_node.process.local_delivery`): Fast DDS then leaves them to this process, by a copy of the
profile of vtff beside FILE. With VTFF_LOCAL_DELIVERY=0 all messages go through the middleware.
"""

from __future__ import annotations

import functools
import gc
import json
import os
import pathlib
import sys
from collections.abc import Iterable
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier

from vtff_node.executables import node_class
from vtff_node.main import run_nodes
from vtff_node.node import VtffNode
from vtff_node.process.leaving import leave_process
from vtff_node.process.local_delivery import LocalDelivery
from vtff_node.process.run_environment import PROFILES_VARIABLE

LOCAL_DELIVERY_VARIABLE = "VTFF_LOCAL_DELIVERY"

#: Name of the copy of the profile of Fast DDS.
PROFILE_FILE = "fastdds_composed.xml"

# The participant in the profiles of vtff, and what is added to it.
_PARTICIPANT_TAG = '<participant profile_name="vtff_participant" is_default_profile="true">'
_CONTENT_TAG = "<rtps>"
_IGNORES_OWN_ENDPOINTS = (
    "<propertiesPolicy><properties><property>"
    "<name>fastdds.ignore_local_endpoints</name><value>true</value>"
    "</property></properties></propertiesPolicy>"
)


def make_factories(entries: list[dict[str, Any]]) -> list[functools.partial[Any]]:
    """Return one node factory per entry, each with its own ROS arguments."""
    return [
        functools.partial(
            node_class(entry["package"], entry["executable"]),
            cli_args=entry["ros_arguments"],
            use_global_arguments=False,
        )
        for entry in entries
    ]


def deliver_locally(node_classes: Iterable[Any], folder: pathlib.Path) -> bool:
    """Have messages between nodes of this process delivered without the middleware.

    To be called before ROS is initialised.

    Parameters
    ----------
    node_classes
        Classes of the nodes.
    folder
        Where the changed profile of Fast DDS is written.

    Returns
    -------
    bool
        False where that is not possible: a node needs the middleware, the middleware is another one
        than Fast DDS or has a profile that is not of vtff, or the user does not want it.
    """
    profile = _changed_profile()
    if (
        os.environ.get(LOCAL_DELIVERY_VARIABLE) == "0"
        or any(each.needs_middleware for each in node_classes)
        or not get_rmw_implementation_identifier().startswith("rmw_fastrtps")
        or profile is None
    ):
        return False
    path = folder / PROFILE_FILE
    try:
        path.write_text(profile, encoding="utf-8")
    except OSError:
        return False
    # Programs that nodes start inherit it: endpoints of such a program hear each other no more.
    os.environ[PROFILES_VARIABLE] = str(path)
    VtffNode.local_delivery = LocalDelivery()
    return True


def _changed_profile() -> str | None:
    """Return the profile in force such that Fast DDS ignores endpoints of its own process.

    None if it is not one of vtff.
    """
    try:
        text = pathlib.Path(os.environ.get(PROFILES_VARIABLE, "")).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None
    before, participant, after = text.partition(_PARTICIPANT_TAG)
    # With a second list of properties Fast DDS would refuse the whole profile.
    if _CONTENT_TAG not in after or "<propertiesPolicy" in text:
        return None
    changed = after.replace(_CONTENT_TAG, _CONTENT_TAG + _IGNORES_OWN_ENDPOINTS, 1)
    return before + participant + changed


def main() -> None:
    """Run the nodes that the file on the command line lists."""
    # Imports make many objects and no garbage: looking for it takes a tenth of them.
    gc.disable()
    file = pathlib.Path(sys.argv[1])
    factories = make_factories(json.loads(file.read_text(encoding="utf-8")))
    deliver_locally((factory.func for factory in factories), file.parent)
    leave_process(run_nodes(factories, sys.argv[:1]))


if __name__ == "__main__":
    main()

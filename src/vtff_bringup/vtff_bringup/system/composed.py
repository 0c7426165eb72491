"""Run several nodes in one process: ``python -m vtff_bringup.system.composed FILE``.

FILE is the JSON list that `vtff run --composed` writes: package, executable and ROS
arguments of each node.
"""

from __future__ import annotations

import functools
import json
import pathlib
import sys
from typing import Any

from vtff_node.executables import node_class
from vtff_node.main import run_nodes
from vtff_node.process.leaving import leave_process


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


def main() -> None:
    """Run the nodes that the file on the command line lists."""
    entries = json.loads(pathlib.Path(sys.argv[1]).read_text(encoding="utf-8"))
    factories = make_factories(entries)
    leave_process(run_nodes(factories, sys.argv[:1]))


if __name__ == "__main__":
    main()

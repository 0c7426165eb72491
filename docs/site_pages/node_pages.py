"""Pages of the nodes: what each does, and its parameters with units, ranges and defaults."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.metadata
import inspect
from typing import Any

from vtff_node import parameters
from vtff_node.node import CommonParameters, VtffNode


def find_nodes() -> dict[str, tuple[str, type[VtffNode]]]:
    """Return the nodes of all installed packages: executable -> package and class."""
    nodes = {}
    for entry in importlib.metadata.entry_points(group="console_scripts"):
        module_name = entry.value.partition(":")[0]
        if not module_name.startswith("vtff_") or not module_name.endswith("_node"):
            continue
        module = importlib.import_module(module_name)
        for value in vars(module).values():
            is_node = inspect.isclass(value) and issubclass(value, VtffNode)
            if is_node and value.__module__ == module_name and not inspect.isabstract(value):
                nodes[entry.name] = (module_name.partition(".")[0], value)
    return dict(sorted(nodes.items()))


def node_page(executable: str, package: str, node_class: type[VtffNode]) -> str:
    """Return the page of a node."""
    text = inspect.cleandoc(node_class.__doc__ or "")
    lines = [f"# {executable}", "", f"`ros2 run {package} {executable}`", ""]
    lines += ["```{eval-rst}", text, "```", ""]
    lines += ["## Parameters", "", "| parameter | default | unit | allowed | meaning |"]
    lines += ["|---|---|---|---|---|"]
    table = node_class.Parameters
    for source in filter(None, (table, CommonParameters)):
        for field in parameters.fields_in_order(source):
            lines.append(_parameter_row(field))
    if node_class.Plugins is not None:
        lines += ["", "Plug-ins bring parameters of their own: see [plug-ins](../../plugins.md)."]
    return "\n".join(lines) + "\n"


def _parameter_row(field: dataclasses.Field[Any]) -> str:
    metadata = parameters.metadata_of(field)
    default = "required" if metadata["required"] else f"`{parameters.default_of(field)!r}`"
    minimum, maximum = metadata["minimum"], metadata["maximum"]
    allowed = ", ".join(f"`{choice}`" for choice in metadata["choices"])
    if minimum is not None and maximum is not None:
        allowed = f"{minimum:g} to {maximum:g}"
    elif minimum is not None:
        allowed = f"at least {minimum:g}"
    elif maximum is not None:
        allowed = f"at most {maximum:g}"
    cells = (f"`{field.name}`", default, metadata["unit"], allowed, metadata["description"])
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"

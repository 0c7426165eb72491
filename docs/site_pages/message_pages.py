"""The page of the messages: the definition files with their comments."""

from __future__ import annotations

import pathlib


def message_page(root: pathlib.Path) -> str:
    """Return the page of all messages, services and actions of vtff_msgs."""
    lines = [
        "# Messages",
        "",
        "Definitions of `vtff_msgs`, with units and frames. `ros2 interface show "
        "vtff_msgs/msg/RelativeState` prints the same.",
        "",
    ]
    for kind in ("msg", "srv", "action"):
        for file in sorted((root / "src/vtff_msgs" / kind).glob(f"*.{kind}")):
            definition = file.read_text(encoding="utf-8").rstrip()
            lines += [f"## {file.stem}", "", "```text", definition, "```", ""]
    return "\n".join(lines)

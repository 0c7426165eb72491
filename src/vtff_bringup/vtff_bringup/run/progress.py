"""A run on the terminal: scenario time, speed, in-track positions, links to hardware."""

from __future__ import annotations

import os
import re
import time
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from vtff_bringup.system.description import NodeDescription, SystemDescription

#: Without a terminal, a line is printed each time another such fraction of the run is done.
LINE_FRACTION = 0.1

_EMULATORS = ("simgen_emulator", "can_thruster_emulator")
_THERE = "all inputs are there"
_WAITING = re.compile(rf"waiting for|{_THERE}|connected|baud")
_PREFIX = re.compile(r"^\[\w+\] \[[\d.]+\] \[(?P<node>[^\]]*)\]: ")


class RunProgress:
    """Shows the progress reports of the node that paces a run, as a bar or as lines."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._started: float | None = None
        self._next_line = LINE_FRACTION
        self._task: TaskID | None = None
        self._bar: Progress | None = None
        if console.is_interactive:
            self._bar = Progress(
                BarColumn(bar_width=30),
                TextColumn("{task.description}"),
                TimeRemainingColumn(),
                console=console,
                transient=True,
            )

    def __enter__(self) -> RunProgress:
        """Start the bar."""
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task("starting", total=None)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()

    def print(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(escape(text), soft_wrap=True)

    def update(self, report: dict[str, Any]) -> None:
        """Show one progress report of `vtff_node.node.VtffNode.report_progress`."""
        done, total = float(report["done"]), float(report["total"])
        if self._started is None:
            self._started = time.monotonic()
        text = self._describe(done, total, report)
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, total=total, description=text)
        elif total > 0.0 and done / total >= self._next_line:
            self._next_line += LINE_FRACTION
            # A line of its own in a file or a pipe, however long it is.
            self._console.print(f"  {text}", soft_wrap=True)

    def _describe(self, done: float, total: float, report: dict[str, Any]) -> str:
        assert self._started is not None
        elapsed = time.monotonic() - self._started
        parts = [f"{done:6.0f} / {total:.0f} {report.get('unit', 's')}"]
        if elapsed > 0.5 and report.get("unit", "s") == "s":
            parts.append(f"{done / elapsed:5.0f} x real time")
        for name, value in report.get("in_track", {}).items():
            parts.append(f"{name} in-track {value:9.2f} m")
        return "   ".join(parts)


class LinkLines:
    """What the console tells about the links of a run to hardware, from its first second on.

    A run with emulators says nothing when it starts as it should. One with hardware tells what each
    link is waiting for, because a cable, a name or a baud rate may be wrong.

    Parameters
    ----------
    description
        The system; without links to hardware nothing is told.
    """

    def __init__(self, description: SystemDescription) -> None:
        emulated = {process.executable for process in description.processes}
        nodes = description.nodes
        self.first: list[str] = []
        if not emulated & {_EMULATORS[0]}:
            drivers = (node for node in nodes if node.executable == "receiver_driver")
            self.first += [line for node in drivers if (line := _receiver_line(node))]
            bridges = (node for node in nodes if node.executable == "simgen_bridge")
            self.first += [line for node in bridges if (line := _simgen_line(node))]
        if not emulated & {_EMULATORS[1]}:
            self.first += [_can_line(n) for n in nodes if n.executable == "thruster_can"]
        self._told: set[tuple[tuple[str, str], str]] = set()

    def is_new(self, name: str, line: str) -> bool:
        """Return whether a line of a node tells the state of a link, for the first time.

        Parameters
        ----------
        name
            Name of the process.
        line
            Line that it printed.
        """
        if not self.first or not _WAITING.search(line):
            return False
        prefix = _PREFIX.match(line)
        speaker = (name, "" if prefix is None else prefix["node"])
        told = (speaker, _PREFIX.sub("", line))
        # That inputs are there answers a node that was waiting; of others it would say of cables
        # what is true of topics.
        waited = any(speaker == other for other, _ in self._told)
        if told in self._told or (_THERE in line and not waited):
            return False
        self._told.add(told)
        return True


def _receiver_line(node: NodeDescription) -> str:
    port = str(node.all_parameters().get("port", ""))
    if not port:
        return ""
    if os.path.isfile(port):
        return ""  # a log
    if port.startswith("tcp://"):
        state = "is connected to"
    else:
        state = "is there" if os.path.exists(port) else "no such device yet"
    return f"receiver of {node.namespace.strip('/')}: {port} ({state})"


def _simgen_line(node: NodeDescription) -> str:
    given = node.all_parameters()
    if not given.get("simgen_host"):
        return ""
    address = f"{given.get('simgen_host', '')}:{given.get('simgen_port', '')}"
    return f"SimGEN: {address} (is connected to when the other nodes are ready)"


def _can_line(node: NodeDescription) -> str:
    given = node.all_parameters()
    bus = f"{given.get('interface', '')} {given.get('channel', '')}".strip()
    return f"thruster of {node.namespace.strip('/')}: CAN bus {bus}"

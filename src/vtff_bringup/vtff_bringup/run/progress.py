"""Progress of a run on the terminal: scenario time, speed, in-track positions."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

#: Without a terminal, a line is printed each time another such fraction of the run is done.
LINE_FRACTION = 0.1


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

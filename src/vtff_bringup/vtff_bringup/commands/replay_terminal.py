"""Keys and progress bar of a replay in a terminal."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

if TYPE_CHECKING:
    from vtff_bag.bag_player_node import BagPlayerNode

#: Action of each key, by the bytes that a terminal sends.
KEYS = {
    b" ": "toggle",
    b"\x1b[C": "step",
    b"\x1b[A": "faster",
    b"\x1b[B": "slower",
    b"\x1b[D": "back",
    b"\x1b[5~": "back",
    b"\x1b[6~": "forward",
    b"0": "start",
    b"q": "quit",
}
HELP = (
    "space pause/resume, \N{RIGHTWARDS ARROW} next message, \N{UPWARDS ARROW}\N{DOWNWARDS ARROW} "
    "rate, \N{LEFTWARDS ARROW} back 10 s, PgDn forward 10 s, 0 start, q quit"
)

RATE_FACTOR = 1.25  # by which the keys change the rate
JUMP = 10.0  # s of recorded time by which the keys go back and forward

UPDATE_INTERVAL = 0.1  # s of wall time between updates of the bar
LINE_FRACTION = 0.1  # without a terminal: fraction of the replay between lines


def split_keys(typed: bytes) -> Iterator[str]:
    """Yield the actions of the keys typed; unknown keys are left out."""
    position = 0
    while position < len(typed):
        for key, action in KEYS.items():
            if typed.startswith(key, position):
                yield action
                position += len(key)
                break
        else:
            position += 1


def apply_action(action: str, node: BagPlayerNode) -> None:
    """Perform the action of a key."""
    replay = node.replay
    assert replay is not None
    if action == "toggle":
        (node.resume if replay.paused else node.pause)()
    elif action == "step":
        node.pause()
        replay.step()
    elif action in ("faster", "slower"):
        factor = RATE_FACTOR if action == "faster" else 1.0 / RATE_FACTOR
        with contextlib.suppress(ValueError):  # at the end of its range the rate stays
            replay.set_rate(replay.rate * factor)
    elif action in ("back", "forward", "start"):
        offset = {"back": replay.position - JUMP, "forward": replay.position + JUMP}.get(action, 0)
        replay.seek(min(max(offset, 0.0), replay.duration))
    elif action == "quit":
        node.finish()


class Keyboard:
    """Reads single keys from the terminal without echo; without a terminal there are no keys."""

    def __init__(self) -> None:
        self._descriptor = -1
        self._restore: Callable[[], None] | None = None

    def __enter__(self) -> Keyboard:
        """Set the terminal to single keys without echo."""
        with contextlib.suppress(ImportError, OSError, ValueError):
            descriptor = sys.stdin.fileno()
            if os.isatty(descriptor):
                before = termios.tcgetattr(descriptor)
                tty.setcbreak(descriptor)
                self._descriptor = descriptor
                self._restore = lambda: termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
        return self

    def __exit__(self, *exception: object) -> None:
        """Restore the settings of the terminal."""
        if self._restore is not None:
            self._restore()

    @property
    def present(self) -> bool:
        """Whether standard input is a terminal."""
        return self._restore is not None

    def actions(self) -> list[str]:
        """Return the actions of the keys typed since the last call, without waiting."""
        if not self.present or not select.select([self._descriptor], [], [], 0.0)[0]:
            return []
        return list(split_keys(os.read(self._descriptor, 256)))


class ReplayProgress:
    """Shows the position of a replay: as a bar, or as lines without a terminal that draws bars."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._next_update = 0.0
        self._next_line = LINE_FRACTION
        self._printed_state = ""
        self._task: TaskID | None = None
        self._bar: Progress | None = None
        if console.is_interactive:
            self._bar = Progress(
                BarColumn(bar_width=30),
                TextColumn("{task.description}"),
                console=console,
                transient=True,
            )

    def __enter__(self) -> ReplayProgress:
        """Start the bar."""
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task("starting", total=None)
        return self

    def __exit__(self, *exception: object) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()

    def update(self, node: BagPlayerNode) -> None:
        """Show the position of the replay, at most once each `UPDATE_INTERVAL`."""
        now = time.monotonic()
        replay = node.replay
        if replay is None or now < self._next_update:
            return
        self._next_update = now + UPDATE_INTERVAL
        state = f"{'paused' if replay.paused else 'playing'} x {replay.rate:g}"
        text = (
            f"{replay.position:8.1f} / {replay.duration:.1f} s  {state}"
            f"  {replay.published} messages"
        )
        if self._bar is not None and self._task is not None:
            total = max(replay.duration, 1e-9)
            self._bar.update(self._task, completed=replay.position, total=total, description=text)
        elif state != self._printed_state or replay.position >= self._next_line * replay.duration:
            while replay.position >= self._next_line * replay.duration and self._next_line <= 1.0:
                self._next_line += LINE_FRACTION
            self._printed_state = state
            self._console.print(f"  {text}", highlight=False)

"""`vtff replay` in a terminal: what the keys do, and what is printed."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import termios
import time
import types

import bag_samples
import pytest

from vtff_bag.file.reader import BagReader
from vtff_bag.player.messages_in_order import Replay
from vtff_bringup.commands.replay_terminal import KEYS, apply_action, split_keys

COUNT = 300
LIMIT = 60.0  # s after which a test gives up


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    directory = tmp_path_factory.mktemp("replay") / "bag"
    bag_samples.write_bag(directory, bag_samples.sample_messages(COUNT))
    return directory


def test_keys(recording):
    done = []
    reader = BagReader(recording)
    replay = Replay(reader, reader.topics, lambda message: None, paused=True)
    node = types.SimpleNamespace(
        replay=replay, pause=replay.pause, resume=replay.resume, finish=lambda: done.append(1)
    )
    typed = b"x" + b"".join(KEYS) + b"\x1b["
    assert list(split_keys(typed)) == list(KEYS.values())
    for action in KEYS.values():
        apply_action(action, node)
    assert done == [1]
    assert replay.position == 0.0 and replay.rate == 1.0
    apply_action("forward", node)
    assert replay.position == 10.0
    for _ in range(200):
        apply_action("slower", node)
    assert replay.rate >= 1e-3


def read_until(terminal, text, printed=b""):
    """Return everything printed until a text stands in it."""
    deadline = time.monotonic() + LIMIT
    while text not in printed:
        assert time.monotonic() < deadline, printed
        if select.select([terminal], [], [], 0.1)[0]:
            printed += os.read(terminal, 65536)
    return printed


@pytest.mark.parametrize("kind", ["xterm", "dumb"])
def test_keys_in_a_terminal(recording, kind):
    """A bar where it can be drawn, else a line for each change."""
    terminal, side = pty.openpty()
    before = termios.tcgetattr(side)
    domain_coordinator = pytest.importorskip("domain_coordinator")
    with domain_coordinator.domain_id() as free_domain:
        player = subprocess.Popen(
            [sys.executable, "-m", "vtff_bringup.cli", "replay", str(recording), "--delay", "0"],
            stdin=side,
            stdout=side,
            stderr=side,
            env={
                **os.environ,
                "ROS_DOMAIN_ID": str(free_domain),
                "COLUMNS": "100",
                "TERM": kind,
            },
        )
        try:
            read_until(terminal, b"playing x 1")
            os.write(terminal, b" ")
            read_until(terminal, b"paused x 1")
            os.write(terminal, b"\x1b[A")
            read_until(terminal, b"paused x 1.25")
            os.write(terminal, b"q")
            read_until(terminal, b"messages published")
            assert player.wait(timeout=LIMIT) == 0
            assert termios.tcgetattr(side) == before
        finally:
            player.kill()
            player.wait()
            os.close(terminal)
            os.close(side)

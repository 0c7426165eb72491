"""Imports while a run flies do not break the threads that come later."""

from __future__ import annotations

import subprocess
import sys

_PROGRAM = """
import threading
from vtff_bringup.run.background_import import BackgroundImport

imports = BackgroundImport("vtff_dynamics.frames.earth")
imports.begin()
imports.wait()
from vtff_dynamics.time.timescales import GpsTime
for _ in range(5):
    # A text comes from the allocator of brahe, a number does not.
    thread = threading.Thread(target=lambda: str(GpsTime(10**18).to_brahe_epoch()))
    thread.start()
    thread.join()
print("whole")
"""


def test_threads_after_the_import_may_use_brahe():
    """The first of them took the number of the importing thread and died by SIGSEGV."""
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout) == (0, "whole\n"), done.stderr

"""The vtff command as a program that ends in order when the program that started it dies.

``python -m vtff_bringup.campaign.dependent_run PARENT ARGUMENT...``: PARENT is the process id of
the one that starts it, the rest are the arguments of ``vtff``. Linux sends it SIGTERM when PARENT
is gone.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_SET_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2); it outlives the change of program


def main() -> None:
    """Become the vtff command."""
    parent, *arguments = sys.argv[1:]
    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGTERM)
    if os.getppid() != int(parent):
        sys.exit(f"process {parent}, which started this run, is gone")
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # workers have it blocked
    os.execv(sys.executable, [sys.executable, "-m", "vtff_bringup.cli", *arguments])


if __name__ == "__main__":
    main()

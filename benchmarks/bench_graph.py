"""Speed of the reference run: whole graph, 1 Hz, one hour of scenario, every topic recorded.

The factor counts from the first step to the last, start and end of the processes left out; the
second one counts everything. The yardstick tells how fast this machine is just now: single-core
seconds for ten million additions in Python (0.6 to 0.8 s on a quiet current machine).
"""

from __future__ import annotations

import argparse
import pathlib
import platform
import statistics
import subprocess
import sys
import tempfile
import time

from vtff_bringup.bag.reader import BagReader

ROOT = pathlib.Path(__file__).resolve().parents[1]
SYSTEM = ROOT / "config/system/reference_software.yaml"
TARGETS = {"separate processes": 400, "composed": 1000}


def yardstick() -> float:
    """Return the seconds that ten million additions take."""
    started = time.perf_counter()
    total = 0
    for number in range(10_000_000):
        total += number
    return time.perf_counter() - started


def measure(composed: bool, duration: float) -> tuple[float, float]:
    """Run once; return real-time factors of the stepping alone and of everything."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "vtff_bringup.cli", "run", str(SYSTEM), "--no-report"]
        command += ["--out", f"{folder}/run", "--duration", str(duration)]
        command += ["--composed"] if composed else []
        started = time.perf_counter()
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        everything = duration / (time.perf_counter() - started)
        *_, last = BagReader(f"{folder}/run").messages("/sim/status")
        return float(last.message.real_time_factor), everything


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3, help="runs of each kind (%(default)s)")
    parser.add_argument("--duration", type=float, default=3600.0, help="scenario seconds")
    options = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    print("| mode | target | best | median | with start and end | yardstick before each, s |")
    print("|---|---|---|---|---|---|")
    for mode, target in TARGETS.items():
        marks, factors, totals = [], [], []
        for _ in range(options.repeat):
            marks.append(yardstick())
            factor, total = measure(mode == "composed", options.duration)
            factors.append(factor)
            totals.append(total)
        shown = " ".join(f"{mark:.2f}" for mark in marks)
        print(
            f"| {mode} | {target} | {max(factors):.0f} | {statistics.median(factors):.0f} "
            f"| {max(totals):.0f} | {shown} |"
        )


if __name__ == "__main__":
    main()

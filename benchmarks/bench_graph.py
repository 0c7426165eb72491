"""Speed of whole graphs, every topic recorded.

reference_software: 1 Hz, one hour of scenario. reference: emulated receivers of 36 observations at
20 Hz and their drivers, SimGEN and the CAN thruster, with and without the relative navigation.

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
from dataclasses import dataclass

from vtff_bag.file.reader import BagReader
from vtff_node.plain_yaml import format_yaml, parse_yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]
SOFTWARE = ("reference_software",)
RECEIVERS = ("reference", f"gnss:={ROOT / 'config/gnss/benchmark.yaml'}")
ON_TRUTH = "relative_state:=relative_state_truth"


@dataclass(frozen=True)
class Mode:
    """One row of the table: how to run, and the real-time factor that is asked for."""

    name: str
    arguments: tuple[str, ...]
    target: int
    duration: float = 3600.0
    without: str = ""


MODES = (
    Mode("1 Hz, separate processes", (*SOFTWARE, "--distributed"), 400),
    Mode("1 Hz, composed", SOFTWARE, 1000),
    Mode("20 Hz receivers", (*RECEIVERS, ON_TRUTH), 60, 600.0, without="relative_ekf"),
    Mode("20 Hz receivers and navigation", RECEIVERS, 60, 600.0),
)


def yardstick() -> float:
    """Return the seconds that ten million additions take."""
    started = time.perf_counter()
    total = 0
    for number in range(10_000_000):
        total += number
    return time.perf_counter() - started


def system_without(node: str, folder: str) -> str:
    """Write the reference system without a node; return the path of the file."""
    path = ROOT / "config/system/reference.yaml"
    text = path.read_text().replace(": ../", f": {path.parents[1]}/")
    content = parse_yaml(text.replace("[../", f"[{path.parents[1]}/"))
    content["nodes"] = [entry for entry in content["nodes"] if entry["executable"] != node]
    changed = pathlib.Path(folder) / "system.yaml"
    changed.write_text(format_yaml(content))
    return str(changed)


def measure(mode: Mode, duration: float) -> tuple[float, float]:
    """Run once; return real-time factors of the stepping alone and of everything."""
    with tempfile.TemporaryDirectory() as folder:
        system, *arguments = mode.arguments
        if mode.without:
            system = system_without(mode.without, folder)
        command = [sys.executable, "-m", "vtff_bringup.cli", "run", system, *arguments]
        command += ["--no-report", "--out", f"{folder}/run", "--duration", str(duration)]
        started = time.perf_counter()
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        everything = duration / (time.perf_counter() - started)
        *_, last = BagReader(f"{folder}/run").messages("/sim/status")
        return float(last.message.real_time_factor), everything


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3, help="runs of each kind (%(default)s)")
    parser.add_argument("--duration", type=float, help="scenario seconds (3600 and 600)")
    parser.add_argument("--only", default="", help="modes with this in their name")
    options = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    print("| mode | target | best | median | with start and end | yardstick before each, s |")
    print("|---|---|---|---|---|---|")
    for mode in (mode for mode in MODES if options.only in mode.name):
        marks, factors, totals = [], [], []
        for _ in range(options.repeat):
            marks.append(yardstick())
            factor, total = measure(mode, options.duration or mode.duration)
            factors.append(factor)
            totals.append(total)
        shown = " ".join(f"{mark:.2f}" for mark in marks)
        print(
            f"| {mode.name} | {mode.target} | {max(factors):.0f} "
            f"| {statistics.median(factors):.0f} | {max(totals):.0f} | {shown} |",
            flush=True,
        )


if __name__ == "__main__":
    main()

"""Many short runs in a row: each must end soon after its last step, with its report.

    python benchmarks/bench_short_runs.py --count 200

Each run flies a few seconds of a system with all its processes. Its end is the time from the last
step in the bag, which is when the bag was last extended by it, to the end of the nodes; the report
that follows is not counted. The exit code is 1 if a run failed, was late or left no report.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time

LARGEST_END = 3.0  # s from the last step to the end of the last process


def fly(system: str, duration: float, folder: pathlib.Path) -> tuple[bool, float, str]:
    """Fly one run; return whether it is as it should be, s from its last step, and its output."""
    command = [sys.executable, "-m", "vtff_bringup.cli", "run", system]
    command += ["--duration", f"{duration:g}", "--out", str(folder)]
    began = time.monotonic()
    result = subprocess.run(command, capture_output=True, text=True, timeout=600)
    wall_time = time.monotonic() - began
    bridge = folder / "nodes" / "simgen_bridge.json"
    recorded = folder / "bag" / "metadata.yaml"
    if not bridge.is_file() or not recorded.is_file():
        return False, wall_time, result.stdout + result.stderr
    json.loads(bridge.read_text(encoding="utf-8"))
    # The node that ends the run writes its counts after the last step; the recorder ends last.
    end = recorded.stat().st_mtime - bridge.stat().st_mtime
    is_whole = result.returncode == 0 and (folder / "report" / "summary.json").is_file()
    return is_whole and end <= LARGEST_END, end, result.stdout + result.stderr


def main() -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10, help="number of runs (default: 10)")
    parser.add_argument("--duration", type=float, default=3.0, help="s of scenario (default: 3)")
    parser.add_argument("--system", default="reference", help="default: reference")
    given = parser.parse_args()
    ends: list[float] = []
    failed = 0
    with tempfile.TemporaryDirectory(prefix="short_runs_") as folder:
        for number in range(given.count):
            is_good, end, output = fly(
                given.system, given.duration, pathlib.Path(folder) / f"run_{number}"
            )
            ends.append(end)
            if not is_good:
                failed += 1
                print(f"run {number}: {end:.1f} s after the last step\n{output}", flush=True)
    ends.sort()
    print(
        f"{given.count} runs, {failed} failed, late or without report; from the last step to the "
        f"end: median {ends[len(ends) // 2]:.2f} s, largest {ends[-1]:.2f} s"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

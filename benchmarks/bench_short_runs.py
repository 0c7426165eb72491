"""Many short runs in a row: each must end soon after its last step, with its report.

    python benchmarks/bench_short_runs.py --count 200

Each run flies a few seconds of a system with all its processes. Its end is the time from the last
step to the end of the recorder, which ends last. The report that follows counts in the time to the
prompt alone. The exit code is 1 if a run failed, was late or left no report.
"""

from __future__ import annotations

import argparse
import dataclasses
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

LARGEST_END = 3.0  # s from the last step to the end of the last process


@dataclasses.dataclass(frozen=True)
class Flight:
    """One run: whether it is as it should be, and what it printed.

    ``end`` and ``prompt`` are s from the last step to the end of the recorder and of the command.
    """

    is_good: bool
    end: float
    prompt: float
    output: str


def fly(system: str, duration: float, folder: pathlib.Path) -> Flight:
    """Fly one run."""
    command = [sys.executable, "-m", "vtff_bringup.cli", "run", system]
    command += ["--duration", f"{duration:g}", "--out", str(folder)]
    began = time.time()
    result = subprocess.run(command, capture_output=True, text=True, timeout=600)
    ended = time.time()
    output = result.stdout + result.stderr
    bridge = folder / "nodes" / "simgen_bridge.json"
    recorded = folder / "bag" / "metadata.yaml"
    if not bridge.is_file() or not recorded.is_file():
        return Flight(False, ended - began, ended - began, output)
    # The node that ends the run writes its counts after the last step.
    last_step = bridge.stat().st_mtime
    end = recorded.stat().st_mtime - last_step
    is_whole = result.returncode == 0 and (folder / "report" / "summary.json").is_file()
    return Flight(is_whole and end <= LARGEST_END, end, ended - last_step, output)


def main() -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10, help="number of runs (default: 10)")
    parser.add_argument("--duration", type=float, default=3.0, help="s of scenario (default: 3)")
    parser.add_argument("--system", default="reference", help="default: reference")
    given = parser.parse_args()
    flights: list[Flight] = []
    with tempfile.TemporaryDirectory(prefix="short_runs_") as folder:
        for number in range(given.count):
            path = pathlib.Path(folder) / f"run_{number}"
            flight = fly(given.system, given.duration, path)
            shutil.rmtree(path, ignore_errors=True)
            flights.append(flight)
            if not flight.is_good:
                print(
                    f"run {number}: {flight.end:.1f} s after the last step\n{flight.output}",
                    flush=True,
                )
    failed = sum(not flight.is_good for flight in flights)
    print(f"{given.count} runs, {failed} failed, late or without report; from the last step")
    for what, times in (
        ("to the end of the recorder", sorted(flight.end for flight in flights)),
        ("to the prompt", sorted(flight.prompt for flight in flights)),
    ):
        print(f"  {what}: median {times[len(times) // 2]:.2f} s, largest {times[-1]:.2f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

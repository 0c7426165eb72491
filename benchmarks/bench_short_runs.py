"""Many short runs in a row: each must end soon after its last step, with its report.

    python benchmarks/bench_short_runs.py --count 200

Each run flies a few seconds of a system with all its processes. Its end is the time from the last
step to the end of the recorder, which ends last. The report that follows counts in the time to the
prompt alone. A process of the run that still exists at the prompt is an orphan. The exit code is 1
if a run failed, was late, left no report or an orphan, or printed a traceback.
"""

from __future__ import annotations

import argparse
import collections
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
    """One run and what was wrong with it.

    ``end`` and ``prompt`` are s from the last step to the end of the recorder and of the command.
    """

    faults: tuple[str, ...]
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
    faults = {
        "failed": result.returncode != 0,
        "without report": not (folder / "report" / "summary.json").is_file(),
        "with orphans": bool(processes_of(folder)),
        "with a traceback": "Traceback" in output,
    }
    end = prompt = ended - began
    if bridge.is_file() and recorded.is_file():
        # The node that ends the run writes its counts after the last step.
        last_step = bridge.stat().st_mtime
        end, prompt = recorded.stat().st_mtime - last_step, ended - last_step
    faults["late"] = end > LARGEST_END
    return Flight(tuple(name for name, is_so in faults.items() if is_so), end, prompt, output)


def processes_of(folder: pathlib.Path) -> list[int]:
    """Return the processes whose command line names a folder."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if str(folder).encode() + b"/" in path.read_bytes():
                found.append(int(path.parent.name))
        except OSError:  # it has ended meanwhile
            continue
    return found


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
            if flight.faults:
                what = ", ".join(flight.faults)
                print(f"run {number}: {what}, {flight.end:.1f} s\n{flight.output}", flush=True)
    print(f"{given.count} runs of {given.duration:g} s of {given.system}")
    counts = collections.Counter(fault for flight in flights for fault in flight.faults)
    for fault in ("failed", "late", "without report", "with orphans", "with a traceback"):
        print(f"  {fault}: {counts[fault]}")
    for what, times in (
        ("to the end of the recorder", sorted(flight.end for flight in flights)),
        ("to the prompt", sorted(flight.prompt for flight in flights)),
    ):
        median, largest = times[len(times) // 2], times[-1]
        print(f"  from the last step {what}: median {median:.2f} s, largest {largest:.2f} s")
    return 1 if counts else 0


if __name__ == "__main__":
    sys.exit(main())

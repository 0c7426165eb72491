"""Cost of formations of 2, 4, 8 and 16 spacecraft in the software loop, composed.

The time is processor time of the process that holds all nodes but the recorder, per second of
scenario, without what it takes to start: the difference of a long and a short run. The speed is
that of the long run on the wall clock, from first to last step. The cost of a spacecraft more
should not depend on how many there are.

    python benchmarks/bench_formation.py [--duration 400] [--spacecraft 2 4 8 16]
"""

from __future__ import annotations

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

SYSTEM = "formation_software"
SHORT = 50  # s of scenario; what a run takes to start cancels in the difference


def fly(spacecraft: int, duration: int, folder: str) -> tuple[float, float]:
    """Fly a formation; return processor time of its nodes (s) and real-time factor."""
    out = pathlib.Path(folder) / f"{spacecraft}_{duration}"
    arguments = [SYSTEM, f"number_of_deputies:={spacecraft - 1}"]
    command = ["vtff", "run", *arguments, "--duration", str(duration), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    record = json.loads((out / "nodes" / "simgen_bridge.json").read_text(encoding="utf-8"))
    summary = json.loads((out / "report" / "summary.json").read_text(encoding="utf-8"))
    return record["process_cpu_time_s"], summary["real_time_factor"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=int, default=400, help="s of scenario (%(default)s)")
    parser.add_argument("--spacecraft", type=int, nargs="+", default=[2, 4, 8, 16])
    options = parser.parse_args()
    if min(options.spacecraft) < 2 or options.duration <= SHORT:
        parser.error(f"2 spacecraft or more and a duration of more than {SHORT} s expected")
    print("spacecraft   ms processor per s   a spacecraft   x real time")
    costs = []
    with tempfile.TemporaryDirectory() as folder:
        for spacecraft in options.spacecraft:
            short, _ = fly(spacecraft, SHORT, folder)
            long, speed = fly(spacecraft, options.duration, folder)
            cost = 1e3 * (long - short) / (options.duration - SHORT)
            costs.append(cost)
            share = cost / spacecraft
            print(f"{spacecraft:10d} {cost:20.2f} {share:14.2f} {speed:13.0f}", flush=True)
    if len(costs) > 1:
        slopes = np.diff(costs) / np.diff(options.spacecraft)
        print(
            f"a spacecraft more: {', '.join(f'{slope:.2f}' for slope in slopes)} ms; "
            f"largest over smallest {slopes.max() / slopes.min():.2f}"
        )


if __name__ == "__main__":
    main()

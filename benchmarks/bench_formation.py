"""Cost of formations of 2, 4, 8 and 16 spacecraft, in the software loop or with receivers.

The time is processor time of the process that holds all nodes but the recorder, per second of
scenario, without what it takes to start: the difference of a long and a short run. All fly equally
long, because an approach costs more than keeping. Virtual machines change their speed within
minutes: a fixed calculation before and after each run tells how fast it was, and all times are
those of the fastest. The median of some rounds is taken. The speed is that of the fastest long run
on the wall clock, from first to last step. The cost of a spacecraft more should not depend on how
many there are.

With --receivers each spacecraft has an emulated receiver at 20 Hz, each deputy a filter and a
thruster on a bus (`reference` with the spacecraft of config/scenario/train.yaml), and the processor
time is that of all processes; resident memory is that of each process at a quarter, at half and at
the end of the flight.

    python benchmarks/bench_formation.py [--duration 2000] [--rounds 3] [--spacecraft 2 4 8 16]
    python benchmarks/bench_formation.py --receivers --duration 600 --spacecraft 2 4 8
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

import numpy as np
from bench_stages import fly as fly_processes
from tables import add_write_option, write_rows

from vtff_node.plain_yaml import format_yaml, parse_yaml

SYSTEM = "formation_software"
CONFIG = pathlib.Path(__file__).resolve().parents[1] / "config"
SHORT = 50  # s of scenario; what a run takes to start cancels in the difference

COLUMNS = ("spacecraft", "processor of a second, ms", "a spacecraft, ms", "times real time")
"""Columns of the rows that are kept."""


def fixed_calculation() -> float:
    """Return the processor time of a calculation that is always the same, s."""
    vector, total = np.arange(3.0), 0.0
    start = time.process_time()
    for _ in range(200_000):
        total += float(vector @ vector)
    return time.process_time() - start


def fly(spacecraft: int, duration: int) -> tuple[float, float]:
    """Fly a formation; return processor time in units of `fixed_calculation`, real-time factor."""
    unit = fixed_calculation()
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "run"
        arguments = [SYSTEM, f"number_of_deputies:={spacecraft - 1}"]
        command = ["vtff", "run", *arguments, "--duration", str(duration), "--out", str(out)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stdout + done.stderr)
        record = json.loads((out / "nodes" / "simgen_bridge.json").read_text(encoding="utf-8"))
        summary = json.loads((out / "report" / "summary.json").read_text(encoding="utf-8"))
    unit = 0.5 * (unit + fixed_calculation())
    return record["process_cpu_time_s"] / unit, summary["real_time_factor"]


def systems_with_receivers(spacecraft: int, folder: pathlib.Path) -> list[str]:
    """Write the files of a formation with receivers; return the arguments of `vtff run`."""
    train = parse_yaml((CONFIG / "scenario/train.yaml").read_text(encoding="utf-8"))
    train["spacecraft"][1]["repeat"] = spacecraft - 1
    shutil.copy(CONFIG / "gnss/reference.yaml", folder)
    names = ["chief", *(f"deputy_{number}" for number in range(1, spacecraft))]
    receivers = [
        {"name": name, "vehicle": f"v{number}_m1"} for number, name in enumerate(names, start=1)
    ]
    gnss = {"extends": "reference.yaml", "name": "train", "receivers": receivers}
    for name, content in (("train", train), ("receivers", gnss)):
        text = format_yaml(content)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return [f"scenario:={folder}/train.yaml", f"gnss:={folder}/receivers.yaml"]


def fly_with_receivers(spacecraft: int, duration: int) -> tuple[float, float, list[str]]:
    """Fly a formation with receivers.

    Returns
    -------
    tuple of float, float, list of str
        Processor time of all processes in units of `fixed_calculation`, real-time factor (NaN: it
        is not looked at), and lines with the memory of each process.
    """
    unit = fixed_calculation()
    memory: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as name:
        arguments = systems_with_receivers(spacecraft, pathlib.Path(name))
        times = fly_processes("vtff", arguments, duration, memory)
    unit = 0.5 * (unit + fixed_calculation())
    used = sum(user + system for user, system in times.values())
    return used / unit, math.nan, describe_memory(memory)


def describe_memory(samples: list[dict[str, float]]) -> list[str]:
    """Return a line for each process of a run: its memory at a quarter, half and the end of it.

    Processes that have been there for less than half of the samples are left out.
    """
    lines = []
    for name in sorted({name for sample in samples for name in sample}):
        sizes = [sample[name] for sample in samples if name in sample]
        if len(sizes) >= 0.5 * len(samples):
            quarter, half, end = (sizes[int(part * (len(sizes) - 1))] for part in (0.25, 0.5, 0.97))
            lines.append(f"  {name}: {quarter:.1f}, {half:.1f}, {end:.1f} MB")
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=int, default=2000, help="s of scenario (%(default)s)")
    parser.add_argument("--rounds", type=int, default=3, help="of all formations (%(default)s)")
    parser.add_argument("--spacecraft", type=int, nargs="+", default=[2, 4, 8, 16])
    parser.add_argument("--receivers", action="store_true", help="with receivers at 20 Hz")
    add_write_option(parser, "formation")
    options = parser.parse_args()
    if options.write and options.receivers:
        parser.error("--write: rows without receivers alone are kept")
    if min(options.spacecraft) < 2 or options.duration <= SHORT or options.rounds < 1:
        parser.error(
            f"2 spacecraft or more, a duration of more than {SHORT} s and a round or more expected"
        )
    fastest = min(fixed_calculation() for _ in range(10))
    flown: list[dict[int, tuple[float, float, float]]] = []
    for _ in range(options.rounds):
        flown.append({})
        for number in options.spacecraft:
            lines: list[str] = []
            if options.receivers:
                short = fly_with_receivers(number, SHORT)[0]
                long, speed, lines = fly_with_receivers(number, options.duration)
            else:
                short, _ = fly(number, SHORT)
                long, speed = fly(number, options.duration)
            flown[-1][number] = short, long, speed
            print(
                f"round {len(flown)}, {number} spacecraft: {fastest * (long - short):.2f} s of "
                f"processor" + (f", {speed:.0f} x real time" if math.isfinite(speed) else ""),
                *lines,
                sep="\n",
                flush=True,
            )
    print(
        "spacecraft   ms processor per s   a spacecraft"
        + ("" if options.receivers else "   x real time")
    )
    costs, rows = [], []
    for number in options.spacecraft:
        units = float(np.median([one[number][1] - one[number][0] for one in flown]))
        speed = max(one[number][2] for one in flown)
        costs.append(1e3 * fastest * units / (options.duration - SHORT))
        print(
            f"{number:10d} {costs[-1]:20.2f} {costs[-1] / number:14.2f}"
            + (f" {speed:13.0f}" if math.isfinite(speed) else "")
        )
        rows.append([str(number), f"{costs[-1]:.2f}", f"{costs[-1] / number:.2f}", f"{speed:.0f}"])
    if options.write:
        write_rows("formation", COLUMNS, rows, "1")
    if len(costs) > 1:
        slopes = np.diff(costs) / np.diff(options.spacecraft)
        print(
            f"a spacecraft more: {', '.join(f'{slope:.2f}' for slope in slopes)} ms; "
            f"largest over smallest {slopes.max() / slopes.min():.2f}"
        )


if __name__ == "__main__":
    main()

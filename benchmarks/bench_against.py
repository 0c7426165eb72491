"""`reference` and the software loops, beside another checkout: processor time and speed, in turn.

Both fly without `formation_safety`, which commit 0ab621d does not have::

    python benchmarks/bench_against.py --base ../base/.venv/bin/vtff [--rounds 3] [--long 1200]

Of `reference` a short and a long run give the processor time of a scenario second, of all
processes; the speed is that of the flight, without start and end. Where other work disturbs, only
the processor time means anything.
"""

from __future__ import annotations

import argparse
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
from typing import NamedTuple

from tables import add_write_option, write_rows

from vtff_node.plain_yaml import format_yaml, parse_yaml

ROOT = pathlib.Path(__file__).resolve().parents[1]
SYSTEMS = ROOT / "src/vtff_bringup/config/system"
COLUMNS = ("figure", "commit 0ab621d", "vtff", "ratio", "aim")
"""Columns of the rows that are kept."""
SHORT, LONG = 40.0, 240.0  # s of scenario


class Mode(NamedTuple):
    """A way to fly: system, arguments of this checkout and of the base, runs and what must be."""

    name: str
    system: str
    arguments: tuple[str, ...]
    arguments_of_base: tuple[str, ...]
    durations: tuple[float, ...]
    wanted: str
    rows: tuple[tuple[str, str], tuple[str, str]]
    """Names and aims of the rows that are kept: processor time and speed; empty: not kept."""


MODES = (
    Mode(
        "reference",
        "reference",
        (),
        (),
        (SHORT, LONG),
        "<= 0.40 of the processor, >= 2.5 x faster",
        (
            ("`reference`, processor of a scenario second, all processes, ms", "0.40"),
            ("`reference`, times real time of the flight", "2.5"),
        ),
    ),
    Mode(
        "one process",
        "reference_software",
        (),
        ("--composed",),
        (40000.0,),
        ">= 2 x faster",
        (("", ""), ("software loop in one process, times real time, 40 000 s", "2")),
    ),
    Mode(
        "a process for each node",
        "reference_software",
        ("--distributed",),
        (),
        (10000.0,),
        ">= 1.7 x faster",
        (
            ("", ""),
            ("software loop, a process for each node, times real time, 10 000 s", "1.7"),
        ),
    ),
)


class Flight(NamedTuple):
    """Processor time of a run with start and end, s, and times real time of its flight.

    A flight that ends before its first line of progress has no speed, NaN.
    """

    processor: float
    speed: float


def without_safety(folder: str) -> str:
    """Write the reference system without its monitor; return the path of the file."""
    text = (SYSTEMS / "reference.yaml").read_text()
    place = SYSTEMS.parent
    content = parse_yaml(text.replace(": ../", f": {place}/").replace("- ../", f"- {place}/"))
    nodes = [node for node in content["nodes"] if node["executable"] != "formation_safety"]
    for node in nodes:
        files = node.get("parameter_files", [])
        node["parameter_files"] = [file.replace("../", f"{place}/") for file in files]
        if node["executable"] == "thruster_can":
            del node["remaps"]
    path = pathlib.Path(folder) / "reference.yaml"
    path.write_text(format_yaml({**content, "nodes": nodes}))
    return str(path)


def fly(vtff: str, system: str, arguments: tuple[str, ...], duration: float) -> Flight:
    """Run once and return what it took."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(pathlib.Path(vtff).absolute()), "run", system, *arguments, "--no-report"]
        command += ["--duration", str(duration), "--out", f"{folder}/run"]
        # In its own checkout, whose environment the command sets itself.
        plain = {name: os.environ[name] for name in ("HOME", "PATH") if name in os.environ}
        checkout = pathlib.Path(vtff).absolute().parents[2]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=checkout, env=plain
        )
        assert process.stdout is not None
        speeds = re.findall(r"/ \d+ s +(\d+) x real time", process.stdout.read())
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if status:
            sys.exit(f"{' '.join(command)} failed")
        return Flight(usage.ru_utime + usage.ru_stime, float(speeds[-1]) if speeds else math.nan)


def measure(
    vtff: str, system: str, arguments: tuple[str, ...], durations: tuple[float, ...]
) -> tuple[float, float]:
    """Return the processor time of a second, ms (with start and end for one run), and the speed."""
    flights = [fly(vtff, system, arguments, duration) for duration in durations]
    if len(flights) == 1:
        return 1e3 * flights[0].processor / durations[0], flights[0].speed
    processor = flights[1].processor - flights[0].processor
    return 1e3 * processor / (durations[1] - durations[0]), flights[1].speed


def result_rows(mode: Mode, flights: list[list[tuple[float, float]]]) -> list[list[str]]:
    """Return the rows of a mode: processor time where it is wanted, and speed."""
    rows = []
    for place, (name, wanted) in enumerate(mode.rows):
        if name:
            base, own = ([flight[side][place] for flight in flights] for side in (0, 1))
            ratios = [after / before for before, after in zip(base, own, strict=True)]
            digits = 1 - place
            rows.append(
                [
                    name,
                    ", ".join(f"{value:.{digits}f}" for value in base),
                    ", ".join(f"{value:.{digits}f}" for value in own),
                    ", ".join(f"{value:.2f}" for value in ratios),
                    wanted,
                ]
            )
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--base", help="vtff command of the other checkout")
    parser.add_argument("--vtff", default=str(ROOT / ".venv/bin/vtff"), help="%(default)s")
    parser.add_argument("--only", default="", help="modes with this in their name")
    parser.add_argument("--rounds", type=int, default=3, help="(%(default)s)")
    parser.add_argument(
        "--long", type=float, default=LONG, help="s of the long run of reference (%(default)s)"
    )
    add_write_option(parser, "speed")
    options = parser.parse_args()
    if options.write and options.base is None:
        parser.error("--write: --base expected")
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        own = {"reference": without_safety(folder)}
        for mode in (mode for mode in MODES if options.only in mode.name):
            ratios, flights = [], []
            longest = options.long if mode.name == "reference" else mode.durations[-1]
            for _ in range(options.rounds):
                line = mode.name
                found = [
                    measure(vtff, system, arguments, (*mode.durations[:-1], longest))
                    for vtff, system, arguments in (
                        (options.base, mode.system, mode.arguments_of_base),
                        (options.vtff, own.get(mode.system, mode.system), mode.arguments),
                    )
                    if vtff is not None
                ]
                for name, (processor, speed) in zip(
                    ("base", "now")[-len(found) :], found, strict=True
                ):
                    line += f"; {name} {processor:.2f} ms a second, {speed:.0f} x"
                if len(found) == 2:
                    flights.append(found)
                    ratios.append((found[1][0] / found[0][0], found[1][1] / found[0][1]))
                    line += "; ratio {:.2f}, {:.2f}".format(*ratios[-1])
                print(line, flush=True)
            if ratios:
                processor, speed = (
                    statistics.median(column) for column in zip(*ratios, strict=True)
                )
                print(f"{mode.name}: medians {processor:.2f}, {speed:.2f}; must be {mode.wanted}")
                rows += result_rows(mode, flights)
        if options.write:
            write_rows("speed", COLUMNS, rows, "1")


if __name__ == "__main__":
    main()

"""Latency of commands in real time: from the last byte of a second to the command on its bus.

Flies `reference` with emulated hardware in real time, or takes recorded runs. The compute time is
that of the filter alone, which tells how fast the machine was.
"""

from __future__ import annotations

import argparse
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from tables import add_write_option, write_rows

from vtff_analysis.recordings.recording_details import DetailCollector
from vtff_bag.file.reader import BagReader
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC

ROOT = pathlib.Path(__file__).resolve().parents[1]
COMPUTE_TIME = "compute time of the last epoch"


COLUMNS = ("figure", "commit 0ab621d", "vtff", "ratio", "aim")
"""Columns of the row that is kept: median, and 99 % without the first second, ms."""
ROW = "`reference --realtime`, last byte of a second to the command on its bus"


def report(run: str) -> list[str]:
    """Print the lines of a run; return the row that is kept, of the last thruster."""
    details = DetailCollector()
    handler = details.handler(DIAGNOSTICS_TOPIC)
    assert handler is not None
    compute = []
    for item in BagReader(run).messages(DIAGNOSTICS_TOPIC):
        handler(item.message)
        compute += [
            1e3 * float(pair.value)
            for status in item.message.status
            for pair in status.values
            if pair.key == COMPUTE_TIME
        ]
    row: list[str] = []
    for thruster, latency in details.command_latency().items():
        for name, values in (("all", latency), ("without the first second", latency[1:])):
            median, most, nearly_all = 1e3 * np.percentile(values, [50.0, 90.0, 99.0])
            print(
                f"| {thruster} | {name} | {len(values)} | {median:.1f} | {most:.1f} "
                f"| {nearly_all:.1f} | {1e3 * values.max():.1f} | {np.median(compute):.1f} |"
            )
        row = [ROW, "-", f"{median:.1f}, {nearly_all:.1f} ms", "-", "10 ms at 99 %"]
    return row


def main() -> None:
    """Fly where no run is given, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", help="runs that were recorded with --realtime")
    parser.add_argument("--duration", type=float, default=120.0, help="s (%(default)s)")
    add_write_option(parser, "speed")
    options = parser.parse_args()
    rows = []
    print("| thruster | seconds | number | median, ms | 90 % | 99 % | largest | filter epoch |")
    print("|---|---|---|---|---|---|---|---|")
    for run in options.runs:
        rows = [report(run)]
    if not options.runs:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "vtff_bringup.cli", "run", "reference", "--realtime"]
            command += [
                "--duration",
                str(options.duration),
                "--no-report",
                "--out",
                f"{folder}/run",
            ]
            subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
            rows = [report(f"{folder}/run")]
    if options.write:
        write_rows("speed", COLUMNS, rows, "1")


if __name__ == "__main__":
    main()

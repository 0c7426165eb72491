"""Speed of the ionosphere chain: two receivers at 20 Hz, online and from a bag.

Without --bag the scenario of equatorial spread F is flown first, which takes a while. Aims: an
hour from a bag within 20 s; online at most 20 % of a core. Processor time tells what the work
costs, also when the machine has other work; the yardstick (processor seconds for ten million
additions in Python) tells how fast the machine is just now.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it; as the vtff command does.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})
ROOT = pathlib.Path(__file__).resolve().parents[1]
# The input of the processor is read back by a module of the tests.
sys.path.insert(0, str(ROOT / "test"))

from formation_recording import formation_seconds  # noqa: E402

from vtff_bag.file.reader import BagReader  # noqa: E402
from vtff_bringup.run.runner import NODE_RECORDS  # noqa: E402
from vtff_iono.formation_ionosphere import FormationIonosphere  # noqa: E402

VTFF = (sys.executable, "-m", "vtff_bringup.cli")


@dataclass(frozen=True)
class Cost:
    """Seconds of work, of the wall clock and of the processor."""

    wall: float
    processor: float


def measured(work: Callable[[], object]) -> Cost:
    """Return what a call costs, in this process and in those that it starts."""
    wall, processor = time.perf_counter(), _processor_time()
    work()
    return Cost(time.perf_counter() - wall, _processor_time() - processor)


def _processor_time() -> float:
    usage = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(part.ru_utime + part.ru_stime for part in usage)


def yardstick() -> float:
    """Return the processor seconds that ten million additions take."""

    def add() -> None:
        total = 0
        for number in range(10_000_000):
            total += number

    return measured(add).processor


def process_recording(bag: str) -> int:
    """Read a bag, process it many seconds at a time and return the number of seconds."""
    return sum(
        1 for _ in FormationIonosphere().process_recording(formation_seconds(BagReader(bag)))
    )


def process_seconds(bag: str) -> float:
    """Read a bag, process its seconds one by one and return the processor time of that, s."""
    ionosphere, total = FormationIonosphere(), 0.0
    for ephemerides, second in formation_seconds(BagReader(bag)):
        started = time.process_time()
        for ephemeris in ephemerides:
            ionosphere.add_ephemeris(ephemeris)
        ionosphere.process(second)
        total += time.process_time() - started
    return total


def report(bag: str, folder: str) -> None:
    """Measure and print."""
    # Compiled loops are loaded, and compiled if need be, outside of the measurement.
    _, first = next(iter(formation_seconds(BagReader(bag))))
    FormationIonosphere().process(first)
    times = [second.time for _, second in formation_seconds(BagReader(bag))]
    duration = 1e-9 * (times[-1] - times[0])
    command = [*VTFF, "tec", bag, "--format", "parquet", "--out", f"{folder}/tec"]
    works: tuple[tuple[str, Callable[[], object]], ...] = (
        ("reading the bag", lambda: list(formation_seconds(BagReader(bag)))),
        ("reading and the whole chain", lambda: process_recording(bag)),
        ("vtff tec, two processes, start and plots included", lambda: subprocess.run(
            command, check=True, capture_output=True, cwd=ROOT)),
    )  # fmt: skip
    print(f"{duration:.0f} s of two receivers")
    print("| work | wall, s | processor, s | times real time | yardstick, s |")
    print("|---|---|---|---|---|")
    for name, work in works:
        mark = yardstick()
        cost = measured(work)
        factor = duration / cost.wall
        # The workers of vtff tec are nobody's children whose time could be asked for.
        processor = "" if name.startswith("vtff tec") else f"{cost.processor:.1f}"
        print(f"| {name} | {cost.wall:.1f} | {processor} | {factor:.0f} | {mark:.2f} |")
    mark = yardstick()
    share = 100.0 * process_seconds(bag) / duration
    print(f"algorithms, second by second: {share:.1f} % of a core (yardstick {mark:.2f} s)")
    record = pathlib.Path(bag) / NODE_RECORDS / "ionosphere_processor.json"
    if record.is_file():
        processor = json.loads(record.read_text(encoding="utf-8"))["process_cpu_time_s"]
        share = 100.0 * processor / duration
        print(f"the node when this was recorded, messages and start included: {share:.1f} %")


def main() -> None:
    """Take or make a bag, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bag", help="run folder or bag of two receivers at 20 Hz")
    parser.add_argument("--duration", type=float, default=600.0, help="of the run, s (%(default)s)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bag = options.bag or f"{folder}/run"
        if options.bag is None:
            command = [*VTFF, "run", "esf", "--no-report", "--out", bag]
            command += ["--duration", str(options.duration)]
            subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
        report(bag, folder)


if __name__ == "__main__":
    main()

"""Where the processor time of one scenario second of `reference` goes, by process and by stage.

Processes: a short and a long run; user and system time of each process, read from /proc until it
ends. The difference of the two runs is what a second costs, the rest of the short run is start and
end. `--vtff` measures another checkout, `--distributed` a process for each node.

Stages: the same work in this process alone, best of several, so without ROS, without the other
processes that empty the caches, and without the wake-ups between them. What a process needs beyond
its stages are pseudo-terminal, DDS, executor and cold caches.

    python benchmarks/bench_stages.py [--seconds 50 350] [--vtff ../old/.venv/bin/vtff]
"""

from __future__ import annotations

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})

REPOSITORY = pathlib.Path(__file__).resolve().parents[1]
LOGS = (
    b"LOG RANGEB ONTIME 0.05\r\nLOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n"
    b"LOG GPSEPHEMB ONCHANGED\r\nLOG GALINAVEPHEMERISB ONCHANGED\r\n"
)
TICK = 1.0 / os.sysconf("SC_CLK_TCK")
SAMPLE_INTERVAL = 0.05  # s
STAGE_SECONDS = 90  # of scenario
SETTLED = 30  # s of scenario after which the filter has all its states
REPEATS = 3

Times = dict[str, tuple[float, float]]


def processes() -> dict[int, tuple[int, float, float]]:
    """Return parent, user and system time (s) of every process of the machine."""
    found = {}
    for folder in pathlib.Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                text = (folder / "stat").read_text()
            except OSError:
                continue
            fields = text[text.rindex(")") + 2 :].split()
            found[int(folder.name)] = (
                int(fields[1]),
                int(fields[11]) * TICK,
                int(fields[12]) * TICK,
            )
    return found


def name_of(process: int) -> str:
    """Return namespace and executable of a process; empty if it has none that matters."""
    try:
        words = pathlib.Path(f"/proc/{process}/cmdline").read_text().split("\0")
    except OSError:
        return ""
    namespace = next((word.partition(":=")[2] for word in words if word.startswith("__ns:=")), "")
    programs = [pathlib.Path(word).name for word in words[:3] if not word.startswith("-")]
    names = [name for name in programs if name and not name.startswith("python")]
    return f"{namespace.rstrip('/')}/{names[0]}" if names and namespace else "".join(names[:1])


def resident_memory(process: int) -> float:
    """Return the resident memory of a process, MB; zero if it has ended."""
    try:
        pages = int(pathlib.Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def fly(
    vtff: str, arguments: list[str], seconds: int, memory: list[dict[str, float]] | None = None
) -> Times:
    """Fly a run; return user and system time of its processes, s.

    `memory` takes the resident memory of the processes, MB by name, some times a second.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [vtff, "run", "reference", *arguments, "--no-report"]
        command += ["--duration", str(seconds), "--out", f"{folder}/run"]
        used: dict[int, tuple[str, float, float]] = {}
        with open(f"{folder}/output", "wb") as output:
            run = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
            while run.poll() is None:
                running = processes()
                family = {run.pid}
                while (
                    more := {p for p, (parent, _, _) in running.items() if parent in family}
                    - family
                ):
                    family |= more
                for process in family & running.keys():
                    name = name_of(process) or used.get(process, ("",))[0]
                    used[process] = (name, *running[process][1:])
                if memory is not None:
                    memory.append({used[p][0]: resident_memory(p) for p in family & used.keys()})
                time.sleep(SAMPLE_INTERVAL)
        if run.returncode:
            sys.exit(pathlib.Path(f"{folder}/output").read_text())
    times: Times = {}
    for name, user, system in used.values():
        before = times.get(name, (0.0, 0.0))
        times[name] = (before[0] + user, before[1] + system)
    return times


def print_processes(vtff: str, arguments: list[str], short: int, long: int) -> None:
    """Print what each process needs."""
    first, second = fly(vtff, arguments, short), fly(vtff, arguments, long)
    span = long - short
    print("| process | user | system | ms for a second | start and end, s |")
    print("|---|---|---|---|---|")
    rows = []
    for name, times in second.items():
        begun = first.get(name, (0.0, 0.0))
        user, system = (1e3 * (a - b) / span for a, b in zip(times, begun, strict=True))
        rows.append((name, user, system, sum(begun) - 1e-3 * (user + system) * short))
    rows.sort(key=lambda row: -row[1] - row[2])
    rows.append(("all", *(sum(row[k] for row in rows) for k in (1, 2, 3))))  # type: ignore[arg-type]
    for name, user, system, rest in rows:
        if user + system + rest > 0.1:
            print(f"| {name} | {user:.2f} | {system:.2f} | {user + system:.2f} | {rest:.2f} |")


def best(work: Callable[[], object]) -> float:
    """Return the least processor time of a piece of work, ms for a scenario second."""
    times = []
    for _ in range(REPEATS):
        begun = time.process_time()
        work()
        times.append(time.process_time() - begun)
    return 1e3 * min(times) / STAGE_SECONDS


def print_stages() -> None:
    """Print what the stages need."""
    sys.path.insert(0, str(REPOSITORY / "src" / "vtff_sim_bridge" / "test"))
    import gnss_emulator_support as support
    import numpy as np
    from rclpy.serialization import serialize_message

    from vtff_bag.file.writer import BagWriter
    from vtff_gnss.ephemeris import BroadcastEphemeris
    from vtff_gnss.novatel import Event, ReceiverLogStream
    from vtff_gnss.observations import ObservationEpoch
    from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
    from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
    from vtff_node.conversions.gnss import observations_to_message

    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], STAGE_SECONDS)
    run = support.Run(support.configuration("reference"), motions, LOGS)
    marks: list[float] = []
    run.all(lambda _second: marks.append(time.process_time()))
    emulate = 1e3 * float(np.percentile(np.diff(marks[1:]), 5.0))
    contents = [bytes(run.content[name]) for name in ("chief", "deputy")]

    def decode() -> list[list[Event]]:
        decoded = []
        for content in contents:
            stream = ReceiverLogStream()
            size = -(-len(content) // STAGE_SECONDS)  # a second at a time, as in lockstep
            chunks = (content[k : k + size] for k in range(0, len(content), size))
            decoded.append([event for chunk in chunks for event in stream.feed(chunk)])
        return decoded

    events = decode()
    epochs = [[e for e in of_one if isinstance(e, ObservationEpoch)] for of_one in events]

    def serialise() -> list[bytes]:
        return [
            serialize_message(observations_to_message(epoch, "antenna"))
            for of_one in epochs
            for epoch in of_one
        ]

    messages = serialise()

    def record() -> None:
        with tempfile.TemporaryDirectory() as folder, BagWriter(f"{folder}/bag") as writer:
            topic = writer.add_topic("/chief/gnss/high_rate", "vtff_msgs/msg/GnssObservations")
            for message in messages:
                writer.write(topic, message, 0)

    ephemerides = [e for e in events[0] if isinstance(e, BroadcastEphemeris)]
    estimator = CdgpsEstimator(CdgpsConfiguration(), ephemerides)
    whole = [[e for e in of_one if e.time.time_of_week % 1.0 == 0.0] for of_one in epochs]
    times = []
    for chief, deputy in zip(*whole, strict=True):
        begun = time.process_time()
        estimator.process(chief.time, chief, deputy)
        times.append(time.process_time() - begun)

    print("| stage, alone and in warm caches | ms for a second |")
    print("|---|---|")
    for stage, cost in (
        ("emulate and encode two receivers", emulate),
        ("decode two receivers", best(decode)),
        ("serialise 40 observations", best(serialise)),
        ("estimate: carrier-phase filter", 1e3 * float(np.percentile(times[SETTLED:], 5.0))),
        ("write 40 observations to the bag", best(record)),
    ):
        print(f"| {stage} | {cost:.2f} |")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=int, nargs=2, default=[50, 350], metavar="S")
    parser.add_argument("--vtff", default="vtff", help="command of the checkout to measure")
    parser.add_argument("--distributed", action="store_true", help="a process for each node")
    parser.add_argument("--only", choices=("processes", "stages"))
    options = parser.parse_args()
    short, long = options.seconds
    if not 0 < short < long:
        parser.error("--seconds: two durations expected, the shorter first")
    if options.only != "stages":
        print_processes(options.vtff, ["--distributed"] * options.distributed, short, long)
    if options.only != "processes":
        print_stages()


if __name__ == "__main__":
    main()

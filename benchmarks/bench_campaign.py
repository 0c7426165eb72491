"""Speed of campaigns: cases without ROS, beside a bare run, and what the scheduler can hand out.

Run with the workspace environment on an idle machine:

``python benchmarks/bench_campaign.py``            all but the long one (5 minutes)
``python benchmarks/bench_campaign.py library``    cases of 1 h without ROS, 1 and 2 workers
``python benchmarks/bench_campaign.py run``        cases of `vtff run` beside bare runs
``python benchmarks/bench_campaign.py scheduler``  cases that do nothing, and cases that sleep on
                                                   1000 threads: a large cluster without its work
``python benchmarks/bench_campaign.py thousand``   1000 cases of 1 h, memory, and the table
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import pathlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any

import distributed
import psutil

from vtff_bringup.campaign.campaign import Execution, PreparedCampaign, prepare_campaign
from vtff_bringup.campaign.campaign_file import load_campaign
from vtff_bringup.campaign.cases import Case
from vtff_bringup.campaign.execution import fly_campaign
from vtff_bringup.campaign.plan import FlightPlan
from vtff_bringup.campaign.worker import COMPLETE, make_record
from vtff_node.plain_yaml import format_yaml

REPOSITORY = pathlib.Path(__file__).resolve().parents[1]
START = "scenario.spacecraft.deputy.orbit.same_orbit_ahead"
CAMPAIGN: dict[str, Any] = {
    "description": "reference formation from dispersed starts",
    "system": "reference_software",
    "vary": {START: {"distribution": "norm", "loc": 1000.0, "scale": 50.0}},
    "figures": ["settling_time_s", "minimum_in_track_m", "delta_v_total_in_track_m_per_s"],
}
RUN_DURATION = 600.0  # s
SLEEP = 0.5  # s


def prepared(folder: pathlib.Path, **fields: Any) -> PreparedCampaign:
    """Return a campaign that writes into a new folder."""
    out = pathlib.Path(tempfile.mkdtemp(dir=folder))
    file = out / "bench.yaml"
    file.write_text(format_yaml({**CAMPAIGN, **fields}), encoding="utf-8")
    return prepare_campaign(load_campaign(file), out, "none")


def measure_library(folder: pathlib.Path, count: int = 60) -> None:
    """Fly cases of one hour without ROS on one worker and on two."""
    times = {}
    for workers in (1, 2):
        begin = time.perf_counter()
        flown = prepared(folder, loop="library", samples=count)
        first: list[float] = []

        def note(record: dict[str, Any], first: list[float] = first) -> None:
            first.append(time.perf_counter())

        result = flown.fly(Execution(workers), on_record=note)
        end = time.perf_counter()
        processor = sum(record["processor_time_s"] for record in result.records) / count
        # Between the first and the last record: what many cases cost.
        times[workers] = (first[-1] - first[workers - 1]) / (count - workers)
        print(
            f" {workers} workers: {count} cases of 1 h in {end - begin:.1f} s with start and end; "
            f"{1e3 * times[workers]:.0f} ms a case, {1e3 * processor:.0f} ms of processor"
        )
    print(f" throughput of 2 workers to 1: {times[1] / times[2]:.2f}")


def measure_run(folder: pathlib.Path, count: int = 12) -> None:
    """Fly cases of `vtff run` one after the other, and the same runs bare."""
    command = [sys.executable, "-m", "vtff_bringup.cli", "run", "reference_software", "--composed"]
    command += ["--duration", f"{RUN_DURATION:g}"]
    begin = time.perf_counter()
    for number in range(count):
        out = str(folder / f"bare_{number}")
        subprocess.run([*command, "--out", out], check=True, stdout=subprocess.DEVNULL)
    bare = (time.perf_counter() - begin) / count
    begin = time.perf_counter()
    done: list[float] = []
    flown = prepared(folder, samples=count, duration=RUN_DURATION)
    flown.fly(Execution(1), on_record=lambda record: done.append(time.perf_counter()))
    whole = time.perf_counter() - begin
    # Between records: a case with its own start and end, without those of the campaign.
    case = (done[-1] - done[0]) / (count - 1)
    print(
        f" {count} runs of {RUN_DURATION:g} s: bare {bare:.2f} s each, as cases {case:.2f} s each, "
        f"start and end of the run included: {100.0 * (case / bare - 1.0):+.1f} %; start and end "
        f"of the campaign {whole - count * case:.1f} s"
    )


def do_nothing(plan: FlightPlan, cases: Any) -> list[dict[str, Any]]:
    """Return records of cases that were not flown."""
    return [make_record(case, COMPLETE) for case in cases]


def sleep_a_while(plan: FlightPlan, cases: Any) -> list[dict[str, Any]]:
    """Take the time of a case without its work."""
    time.sleep(SLEEP * len(cases))
    return do_nothing(plan, cases)


@contextlib.contextmanager
def cluster(workers: int, threads: int) -> Iterator[tuple[distributed.Client, psutil.Process]]:
    """Yield a client of a cluster of programs of their own, and the scheduler's process."""
    environment = {**os.environ, "DASK_DISTRIBUTED__LOGGING__DISTRIBUTED": "critical"}
    started: list[subprocess.Popen[bytes]] = []

    def start(program: str, *arguments: object) -> None:
        words = [sys.executable, "-m", f"distributed.cli.{program}", *map(str, arguments)]
        started.append(subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL))

    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "scheduler.json"
        local = ("--scheduler-file", file, "--no-dashboard")
        try:
            start("dask_scheduler", "--host", "127.0.0.1", "--port", 0, *local)
            for _ in range(workers):
                start("dask_worker", "--nthreads", threads, "--no-nanny", *local)
            deadline = time.monotonic() + 60.0
            while not file.exists() and time.monotonic() < deadline:
                time.sleep(0.1)
            with distributed.Client(scheduler_file=str(file), set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=60)
                yield client, psutil.Process(started[0].pid)
        finally:
            for process in started:
                process.terminate()
            for process in started:
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def measure_scheduler(folder: pathlib.Path) -> None:
    """Hand out cases that do nothing, and cases that sleep on many threads."""
    plan = prepared(folder, loop="library", samples=1).plan

    def hand_out(
        client: distributed.Client,
        scheduler: psutil.Process,
        count: int,
        fly: Callable[..., Any],
        batch: int,
    ) -> tuple[float, float, float]:
        """Return cases a second, and processor time a case of scheduler and command in ms."""
        cases = [Case(number, number, {START: 1000.0}, {START: 1000.0}) for number in range(count)]
        own, others = time.process_time(), sum(scheduler.cpu_times()[:2])
        begin = time.perf_counter()
        fly_campaign(client, plan, cases, lambda record: None, batch, fly)
        took = time.perf_counter() - begin
        own, others = time.process_time() - own, sum(scheduler.cpu_times()[:2]) - others
        return count / took, 1e3 * others / count, 1e3 * own / count

    with cluster(1, 8) as (client, scheduler):
        hand_out(client, scheduler, 200, do_nothing, 1)
        for batch in (1, 10):
            rate, others, own = hand_out(client, scheduler, 4000, do_nothing, batch)
            print(
                f" cases that do nothing, {batch} a task: {rate:.0f} a second; processor time a "
                f"case: scheduler {others:.2f} ms, command {own:.2f} ms"
            )
    for threads in (10, 100, 1000):
        with cluster(min(threads, 4), threads // min(threads, 4)) as (client, scheduler):
            available = sum(client.nthreads().values())
            ideal = available / SLEEP
            for batch in (1, 10) if threads == 1000 else (1,):
                count = int(min(20.0 * ideal, 8000)) * (1 if batch == 1 else 3)
                rate, _, _ = hand_out(client, scheduler, count, sleep_a_while, batch)
                print(
                    f" cases that sleep {SLEEP:g} s on {available} threads, {batch} a task: "
                    f"{rate:.0f} a second of {ideal:.0f} possible, {100.0 * rate / ideal:.0f} %"
                )


def measure_thousand(folder: pathlib.Path) -> None:
    """Fly 1000 cases of one hour on two workers; look at memory and at the table."""
    import pyarrow.parquet

    begin = time.perf_counter()
    flown = prepared(folder, loop="library", samples=1000)
    own, memory = psutil.Process(), []

    def note(record: dict[str, Any]) -> None:
        memory.append(own.memory_info().rss / 1e6)

    result = flown.fly(Execution(2), on_record=note)
    took = time.perf_counter() - begin
    processor = sum(record["processor_time_s"] for record in result.records) / len(result.records)
    print(
        f" 1000 cases of 1 h on 2 workers: {took:.0f} s, {1e3 * processor:.0f} ms of processor each"
    )
    marks = ", ".join(f"{memory[n - 1]:.0f} after {n}" for n in (10, 250, 500, 750, 1000))
    print(f" memory of command and scheduler, MB: {marks}")
    path = flown.folder / "cases.parquet"
    shapes = [f"pyarrow {pyarrow.parquet.read_table(path).shape}"]
    # Neither is needed to run vtff; each is tried where it is installed.
    for library in ("pandas", "polars"):
        with contextlib.suppress(ImportError):
            shapes.append(f"{library} {importlib.import_module(library).read_parquet(path).shape}")
    print(f" table: {', '.join(shapes)}, {path.stat().st_size} bytes")


def main() -> None:
    """Measure and print."""
    os.chdir(REPOSITORY)
    measures = {
        "library": measure_library,
        "run": measure_run,
        "scheduler": measure_scheduler,
        "thousand": measure_thousand,
    }
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("measure", nargs="*", help=f"of {', '.join(measures)}")
    chosen = parser.parse_args().measure or ["library", "run", "scheduler"]
    if unknown := set(chosen) - set(measures):
        parser.error(f"measure: {' '.join(sorted(unknown))} is none of {', '.join(measures)}")
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen:
            print(name, flush=True)
            measures[name](pathlib.Path(folder))


if __name__ == "__main__":
    main()

"""A case flown as `vtff run`: a program with ports, ROS domain and folder of its own."""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import psutil  # type: ignore[import-untyped]

from vtff_bringup.campaign.cases import Case
from vtff_bringup.campaign.plan import FlightPlan, case_files, case_overrides
from vtff_node.plain_yaml import format_yaml

__all__ = ["CaseFailedError", "CaseTimeoutError", "end_flights", "fly_run_case"]

_SUMMARY = "report/summary.json"
_LOG = "vtff_run.log"
_PATIENCE = 45.0  # s that `vtff run` gets to end its nodes in order

_flights: dict[int, tuple[str, subprocess.Popen[bytes]]] = {}
"""Campaign and program of the cases that this worker flies now, by process id."""
_flights_lock = threading.Lock()


class CaseFailedError(Exception):
    """A case did not come to its planned end; the text says why, on one line."""


class CaseTimeoutError(CaseFailedError):
    """A case took longer than the time-out of its campaign."""


def fly_run_case(plan: FlightPlan, case: Case, folder: pathlib.Path) -> dict[str, Any]:
    """Fly a case in a new run folder and return the summary of its report.

    Raises
    ------
    CaseFailedError
        If the run failed or hung.
    OSError
        If the folder cannot be written.
    LookupError
        If an entry of a file that the case sets is not there.
    """
    folder.mkdir(parents=True)
    overrides = case_overrides(plan, case)
    for argument, file in case_files(plan, case).items():
        path = folder.parent / f"{folder.name}_{argument}.yaml"
        text = format_yaml(file.fields)
        path.write_text(f"# Written by vtff campaign from {file.name}.\n{text}", "utf-8")
        overrides.append(f"{argument}:={path}")
    arguments = ["run", plan.system, *overrides, "--seed", str(case.seed), "--out", str(folder)]
    if plan.duration is not None:
        arguments += ["--duration", repr(plan.duration)]
    if plan.composed:
        arguments.append("--composed")
    try:
        exit_code = _run(plan, arguments, folder.parent / f"{folder.name}_{_LOG}")
    finally:
        # vtff run wants an empty folder: what is not its own comes in afterwards.
        for made in sorted(folder.parent.glob(f"{folder.name}_*")):
            made.rename(folder / made.name.removeprefix(f"{folder.name}_"))
    if exit_code:
        reason = _last_error(folder / _LOG)
        raise CaseFailedError(reason or f"vtff run ended with exit code {exit_code}")
    summary: dict[str, Any] = json.loads((folder / _SUMMARY).read_text(encoding="utf-8"))
    return summary


def end_flights(campaign: str, number: int = signal.SIGTERM) -> int:
    """End what this worker flies for a campaign; return how many cases that are."""
    with _flights_lock:
        ended = [process for owner, process in _flights.values() if owner == campaign]
    for process in ended:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
    return len(ended)


def _run(plan: FlightPlan, arguments: list[str], log: pathlib.Path) -> int:
    """Run the vtff command; return its exit code. Nothing that it started is left behind."""
    module = "vtff_bringup.campaign.dependent_run"  # ends when this worker dies
    environment = {k: v for k, v in os.environ.items() if k != "ROS_DOMAIN_ID"}
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", module, str(os.getpid()), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env={**environment, "COLUMNS": "200"},
            start_new_session=True,
        )
    with _registered(plan.folder, process):
        try:
            return process.wait(plan.timeout)
        except subprocess.TimeoutExpired:
            raise CaseTimeoutError(f"hung: not done after {plan.timeout:g} s") from None
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a run and every process below it, in order if it can."""
    descendants: list[psutil.Process] = []
    if process.poll() is None:
        with contextlib.suppress(psutil.NoSuchProcess):
            descendants = psutil.Process(process.pid).children(recursive=True)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
    for descendant in descendants:
        with contextlib.suppress(psutil.NoSuchProcess):
            descendant.kill()
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@contextlib.contextmanager
def _registered(campaign: str, process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Keep a program among those that `end_flights` ends."""
    with _flights_lock:
        _flights[process.pid] = (campaign, process)
    try:
        yield
    finally:
        with _flights_lock:
            del _flights[process.pid]


def _last_error(log: pathlib.Path) -> str:
    """Return the line of a run's output that tells why it failed."""
    lines = [line.strip() for line in log.read_text("utf-8", "replace").splitlines()]
    telling = [
        line
        for line in lines
        if any(sign in line for sign in ("error:", "Error", "exit code", "signal", "No space left"))
    ]
    return (telling or [line for line in lines if line] or [""])[-1]

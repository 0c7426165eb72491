"""Work of a Dask worker: it flies cases and returns a record of each, never an exception."""

from __future__ import annotations

import functools
import hashlib
import os
import pathlib
import platform
import resource
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from distributed import get_worker

from vtff_bag.run.environment import describe_environment
from vtff_bringup.campaign.cases import Case
from vtff_bringup.campaign.library_flight import fly_library_case
from vtff_bringup.campaign.plan import FlightPlan
from vtff_bringup.campaign.run_flight import CaseFailedError, CaseTimeoutError, fly_run_case

__all__ = ["COMPLETE", "FAILED", "HUNG", "LOST", "fly_cases", "make_record"]

COMPLETE, FAILED, HUNG, LOST = "complete", "failed", "hung", "lost"
"""Status of a case: flown to its end, failed, over its time-out, or lost with its worker."""

RUNS_FOLDER = "runs"
_EXIT_HUNG = 86  # of a worker that ends itself because a case in it hangs


def fly_cases(plan: FlightPlan, cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Fly cases one after the other and return their records."""
    return [_fly(plan, case) for case in cases]


def make_record(case: Case, status: str, reason: str = "", **measured: Any) -> dict[str, Any]:
    """Return the record of a case: all that the table tells of it."""
    return {
        "case": case.number,
        "status": status,
        "reason": reason,
        "seed": case.seed,
        "inputs": dict(case.inputs),
        "figures": {},
        "wall_time_s": None,
        "processor_time_s": None,
        "run_folder": None,
        "vtff_version": None,
        "git_commit": None,
        "machine": None,
        **measured,
    }


def _fly(plan: FlightPlan, case: Case) -> dict[str, Any]:
    environment = _environment()
    machine = {
        "vtff_version": environment["vtff_version"],
        "git_commit": environment["git_commit"],
        "machine": f"{platform.node()} ({environment['machine_cpu_model']})",
    }
    if environment["vtff_version"] != plan.version:
        reason = f"the worker has vtff {environment['vtff_version']}, not {plan.version}"
        return make_record(case, FAILED, reason, **machine)
    started, processor_started = time.monotonic(), _processor_time()
    status, reason, figures, run_folder = COMPLETE, "", {}, None
    try:
        if plan.loop == "library":
            with _watched(plan.timeout):
                figures = fly_library_case(plan, case)
        else:
            figures, run_folder = _fly_in_folder(plan, case)
    except _RunEndedError as error:
        status, reason, run_folder = error.status, str(error), error.run_folder
    except Exception as error:  # whatever a case does, the others go on
        status, reason = FAILED, f"{type(error).__name__}: {' '.join(str(error).split())}"
    return make_record(
        case,
        status,
        reason,
        figures={name: figures.get(name) for name in plan.figures} if figures else {},
        wall_time_s=time.monotonic() - started,
        processor_time_s=_processor_time() - processor_started,
        run_folder=run_folder,
        **machine,
    )


class _RunEndedError(Exception):
    """A run that did not come to its end, with its status and the folder that was kept."""

    def __init__(self, status: str, reason: str, run_folder: str | None) -> None:
        super().__init__(reason)
        self.status = status
        self.run_folder = run_folder


def _fly_in_folder(plan: FlightPlan, case: Case) -> tuple[dict[str, Any], str | None]:
    """Fly a case as `vtff run`; return its summary and the name of its folder if it is kept."""
    with _scratch_folder() as scratch:
        # With the identity in its name: a campaign that was extended counts its cases anew.
        digest = hashlib.sha256(case.identity.encode()).hexdigest()
        folder = scratch / f"{case.number:06d}_{digest[:8]}"
        try:
            summary = fly_run_case(plan, case, folder)
        except CaseFailedError as error:
            status = HUNG if isinstance(error, CaseTimeoutError) else FAILED
            kept = None if plan.keep == "none" else _keep(plan, folder)
            reason = str(error).replace(str(folder), kept or folder.name)
            raise _RunEndedError(status, reason, kept) from None
        return summary, _keep(plan, folder) if plan.keep == "bags" else None


def _keep(plan: FlightPlan, folder: pathlib.Path) -> str | None:
    """Move a run folder into that of the campaign; return its name there."""
    place = pathlib.Path(plan.folder) / RUNS_FOLDER
    if not folder.is_dir() or not pathlib.Path(plan.folder).is_dir():
        return None  # nothing was flown, or this machine does not share the campaign's folder
    place.mkdir(exist_ok=True)
    kept = place / folder.name
    if kept.exists():  # of an attempt before
        shutil.rmtree(kept)
    shutil.move(folder, kept)
    return f"{RUNS_FOLDER}/{folder.name}"


@contextmanager
def _scratch_folder() -> Iterator[pathlib.Path]:
    """Yield a folder of this worker that goes when the case is done."""
    try:
        parent = get_worker().local_directory
    except ValueError:  # not on a worker: a case that is repeated by itself
        parent = None
    with tempfile.TemporaryDirectory(dir=parent, prefix="case_", ignore_cleanup_errors=True) as own:
        yield pathlib.Path(own)


@contextmanager
def _watched(timeout: float) -> Iterator[None]:
    """End this worker when what runs in it takes longer: nothing else can end a thread."""
    watchdog = threading.Timer(timeout, os._exit, (_EXIT_HUNG,))
    watchdog.daemon = True
    watchdog.start()
    try:
        yield
    finally:
        watchdog.cancel()


@functools.cache
def _environment() -> dict[str, Any]:
    return describe_environment()


def _processor_time() -> float:
    """Return processor seconds of this thread and of the processes that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.thread_time() + children.ru_utime + children.ru_stime

"""Environment of a run: version of vtff, git commit, machine."""

from __future__ import annotations

import importlib.metadata
import os
import pathlib
import platform
import subprocess
from typing import Any

GIT_TIMEOUT = 5.0  # s
PACKAGE = "vtff_bringup"


def describe_environment() -> dict[str, Any]:
    """Return version, git commit and machine under the keys of docs/summary.md.

    Returns
    -------
    dict
        Value by key; None for a value that this machine does not provide.
    """
    commit, modified = _read_git_state()
    return {
        "vtff_version": vtff_version(),
        "git_commit": commit,
        "git_modified": modified,
        "machine_cpu_model": _read_cpu_model(),
        "machine_cpu_cores": os.cpu_count(),
        "machine_python": platform.python_version(),
        "machine_platform": platform.platform(),
    }


def vtff_version() -> str | None:
    """Return the version of vtff; None where it is not installed."""
    try:
        return importlib.metadata.version(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return None


def _read_cpu_model() -> str | None:
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or None
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, None) or platform.processor() or None


def _read_git_state() -> tuple[str | None, bool | None]:
    """Return the commit and whether files differ from it; None outside a checkout of vtff."""
    folder = pathlib.Path(__file__).resolve().parent
    top = _run_git(folder, "rev-parse", "--show-toplevel")
    # An installed package may lie inside some other project's repository.
    if top is None or not (pathlib.Path(top) / "src" / PACKAGE).is_dir():
        return None, None
    commit = _run_git(folder, "rev-parse", "--verify", "HEAD")
    if commit is None:
        return None, None
    changes = _run_git(pathlib.Path(top), "status", "--porcelain")
    return commit, None if changes is None else bool(changes)


def _run_git(folder: pathlib.Path, *arguments: str) -> str | None:
    try:
        answer = subprocess.run(
            ["git", *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=GIT_TIMEOUT,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()

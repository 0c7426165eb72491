"""Running the vtff command in tests, and runs that several tests share."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
SYSTEMS = ROOT / "config" / "system"
SHARED = pathlib.Path(os.environ.get("VTFF_SHARED", ROOT.parent / "shared"))


def run_vtff(*arguments: object, timeout: float = 240.0) -> subprocess.CompletedProcess[str]:
    """Run the vtff command as a user would and return what it printed."""
    return subprocess.run(
        [sys.executable, "-m", "vtff_bringup.cli", *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout,
        env={**os.environ, "COLUMNS": "200"},
    )


class Runs:
    """Makes runs on demand and remembers them."""

    def __init__(self, folder: pathlib.Path) -> None:
        self._folder = folder
        self._made: dict[str, tuple[pathlib.Path, subprocess.CompletedProcess[str]]] = {}

    def make(
        self, name: str, system: str, *arguments: object
    ) -> tuple[pathlib.Path, subprocess.CompletedProcess[str]]:
        """Return folder and result of a run; the same name gives the same run."""
        if name not in self._made:
            folder = self._folder / name
            result = run_vtff("run", SYSTEMS / system, *arguments, "--out", folder)
            assert result.returncode == 0, result.stdout + result.stderr
            self._made[name] = (folder, result)
        return self._made[name]

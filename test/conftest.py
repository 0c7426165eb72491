"""Whole-graph runs shared by the tests: each is made once, in a folder of its own."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

ROOT = pathlib.Path(__file__).resolve().parents[1]
SYSTEMS = ROOT / "config" / "system"
SHARED = pathlib.Path(os.environ.get("VTFF_SHARED", ROOT.parent / "shared"))

sys.path.insert(0, str(pathlib.Path(__file__).parent))


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


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of this test session."""
    return Runs(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="session")
def shared() -> pathlib.Path:
    """Folder of reference data, or skip."""
    if not SHARED.is_dir():
        pytest.skip("the folder of reference data (../shared) is absent")
    return SHARED

"""The libraries in an empty environment without ROS: they install, and three examples run."""

from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]

EXAMPLES = """
import math
from vtff_analysis.library.functions import baseline, fly, tec
from vtff_dynamics.relative.formation import Formation
from vtff_dynamics.time.timescales import parse_epoch
from vtff_node.plugins.loading import plugin_names

result = fly("reference.yaml", "delay_aware", duration=60.0)
assert result.deputy().state_relative_rtn.shape == (61, 6)
formation = Formation.on_circular_orbit(
    parse_epoch("2016-03-21T01:00:00 GPS"),
    6.871e6,
    math.radians(45.0),
    {"deputy": [0.0, 100.0, 0.0, 0.0, 0.0, 0.0]},
)
assert abs(formation.after(60.0).relative_states_rtn["deputy"][1] - 100.0) < 1.0
assert "cdgps" in plugin_names("vtff.estimators") and "paper" in plugin_names("vtff.controllers")
import vtff_control.thruster.can_thruster, vtff_gnss.novatel, vtff_iono.content.absolute_tec
import vtff_nav.relative.cdgps.estimator, vtff_nav.relative.paper.estimator
try:
    import rclpy
except ImportError:
    print("no ROS: all well")
"""


def copy_sources(folder: pathlib.Path) -> None:
    """Copy what `pip install .` needs, so that nothing is built in the tree."""
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    ignored = shutil.ignore_patterns("test", "cesium", "__pycache__", "*.egg-info", "build")
    shutil.copytree(ROOT / "src", folder / "src", ignore=ignored)


@pytest.mark.slow
def test_libraries_install_and_run_in_an_empty_environment(tmp_path):
    """Downloads 300 MB: two to five minutes of wall time, half a minute of computing."""
    sources = tmp_path / "sources"
    sources.mkdir()
    copy_sources(sources)
    shutil.copy(ROOT / "config/scenario/reference.yaml", tmp_path)
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH")
    }
    python = tmp_path / "venv/bin/python"

    def run(*command: object) -> str:
        result = subprocess.run(
            [*map(str, command)],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=1200.0,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    run(sys.executable, "-m", "venv", tmp_path / "venv")
    packages = [sources / "src" / f"vtff_{name}" for name in ("dynamics", "gnss", "nav", "iono")]
    packages.append(sources / "src/vtff_control")
    wheels = tmp_path / "wheels"
    run(python, "-m", "pip", "wheel", "-q", "--no-deps", "-w", wheels, *packages)
    assert len(list(wheels.glob("vtff_*.whl"))) == len(packages)
    run(python, "-m", "pip", "install", "-q", *packages)
    run(python, "-c", "import vtff_nav.relative.cdgps.estimator, vtff_iono.content.absolute_tec")
    run(python, "-m", "pip", "install", "-q", sources)
    assert run(python, "-c", EXAMPLES) == "no ROS: all well\n"

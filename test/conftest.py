"""Whole-graph runs shared by the tests: each is made once, in a folder of its own."""

from __future__ import annotations

import os
import pathlib

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from graph_support import Runs  # noqa: E402
from shared_data import require_shared  # noqa: E402


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of this test session, shared by its worker processes."""
    folder = tmp_path_factory.getbasetemp()
    # pytest-xdist gives each worker a folder of its own in that of the session.
    return Runs((folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "runs")


@pytest.fixture(scope="session")
def shared() -> pathlib.Path:
    """Folder of reference data, or skip."""
    return require_shared()

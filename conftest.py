"""Settings of all tests: helper modules, examples of property tests, and what was left out."""

from __future__ import annotations

import gc
import os
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

# As many test processes run as there are processors, and the matrices are small: threads of the
# numerical libraries would only wait for each other. Set before numpy and numba are imported.
for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

# Helper modules of the tests stand in the test folders; pytest's importlib mode adds no path.
_ROOT = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(_ROOT / "test"), *(str(path) for path in sorted(_ROOT.glob("src/*/test")))]

from shared_data import ABSENT, shared_folder  # noqa: E402

# A test that fails by chance tells nothing of the change that it is run for. New examples are
# looked for on purpose, with HYPOTHESIS_PROFILE=explore.
settings.register_profile("vtff", deadline=None, derandomize=True, database=None)
settings.register_profile("explore", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "vtff"))


class Omissions:
    """Counts what a test session leaves out, also where worker processes run the tests."""

    def __init__(self) -> None:
        self._deselected = 0

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        """Count tests that the command line excludes."""
        self._deselected += len(items)

    def pytest_collection_finish(self) -> None:
        """Take the modules and items out of the garbage collection: they last to the end."""
        gc.collect()
        gc.freeze()

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hand the count of a worker process to the process that reports."""
        gc.unfreeze()
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["deselected"] = self._deselected

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take the count of a worker process; each of them has collected all tests."""
        counted = getattr(node, "workeroutput", {}).get("deselected", 0)
        self._deselected = max(self._deselected, counted)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print a line for each kind of omission that there is."""
        skipped = sum(
            f"Skipped: {ABSENT}" in str(report.longrepr)
            for report in terminalreporter.stats.get("skipped", [])
        )
        if skipped:
            terminalreporter.write_line(
                f"{skipped} tests skipped: they need the reference data, which are not in "
                f"{shared_folder()} (VTFF_SHARED names another folder)"
            )
        if self._deselected:
            marks = terminalreporter.config.option.markexpr
            terminalreporter.write_line(
                f"{self._deselected} tests deselected ({marks or 'by name'}); "
                "make test PYTEST_ARGUMENTS='-m slow' runs the slow ones"
            )


@pytest.fixture
def ros_context() -> Iterator[Any]:
    """Yield a context of rclpy in a ROS domain that nothing else on this machine uses."""
    import rclpy
    from domain_coordinator import domain_id

    context = rclpy.Context()
    with domain_id() as domain:
        rclpy.init(context=context, domain_id=domain)
        yield context
        rclpy.try_shutdown(context=context)


def pytest_configure(config: pytest.Config) -> None:
    """Count what this session leaves out."""
    config.pluginmanager.register(Omissions())

"""The end of a node process: bounded and with its exit code, whatever hangs after the nodes."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")
from domain_coordinator import domain_id  # noqa: E402

LIMIT = 60.0  # s after which a test gives up

PROGRAM = """
    import re
    import sys
    from vtff_node import main
    from vtff_node.node import VtffNode

    main.LEAVE_TIMEOUT, main.TEARDOWN_TIMEOUT = 0.5, 2.0

    class EndingNode(VtffNode):
        def __init__(self, **node_arguments):
            super().__init__("ending", **node_arguments)
            self.finish({exit_code})
            self.create_timer(0.01, self.work)

        def work(self):
            {work}

        def destroy_node(self):
            {teardown}
            super().destroy_node()

    main.run_node(EndingNode)
"""


def run(
    teardown: str, exit_code: int | None = 0, work: str = "pass"
) -> subprocess.CompletedProcess[str]:
    """Run a node that finishes at once with an exit code; None: it works until that ends it."""
    program = textwrap.dedent(PROGRAM).format(teardown=teardown, exit_code=exit_code, work=work)
    if exit_code is None:
        program = program.replace("self.finish(None)", "pass")
    with domain_id() as free_domain:
        return subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "ROS_DOMAIN_ID": str(free_domain)},
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )


@pytest.mark.parametrize("exit_code", [0, 1])
def test_a_process_ends_with_the_code_of_its_node(exit_code):
    result = run("pass", exit_code)
    assert result.returncode == exit_code
    # The one line of a healthy node.
    assert [line.rpartition(": ")[2] for line in result.stderr.splitlines()] == ["begins"]


@pytest.mark.parametrize("exit_code", [0, 1])
@pytest.mark.parametrize(
    "teardown",
    ["while True: pass", "re.match('(a+)+$', 'a' * 60 + 'b')"],  # the latter keeps the lock
    ids=["gives the interpreter lock away", "keeps it"],
)
def test_a_teardown_that_spins_is_left_with_the_code_of_the_node(teardown, exit_code):
    result = run(teardown, exit_code)
    assert result.returncode == exit_code
    assert "Timeout (0:00:00.500000)!" in result.stderr
    assert "in destroy_node" in result.stderr


def test_a_failing_node_whose_teardown_spins_ends_with_code_1():
    result = run("re.match('(a+)+$', 'a' * 60 + 'b')", None, work="raise OSError('no disk')")
    assert result.returncode == 1
    assert "in destroy_node" in result.stderr


def test_a_node_without_memory_says_so_in_one_line():
    result = run("pass", None, work="import numpy; numpy.empty((10**6, 10**8))")
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    last = result.stderr.splitlines()[-1]
    assert last.startswith("error: /ending: no memory is left: Unable to allocate")

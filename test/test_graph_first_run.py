"""The first run after an installation: nothing is compiled yet, and no step waits for it."""

from __future__ import annotations

import pytest
from graph_support import SYSTEMS, run_vtff

from vtff_bag.file.reader import BagReader
from vtff_msgs.msg import SimulatorStatus

DURATION = 20


@pytest.mark.slow
@pytest.mark.parametrize("pacing", [(), ("--realtime", "--distributed", "--max-lag", 0)])
def test_a_first_run_compiles_before_its_first_step(tmp_path, monkeypatch, pacing):
    machine_code, run = tmp_path / "machine_code", tmp_path / "run"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(machine_code))
    arguments = (*pacing, "--duration", DURATION, "--no-report", "--out", run)
    result = run_vtff("run", SYSTEMS / "reference.yaml", *arguments, timeout=1800.0)
    assert result.returncode == 0, result.stdout + result.stderr
    assert any(machine_code.rglob("*"))
    statuses = [item.message for item in BagReader(run).messages("/sim/status")]
    assert [status.step for status in statuses] == [*range(DURATION + 1), DURATION]
    assert statuses[-1].state == SimulatorStatus.STATE_ENDED
    assert statuses[-1].late_commands == 0

"""The truth file: JSON lines, and one named error when the disk is full."""

from __future__ import annotations

import json
import pathlib

import pytest

from vtff_sim_bridge.receiver.truth_file import TruthFile


def test_records_are_json_lines(tmp_path):
    truth = TruthFile(tmp_path / "truth.jsonl")
    assert truth.is_wanted
    truth.write("run", seed=1)
    truth.close()
    truth.write("run", seed=2)  # after the end nothing is written
    assert json.loads((tmp_path / "truth.jsonl").read_text()) == {"record": "run", "seed": 1}


@pytest.mark.skipif(not pathlib.Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("method", ["flush", "close"])
def test_a_full_disk_is_one_error_with_the_file(method):
    truth = TruthFile("/dev/full")
    truth.write("run", seed=1)
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        getattr(truth, method)()
    truth.write("second", second=1)
    truth.flush()
    truth.close()
    assert not truth.is_wanted

"""Functions for daily use: they give what the command gives, and tell wrong arguments."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_analysis.library.functions import baseline, fly, tec
from vtff_control.tracking.sdre import SdreDesign
from vtff_sim_bridge.truth.scenario import load_scenario

SCENARIO = pathlib.Path(__file__).resolve().parents[4] / "config/scenario/reference.yaml"


def test_fly_is_the_closed_loop_of_the_scenario():
    flown = fly(SCENARIO, "delay_aware", duration=60.0)
    expected = simulate_closed_loop(
        load_scenario(SCENARIO), SdreDesign(design="delay_aware"), duration=60.0
    )
    assert len(flown.time) == 61
    np.testing.assert_array_equal(
        flown.deputy().state_relative_rtn, expected.deputy().state_relative_rtn
    )


def test_fly_with_the_cap_of_appendix_a_comes_as_near_as_the_paper():
    flown = fly(SCENARIO, "paper", duration=120.0, acceleration_cap=1.4)
    closest, _ = flown.minimum_in_track()
    assert closest == pytest.approx(38.17, abs=0.1)  # m; paper 000, appendix A


PLUGIN = """
import numpy as np
from vtff_control.tracking.controller import ControlResult

class Constant:
    def __init__(self, setting):
        self.cap = setting.acceleration_cap

    def reset(self):
        pass

    def control(self, relative_state_rtn, state_chief_gcrf, target_rtn, stamp=None):
        return ControlResult(np.array([0.0, -0.5 * self.cap, 0.0]), saturated=False, valid=True)
"""


def test_fly_takes_the_controller_of_a_plugin(tmp_path, monkeypatch):
    (tmp_path / "lab_controller.py").write_text(PLUGIN)
    metadata = tmp_path / "lab-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[vtff.controllers]\nlab_constant = lab_controller:Constant\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    deputy = fly(SCENARIO, "lab_constant", duration=60.0, acceleration_cap=0.1).deputy()
    np.testing.assert_array_equal(deputy.command_rtn, np.tile([0.0, -0.05, 0.0], (60, 1)))
    # Thrust waits one step; then the speed grows by 0.05 m/s in each second.
    assert deputy.state_relative_rtn[-1, 4] == pytest.approx(-0.05 * 59, abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"design": "nobody"}, "parameter 'design' is 'nobody'; installed are: .*paper"),
        ({"duration": 0.25}, "duration: one or more whole steps"),
        ({"acceleration_cap": -1.0}, "acceleration_cap: one or three positive numbers"),
    ],
)
def test_fly_tells_wrong_arguments(arguments, text):
    with pytest.raises(ValueError, match=text):
        fly(SCENARIO, **arguments)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"dynamics": "fast"}, "dynamics: expected one of .*; got 'fast'"),
        ({"position_base_itrf": [4e3, 3e3, 4e3]}, r"position_base_itrf: .* m or more .*in km"),
        ({"position_base_itrf": [[4e6], [3e6], [4e6]]}, r"shape \(3,\); got shape \(3, 1\)"),
    ],
)
def test_baseline_tells_wrong_arguments_before_it_reads(arguments, text):
    with pytest.raises(ValueError, match=text):
        baseline("no_rover.rnx", "no_base.rnx", **arguments)


def test_files_that_are_none_are_told(tmp_path):
    other = tmp_path / "text.rnx"
    other.write_text("no observations\n")
    for call in (lambda: tec(other), lambda: baseline(other, other), lambda: tec(other, other)):
        with pytest.raises(ValueError, match=r"text\.rnx"):
            call()
    with pytest.raises(OSError, match="nothing"):
        tec(tmp_path / "nothing.rnx")

"""After its synthetic epochs an estimator compiles nothing more, for which a node would be late."""

from __future__ import annotations

import subprocess
import sys

import pytest

from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.antenna_correction import Antenna, AntennaPair
from vtff_nav.relative.common.dynamics import DYNAMICS
from vtff_nav.relative.common.solution import SOLUTION_FIXED, SOLUTION_FLOAT
from vtff_nav.relative.paper.estimator import PaperEstimator
from vtff_nav.relative.synthetic_epochs import process_synthetic_epochs

COMPILED_BEFORE_THE_FIRST_EPOCH = """
from cdgps_test_support import configuration, fly, simulate
from compiled_forms import compiled_forms
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.synthetic_epochs import process_synthetic_epochs

scenario = simulate(30)
process_synthetic_epochs(CdgpsEstimator(configuration()))
before = compiled_forms()
assert before["vtff_nav.relative.kernels.noise.update_models"] > 0
fly(scenario, configuration())
assert compiled_forms() == before, (before, compiled_forms())
"""


def test_nothing_is_left_to_compile_for_the_first_epoch():
    """In a process of its own: other tests have compiled everything here."""
    program = f"import sys; sys.path[:0] = {sys.path!r}\n{COMPILED_BEFORE_THE_FIRST_EPOCH}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_synthetic_epochs_give_integers(dynamics):
    estimator = CdgpsEstimator(CdgpsConfiguration(dynamics=dynamics))
    is_in_orbit = estimator.configuration.chief_motion == "orbital"
    solution = process_synthetic_epochs(estimator, is_in_orbit=is_in_orbit)
    assert solution.solution == SOLUTION_FIXED
    assert len(solution.ambiguities) > 0


def test_synthetic_epochs_have_attitudes():
    deputy = Antenna(lever_arm_body=(0.1, 0.0, 0.2), attitude_frame="estimated")
    estimator = CdgpsEstimator(CdgpsConfiguration(antennas=AntennaPair(Antenna(), deputy)))
    assert process_synthetic_epochs(estimator).solution == SOLUTION_FIXED


def test_the_filter_of_the_paper_starts_in_synthetic_epochs():
    assert process_synthetic_epochs(PaperEstimator()).solution >= SOLUTION_FLOAT

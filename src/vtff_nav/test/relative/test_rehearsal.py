"""After a rehearsal an estimator compiles nothing more: a node in real time would wait for it."""

from __future__ import annotations

import pytest
from cdgps_test_support import configuration, fly, simulate

from vtff_dynamics.compiled import count_compiled_forms
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.dynamics import DYNAMICS
from vtff_nav.relative.common.solution import SOLUTION_FLOAT
from vtff_nav.relative.integers.least_squares import compile_kernels
from vtff_nav.relative.paper.configuration import PaperConfiguration
from vtff_nav.relative.paper.estimator import PaperEstimator
from vtff_nav.relative.rehearsal import rehearse


def test_nothing_is_compiled_after_a_rehearsal():
    compile_kernels()
    rehearse(CdgpsEstimator(configuration()))
    scenario = simulate(30)
    before = count_compiled_forms()
    assert before["vtff_nav.relative.kernels.motion.advance_errors_of_pair"] > 0
    assert before["vtff_nav.relative.kernels.noise.update_models"] > 0
    fly(scenario, configuration())
    assert count_compiled_forms() == before


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_a_rehearsal_gives_solutions(dynamics):
    estimator = CdgpsEstimator(CdgpsConfiguration(dynamics=dynamics))
    is_in_orbit = estimator.configuration.chief_motion == "orbital"
    assert rehearse(estimator, is_in_orbit=is_in_orbit).solution >= SOLUTION_FLOAT


def test_a_rehearsal_of_the_paper():
    estimator = PaperEstimator(PaperConfiguration(start_duration=3.0))
    assert rehearse(estimator).solution >= SOLUTION_FLOAT

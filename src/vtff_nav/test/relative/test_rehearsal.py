"""After a rehearsal an estimator compiles nothing more: a node in real time would wait for it."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

import pytest
from cdgps_test_support import configuration, fly, simulate

import vtff_nav.relative
from vtff_dynamics.orbit import harmonics
from vtff_gnss.orbits import compiled_sight
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.dynamics import DYNAMICS
from vtff_nav.relative.common.solution import SOLUTION_FLOAT
from vtff_nav.relative.integers.least_squares import compile_kernels
from vtff_nav.relative.paper.configuration import PaperConfiguration
from vtff_nav.relative.paper.estimator import PaperEstimator
from vtff_nav.relative.rehearsal import rehearse


def compiled_forms() -> dict[str, int]:
    """Return how many forms of each compiled function there are."""
    modules: list[ModuleType] = [harmonics, compiled_sight]
    for found in pkgutil.walk_packages(vtff_nav.relative.__path__, "vtff_nav.relative."):
        modules.append(importlib.import_module(found.name))
    forms = {}
    for module in modules:
        for name, value in vars(module).items():
            signatures = getattr(value, "signatures", None)
            if signatures is None and hasattr(value, "find_dispatcher"):
                signatures = value.find_dispatcher().signatures
            if isinstance(signatures, list):
                forms[f"{module.__name__}.{name}"] = len(signatures)
    return forms


def test_nothing_is_compiled_after_a_rehearsal():
    compile_kernels()
    rehearse(CdgpsEstimator(configuration()))
    scenario = simulate(30)
    before = compiled_forms()
    assert before["vtff_nav.relative.kernels.motion.advance_pair"] > 0
    assert before["vtff_nav.relative.kernels.noise.update_models"] > 0
    fly(scenario, configuration())
    assert compiled_forms() == before


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_a_rehearsal_gives_solutions(dynamics):
    estimator = CdgpsEstimator(CdgpsConfiguration(dynamics=dynamics))
    is_in_orbit = estimator.configuration.chief_motion == "orbital"
    assert rehearse(estimator, is_in_orbit=is_in_orbit).solution >= SOLUTION_FLOAT


def test_a_rehearsal_of_the_paper():
    estimator = PaperEstimator(PaperConfiguration(start_duration=3.0))
    assert rehearse(estimator).solution >= SOLUTION_FLOAT

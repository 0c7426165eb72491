"""The estimator on board is compiled before its first sample."""

import subprocess
import sys

COMPILED_BEFORE_THE_FIRST_SAMPLE = """
import numpy as np
from compiled_forms import compiled_forms
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.onboard import (
    ModuleReport, OnboardAttitudeEstimator, process_synthetic_samples,
)

body, configuration = BodyModel(), AttitudeFilterConfiguration()
process_synthetic_samples(OnboardAttitudeEstimator(body, configuration))
before = compiled_forms()
estimator = OnboardAttitudeEstimator(body, configuration)
state = np.array([0.0, 7.0e6, 0.0, 0.0, 0.0, 7.5e3])
for number in range(100):
    angle = 2e-3 * number
    field = 3e-5 * np.array([np.cos(angle), 0.2, np.sin(angle)])
    samples = np.array([field, field]) + 1e-8 * number
    report = ModuleReport(5.0, samples, (0.8, 0.0), -200.0, -210.0, np.array([0.0, 0.5, -0.1]))
    known = estimator.process(report, state, field, field)
assert known.estimate is not None and known.field_is_valid
assert before and compiled_forms() == before, (before, compiled_forms())
"""


def test_nothing_is_left_to_compile_for_the_first_sample():
    """In a process of its own: other tests have compiled everything here."""
    program = f"import sys; sys.path[:0] = {sys.path!r}\n{COMPILED_BEFORE_THE_FIRST_SAMPLE}"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr

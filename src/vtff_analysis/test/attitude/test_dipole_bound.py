"""The bound of Cramer and Rao for a dipole, against closed forms and the paper's estimator."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_analysis.attitude.dipole_bound import dipole_bound
from vtff_analysis.attitude.snap1 import fly_dipole_estimation

SIGMA, PERIOD, FIELD = 5e-4, 5.0, 3e-5


def test_across_a_field_that_stays_it_is_that_of_a_regression_line():
    """At rest without wheel a dipole y in a field along x turns z: the rate is a line in time."""
    samples = 60
    still, field = np.zeros((samples + 1, 3)), np.tile([FIELD, 0.0, 0.0], (samples + 1, 1))
    # A last field along y lets the dipole along x be known at all.
    field[-1] = (0.0, FIELD, 0.0)
    inertia = np.diag([0.05, 0.06, 0.07])
    bound = dipole_bound(still, field, PERIOD, inertia, np.zeros(3), SIGMA)
    slope_sigma = SIGMA * np.sqrt(12.0 / (samples * (samples**2 - 1.0))) / PERIOD
    assert np.sqrt(bound[2, 2]) == pytest.approx(0.06 / FIELD * slope_sigma, rel=0.02)
    with pytest.raises(np.linalg.LinAlgError):
        dipole_bound(still[:1], field[:1], PERIOD, inertia, np.zeros(3), SIGMA)


@pytest.mark.parametrize("wheel_rpm", [0.0, -2700.0])
def test_sigmas_of_the_estimator_stand_above_the_bound(wheel_rpm):
    """Its model has noise that the samples have not: a few hundredths to a fifth more."""
    result = fly_dipole_estimation(wheel_rpm, 120, seed=601)
    ratio = result.sigma[-1] / np.sqrt(np.diag(result.bound(120)))
    assert (ratio > 0.98).all() and (ratio < 1.3).all()

"""The virtual orbit of a chief that thrusts."""

import numpy as np
import pytest

from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.time.timescales import GpsTime
from vtff_nav.relative.reference_orbit import ReferenceOrbit

START = GpsTime(1_142_557_200 * 10**9)
CHIEF = np.array([6928137.0, 0.0, 0.0, 0.0, 3792.5442661521847, 6568.879358929605])
MODEL = ForceModel("spherical_harmonics", 8, 8)


def orbit(**changes):
    return ReferenceOrbit(MODEL, **{"settling_time": 0.0, **changes})


def test_a_chief_without_errors_stays_on_its_orbit():
    followed, truth = orbit(), Propagator(START, CHIEF, MODEL)
    for second in range(120):
        state, reference = followed.follow(START + float(second), truth.state_gcrf)
        truth.advance()
    assert np.abs(state[:3]).max() < 1e-4
    assert np.abs(state[3:]).max() < 1e-6
    assert np.linalg.norm(reference[:3]) == pytest.approx(6928137.0, abs=20e3)


def test_where_the_chief_is():
    followed = orbit()
    followed.follow(START, CHIEF)
    moved = np.array([1.0, -2.0, 3.0, 0.01, 0.02, -0.03])
    state, _ = orbit().follow(START, CHIEF)
    assert not state.any()
    state, _ = followed.follow(START, deputy_state_gcrf(CHIEF, moved))
    assert state == pytest.approx(moved, abs=1e-6)


def test_it_begins_when_navigation_has_settled():
    followed = orbit(settling_time=30.0)
    assert followed.follow(START, CHIEF) is None
    assert followed.follow(START + 29.0, CHIEF) is None
    assert followed.follow(START + 30.0, CHIEF) is not None
    # A jump back in time begins it anew.
    assert followed.follow(START, CHIEF) is None


@pytest.mark.parametrize(
    ("changes", "text"),
    [({"settling_time": -1.0}, "settling_time"), ({"longest_step": 0.0}, "longest_step")],
)
def test_wrong_settings_are_refused(changes, text):
    with pytest.raises(ValueError, match=text):
        orbit(**changes)


def test_a_state_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="chief_gcrf"):
        orbit().follow(START, [np.nan] * 6)

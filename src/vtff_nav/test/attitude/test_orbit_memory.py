"""The orbit as attitude needs it: exact where it came, predicted where it did not."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.time.timescales import parse_epoch
from vtff_nav.attitude.orbit_memory import OrbitMemory

EPOCH = parse_epoch("2001-02-08T00:00:00 UTC")
TRACK = OrbitTrack(EPOCH, ClassicalElements(7.082e6, 1e-3, 1.71, 1.0, 0.5, 0.0).to_state())


def stamp(number: int) -> int:
    return TRACK.time(number).to_unix_nanoseconds()


def test_a_missing_state_is_predicted_and_its_field_is_that_of_the_orbit():
    memory = OrbitMemory()
    assert memory.at(stamp(0)) is None
    for number in range(3):
        memory.add(stamp(number), TRACK.state_gcrf(number))
    memory.add(stamp(3), np.full(6, np.nan))  # no navigation
    assert memory.has(stamp(2)) and not memory.has(stamp(3))
    for number in (2, 3, 40):
        point = memory.at(stamp(number))
        assert np.linalg.norm((point.state_gcrf - TRACK.state_gcrf(number))[:3]) < 1e-2
        np.testing.assert_allclose(point.field_gcrf, TRACK.field_gcrf(number), atol=1e-13)


def test_a_prediction_ends_and_old_states_are_forgotten():
    memory = OrbitMemory(longest_prediction=100.0, kept=5)
    for number in range(20):
        memory.add(stamp(number), TRACK.state_gcrf(number))
    assert memory.at(stamp(14)) is None and memory.at(stamp(15)) is not None
    assert memory.at(stamp(60)) is None


@pytest.mark.parametrize("state", [np.zeros(5), np.full(6, np.inf)])
def test_what_is_no_state_is_ignored(state):
    memory = OrbitMemory()
    memory.add(stamp(0), state)
    assert memory.at(stamp(0)) is None

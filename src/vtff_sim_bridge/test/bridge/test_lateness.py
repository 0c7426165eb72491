"""Lateness of steps: what counts, when a late phase begins, and the limit."""

import pytest

from vtff_sim_bridge.bridge.lateness import Lateness


def test_a_late_phase_begins_once():
    lateness = Lateness(step=2.0, maximum_steps=2.0)
    begins = [lateness.note(delay) for delay in (0.1, 1.0, 1.1, 3.0, 0.2, 1.5)]
    assert begins == [False, False, True, False, False, True]
    assert lateness.late_steps == 3
    assert lateness.largest == 3.0
    assert lateness.is_late


@pytest.mark.parametrize(
    ("maximum_steps", "delay", "exceeds"),
    [(2.0, 3.9, False), (2.0, 4.1, True), (0.0, 1e6, False), (0.5, 1.01, True), (2.0, 0.0, False)],
)
def test_the_limit_is_in_steps(maximum_steps, delay, exceeds):
    assert Lateness(step=2.0, maximum_steps=maximum_steps).exceeds_limit(delay) is exceeds

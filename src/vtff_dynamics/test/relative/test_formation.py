"""A formation: shapes and units are checked, and it moves as its spacecraft do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.relative.formation import Formation
from vtff_dynamics.time.timescales import parse_epoch

EPOCH = parse_epoch("2016-03-21T01:00:00 GPS")
AHEAD = {"deputy": [0.0, 100.0, 0.0, 0.0, 0.0, 0.0]}


def on_orbit(radius=6.871e6, inclination=0.5, deputies=AHEAD):
    return Formation.on_circular_orbit(EPOCH, radius, inclination, deputies)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"radius": 6871.0}, r"radius: expected .* m; got 6871 \(is it in km\?\)"),
        ({"inclination": 45.0}, r"inclination: expected radians .*got 45 \(is it in degrees\?\)"),
        ({"deputies": {"d": np.zeros((6, 1))}}, r"\['d'\]: expected .* \(6,\); got shape \(6, 1\)"),
        ({"deputies": {"d": [0.0, 8e6, 0, 0, 0, 0]}}, "below the chief's radius .*got 8e"),
        ({"deputies": {"d": [0.0, math.nan, 0, 0, 0, 0]}}, "finite .*got .*nan"),
        ({"deputies": {"d": "text"}}, "got .*text"),
        ({"deputies": {"d": [0, 1e3, 0, 0, 2e4, 0]}}, r"\['d'\], in GCRF: expected a speed"),
    ],
)
def test_wrong_unit_or_shape_is_told(arguments, text):
    with pytest.raises(ValueError, match=text):
        on_orbit(**arguments)


@pytest.mark.parametrize(
    ("factors", "text"),
    [
        ((1e-3, 1.0), r"state_chief_gcrf: .*\(is it in km\?\)"),
        ((1.0, 1e-3), r"state_chief_gcrf: .*\(is it in km/s\?\)"),
    ],
)
def test_state_of_the_chief_in_kilometres_is_told(factors, text):
    state = on_orbit().state_chief_gcrf * np.repeat(factors, 3)
    with pytest.raises(ValueError, match=text):
        Formation(EPOCH, state, {})


def test_time_of_another_kind_is_told():
    with pytest.raises(ValueError, match="time: expected a GpsTime; got float"):
        Formation(1.0, on_orbit().state_chief_gcrf, {})


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan])
def test_wrong_duration_is_told(duration):
    with pytest.raises(ValueError, match="duration: expected positive seconds"):
        on_orbit().after(duration)


def test_moves_as_its_spacecraft():
    later = on_orbit().after(25.5)
    chief = on_orbit().state_chief_gcrf
    states = []
    for start in (chief, deputy_state_gcrf(chief, np.array(AHEAD["deputy"]))):
        propagator = Propagator(EPOCH, start, step=0.5)
        for _ in range(51):
            propagator.advance()
        states.append(propagator.state_gcrf)
    assert later.time == EPOCH + 25.5
    np.testing.assert_allclose(later.state_chief_gcrf, states[0], atol=1e-5)
    expected = relative_state_rtn(*states)
    np.testing.assert_allclose(later.relative_states_rtn["deputy"], expected, atol=1e-5)
    np.testing.assert_allclose(later.state_gcrf("deputy"), states[1], atol=1e-5)

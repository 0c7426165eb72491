"""Clusters that orbits hold."""

import itertools
import math

import numpy as np
import pytest

from vtff_control.cluster.elements_field import SHAPES, ElementsField, JoiningField
from vtff_control.cluster.potential_field import equilibrium_distance
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import (
    osculating_elements,
    state_from_elements,
)
from vtff_dynamics.relative.motion import hcw_transition_matrix
from vtff_dynamics.relative.relative_elements import elements_of_deputy
from vtff_dynamics.relative.transition import j2_transition_matrix

AXIS = 6678e3
MEAN_MOTION = math.sqrt(GM_EARTH / AXIS**3)
PERIOD = 2.0 * math.pi / MEAN_MOTION
# At the ascending node, where latitude counts from.
CENTRE = np.array([AXIS, 0.0, 0.0, 0.0, math.radians(51.6), 0.3])
SIDE = equilibrium_distance()
# Eccentricity vectors of a triangle with sides of 1.
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)]])


def craft(elements):
    """Return states in GCRF of mean relative elements that do not drift apart under J2, (m, 6)."""
    drift = j2_transition_matrix(CENTRE, PERIOD)[1]
    states = []
    for wanted in np.array(elements, dtype=float):
        wanted[0] -= wanted[2:] @ drift[2:] / drift[0]
        mean = elements_of_deputy(CENTRE, wanted)
        states.append(state_from_elements(osculating_elements(mean)))
    return np.array(states)


def seen(states, own=0):
    """Return the states of the others in the RTN frame of one, (m - 1, 6)."""
    others = np.delete(states, own, axis=0)
    return np.array([relative_state_rtn(states[own], other) for other in others])


def changed(states, own, impulse):
    """Return all states after a velocity change of one in its RTN frame, m/s."""
    after = states.copy()
    after[own, 3:] += rotation_gcrf_to_rtn(states[own]).T @ impulse
    return after


def triangle(shape):
    """Return the elements of three members at the equilibrium of a shape, (3, 6)."""
    elements = np.zeros((3, 6))
    if shape == "circle":
        elements[:, 2:4] = 0.5 * SIDE * CORNERS
        elements[:, 4:] = math.sqrt(3.0) * elements[:, [3, 2]] * [-1.0, 1.0]
    else:
        elements[:, 2:4] = SIDE * CORNERS
        elements[:, 4:] = elements[:, 2:4] if shape == "helix" else 0.0
    return elements


def distances(states, orbits=1.0):
    """Return the distances of all pairs in nonlinear motion under J2, (k, pairs)."""
    # A nodal period is shorter than a Keplerian one by a share of 0.001.
    flown = free_flight(states, np.linspace(0.0, orbits * PERIOD, int(541 * orbits)))[..., :3]
    pairs = itertools.combinations(range(len(states)), 2)
    return np.array([np.linalg.norm(flown[:, j] - flown[:, i], axis=1) for i, j in pairs]).T


def at_rest(positions):
    """Return states at rest about the first, (m, 6), of positions in its RTN frame, (m, 3)."""
    lead = craft(np.zeros((1, 6)))[0]
    to_gcrf = rotation_gcrf_to_rtn(lead).T
    omega = np.cross(lead[:3], lead[3:]) / (lead[:3] @ lead[:3])
    places = np.asarray(positions) @ to_gcrf.T
    return np.hstack((lead[:3] + places, lead[3:] + np.cross(omega, places)))


@pytest.mark.parametrize("shape", SHAPES)
def test_triangle_needs_no_thrust_and_keeps_its_distance(shape):
    states = craft(triangle(shape))
    apart = distances(states, 3.0)
    assert apart.min() == pytest.approx(SIDE, rel=0.03)
    if shape == "circle":
        np.testing.assert_allclose(apart, SIDE, rtol=0.03)
    for own in range(3):
        impulse = ElementsField(shape).impulse(seen(states, own), states[own], 30.0)
        # Curvature and what mean elements leave out are some metres, of which a share is taken.
        assert np.abs(impulse).max() < 1e-4


def test_a_cluster_at_rest_joins_without_drift():
    generator = np.random.default_rng(7)
    for _ in range(8):
        angle = generator.uniform(0.0, 2.0 * math.pi)
        turned = CORNERS @ [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
        rest = at_rest(np.hstack((SIDE * turned, np.zeros((3, 1)))))
        states = rest
        # The lead does not thrust, and the others are known to do so.
        hold = np.array([[0.0, 0.0, 0.0], [2e-3, 0.0, 0.0]])
        for own in (1, 2):
            change = ElementsField().join(seen(rest, own), rest[own], thrusts=hold)
            states = changed(states, own, change)
        apart = distances(states, 3.0)
        assert apart.min() >= 0.48 * SIDE
        # Some 25 m an orbit, by the curvature of the orbit.
        first, last = apart[:541].max(axis=0), apart[-541:].max(axis=0)
        np.testing.assert_allclose(last, first, atol=80.0)


@pytest.mark.parametrize("shape", SHAPES)
def test_orbits_are_joined_from_places_where_they_belong(shape):
    """Joined from a triangle at rest, two members one behind the other would come to 432 m."""
    field, rest = ElementsField(shape), ElementsField(shape).at_rest
    assert isinstance(rest, JoiningField)
    # One of the sides along the track.
    relative = np.zeros((3, 6))
    relative[:, :2] = SIDE * CORNERS[:, ::-1]
    own_state = craft(np.zeros((1, 6)))[0]
    transition = hcw_transition_matrix(MEAN_MOTION, 30.0)
    for _ in range(60):
        impulses = np.zeros((3, 3))
        for own in (1, 2):
            others = np.delete(relative, own, axis=0) - relative[own]
            impulses[own] = rest.impulse(others, own_state, 30.0)
        relative[:, 3:] += impulses
        relative = relative @ transition.T
    paths = relative[:, :3]
    assert min(np.linalg.norm(b - a) for a, b in itertools.combinations(paths, 2)) > 0.9 * SIDE
    states = joined = at_rest(paths)
    for own in (1, 2):
        hold = np.array([[0.0, 0.0, 0.0], [2e-3, 0.0, 0.0]])
        joined = changed(joined, own, field.join(seen(states, own), states[own], thrusts=hold))
    assert distances(joined).min() > 0.8 * SIDE
    straight = np.zeros((3, 3))
    straight[:, :2] = SIDE * CORNERS[:, ::-1]
    states = joined = at_rest(straight)
    for own in (1, 2):
        joined = changed(joined, own, field.join(seen(states, own), states[own], thrusts=hold))
    # A circle has its inclination in between, where the ellipse is narrow.
    assert shape == "circle" or distances(joined).min() < 0.6 * SIDE


def test_thrust_against_drift_distance_and_tilt():
    field = ElementsField("ellipse")
    elements = triangle("ellipse")

    def impulse(wanted, *arguments, shape="ellipse"):
        """Return the change of the first of members with these elements."""
        states = craft(wanted)
        return ElementsField(shape).impulse(seen(states), states[0], 30.0, *arguments)

    still = impulse(elements)
    higher = elements.copy()
    higher[1:, 0] += 40.0
    # The others are higher: speed up by as much as a small share of n da / 2.
    change = impulse(higher) - still
    share = max(field.quiet_share, 40.0 / field.reach)
    assert change[1] == pytest.approx(share * 0.5 * MEAN_MOTION * 40.0, rel=0.05)
    assert abs(change[2]) < 1e-6
    # The others are ahead by 80 m: a lower orbit catches up.
    ahead = elements.copy()
    ahead[1:, 1] += 80.0
    lower = 80.0 / (1.5 * MEAN_MOTION * field.drift_time)
    share = max(field.quiet_share, lower / field.reach)
    change = impulse(ahead) - still
    assert change[1] == pytest.approx(-share * 0.5 * MEAN_MOTION * lower, rel=0.1)
    # One member whose ellipse is too narrow: both go apart, at once.
    near = np.zeros((2, 6))
    near[1, 3] = 0.5 * SIDE
    away = impulse(near)
    states = craft(near)
    assert distances(changed(states, 0, away)).min() > distances(states).min() + 10.0
    # One that is not followed only repels.
    both = np.vstack((near, np.zeros((1, 6))))
    both[2, 3] = 3.0 * SIDE
    np.testing.assert_allclose(impulse(both, [True, False]), away, rtol=5e-3, atol=1e-6)
    # It repels where it is near along the track, or will be before half an orbit is over.
    drifting = np.vstack((elements, np.zeros((1, 6))))
    for forward, height, repels in ((0.0, 0.0, 1), (4e3, 0.0, 0), (4e3, 8e2, 1), (4e3, -8e2, 0)):
        drifting[3] = [height, forward, height, 0.3 * SIDE, 0.0, 0.0]
        change = impulse(drifting, [True, True, False])
        assert (abs(change[0]) > 0.005) == repels, (forward, height, change)
    assert not field.impulse(np.zeros((0, 6)), craft(np.zeros((1, 6)))[0], 30.0).any()
    # A circle wants its inclination.
    tilted = impulse(elements, shape="circle")
    assert abs(still[2]) < 1e-6 and abs(tilted[2]) > 1e-3


def test_shape_and_density():
    with pytest.raises(ValueError, match="shape"):
        ElementsField("square")
    field = ElementsField()
    assert field.thrust_density(np.zeros(3), 30.0) == field.acceleration_density
    assert field.thrust_density(np.array([0.03, 0.0, 0.04]), 25.0) == pytest.approx(0.01, rel=1e-3)

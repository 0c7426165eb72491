"""Clusters that orbits hold."""

import itertools
import math

import numpy as np
import pytest

from vtff_control.cluster.elements_field import SHAPES, ElementsField
from vtff_control.cluster.potential_field import equilibrium_distance
from vtff_dynamics.relative.motion import hcw_transition_matrix
from vtff_dynamics.relative.relative_elements import linear_map_rtn

MEAN_MOTION = 1.15e-3
SIDE = equilibrium_distance()
# Eccentricity vectors of a triangle with sides of 1.
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)]])


def states_of(elements):
    """Return relative states of relative elements at latitude 0, (m, 6)."""
    return np.asarray(elements) @ linear_map_rtn(MEAN_MOTION, 0.0).T


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


def distances(states):
    """Return the distances of all pairs over an orbit, (k, pairs)."""
    times = np.linspace(0.0, 2.0 * math.pi / MEAN_MOTION, 181)
    paths = np.array([states @ hcw_transition_matrix(MEAN_MOTION, t).T for t in times])[..., :3]
    pairs = itertools.combinations(range(len(states)), 2)
    return np.array([np.linalg.norm(paths[:, j] - paths[:, i], axis=1) for i, j in pairs]).T


@pytest.mark.parametrize("shape", SHAPES)
def test_triangle_needs_no_thrust_and_keeps_its_distance(shape):
    states = states_of(triangle(shape))
    apart = distances(states)
    assert apart.min() == pytest.approx(SIDE, rel=1e-3)
    if shape == "circle":
        np.testing.assert_allclose(apart, SIDE, rtol=1e-9)
    for own in range(3):
        neighbours = np.delete(states, own, axis=0) - states[own]
        assert np.abs(ElementsField(shape).impulse(neighbours, MEAN_MOTION, 30.0)).max() < 1e-9


def test_a_cluster_at_rest_joins_without_drift():
    generator = np.random.default_rng(7)
    for _ in range(20):
        angle = generator.uniform(0.0, 2.0 * math.pi)
        turned = CORNERS @ [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
        states = np.zeros((3, 6))
        states[:, :2] = SIDE * turned
        # The lead does not thrust; each other one goes round both that it sees.
        changes = np.zeros((3, 3))
        for own in (1, 2):
            neighbours = np.delete(states, own, axis=0) - states[own]
            changes[own] = ElementsField().join(neighbours, MEAN_MOTION, [own != 0, False])
        states[:, 3:] += changes
        apart = distances(states)
        np.testing.assert_allclose(apart[-1], apart[0], rtol=1e-6)
        assert apart.min() >= 0.499 * SIDE


def test_thrust_against_drift_distance_and_tilt():
    field = ElementsField("ellipse")
    elements = triangle("ellipse")[1:]
    higher = elements.copy()
    higher[:, 0] += 4.0
    # The others are higher: speed up by as much as a small share of n da / 2.
    change = field.impulse(states_of(higher), MEAN_MOTION, 30.0)
    assert change[1] == pytest.approx(field.quiet_share * 0.5 * MEAN_MOTION * 4.0)
    assert change[2] == 0.0
    # The others are ahead by 8 m: a lower orbit catches up.
    ahead = elements.copy()
    ahead[:, 1] += 8.0
    lower = 8.0 / (1.5 * MEAN_MOTION * field.drift_time)
    change = field.impulse(states_of(ahead), MEAN_MOTION, 30.0)
    assert change[1] == pytest.approx(-field.quiet_share * 0.5 * MEAN_MOTION * lower)
    # One member whose ellipse is too narrow: both go apart, at once.
    near = np.zeros((1, 6))
    near[0, 3] = 0.5 * SIDE
    away = field.impulse(states_of(near), MEAN_MOTION, 30.0)
    nearer = states_of(near) - np.concatenate((np.zeros(3), away))
    assert distances(np.vstack((np.zeros(6), nearer))).min() > 0.7 * SIDE
    # One that is not followed only repels.
    both = np.vstack((near, near))
    both[1, 3] = 3.0 * SIDE
    only_near = field.impulse(states_of(near), MEAN_MOTION, 30.0)
    far_ignored = field.impulse(states_of(both), MEAN_MOTION, 30.0, [True, False])
    np.testing.assert_allclose(far_ignored, only_near)
    # It repels where it is near along the track, or will be before half an orbit is over.
    drifting = np.vstack((states_of(triangle("ellipse")[1:]), np.zeros((1, 6))))
    for ahead, height, repels in ((0.0, 0.0, 1), (4e3, 0.0, 0), (4e3, 8e2, 1), (4e3, -8e2, 0)):
        drifting[2] = states_of(np.array([[height, ahead, height, 0.3 * SIDE, 0.0, 0.0]]))
        change = field.impulse(drifting, MEAN_MOTION, 30.0, [True, True, False])
        assert (abs(change[0]) > 0.1) == repels, (ahead, height)
    assert not field.impulse(np.zeros((0, 6)), MEAN_MOTION, 30.0).any()
    # A circle wants its inclination.
    flat = field.impulse(states_of(triangle("ellipse")[1:]), MEAN_MOTION, 30.0)
    tilted = ElementsField("circle").impulse(states_of(triangle("ellipse")[1:]), MEAN_MOTION, 30.0)
    assert flat[2] == 0.0 and abs(tilted[2]) > 1e-3


def test_shape_and_density():
    with pytest.raises(ValueError, match="shape"):
        ElementsField("square")
    field = ElementsField()
    assert field.thrust_density(np.zeros(3), 30.0) == field.acceleration_density
    assert field.thrust_density(np.array([0.03, 0.0, 0.04]), 25.0) == pytest.approx(0.01, rel=1e-3)

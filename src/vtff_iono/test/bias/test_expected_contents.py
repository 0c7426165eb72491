"""Columns of horizontal structure, and offsets of pierce points, by their plain formulas."""

import numpy as np
import pytest

from vtff_iono.bias.expected_contents import HorizontalLayers, Knots, pierce_offsets
from vtff_iono.geometry.mapping import pierce_point, shell_height

RAYS = 30
GENERATOR = np.random.default_rng(8)


def test_columns_are_products_of_weights_mappings_and_offsets():
    low, high = GENERATOR.normal(size=(2, RAYS, 2))
    mapping_low, mapping_high = GENERATOR.uniform(1.0, 3.0, (2, RAYS))
    time = np.sort(GENERATOR.uniform(0.0, 1300.0, RAYS))
    weights = Knots.over(time).weights(time)
    expected = []
    for mapping, offset in ((mapping_low, low), (mapping_high, high)):
        level = mapping[:, None] * weights
        expected += [level, level * offset[:, :1], level * offset[:, 1:]]
    layers = HorizontalLayers(low, high, mapping_high)
    found = layers.columns(weights, mapping_low, 2)
    assert found[:, :-2] == pytest.approx(np.hstack(expected), rel=1e-12)
    assert (found[:, -2:] == 0.0).all()
    sums = np.stack([column.sum(axis=1) for column in expected], axis=-1)
    assert layers.means(mapping_low) == pytest.approx(sums, rel=1e-12, abs=1e-15)


def test_offsets_are_components_to_the_east_and_to_the_north():
    position = GENERATOR.normal(size=(RAYS, 3))
    position *= 6.9e6 / np.linalg.norm(position, axis=1, keepdims=True)
    direction = position / 6.9e6 + 0.5 * GENERATOR.normal(size=(RAYS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    altitude = np.full(RAYS, 500e3)
    east = np.cross([0.0, 0.0, 1.0], position)
    north = np.cross(position, east)
    point = pierce_point(position, direction, altitude + 0.5 * shell_height(altitude))
    offset = (point - position) / 1e6
    expected = [(offset * axis).sum(1) / np.linalg.norm(axis, axis=1) for axis in (east, north)]
    found = pierce_offsets(position, direction, altitude)
    assert np.isfinite(found).sum() > RAYS
    assert found == pytest.approx(np.transpose(expected), abs=1e-12, nan_ok=True)

"""Window of the contents from which the crossing of a vertical edge is fitted."""

import pytest

from vtff_iono.edges.vertical_edges import choose_half_window


@pytest.mark.parametrize("distance", [15.0, 20.0, 35.0, 41.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_other_edge_lies_in_the_window(distance, sign):
    half_window = choose_half_window(100.0, [100.0, 100.0 + sign * distance, 400.0])
    assert 10.0 <= half_window < distance
    # Most of what is free is used: without samples a crossing in scintillation is uncertain.
    assert half_window > 0.6 * distance


@pytest.mark.parametrize(("edge_times", "half_window"), [([100.0], 40.0), ([100.0, 104.0], 10.0)])
def test_longest_and_shortest_window(edge_times, half_window):
    assert choose_half_window(100.0, edge_times) == half_window

"""Walls that are fitted at once are those that `fit_wall` finds one by one."""

import numpy as np
import pytest

from vtff_iono.edges.wall_fit import SMOOTH_WALL, WALL, fit_wall
from vtff_iono.edges.wall_search import MEANS, STEEPEST, find_walls, fit_places

LENGTH, SLOW_TIME, WALL_PLACE = 500.0, 100.0, 400e3


def profile(count=80):
    """Return samples of a climb through a wall, and what one satellite's slow error does."""
    second = np.arange(count, dtype=float)
    altitude = WALL_PLACE + 200.0 * (second - count / 2)
    density = np.where(altitude < WALL_PLACE, 1e11, 5e11)
    density += np.random.default_rng(3).normal(0.0, 3e9, count)
    sigmas = np.full(count, 3e9), np.full(count, 1e9)
    return np.column_stack((second, altitude, density, *sigmas)), np.full((count, 1), 2e9)


def test_fits_of_all_places_are_those_of_each():
    samples, slow = profile()
    places = WALL_PLACE + np.array([-300.0, 0.0, 4000.0])
    widths, passes, kinds = np.array([0.0, 2e3]), np.array([2, 3]), np.array([WALL, SMOOTH_WALL])
    fits = fit_places(samples, slow, 1.0, places, 3e3, widths, LENGTH, SLOW_TIME, 40, passes, kinds)
    for kind, times, width, place in np.ndindex(fits.shape[1:]):
        shape = places[place], 3e3, widths[width], LENGTH, SLOW_TIME, STEEPEST, 40, 0
        one = fit_wall(samples, slow, 1.0, *shape, int(passes[times]), int(kinds[kind]))
        found = fits[:, kind, times, width, place]
        assert one[0] and found.tolist() == [one[1], *one[3:]]


def test_a_wall_is_found_where_it_is_and_each_place_is_looked_at_once():
    samples, slow = profile()
    examined_to = np.full(1, -np.inf)
    arguments = np.array([0.0]), np.array([3e3]), examined_to, np.inf, False, 3, 5.0, 0.15
    walls = find_walls(samples, slow, 1.0, LENGTH, SLOW_TIME, *arguments)
    best = walls[np.argmax(walls[:, 5] / walls[:, 6])]
    assert best[2] == pytest.approx(WALL_PLACE, abs=200.0)
    assert best[5] == pytest.approx(4e11, rel=0.05)
    window = slice(*np.searchsorted(samples[:, 1], (best[2] - 3e3, best[2] + 3e3)))
    shape = best[2], 3e3, 0.0, LENGTH, SLOW_TIME, STEEPEST, MEANS, 3, 1, WALL
    assert best[3:9].tolist() == list(fit_wall(samples[window], slow[window], 1.0, *shape)[1:7])
    assert examined_to[0] == samples[-1, 1]
    assert len(find_walls(samples, slow, 1.0, LENGTH, SLOW_TIME, *arguments)) == 0

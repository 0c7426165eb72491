"""Sigmas of a point: those of the measurements, greater only by a misfit that can be seen."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_sim_bridge.receiver.point_solution import RangeEquations, solve_points

DIRECTION = np.array(
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-0.6, 0.0, -0.8], [0.0, -0.8, 0.6]]
)


def equations(count, excess=0.0):
    return RangeEquations(
        direction=DIRECTION[:count],
        excess=np.full((1, count), excess) * np.arange(count),
        sigma=np.full((1, count), 2.0),
        system=np.zeros(count, dtype=int),
        systems=np.zeros(1, dtype=int),
    )


def stated_sigma(count):
    design = np.column_stack((-DIRECTION[:count], np.ones(count)))
    return 2.0 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[:3]


@pytest.mark.parametrize("count", [4, 5])
def test_sigma_is_that_of_the_measurements_where_they_agree(count):
    (solution,) = solve_points(equations(count)) or ()
    np.testing.assert_allclose(solution.sigma, stated_sigma(count), rtol=1e-12)


def test_a_misfit_makes_the_sigma_greater():
    (solution,) = solve_points(equations(5, excess=30.0)) or ()
    assert (solution.sigma > 2.0 * stated_sigma(5)).all()


def test_too_few_satellites_have_no_solution():
    assert solve_points(equations(3)) is None

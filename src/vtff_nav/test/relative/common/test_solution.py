"""Solutions: what may be published, and the solution of an estimator that has none."""

import dataclasses

import numpy as np
import pytest

from vtff_dynamics.time.timescales import GpsTime
from vtff_nav.relative.common.solution import (
    SOLUTION_FIXED,
    SOLUTION_NONE,
    RelativeSolution,
    check_solution,
)

TIME = GpsTime(10**18)
SIZES = {"position": (3,), "velocity": (3,), "covariance": (6, 6)}


def arrays():
    """Names and shapes of the arrays: positions and velocities of 3, covariances of 6 numbers."""
    shapes = {}
    for field in dataclasses.fields(RelativeSolution):
        kind = field.name.split("_")[0]
        if kind in SIZES:
            shapes[field.name] = (3, 3) if "covariance_position" in field.name else SIZES[kind]
    return shapes


@pytest.fixture
def solution():
    zeros = {name: np.zeros(shape) for name, shape in arrays().items()}
    return dataclasses.replace(RelativeSolution.none(TIME, ()), solution=SOLUTION_FIXED, **zeros)


def test_without_a_solution_nothing_is_known_and_nothing_is_old():
    none = RelativeSolution.none(TIME, ("no observations",))
    check_solution(none)
    assert (none.solution, none.age, none.degraded) == (SOLUTION_NONE, 0.0, ("no observations",))
    assert all(np.isnan(getattr(none, name)).all() for name in arrays())
    assert RelativeSolution.none(TIME, (), 12.0).age == 12.0


@pytest.mark.parametrize("name", arrays())
def test_arrays_have_their_shape_and_finite_numbers(solution, name):
    check_solution(solution)
    array = getattr(solution, name)
    for wrong in (array[:-1], np.vstack((array, array)), array.astype(str)):
        with pytest.raises(ValueError, match=f"{name}: numbers of shape"):
            check_solution(dataclasses.replace(solution, **{name: wrong}))
    spoiled = array.copy()
    spoiled.flat[-1] = np.inf
    with pytest.raises(ValueError, match=f"{name}: not finite"):
        check_solution(dataclasses.replace(solution, **{name: spoiled}))


def test_only_solutions_of_a_known_kind(solution):
    with pytest.raises(ValueError, match="RelativeSolution is expected, got dict"):
        check_solution({})
    with pytest.raises(ValueError, match="solution: 99"):
        check_solution(dataclasses.replace(solution, solution=99))

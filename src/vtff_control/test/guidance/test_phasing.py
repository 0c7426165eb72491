"""Phasing: against impulses, bang-bang bounds, and what is impossible."""

import math

import pytest

from vtff_control.guidance.phasing import (
    InfeasiblePhasingError,
    impulsive_phasing_velocity,
    least_phasing_orbits,
    phase,
)

AXIS = 7153100.0
ANGLE = math.radians(10.0)


def test_numbers_of_paper_002():
    assert impulsive_phasing_velocity(AXIS, ANGLE, 15.0) == pytest.approx(9.22, rel=0.01)
    assert phase(AXIS, ANGLE, 15.0, 2.15e-4).velocity_change == pytest.approx(15.0, rel=0.01)
    engine = 25e-3 / 1600.0
    least = least_phasing_orbits(AXIS, ANGLE, engine)
    assert least == pytest.approx(54.2, rel=0.01)
    assert phase(AXIS, ANGLE, 1.000001 * least, engine).velocity_change == pytest.approx(
        5.1, rel=0.01
    )
    with pytest.raises(InfeasiblePhasingError, match=r"at least 271\.\d orbits"):
        phase(AXIS, ANGLE, 15.0, 1e-3 / 1600.0)


def test_strong_thrust_is_two_impulses():
    phasing = phase(AXIS, ANGLE, 30.0, 1.0)
    assert phasing.velocity_change == pytest.approx(
        impulsive_phasing_velocity(AXIS, ANGLE, 30.0), rel=0.01
    )
    assert phasing.semi_major_axis_change < 0.0
    behind = phase(AXIS, -ANGLE, 30.0, 1.0)
    assert behind.semi_major_axis_change == -phasing.semi_major_axis_change

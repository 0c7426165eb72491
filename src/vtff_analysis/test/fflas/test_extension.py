"""Phasing flown by the paper's equation, tables 3 and 5, and the deorbit."""

import math

import pytest

from vtff_analysis.fflas.extension import (
    TABLE_3,
    deorbit,
    extension_years,
    fly_phasing,
    separation_inputs,
)
from vtff_analysis.studies.formation_designs import FFLAS_AXIS
from vtff_control.guidance.phasing import phase


def test_phasing_flown_by_equation_1():
    phasing = phase(FFLAS_AXIS, math.radians(10.0), 15.0, 2.15e-4)
    flight = fly_phasing(phasing)
    assert math.degrees(flight.angle[-1]) == pytest.approx(10.0, rel=0.01)
    assert flight.semi_major_axis[-1] == pytest.approx(FFLAS_AXIS, abs=30.0)
    lowest = flight.semi_major_axis.min() - FFLAS_AXIS
    assert lowest == pytest.approx(phasing.semi_major_axis_change, rel=0.01)
    assert lowest == pytest.approx(-14.4e3, rel=0.01)


@pytest.mark.parametrize(("percent", "years"), [(1, 2.1), (2, 4.2), (3, 6.3), (4, 8.4), (5, 10.5)])
def test_table_5_by_its_own_cost(percent, years):
    assert extension_years(percent, 0.030) == pytest.approx(years, rel=0.02)


def test_no_single_input_gives_table_3():
    axes, drags = zip(*(separation_inputs(*entry) for entry in TABLE_3.items()), strict=True)
    assert max(axes) / min(axes) > 3.0
    assert max(drags) / min(drags) > 3.0


def test_deorbit():
    one, four = deorbit(25e-3, 1600.0), deorbit(0.1, 1600.0)
    assert one.velocity_change == pytest.approx(367.0, rel=0.002)
    assert one.days == pytest.approx(272.0, rel=0.002)
    assert four.days == pytest.approx(68.0, rel=0.002)

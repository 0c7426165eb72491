"""Angles."""

import math

from hypothesis import given
from hypothesis import strategies as st

from vtff_dynamics.angles import wrap_angle


@given(st.floats(-1e4, 1e4))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    assert abs(math.remainder(wrapped - angle, 2.0 * math.pi)) < 1e-11


def test_half_a_turn_is_negative():
    assert wrap_angle(math.pi) == wrap_angle(-math.pi) == -math.pi

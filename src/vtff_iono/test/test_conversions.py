"""State that is believed when relative navigation and the receivers disagree."""

import numpy as np
import pytest

from vtff_dynamics.time.timescales import GpsTime
from vtff_iono.conversions import (
    block_from_messages,
    boundary_to_message,
    second_from_messages,
)
from vtff_iono.edges.boundary import NO_SYSTEM, Boundary, BoundaryKind, BoundarySource
from vtff_iono.spacecraft.navigation_choice import NavigationChoice
from vtff_msgs.msg import AmbiguityStatus, GnssFix, IrregularityBoundary, RelativeState

TIME = GpsTime.from_week_tow(1889, 90_000.0)
NOTHING = block_from_messages([])
POSITION = np.array([6.7e6, 0.0, 0.0])
VELOCITY = np.array([0.0, 7.5e3, 0.0])


def relative_state():
    message = RelativeState()
    message.solution = RelativeState.SOLUTION_FIXED
    message.position_chief_gcrf = POSITION
    message.velocity_chief_gcrf = VELOCITY
    message.position = np.array([-1000.0, -15000.0, 0.0])
    message.velocity = np.zeros(3)
    unix = TIME.to_unix_nanoseconds()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(unix, 10**9)
    return message


def ambiguities():
    message = AmbiguityStatus()
    for name, value in (("system", 0), ("band", 1), ("attribute", 67), ("prn", 5)):
        setattr(message, name, [value])
    message.ambiguity_cycles = [3.0]
    message.state = [AmbiguityStatus.STATE_FIXED]
    return message


def fix(state, shift):
    message = GnssFix()
    message.position, message.velocity = state[:3] + [shift, 0.0, 0.0], state[3:]
    return message


def second(relative, fixes, choice=None, time=TIME):
    return second_from_messages(
        time, (NOTHING, NOTHING), [relative], [ambiguities()], fixes, choice or NavigationChoice()
    )


@pytest.mark.parametrize(("shift", "is_lost"), [(15.0, False), (300.0, True)])
def test_fixes_overrule_relative_navigation_that_is_lost(shift, is_lost):
    told = second(relative_state(), [None, None])
    assert len(told.integers[0]) == 1
    fixes = [fix(state, shift) for state in told.states_itrf]
    choice = NavigationChoice()
    for elapsed in range(121):
        result = second(relative_state(), fixes, choice, TIME + float(elapsed))
    expected = [fixes[n].position if is_lost else told.states_itrf[n][:3] for n in (0, 1)]
    for state, position in zip(result.states_itrf, expected, strict=True):
        assert state[:3] == pytest.approx(position)
    assert (len(result.integers[0]) == 0) == is_lost


def test_navigation_is_not_overruled_by_fixes_that_err_for_seconds():
    """Fixes that are 300 m off in the fades of a bubble, now and then one that is right."""
    choice = NavigationChoice()
    told = second(relative_state(), [None, None])
    for elapsed in range(300):
        fixes = [fix(state, 0.0 if elapsed % 50 == 49 else 300.0) for state in told.states_itrf]
        result = second(relative_state(), fixes, choice, TIME + float(elapsed))
        assert result.states_itrf[1] == pytest.approx(told.states_itrf[1])
        assert len(result.integers[0]) == 1


def test_fixes_alone():
    told = second(relative_state(), [None, None])
    fixes = [fix(state, 0.0) for state in told.states_itrf]
    result = second(None, fixes)
    assert result.states_itrf[1] == pytest.approx(told.states_itrf[1])
    assert second(None, [None, None]).states_itrf == (None, None)


@pytest.mark.parametrize(
    ("prefix", "numbers"), [("KIND", BoundaryKind), ("SOURCE", BoundarySource)]
)
def test_numbers_of_boundaries_are_those_of_the_message(prefix, numbers):
    for member in numbers:
        assert member == getattr(IrregularityBoundary, f"{prefix}_{member.name}")


@pytest.mark.parametrize(("width", "sigma"), [(2400.0, 300.0), (np.nan, np.nan)])
def test_a_vertical_edge_tells_its_width(width, sigma):
    """An edge of a ray has none."""
    edge = Boundary(
        BoundaryKind.VERTICAL,
        BoundarySource.DENSITY,
        spacecraft=0,
        system=NO_SYSTEM,
        prn=0,
        time=TIME.nanoseconds,
        time_sigma=0.5,
        is_entry=True,
        position_itrf=POSITION,
        confidence=0.9,
        width=width,
        width_sigma=sigma,
    )
    message = boundary_to_message(edge, "chief", "deputy")
    assert [message.width, message.width_sigma] == pytest.approx([width, sigma], nan_ok=True)
    assert message.time_sigma == 0.5
    assert (message.spacecraft, message.child_frame_id) == ("chief", "deputy")

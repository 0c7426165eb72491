"""Solutions of the filters as messages: every column, with its unit and its length."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402

from vtff_dynamics.time.timescales import GpsTime  # noqa: E402
from vtff_gnss.constants import SYSTEM_GPS  # noqa: E402
from vtff_msgs.msg import AmbiguityStatus, LaserRange, RelativeState, SlantTec  # noqa: E402
from vtff_nav.relative.common import solution as kinds  # noqa: E402
from vtff_nav.relative.common.solution import (  # noqa: E402
    AMBIGUITY_FIXED,
    SOLUTION_FIXED,
    AmbiguityTable,
    DifferentialTecTable,
    RelativeSolution,
)
from vtff_nav.relative_conversions import (  # noqa: E402
    ambiguities_to_message,
    differential_tec_to_message,
    laser_from_message,
    relative_state_to_message,
)

TIME = GpsTime.from_week_tow(1889, 90000.0)


def bytes_of(*values):
    return np.array(values, dtype=np.uint8)


@pytest.fixture
def solution():
    covariance = np.arange(36.0).reshape(6, 6)
    return RelativeSolution(
        time=TIME,
        solution=SOLUTION_FIXED,
        position_rtn=np.array([1.0, 2.0, 3.0]),
        velocity_rtn=np.array([0.1, 0.2, 0.3]),
        covariance_rtn=covariance,
        position_itrf=np.zeros(3),
        covariance_position_itrf=np.eye(3),
        position_chief_gcrf=np.array([7e6, 0.0, 0.0]),
        velocity_chief_gcrf=np.array([0.0, 7.5e3, 0.0]),
        covariance_chief_gcrf=np.eye(6),
        satellites_used=9,
        ambiguities_fixed=2,
        ratio=12.5,
        success_rate=0.9995,
        innovation_rms=1.1,
        age=0.0,
        ambiguities=AmbiguityTable(
            system=bytes_of(SYSTEM_GPS, SYSTEM_GPS),
            prn=bytes_of(5, 7),
            band=bytes_of(1, 2),
            attribute=bytes_of(67, 87),
            reference_prn=bytes_of(9, 0),
            ambiguity_cycles=np.array([-12345678.0, 3.25]),
            ambiguity_sigma_cycles=np.array([0.02, 0.5]),
            state=bytes_of(AMBIGUITY_FIXED, 0),
            fixed_since=(TIME - 10.0, None),
        ),
        differential_tec=DifferentialTecTable(
            system=bytes_of(SYSTEM_GPS),
            prn=bytes_of(5),
            band_first=bytes_of(1),
            band_second=bytes_of(2),
            stec_tecu=np.array([-0.0123]),
            stec_sigma_tecu=np.array([0.004]),
            elevation=np.array([0.7]),
            azimuth=np.array([3.1]),
            arc=np.array([4], dtype=np.uint32),
        ),
    )


def round_trip(message, kind):
    return deserialize_message(serialize_message(message), kind)


def numbers_of(names_of, prefix):
    """Return the constants of a module or message class whose names have a prefix."""
    length = len(prefix)
    names = [name for name in dir(names_of) if name.startswith(prefix)]
    return {
        n[length:]: getattr(names_of, n) for n in names if isinstance(getattr(names_of, n), int)
    }


def test_numbers_are_those_of_the_messages():
    """The filters know no ROS, so the numbers of the messages stand a second time there."""
    solutions = numbers_of(RelativeState, "SOLUTION_")
    assert numbers_of(kinds, "SOLUTION_") == solutions
    assert set(solutions) >= {"NONE", "PREDICTED", "CODE", "FLOAT", "FIXED", "TRUTH"}
    assert numbers_of(kinds, "AMBIGUITY_") == numbers_of(AmbiguityStatus, "STATE_")
    names = {number: name.lower() for name, number in solutions.items() if name != "TRUTH"}
    assert dict(kinds.SOLUTION_NAMES) == names


def test_relative_state(solution):
    message = round_trip(relative_state_to_message(solution, "chief", "deputy"), RelativeState)
    assert message.header.frame_id == "chief/rtn"
    assert message.header.stamp.sec == TIME.to_unix_nanoseconds() // 10**9
    assert message.child_frame_id == "deputy"
    assert message.position.tolist() == [1.0, 2.0, 3.0]
    assert message.velocity.tolist() == [0.1, 0.2, 0.3]
    assert message.covariance.tolist() == list(range(36))
    assert message.position_chief_gcrf[0] == 7e6
    assert message.velocity_chief_gcrf[1] == 7.5e3
    assert (message.solution, message.satellites_used) == (RelativeState.SOLUTION_FIXED, 9)
    assert (message.ambiguities_fixed, message.ratio) == (2, 12.5)


def test_ambiguities(solution):
    message = round_trip(ambiguities_to_message(solution, "chief", "deputy"), AmbiguityStatus)
    assert list(message.prn) == [5, 7]
    assert list(message.reference_prn) == [9, 0]
    assert list(message.ambiguity_cycles) == [-12345678.0, 3.25]
    assert list(message.ambiguity_sigma_cycles) == pytest.approx([0.02, 0.5])
    assert list(message.state) == [AmbiguityStatus.STATE_FIXED, AmbiguityStatus.STATE_FLOAT]
    assert list(message.fixed_since) == [message.header.stamp.sec - 10.0, 0.0]
    assert message.success_rate == pytest.approx(0.9995)


def test_differential_tec(solution):
    message = round_trip(differential_tec_to_message(solution, "chief", "deputy"), SlantTec)
    assert list(message.stec_tecu) == [-0.0123]
    assert list(message.stec_sigma_tecu) == pytest.approx([0.004])
    assert (message.band_first[0], message.band_second[0], message.arc[0]) == (1, 2, 4)
    assert np.isnan([message.stec_code_tecu[0], message.vtec_tecu[0]]).all()
    lengths = {
        len(getattr(message, name))
        for name in message.get_fields_and_field_types()
        if name not in ("header", "child_frame_id")
    }
    assert message.child_frame_id == "deputy"
    assert lengths == {1}


def test_no_solution_is_a_message_too():
    nothing = RelativeSolution.none(TIME, ("no satellite in common",))
    message = round_trip(relative_state_to_message(nothing, "chief", "deputy"), RelativeState)
    assert message.solution == RelativeState.SOLUTION_NONE
    assert np.isnan(message.position).all()
    assert len(ambiguities_to_message(nothing, "chief", "deputy").prn) == 0


def test_laser_range():
    message = LaserRange(range=250.0, range_sigma=1e-4, valid=True)
    message.header.stamp.sec = TIME.to_unix_nanoseconds() // 10**9
    measured = laser_from_message(message)
    assert (measured.time, measured.range, measured.range_sigma) == (TIME, 250.0, 1e-4)
    message.valid = False
    assert laser_from_message(message) is None
    assert laser_from_message(LaserRange(range=float("nan"), valid=True)) is None

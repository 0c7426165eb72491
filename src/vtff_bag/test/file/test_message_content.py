"""Messages that say the same, whatever the bytes between their fields hold."""

import math

import pytest
from rclpy.serialization import serialize_message

from vtff_bag.file.message_content import have_equal_content
from vtff_msgs.msg import AdcsCommand, AmbiguityStatus

COMMAND = "vtff_msgs/msg/AdcsCommand"


def command(**values):
    """Return the bytes of a command; two bytes before its last text align the text's length."""
    fields = {"child_frame_id": "snap1", "mode": 1, "wheel_speed_rpm": math.nan, "reason": "why"}
    return bytes(serialize_message(AdcsCommand(**{**fields, **values})))


def test_bytes_between_fields_do_not_count():
    """Any byte that changes no field is one of them; there is at least one."""
    content, free = command(), 0
    for index in range(4, len(content)):
        changed = bytearray(content)
        changed[index] ^= 0x40
        try:
            free += have_equal_content(content, bytes(changed), COMMAND)
        except Exception:
            continue  # a length that no longer fits
    assert 0 < free < 16


@pytest.mark.parametrize(
    "values",
    [{"mode": 2}, {"wheel_speed_rpm": 0.0}, {"reason": "who"}, {"pulse_steps": [0, 0, 1]}],
)
def test_a_field_that_differs_counts(values):
    assert have_equal_content(command(), command(), COMMAND)
    assert not have_equal_content(command(), command(**values), COMMAND)


def test_zeros_of_other_sign_differ():
    zeros = [command(wheel_speed_rpm=value) for value in (0.0, -0.0)]
    assert not have_equal_content(*zeros, COMMAND)


def test_arrays_are_compared_by_their_bytes():
    one, other = (
        bytes(serialize_message(AmbiguityStatus(system=system, prn=[5]))) for system in ([0], [1])
    )
    assert not have_equal_content(one, other, "vtff_msgs/msg/AmbiguityStatus")

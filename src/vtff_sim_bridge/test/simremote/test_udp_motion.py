"""Binary motion datagrams of SimREMOTE."""

from __future__ import annotations

import ctypes
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simremote_test_support import NaturalLayout, datagram_of

from vtff_sim_bridge.simremote.language import SimRemoteSyntaxError
from vtff_sim_bridge.simremote.motion import GeodeticMotionState, MotionState
from vtff_sim_bridge.simremote.udp_motion import MotionDatagram, parse_datagram

finite = st.floats(allow_nan=False, allow_infinity=False)
motions = st.lists(st.tuples(finite, finite, finite), min_size=8, max_size=8)
datagrams = st.builds(
    lambda vehicle, kind, parts, milliseconds, latency: MotionDatagram(
        f"v{vehicle}_m1",
        kind(*parts),
        None if milliseconds is None else milliseconds * 1_000_000,
        latency,
    ),
    st.integers(1, 999),
    st.sampled_from([MotionState, GeodeticMotionState]),
    motions,
    st.none() | st.integers(0, 2**32 - 1),
    st.integers(-(2**31), 2**31 - 1),
)


@given(datagrams, st.booleans())
def test_datagram_round_trip(command: MotionDatagram, packed: bool) -> None:
    datagram = datagram_of(command, packed)
    assert len(datagram) == (212 if packed else 216)
    assert parse_datagram(datagram) == command


def test_datagram_layout_is_that_of_a_compiler() -> None:
    structure = NaturalLayout(0, 1, 12_345, 2, (ctypes.c_double * 24)(*range(24)), -7)
    assert ctypes.sizeof(structure) == 216
    command = parse_datagram(bytes(structure))
    assert (command.vehicle_id, command.time_nanoseconds) == ("v2_m1", 12_345_000_000)
    assert [number for vector in command.motion for number in vector] == list(range(24))
    assert command.latency_ms == -7


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"type": 2}, "type"),
        ({"time_action": 2}, "time_action"),
        ({"vehicle_id": 0}, "vehicle_id"),
        ({"numbers": (ctypes.c_double * 24)(0, 0, 0, math.nan)}, "velocity_x"),
    ],
)
def test_datagram_errors_name_the_field(changes: dict, field: str) -> None:
    structure = NaturalLayout(0, 1, 0, 1)
    for name, value in changes.items():
        setattr(structure, name, value)
    with pytest.raises(SimRemoteSyntaxError, match=f"^{field}: "):
        parse_datagram(bytes(structure))


@given(st.binary(max_size=230) | st.binary(min_size=212, max_size=216))
def test_any_bytes_are_a_datagram_or_a_syntax_error(datagram: bytes) -> None:
    try:
        parse_datagram(datagram)
    except SimRemoteSyntaxError as error:
        assert len(datagram) in (212, 216) or str(error).startswith("datagram: ")

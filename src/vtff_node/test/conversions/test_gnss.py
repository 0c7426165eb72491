"""Messages and dataclasses hold the same: names, values, times."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss import constants, ephemeris, fix
from vtff_gnss.novatel import RawLog
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_msgs.msg import (
    GlonassEphemeris,
    GnssEphemeris,
    GnssFix,
    GnssObservations,
    ReceiverLog,
)
from vtff_node.conversions import gnss as conversions
from vtff_node.stamps import to_nanoseconds

SECOND = 1_000_000_000
IDENTICAL = settings(max_examples=60)

floats = st.floats(width=64)
vectors = st.tuples(floats, floats, floats)
# From 1980 to the end of the ROS stamp.
times = st.integers(0, 1_831_000_000 * SECOND).map(GpsTime)
#: Inserted second 2016-12-31T23:59:60, where two GPS times share a stamp.
LEAP_SECOND = parse_epoch("2016-12-31T23:59:60 UTC")

ELEMENTS = {"B": st.integers(0, 255), "b": st.integers(-128, 127), "H": st.integers(0, 65535),
            "d": floats, "f": st.floats(width=32)}  # fmt: skip


@st.composite
def epochs(draw):
    count = draw(st.integers(0, 12))
    columns = {}
    for name, kind in OBSERVATION_COLUMNS.items():
        values = st.lists(ELEMENTS[np.dtype(kind).char], min_size=count, max_size=count)
        columns[name] = np.array(draw(values), dtype=kind)
    return ObservationEpoch(
        time=draw(times),
        time_status=draw(st.integers(0, 255)),
        receiver_status=draw(st.integers(0, 2**32 - 1)),
        log_name="RANGE",
        **columns,
    )


def of_fields(kind, **given_strategies):
    """Build instances of a dataclass from strategies by the type of each field."""
    by_type = {"GpsTime": times, "float": floats, "tuple[float, float, float]": vectors}
    strategies = {
        field.name: given_strategies.get(field.name, by_type.get(field.type))
        for field in dataclasses.fields(kind)
    }
    return st.builds(kind, **strategies)


uint8, uint16 = st.integers(0, 255), st.integers(0, 65535)
ephemerides = of_fields(
    ephemeris.BroadcastEphemeris,
    system=uint8, prn=uint8, source=uint8, issue_of_data_ephemeris=uint16,
    issue_of_data_clock=uint16, health=uint16, gps_week=uint16,
)  # fmt: skip
fixes = of_fields(
    fix.Fix, status=uint8, receiver_solution_type=uint16, satellites_tracked=uint8,
    satellites_used=uint8,
)  # fmt: skip


def over_the_wire(message):
    """Return what a subscriber gets."""
    return deserialize_message(serialize_message(message), type(message))


def observations_message(epoch, frame_id):
    """Return what a subscriber gets of an epoch."""
    return over_the_wire(conversions.observations_to_message(epoch, frame_id))


def equal(left, right):
    """Compare dataclasses field by field; NaN equals NaN."""
    assert type(left) is type(right)
    for field in dataclasses.fields(left):
        mine, theirs = getattr(left, field.name), getattr(right, field.name)
        if field.type == "float" or str(field.type).startswith("tuple"):
            assert type(mine) is type(theirs)
            assert np.array_equal(mine, theirs, equal_nan=True), field.name
        else:
            assert mine == theirs, field.name
    return True


def assert_stamp(message, time):
    assert to_nanoseconds(message.header.stamp) == time.to_unix_nanoseconds()


@IDENTICAL
@given(epochs())
def test_observations_come_back_as_they_were(epoch):
    message = observations_message(epoch, "chief/gnss_antenna")
    back = conversions.observations_from_message(message, log_name="RANGE")
    assert back == epoch
    for name, column in back.columns().items():
        assert column.dtype == OBSERVATION_COLUMNS[name]
        assert column.flags.owndata
    assert_stamp(message, epoch.time)
    assert message.header.frame_id == "chief/gnss_antenna"
    assert message.gps_week == epoch.time.week
    assert round(message.gps_time_of_week * SECOND) == epoch.time.time_of_week_nanoseconds


@IDENTICAL
@given(ephemerides)
def test_ephemerides_come_back_as_they_were(original):
    message = over_the_wire(conversions.ephemeris_to_message(original))
    back = conversions.ephemeris_from_message(message)
    assert_stamp(message, original.time)
    if back.time != original.time:  # a stamp of a leap second stands for two times
        assert original.time.isoformat("UTC")[17:19] == "60"
        back = dataclasses.replace(back, time=original.time)
    assert equal(back, original)
    assert message.header.frame_id == "earth"


def test_glonass_ephemerides_come_back_as_they_were():
    original = ephemeris.GlonassEphemeris(
        time=GpsTime.from_week_tow(1562, 515251.0),
        prn=17,
        glonass_channel=-4,
        issue_of_data=92,
        health=3,
        time_of_ephemeris=GpsTime.from_week_tow(1562, 515714.999),
        position=(1.1e7, -2.2e7, 3.3e6),
        velocity=(1e3, -2e3, math.pi),
        acceleration=(0.0, 1.8626451492309570e-06, -2e-6),
        clock_offset=-1.2e-4,
        relative_frequency_offset=1e-12,
    )
    message = over_the_wire(conversions.glonass_ephemeris_to_message(original))
    assert conversions.glonass_ephemeris_from_message(message) == original


@IDENTICAL
@given(fixes)
def test_fixes_come_back_as_they_were(original):
    message = over_the_wire(conversions.fix_to_message(original))
    assert equal(conversions.fix_from_message(message), original)
    assert_stamp(message, original.time)
    assert message.header.frame_id == "earth"


@IDENTICAL
@given(
    st.builds(
        RawLog,
        time=st.none() | times,
        name=st.text("ABCRANGE1_", min_size=1),
        log_id=uint16,
        content=st.binary(max_size=200),
    )  # fmt: skip
)
def test_raw_logs_come_back_as_they_were(log):
    message = over_the_wire(conversions.raw_log_to_message(log, "deputy/gnss_antenna"))
    back = conversions.raw_log_from_message(message)
    if log.time is None:
        assert to_nanoseconds(message.header.stamp) == 0
    else:
        assert_stamp(message, log.time)
    if log.time is None or log.time.isoformat("UTC")[17:19] != "60":
        assert back == log


def test_times_are_exact_within_a_leap_second():
    """Two epochs one second apart share their stamp; week and second of week tell them apart."""
    empty = {name: np.empty(0, kind) for name, kind in OBSERVATION_COLUMNS.items()}
    messages = [
        observations_message(ObservationEpoch(time, 180, 0, "RANGE", **empty), "antenna")
        for time in (LEAP_SECOND + 0.25, LEAP_SECOND + 1.25)
    ]
    assert messages[0].header.stamp == messages[1].header.stamp
    back = [conversions.observations_from_message(message).time for message in messages]
    assert back == [LEAP_SECOND + 0.25, LEAP_SECOND + 1.25]


def array_fields(message_type):
    kinds = message_type.get_fields_and_field_types()
    return {name: kind for name, kind in kinds.items() if kind.startswith("sequence")}


def test_columns_agree_with_the_message():
    ros_types = {"uint8": np.uint8, "int8": np.int8, "uint16": np.uint16, "float": np.float32,
                 "double": np.float64}  # fmt: skip
    fields = {
        name: ros_types[kind[len("sequence<") : -1]]
        for name, kind in array_fields(GnssObservations).items()
    }
    assert fields == OBSERVATION_COLUMNS


@pytest.mark.parametrize(
    ("kind", "message_type", "only_in_message"),
    [
        (ephemeris.BroadcastEphemeris, GnssEphemeris, set()),
        (fix.Fix, GnssFix, {"gps_week", "gps_time_of_week"}),
        (
            ephemeris.GlonassEphemeris,
            GlonassEphemeris,
            {"gps_week", "toe"},
        ),
    ],
)
def test_field_names_agree_with_the_message(kind, message_type, only_in_message):
    names = {field.name for field in dataclasses.fields(kind)} - {"time", "time_of_ephemeris"}
    in_message = set(message_type.get_fields_and_field_types()) - {"header"}
    assert names == in_message - only_in_message


@pytest.mark.parametrize(
    ("message_type", "module", "prefixes"),
    [
        (GnssObservations, constants, {"SYSTEM_": "SYSTEM_", "FLAG_": "FLAG_"}),
        (GnssEphemeris, constants, {"SOURCE_": "EPHEMERIS_SOURCE_"}),
        (GnssFix, fix, {"STATUS_": "STATUS_"}),
    ],
)
def test_constants_agree_with_the_library(message_type, module, prefixes):
    compared = 0
    for theirs, ours in prefixes.items():
        names = {name for name in dir(message_type) if name.startswith(theirs)}
        for name in names:
            library_name = ours + name[len(theirs) :]
            if hasattr(module, library_name):
                assert getattr(module, library_name) == getattr(message_type, name), name
                compared += 1
    assert compared >= 4


def one_signal():
    columns = {name: np.ones(1, kind) for name, kind in OBSERVATION_COLUMNS.items()}
    return ObservationEpoch(GpsTime(10**18), 180, 0, "RANGE", **columns)


@pytest.mark.parametrize("column", OBSERVATION_COLUMNS)
def test_a_column_of_another_type_is_refused(column):
    wrong = dataclasses.replace(one_signal(), **{column: np.ones(1, np.int64)})
    with pytest.raises(TypeError, match=f"'{column}' is int64"):
        observations_message(wrong, "antenna")


def test_columns_of_different_length_are_refused():
    wrong = dataclasses.replace(one_signal(), lock_time=np.ones(2, np.float32))
    with pytest.raises(ValueError, match="'lock_time' has shape"):
        observations_message(wrong, "antenna")
    message = observations_message(one_signal(), "antenna")
    message.flags.append(1)
    with pytest.raises(ValueError, match="'flags' has shape"):
        conversions.observations_from_message(message)


def test_times_after_the_end_of_ros_stamps_are_refused():
    late = dataclasses.replace(one_signal(), time=parse_epoch("2038-02-01T00:00:00 GPS"))
    with pytest.raises(ValueError, match="does not fit a ROS stamp"):
        observations_message(late, "antenna")


def test_nan_survives():
    epoch = dataclasses.replace(one_signal(), carrier_phase_cycles=np.array([math.nan]))
    message = observations_message(epoch, "antenna")
    assert math.isnan(message.carrier_phase_cycles[0])


def test_raw_log_bytes_are_exact():
    content = bytes(range(256))
    message = conversions.raw_log_to_message(RawLog(None, "RANGEB", 43, content), "antenna")
    assert isinstance(message, ReceiverLog)
    assert bytes(over_the_wire(message).data) == content

"""SimREMOTE text: every element reads back as written, and errors name the field."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vtff_sim_bridge.simremote import language as simremote
from vtff_sim_bridge.simremote.language import (
    Command,
    Reply,
    SimGenStatus,
    SimRemoteSyntaxError,
    format_motion,
    format_reply,
    format_timestamp,
    parse_command,
    parse_motion,
    parse_reply,
    parse_timestamp,
)
from vtff_sim_bridge.simremote.motion import GeodeticMotionState, MotionState

finite = st.floats(allow_nan=False, allow_infinity=False)
vectors = st.tuples(finite, finite, finite)
nanoseconds = st.integers(0, simremote.MAXIMUM_TIME_SECONDS * 10**9)
vehicle_ids = st.builds("v{}_m{}".format, st.integers(1, 99), st.integers(1, 9))
# Blanks around a text are not part of it.
texts = st.text(st.characters(exclude_categories=["Cs", "Cc"])).map(str.strip)
verbs = st.from_regex(r"\*?[A-Z][A-Z0-9_]{0,12}\??", fullmatch=True)
arguments = st.lists(
    st.text(st.characters(min_codepoint=33, max_codepoint=126, exclude_characters=","))
).map(tuple)


def clock_timestamp(time: int) -> str:
    """Return a time stamp in ns as ``d hh:mm:ss.fffffffff``."""
    seconds, fraction = divmod(time, 10**9)
    days, seconds = divmod(seconds, 86400)
    return f"{days} {simremote.format_duration(seconds)}.{fraction:09d}"


def command_line(command: Command) -> str:
    fields = [command.verb, *command.arguments]
    if command.has_timestamp:
        fields.insert(0, format_timestamp(command.time_nanoseconds))
    return ",".join(fields)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-", None),
        (" - ", None),
        ("0", 0),
        ("000.050", 50_000_000),
        ("12.34", 12_340_000_000),
        (".5", 500_000_000),
        ("7.", 7_000_000_000),
        ("0.000000001", 1),
        ("0 00:00:01.000", 1_000_000_000),
        ("1 02:03:04.5", 93_784_500_000_000),
        ("01:00:00", 3_600_000_000_000),
        ("0:00:00.05", 50_000_000),
    ],
)
def test_timestamp_forms(text: str, expected: int | None) -> None:
    assert parse_timestamp(text) == expected


@pytest.mark.parametrize(
    "text",
    ["", "--", "-1", "+1", "1e3", "nan", "1_0", "1:2:3", "24:00:00", "0 00:60:00", "00:00:60"]
    + ["1.2.3", "9" * 400, "2000001", "999 00:00:00", "٣"],
)
def test_timestamp_errors_name_it(text: str) -> None:
    with pytest.raises(SimRemoteSyntaxError, match="^timestamp: "):
        parse_timestamp(text)


@given(nanoseconds)
def test_timestamp_round_trip(time: int) -> None:
    assert parse_timestamp(format_timestamp(time)) == time
    assert parse_timestamp(clock_timestamp(time)) == time


@given(st.integers(0, 900 * 86400))
def test_duration_round_trip(seconds: int) -> None:
    assert simremote.parse_duration(simremote.format_duration(seconds)) == seconds


@given(st.integers(0, 5_000_000_000))
def test_calendar_round_trip(seconds: int) -> None:
    text = simremote.format_calendar(seconds)
    assert simremote.parse_calendar(text) == seconds
    assert simremote.parse_calendar(text.upper()) == seconds


def test_calendar_known_time() -> None:
    # 1 000 000 000 s of GPS, as any GPS calendar shows.
    assert simremote.parse_calendar("14-SEP-2011 01:46:40") == 1_000_000_000


@pytest.mark.parametrize(
    "text", ["", "30-Feb-2020 00:00:00", "1-1-2020 00:00:00", "05-Jan-1980 23:59:59", "x"]
)
def test_calendar_errors_name_it(text: str) -> None:
    with pytest.raises(SimRemoteSyntaxError, match="^start_time: "):
        simremote.parse_calendar(text)


@given(st.builds(Command, verbs, arguments, nanoseconds | st.none(), st.just(True)))
def test_command_with_timestamp_round_trip(command: Command) -> None:
    assert parse_command(command_line(command)) == command


@given(st.builds(Command, verbs, arguments, st.none(), st.just(False)))
def test_bare_command_round_trip(command: Command) -> None:
    assert parse_command(command_line(command)) == command


def test_command_case_and_blanks() -> None:
    assert parse_command(" - , ru ") == Command("RU")
    assert parse_command("tr,  0") == Command("TR", ("0",), None, False)
    assert parse_command("0 00:00:01.000,mot, V1_M1,    1.0") == Command(
        "MOT", ("V1_M1", "1.0"), 1_000_000_000
    )


@pytest.mark.parametrize("line", ["", ",", "-", "-,", "5", "1.0, ,x", "-,M OT", "?", "RU!"])
def test_command_errors_name_the_verb(line: str) -> None:
    with pytest.raises(SimRemoteSyntaxError, match="^verb: "):
        parse_command(line)


@given(st.text())
def test_any_text_is_a_command_or_a_syntax_error(line: str) -> None:
    try:
        parse_command(line)
    except SimRemoteSyntaxError as error:
        assert str(error).isascii() and "\n" not in str(error)


@given(finite)
@example(-1e22)
def test_number_round_trip_without_exponent(number: float) -> None:
    line = format_motion(None, "v1_m1", MotionState((0.0, number, 0.0)))
    text = parse_command(line).arguments[2]
    assert float(text) == number
    assert "e" not in text
    significant = text.lstrip("-").replace(".", "").strip("0")
    assert len(significant) <= 17
    if 1e-6 <= abs(number) < 1e23:
        assert len(text) <= 25


@given(nanoseconds | st.none(), vehicle_ids, st.lists(vectors, min_size=8, max_size=8))
def test_motion_round_trip(time: int | None, vehicle_id: str, parts: list) -> None:
    text = format_motion(time, vehicle_id, MotionState(*parts))
    command = parse_command(text)
    assert (command.verb, command.time_nanoseconds) == ("MOT", time)
    assert len(command.arguments) == 25
    assert parse_motion(command.arguments) == (vehicle_id, MotionState(*parts))
    geodetic = simremote.parse_geodetic_motion(command.arguments)
    assert geodetic == (vehicle_id, GeodeticMotionState(*parts))


@given(st.lists(finite, min_size=3, max_size=24))
def test_omitted_trailing_numbers_are_zero(numbers: list[float]) -> None:
    vehicle_id, state = parse_motion(["V1_M1", *map(repr, numbers)])
    assert vehicle_id == "v1_m1"
    flat = [number for vector in state for number in vector]
    assert flat == numbers + [0.0] * (24 - len(numbers))


@pytest.mark.parametrize(
    ("texts", "field"),
    [
        ([], "position_x"),
        (["1", "2"], "position_z"),
        (["1", "2", "abc"], "position_z"),
        (["1", "2", "3", "nan"], "velocity_x"),
        (["1", "2", "3", "4", "inf"], "velocity_y"),
        (["1", "2", "3", "4", "5", "1_0"], "velocity_z"),
        (["0"] * 12 + [""], "heading"),
        (["0"] * 23 + ["٣"], "angular_jerk_z"),
        (["0"] * 25, "motion"),
    ],
)
def test_motion_errors_name_the_field(texts: list[str], field: str) -> None:
    with pytest.raises(SimRemoteSyntaxError, match=f"^{field}: "):
        parse_motion(["v1_m1", *texts])


@pytest.mark.parametrize("vehicle_id", ["", "v1", "v0_m1", "v1_a1", "m1_v1", "v1_m1_"])
def test_motion_errors_name_the_vehicle(vehicle_id: str) -> None:
    with pytest.raises(SimRemoteSyntaxError, match="^vehicle: "):
        parse_motion([vehicle_id, "1", "2", "3"])


def test_motion_of_great_numbers_is_not_mistaken_for_infinite() -> None:
    assert parse_motion(["v1_m1", "1.7e308", "1.7e308", "0"])[1].position_itrf[1] == 1.7e308


def test_writing_a_number_that_is_not_finite_names_it() -> None:
    state = MotionState((1.0, 2.0, 3.0), (4.0, float("nan"), 6.0))
    with pytest.raises(ValueError, match="^velocity_y of v2_m1: .*nan"):
        format_motion(0, "v2_m1", state)
    with pytest.raises(ValueError, match="24 numbers expected, got 23"):
        format_motion(0, "v2_m1", MotionState((1.0, 2.0)))  # type: ignore[arg-type]


@given(
    st.builds(
        Reply,
        st.sampled_from(SimGenStatus),
        texts.filter(lambda text: "<" not in text) | st.none(),
        texts.filter(lambda text: "<" not in text) | st.none(),
        texts.filter(lambda text: "<" not in text) | st.none(),
    )
)
def test_reply_round_trip_and_is_xml(reply: Reply) -> None:
    text = format_reply(reply)
    assert parse_reply(text) == reply
    root = ElementTree.fromstring(text.encode("ascii", "xmlcharrefreplace"))
    assert root.tag == "msg" and int(root.findtext("status", "")) == reply.status
    for name, content in zip(("data", "error", "fatal"), reply[1:], strict=True):
        found = root.findtext(name)
        assert (found is None) == (content is None)


def test_reply_forms() -> None:
    assert format_reply(Reply(SimGenStatus.READY)) == "<msg><status> 2 </status></msg>"
    padded = "\n<msg> <status>\n5 </status>\n<data>\n 12.5 \n</data>\n <error>  </error></msg>\n"
    reply = parse_reply(padded)
    assert reply == Reply(SimGenStatus.RUNNING, "12.5", "")
    assert reply.failure == "no reason given"
    assert parse_reply("<msg><status> 2 </status></msg>").failure is None
    capability = "<msg><status> 2 </status><data> <box a='1'>&lt;</box> </data></msg>"
    assert parse_reply(capability).data_text == "<box a='1'>&lt;</box>"


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "reply"),
        ("<msg></msg>", "reply"),
        ("<msg><status> x </status></msg>", "reply"),
        ("<msg><status> 8 </status></msg>", "status"),
        ("<msg><status> 2 </status><other/></msg>", "reply"),
    ],
)
def test_reply_errors_name_the_field(text: str, field: str) -> None:
    with pytest.raises(SimRemoteSyntaxError, match=f"^{field}: "):
        parse_reply(text)


@given(st.text() | st.text(st.sampled_from(list("<>/msgstatud 0123"))))
def test_any_text_is_a_reply_or_a_syntax_error(text: str) -> None:
    try:
        parse_reply(text)
    except SimRemoteSyntaxError as error:
        assert "\n" not in str(error)

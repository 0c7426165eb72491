"""SimREMOTE, the remote-control language of Spirent SimGEN: text in both directions.

A command is one line, `<time stamp>,<verb>,<vehicle or antenna>,<parameter>,...`; the reply to it
is one XML element, `<msg><status> 2 </status>[<data> .. </data>][<error> .. </error>]</msg>`.
The SIMREMOTE manual is not public; this grammar is what independent public clients agree on.
Nothing here does input or output: see `simremote_client` and `simremote_server`.
"""

from __future__ import annotations

import datetime
import enum
import functools
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY
from vtff_sim_bridge.simremote.motion import ZERO_VECTOR, GeodeticMotionState, MotionState, Vector

DEFAULT_PORT = 15650
"""TCP port on which SimGEN listens; UDP motion goes to the same number."""

MAXIMUM_TIME_SECONDS = 2_000_000
"""Latest time into a run, s; below 2**51 ns, binary64 seconds keep every nanosecond."""

_ATTITUDE_FIELDS = (
    "heading", "elevation", "bank",
    "angular_velocity_x", "angular_velocity_y", "angular_velocity_z",
    "angular_acceleration_x", "angular_acceleration_y", "angular_acceleration_z",
    "angular_jerk_x", "angular_jerk_y", "angular_jerk_z",
)  # fmt: skip
MOT_FIELDS = (
    "position_x", "position_y", "position_z",
    "velocity_x", "velocity_y", "velocity_z",
    "acceleration_x", "acceleration_y", "acceleration_z",
    "jerk_x", "jerk_y", "jerk_z",
    *_ATTITUDE_FIELDS,
)  # fmt: skip
"""Names of the 24 numbers of MOT in order; error texts use them."""
MOTB_FIELDS = (
    "latitude", "longitude", "height",
    "velocity_north", "velocity_east", "velocity_down",
    "acceleration_north", "acceleration_east", "acceleration_down",
    "jerk_north", "jerk_east", "jerk_down",
    *_ATTITUDE_FIELDS,
)  # fmt: skip
"""Names of the 24 numbers of MOTB in order; error texts use them."""

_ZERO_TEXT = ",".join(map(repr, ZERO_VECTOR))
_CLOCK_TIME = re.compile(r"(?:(\d{1,3})\s+)?(\d{1,2}):(\d{2}):(\d{2})(?:\.(\d{1,9}))?", re.ASCII)
_DECIMAL_TIME = re.compile(r"\d+(?:\.\d*)?|\.\d+", re.ASCII)
_CALENDAR = re.compile(r"(\d{1,2})-([A-Za-z]{3})-(\d{4})\s+(\d{1,2}):(\d{2}):(\d{2})", re.ASCII)
_VERB = re.compile(r"\*?[A-Z][A-Z0-9_]*\??", re.ASCII)
_VEHICLE_ID = re.compile(r"v[1-9]\d{0,2}_m[1-9]\d{0,2}", re.ASCII)
_ANTENNA_ID = re.compile(r"v[1-9]\d{0,2}_a[1-9]\d{0,2}", re.ASCII)
_REPLY = re.compile(r"\s*<msg>\s*<status>\s*(\d+)\s*</status>(.*)</msg>\s*", re.DOTALL | re.ASCII)
_CHILD = re.compile(r"\s*<(data|error|fatal)>(.*?)</\1>\s*", re.DOTALL)
_MONTHS = "Jan Feb Mar Apr May Jun Jul Aug Sep Oct Nov Dec".split()
_GPS_EPOCH = datetime.datetime(1980, 1, 6)


class SimRemoteSyntaxError(ValueError):
    """A text is not SimREMOTE; the message names the field."""


class SimGenStatus(enum.IntEnum):
    """Status of SimGEN, as every reply gives it."""

    NO_SCENARIO = 0
    LOADING = 1
    READY = 2
    ARMING = 3
    ARMED = 4
    RUNNING = 5
    PAUSED = 6
    ENDED = 7


class Command(NamedTuple):
    """One command line, taken apart.

    Attributes
    ----------
    verb : str
        In capitals, such as ``MOT``.
    arguments : tuple of str
        Texts between commas after the verb, without blanks around.
    time_nanoseconds : int or None
        Time into the run at which the command takes effect, ns; None for immediately.
    has_timestamp : bool
        False for the bare form, such as ``RU`` instead of ``-,RU``.
    """

    verb: str
    arguments: tuple[str, ...] = ()
    time_nanoseconds: int | None = None
    has_timestamp: bool = True


class Reply(NamedTuple):
    """The reply to one command; texts without the blanks around them, None where absent."""

    status: SimGenStatus
    data_text: str | None = None
    error_text: str | None = None
    fatal_text: str | None = None

    @property
    def failure(self) -> str | None:
        """Error that the simulator reports, or None."""
        texts = [text for text in (self.fatal_text, self.error_text) if text is not None]
        return "; ".join(text or "no reason given" for text in texts) if texts else None


def parse_timestamp(text: str) -> int | None:
    """Return a time stamp as nanoseconds into the run, None for ``-`` (immediately).

    Forms: ``-``, ``d hh:mm:ss.sss`` (days from 0), ``hh:mm:ss[.fff]`` and decimal seconds.

    Raises
    ------
    SimRemoteSyntaxError
        If the text has none of these forms or is later than `MAXIMUM_TIME_SECONDS`.
    """
    text = text.strip()
    if text == "-":
        return None
    if _DECIMAL_TIME.fullmatch(text):
        seconds = float(text)
        nanoseconds = round(min(seconds, 2.0 * MAXIMUM_TIME_SECONDS) * 1e9)
    else:
        nanoseconds = _clock_nanoseconds("timestamp", text)
    if nanoseconds > MAXIMUM_TIME_SECONDS * NANOSECONDS_PER_SECOND:
        raise SimRemoteSyntaxError(
            f"timestamp: at most {MAXIMUM_TIME_SECONDS} s expected, got {quote(text)}"
        )
    return nanoseconds


def format_timestamp(time_nanoseconds: int | None) -> str:
    """Return a time stamp as decimal seconds with at least three decimals, or ``-``."""
    if time_nanoseconds is None:
        return "-"
    seconds, fraction = divmod(time_nanoseconds, NANOSECONDS_PER_SECOND)
    return f"{seconds}.{_format_fraction(fraction)}"


def _format_fraction(nanoseconds: int) -> str:
    """Return a fraction of a second as three to nine decimals."""
    return f"{nanoseconds:09d}".rstrip("0").ljust(3, "0")


def parse_duration(text: str, field: str = "duration") -> int:
    """Return ``[d ]hh:mm:ss`` as whole seconds.

    Raises
    ------
    SimRemoteSyntaxError
        If the text has another form.
    """
    nanoseconds = _clock_nanoseconds(field, text.strip())
    if nanoseconds % NANOSECONDS_PER_SECOND:
        raise SimRemoteSyntaxError(f"{field}: whole seconds expected, got {quote(text)}")
    return nanoseconds // NANOSECONDS_PER_SECOND


def format_duration(seconds: int) -> str:
    """Return whole seconds as ``[d ]hh:mm:ss``."""
    days, seconds = divmod(seconds, SECONDS_PER_DAY)
    hours, seconds = divmod(seconds, 3600)
    minutes, seconds = divmod(seconds, 60)
    clock = f"{hours:02d}:{minutes:02d}:{seconds:02d}"
    return f"{days} {clock}" if days else clock


def _clock_nanoseconds(field: str, text: str) -> int:
    """Return ``[d ]hh:mm:ss[.fff]`` as nanoseconds."""
    match = _CLOCK_TIME.fullmatch(text)
    if not match:
        raise SimRemoteSyntaxError(
            f"{field}: '[d ]hh:mm:ss' expected, got {quote(text)}"
            if field != "timestamp"
            else f"timestamp: '-', '[d ]hh:mm:ss.sss' or seconds expected, got {quote(text)}"
        )
    days, hours, minutes, seconds = (int(group or 0) for group in match.groups()[:4])
    if hours > 23 or minutes > 59 or seconds > 59:
        raise SimRemoteSyntaxError(f"{field}: hour, minute or second too large in {quote(text)}")
    whole = days * SECONDS_PER_DAY + hours * 3600 + minutes * 60 + seconds
    return whole * NANOSECONDS_PER_SECOND + int((match[5] or "").ljust(9, "0"))


def parse_calendar(text: str, field: str = "start_time") -> int:
    """Return ``DD-MON-YYYY hh:mm:ss`` as seconds since 1980-01-06 00:00:00 of the same scale.

    Raises
    ------
    SimRemoteSyntaxError
        If the text has another form, is no date, or is before 1980-01-06.
    """
    match = _CALENDAR.fullmatch(text.strip())
    if not match or match[2].capitalize() not in _MONTHS:
        raise SimRemoteSyntaxError(f"{field}: 'DD-MON-YYYY hh:mm:ss' expected, got {quote(text)}")
    month = _MONTHS.index(match[2].capitalize()) + 1
    day, year, hour, minute, second = (int(match[group]) for group in (1, 3, 4, 5, 6))
    try:
        moment = datetime.datetime(year, month, day, hour, minute, second)
    except ValueError as error:
        raise SimRemoteSyntaxError(f"{field}: {error} in {quote(text)}") from None
    if moment < _GPS_EPOCH:
        raise SimRemoteSyntaxError(f"{field}: before 06-Jan-1980 in {quote(text)}")
    return int((moment - _GPS_EPOCH).total_seconds())


def format_calendar(seconds: int) -> str:
    """Return seconds since 1980-01-06 00:00:00 as ``DD-Mon-YYYY hh:mm:ss`` of the same scale."""
    moment = _GPS_EPOCH + datetime.timedelta(seconds=seconds)
    # strftime would take the month names from the locale.
    return f"{moment.day:02d}-{_MONTHS[moment.month - 1]}-{moment.year:04d} {moment:%H:%M:%S}"


def parse_command(line: str) -> Command:
    """Take a command line apart.

    Raises
    ------
    SimRemoteSyntaxError
        If the time stamp or the verb is malformed; the arguments are not looked at.
    """
    fields = [field.strip() for field in line.split(",")]
    first = fields[0]
    if first[:1] in ("-", ".") or first[:1].isdigit():
        if len(fields) < 2:
            raise SimRemoteSyntaxError(f"verb: missing after time stamp {quote(first)}")
        time_nanoseconds, has_timestamp, verb, start = parse_timestamp(first), True, fields[1], 2
    else:
        time_nanoseconds, has_timestamp, verb, start = None, False, first, 1
    verb = verb.upper()
    if not _VERB.fullmatch(verb):
        raise SimRemoteSyntaxError(f"verb: a command name expected, got {quote(fields[start - 1])}")
    return Command(verb, tuple(fields[start:]), time_nanoseconds, has_timestamp)


def parse_vehicle_id(text: str) -> str:
    """Return a vehicle id such as ``v1_m1`` in lower case; raise SimRemoteSyntaxError if none."""
    vehicle_id = text.lower()
    if not _VEHICLE_ID.fullmatch(vehicle_id):
        raise SimRemoteSyntaxError(f"vehicle: an id such as v1_m1 expected, got {quote(text)}")
    return vehicle_id


def parse_antenna_id(text: str) -> str:
    """Return an antenna id such as ``v1_a1`` in lower case; raise SimRemoteSyntaxError if none."""
    antenna_id = text.lower()
    if not _ANTENNA_ID.fullmatch(antenna_id):
        raise SimRemoteSyntaxError(f"antenna: an id such as v1_a1 expected, got {quote(text)}")
    return antenna_id


def parse_number(field: str, text: str) -> float:
    """Return a finite number; raise SimRemoteSyntaxError naming the field if it is none."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    # float() also reads 1_000, non-ASCII digits, inf and nan.
    if "_" in text or not text.isascii() or not math.isfinite(number):
        raise SimRemoteSyntaxError(f"{field}: a number expected, got {quote(text)}")
    return number


def _remove_exponent(text: str) -> str:
    """Return a decimal with exponent as a decimal without exponent."""
    mantissa, exponent_text = text.split("e")
    exponent = int(exponent_text)
    sign = "-" if mantissa.startswith("-") else ""
    whole, _, decimals = mantissa.lstrip("-").partition(".")
    if exponent < 0:
        return f"{sign}0.{'0' * (-exponent - 1)}{whole}{decimals}"
    # No ".0" follows, which would make the largest numbers longer than promised.
    return f"{sign}{whole}{decimals.ljust(exponent, '0')}"


def parse_motion(arguments: Sequence[str]) -> tuple[str, MotionState]:
    """Return vehicle id and motion of the arguments of MOT; omitted trailing numbers are 0.

    Raises
    ------
    SimRemoteSyntaxError
        If the vehicle id or a number is malformed, or there are not 3 to 24 numbers.
    """
    vehicle_id, vectors = _parse_vectors(MOT_FIELDS, arguments)
    return vehicle_id, MotionState(*vectors)


def parse_geodetic_motion(arguments: Sequence[str]) -> tuple[str, GeodeticMotionState]:
    """Return vehicle id and motion of the arguments of MOTB; errors as in `parse_motion`."""
    vehicle_id, vectors = _parse_vectors(MOTB_FIELDS, arguments)
    return vehicle_id, GeodeticMotionState(*vectors)


def format_motion(time_nanoseconds: int | None, vehicle_id: str, state: MotionState) -> str:
    """Return a MOT command with all 24 numbers, without line ending.

    Each number is the shortest decimal that reads back as the same binary64 number, without
    exponent: at most 17 significant digits, and 25 characters for 1e-6 <= abs(number) < 1e23.
    Public clients write plain decimals, so whether SimGEN reads exponents is not known.

    Raises
    ------
    ValueError
        If a number is not finite or a vector has not three; the message names the field.
    """
    text = ",".join(
        [
            # Without an attitude half of all numbers.
            _ZERO_TEXT if vector is ZERO_VECTOR else ",".join(map(repr, map(float, vector)))
            for vector in state
        ]
    )
    count = text.count(",") + 1
    if count != len(MOT_FIELDS):
        raise ValueError(f"MOT: {len(MOT_FIELDS)} numbers expected, got {count}")
    if "n" in text:
        numbers = map(float, text.split(","))
        name, number = next(
            pair for pair in zip(MOT_FIELDS, numbers, strict=True) if not math.isfinite(pair[1])
        )
        raise ValueError(f"{name} of {vehicle_id}: finite number expected, got {number}")
    if "e" in text:
        text = ",".join(
            _remove_exponent(number) if "e" in number else number for number in text.split(",")
        )
    return f"{format_timestamp(time_nanoseconds)},MOT,{vehicle_id},{text}"


def _parse_vectors(fields: tuple[str, ...], arguments: Sequence[str]) -> tuple[str, list[Vector]]:
    """Return vehicle id and the vectors of three of a motion command."""
    vehicle_id = parse_vehicle_id(arguments[0] if arguments else "")
    texts = arguments[1:]
    if len(texts) > len(fields):
        raise SimRemoteSyntaxError(f"motion: at most {len(fields)} numbers, got {len(texts)}")
    if len(texts) < 3:
        raise SimRemoteSyntaxError(f"{fields[len(texts)]}: number is missing")
    joined = "".join(texts)
    try:
        numbers = list(map(float, texts))
        checksum = sum(numbers)
        # One sum instead of 24 tests; it is not finite if any of the numbers is not.
        doubtful = "_" in joined or not joined.isascii() or checksum - checksum != 0.0
    except ValueError:
        doubtful = True
    if doubtful:
        numbers = [parse_number(field, text) for field, text in zip(fields, texts, strict=False)]
    numbers.extend([0.0] * (len(fields) - len(numbers)))
    values = iter(numbers)
    return vehicle_id, list(zip(values, values, values, strict=True))


@functools.lru_cache(maxsize=64)
def parse_reply(text: str) -> Reply:
    """Return the reply that an XML text ``<msg>..</msg>`` is.

    Data that is XML itself is returned as it came.

    Raises
    ------
    SimRemoteSyntaxError
        If the text is no reply or the status is not 0 to 7.
    """
    match = _REPLY.fullmatch(text)
    if not match:
        raise SimRemoteSyntaxError(f"reply: '<msg><status>' expected, got {quote(text)}")
    try:
        status = SimGenStatus(int(match[1]))
    except ValueError:
        raise SimRemoteSyntaxError(f"status: 0 to 7 expected, got {quote(match[1])}") from None
    if not match[2]:
        return Reply(status)
    texts: dict[str, str] = {}
    position, end = match.span(2)
    while position < end and text[position:end].strip():
        child = _CHILD.match(text, position, end)
        if not child:
            raise SimRemoteSyntaxError(f"reply: unknown element in {quote(text[position:end])}")
        content = child[2].strip()
        texts[child[1]] = content if "<" in content else _unescape(content)
        position = child.end()
    return Reply(status, texts.get("data"), texts.get("error"), texts.get("fatal"))


@functools.lru_cache(maxsize=64)
def format_reply(reply: Reply) -> str:
    """Return a reply as XML text, its texts padded with blanks as SimGEN does."""
    parts = [f"<msg><status> {reply.status:d} </status>"]
    for name, text in zip(("data", "error", "fatal"), reply[1:], strict=True):
        if text is not None:
            parts.append(f"<{name}> {_escape(text)} </{name}>")
    parts.append("</msg>")
    return "".join(parts)


# xml.sax.saxutils has both functions, but its import takes longer than the rest of the emulator.
def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _unescape(text: str) -> str:
    return text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")


def quote(text: str) -> str:
    """Return a received text for an error message: quoted, ASCII, at most 40 characters of it."""
    return ascii(text if len(text) <= 40 else text[:37] + "...")

"""Commands and log scheduling of the emulated receiver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import (
    EPHEMERIS_SOURCE_INAV,
    EPHEMERIS_SOURCE_LNAV,
    FLAG_LOCK_LOST,
    SYSTEM_GALILEO,
    SYSTEM_GPS,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel import CommandResponse, RawLog, ReceiverLogStream
from vtff_gnss.novatel.encode.lnav import quantize_lnav
from vtff_gnss.novatel.encode.solution import ComponentVersion, IonosphereUtc
from vtff_gnss.observations import (
    OBSERVATION_COLUMNS,
    EpochTimes,
    ObservationEpoch,
    ObservationSeries,
)
from vtff_sim_bridge.receiver.receiver_firmware import BAUD_RATES, ReceiverFirmware
from vtff_sim_bridge.receiver.receiver_logs import EpochOfSeries

START = GpsTime.from_week_tow(1889, 90000.0)
OK = b"\r\n<OK\r\n[COM1]"
SETUP = b"UNLOGALL THISPORT TRUE\r\nLOG COM1 RANGEB ONTIME 0.05\r\nLOG BESTXYZB ONTIME 1\r\n"


def ephemeris(prn: int, system: int = SYSTEM_GPS, toe: float = 93600.0) -> BroadcastEphemeris:
    is_gps = system == SYSTEM_GPS
    made = BroadcastEphemeris(
        time=START, system=system, prn=prn,
        source=EPHEMERIS_SOURCE_LNAV if is_gps else EPHEMERIS_SOURCE_INAV,
        issue_of_data_ephemeris=5, issue_of_data_clock=5, health=0, gps_week=1889, toe=toe,
        toc=toe, af0=1e-5, af1=0.0, af2=0.0, semi_major_axis=26.56e6, eccentricity=0.01,
        inclination=0.96, inclination_rate=0.0, longitude_of_ascending_node=-2.0,
        right_ascension_rate=-8e-9, argument_of_perigee=0.5, mean_anomaly=0.1 * prn,
        mean_motion_difference=4.5e-9, cuc=0.0, cus=0.0, crc=0.0, crs=0.0, cic=0.0, cis=0.0,
        group_delay=0.0, group_delay_secondary=0.0, accuracy=2.0,
        fit_interval=14400.0)  # fmt: skip
    return quantize_lnav(made) if is_gps else made


class Outputs:
    """Constant outputs; counts what it was asked for."""

    def __init__(self) -> None:
        self.held: tuple[BroadcastEphemeris, ...] = tuple(ephemeris(prn) for prn in (3, 7))
        self.asked: list[str] = []

    def observations(self, time: GpsTime) -> EpochOfSeries:
        self.asked.append("observations")
        count = 36
        columns = {name: np.zeros((1, count), kind) for name, kind in OBSERVATION_COLUMNS.items()}
        for name in ("system", "prn", "band", "attribute", "glonass_channel"):
            columns[name] = columns[name][0]
        columns["prn"][:] = np.arange(count) // 3 + 1
        columns["band"][:] = np.resize([1, 2, 2], count)
        columns["attribute"][:] = np.resize([ord("C"), ord("W"), ord("S")], count)
        columns["pseudorange"][:] = 2.2e7
        columns["carrier_phase_cycles"][:] = 2.2e7 / 0.19
        columns["lock_time"][:] = (time - START) + 10.0
        columns["flags"][:] = 7
        observed = np.ones((1, count), dtype=bool)
        series = ObservationSeries((time,), 180, 0, "RANGE", observed, **columns)
        return EpochOfSeries(series, 0)

    def fix(self, time: GpsTime) -> Fix:
        self.asked.append("fix")
        three = (1.0, 2.0, 3.0)
        return Fix(time, 1, 16, three, three, three, three, 0.0, 12, 12, 1e-8, 1e-9)

    def receiver_time(self, time: GpsTime) -> ReceiverTime:
        return ReceiverTime(time, True, 1e-8, 1e-9, -17.0)

    def ephemerides(self, time: GpsTime) -> tuple[BroadcastEphemeris, ...]:
        self.asked.append("ephemerides")
        return self.held

    def ionosphere_utc(self, time: GpsTime) -> tuple[IonosphereUtc, ...]:
        return (IonosphereUtc.at(START),)


def names_of(content: bytes) -> list[str]:
    """Return the names of the logs, in order."""
    events = ReceiverLogStream(raw_logs="all", every_ephemeris=True).feed(content)
    return [event.name for event in events if isinstance(event, RawLog)]


def raw_logs(content: bytes) -> list[RawLog]:
    """Return the logs as they came."""
    events = ReceiverLogStream(raw_logs="all").feed(content)
    return [event for event in events if isinstance(event, RawLog)]


def run(receiver: ReceiverFirmware, outputs: Outputs, first: int, last: int) -> list[list[str]]:
    """Advance in steps of 50 ms; the names of the logs of every epoch."""
    return [names_of(receiver.advance(START + 0.05 * step, outputs)) for step in range(first, last)]


@pytest.mark.parametrize(
    "command",
    [
        b"unlogall", b"UNLOGALL THISPORT", b"UnlogAll com1 true", b"LOG RANGEB ONTIME 0.05",
        b"log com1 rangea ontime 1", b"LOG THISPORT RANGECMP4B ONTIME 0.25 0.05 HOLD",
        b"LOG BESTXYZB", b"LOG TIMEB ONCE", b"LOG RAWEPHEMB ONNEW", b"LOG GPSEPHEMB ONCHANGED",
        b"LOG IONUTCB ONCHANGED", b"LOG COM2 RANGEB ONTIME 10 NOHOLD", b"ECHO OFF",
        b"ECHO COM1 ON", b"SERIALCONFIG COM1 460800 N 8 1 N OFF", b"SERIALCONFIG 115200",
        b"SAVECONFIG", b"LOG USB1 RANGEB ONTIME 1", b"  LOG  RANGEB   ONTIME  2 ",
        b"INTERFACEMODE COM1 NOVATEL NOVATEL ON",
    ],
)  # fmt: skip
def test_accepted(command):
    assert ReceiverFirmware().receive(command + b"\r\n") == OK


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (b"LOG BSTXYZB", b"Invalid Message. Field = BSTXYZB"),  # as a real receiver answered
        (b"FOO", b"Invalid Message. Field = FOO"),
        (b"LOG COM9 RANGEB", b"Invalid Message. Field = COM9"),
        (b"LOG", b"Message missing field"),
        (b"LOG RANGEB ONCHANGED", b"Trigger ONCHANGED not valid for this log"),
        (b"LOG VERSIONB ONNEW", b"Trigger ONNEW not valid for this log"),
        (b"LOG RANGEB ONMARK", b"Trigger ONMARK not valid for this log"),
        (b"LOG RANGEB SOMETIMES", b"Invalid Message. Field = SOMETIMES"),
        (b"LOG RANGEB ONTIME", b"Message missing field"),
        (b"LOG RANGEB ONTIME 0.01", b"Requested rate is invalid"),
        (b"LOG RANGEB ONTIME 0.3", b"Requested rate is invalid"),
        (b"LOG RANGEB ONTIME 1.5", b"Requested rate is invalid"),
        (b"LOG RANGEB ONTIME 0", b"Requested rate is invalid"),
        (b"LOG RANGEB ONTIME -1", b"Requested rate is invalid"),
        (b"LOG RANGEB ONTIME nan", b"Invalid Message. Field = NAN"),
        (b"LOG RANGEB ONTIME x", b"Invalid Message. Field = X"),
        (b"LOG RANGEB ONTIME 1 1", b"Invalid offset."),
        (b"LOG RANGEB ONTIME 1 0.03", b"Invalid offset."),
        (b"LOG RANGEB ONTIME 1 0 KEEP", b"Invalid Message. Field = KEEP"),
        (b"LOG RANGEB ONTIME 1 0 HOLD 7", b"Invalid Message. Field = 7"),
        (b"UNLOG RANGEB", b"Requested log does not exist"),
        (b"UNLOGALL COM1 PERHAPS", b"Invalid Message. Field = PERHAPS"),
        (b"SERIALCONFIG COM1 123456", b"Invalid baud rate"),
        (b"SERIALCONFIG COM7 9600", b"Com port not supported. Field = COM7"),
        (b"SERIALCONFIG", b"Message missing field"),
        (b"SERIALCONFIG COM1 9600 X", b"Invalid Message. Field = X"),
        (b"\xff\xfe", b"Invalid Message. Field = ??"),
        (b"LOG " + b"X" * 600, b"Message is incorrect"),
    ],
)
def test_refused(command, text):
    assert ReceiverFirmware().receive(command + b"\r\n") == (b"\r\n<ERROR:" + text + b"\r\n[COM1]")


def test_several_commands_in_one_write_and_one_in_several():
    receiver = ReceiverFirmware("COM2")
    assert receiver.receive(SETUP) == 3 * OK.replace(b"COM1", b"COM2")
    assert [receiver.receive(bytes([byte])) for byte in b"LOG TIMEB\r\n"].count(b"") == 10
    for ending in (b"\r", b"\n", b"\r\n", b"\n\r"):
        assert receiver.receive(b"ECHO OFF" + ending) != b""
    assert receiver.receive(b"\r\n\r\n  \r\n") == b""


def test_answers_are_read_as_answers():
    answer = ReceiverFirmware().receive(b"LOG RANGEB ONTIME 0.05\r\nLOG NONSENSE\r\n")
    events = ReceiverLogStream().feed(answer)
    assert events == [
        CommandResponse(True, "OK"),
        CommandResponse(False, "ERROR:Invalid Message. Field = NONSENSE"),
    ]


def test_schedule_on_time():
    receiver, outputs = ReceiverFirmware(), Outputs()
    assert receiver.receive(SETUP + b"LOG TIMEB ONTIME 0.5 0.25\r\n") == 4 * OK
    assert receiver.active_logs == (
        "RANGEB ONTIME 0.05", "BESTXYZB ONTIME 1", "TIMEB ONTIME 0.5",
    )  # fmt: skip
    for step, names in enumerate(run(receiver, outputs, 0, 41)):
        expected = ["RANGEB"]
        expected += ["TIMEB"] if step % 10 == 5 else []
        expected += ["BESTXYZB"] if step % 20 == 0 else []
        assert names == expected, step
    assert outputs.asked.count("fix") == 3 and "ephemerides" not in outputs.asked


def test_order_of_an_epoch_does_not_depend_on_the_order_of_the_commands():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG GPSEPHEMB ONCE\r\nLOG BESTXYZB ONTIME 1\r\nLOG IONUTCB ONCE\r\n")
    receiver.receive(b"LOG TIMEB ONTIME 1\r\nLOG RAWEPHEMB ONCE\r\nLOG RANGEB ONTIME 1\r\n")
    assert run(receiver, outputs, 0, 1) == [
        ["RANGEB", "BESTXYZB", "IONUTCB", *2 * ["RAWEPHEMB"], *2 * ["GPSEPHEMB"], "TIMEB"]
    ]
    assert run(receiver, outputs, 20, 21) == [["RANGEB", "BESTXYZB", "TIMEB"]]


def test_on_new_and_on_changed():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG RAWEPHEMB ONNEW\r\nLOG GPSEPHEMB ONCHANGED\r\n")
    receiver.receive(b"LOG GALINAVEPHEMERISB ONCHANGED\r\n")
    assert run(receiver, outputs, 0, 2) == [2 * ["RAWEPHEMB"] + 2 * ["GPSEPHEMB"], []]
    repeated = replace(outputs.held[0], time=START + 30.0)
    outputs.held = (repeated, outputs.held[1])
    assert run(receiver, outputs, 2, 4) == [["RAWEPHEMB"], []]
    outputs.held = (repeated, ephemeris(7, toe=100800.0), ephemeris(11, SYSTEM_GALILEO))
    assert run(receiver, outputs, 4, 6) == [["RAWEPHEMB", "GPSEPHEMB", "GALINAVEPHEMERISB"], []]
    # A new LOG starts anew.
    receiver.receive(b"LOG GPSEPHEMB ONCHANGED\r\n")
    assert run(receiver, outputs, 6, 7) == [2 * ["GPSEPHEMB"]]


def test_on_new_sends_nothing_that_was_received_before():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG TIMEB ONTIME 1\r\n")
    assert run(receiver, outputs, 0, 2) == [["TIMEB"], []]
    receiver.receive(b"LOG RAWEPHEMB ONNEW\r\nLOG IONUTCB ONNEW\r\n")
    assert run(receiver, outputs, 2, 4) == [[], []]
    outputs.held = (*outputs.held, replace(ephemeris(9), time=START + 0.2))
    assert run(receiver, outputs, 4, 6) == [["RAWEPHEMB"], []]


def test_once_is_sent_once():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG RANGEB\r\n")
    assert run(receiver, outputs, 0, 2) == [["RANGEB"], []]


def test_version_is_answered_at_once_and_before_the_time_is_known():
    receiver = ReceiverFirmware(versions=(ComponentVersion(model="G2L"),))
    answer = receiver.receive(b"LOG VERSIONB ONCE\r\n")
    assert answer.startswith(OK)
    (log,) = raw_logs(answer)
    assert (log.name, log.time) == ("VERSIONB", None)
    receiver.advance(START, Outputs())
    (log,) = raw_logs(receiver.receive(b"log versionb\r\n"))
    assert log.time == START


def test_unlog_and_hold():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG RANGEB ONTIME 0.05 0 HOLD\r\nLOG TIMEB ONTIME 0.05 HOLD\r\n")
    receiver.receive(b"LOG BESTXYZB ONTIME 0.05\r\nUNLOGALL THISPORT\r\n")
    assert run(receiver, outputs, 0, 1) == [["RANGEB", "TIMEB"]]
    assert receiver.receive(b"UNLOG COM1 TIMEB\r\n") == OK
    assert run(receiver, outputs, 1, 2) == [["RANGEB"]]
    assert receiver.receive(b"UNLOGALL COM2 TRUE\r\n") == OK
    assert run(receiver, outputs, 2, 3) == [["RANGEB"]]
    assert receiver.receive(b"UNLOGALL TRUE\r\n") == OK
    assert run(receiver, outputs, 3, 4) == [[]]


def test_logs_of_other_ports_go_nowhere_and_a_second_log_replaces_the_first():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG COM2 RANGEB ONTIME 0.05\r\n")
    assert run(receiver, outputs, 0, 2) == [[], []]
    receiver.receive(b"LOG RANGEB ONTIME 0.05\r\nLOG RANGEB ONTIME 0.1\r\n")
    assert run(receiver, outputs, 2, 5) == [["RANGEB"], [], ["RANGEB"]]


def test_ascii_and_binary_are_two_logs():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"LOG RANGEA ONTIME 1\r\nLOG RANGEB ONTIME 1\r\nLOG TIME ONTIME 1\r\n")
    content = receiver.advance(START, outputs)
    text, binary = (e for e in ReceiverLogStream().feed(content) if isinstance(e, ObservationEpoch))
    assert text.time == binary.time and (text.prn == binary.prn).all()
    assert b"<TIME COM1 0 " in content


def test_epochs_go_forward():
    receiver = ReceiverFirmware()
    receiver.advance(START, Outputs())
    with pytest.raises(ValueError, match="not later"):
        receiver.advance(START, Outputs())


def test_power_cycle_brings_the_saved_configuration_back():
    receiver, outputs = ReceiverFirmware(), Outputs()
    receiver.receive(b"SERIALCONFIG COM1 460800\r\nLOG RANGEB ONTIME 0.05\r\nSAVECONFIG\r\n")
    receiver.receive(b"SERIALCONFIG COM1 115200\r\nLOG TIMEB ONTIME 0.05\r\nLOG RAW")
    assert receiver.power_cycle() == b"\r\n[COM1]"
    assert receiver.baud == 460800
    assert run(receiver, outputs, 0, 1) == [["RANGEB"]]
    fresh = ReceiverFirmware()
    fresh.receive(SETUP + b"SERIALCONFIG COM1 460800\r\n")
    assert fresh.receive(b"RESET\r\n") == OK + b"\r\n[COM1]"
    assert fresh.active_logs == () and fresh.baud == 9600


def test_link_load_is_that_of_the_bandwidth_table():
    """RANGEB of 36 observations at 20 Hz on 460800: 70 %, on 230400: 141 % (interfaces.md 2.3)."""
    receiver, outputs = ReceiverFirmware(baud=460800), Outputs()
    receiver.receive(b"LOG RANGEB ONTIME 0.05\r\n")
    run(receiver, outputs, 0, 40)
    assert receiver.link_load_percent == pytest.approx(1620 * 20 * 10 / 460800 * 100)
    receiver.receive(b"SERIALCONFIG COM1 230400 N 8 1 N OFF\r\n")
    assert receiver.link_load_percent == pytest.approx(140.625)
    receiver.receive(b"SERIALCONFIG COM1 230400 E 8 2 N OFF\r\n")
    assert receiver.link_load_percent == pytest.approx(140.625 * 1.2)


def test_a_line_that_is_fast_enough_loses_nothing():
    limited, free = (ReceiverFirmware(baud=460800, limits_baud=flag) for flag in (True, False))
    streams = []
    for receiver in (limited, free):
        receiver.receive(SETUP)
        outputs = Outputs()
        streams.append(
            b"".join(receiver.advance(START + 0.05 * step, outputs) for step in range(60))
        )
    assert limited.dropped_frames == 0
    assert streams[1].startswith(streams[0])
    assert 0 < len(streams[1]) - len(streams[0]) == limited.waiting_bytes < 2000


def test_a_line_that_is_too_slow_drops_whole_logs_and_tells_so():
    receiver, outputs = ReceiverFirmware(baud=115200, limits_baud=True), Outputs()
    receiver.receive(b"LOG RANGEB ONTIME 0.05\r\n")
    stream, received = ReceiverLogStream(), 0
    epochs = []
    for step in range(400):
        content = receiver.advance(START + 0.05 * step, outputs)
        assert len(content) <= 576 + 1
        received += len(content)
        epochs += stream.feed(content)
    assert receiver.link_load_percent == pytest.approx(281.25)
    assert received == pytest.approx(11520 * 19.95, abs=2)
    assert receiver.dropped_frames > 200
    assert stream.counters.frames_crc_bad == stream.counters.bytes_skipped == 0
    assert len(epochs) == received // 1620
    assert epochs[-1].receiver_status == 0x100 and epochs[0].receiver_status == 0
    # Lock times grow as time does: what is missing is no slip.
    assert not any((epoch.flags & FLAG_LOCK_LOST).any() for epoch in epochs)


def test_an_idle_line_saves_nothing_up():
    receiver, outputs = ReceiverFirmware(baud=9600, limits_baud=True), Outputs()
    receiver.advance(START, outputs)
    receiver.receive(b"LOG RANGEB ONCE\r\n")
    receiver.advance(START + 100.0, outputs)
    assert len(receiver.advance(START + 100.1, outputs)) == 96


def test_an_answer_waits_behind_the_bytes_of_a_full_line():
    receiver, outputs = ReceiverFirmware(baud=9600, limits_baud=True), Outputs()
    receiver.receive(b"LOG RANGEB ONCE\r\n")
    receiver.advance(START, outputs)
    assert receiver.receive(b"ECHO OFF\r\n") == b""
    content = b"".join(receiver.advance(START + 0.1 * k, outputs) for k in range(1, 30))
    assert content.endswith(OK) and names_of(content) == ["RANGEB"]


def test_runs_are_repeatable():
    def once() -> bytes:
        receiver, outputs = ReceiverFirmware(baud=115200, limits_baud=True), Outputs()
        content = receiver.receive(SETUP + b"LOG RAWEPHEMB ONNEW\r\nLOG RANGECMP4B ONTIME 0.1\r\n")
        return content + b"".join(
            receiver.advance(START + 0.05 * step, outputs) for step in range(50)
        )

    assert once() == once()


@pytest.mark.parametrize("options", [{"port_name": "COM9"}, {"baud": 12345}])
def test_settings_are_checked(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        ReceiverFirmware(**options)


WORDS = st.sampled_from(
    ["LOG", "UNLOG", "UNLOGALL", "SERIALCONFIG", "ECHO", "COM1", "COM2", "THISPORT", "RANGEB",
     "RANGECMPB", "VERSIONB", "GPSEPHEMB", "ONTIME", "ONCE", "ONNEW", "0.05", "1", "1e99", "-0",
     "HOLD", "TRUE", "460800", "inf", "\u00e9", ",", "RESET", "SAVECONFIG"]
)  # fmt: skip


@given(
    st.lists(st.lists(WORDS, min_size=1, max_size=7), max_size=12),
    st.lists(st.integers(1, 40), min_size=1, max_size=8),
)
@settings(max_examples=150)
def test_any_commands_in_any_pieces_get_one_answer_each(commands, lengths):
    content = b"".join(" ".join(words).encode() + b"\r\n" for words in commands)
    whole = ReceiverFirmware().receive(content)
    pieces, receiver, position, index = b"", ReceiverFirmware(), 0, 0
    while position < len(content):
        length = lengths[index % len(lengths)]
        pieces += receiver.receive(content[position : position + length])
        position, index = position + length, index + 1
    assert pieces == whole
    responses = [e for e in ReceiverLogStream().feed(whole) if isinstance(e, CommandResponse)]
    asked = [words for words in commands if any(word != "," for word in words)]
    assert len(responses) == len(asked)
    assert receiver.baud in BAUD_RATES


def test_epochs_at_once_are_those_one_by_one():
    commands = (
        b"LOG BESTXYZB ONTIME 0.25 0.1\r\nLOG TIMEB ONTIME 1\r\nLOG IONUTCB ONNEW\r\n"
        b"LOG RAWEPHEMB ONCHANGED\r\nLOG VERSIONB ONTIME 1\r\nLOG BESTXYZA ONCE\r\n"
    )
    at_once, one_by_one = ReceiverFirmware(), ReceiverFirmware()
    outputs = Outputs()
    for receiver in (at_once, one_by_one):
        receiver.receive(commands)
    for second in range(3):
        times = [START + (second + 0.05 * step) for step in range(20)]
        contents = at_once.advance_epochs(EpochTimes([time.nanoseconds for time in times]), outputs)
        assert contents == [one_by_one.advance(time, outputs) for time in times]
        assert at_once.link_load_percent == one_by_one.link_load_percent > 0.0
    with pytest.raises(ValueError, match="not later"):
        at_once.advance_epochs(EpochTimes([START.nanoseconds + 4 * 10**9] * 2), outputs)

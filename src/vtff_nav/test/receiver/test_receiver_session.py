"""The session with a receiver, on a fake port and with a clock of the test: no waiting."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from receiver_port_support import COMMANDS, FakePort, Outputs, epoch_time, epochs_of, same_epoch

from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.receiver.live_port import PortError
from vtff_nav.receiver.receiver_session import (
    OPENING_PATIENCE,
    ReceiverSession,
    SessionSettings,
    SessionState,
)
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware

TICK = 0.01  # s
EXAMPLES = settings(max_examples=20)


class Bench:
    """A session, an emulated receiver and the line between them, in simulated wall time.

    Parameters
    ----------
    baud : int or None
        Rate of the driver's port; None is TCP.
    receiver : ReceiverFirmware, optional
    commands : tuple of str
    """

    def __init__(self, baud=460800, receiver=None, commands=COMMANDS, **changes):
        self.receiver = receiver or ReceiverFirmware(baud=baud or 9600)
        self.outputs = Outputs()
        self.now = 100.0
        self.epoch = 0
        self.ports: list[FakePort] = []
        self.reports: list[tuple[bool, str]] = []
        self.events = []
        self.baud = baud
        self.is_plugged = True
        self.hears = True  # the receiver hears the driver
        self.is_on = True
        self.stream = ReceiverLogStream()
        self.session = ReceiverSession(
            self._open,
            self.stream,
            SessionSettings(commands=commands, **changes),
            report=lambda is_problem, text: self.reports.append((is_problem, text)),
        )

    def _open(self):
        if not self.is_plugged:
            raise PortError("cannot open fake: no such device")
        self.ports.append(FakePort(self.baud))
        return self.ports[-1]

    @property
    def port(self) -> FakePort:
        return self.ports[-1]

    def put(self, content: bytes) -> None:
        """Let bytes of the receiver arrive, garbled if the rates differ."""
        if self.baud is not None and self.port.baud != self.receiver.baud:
            content = bytes((byte * 167 + 0x80) & 0xFF for byte in content)
        self.port.arriving += content

    def tick(self, epochs: int = 0) -> None:
        self.now += TICK
        self.events += self.session.advance(self.now)
        if not self.ports or self.port.is_closed:
            return
        sent, self.port.sent = bytes(self.port.sent), bytearray()
        is_readable = self.baud is None or self.port.baud == self.receiver.baud
        rate = self.receiver.baud
        if sent and self.is_on and self.hears and is_readable:
            answer = self.receiver.receive(sent)
            if rate != self.receiver.baud:  # the answer still comes at the old rate
                self.port.arriving += answer
            else:
                self.put(answer)
        for _ in range(epochs):
            content = self.receiver.advance(epoch_time(self.epoch), self.outputs)
            self.epoch += 1
            if self.is_on:
                self.put(content)

    def run(self, seconds: float, epochs_per_tick: int = 0) -> None:
        for _ in range(round(seconds / TICK)):
            self.tick(epochs_per_tick)

    def until_running(self, patience: float = 30.0) -> float:
        """Return how long, s, it took."""
        began = self.now
        while not self.session.is_running:
            assert self.now - began < patience, self.session.problem
            self.tick()
        return self.now - began


def test_commands_are_sent_one_after_another():
    bench = Bench()
    bench.until_running()
    assert bench.receiver.active_logs == (
        "RANGEB ONTIME 0.05",
        "BESTXYZB ONTIME 1",
        "TIMEB ONTIME 1",
    )
    assert bench.session.problem == ""
    assert bench.session.version.serial_number == "VTFF00000000"
    assert (bench.session.configurations, bench.session.reconnects) == (1, 0)
    bench.run(0.3, epochs_per_tick=1)
    assert sum(isinstance(event, ObservationEpoch) for event in bench.events) > 20


def test_without_commands_nothing_is_sent():
    bench = Bench(commands=())
    bench.receiver.receive(b"LOG RANGEB ONTIME 0.05\r\n")
    bench.run(1.0, epochs_per_tick=1)
    assert bench.session.is_running
    assert bench.port.sent == b""
    assert len(bench.events) > 90
    bench.is_on = False
    bench.run(4.0)
    assert bench.session.problem == "nothing was received for 3 s"
    bench.is_on = True
    bench.run(0.1, epochs_per_tick=1)
    assert bench.session.problem == ""


def test_a_refused_command_is_named_and_the_others_are_sent():
    commands = (COMMANDS[0], "LOG THISPORT NONSENSEB ONTIME 1", *COMMANDS[1:])
    bench = Bench(commands=commands)
    bench.until_running()
    said = "'LOG THISPORT NONSENSEB ONTIME 1': ERROR:Invalid Message. Field = NONSENSEB"
    assert bench.session.problem == said
    assert len(bench.receiver.active_logs) == 3
    attempts = [text for is_problem, text in bench.reports if is_problem]
    assert len(attempts) == 3
    assert "command 'LOG THISPORT NONSENSEB ONTIME 1', attempt 1: ERROR:Invalid" in attempts[0]


@pytest.mark.parametrize("actual", [9600, 115200, 921600])
def test_the_baud_rate_is_found_and_changed(actual):
    bench = Bench(receiver=ReceiverFirmware(baud=actual))
    bench.until_running()
    assert bench.receiver.baud == 460800
    assert bench.port.baud == 460800
    assert (True, f"the receiver was found at {actual} baud and is set to 460800") in bench.reports
    assert len(bench.receiver.active_logs) == 3


def test_the_baud_rate_is_not_looked_for_if_not_wanted():
    bench = Bench(receiver=ReceiverFirmware(baud=9600), searches_baud=False)
    bench.run(5.0)
    assert bench.session.problem == "the receiver does not answer at 460800 baud"
    assert {port.baud for port in bench.ports} == {460800}


def test_a_receiver_that_changes_its_rate_is_followed():
    bench = Bench()
    bench.until_running()
    bench.run(0.5, epochs_per_tick=1)
    bench.receiver.receive(b"SERIALCONFIG COM1 115200\r\n")
    bench.run(1.0, epochs_per_tick=1)
    began = bench.now
    while bench.receiver.baud != 460800 or not bench.session.is_running:
        assert bench.now - began < 20.0
        bench.tick(1)
    bench.run(0.5, epochs_per_tick=1)
    assert isinstance(bench.events[-1], ObservationEpoch)
    assert "wrong baud rate?" in " ".join(text for _, text in bench.reports)


def test_a_power_cycle_is_noticed_and_the_logs_are_asked_for_again():
    bench = Bench()
    bench.until_running()
    bench.run(0.5, epochs_per_tick=1)
    bench.is_on = False
    bench.run(2.0)
    bench.is_on = True
    bench.put(bench.receiver.power_cycle())
    assert bench.receiver.active_logs == ()
    bench.run(3.2)
    bench.until_running()
    assert len(bench.receiver.active_logs) == 3
    assert bench.session.configurations == 2
    assert bench.session.last_problem == "nothing was received for 3 s"
    assert bench.session.problem == ""


def test_a_receiver_with_nothing_to_send_is_asked_less_and_less_often():
    bench = Bench()
    times = []
    bench.until_running()
    for _ in range(round(100.0 / TICK)):
        bench.tick()
        if bench.session.configurations > len(times):
            times.append(bench.now)
    pauses = [later - earlier for earlier, later in zip(times, times[1:], strict=False)]
    assert pauses == pytest.approx([3.0, 6.0, 12.0, 24.0, 24.0, 24.0], abs=0.5)
    bench.run(0.2, epochs_per_tick=1)
    bench.run(3.5)
    assert bench.session.last_problem == "nothing was received for 3 s"


def test_unplugged_and_plugged_in_again_with_growing_pauses():
    bench = Bench()
    bench.until_running()
    bench.port.is_lost = True
    bench.is_plugged = False
    tried = []
    original = bench._open
    bench.session._open_port = lambda: (tried.append(bench.now), original())[1]
    bench.run(30.0)
    assert bench.session.state is SessionState.ABSENT
    assert bench.session.problem == "cannot open fake: no such device"
    pauses = [later - earlier for earlier, later in zip(tried, tried[1:], strict=False)]
    assert pauses[:3] == pytest.approx([0.4, 0.8, 1.6], abs=2 * TICK)
    assert max(pauses) == pytest.approx(5.0, abs=2 * TICK)
    bench.is_plugged = True
    bench.until_running()
    assert bench.session.reconnects == 1
    assert bench.session.configurations == 2
    bench.port.is_lost = True
    bench.run(0.5)
    assert bench.session.is_running  # the pauses begin anew after a success


def test_a_port_that_comes_while_the_nodes_start_is_no_problem_to_tell():
    bench = Bench()
    bench.is_plugged = False
    bench.run(0.5 * OPENING_PATIENCE)
    assert bench.session.problem == "cannot open fake: no such device"
    assert not any(is_problem for is_problem, _ in bench.reports)
    bench.is_plugged = True
    bench.until_running()
    assert not any(is_problem for is_problem, _ in bench.reports)
    assert bench.session.problem == ""


def test_a_port_that_stays_absent_is_told_once():
    bench = Bench()
    bench.is_plugged = False
    bench.run(4.0 * OPENING_PATIENCE)
    problems = [text for is_problem, text in bench.reports if is_problem]
    assert problems == ["cannot open fake: no such device"]


def test_a_receiver_that_sends_but_does_not_hear_is_used_as_it_is():
    bench = Bench(baud=None, command_attempts=2)
    bench.receiver.receive(b"LOG RANGEB ONTIME 0.05\r\n")
    bench.hears = False
    bench.run(10.0, epochs_per_tick=1)
    assert bench.session.is_running
    assert bench.session.problem == "'UNLOGALL THISPORT TRUE': no answer"
    assert isinstance(bench.events[-1], ObservationEpoch)


def test_a_silent_receiver_is_looked_for_again_and_again():
    bench = Bench()
    bench.is_on = False
    bench.run(40.0)
    assert not bench.session.is_running
    assert "does not answer at 460800 baud nor at any other" in bench.session.problem
    assert bench.session.connections > 3
    bench.is_on = True
    bench.until_running()


def test_a_late_answer_is_not_taken_for_that_of_the_next_command():
    bench = Bench(baud=None, commands=("UNLOGALL", "NONSENSE", "LOG VERSIONB"), command_timeout=0.2)
    line = []  # the receiver takes long for everything

    def slow(content, _receive=bench.receiver.receive):
        line.append((bench.now + 0.25, _receive(content)))
        return b""

    bench.receiver.receive = slow
    for _ in range(3000):
        bench.tick()
        while line and line[0][0] <= bench.now:
            bench.put(line.pop(0)[1])
        if bench.session.is_running:
            break
    assert "UNLOGALL" not in bench.session.refused
    assert "LOG VERSIONB" not in bench.session.refused


def test_requests_are_answered_in_order_between_logs():
    bench = Bench()
    bench.until_running()
    good = bench.session.request("LOG BESTXYZB ONTIME 2", bench.now + 2.0)
    bad = bench.session.request("LOG NONSENSE", bench.now + 2.0)
    bench.run(0.5, epochs_per_tick=1)
    assert good.is_over and good.answer.is_ok
    assert bad.is_over and bad.answer.text == "ERROR:Invalid Message. Field = NONSENSE"
    bench.hears = False
    unheard = bench.session.request("LOG VERSION", bench.now + 2.0)
    bench.run(1.9, epochs_per_tick=1)
    assert not unheard.is_over
    bench.run(0.2, epochs_per_tick=1)
    assert unheard.is_over and unheard.answer is None
    bench.hears = True
    again = bench.session.request("LOG NONSENSE", bench.now + 2.0)
    bench.run(1.0, epochs_per_tick=1)
    assert not again.answer.is_ok
    assert bench.session.is_running


def test_a_request_without_a_connection_ends_too():
    bench = Bench()
    bench.is_plugged = False
    bench.tick()
    request = bench.session.request("LOG VERSION", bench.now + 1.0)
    bench.run(1.2)
    assert request.is_over and request.answer is None


def clean_stream(seconds: int) -> bytes:
    receiver = ReceiverFirmware()
    receiver.receive(b"LOG RANGEB ONTIME 0.05\r\nLOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n")
    outputs = Outputs(signals=36)
    return b"".join(receiver.advance(epoch_time(n), outputs) for n in range(20 * seconds))


CLEAN = clean_stream(10)
CLEAN_EPOCHS = {epoch.time.nanoseconds: epoch for epoch in epochs_of(CLEAN)}
BYTES_PER_SECOND = len(CLEAN) / 10.0


def read_by_session(content: bytes, chunks) -> list[ObservationEpoch]:
    """Feed bytes to a session in chunks and return the epochs that it yields."""
    bench = Bench(baud=None, commands=(), receiver_timeout=math.inf)
    bench.tick()
    position = 0
    while position < len(content):
        length = next(chunks)
        bench.port.arriving += content[position : position + length]
        position += length
        bench.tick()
    bench.events += bench.stream.close()
    return [event for event in bench.events if isinstance(event, ObservationEpoch)]


@EXAMPLES
@given(st.integers(0, 2**32), st.integers(1, 3000))
def test_how_reads_are_split_does_not_matter(seed, longest):
    generator = random.Random(seed)
    chunks = iter(lambda: generator.randint(1, longest), None)
    part = CLEAN[:20_000]
    epochs = read_by_session(part, chunks)
    assert epochs == epochs_of(part)


def assert_only_true_epochs(epochs, damaged: bytes) -> None:
    """Every epoch is one of the clean stream, and every intact frame was decoded."""
    assert all(same_epoch(epoch, CLEAN_EPOCHS[epoch.time.nanoseconds]) for epoch in epochs)
    times = [epoch.time.nanoseconds for epoch in epochs]
    assert times == sorted(set(times))
    intact = [e.time.nanoseconds for e in CLEAN_EPOCHS.values() if frame_of(e) in damaged]
    assert set(intact) <= set(times)


FRAMES: dict[int, bytes] = {}


def frame_of(epoch: ObservationEpoch) -> bytes:
    """Return the frame of a clean epoch."""
    if not FRAMES:
        receiver, outputs = ReceiverFirmware(), Outputs(signals=36)
        receiver.receive(b"LOG RANGEB ONTIME 0.05\r\n")
        for number in range(200):
            time = epoch_time(number)
            FRAMES[time.nanoseconds] = receiver.advance(time, outputs)
    return FRAMES[epoch.time.nanoseconds]


@EXAMPLES
@given(st.integers(0, 2**32))
def test_one_byte_in_5000_corrupted(seed):
    generator = random.Random(seed)
    damaged = bytearray(CLEAN)
    hits = [n for n in range(len(damaged)) if generator.random() < 1.0 / 5000.0]
    for hit in hits:
        damaged[hit] ^= generator.randint(1, 255)
    epochs = read_by_session(bytes(damaged), iter(lambda: generator.randint(1, 2000), None))
    assert_only_true_epochs(epochs, bytes(damaged))
    assert len(epochs) >= 200 - len(hits)


@EXAMPLES
@given(st.integers(0, 2**32))
def test_bursts_of_dropped_bytes(seed):
    generator = random.Random(seed)
    parts, position, bursts = [], 0, 0
    while position < len(CLEAN):
        end = position + generator.randint(2000, 30_000)
        parts.append(CLEAN[position:end])
        position = end + generator.randint(1, 200)
        bursts += 1
    damaged = b"".join(parts)
    epochs = read_by_session(damaged, iter(lambda: generator.randint(1, 2000), None))
    assert_only_true_epochs(epochs, damaged)
    assert len(epochs) >= 200 - 2 * bursts


@EXAMPLES
@given(st.integers(0, 2**32))
def test_intact_frames_are_decoded_within_half_a_second(seed):
    """Half a second of scenario time is half a second's worth of bytes behind the frame."""
    generator = random.Random(seed)
    damaged = bytearray(CLEAN)
    for hit in range(len(damaged)):
        if generator.random() < 1.0 / 5000.0:
            damaged[hit] ^= generator.randint(1, 255)
    content = bytes(damaged)
    bench = Bench(baud=None, commands=(), receiver_timeout=math.inf)
    bench.tick()
    seen: dict[int, int] = {}
    for start in range(0, len(content), 400):
        bench.port.arriving += content[start : start + 400]
        count = len(bench.events)
        bench.tick()
        for event in bench.events[count:]:
            if isinstance(event, ObservationEpoch):
                seen[event.time.nanoseconds] = start + 400
    for epoch in CLEAN_EPOCHS.values():
        end = content.find(frame_of(epoch)) + len(frame_of(epoch))
        if frame_of(epoch) in content and len(content) - end > 0.5 * BYTES_PER_SECOND:
            assert seen[epoch.time.nanoseconds] - end < 0.5 * BYTES_PER_SECOND

"""Receivers for tests of the driver: one on a fake port, and emulated ones on real ports."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.fix import STATUS_SINGLE, Fix, ReceiverTime
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch, ObservationSeries
from vtff_nav.receiver.live_port import PortError
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.receiver_logs import EpochOfSeries
from vtff_sim_bridge.receiver.receiver_port import ReceiverPort

START = parse_epoch("2016-03-21T01:00:00 GPS")
EPOCH = 50_000_000  # ns
PATIENCE = 20.0  # s of wall time before a test gives up

COMMANDS = (
    "UNLOGALL THISPORT TRUE",
    "LOG THISPORT RANGEB ONTIME 0.05",
    "LOG THISPORT BESTXYZB ONTIME 1",
    "LOG THISPORT TIMEB ONTIME 1",
)


def epoch_time(number: int) -> GpsTime:
    """Return the time of a 20 Hz epoch since `START`."""
    return GpsTime(START.nanoseconds + number * EPOCH)


class Outputs:
    """Observations that an emulated receiver logs: a few signals that change every epoch."""

    def __init__(self, signals: int = 6, seed: int = 1) -> None:
        self._signals = signals
        self._seed = seed

    def observations(self, time: GpsTime) -> EpochOfSeries:
        number = (time.nanoseconds - START.nanoseconds) // EPOCH
        generator = np.random.default_rng((self._seed, number))
        count = self._signals
        columns = {name: np.zeros((1, count), kind) for name, kind in OBSERVATION_COLUMNS.items()}
        for name in ("system", "prn", "band", "attribute", "glonass_channel"):
            columns[name] = columns[name][0]
        columns["prn"][:] = np.arange(count) % 31 + 1
        columns["band"][:] = np.where(np.arange(count) < 31, 1, 2)
        columns["attribute"][:] = np.where(np.arange(count) < 31, ord("C"), ord("W"))
        columns["pseudorange"][:] = 2.2e7 + generator.normal(0.0, 1e3, count)
        columns["carrier_phase_cycles"][:] = 1.1e8 + generator.normal(0.0, 1e3, count)
        columns["cn0_dbhz"][:] = 45.0
        columns["lock_time"][:] = 10.0 + 0.05 * number
        columns["flags"][:] = 7
        observed = np.ones((1, count), dtype=bool)
        return EpochOfSeries(ObservationSeries((time,), 180, 0, "RANGE", observed, **columns), 0)

    def fix(self, time: GpsTime) -> Fix:
        none = (0.0, 0.0, 0.0)
        return Fix(
            time, STATUS_SINGLE, 16, (7e6, 0.0, 0.0), (0.0, 7.5e3, 0.0), none, none,
            velocity_latency=0.0, satellites_tracked=6, satellites_used=6,
            clock_offset=0.0, clock_offset_sigma=0.0,
        )  # fmt: skip

    def receiver_time(self, time: GpsTime) -> ReceiverTime:
        return ReceiverTime(time, True, 1e-8, 1e-9, -17.0)

    def ephemerides(self, time: GpsTime) -> tuple:
        return ()

    def ionosphere_utc(self, time: GpsTime) -> tuple:
        return ()


class FakePort:
    """A port whose other end is the test: `arriving` is read, `sent` was written."""

    def __init__(self, baud: int | None = None) -> None:
        self.baud = baud
        self.arriving = bytearray()
        self.sent = bytearray()
        self.is_lost = False
        self.is_closed = False
        self.read_length = 1 << 16

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        if self.is_lost:
            raise PortError("the fake port was lost")
        chunk = bytes(self.arriving[: self.read_length])
        del self.arriving[: len(chunk)]
        return chunk

    def write(self, content: bytes | bytearray) -> int:
        if self.is_lost:
            raise PortError("the fake port was lost")
        taken = content[:7]  # a slow line takes a command in parts
        self.sent += taken
        return len(taken)

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        self.is_closed = True


@dataclasses.dataclass
class Served:
    """An emulated receiver in a thread: `port` is its `ReceiverPort`; use `lock` to touch both."""

    receiver: ReceiverFirmware
    port: ReceiverPort
    lock: threading.Lock
    epoch: int = 0

    def advance(self, epochs: int, outputs: Outputs) -> None:
        """Send what is due at the next 20 Hz epochs."""
        with self.lock:
            for _ in range(epochs):
                self.port.send(self.receiver.advance(epoch_time(self.epoch), outputs))
                self.epoch += 1


@contextlib.contextmanager
def serving(receiver: ReceiverFirmware, **options: Any) -> Iterator[Served]:
    """Serve an `ReceiverFirmware` on the ports that the options name."""
    port = ReceiverPort(receiver, **options)
    served = Served(receiver, port, threading.Lock())
    ended = threading.Event()

    def serve() -> None:
        while not ended.wait(0.001):
            with served.lock:
                port.process()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield served
    finally:
        ended.set()
        thread.join()
        port.close()


def until(is_reached: Callable[[], bool], each: Callable[[], object]) -> None:
    """Call `each` again and again until something is reached."""
    deadline = time.monotonic() + PATIENCE
    while not is_reached():
        assert time.monotonic() < deadline
        each()
        time.sleep(0.001)


def epochs_of(content: bytes) -> list[ObservationEpoch]:
    """Return the epochs in a byte stream."""
    stream = ReceiverLogStream()
    events = stream.feed(content) + stream.close()
    return [event for event in events if isinstance(event, ObservationEpoch)]


def same_epoch(first: ObservationEpoch, second: ObservationEpoch) -> bool:
    """Whether two epochs hold the same; the sign of a lost lock depends on what came before."""
    ours, theirs = first.columns(), second.columns()
    return first.time == second.time and all(
        np.array_equal(ours[name] & 15 if name == "flags" else ours[name],
                       theirs[name] & 15 if name == "flags" else theirs[name], equal_nan=True)
        for name in ours
    )  # fmt: skip

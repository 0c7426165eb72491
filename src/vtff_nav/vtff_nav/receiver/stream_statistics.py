"""Statistics for /diagnostics: observations of a receiver, and rates and load of its line."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss.fix import ReceiverTime
from vtff_gnss.novatel import Event
from vtff_gnss.observations import ObservationEpoch

__all__ = ["StreamStatistics"]

#: Receiver time over which rates are formed.
WINDOW_SECONDS = 10
#: A serial line sends 10 bits for each byte: start bit, 8 bits, stop bit.
BITS_PER_BYTE = 10

_TIME_STATUS_NAMES = {
    20: "unknown", 60: "approximate", 80: "coarse, adjusting", 100: "coarse",
    120: "coarse steering", 130: "free wheeling", 140: "fine, adjusting", 160: "fine",
    170: "fine, backup steering", 180: "fine steering", 200: "from satellite",
}  # fmt: skip


class StreamStatistics:
    """Newest epoch, and rates per second of receiver time, valid also faster than real time."""

    def __init__(self) -> None:
        self._bytes = 0
        #: Receiver time (ns) and bytes received so far, one for each observation epoch.
        self._epochs: deque[tuple[int, int]] = deque()
        self._newest: ObservationEpoch | None = None
        self._time: ReceiverTime | None = None

    @property
    def satellites(self) -> int:
        """Number of satellites in the newest epoch."""
        epoch = self._newest
        if epoch is None:
            return 0
        return len(set(zip(epoch.system.tolist(), epoch.prn.tolist(), strict=True)))

    @property
    def newest_nanoseconds(self) -> int:
        """Unix time of the newest epoch; 0 before the first."""
        return 0 if self._newest is None else self._newest.time.to_unix_nanoseconds()

    def add(self, byte_count: int, events: Iterable[Event]) -> None:
        """Add the bytes and events of one read; its epochs share the bytes evenly."""
        times: list[int] = []
        for event in events:
            if isinstance(event, ObservationEpoch):
                times.append(event.time.nanoseconds)
                self._newest = event
            elif isinstance(event, ReceiverTime):
                self._time = event
        epochs = self._epochs
        for number, time in enumerate(times, 1):
            newest = epochs[-1][0] if epochs else time
            if not 0 <= time - newest <= NANOSECONDS_PER_SECOND:
                epochs.clear()  # rates are computed within one sequence without a gap
            if not epochs or time > newest:
                epochs.append((time, self._bytes + byte_count * number // len(times)))
        while times and times[-1] - epochs[0][0] > WINDOW_SECONDS * NANOSECONDS_PER_SECOND:
            epochs.popleft()
        self._bytes += byte_count

    def rates(self) -> tuple[float, float]:
        """Return epochs/s and bytes/s of receiver time; NaN with fewer than two epochs."""
        if len(self._epochs) < 2:
            return math.nan, math.nan
        (first, bytes_first), (last, bytes_last) = self._epochs[0], self._epochs[-1]
        span = (last - first) / NANOSECONDS_PER_SECOND
        return (len(self._epochs) - 1) / span, (bytes_last - bytes_first) / span

    def line_values(self, baud: int | None) -> dict[str, str]:
        """Return rates and load for /diagnostics; `baud` is None for a link without a rate."""
        epoch_rate, byte_rate = self.rates()
        if math.isnan(epoch_rate):
            return {}
        values = {"epochs/s": f"{epoch_rate:.2f}", "bytes/s": f"{byte_rate:.0f}"}
        if baud:
            values["link load %"] = f"{100.0 * byte_rate * BITS_PER_BYTE / baud:.1f}"
        return values

    def tracking_values(self) -> dict[str, str]:
        """Return satellites, C/N0 and clock of the newest epoch for /diagnostics."""
        epoch = self._newest
        if epoch is None:
            return {"satellites": "0"}
        status = int(epoch.time_status)
        values = {
            "satellites": str(self.satellites),
            "signals": str(len(epoch)),
            "time status": _TIME_STATUS_NAMES.get(status, str(status)),
            "receiver status": f"{epoch.receiver_status:#010x}",
            "GPS week": str(epoch.gps_week),
            "time of week": f"{epoch.gps_time_of_week:.3f}",
        }
        if len(epoch):
            values["C/N0 mean dB-Hz"] = f"{float(epoch.cn0_dbhz.mean()):.1f}"
            values["C/N0 least dB-Hz"] = f"{float(epoch.cn0_dbhz.min()):.1f}"
        if self._time is not None:
            values["clock offset"] = f"{self._time.clock_offset:.3e} s"
            values["clock model"] = "valid" if self._time.is_valid else "not valid"
        return values

"""Observation epochs to RANGECMP4 (OEM7 reference manual, log RANGECMP4).

The layout, and what it cannot hold, is described with its decoder in `rangecmp45`; both use the
tables of `rangecmp45_layout`. Logs of whole seconds hold reference blocks; logs between hold
differences to them.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from typing import NamedTuple

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss import constants as c
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.encode.frame import HeaderSettings, encode_frame
from vtff_gnss.novatel.encode.range import prn_novatel, tracking_status
from vtff_gnss.novatel.range import rangecmp45_layout as layout
from vtff_gnss.novatel.range.range_logs import GLONASS_CHANNEL_OFFSET
from vtff_gnss.novatel.range.rangecmp2 import COMPRESSED_SYSTEMS
from vtff_gnss.novatel.range.record_columns import LOCK_TIME_CLASSES, wavelength
from vtff_gnss.novatel.range.tracking_status import signal_from_status
from vtff_gnss.observations import ObservationEpoch

__all__ = ["RangeCmp4Encoder"]

_SYSTEM_NUMBER = {system: number for number, system in COMPRESSED_SYSTEMS.items()}
_SIGNAL_NUMBER = {
    (system, signal): number for (system, number), signal in layout.SIGNAL_TYPES.items()
}
_PRN_OF_FIRST_SATELLITE = {c.SYSTEM_GLONASS: 38, c.SYSTEM_QZSS: 193}


class _Signal(NamedTuple):
    """One signal; pseudorange and phase range in m, range rate in m/s, NaN where invalid."""

    number: int
    column: int
    pseudorange: float
    phase_range: float
    range_rate: float


class _Difference(NamedTuple):
    """Values of a reference block as the decoder has them; differential blocks refer to them."""

    pseudorange: float
    phase_range: float
    range_rate: float


@dataclass
class _Bits:
    """Bit fields, least significant bit first."""

    value: int = 0
    length: int = 0

    def add(self, value: int, width: int) -> None:
        self.value |= (value & ((1 << width) - 1)) << self.length
        self.length += width

    def add_mask(self, members: list[int], width: int) -> None:
        self.add(sum(1 << member for member in members), width)

    def to_payload(self) -> bytes:
        length = (self.length + 7) // 8
        return length.to_bytes(4, "little") + self.value.to_bytes(length, "little")


class RangeCmp4Encoder:
    """Encodes epochs in sequence.

    Quantisation: pseudorange 0.5 mm, carrier phase 0.1 mm, range rate 0.1 mm/s, C/N0 0.05 dB,
    lock time in classes of a factor 2 (rounded down), sigmas rounded up to the next of 16 steps.
    Values that do not fit are sent as invalid, as by a receiver: a carrier phase more than 419 m
    from the pseudorange, a range rate above 3355 m/s, a pseudorange of a secondary signal more than
    262 m from that of the primary. A satellite whose differences do not fit (phase 3.3 m, range
    rate 0.8 m/s for secondary signals), or that has no reference, is sent as a reference block
    also between whole seconds: in low Earth orbit most are. The number of a block is its second
    modulo 8, so that a difference is not applied to a reference of another second.
    """

    def __init__(self) -> None:
        self._second = -1
        self._references: dict[tuple[int, int, int], _Difference] = {}

    def encode(self, epoch: ObservationEpoch, settings: HeaderSettings) -> bytes:
        """Return an epoch as a RANGECMP4 log.

        Raises
        ------
        ValueError
            If the time is not a whole millisecond, or RANGECMP4 has no number for a signal.
        """
        second, nanoseconds = divmod(epoch.time.nanoseconds, NANOSECONDS_PER_SECOND)
        if nanoseconds == 0 or second != self._second:
            self._references.clear()
            self._second = second
        bits = _Bits()
        systems = _group_signals(epoch)
        bits.add_mask(sorted(systems), 16)
        for system_number, satellites in sorted(systems.items()):
            numbers = sorted({s.number for signals in satellites.values() for s in signals})
            bits.add_mask([satellite - 1 for satellite in satellites], 64)
            bits.add_mask(numbers, 16)
            for signals in satellites.values():
                chosen = {signal.number for signal in signals}
                bits.add_mask([i for i, n in enumerate(numbers) if n in chosen], len(numbers))
            for satellite, signals in satellites.items():
                self._add_block(bits, epoch, (system_number, satellite), signals, nanoseconds)
        return encode_frame(
            ids.ID_RANGECMP4,
            bits.to_payload(),
            epoch.time,
            settings,
            epoch.time_status,
            epoch.receiver_status,
        )

    def _add_block(
        self,
        bits: _Bits,
        epoch: ObservationEpoch,
        satellite: tuple[int, int],
        signals: list[_Signal],
        nanoseconds: int,
    ) -> None:
        if nanoseconds:
            rows = self._differences(satellite, signals, nanoseconds * 1e-9)
            if rows is not None:
                bits.add(1, 1)
                bits.add(self._second, 3)
                for position, (signal, values) in enumerate(zip(signals, rows, strict=True)):
                    _add_quality(bits, epoch, signal.column)
                    widths = (
                        layout.SECONDARY_DIFFERENCE if position else (layout.PRIMARY_DIFFERENCE)
                    )
                    for value, width in zip(values, widths, strict=True):
                        bits.add(_field(value, width), width)
                return
        bits.add(0, 1)
        bits.add(self._second, 3)
        if COMPRESSED_SYSTEMS[satellite[0]] == c.SYSTEM_GLONASS:
            channel = int(epoch.glonass_channel[signals[0].column])
            bits.add(channel + GLONASS_CHANNEL_OFFSET, 5)
        primary: _Difference | None = None
        for signal in signals:
            _add_quality(bits, epoch, signal.column)
            sent = _add_absolute(bits, signal, primary)
            primary = primary or sent
            if nanoseconds == 0:
                key = (*satellite, signal.number)
                self._references[key] = sent

    def _differences(
        self, satellite: tuple[int, int], signals: list[_Signal], elapsed: float
    ) -> list[tuple[int | None, int | None, int | None]] | None:
        """Return the differences of all signals of a satellite; None if they do not do."""
        rows = []
        for position, signal in enumerate(signals):
            reference = self._references.get((*satellite, signal.number))
            if reference is None:
                return None
            widths = layout.SECONDARY_DIFFERENCE if position else layout.PRIMARY_DIFFERENCE
            motion = reference.range_rate * elapsed
            row = (
                _steps(
                    signal.pseudorange - reference.pseudorange - motion, layout.PSEUDORANGE_SCALE
                ),
                _steps(
                    signal.phase_range - reference.phase_range - motion, layout.PHASE_RANGE_SCALE
                ),
                _steps(signal.range_rate - reference.range_rate, layout.RANGE_RATE_SCALE),
            )
            wanted = (signal.pseudorange, signal.phase_range, signal.range_rate)
            for value, measured, width in zip(row, wanted, widths, strict=True):
                is_lost = value is None or not _fits(value, width)
                if is_lost and not math.isnan(measured):
                    return None
            rows.append(row)
        return rows


def _group_signals(epoch: ObservationEpoch) -> dict[int, dict[int, list[_Signal]]]:
    """Return the signals by system number and satellite number, all in ascending order."""
    grouped: dict[int, dict[int, list[_Signal]]] = {}
    if not len(epoch):
        return grouped
    signal_types = signal_from_status(tracking_status(epoch)).tolist()
    numbers = prn_novatel(epoch.system, epoch.prn).tolist()
    for index, (system, prn, kind, flags) in enumerate(
        zip(epoch.system.tolist(), numbers, signal_types, epoch.flags.tolist(), strict=True)
    ):
        number = _SIGNAL_NUMBER.get((system, kind))
        if number is None or system not in _SYSTEM_NUMBER:
            raise ValueError(f"signal: type {kind} of system {system} is not in RANGECMP4")
        metres_per_cycle = wavelength(system, kind, int(epoch.glonass_channel[index]))
        has_phase = flags & c.FLAG_PHASE_VALID
        signal = _Signal(
            number,
            index,
            float(epoch.pseudorange[index]) if flags & c.FLAG_CODE_VALID else math.nan,
            float(epoch.carrier_phase_cycles[index]) * metres_per_cycle if has_phase else math.nan,
            -float(epoch.doppler_hz[index]) * metres_per_cycle if has_phase else math.nan,
        )
        satellite = _satellite_number(system, prn)
        grouped.setdefault(_SYSTEM_NUMBER[system], {}).setdefault(satellite, []).append(signal)
    for system_number, satellites in grouped.items():
        grouped[system_number] = {key: sorted(satellites[key]) for key in sorted(satellites)}
    return grouped


def _satellite_number(system: int, prn: int) -> int:
    if system == c.SYSTEM_SBAS:
        return prn - (119 if prn <= 158 else 129)
    return prn - _PRN_OF_FIRST_SATELLITE.get(system, 1) + 1


def _steps(value: float, scale: float) -> int | None:
    return None if math.isnan(value) else round(value / scale)


def _fits(value: int, width: int) -> bool:
    """Tell whether a number is in the range of a field; its most negative one means invalid."""
    return abs(value) < 1 << (width - 1)


def _field(value: int | None, width: int) -> int:
    return -(1 << (width - 1)) if value is None or not _fits(value, width) else value


def _add_quality(bits: _Bits, epoch: ObservationEpoch, index: int) -> None:
    flags = int(epoch.flags[index])
    bits.add(bool(flags & c.FLAG_PARITY_KNOWN), 1)
    bits.add(bool(flags & c.FLAG_HALF_CYCLE_ADDED), 1)
    bits.add(min(max(round(float(epoch.cn0_dbhz[index]) / layout.CN0_SCALE_DBHZ), 0), 2047), 11)
    bits.add(bisect.bisect_right(LOCK_TIME_CLASSES, float(epoch.lock_time[index])) - 1, 4)
    for steps, sigma in (
        (layout.SIGMA_METRES_16, epoch.pseudorange_sigma[index]),
        (layout.SIGMA_CYCLES_16, epoch.carrier_phase_sigma_cycles[index]),
    ):
        # A float32 sigma may lie above its own step by its rounding.
        bits.add(bisect.bisect_left(steps, float(sigma) * (1.0 - 1e-6)), 4)


def _add_absolute(bits: _Bits, signal: _Signal, primary: _Difference | None) -> _Difference:
    """Add a reference block; return the values as they will be decoded."""
    if primary is None:
        widths, is_primary = layout.RANGECMP4.primary, True
        pseudorange_origin, rate_origin = 0.0, 0.0
    else:
        widths, is_primary = layout.RANGECMP4.secondary, False
        pseudorange_origin, rate_origin = primary.pseudorange, primary.range_rate
    code = _steps(signal.pseudorange - pseudorange_origin, layout.PSEUDORANGE_SCALE)
    if is_primary:
        invalid = (1 << widths.pseudorange) - 1
        if code is not None and not 0 <= code < invalid:
            code = None
        bits.add(invalid if code is None else code, widths.pseudorange)
    else:
        if code is not None and not _fits(code, widths.pseudorange):
            code = None
        bits.add(_field(code, widths.pseudorange), widths.pseudorange)
    pseudorange = layout.to_physical(code, layout.PSEUDORANGE_SCALE, pseudorange_origin)
    phase = _within(
        _steps(signal.phase_range - pseudorange, layout.PHASE_RANGE_SCALE), widths.phase_range
    )
    rate = _within(
        _steps(signal.range_rate - rate_origin, layout.RANGE_RATE_SCALE), widths.range_rate
    )
    bits.add(_field(phase, widths.phase_range), widths.phase_range)
    bits.add(_field(rate, widths.range_rate), widths.range_rate)
    return _Difference(
        pseudorange,
        layout.to_physical(phase, layout.PHASE_RANGE_SCALE, pseudorange),
        layout.to_physical(rate, layout.RANGE_RATE_SCALE, rate_origin),
    )


def _within(value: int | None, width: int) -> int | None:
    return value if value is not None and _fits(value, width) else None

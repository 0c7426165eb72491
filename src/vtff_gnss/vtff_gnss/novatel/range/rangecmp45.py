"""RANGECMP4 and RANGECMP5 to columns (OEM7 reference manual, logs RANGECMP4 and RANGECMP5).

Both are streams of bit fields, least significant bit first: systems, satellites and signals as
masks, then a block for each satellite. The first signal of a satellite is the primary one; the
others are coded relative to it. RANGECMP4 between whole seconds holds differences to the log of
the last whole second. Those whose reference was lost are dropped and counted: novatel_edie
2.10.11 decodes them against older references, or loses its place in the log, and gives wrong
observations.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel.range.range_logs import GLONASS_CHANNEL_OFFSET
from vtff_gnss.novatel.range.rangecmp2 import COMPRESSED_SYSTEMS, to_signed
from vtff_gnss.novatel.range.rangecmp45_layout import (
    CN0_SCALE_DBHZ,
    PHASE_RANGE_SCALE,
    PRIMARY_DIFFERENCE,
    PSEUDORANGE_SCALE,
    RANGE_RATE_SCALE,
    RANGECMP4,
    RANGECMP5,
    SECONDARY_DIFFERENCE,
    SIGNAL_TYPES,
    CompressedLayout,
    to_physical,
)
from vtff_gnss.novatel.range.record_columns import (
    CLASS_BOUND,
    LOCK_TIME_CLASSES,
    SignalRow,
    records_from_rows,
    wavelength,
)
from vtff_gnss.novatel.range.signal_records import SignalRecords

__all__ = ["RangeCmp4Decoder", "decode_rangecmp5"]

_UNKNOWN_SYSTEM = 7
_UNKNOWN_SIGNAL = 31


class _Measurement(NamedTuple):
    """Absolute values of one signal: m, m, m/s; NaN where invalid."""

    pseudorange: float
    phase_range: float
    range_rate: float


@dataclass(frozen=True)
class _Reference:
    """A signal in the log of a whole second."""

    second: int
    block_id: int
    glonass_channel: int
    measurement: _Measurement


class _BitReader:
    def __init__(self, name: str, payload: bytes) -> None:
        length = int.from_bytes(payload[:4], "little")
        if 4 + length > len(payload):
            raise ValueError(f"{name}: {length} bytes announced, {len(payload) - 4} received")
        self._name = name
        self._bits = int.from_bytes(payload[4 : 4 + length], "little")
        self._left = 8 * length

    def read_unsigned(self, length: int) -> int:
        """Return the next `length` bits as a number; raise ValueError at the end."""
        if length > self._left:
            raise ValueError(f"{self._name}: bit fields run over the end")
        value = self._bits & ((1 << length) - 1)
        self._bits >>= length
        self._left -= length
        return value

    def read_signed_or_none(self, length: int) -> int | None:
        """Return a two's complement number; None for the most negative one, which means invalid."""
        value = to_signed(self.read_unsigned(length), length)
        return None if value == -(1 << (length - 1)) else value

    def read_members(self, length: int) -> list[int]:
        """Return the numbers of the bits set in a mask."""
        mask = self.read_unsigned(length)
        return [bit for bit in range(length) if mask >> bit & 1]


class _Quality(NamedTuple):
    """The fields that lead every signal block."""

    is_parity_known: int
    is_half_cycle_added: int
    cn0_dbhz: float
    lock_time_class: int
    pseudorange_sigma: float
    carrier_phase_sigma_cycles: float


class _BlockHeader(NamedTuple):
    is_difference: int
    block_id: int
    glonass_channel: int | None


def decode_rangecmp5(payload: bytes) -> SignalRecords:
    """Decode the payload of a RANGECMP5 log.

    Quantisation: pseudorange 0.5 mm, carrier phase 0.1 mm, range rate 0.1 mm/s, C/N0 0.05 dB,
    lock time in classes of a factor 2.

    Raises
    ------
    ValueError
        If the bit fields run over the end of the payload.
    """
    reader = _BitReader(RANGECMP5.name, payload)
    rows: list[SignalRow] = []
    for system, satellite, signals in _satellites(reader):
        header = _block_header(reader, system, has_channel=True)
        primary: _Measurement | None = None
        for signal in signals:
            quality = _quality(reader, RANGECMP5)
            measurement = _absolute(reader, RANGECMP5, primary)
            primary = primary or measurement
            channel = header.glonass_channel or 0
            rows.append(_row(system, satellite, signal, channel, quality, measurement))
    return records_from_rows(rows)


class RangeCmp4Decoder:
    """Decodes RANGECMP4 logs in sequence; keeps the reference of the last whole second.

    Quantisation as RANGECMP5. The range rate of a reference is limited to 3355 m/s, too little
    for some signals in low Earth orbit, where the receiver then marks it invalid.
    """

    def __init__(self) -> None:
        self._references: dict[tuple[int, int, int], _Reference] = {}

    def decode(self, payload: bytes, time: GpsTime) -> tuple[SignalRecords, int]:
        """Decode the payload of the log with the header time `time`.

        Returns
        -------
        records : SignalRecords
        missing_count : int
            Signals left out because their reference was not received.

        Raises
        ------
        ValueError
            If the bit fields run over the end of the payload.
        """
        second, nanoseconds = divmod(time.nanoseconds, NANOSECONDS_PER_SECOND)
        if nanoseconds == 0:
            self._references.clear()
        reader = _BitReader(RANGECMP4.name, payload)
        rows: list[SignalRow] = []
        missing_count = 0
        for system, satellite, signals in _satellites(reader):
            header = _block_header(reader, system, has_channel=False)
            primary: _Measurement | None = None
            for index, signal in enumerate(signals):
                key = (system, satellite, signal)
                quality = _quality(reader, RANGECMP4)
                if header.is_difference:
                    widths = SECONDARY_DIFFERENCE if index else PRIMARY_DIFFERENCE
                    differences = [reader.read_signed_or_none(width) for width in widths]
                    reference = self._references.get(key)
                    if (
                        reference is None
                        or reference.second != second
                        or reference.block_id != header.block_id
                    ):
                        missing_count += 1
                        continue
                    channel = reference.glonass_channel
                    measurement = _from_differences(
                        differences, reference.measurement, nanoseconds * 1e-9
                    )
                else:
                    channel = header.glonass_channel or 0
                    measurement = _absolute(reader, RANGECMP4, primary)
                    primary = primary or measurement
                    if nanoseconds == 0:
                        self._references[key] = _Reference(
                            second, header.block_id, channel, measurement
                        )
                rows.append(_row(system, satellite, signal, channel, quality, measurement))
        return records_from_rows(rows), missing_count


def _satellites(reader: _BitReader) -> Iterator[tuple[int, int, list[int]]]:
    """Yield (system number, satellite number, signal numbers) for each satellite block.

    The blocks lie between the masks, so the caller must read each block before the next step.
    """
    for system in reader.read_members(16):
        satellites = reader.read_members(64)
        signals = reader.read_members(16)
        included = [reader.read_members(len(signals)) for _ in satellites]
        for satellite, chosen in zip(satellites, included, strict=True):
            yield system, satellite + 1, [signals[index] for index in chosen]


def _block_header(reader: _BitReader, system: int, has_channel: bool) -> _BlockHeader:
    is_difference = reader.read_unsigned(1)
    block_id = reader.read_unsigned(3)
    is_glonass = COMPRESSED_SYSTEMS.get(system) == c.SYSTEM_GLONASS
    if is_glonass and (has_channel or not is_difference):
        return _BlockHeader(
            is_difference, block_id, reader.read_unsigned(5) - GLONASS_CHANNEL_OFFSET
        )
    return _BlockHeader(is_difference, block_id, None)


def _quality(reader: _BitReader, layout: CompressedLayout) -> _Quality:
    return _Quality(
        is_parity_known=reader.read_unsigned(1),
        is_half_cycle_added=reader.read_unsigned(1),
        cn0_dbhz=reader.read_unsigned(11) * CN0_SCALE_DBHZ,
        lock_time_class=reader.read_unsigned(4),
        pseudorange_sigma=layout.sigma_metres[reader.read_unsigned(layout.sigma_bits)],
        carrier_phase_sigma_cycles=layout.sigma_cycles[reader.read_unsigned(layout.sigma_bits)],
    )


def _absolute(
    reader: _BitReader, layout: CompressedLayout, primary: _Measurement | None
) -> _Measurement:
    """Read a reference block; `primary` is the first signal of the satellite, if read already."""
    if primary is None:
        widths = layout.primary
        unsigned = reader.read_unsigned(widths.pseudorange)
        is_valid = unsigned != (1 << widths.pseudorange) - 1
        pseudorange = unsigned * PSEUDORANGE_SCALE if is_valid else math.nan
        range_rate_origin = 0.0
    else:
        widths = layout.secondary
        difference = reader.read_signed_or_none(widths.pseudorange)
        pseudorange = to_physical(difference, PSEUDORANGE_SCALE, primary.pseudorange)
        range_rate_origin = primary.range_rate
    phase = reader.read_signed_or_none(widths.phase_range)
    rate = reader.read_signed_or_none(widths.range_rate)
    return _Measurement(
        pseudorange,
        to_physical(phase, PHASE_RANGE_SCALE, pseudorange),
        to_physical(rate, RANGE_RATE_SCALE, range_rate_origin),
    )


def _from_differences(
    differences: list[int | None], reference: _Measurement, elapsed: float
) -> _Measurement:
    pseudorange, phase_range, range_rate = differences
    motion = reference.range_rate * elapsed
    return _Measurement(
        to_physical(pseudorange, PSEUDORANGE_SCALE, reference.pseudorange + motion),
        to_physical(phase_range, PHASE_RANGE_SCALE, reference.phase_range + motion),
        to_physical(range_rate, RANGE_RATE_SCALE, reference.range_rate),
    )


def _prn_novatel(system: int, satellite: int) -> int:
    """Return the PRN as in RANGE; 0 for a GLONASS satellite whose slot is unknown."""
    if system == c.SYSTEM_GLONASS:
        return satellite + 37 if satellite <= 42 else 0
    if system == c.SYSTEM_SBAS:
        return satellite + (119 if satellite <= 39 else 129)
    if system == c.SYSTEM_QZSS:
        return satellite + 192
    return satellite


def _row(
    system_number: int,
    satellite: int,
    signal_number: int,
    channel: int,
    quality: _Quality,
    measurement: _Measurement,
) -> SignalRow:
    system = COMPRESSED_SYSTEMS.get(system_number, _UNKNOWN_SYSTEM)
    signal = SIGNAL_TYPES.get((system, signal_number), _UNKNOWN_SIGNAL)
    metres_per_cycle = wavelength(system, signal, channel)
    lock_class = quality.lock_time_class
    return SignalRow(
        system=system,
        signal=signal,
        prn_novatel=_prn_novatel(system, satellite),
        glonass_channel=channel,
        pseudorange=measurement.pseudorange,
        carrier_phase_cycles=measurement.phase_range / metres_per_cycle,
        doppler_hz=-measurement.range_rate / metres_per_cycle,
        cn0_dbhz=quality.cn0_dbhz,
        pseudorange_sigma=quality.pseudorange_sigma,
        carrier_phase_sigma_cycles=quality.carrier_phase_sigma_cycles,
        lock_time=LOCK_TIME_CLASSES[lock_class],
        lock_time_bound=CLASS_BOUND[lock_class],
        flags=(not math.isnan(measurement.pseudorange)) * c.FLAG_CODE_VALID
        | (not math.isnan(measurement.phase_range)) * c.FLAG_PHASE_VALID
        | quality.is_parity_known * c.FLAG_PARITY_KNOWN
        | quality.is_half_cycle_added * c.FLAG_HALF_CYCLE_ADDED,
    )

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

from vtff_dynamics.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel.range_logs import GLONASS_CHANNEL_OFFSET
from vtff_gnss.novatel.rangecmp2 import COMPRESSED_SYSTEMS, signed
from vtff_gnss.novatel.record_columns import (
    CLASS_BOUND,
    LOCK_TIME_CLASSES,
    SignalRow,
    records_from_rows,
    wavelength,
)
from vtff_gnss.novatel.signal_records import SignalRecords

__all__ = ["RangeCmp4Decoder", "decode_rangecmp5"]

_PSEUDORANGE_SCALE = 0.0005
_PHASE_RANGE_SCALE = 0.0001
_RANGE_RATE_SCALE = 0.0001
_CN0_SCALE_DBHZ = 0.05

# Signal numbers of RANGECMP4 and 5 to the signal types of the tracking status word.
_SIGNALS = {
    (c.SYSTEM_GPS, 1): 0,
    (c.SYSTEM_GPS, 4): 9,
    (c.SYSTEM_GPS, 5): 17,
    (c.SYSTEM_GPS, 6): 5,
    (c.SYSTEM_GPS, 7): 14,
    (c.SYSTEM_GPS, 15): 16,
    (c.SYSTEM_GLONASS, 1): 0,
    (c.SYSTEM_GLONASS, 3): 1,
    (c.SYSTEM_GLONASS, 4): 5,
    (c.SYSTEM_GLONASS, 6): 6,
    (c.SYSTEM_SBAS, 1): 0,
    (c.SYSTEM_SBAS, 2): 6,
    (c.SYSTEM_GALILEO, 1): 2,
    (c.SYSTEM_GALILEO, 2): 12,
    (c.SYSTEM_GALILEO, 3): 17,
    (c.SYSTEM_GALILEO, 4): 20,
    (c.SYSTEM_GALILEO, 5): 7,
    (c.SYSTEM_GALILEO, 12): 6,
    (c.SYSTEM_BEIDOU, 1): 0,
    (c.SYSTEM_BEIDOU, 2): 4,
    (c.SYSTEM_BEIDOU, 3): 1,
    (c.SYSTEM_BEIDOU, 4): 5,
    (c.SYSTEM_BEIDOU, 5): 2,
    (c.SYSTEM_BEIDOU, 6): 6,
    (c.SYSTEM_BEIDOU, 7): 7,
    (c.SYSTEM_BEIDOU, 9): 9,
    (c.SYSTEM_BEIDOU, 11): 11,
    (c.SYSTEM_QZSS, 1): 0,
    (c.SYSTEM_QZSS, 3): 17,
    (c.SYSTEM_QZSS, 4): 14,
    (c.SYSTEM_QZSS, 8): 16,
    (c.SYSTEM_QZSS, 11): 27,
    (c.SYSTEM_NAVIC, 1): 0,
}
_UNKNOWN_SYSTEM = 7
_UNKNOWN_SIGNAL = 31

_SIGMA_METRES_16 = (
    *(0.020, 0.030, 0.045, 0.066, 0.099, 0.148, 0.220, 0.329),
    *(0.491, 0.732, 1.092, 1.629, 2.430, 3.625, 5.409, float("inf")),
)
_SIGMA_CYCLES_16 = (
    *(0.00391, 0.00521, 0.00696, 0.00929, 0.01239, 0.01654, 0.02208, 0.02947),
    *(0.03933, 0.05249, 0.07006, 0.09350, 0.12480, 0.16656, 0.22230, float("inf")),
)
_SIGMA_METRES_32 = (
    *(0.020, 0.030, 0.045, 0.066, 0.099, 0.148, 0.220, 0.329, 0.491, 0.732, 1.092),
    *(1.629, 2.430, 3.625, 5.409, 6.876, 8.741, 11.111, 14.125, 17.957, 22.828, 29.020),
    *(36.891, 46.898, 59.619, 75.791, 96.349, 122.484, 155.707, 197.943, 251.634, float("inf")),
)
_SIGMA_CYCLES_32 = (
    *(0.00391, 0.00458, 0.00536, 0.00628, 0.00735, 0.00861, 0.01009, 0.01182),
    *(0.01385, 0.01621, 0.01900, 0.02223, 0.02607, 0.03054, 0.03577, 0.04190),
    *(0.04908, 0.05749, 0.06734, 0.07889, 0.09240, 0.10824, 0.12679, 0.14851),
    *(0.17396, 0.20378, 0.23870, 0.27961, 0.32753, 0.38366, 0.44940, float("inf")),
)


class _Widths(NamedTuple):
    """Bits of pseudorange, phase range and range rate of one kind of block."""

    pseudorange: int
    phase_range: int
    range_rate: int


@dataclass(frozen=True)
class _Layout:
    """What differs between the logs."""

    name: str
    sigma_bits: int
    sigma_metres: tuple[float, ...]
    sigma_cycles: tuple[float, ...]
    primary: _Widths
    secondary: _Widths


_RANGECMP4 = _Layout(
    name="RANGECMP4",
    sigma_bits=4,
    sigma_metres=_SIGMA_METRES_16,
    sigma_cycles=_SIGMA_CYCLES_16,
    primary=_Widths(37, 23, 26),
    secondary=_Widths(20, 23, 14),
)
_RANGECMP5 = _Layout(
    name="RANGECMP5",
    sigma_bits=5,
    sigma_metres=_SIGMA_METRES_32,
    sigma_cycles=_SIGMA_CYCLES_32,
    primary=_Widths(37, 23, 28),
    secondary=_Widths(20, 23, 16),
)
_PRIMARY_DIFFERENCE = _Widths(19, 16, 18)
_SECONDARY_DIFFERENCE = _Widths(19, 16, 14)


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

    def unsigned(self, length: int) -> int:
        if length > self._left:
            raise ValueError(f"{self._name}: bit fields run over the end")
        value = self._bits & ((1 << length) - 1)
        self._bits >>= length
        self._left -= length
        return value

    def signed_or_none(self, length: int) -> int | None:
        """Return a two's complement number; None for the most negative one, which means invalid."""
        value = signed(self.unsigned(length), length)
        return None if value == -(1 << (length - 1)) else value

    def members(self, length: int) -> list[int]:
        """Return the numbers of the bits set in a mask."""
        mask = self.unsigned(length)
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
    reader = _BitReader(_RANGECMP5.name, payload)
    rows: list[SignalRow] = []
    for system, satellite, signals in _satellites(reader):
        header = _block_header(reader, system, has_channel=True)
        primary: _Measurement | None = None
        for signal in signals:
            quality = _quality(reader, _RANGECMP5)
            measurement = _absolute(reader, _RANGECMP5, primary)
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
        second, nanoseconds = divmod(time.nanoseconds, 1_000_000_000)
        if nanoseconds == 0:
            self._references.clear()
        reader = _BitReader(_RANGECMP4.name, payload)
        rows: list[SignalRow] = []
        missing_count = 0
        for system, satellite, signals in _satellites(reader):
            header = _block_header(reader, system, has_channel=False)
            primary: _Measurement | None = None
            for index, signal in enumerate(signals):
                key = (system, satellite, signal)
                quality = _quality(reader, _RANGECMP4)
                if header.is_difference:
                    widths = _SECONDARY_DIFFERENCE if index else _PRIMARY_DIFFERENCE
                    differences = [reader.signed_or_none(width) for width in widths]
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
                    measurement = _absolute(reader, _RANGECMP4, primary)
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
    for system in reader.members(16):
        satellites = reader.members(64)
        signals = reader.members(16)
        included = [reader.members(len(signals)) for _ in satellites]
        for satellite, chosen in zip(satellites, included, strict=True):
            yield system, satellite + 1, [signals[index] for index in chosen]


def _block_header(reader: _BitReader, system: int, has_channel: bool) -> _BlockHeader:
    is_difference = reader.unsigned(1)
    block_id = reader.unsigned(3)
    is_glonass = COMPRESSED_SYSTEMS.get(system) == c.SYSTEM_GLONASS
    if is_glonass and (has_channel or not is_difference):
        return _BlockHeader(is_difference, block_id, reader.unsigned(5) - GLONASS_CHANNEL_OFFSET)
    return _BlockHeader(is_difference, block_id, None)


def _quality(reader: _BitReader, layout: _Layout) -> _Quality:
    return _Quality(
        is_parity_known=reader.unsigned(1),
        is_half_cycle_added=reader.unsigned(1),
        cn0_dbhz=reader.unsigned(11) * _CN0_SCALE_DBHZ,
        lock_time_class=reader.unsigned(4),
        pseudorange_sigma=layout.sigma_metres[reader.unsigned(layout.sigma_bits)],
        carrier_phase_sigma_cycles=layout.sigma_cycles[reader.unsigned(layout.sigma_bits)],
    )


def _scaled(value: int | None, scale: float, origin: float) -> float:
    return math.nan if value is None else value * scale + origin


def _absolute(reader: _BitReader, layout: _Layout, primary: _Measurement | None) -> _Measurement:
    """Read a reference block; `primary` is the first signal of the satellite, if read already."""
    if primary is None:
        widths = layout.primary
        unsigned = reader.unsigned(widths.pseudorange)
        is_valid = unsigned != (1 << widths.pseudorange) - 1
        pseudorange = unsigned * _PSEUDORANGE_SCALE if is_valid else math.nan
        range_rate_origin = 0.0
    else:
        widths = layout.secondary
        difference = reader.signed_or_none(widths.pseudorange)
        pseudorange = _scaled(difference, _PSEUDORANGE_SCALE, primary.pseudorange)
        range_rate_origin = primary.range_rate
    phase = reader.signed_or_none(widths.phase_range)
    rate = reader.signed_or_none(widths.range_rate)
    return _Measurement(
        pseudorange,
        _scaled(phase, _PHASE_RANGE_SCALE, pseudorange),
        _scaled(rate, _RANGE_RATE_SCALE, range_rate_origin),
    )


def _from_differences(
    differences: list[int | None], reference: _Measurement, elapsed: float
) -> _Measurement:
    pseudorange, phase_range, range_rate = differences
    motion = reference.range_rate * elapsed
    return _Measurement(
        _scaled(pseudorange, _PSEUDORANGE_SCALE, reference.pseudorange + motion),
        _scaled(phase_range, _PHASE_RANGE_SCALE, reference.phase_range + motion),
        _scaled(range_rate, _RANGE_RATE_SCALE, reference.range_rate),
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
    signal = _SIGNALS.get((system, signal_number), _UNKNOWN_SIGNAL)
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

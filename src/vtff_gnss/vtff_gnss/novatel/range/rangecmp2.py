"""RANGECMP2 to columns (OEM7 reference manual, log RANGECMP2)."""

from __future__ import annotations

import struct

from vtff_gnss import constants as c
from vtff_gnss.novatel.range.range_logs import GLONASS_CHANNEL_OFFSET
from vtff_gnss.novatel.range.record_columns import SignalRow, records_from_rows, wavelength
from vtff_gnss.novatel.range.signal_records import SignalRecords

__all__ = ["COMPRESSED_SYSTEMS", "RANGECMP2_SIGNALS", "decode_rangecmp2", "to_signed"]

COMPRESSED_SYSTEMS = {
    0: c.SYSTEM_GPS,
    1: c.SYSTEM_GLONASS,
    2: c.SYSTEM_SBAS,
    5: c.SYSTEM_GALILEO,
    6: c.SYSTEM_BEIDOU,
    7: c.SYSTEM_QZSS,
    9: c.SYSTEM_NAVIC,
}
"""System numbers of RANGECMP2, 4 and 5 to ``SYSTEM_*``."""

# Signal numbers of RANGECMP2 to (signal type of the tracking status word, L1 frequency / own).
RANGECMP2_SIGNALS: dict[tuple[int, int], tuple[int, float]] = {
    (c.SYSTEM_GPS, 1): (0, 1.0),
    (c.SYSTEM_GPS, 4): (9, 154 / 120),
    (c.SYSTEM_GPS, 5): (17, 154 / 120),
    (c.SYSTEM_GPS, 6): (5, 154 / 120),
    (c.SYSTEM_GPS, 7): (14, 154 / 115),
    (c.SYSTEM_GPS, 15): (16, 1.0),
    (c.SYSTEM_GLONASS, 1): (0, 1.0),
    (c.SYSTEM_GLONASS, 3): (1, 9 / 7),
    (c.SYSTEM_GLONASS, 4): (5, 9 / 7),
    (c.SYSTEM_GLONASS, 6): (6, 313 / 235),
    (c.SYSTEM_SBAS, 1): (0, 1.0),
    (c.SYSTEM_SBAS, 2): (6, 154 / 115),
    (c.SYSTEM_GALILEO, 1): (2, 1.0),
    (c.SYSTEM_GALILEO, 2): (12, 154 / 115),
    (c.SYSTEM_GALILEO, 3): (17, 154 / 118),
    (c.SYSTEM_GALILEO, 4): (20, 154 / 116.5),
    (c.SYSTEM_GALILEO, 5): (7, 154 / 125),
    (c.SYSTEM_GALILEO, 12): (6, 154 / 125),
    (c.SYSTEM_QZSS, 1): (0, 1.0),
    (c.SYSTEM_QZSS, 3): (17, 154 / 120),
    (c.SYSTEM_QZSS, 4): (14, 154 / 115),
    (c.SYSTEM_QZSS, 8): (16, 1.0),
    (c.SYSTEM_QZSS, 11): (27, 154 / 125),
    (c.SYSTEM_BEIDOU, 1): (0, 1.0),
    (c.SYSTEM_BEIDOU, 2): (4, 1.0),
    (c.SYSTEM_BEIDOU, 3): (1, 1526 / 1180),
    (c.SYSTEM_BEIDOU, 4): (5, 1526 / 1180),
    (c.SYSTEM_BEIDOU, 13): (2, 1526 / 1240),
    (c.SYSTEM_BEIDOU, 16): (6, 1526 / 1240),
    (c.SYSTEM_BEIDOU, 19): (7, 1526 / 1540),
    (c.SYSTEM_BEIDOU, 20): (9, 1526 / 1150),
    (c.SYSTEM_BEIDOU, 21): (11, 1526 / 1180),
    (c.SYSTEM_NAVIC, 1): (0, 1.0),
}

_UNKNOWN_SYSTEM = 7
_UNKNOWN_SIGNAL = 31
_SATELLITE_BLOCK = struct.Struct("<BBQ")
_SIGNAL_BLOCK = struct.Struct("<IQ")
_LOCK_TIME_MAX_MS = (1 << 17) - 1
_PSEUDORANGE_SIGMA = (0.020, 0.030, 0.045, 0.066, 0.099, 0.148, 0.220, 0.329) + (
    0.491, 0.732, 1.092, 1.629, 2.430, 3.625, 5.409,
    float("inf"),
)  # fmt: skip
_CARRIER_PHASE_SIGMA_CYCLES = (0.00391, 0.00521, 0.00696, 0.00929, 0.01239, 0.01654) + (
    0.02208, 0.02947, 0.03933, 0.05249, 0.07006, 0.09350, 0.12480, 0.16656, 0.22230,
    float("inf"),
)  # fmt: skip


def to_signed(value: int, length: int) -> int:
    """Return the low `length` bits of `value` as a two's complement number."""
    return value - (1 << length) if value >> (length - 1) & 1 else value


def decode_rangecmp2(payload: bytes) -> SignalRecords:
    """Decode the payload of a RANGECMP2 log.

    Quantisation: pseudorange 1/128 m, carrier phase 1/2048 m, Doppler 1/256 Hz of L1, C/N0
    1 dB, lock time 1 ms up to 131.071 s.

    Raises
    ------
    ValueError
        If the blocks run over the end of the payload.
    """
    end = 4 + int.from_bytes(payload[:4], "little")
    if end > len(payload):
        raise ValueError(f"RANGECMP2: {end} bytes announced, {len(payload)} received")
    rows: list[SignalRow] = []
    position = 4
    while position < end:
        if position + _SATELLITE_BLOCK.size > end:
            raise ValueError("RANGECMP2: satellite block cut off")
        _, satellite, fields = _SATELLITE_BLOCK.unpack_from(payload, position)
        position += _SATELLITE_BLOCK.size
        signal_count = fields >> 60
        if position + signal_count * _SIGNAL_BLOCK.size > end:
            raise ValueError("RANGECMP2: signal block cut off")
        for _ in range(signal_count):
            rows.append(
                _signal_row(satellite, fields, *_SIGNAL_BLOCK.unpack_from(payload, position))
            )
            position += _SIGNAL_BLOCK.size
    return records_from_rows(rows)


def _signal_row(satellite: int, fields: int, status: int, values: int) -> SignalRow:
    system = COMPRESSED_SYSTEMS.get(fields >> 4 & 31, _UNKNOWN_SYSTEM)
    channel = (fields & 15) - GLONASS_CHANNEL_OFFSET
    base_range = to_signed(fields >> 10 & 0x1FFFFFFF, 29)
    base_doppler_hz = to_signed(fields >> 39 & 0x1FFFFF, 21)
    signal, carrier_ratio = RANGECMP2_SIGNALS.get((system, status & 31), (_UNKNOWN_SIGNAL, 1.0))
    lock_time_ms = status >> 8 & 0x1FFFF
    phase_range = base_range + (values >> 27 & 0xFFFFF) / 2048.0
    doppler_hz = base_doppler_hz + to_signed(values >> 47 & 0x1FFFF, 17) / 256.0
    return SignalRow(
        system=system,
        signal=signal,
        prn_novatel=satellite + (37 if system == c.SYSTEM_GLONASS else 0),
        glonass_channel=channel,
        pseudorange=base_range + (values >> 13 & 0x3FFF) / 128.0,
        carrier_phase_cycles=phase_range / wavelength(system, signal, channel),
        doppler_hz=doppler_hz / carrier_ratio,
        cn0_dbhz=20.0 + (values & 31),
        pseudorange_sigma=_PSEUDORANGE_SIGMA[values >> 5 & 15],
        carrier_phase_sigma_cycles=_CARRIER_PHASE_SIGMA_CYCLES[values >> 9 & 15],
        lock_time=lock_time_ms / 1000.0,
        lock_time_bound=float("inf") if lock_time_ms == _LOCK_TIME_MAX_MS else lock_time_ms / 1e3,
        flags=(status >> 5 & 1) * c.FLAG_PHASE_VALID
        | (status >> 6 & 1) * c.FLAG_PARITY_KNOWN
        | (status >> 7 & 1) * c.FLAG_CODE_VALID
        | (status >> 30 & 1) * c.FLAG_HALF_CYCLE_ADDED,
    )

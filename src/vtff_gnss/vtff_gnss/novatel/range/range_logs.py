"""RANGE and RANGECMP to columns (OEM7 reference manual, logs RANGE and RANGECMP)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss import constants as c
from vtff_gnss.novatel.range.signal_records import SignalRecords
from vtff_gnss.novatel.range.tracking_status import (
    flags_from_status,
    rinex_signal,
    signal_from_status,
    system_from_status,
)
from vtff_gnss.signals import carrier_wavelength

__all__ = [
    "GLONASS_CHANNEL_OFFSET",
    "RANGECMP_RECORD",
    "RANGE_RECORD",
    "GlonassChannels",
    "decode_range",
    "decode_rangecmp",
]

RANGE_RECORD = np.dtype(
    [
        ("prn", "<u2"),
        ("glonass_frequency", "<u2"),
        ("pseudorange", "<f8"),
        ("pseudorange_sigma", "<f4"),
        ("accumulated_doppler_cycles", "<f8"),
        ("accumulated_doppler_sigma_cycles", "<f4"),
        ("doppler_hz", "<f4"),
        ("cn0_dbhz", "<f4"),
        ("lock_time", "<f4"),
        ("tracking_status", "<u4"),
    ]
)
"""One observation of RANGEB, 44 bytes."""

RANGECMP_RECORD = np.dtype(
    [
        ("tracking_status", "<u4"),
        ("doppler_pseudorange", "<u8"),
        ("accumulated_doppler", "<i4"),
        ("sigmas", "u1"),
        ("prn", "u1"),
        ("lock_cn0_glonass", "<u4"),
        ("reserved", "<u2"),
    ]
)
"""One observation of RANGECMPB, 24 bytes."""

GLONASS_CHANNEL_OFFSET = 7
"""Number in the logs less frequency channel; verified on ADR / PSR of real OEM7 logs."""

_RANGECMP_PSEUDORANGE_SIGMA = np.array(
    [0.050, 0.075, 0.113, 0.169, 0.253, 0.380, 0.570, 0.854]
    + [1.281, 2.375, 4.750, 9.500, 19.0, 38.0, 76.0, 152.0]
)
_RANGECMP_ROLLOVER_CYCLES = 2.0**23
_RANGECMP_LOCK_TIME_MAX = (2**21 - 1) / 32.0


class GlonassChannels:
    """Frequency channels of the GLONASS slots, learnt from the logs that tell them.

    RANGECMP of OEMV receivers has zeros where later receivers write the channel, and zero is a
    legal number there. It is believed once any RANGECMP record was not zero.
    """

    def __init__(self) -> None:
        self._by_slot = np.full(256, c.GLONASS_CHANNEL_UNKNOWN, dtype=np.int64)
        self._is_in_rangecmp = False

    def learn(self, slot: int, channel: int) -> None:
        """Remember the channel of an orbital slot."""
        if 0 <= slot < len(self._by_slot):
            self._by_slot[slot] = channel

    def from_rangecmp(
        self,
        prn_novatel: npt.NDArray[np.integer],
        number: npt.NDArray[np.integer],
        is_glonass: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.int64]:
        """Return the channels of RANGECMP records, shape (n,), or the mark for unknown."""
        self._is_in_rangecmp |= bool(np.any(number[is_glonass]))
        if self._is_in_rangecmp:
            return np.asarray(number, dtype=np.int64) - GLONASS_CHANNEL_OFFSET
        slot = np.clip(np.asarray(prn_novatel, dtype=np.int64) - 37, 0, 255)
        return np.asarray(self._by_slot[slot])


def decode_range(payload: bytes) -> SignalRecords:
    """Decode the payload of a RANGE log.

    Raises
    ------
    ValueError
        If the payload is shorter than its count of observations says.
    """
    count = int.from_bytes(payload[:4], "little")
    records = np.frombuffer(payload, dtype=RANGE_RECORD, count=count, offset=4)
    status = records["tracking_status"].astype(np.intp)
    lock_time = records["lock_time"]
    return SignalRecords(
        system=system_from_status(status),
        signal=signal_from_status(status),
        prn_novatel=records["prn"],
        glonass_channel=records["glonass_frequency"].astype(np.int64) - GLONASS_CHANNEL_OFFSET,
        pseudorange=records["pseudorange"],
        carrier_phase_cycles=-records["accumulated_doppler_cycles"],
        doppler_hz=records["doppler_hz"],
        cn0_dbhz=records["cn0_dbhz"],
        pseudorange_sigma=records["pseudorange_sigma"],
        carrier_phase_sigma_cycles=records["accumulated_doppler_sigma_cycles"],
        lock_time=lock_time,
        lock_time_bound=lock_time,
        flags=flags_from_status(status),
    )


def decode_rangecmp(payload: bytes, channels: GlonassChannels) -> SignalRecords:
    """Decode the payload of a RANGECMP log.

    Quantisation: pseudorange 1/128 m, carrier phase 1/256 cycle, Doppler 1/256 Hz, C/N0 1 dB,
    lock time 1/32 s. The carrier phase comes modulo 2^23 cycles and is rebuilt with the
    pseudorange; without code lock it is marked invalid.

    Raises
    ------
    ValueError
        If the payload is shorter than its count of observations says.
    """
    count = int.from_bytes(payload[:4], "little")
    records = np.frombuffer(payload, dtype=RANGECMP_RECORD, count=count, offset=4)
    status = records["tracking_status"]
    system, signal = system_from_status(status), signal_from_status(status)
    packed = records["doppler_pseudorange"]
    doppler = (packed & np.uint64(0xFFFFFFF)).astype(np.int64)
    doppler -= (doppler >> 27) << 28
    pseudorange = (packed >> np.uint64(28)).astype(np.float64) / 128.0
    lock_cn0_glonass = records["lock_cn0_glonass"]
    channel = channels.from_rangecmp(
        records["prn"], lock_cn0_glonass >> np.uint32(26), system == c.SYSTEM_GLONASS
    )
    phase = _unroll(-records["accumulated_doppler"] / 256.0, pseudorange, system, signal, channel)
    flags = flags_from_status(status)
    has_code = (flags & np.uint16(c.FLAG_CODE_VALID)) > 0
    lock_time = (lock_cn0_glonass & np.uint32(0x1FFFFF)).astype(np.float64) / 32.0
    return SignalRecords(
        system=system,
        signal=signal,
        prn_novatel=records["prn"],
        glonass_channel=channel,
        pseudorange=pseudorange,
        carrier_phase_cycles=phase,
        doppler_hz=doppler / 256.0,
        cn0_dbhz=20.0 + ((lock_cn0_glonass >> np.uint32(21)) & np.uint32(31)),
        pseudorange_sigma=_RANGECMP_PSEUDORANGE_SIGMA[records["sigmas"] & 15],
        carrier_phase_sigma_cycles=((records["sigmas"] >> 4) + 1.0) / 512.0,
        lock_time=lock_time,
        lock_time_bound=np.where(lock_time >= _RANGECMP_LOCK_TIME_MAX, np.inf, lock_time),
        flags=np.where(has_code, flags, flags & ~np.uint16(c.FLAG_PHASE_VALID)),
    )


def _unroll(
    phase_cycles: npt.NDArray[np.float64],
    pseudorange: npt.NDArray[np.float64],
    system: npt.NDArray[np.intp],
    signal: npt.NDArray[np.intp],
    channel: npt.NDArray[np.int64],
) -> npt.NDArray[np.float64]:
    """Add the whole 2^23 cycles that bring the carrier phase nearest to the pseudorange."""
    band, _ = rinex_signal(system, signal)
    # Channel 0 in place of an unknown one shifts the expected phase by 0.3e6 cycles at most.
    known_channel = np.where(channel == c.GLONASS_CHANNEL_UNKNOWN, 0, channel)
    wavelength = carrier_wavelength(system, band, known_channel)
    wavelength = np.where(np.isnan(wavelength), SPEED_OF_LIGHT / c.FREQUENCY_L1, wavelength)
    turns = np.rint((pseudorange / wavelength - phase_cycles) / _RANGECMP_ROLLOVER_CYCLES)
    return phase_cycles + _RANGECMP_ROLLOVER_CYCLES * turns

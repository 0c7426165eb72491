"""Observation epochs to RANGE and RANGECMP (OEM7 reference manual, logs RANGE and RANGECMP)."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.encode.frame import HeaderSettings, encode_frame
from vtff_gnss.novatel.range.range_logs import (
    GLONASS_CHANNEL_OFFSET,
    RANGE_RECORD,
    RANGECMP_RECORD,
)
from vtff_gnss.novatel.range.tracking_status import NOVATEL_SIGNALS, rinex_prn
from vtff_gnss.observations import ObservationEpoch, ObservationSeries

__all__ = [
    "encode_range",
    "encode_range_series",
    "encode_rangecmp",
    "prn_novatel",
    "tracking_status",
]

_L1_PLL, _L1_FLL, _L2_SEARCH, _L2_PLL = 4, 7, 10, 11
_PHASE_LOCK_BIT = np.uint32(1 << 10)
_LOGGED_FLAGS = np.uint16(15)
_GROUPED_BIT = 1 << 20
_PRIMARY_BIT = 1 << 27

# Tracking state with phase lock and correlator type (bits 13-15) that real receivers give: the
# most common ones in NovAtel's RANGE vectors. Signals that are not here are tracked like L1 C/A.
_STATE_AND_CORRELATOR = {
    (c.SYSTEM_GPS, 0): (_L1_PLL, 4),
    (c.SYSTEM_GPS, 5): (_L2_PLL, 1),
    (c.SYSTEM_GPS, 9): (_L2_PLL, 1),
    (c.SYSTEM_GPS, 14): (_L1_PLL, 6),
    (c.SYSTEM_GPS, 17): (_L2_PLL, 6),
    (c.SYSTEM_GLONASS, 1): (_L2_PLL, 4),
    (c.SYSTEM_GLONASS, 5): (_L2_PLL, 1),
    (c.SYSTEM_GALILEO, 2): (_L1_PLL, 6),
    (c.SYSTEM_GALILEO, 12): (_L1_PLL, 6),
    (c.SYSTEM_GALILEO, 17): (_L1_PLL, 6),
    (c.SYSTEM_GALILEO, 20): (_L1_PLL, 1),
    (c.SYSTEM_BEIDOU, 1): (_L2_PLL, 0),
    (c.SYSTEM_QZSS, 17): (_L2_PLL, 6),
}
_DEFAULT_STATE_AND_CORRELATOR = (_L1_PLL, 4)
_PRIMARY_SIGNALS = {
    (c.SYSTEM_GPS, 0),
    (c.SYSTEM_GLONASS, 0),
    (c.SYSTEM_SBAS, 0),
    (c.SYSTEM_GALILEO, 2),
    (c.SYSTEM_BEIDOU, 0),
    (c.SYSTEM_BEIDOU, 4),
    (c.SYSTEM_QZSS, 0),
}

# By system, RINEX frequency digit, attribute: status word without state, channel and flags; the
# states with and without phase lock. Zero where the combination does not exist.
_WORD = np.zeros((8, 10, 128), dtype=np.uint32)
_STATE_LOCKED = np.zeros((8, 10, 128), dtype=np.uint32)
_STATE_UNLOCKED = np.zeros((8, 10, 128), dtype=np.uint32)
for (_system, _signal), (_band, _attribute) in reversed(NOVATEL_SIGNALS.items()):
    # In reverse, so that of two NovAtel signals with one RINEX name the first one is taken.
    _place = _system, _band, ord(_attribute)
    _state, _correlator = _STATE_AND_CORRELATOR.get(
        (_system, _signal), _DEFAULT_STATE_AND_CORRELATOR
    )
    _is_primary = (_system, _signal) in _PRIMARY_SIGNALS
    _WORD[_place] = (
        _correlator << 13
        | _system << 16
        | _GROUPED_BIT
        | _signal << 21
        | _is_primary * _PRIMARY_BIT
    )
    _STATE_LOCKED[_place] = _state
    _STATE_UNLOCKED[_place] = _L1_FLL if _state == _L1_PLL else _L2_SEARCH

_FLAG_BITS = np.array(
    [
        bool(flags & c.FLAG_PHASE_VALID) << 10
        | bool(flags & c.FLAG_PARITY_KNOWN) << 11
        | bool(flags & c.FLAG_CODE_VALID) << 12
        | bool(flags & c.FLAG_HALF_CYCLE_ADDED) << 28
        for flags in range(16)
    ],
    dtype=np.uint32,
)

_PRN_NOVATEL = np.zeros((8, 256), dtype=np.uint16)
for _system in range(7):
    _numbers = rinex_prn(np.full(256, _system, dtype=np.intp), np.arange(256))
    _PRN_NOVATEL[_system, _numbers] = np.arange(256)
_PRN_NOVATEL[:, 0] = 0

_PSEUDORANGE_SIGMA_STEPS = np.array(
    [0.050, 0.075, 0.113, 0.169, 0.253, 0.380, 0.570, 0.854]
    + [1.281, 2.375, 4.750, 9.500, 19.0, 38.0, 76.0],
    dtype=np.float32,
)
_ROLLOVER = 1 << 31
"""2^23 cycles in steps of 1/256 cycle."""
_LOCK_TIME_MAX = (1 << 21) - 1


class _SignalNumbers(NamedTuple):
    """NovAtel's numbers of the signals of an epoch; all of shape (n,), read-only."""

    prn: npt.NDArray[np.uint16]
    glonass_frequency: npt.NDArray[np.uint16]
    status_locked: npt.NDArray[np.uint32]
    status_unlocked: npt.NDArray[np.uint32]


def tracking_status(
    epoch: ObservationEpoch, channel: npt.NDArray[np.integer] | None = None
) -> npt.NDArray[np.uint32]:
    """Return the channel tracking status words of an epoch.

    Parameters
    ----------
    epoch : ObservationEpoch
        Systems, signals and flags; `FLAG_LOCK_LOST` has no bit, the lock time tells it.
    channel : ndarray of int, shape (n,), optional
        Receiver channels 0..31; 0 by default.

    Returns
    -------
    ndarray of uint32, shape (n,)

    Raises
    ------
    ValueError
        If NovAtel has no number for a signal or satellite.
    """
    return _tracking_status(epoch, _numbers_of(epoch), channel)


def _tracking_status(
    epoch: ObservationEpoch | ObservationSeries,
    numbers: _SignalNumbers,
    channel: npt.NDArray[np.integer] | None,
) -> npt.NDArray[np.uint32]:
    bits = _FLAG_BITS[epoch.flags & _LOGGED_FLAGS]
    has_phase = bits & _PHASE_LOCK_BIT
    if has_phase.all():
        bits |= numbers.status_locked
    else:
        bits |= np.where(has_phase, numbers.status_locked, numbers.status_unlocked)
    if channel is not None:
        bits |= (np.asarray(channel, dtype=np.uint32) & np.uint32(31)) << np.uint32(5)
    return np.asarray(bits)


def _numbers_of(epoch: ObservationEpoch | ObservationSeries) -> _SignalNumbers:
    return _signal_numbers(
        epoch.system.tobytes(),
        epoch.prn.tobytes(),
        epoch.band.tobytes(),
        epoch.attribute.tobytes(),
        epoch.glonass_channel.tobytes(),
    )


@functools.lru_cache(maxsize=64)
def _signal_numbers(
    system_bytes: bytes, prn_bytes: bytes, band_bytes: bytes, attribute_bytes: bytes, channel: bytes
) -> _SignalNumbers:
    """Return the numbers of a list of signals, which stays the same over many epochs."""
    system, prn, band, attribute = (
        np.frombuffer(column, dtype=np.uint8)
        for column in (system_bytes, prn_bytes, band_bytes, attribute_bytes)
    )
    signal_index = (system, band, attribute)
    words = _WORD[signal_index]
    if not words.all():
        index = int(np.argmin(words))
        signal = f"{band[index]}{chr(attribute[index])}"
        raise ValueError(f"signal: {signal} of system {system[index]} has no NovAtel number")
    # Zero for other systems than GLONASS, and for unknown channels.
    glonass_channel = np.frombuffer(channel, dtype=np.int8).astype(np.int16)
    is_known = (system == c.SYSTEM_GLONASS) & (glonass_channel != c.GLONASS_CHANNEL_UNKNOWN)
    frequency = (glonass_channel + np.int16(GLONASS_CHANNEL_OFFSET)) * is_known
    return _SignalNumbers(
        prn_novatel(system, prn),
        frequency.astype(np.uint16),
        words | _STATE_LOCKED[signal_index],
        words | _STATE_UNLOCKED[signal_index],
    )


def prn_novatel(
    system: npt.NDArray[np.integer], prn: npt.NDArray[np.integer]
) -> npt.NDArray[np.uint16]:
    """Return NovAtel's satellite numbers, shape (n,).

    Raises
    ------
    ValueError
        If a RINEX satellite number does not exist.
    """
    numbers = _PRN_NOVATEL[system, prn]
    if not numbers.all():
        index = int(np.argmin(numbers))
        raise ValueError(f"prn: {prn[index]} of system {system[index]} does not exist")
    return np.asarray(numbers)


def encode_range(
    epoch: ObservationEpoch,
    settings: HeaderSettings,
    channel: npt.NDArray[np.integer] | None = None,
) -> bytes:
    """Return an epoch as a RANGE log; nothing is rounded.

    Parameters
    ----------
    epoch : ObservationEpoch
        In the order of the log; its time and status words go to the header.
    settings : HeaderSettings
        The other fields of the header.
    channel : ndarray of int, shape (n,), optional
        Receiver channels 0..31; 0 by default.

    Raises
    ------
    ValueError
        If the time is not a whole millisecond, or NovAtel has no number for a signal.
    """
    is_observed = np.ones((1, len(epoch)), dtype=bool)
    return _range_frames(epoch, (epoch.time,), is_observed, settings, channel)[0]


def encode_range_series(series: ObservationSeries, settings: HeaderSettings) -> list[bytes]:
    """Return the RANGE logs of the epochs of a series, as `encode_range` makes them.

    Parameters, Raises
        See `encode_range`.
    """
    return _range_frames(series, series.times, series.is_observed, settings, series.channel)


def _range_frames(
    observations: ObservationEpoch | ObservationSeries,
    times: Sequence[GpsTime],
    is_observed: npt.NDArray[np.bool_],
    settings: HeaderSettings,
    channel: npt.NDArray[np.integer] | None,
) -> list[bytes]:
    """Return the RANGE logs of k epochs; `is_observed` is of shape (k, n)."""
    o = observations
    numbers = _numbers_of(o)
    signal = is_observed.nonzero()[1]
    records = np.empty(len(signal), RANGE_RECORD)
    records["prn"] = numbers.prn[signal]
    records["glonass_frequency"] = numbers.glonass_frequency[signal]
    for name, column in (
        ("pseudorange", o.pseudorange),
        ("pseudorange_sigma", o.pseudorange_sigma),
        ("accumulated_doppler_cycles", -o.carrier_phase_cycles),
        ("accumulated_doppler_sigma_cycles", o.carrier_phase_sigma_cycles),
        ("doppler_hz", o.doppler_hz),
        ("cn0_dbhz", o.cn0_dbhz),
        ("lock_time", o.lock_time),
        ("tracking_status", _tracking_status(o, numbers, channel)),
    ):
        records[name] = column.reshape(is_observed.shape)[is_observed]
    ends = np.cumsum(np.count_nonzero(is_observed, axis=1)).tolist()
    return [
        _frame(ids.ID_RANGE, records[start:end], time, o, settings)
        for time, start, end in zip(times, [0, *ends], ends, strict=False)
    ]


def encode_rangecmp(
    epoch: ObservationEpoch,
    settings: HeaderSettings,
    channel: npt.NDArray[np.integer] | None = None,
) -> bytes:
    """Return an epoch as a RANGECMP log.

    Quantisation: pseudorange 1/128 m, carrier phase 1/256 cycle, Doppler 1/256 Hz (saturated at
    524 kHz), C/N0 1 dB in 20..51, lock time 1/32 s (rounded down, saturated), sigmas rounded up
    to the next of 16 steps. The carrier phase is sent modulo 2^23 cycles, so that a decoder
    rebuilds it only if it is within 2^22 cycles of the pseudorange.

    Parameters, Raises
        See `encode_range`; also ValueError for a pseudorange outside 0..5.3e8 m.
    """
    records = np.zeros(len(epoch), RANGECMP_RECORD)
    if len(epoch):
        numbers = _numbers_of(epoch)
        records["tracking_status"] = _tracking_status(epoch, numbers, channel)
        records["doppler_pseudorange"] = _doppler_pseudorange(epoch)
        phase = np.rint(epoch.carrier_phase_cycles * 256.0).astype(np.int64)
        records["accumulated_doppler"] = -(phase % _ROLLOVER)
        records["sigmas"] = _sigma_numbers(epoch)
        records["prn"] = numbers.prn
        lock_time = np.minimum(np.floor(epoch.lock_time * np.float32(32.0)), _LOCK_TIME_MAX)
        cn0 = np.clip(np.rint(epoch.cn0_dbhz), 20, 51).astype(np.uint32) - np.uint32(20)
        records["lock_cn0_glonass"] = (
            lock_time.astype(np.uint32)
            | cn0 << np.uint32(21)
            | numbers.glonass_frequency.astype(np.uint32) << np.uint32(26)
        )
    return _frame(ids.ID_RANGECMP, records, epoch.time, epoch, settings)


def _doppler_pseudorange(epoch: ObservationEpoch) -> npt.NDArray[np.uint64]:
    pseudorange = np.rint(epoch.pseudorange * 128.0)
    if not (pseudorange.min() >= 0.0 and pseudorange.max() < 2.0**36):
        raise ValueError("pseudorange: outside the 0..5.3e8 m of RANGECMP")
    doppler = np.clip(np.rint(epoch.doppler_hz.astype(np.float64) * 256.0), -(2**27), 2**27 - 1)
    low = doppler.astype(np.int64) & 0xFFFFFFF
    return np.asarray(
        low.astype(np.uint64) | pseudorange.astype(np.uint64) << np.uint64(28), dtype=np.uint64
    )


def _sigma_numbers(epoch: ObservationEpoch) -> npt.NDArray[np.uint8]:
    pseudorange = np.searchsorted(_PSEUDORANGE_SIGMA_STEPS, epoch.pseudorange_sigma)
    phase = np.ceil(epoch.carrier_phase_sigma_cycles * np.float32(512.0)) - 1.0
    return np.asarray(pseudorange | np.clip(phase, 0, 15).astype(np.intp) << 4, dtype=np.uint8)


def _frame(
    message_id: int,
    records: npt.NDArray[np.void],
    time: GpsTime,
    observations: ObservationEpoch | ObservationSeries,
    settings: HeaderSettings,
) -> bytes:
    payload = len(records).to_bytes(4, "little") + records.tobytes()
    status = observations.time_status, observations.receiver_status
    return encode_frame(message_id, payload, time, settings, *status)

"""RANGE logs of the same signals, compiled: from the bytes of their frames to those of columns.

Bytes of numbers are copied as they are, so that it does not matter where they stand.
"""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.byte_integers import read_integer
from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_gnss.constants import (
    FLAG_CODE_VALID,
    FLAG_HALF_CYCLE_ADDED,
    FLAG_LOCK_LOST,
    FLAG_PARITY_KNOWN,
    FLAG_PHASE_VALID,
)
from vtff_gnss.novatel.frame_search import RESPONSE_BIT
from vtff_gnss.novatel.header import MILLISECONDS_PER_WEEK, TIME_STATUS_UNKNOWN
from vtff_gnss.novatel.range.range_logs import GLONASS_CHANNEL_OFFSET, RANGE_RECORD

__all__ = ["copy_range_columns", "find_lost_locks", "read_range_heads"]

_RECORD_LENGTH = RANGE_RECORD.itemsize
_COUNT_LENGTH = 4  # bytes of the number of records, which stands before them
_PSEUDORANGE, _PHASE, _DOPPLER, _CN0, _PSEUDORANGE_SIGMA, _PHASE_SIGMA, _LOCK_TIME, _STATUS = (
    RANGE_RECORD.fields[name][1]  # type: ignore[index]  # place in a record
    for name in (
        "pseudorange",
        "accumulated_doppler_cycles",
        "doppler_hz",
        "cn0_dbhz",
        "pseudorange_sigma",
        "accumulated_doppler_sigma_cycles",
        "lock_time",
        "tracking_status",
    )
)
_LAST_WEEK = 15_249  # 64 bits hold its times, ns since 1980-01-06
# Exponents of numbers of 4 bytes from which on the distance to the next number is not finite.
_GREATEST_EXPONENT = 254


@compiled
def read_range_heads(frames, signals, nanoseconds, time_status, receiver_status):  # type: ignore[no-untyped-def]
    """Read the heads of RANGE logs, and tell whether all list the same signals in the same order.

    Parameters
    ----------
    frames : ndarray of uint8, shape (k, length)
        Frames of one length, whose checksums and lengths are right.
    signals : ndarray of int64, shape (4, n)
        Takes system, signal, PRN and GLONASS channel in NovAtel's numbering.
    nanoseconds : ndarray of int64, shape (k,)
        Takes times, ns since 1980-01-06 (GPS).
    time_status, receiver_status : ndarray of uint8 and uint32, shape (k,)
        Take the fields of the heads.

    Returns
    -------
    bool
        False where the logs must be decoded one by one: they are answers, have no time, list other
        signals, or have lock times that no receiver states.
    """
    header_length = np.int64(frames[0, 3])
    first = header_length + _COUNT_LENGTH
    for log in range(len(frames)):
        frame = frames[log]
        week = read_integer(frame, 14, 2)
        if frame[3] != header_length or frame[6] & RESPONSE_BIT:
            return False
        if not 0 < week <= _LAST_WEEK or frame[13] == TIME_STATUS_UNKNOWN:
            return False
        if read_integer(frame, header_length, 4) != signals.shape[1]:
            return False
        milliseconds = week * MILLISECONDS_PER_WEEK + read_integer(frame, 16, 4)
        nanoseconds[log] = milliseconds * NANOSECONDS_PER_MILLISECOND
        time_status[log] = frame[13]
        receiver_status[log] = read_integer(frame, 20, 4)
        for column in range(signals.shape[1]):
            place = first + column * _RECORD_LENGTH
            prn = read_integer(frame, place, 2)
            channel = read_integer(frame, place + 2, 2) - GLONASS_CHANNEL_OFFSET
            status = read_integer(frame, place + _STATUS, 4)
            system, signal = status >> 16 & 7, status >> 21 & 31
            lock_bits = read_integer(frame, place + _LOCK_TIME, 4)
            # Negative ones have the sign bit, which is above the exponent.
            if lock_bits >> 23 >= _GREATEST_EXPONENT:
                return False
            if log == 0:
                signals[0, column], signals[1, column] = system, signal
                signals[2, column], signals[3, column] = prn, channel
            elif (
                signals[0, column] != system
                or signals[1, column] != signal
                or signals[2, column] != prn
                or signals[3, column] != channel
            ):
                return False
    return True


@compiled
def find_lost_locks(  # type: ignore[no-untyped-def]
    frames, chosen, key, nanoseconds, tracked_seconds, tracked_lock_time, max_tolerance, flags
):
    """Fill the flags of the observations, and follow the lock times of their signals.

    Parameters
    ----------
    frames : ndarray of uint8, shape (k, length)
        As `read_range_heads` accepts them.
    chosen : ndarray of int64, shape (m,)
        Which of the records have observations, each of another signal.
    key : ndarray of int64, shape (m,)
        Place of each signal in the two arrays that follow.
    nanoseconds : ndarray of int64, shape (k,)
        Times, ns since 1980-01-06 (GPS).
    tracked_seconds, tracked_lock_time : ndarray, shape (keys,)
        When each signal was last seen, NaN for never, and its lock time then, s.
    max_tolerance : float
        s.
    flags : ndarray of uint16, shape (k, m)
        Takes ``FLAG_*``.
    """
    first = np.int64(frames[0, 3]) + _COUNT_LENGTH
    bits = np.empty(1, dtype=np.uint32)
    number = bits.view(np.float32)
    for column in range(len(chosen)):
        place = first + chosen[column] * _RECORD_LENGTH
        previous_seconds = tracked_seconds[key[column]]
        previous_lock_time = tracked_lock_time[key[column]]
        for log in range(len(frames)):
            frame = frames[log]
            status = read_integer(frame, place + _STATUS, 4)
            value = (
                (status >> 10 & 1) * FLAG_PHASE_VALID
                | (status >> 11 & 1) * FLAG_PARITY_KNOWN
                | (status >> 12 & 1) * FLAG_CODE_VALID
                | (status >> 28 & 1) * FLAG_HALF_CYCLE_ADDED
            )
            lock_bits = read_integer(frame, place + _LOCK_TIME, 4)
            bits[0] = lock_bits
            lock_time = np.float64(number[0])
            seconds = nanoseconds[log] * 1e-9
            elapsed = seconds - previous_seconds
            if not math.isnan(elapsed):
                tolerance = min(max(0.5 * elapsed, 0.0), max_tolerance)
                # Distance to the next number of 4 bytes.
                tolerance += math.ldexp(1.0, max(lock_bits >> 23, 1) - 150)
                if lock_time - previous_lock_time + tolerance <= elapsed:
                    value |= FLAG_LOCK_LOST
            flags[log, column] = value
            previous_seconds, previous_lock_time = seconds, lock_time
        tracked_seconds[key[column]] = previous_seconds
        tracked_lock_time[key[column]] = previous_lock_time


@compiled
def _copy_column(frame, chosen, place, length, row, start):  # type: ignore[no-untyped-def]
    for column in range(len(chosen)):
        source = place + chosen[column] * _RECORD_LENGTH
        target = start + column * length
        for byte in range(length):
            row[target + byte] = frame[source + byte]


@compiled
def copy_range_columns(frames, chosen, flags, rows, starts):  # type: ignore[no-untyped-def]
    """Write what was measured into rows of bytes, one for each log.

    Parameters
    ----------
    frames, chosen, flags
        As in `find_lost_locks`.
    rows : ndarray of uint8, shape (k, size)
    starts : ndarray of int64, shape (8,)
        Where in a row the columns pseudorange (8 bytes each), carrier phase (8), Doppler shift,
        C/N0, sigma of pseudorange, sigma of carrier phase, lock time (4 each) and flags (2) begin.
    """
    first = np.int64(frames[0, 3]) + _COUNT_LENGTH
    for log in range(len(frames)):
        frame, row = frames[log], rows[log]
        _copy_column(frame, chosen, first + _PSEUDORANGE, 8, row, starts[0])
        _copy_column(frame, chosen, first + _PHASE, 8, row, starts[1])
        _copy_column(frame, chosen, first + _DOPPLER, 4, row, starts[2])
        _copy_column(frame, chosen, first + _CN0, 4, row, starts[3])
        _copy_column(frame, chosen, first + _PSEUDORANGE_SIGMA, 4, row, starts[4])
        _copy_column(frame, chosen, first + _PHASE_SIGMA, 4, row, starts[5])
        _copy_column(frame, chosen, first + _LOCK_TIME, 4, row, starts[6])
        for column in range(len(chosen)):
            # The sign of RINEX: the carrier phase grows with distance.
            row[starts[1] + column * 8 + 7] ^= 0x80
            row[starts[7] + column * 2] = flags[log, column] & 255
            row[starts[7] + column * 2 + 1] = flags[log, column] >> 8

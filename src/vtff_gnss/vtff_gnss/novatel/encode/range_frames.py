"""RANGE frames of consecutive epochs, header to checksum, in one compiled pass over a buffer.

All fields of the log are multiples of 16 bits at multiples of 32 bits, so that a buffer of 32-bit
words is filled.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_MILLISECOND
from vtff_gnss.novatel.checksum import add_byte, add_words
from vtff_gnss.novatel.header import MILLISECONDS_PER_WEEK

__all__ = ["write_range_frames"]

_RECORD_WORDS = 11  # 32-bit words of the record of one signal
_HEADER_WORDS = 7
_WORDS_BESIDE_RECORDS = _HEADER_WORDS + 2


@compiled
def write_range_frames(  # type: ignore[no-untyped-def]
    header,
    nanoseconds,
    is_observed,
    prn_words,
    status_locked,
    status_unlocked,
    flag_bits,
    phase_lock_bit,
    pseudorange,
    carrier_phase_cycles,
    pseudorange_sigma,
    carrier_phase_sigma_cycles,
    doppler_hz,
    cn0_dbhz,
    lock_time,
    flags,
    channel,
):
    """Return the RANGE frames of k epochs, and where each ends.

    Parameters
    ----------
    header : ndarray of uint32, shape (7,)
        Header of a frame without time, which is filled in unless the time status is that of an
        unknown time, and without length.
    nanoseconds : ndarray of int64, shape (k,)
        GPS times of the epochs; negative: the receiver does not know the time.
    is_observed : ndarray of bool, shape (k, n)
    prn_words : ndarray of uint32, shape (n,)
        First word of each record: NovAtel's satellite and GLONASS frequency numbers.
    status_locked, status_unlocked : ndarray of uint32, shape (n,)
        Tracking status with and without phase lock, without flags and channel.
    flag_bits : ndarray of uint32, shape (16,)
        Bits of the tracking status for the logged flags.
    phase_lock_bit : int
        That of them which tells phase lock.
    pseudorange, carrier_phase_cycles : ndarray of float64, shape (k, n)
        m, cycles; the RANGE log has the negative of the phase.
    pseudorange_sigma, carrier_phase_sigma_cycles, doppler_hz, cn0_dbhz, lock_time : ndarray
        Shape (k, n), float32 or what is rounded to it; m, cycles, Hz, dB-Hz, s.
    flags : ndarray of uint16, shape (k, n)
    channel : ndarray of uint8, shape (k, n)
        Receiver channels 0..31.

    Returns
    -------
    words : ndarray of uint32, shape (size,)
        The frames; they have no records of signals that are not observed.
    ends : ndarray of int64, shape (k,)
        Index of the word behind each frame.
    """
    epochs, signals = is_observed.shape
    words = np.empty(epochs * (_WORDS_BESIDE_RECORDS + _RECORD_WORDS * signals), np.uint32)
    ends = np.empty(epochs, np.int64)
    # The bits of floating-point numbers are read as the words of these.
    double, single = np.empty(1), np.empty(1, np.float32)
    double_words, single_word = double.view(np.uint32), single.view(np.uint32)
    end = 0
    for k in range(epochs):
        start = end
        place = start + _HEADER_WORDS + 1
        count = 0
        for n in range(signals):
            if not is_observed[k, n]:
                continue
            count += 1
            bits = np.int64(flag_bits[flags[k, n] & 15])
            if bits & phase_lock_bit:
                bits |= np.int64(status_locked[n])
            else:
                bits |= np.int64(status_unlocked[n])
            bits |= (np.int64(channel[k, n]) & 31) << 5
            words[place] = prn_words[n]
            double[0] = pseudorange[k, n]
            words[place + 1], words[place + 2] = double_words[0], double_words[1]
            single[0] = pseudorange_sigma[k, n]
            words[place + 3] = single_word[0]
            double[0] = -carrier_phase_cycles[k, n]
            words[place + 4], words[place + 5] = double_words[0], double_words[1]
            single[0] = carrier_phase_sigma_cycles[k, n]
            words[place + 6] = single_word[0]
            single[0] = doppler_hz[k, n]
            words[place + 7] = single_word[0]
            single[0] = cn0_dbhz[k, n]
            words[place + 8] = single_word[0]
            single[0] = lock_time[k, n]
            words[place + 9] = single_word[0]
            words[place + 10] = bits
            place += _RECORD_WORDS
        words[start : start + _HEADER_WORDS] = header
        words[start + 2] = 4 + 4 * _RECORD_WORDS * count
        if nanoseconds[k] >= 0:
            milliseconds = nanoseconds[k] // NANOSECONDS_PER_MILLISECOND
            week = milliseconds // MILLISECONDS_PER_WEEK
            words[start + 3] = np.int64(header[3]) | week << 16
            words[start + 4] = milliseconds - week * MILLISECONDS_PER_WEEK
        words[start + _HEADER_WORDS] = count
        checksum = np.int64(0)
        index = start
        while index + 1 < place:
            checksum = add_words(checksum, np.int64(words[index]), np.int64(words[index + 1]))
            index += 2
        if index < place:
            for byte in range(4):
                checksum = add_byte(checksum, np.int64(words[index]) >> (8 * byte) & 255)
        words[place] = checksum
        end = place + 1
        ends[k] = end
    return words, ends

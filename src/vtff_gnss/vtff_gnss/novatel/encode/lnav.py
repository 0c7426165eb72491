"""GPS ephemeris to LNAV subframes 1 to 3 (IS-GPS-200, 20.3.3.1 to 20.3.3.4 and 20.3.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vtff_gnss.constants import EPHEMERIS_SOURCE_LNAV, GPS_PI, SYSTEM_GPS
from vtff_gnss.ephemeris import DEFAULT_FIT_INTERVAL, BroadcastEphemeris, lnav_accuracy
from vtff_gnss.orbits.lnav import decode_subframes

__all__ = ["LnavMessage", "encode_subframes", "parity", "quantize_lnav"]

_PREAMBLE = 0x8B
_FRAME_SECONDS = 30
_WEEK_MODULUS = 1024
_NO_ACCURACY = 15

# IS-GPS-200, table 20-XIV: D25 to D30 as sums modulo 2 of D29* or D30* of the word before and of
# these source bits d1..d24.
_PARITY_EQUATIONS = (
    (29, (1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23)),
    (30, (2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24)),
    (29, (1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22)),
    (30, (2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23)),
    (30, (1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24)),
    (29, (3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24)),
)
_PARITY_MASKS = tuple(
    (star == 30, sum(1 << (24 - bit) for bit in bits)) for star, bits in _PARITY_EQUATIONS
)


@dataclass(frozen=True)
class LnavMessage:
    """Fields of the subframes that an ephemeris does not hold.

    Parameters
    ----------
    telemetry_message : int
        TLM word, bits 9 to 24: message, integrity status flag, reserved bit.
    is_alert, is_anti_spoofing_on : bool
        HOW, bits 18 and 19.
    codes_on_l2, is_l2p_data_off : int, bool
        Subframe 1, word 3 bits 11-12 and word 4 bit 1.
    age_of_data_offset : int
        Subframe 2, word 10, 0..31.
    """

    telemetry_message: int = 0
    is_alert: bool = False
    is_anti_spoofing_on: bool = True
    codes_on_l2: int = 1
    is_l2p_data_off: bool = False
    age_of_data_offset: int = 0


_DEFAULT_MESSAGE = LnavMessage()


class _Words:
    """Ten words of 24 bits, filled by word and first bit as in IS-GPS-200 figure 20-1."""

    def __init__(self, prn: int) -> None:
        self._prn = prn
        self._bits = 0

    def put(self, word: int, first_bit: int, length: int, value: int) -> None:
        end = 24 * (word - 1) + first_bit - 1 + length
        self._bits |= (value & ((1 << length) - 1)) << (240 - end)

    def put_steps(
        self, field: tuple[int, int, int], value: float, scale: float, name: str, signed: bool
    ) -> None:
        """Put ``value / scale``, rounded, into (word, first bit, length)."""
        length = field[2]
        steps = round(value / scale) if math.isfinite(value) else 1 << length
        low, high = (-(1 << (length - 1)), 1 << (length - 1)) if signed else (0, 1 << length)
        if not low <= steps < high:
            raise ValueError(f"GPS PRN {self._prn}: {name}: {value} does not fit LNAV")
        self.put(*field, steps)

    def put_angle(self, word: int, value: float) -> None:
        """Put an angle, modulo a turn, into the last 8 bits of a word and the next word."""
        self.put(word, 17, 32, round(value / GPS_PI * 2.0**31))

    def finish(self) -> bytes:
        """Return the words, with the parity of words 2 and 10 ending in zeros."""
        d29, d30 = 0, 0
        for word in range(1, 11):
            shift = 24 * (10 - word)
            source = self._bits >> shift & 0xFFFFFF
            if word in (2, 10):
                solved = _with_zero_parity(source, d29, d30)
                self._bits ^= (source ^ solved) << shift
                source = solved
            d29, d30 = divmod(parity(source, d29, d30) & 3, 2)
        return self._bits.to_bytes(30, "big")


def parity(source: int, d29_star: int, d30_star: int) -> int:
    """Return the six parity bits D25..D30 of a word (IS-GPS-200, table 20-XIV).

    Parameters
    ----------
    source : int
        The source bits d1..d24, before they are inverted for `d30_star`.
    d29_star, d30_star : int
        The last two bits of the word before.
    """
    result = 0
    for uses_d30, mask in _PARITY_MASKS:
        star = d30_star if uses_d30 else d29_star
        result = result << 1 | (bin(source & mask).count("1") + star & 1)
    return result


def _with_zero_parity(source: int, d29_star: int, d30_star: int) -> int:
    """Choose d23 and d24 such that D29 and D30 are zero (IS-GPS-200, 20.3.3.2)."""
    for trailing in range(4):
        candidate = source & ~3 | trailing
        if parity(candidate, d29_star, d30_star) & 3 == 0:
            return candidate
    raise AssertionError("two free bits always solve the two equations")


def encode_subframes(
    ephemeris: BroadcastEphemeris, message: LnavMessage = _DEFAULT_MESSAGE
) -> tuple[bytes, bytes, bytes]:
    """Return subframes 1 to 3, each ten words of 24 bits without parity.

    Parameters
    ----------
    ephemeris : BroadcastEphemeris
        GPS, source LNAV; `time` is in the 30 s frame in which it is sent. Values are rounded
        to the resolution of the message; accuracy to the next greater URA.
    message : LnavMessage
        The fields that an ephemeris does not hold.

    Raises
    ------
    ValueError
        If it is no LNAV ephemeris, IODE and IODC differ, or a value does not fit its field.
    """
    if (ephemeris.system, ephemeris.source) != (SYSTEM_GPS, EPHEMERIS_SOURCE_LNAV):
        raise ValueError("ephemeris: not of GPS LNAV")
    if ephemeris.issue_of_data_clock & 0xFF != ephemeris.issue_of_data_ephemeris:
        raise ValueError(
            f"GPS PRN {ephemeris.prn}: IODE {ephemeris.issue_of_data_ephemeris} is not the low "
            f"byte of IODC {ephemeris.issue_of_data_clock}"
        )
    frame_count = int(ephemeris.time.time_of_week // _FRAME_SECONDS)
    subframes = []
    for number, fill in ((1, _fill_first), (2, _fill_second), (3, _fill_third)):
        words = _Words(ephemeris.prn)
        words.put(1, 1, 8, _PREAMBLE)
        words.put(1, 9, 16, message.telemetry_message)
        # The count is that of the start of the next subframe, in units of 6 s.
        words.put(2, 1, 17, 5 * frame_count + number)
        words.put(2, 18, 1, message.is_alert)
        words.put(2, 19, 1, message.is_anti_spoofing_on)
        words.put(2, 20, 3, number)
        fill(words, ephemeris, message)
        subframes.append(words.finish())
    first, second, third = subframes
    return first, second, third


def quantize_lnav(ephemeris: BroadcastEphemeris) -> BroadcastEphemeris:
    """Return the ephemeris as a receiver decodes it from the broadcast message.

    Raises
    ------
    ValueError
        See `encode_subframes`.
    """
    return decode_subframes(ephemeris.prn, encode_subframes(ephemeris), ephemeris.time)


def _accuracy_index(accuracy: float) -> int:
    for index in range(_NO_ACCURACY):
        if accuracy <= lnav_accuracy(index) * (1.0 + 1e-9):
            return index
    return _NO_ACCURACY


def _fill_first(words: _Words, e: BroadcastEphemeris, message: LnavMessage) -> None:
    # The week is that of transmission, toe may lie across the turn of the week.
    words.put(3, 1, 10, e.time.week % _WEEK_MODULUS)
    words.put(3, 11, 2, message.codes_on_l2)
    words.put(3, 13, 4, _accuracy_index(e.accuracy))
    words.put_steps((3, 17, 6), e.health, 1.0, "health", signed=False)
    words.put_steps((3, 23, 2), e.issue_of_data_clock >> 8, 1.0, "IODC", signed=False)
    words.put(4, 1, 1, message.is_l2p_data_off)
    words.put_steps((7, 17, 8), e.group_delay, 2.0**-31, "group_delay", signed=True)
    words.put(8, 1, 8, e.issue_of_data_clock)
    words.put_steps((8, 9, 16), e.toc, 16.0, "toc", signed=False)
    words.put_steps((9, 1, 8), e.af2, 2.0**-55, "af2", signed=True)
    words.put_steps((9, 9, 16), e.af1, 2.0**-43, "af1", signed=True)
    words.put_steps((10, 1, 22), e.af0, 2.0**-31, "af0", signed=True)


def _fill_second(words: _Words, e: BroadcastEphemeris, message: LnavMessage) -> None:
    words.put(3, 1, 8, e.issue_of_data_ephemeris)
    words.put_steps((3, 9, 16), e.crs, 2.0**-5, "crs", signed=True)
    words.put_steps(
        (4, 1, 16), e.mean_motion_difference / GPS_PI, 2.0**-43, "mean_motion_difference", True
    )
    words.put_angle(4, e.mean_anomaly)
    words.put_steps((6, 1, 16), e.cuc, 2.0**-29, "cuc", signed=True)
    words.put_steps((6, 17, 32), e.eccentricity, 2.0**-33, "eccentricity", signed=False)
    words.put_steps((8, 1, 16), e.cus, 2.0**-29, "cus", signed=True)
    root = math.sqrt(e.semi_major_axis)
    words.put_steps((8, 17, 32), root, 2.0**-19, "semi_major_axis", signed=False)
    words.put_steps((10, 1, 16), e.toe, 16.0, "toe", signed=False)
    words.put(10, 17, 1, e.fit_interval > DEFAULT_FIT_INTERVAL)
    words.put(10, 18, 5, message.age_of_data_offset)


def _fill_third(words: _Words, e: BroadcastEphemeris, message: LnavMessage) -> None:
    words.put_steps((3, 1, 16), e.cic, 2.0**-29, "cic", signed=True)
    words.put_angle(3, e.longitude_of_ascending_node)
    words.put_steps((5, 1, 16), e.cis, 2.0**-29, "cis", signed=True)
    words.put_angle(5, e.inclination)
    words.put_steps((7, 1, 16), e.crc, 2.0**-5, "crc", signed=True)
    words.put_angle(7, e.argument_of_perigee)
    words.put_steps(
        (9, 1, 24), e.right_ascension_rate / GPS_PI, 2.0**-43, "right_ascension_rate", signed=True
    )
    words.put(10, 1, 8, e.issue_of_data_ephemeris)
    words.put_steps((10, 9, 14), e.inclination_rate / GPS_PI, 2.0**-43, "inclination_rate", True)

"""GPS LNAV subframes 1 to 3 to ephemeris (IS-GPS-200, 20.3.3.3 and 20.3.3.4)."""

from __future__ import annotations

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import EPHEMERIS_SOURCE_LNAV, GPS_PI, SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris, lnav_accuracy, lnav_fit_interval

__all__ = ["SUBFRAME_LENGTH", "SubframeError", "decode_subframes"]

SUBFRAME_LENGTH = 30
"""Bytes of a subframe without parity: ten words of 24 bits."""
_PREAMBLE = 0x8B
_WEEK_MODULUS = 1024


class SubframeError(ValueError):
    """The bytes are not the three ephemeris subframes of one data set."""


class _Subframe:
    """Bit fields of one subframe, addressed by word and bit as in IS-GPS-200 figure 20-1."""

    def __init__(self, subframe: bytes, number: int) -> None:
        if len(subframe) != SUBFRAME_LENGTH:
            raise SubframeError(f"subframe {number}: {len(subframe)} bytes, 30 are required")
        self._bits = int.from_bytes(subframe, "big")
        if self.read_unsigned(1, 1, 8) != _PREAMBLE:
            raise SubframeError(f"subframe {number}: no preamble")
        if self.read_unsigned(2, 20, 3) != number:
            raise SubframeError(f"subframe {number}: it says {self.read_unsigned(2, 20, 3)}")

    def read_unsigned(self, word: int, first_bit: int, length: int) -> int:
        """Return `length` bits from bit `first_bit` (1..24) of `word` (1..10) on."""
        end = 24 * (word - 1) + first_bit - 1 + length
        return (self._bits >> (8 * SUBFRAME_LENGTH - end)) & ((1 << length) - 1)

    def read_signed(self, word: int, first_bit: int, length: int) -> int:
        """Return the field as a two's complement number."""
        value = self.read_unsigned(word, first_bit, length)
        return value - (1 << length) if value >> (length - 1) else value

    def read_long_unsigned(self, word: int) -> int:
        """Return 32 bits: the last 8 of `word` and all 24 of the next one."""
        return self.read_unsigned(word, 17, 32)

    def read_long_signed(self, word: int) -> int:
        """Return `read_long_unsigned` as a two's complement number."""
        return self.read_signed(word, 17, 32)


def decode_subframes(
    prn: int, subframes: tuple[bytes, bytes, bytes], time: GpsTime
) -> BroadcastEphemeris:
    """Decode the ephemeris of a GPS satellite.

    Parameters
    ----------
    prn : int
        Satellite number.
    subframes : tuple of 3 bytes
        Subframes 1, 2 and 3, each 30 bytes: TLM, HOW and eight data words, 24 bits a word,
        parity removed.
    time : GpsTime
        Approximate time of reception (within 9 years), which resolves the 10-bit week.

    Raises
    ------
    SubframeError
        If a subframe has the wrong length, preamble or number, or if the issues of data differ
        (the subframes are from different uploads).
    """
    first, second, third = (_Subframe(subframes[i], i + 1) for i in range(3))
    issue_of_data_clock = first.read_unsigned(3, 23, 2) << 8 | first.read_unsigned(8, 1, 8)
    issues = {
        issue_of_data_clock & 0xFF,
        second.read_unsigned(3, 1, 8),
        third.read_unsigned(10, 1, 8),
    }
    if len(issues) != 1:
        raise SubframeError(f"GPS PRN {prn}: issues of data {sorted(issues)} differ")
    toe = second.read_unsigned(10, 1, 16) * 16.0
    week = _full_week(first.read_unsigned(3, 1, 10), time)
    time_of_transmission = first.read_unsigned(2, 1, 17) * 6.0
    # The broadcast week is that of transmission; toe may lie across the turn of the week.
    if toe - time_of_transmission > 302400.0:
        week -= 1
    elif toe - time_of_transmission < -302400.0:
        week += 1
    # A product is rounded correctly; a power need not be, and the last bit counts here.
    root_of_semi_major_axis = second.read_long_unsigned(8) * 2.0**-19
    return BroadcastEphemeris(
        time=time,
        system=SYSTEM_GPS,
        prn=prn,
        source=EPHEMERIS_SOURCE_LNAV,
        issue_of_data_ephemeris=second.read_unsigned(3, 1, 8),
        issue_of_data_clock=issue_of_data_clock,
        health=first.read_unsigned(3, 17, 6),
        gps_week=week,
        toe=toe,
        toc=first.read_unsigned(8, 9, 16) * 16.0,
        af0=first.read_signed(10, 1, 22) * 2.0**-31,
        af1=first.read_signed(9, 9, 16) * 2.0**-43,
        af2=first.read_signed(9, 1, 8) * 2.0**-55,
        semi_major_axis=root_of_semi_major_axis * root_of_semi_major_axis,
        eccentricity=second.read_long_unsigned(6) * 2.0**-33,
        inclination=third.read_long_signed(5) * 2.0**-31 * GPS_PI,
        inclination_rate=third.read_signed(10, 9, 14) * 2.0**-43 * GPS_PI,
        longitude_of_ascending_node=third.read_long_signed(3) * 2.0**-31 * GPS_PI,
        right_ascension_rate=third.read_signed(9, 1, 24) * 2.0**-43 * GPS_PI,
        argument_of_perigee=third.read_long_signed(7) * 2.0**-31 * GPS_PI,
        mean_anomaly=second.read_long_signed(4) * 2.0**-31 * GPS_PI,
        mean_motion_difference=second.read_signed(4, 1, 16) * 2.0**-43 * GPS_PI,
        cuc=second.read_signed(6, 1, 16) * 2.0**-29,
        cus=second.read_signed(8, 1, 16) * 2.0**-29,
        crc=third.read_signed(7, 1, 16) * 2.0**-5,
        crs=second.read_signed(3, 9, 16) * 2.0**-5,
        cic=third.read_signed(3, 1, 16) * 2.0**-29,
        cis=third.read_signed(5, 1, 16) * 2.0**-29,
        group_delay=first.read_signed(7, 17, 8) * 2.0**-31,
        group_delay_secondary=0.0,
        accuracy=lnav_accuracy(first.read_unsigned(3, 13, 4)),
        fit_interval=lnav_fit_interval(second.read_unsigned(10, 17, 1), issue_of_data_clock),
    )


def _full_week(week_modulo: int, time: GpsTime) -> int:
    """Resolve a week modulo 1024 to the full week nearest to `time`."""
    difference = (week_modulo - time.week + _WEEK_MODULUS // 2) % _WEEK_MODULUS
    return time.week + difference - _WEEK_MODULUS // 2

"""Pairs of signals of one satellite, chosen from the observations of one or of many epochs.

A link is what has its own ambiguities and biases: satellite, two bands and their tracking
attributes. Links are numbered in the order in which they appear.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.signals import carrier_frequency_hz
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = ["DEFAULT_PAIRS", "Link", "PairRows", "PairSelector", "SignalPair"]

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_SYSTEMS, _SATELLITES, _BANDS = 8, 256, 10


@dataclass(frozen=True)
class SignalPair:
    """Two bands of a system and the tracking attributes that may serve, the best first.

    Parameters
    ----------
    system : int
        ``SYSTEM_*``.
    band_first, band_second : int
        RINEX frequency digits; the first of the higher frequency, so that TEC is positive.
    attributes_first, attributes_second : str
        RINEX attributes, e.g. ``"WPLXSC"``. Of each satellite and epoch the first available one
        is used.
    """

    system: int
    band_first: int
    band_second: int
    attributes_first: str
    attributes_second: str


DEFAULT_PAIRS = (
    SignalPair(c.SYSTEM_GPS, 1, 2, "CWP", "WPLXSC"),
    SignalPair(c.SYSTEM_GPS, 1, 5, "CWP", "QXI"),
    SignalPair(c.SYSTEM_GALILEO, 1, 5, "CXB", "QXI"),
    SignalPair(c.SYSTEM_GALILEO, 1, 7, "CXB", "QXI"),
    SignalPair(c.SYSTEM_GLONASS, 1, 2, "CP", "CP"),
    SignalPair(c.SYSTEM_BEIDOU, 2, 6, "IXQ", "IXQ"),
    SignalPair(c.SYSTEM_BEIDOU, 2, 7, "IXQ", "IXQ"),
    SignalPair(c.SYSTEM_QZSS, 1, 2, "CXL", "LXS"),
    SignalPair(c.SYSTEM_QZSS, 1, 5, "CXL", "QXI"),
)
"""Pairs that are used unless others are asked for."""


@dataclass(frozen=True)
class Link:
    """What has its own ambiguities and biases.

    Parameters
    ----------
    system, prn : int
        ``SYSTEM_*`` and RINEX satellite number.
    band_first, band_second : int
        RINEX frequency digits.
    attribute_first, attribute_second : str
        RINEX tracking attributes.
    frequency_first, frequency_second : float
        Hz.
    """

    system: int
    prn: int
    band_first: int
    band_second: int
    attribute_first: str
    attribute_second: str
    frequency_first: float
    frequency_second: float

    @property
    def code_first(self) -> str:
        """RINEX 3 observation code of the first pseudorange, e.g. ``"C1C"``."""
        return f"C{self.band_first}{self.attribute_first}"

    @property
    def code_second(self) -> str:
        """RINEX 3 observation code of the second pseudorange."""
        return f"C{self.band_second}{self.attribute_second}"

    @property
    def tecu_per_metre(self) -> float:
        """TECU that delay the second signal by 1 m more; NaN for an unknown FDMA channel."""
        if not math.isfinite(self.frequency_first + self.frequency_second):
            return math.nan
        return tecu_per_metre(self.frequency_first, self.frequency_second)


@dataclass(frozen=True, eq=False)
class PairRows:
    """Observations of links, one row each, in order of time; all arrays have shape (n,).

    Parameters
    ----------
    time : ndarray of int64
        GPS time of reception, ns since 1980-01-06.
    link, satellite : ndarray of int64
        Number of the link in `PairSelector.links`, and of the satellite.
    row_first, row_second : ndarray of int64
        Rows of the observations that were given. A satellite that has an observation in the first
        band of some pairs, but in no second one, has one row with `row_second` and `link` -1.
    stec_code_tecu, stec_phase_tecu : ndarray
        Slant TEC of code and phase, TECU, biases and ambiguities included; NaN where not observed.
    wide_lane_cycles : ndarray
        Melbourne-Wuebbena combination, cycles of the difference frequency.
    lock_time : ndarray
        Time of continuous tracking, s; the shorter of the two.
    cn0_dbhz : ndarray
        The lower of the two.
    code_valid, phase_valid, parity_known, lock_lost : ndarray of bool
        Of both signals (`lock_lost`: of any).
    half_cycle : ndarray of int64
        Changes when a receiver has added or removed half a cycle.
    """

    time: IntArray
    link: IntArray
    satellite: IntArray
    row_first: IntArray
    row_second: IntArray
    stec_code_tecu: FloatArray
    stec_phase_tecu: FloatArray
    wide_lane_cycles: FloatArray
    lock_time: FloatArray
    cn0_dbhz: FloatArray
    code_valid: BoolArray
    phase_valid: BoolArray
    parity_known: BoolArray
    lock_lost: BoolArray
    half_cycle: IntArray

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def part(self, start: int, end: int) -> PairRows:
        """Return rows `start` to `end` (not included)."""
        return PairRows(**{f.name: getattr(self, f.name)[start:end] for f in fields(self)})


class PairSelector:
    """Forms `PairRows` from observation columns.

    Parameters
    ----------
    pairs : sequence of SignalPair
        Their order is the order of the rows of a satellite.
    """

    def __init__(self, pairs: Sequence[SignalPair] = DEFAULT_PAIRS) -> None:
        self.links: list[Link] = []
        self._numbers: dict[tuple[int, ...], int] = {}
        self._satellites: dict[tuple[int, int], int] = {}
        self._pairs = np.array(
            [(pair.system, pair.band_first, pair.band_second) for pair in pairs], dtype=np.int64
        ).reshape(-1, 3)
        # Rank of an attribute; a signal of two pairs has the same order in both.
        self._rank = np.full((_SYSTEMS, _BANDS, 256), 255, dtype=np.uint8)
        for pair in pairs:
            for band, attributes in (
                (pair.band_first, pair.attributes_first),
                (pair.band_second, pair.attributes_second),
            ):
                for rank, attribute in enumerate(attributes):
                    self._rank[pair.system, band, ord(attribute)] = rank
        self._best = np.full((_SYSTEMS, _SATELLITES, _BANDS), -1, dtype=np.int64)

    def rows(self, time: npt.ArrayLike, columns: Mapping[str, npt.NDArray]) -> PairRows:  # type: ignore[type-arg]
        """Return the rows of one or more epochs.

        Parameters
        ----------
        time : array_like of int, shape (m,) or a scalar
            GPS time of every observation, ns since 1980-01-06, not decreasing. Observations of
            equal time are one epoch; an epoch must not be spread over two calls.
        columns : mapping of str to ndarray, shape (m,)
            Columns of `vtff_gnss.observations.OBSERVATION_COLUMNS`.
        """
        system = columns["system"]
        epoch = np.broadcast_to(np.asarray(time, dtype=np.int64), system.shape)
        first, second = _paired_rows(
            epoch,
            system,
            columns["prn"],
            columns["band"],
            columns["attribute"],
            self._pairs,
            self._rank,
            self._best,
        )
        return self._joined(epoch, columns, first, second)

    def _joined(
        self,
        time: IntArray,
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
        first: IntArray,
        second: IntArray,
    ) -> PairRows:
        link, satellite = self._link_numbers(columns, first, second)
        both = second >= 0
        # Where there is no second signal, the first stands in, and its results are blanked.
        other = np.where(both, second, first)
        factor, wave_first, wave_second, narrow, wide = self._factors(link, both)

        def pair(name: str) -> tuple[npt.NDArray, npt.NDArray]:  # type: ignore[type-arg]
            return columns[name][first], columns[name][other]

        range_first, range_second = pair("pseudorange")
        phase_first, phase_second = pair("carrier_phase_cycles")
        flags_first, flags_second = (part.astype(np.int64) for part in pair("flags"))
        flags_all, flags_any = flags_first & flags_second, flags_first | flags_second
        # NaN stands for a missing value, whatever the flags say.
        stec_code = np.where(both, (range_second - range_first) * factor, np.nan)
        stec_phase = (phase_first * wave_first - phase_second * wave_second) * factor
        code = narrow * range_first + (1.0 - narrow) * range_second
        half = c.FLAG_HALF_CYCLE_ADDED
        return PairRows(
            time=time[first],
            link=link,
            satellite=satellite,
            row_first=first,
            row_second=second,
            stec_code_tecu=stec_code,
            stec_phase_tecu=np.where(both, stec_phase, np.nan),
            wide_lane_cycles=phase_first - phase_second - code / wide,
            lock_time=np.minimum(*pair("lock_time")).astype(float),
            cn0_dbhz=np.minimum(*pair("cn0_dbhz")).astype(float),
            code_valid=both & ((flags_all & c.FLAG_CODE_VALID) != 0) & np.isfinite(stec_code),
            phase_valid=both & ((flags_all & c.FLAG_PHASE_VALID) != 0) & np.isfinite(stec_phase),
            parity_known=(flags_all & c.FLAG_PARITY_KNOWN) != 0,
            lock_lost=(flags_any & c.FLAG_LOCK_LOST) != 0,
            half_cycle=(flags_first & half) + 2 * (flags_second & half),
        )

    def _factors(self, link: IntArray, both: BoolArray) -> tuple[FloatArray, ...]:
        """Return TECU per metre, the wavelengths, the code weight and the wide-lane wavelength."""
        table = np.full((len(self.links) + 1, 5), np.nan)
        for number in np.unique(link[both]).tolist():
            known = self.links[number]
            one, other = known.frequency_first, known.frequency_second
            table[number] = (
                known.tecu_per_metre,
                SPEED_OF_LIGHT / one,
                SPEED_OF_LIGHT / other,
                one / (one + other),
                SPEED_OF_LIGHT / (one - other),
            )
        return tuple(table[link].T)

    def _link_numbers(
        self,
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
        first: IntArray,
        second: IntArray,
    ) -> tuple[IntArray, IntArray]:
        """Return the numbers of the links (-1 without a second signal) and of the satellites."""
        other = np.where(second >= 0, second, first)
        names = ("system", "prn", "band", "attribute", "glonass_channel")
        parts = [columns[name][first].astype(np.int64) for name in names]
        parts += [columns[name][other].astype(np.int64) for name in ("band", "attribute")]
        key = np.zeros(len(first), dtype=np.int64)
        for part in parts:
            key = key << 8 | (part & 0xFF)
        unique, where, inverse = np.unique(key, return_index=True, return_inverse=True)
        link = np.full(len(unique), -1, dtype=np.int64)
        satellite = np.empty(len(unique), dtype=np.int64)
        # In the order of appearance, so that numbers do not depend on how a file is cut.
        for index in np.argsort(where, kind="stable").tolist():
            entry = tuple(int(part[where[index]]) for part in parts)
            name = entry[0], entry[1]
            satellite[index] = self._satellites.setdefault(name, len(self._satellites))
            if second[where[index]] >= 0:
                link[index] = self._number(entry)
        return link[inverse], satellite[inverse]

    def _number(self, entry: tuple[int, ...]) -> int:
        number = self._numbers.get(entry)
        if number is None:
            system, prn, band_first, attribute_first, channel, band_second, attribute_second = entry
            frequencies = carrier_frequency_hz([system] * 2, [band_first, band_second], channel)
            self.links.append(
                Link(
                    system,
                    prn,
                    band_first,
                    band_second,
                    chr(attribute_first),
                    chr(attribute_second),
                    float(frequencies[0]),
                    float(frequencies[1]),
                )
            )
            number = self._numbers[entry] = len(self.links) - 1
        return number


@compiled
def _paired_rows(time, system, prn, band, attribute, pairs, rank, best):  # type: ignore[no-untyped-def]
    """Return the rows of first and second signals; one row with -1 where there is no second one.

    `best` is scratch, filled with -1 before and after.
    """
    count = len(time)
    most = count * max(1, len(pairs))
    first = np.empty(most, dtype=np.int64)
    second = np.empty(most, dtype=np.int64)
    found = 0
    start = 0
    while start < count:
        end = start
        while end < count and time[end] == time[start]:
            s, p, b = system[end], prn[end], band[end]
            own = rank[s, b, attribute[end]]
            if own < 255:
                known = best[s, p, b]
                if known < 0 or own < rank[s, b, attribute[known]]:
                    best[s, p, b] = end
            end += 1
        for row in range(start, end):
            s, p, b = system[row], prn[row], band[row]
            if best[s, p, b] != row:
                continue
            asked = found_before = found
            for pair in range(len(pairs)):
                if pairs[pair, 0] == s and pairs[pair, 1] == b:
                    asked += 1
                    if best[s, p, pairs[pair, 2]] >= 0:
                        first[found] = row
                        second[found] = best[s, p, pairs[pair, 2]]
                        found += 1
            if asked > found_before and found == found_before:
                first[found] = row
                second[found] = -1
                found += 1
        for row in range(start, end):
            best[system[row], prn[row], band[row]] = -1
        start = end
    return first[:found].copy(), second[:found].copy()

"""Pairs of signals of one satellite, chosen from the observations of one epoch or of many.

A link is a satellite with two bands and their tracking attributes; it has its own ambiguities and
biases. Links are numbered in the order in which they first appear.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.signals import carrier_frequency_hz, signal_number
from vtff_iono.links.geometry_free import tecu_per_metre

__all__ = ["DEFAULT_PAIRS", "Link", "PairRows", "PairSelector", "SignalPair", "link_keys"]

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_SYSTEMS, _SATELLITES, _BANDS = 8, 256, 10
# Rank of an attribute that no pair uses.
_NO_RANK = 255


@dataclass(frozen=True)
class SignalPair:
    """Two bands of a system and the tracking attributes that may be used, the best first.

    Parameters
    ----------
    system : int
        ``SYSTEM_*``.
    band_first, band_second : int
        RINEX frequency digits; the first has the higher frequency, so that TEC is positive.
    attributes_first, attributes_second : str
        RINEX attributes, e.g. ``"WPLXSC"``. For each satellite and epoch the first attribute that
        has an observation is used.
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
"""Pairs that are formed unless a caller gives others."""


@dataclass(frozen=True)
class Link:
    """Two signals of a satellite, which have their own ambiguities and biases.

    Parameters
    ----------
    system, prn : int
        ``SYSTEM_*`` and RINEX satellite number.
    band_first, band_second : int
        RINEX frequency digits.
    attribute_first, attribute_second : str
        RINEX tracking attributes.
    frequency_first, frequency_second : float
        Carrier frequencies, Hz; NaN for an unknown FDMA channel.
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
        """Content that delays the second code by 1 m more, TECU; NaN for an unknown channel."""
        if not math.isfinite(self.frequency_first + self.frequency_second):
            return math.nan
        return tecu_per_metre(self.frequency_first, self.frequency_second)

    @property
    def tecu_per_cycle(self) -> float:
        """Content that a cycle more of both phases looks like, TECU; NaN for an unknown channel."""
        wavelengths = SPEED_OF_LIGHT / self.frequency_first, SPEED_OF_LIGHT / self.frequency_second
        return self.tecu_per_metre * (wavelengths[0] - wavelengths[1])


@dataclass(frozen=True, eq=False)
class PairRows:
    """Observations of links, one row each, in order of time; all arrays have shape (n,).

    Parameters
    ----------
    time : ndarray of int64
        GPS time of reception, ns since 1980-01-06.
    link, satellite : ndarray of int64
        Index of the link in `PairSelector.links`, and number of the satellite; satellites are
        numbered from 0 in the order in which they first appear.
    row_first, row_second : ndarray of int64
        Rows of the two observations among those that were given. A satellite that has an
        observation in the first band of some pairs, but in no second band, has one row with
        `row_second` and `link` -1.
    stec_code_tecu, stec_phase_tecu : ndarray
        Slant TEC of code and phase, TECU, biases and ambiguities included; NaN where not observed.
    wide_lane_cycles : ndarray
        Melbourne-Wuebbena combination, cycles of the difference frequency.
    lock_time : ndarray
        Time of continuous tracking, s; the shorter time of the two signals.
    cn0_dbhz : ndarray
        The lower C/N0 of the two signals.
    code_valid, phase_valid, parity_known : ndarray of bool
        True where it holds for both signals.
    lock_lost : ndarray of bool
        True where any of the two signals lost lock.
    half_cycle : ndarray of int64
        Changes when the receiver has added half a cycle to a signal or removed it.
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

    def parts(self, first_row: Sequence[int], first_observation: npt.ArrayLike) -> list[PairRows]:
        """Return the rows of k blocks that follow each other.

        Parameters
        ----------
        first_row : sequence of int, length k + 1
            Where the rows of each block begin; last their number.
        first_observation : array_like of int, shape (k,)
            Where the observations of each block begin: they are counted from there.
        """
        columns = {name: getattr(self, name) for name in _ROW_COLUMNS}
        before = np.repeat(first_observation, np.diff(first_row))
        columns["row_first"] = self.row_first - before
        second = self.row_second
        columns["row_second"] = np.where(second < 0, second, second - before)
        return [
            PairRows(*[column[first:end] for column in columns.values()])
            for first, end in itertools.pairwise(first_row)
        ]


_ROW_COLUMNS = tuple(field.name for field in dataclasses.fields(PairRows))


class PairSelector:
    """Forms `PairRows` from observation columns.

    Parameters
    ----------
    pairs : sequence of SignalPair
        The rows of a satellite follow each other in this order.

    Attributes
    ----------
    links : list of Link
        All links seen so far.
    """

    def __init__(self, pairs: Sequence[SignalPair] = DEFAULT_PAIRS) -> None:
        self.links: list[Link] = []
        self._link_of_key: dict[int, int] = {}
        self._index_of_satellite: dict[tuple[int, int], int] = {}
        self._pairs = np.array(
            [(pair.system, pair.band_first, pair.band_second) for pair in pairs], dtype=np.int64
        ).reshape(-1, 3)
        # Rank of an attribute; a band that occurs in two pairs has the same order in both.
        self._rank = np.full((_SYSTEMS, _BANDS, 256), _NO_RANK, dtype=np.uint8)
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
        first, second = _pair_rows(
            epoch,
            system,
            columns["prn"],
            columns["band"],
            columns["attribute"],
            self._pairs,
            self._rank,
            self._best,
        )
        return self._combine(epoch, columns, first, second)

    def _combine(
        self,
        time: IntArray,
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
        first: IntArray,
        second: IntArray,
    ) -> PairRows:
        """Return the combinations of pairs of observations, given by their row numbers."""
        has_second = second >= 0
        # Where there is no second signal, the first stands in, and its results are blanked.
        second_or_first = np.where(has_second, second, first)
        link, satellite = self._link_numbers(columns, first, second_or_first, has_second)
        factor, wavelength_first, wavelength_second, code_weight, wide_wavelength = self._factors(
            link, has_second
        )

        def of_both(name: str) -> tuple[npt.NDArray, npt.NDArray]:  # type: ignore[type-arg]
            return columns[name][first], columns[name][second_or_first]

        range_first, range_second = of_both("pseudorange")
        phase_first, phase_second = of_both("carrier_phase_cycles")
        flags_first, flags_second = (flags.astype(np.int64) for flags in of_both("flags"))
        flags_all, flags_any = flags_first & flags_second, flags_first | flags_second
        # NaN stands for a missing value, whatever the flags say.
        stec_code = np.where(has_second, (range_second - range_first) * factor, np.nan)
        stec_phase = (phase_first * wavelength_first - phase_second * wavelength_second) * factor
        narrow_lane_range = code_weight * range_first + (1.0 - code_weight) * range_second
        is_code = has_second & ((flags_all & c.FLAG_CODE_VALID) != 0)
        is_phase = has_second & ((flags_all & c.FLAG_PHASE_VALID) != 0)
        half = c.FLAG_HALF_CYCLE_ADDED
        return PairRows(
            time=time[first],
            link=link,
            satellite=satellite,
            row_first=first,
            row_second=second,
            stec_code_tecu=stec_code,
            stec_phase_tecu=np.where(has_second, stec_phase, np.nan),
            wide_lane_cycles=phase_first - phase_second - narrow_lane_range / wide_wavelength,
            lock_time=np.minimum(*of_both("lock_time")).astype(float),
            cn0_dbhz=np.minimum(*of_both("cn0_dbhz")).astype(float),
            code_valid=is_code & np.isfinite(stec_code),
            phase_valid=is_phase & np.isfinite(stec_phase),
            parity_known=(flags_all & c.FLAG_PARITY_KNOWN) != 0,
            lock_lost=(flags_any & c.FLAG_LOCK_LOST) != 0,
            half_cycle=(flags_first & half) + 2 * (flags_second & half),
        )

    def _factors(self, number: IntArray, is_link: BoolArray) -> tuple[FloatArray, ...]:
        """Return five factors of each row; NaN where there is no link.

        They are the TECU per metre, the wavelengths of the two signals, m, the weight of the first
        code in the narrow-lane range, and the wide-lane wavelength, m.
        """
        table = np.full((len(self.links) + 1, 5), np.nan)
        for index in np.flatnonzero(np.bincount(number[is_link])).tolist():
            link = self.links[index]
            frequency_first, frequency_second = link.frequency_first, link.frequency_second
            table[index] = (
                link.tecu_per_metre,
                SPEED_OF_LIGHT / frequency_first,
                SPEED_OF_LIGHT / frequency_second,
                frequency_first / (frequency_first + frequency_second),
                SPEED_OF_LIGHT / (frequency_first - frequency_second),
            )
        return tuple(table[number].T)

    def _link_numbers(
        self,
        columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
        first: IntArray,
        second: IntArray,
        has_second: BoolArray,
    ) -> tuple[IntArray, IntArray]:
        """Return the numbers of the links (-1 without a second signal) and of the satellites."""
        keys, rows, key_of_row = np.unique(
            link_keys(columns, first, second), return_index=True, return_inverse=True
        )
        link = np.full(len(keys), -1, dtype=np.int64)
        satellite = np.empty(len(keys), dtype=np.int64)
        # In the order of appearance, so that numbers do not depend on how a file is cut.
        for index in np.argsort(rows).tolist():
            key, row = int(keys[index]), int(rows[index])
            observation = int(first[row])
            identity = int(columns["system"][observation]), int(columns["prn"][observation])
            satellite[index] = self._index_of_satellite.setdefault(
                identity, len(self._index_of_satellite)
            )
            if has_second[row]:
                if key not in self._link_of_key:
                    self._link_of_key[key] = len(self.links)
                    self.links.append(_make_link(columns, observation, int(second[row])))
                link[index] = self._link_of_key[key]
        return link[key_of_row], satellite[key_of_row]


def link_keys(
    columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
    first: IntArray,
    second: IntArray,
) -> IntArray:
    """Return one integer for each combination of two signals and a GLONASS channel.

    `first` and `second` are rows of observations of the same satellite.
    """
    key = signal_number(
        columns["system"][first],
        columns["prn"][first],
        columns["band"][first],
        columns["attribute"][first],
    )
    # The channels of GLONASS are negative too; a byte holds them in two's complement.
    channel = columns["glonass_channel"][first].astype(np.int8).view(np.uint8)
    for field in (channel, columns["band"][second], columns["attribute"][second]):
        key = key * 256 + field
    return key


def _make_link(
    columns: Mapping[str, npt.NDArray],  # type: ignore[type-arg]
    first: int,
    second: int,
) -> Link:
    """Return the link of two observations of a satellite, given by their row numbers."""
    system = int(columns["system"][first])
    band_first, band_second = int(columns["band"][first]), int(columns["band"][second])
    frequency_first, frequency_second = carrier_frequency_hz(
        [system] * 2, [band_first, band_second], int(columns["glonass_channel"][first])
    )
    return Link(
        system=system,
        prn=int(columns["prn"][first]),
        band_first=band_first,
        band_second=band_second,
        attribute_first=chr(columns["attribute"][first]),
        attribute_second=chr(columns["attribute"][second]),
        frequency_first=float(frequency_first),
        frequency_second=float(frequency_second),
    )


@compiled
def _pair_rows(time, system, prn, band, attribute, pairs, rank, best):  # type: ignore[no-untyped-def]
    """Return the rows of first and second signals; one row with -1 where there is no second one.

    `best` is scratch, filled with -1 before and after: for each satellite and band the row whose
    attribute has the lowest rank.
    """
    count = len(time)
    most = count * max(1, len(pairs))
    first = np.empty(most, dtype=np.int64)
    second = np.empty(most, dtype=np.int64)
    filled = 0
    start = 0
    while start < count:
        end = start
        while end < count and time[end] == time[start]:
            s, p, b = system[end], prn[end], band[end]
            row_rank = rank[s, b, attribute[end]]
            if row_rank < _NO_RANK:
                best_row = best[s, p, b]
                if best_row < 0 or row_rank < rank[s, b, attribute[best_row]]:
                    best[s, p, b] = end
            end += 1
        for row in range(start, end):
            s, p, b = system[row], prn[row], band[row]
            if best[s, p, b] != row:
                continue
            has_pair = False
            filled_before = filled
            for pair in range(len(pairs)):
                if pairs[pair, 0] == s and pairs[pair, 1] == b:
                    has_pair = True
                    if best[s, p, pairs[pair, 2]] >= 0:
                        first[filled] = row
                        second[filled] = best[s, p, pairs[pair, 2]]
                        filled += 1
            if has_pair and filled == filled_before:
                first[filled] = row
                second[filled] = -1
                filled += 1
        for row in range(start, end):
            best[system[row], prn[row], band[row]] = -1
        start = end
    return first[:filled].copy(), second[:filled].copy()

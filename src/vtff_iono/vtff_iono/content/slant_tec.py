"""Absolute slant electron content of links: phase levelled to code, with one sigma and reasons.

The phase content of an arc lacks a constant. It is the weighted mean of code minus phase, after
the satellite bias, over the samples of the arc so far: the numbers depend on the past only, so that
they are the same online and offline. `ArcLevels` gives the means at the end of the arcs, for
work after the fact.

One sigma of a sample has four parts: phase noise, levelling, satellite bias and receiver bias. The
levelling part is the larger of two estimates: from the scatter of single samples, and from the
scatter of one-minute means, which sees multipath.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_iono.links.arcs import ArcDetector, Arcs, ArcSettings
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, PairRows, PairSelector, SignalPair

__all__ = [
    "ArcLevels",
    "BiasFunction",
    "Rejection",
    "SlantTecProcessor",
    "SlantTecRows",
    "SlantTecSettings",
]

BiasFunction = Callable[[Link, GpsTime], tuple[float, float]]
"""Gives a bias first - second of a link at a time, and its sigma, s; NaN where unknown."""

# A bias is looked up again at the start of each hour.
_BIAS_INTERVAL_NANOSECONDS = 3600 * NANOSECONDS_PER_SECOND


class Rejection(enum.IntFlag):
    """Why a sample was rejected: the sum of all reasons; 0 = good."""

    NONE = 0
    NO_SECOND_SIGNAL = 1
    """The satellite has an observation in a first band and in no second one."""
    CODE_INVALID = 2
    """A pseudorange is missing or its loop not locked: the sample does not level the arc."""
    PHASE_INVALID = 4
    """A carrier phase is missing or its loop not locked."""
    PARITY_UNKNOWN = 8
    """A phase may be off by half a cycle."""
    LOW_CN0 = 16
    LOW_ELEVATION = 32
    NO_GEOMETRY = 64
    """No ephemeris or no position: elevation unknown."""
    NO_SATELLITE_BIAS = 128
    """The content contains the unknown bias of the satellite."""
    CODE_OUTLIER = 256
    """Code and phase disagree: the sample does not level the arc."""
    NOT_LEVELLED = 512
    """No sample of the arc could level it yet."""
    NO_RECEIVER_BIAS = 1024
    """The content contains the unknown bias of the receiver."""


_UNUSABLE = (
    Rejection.NO_SECOND_SIGNAL
    | Rejection.PHASE_INVALID
    | Rejection.PARITY_UNKNOWN
    | Rejection.LOW_CN0
    | Rejection.LOW_ELEVATION
    | Rejection.NO_GEOMETRY
)
_NOT_FOR_LEVELLING = _UNUSABLE | Rejection.CODE_INVALID


@dataclass(frozen=True)
class SlantTecSettings:
    """Limits and assumed noise.

    Parameters
    ----------
    elevation_minimum : float
        rad.
    cn0_minimum_dbhz : float
        Of the weaker signal.
    pseudorange_sigma, carrier_phase_sigma : float
        Noise of a single signal at the zenith, m; the scatter of the code replaces the first as
        samples come in.
    code_outlier_sigmas : float
        Deviation of code minus phase from its mean above which a sample does not level.
    """

    elevation_minimum: float = math.radians(10.0)
    cn0_minimum_dbhz: float = 20.0
    pseudorange_sigma: float = 0.3
    carrier_phase_sigma: float = 0.001
    code_outlier_sigmas: float = 5.0


@dataclass(frozen=True, eq=False)
class SlantTecRows:
    """Slant content of links, one row each; all arrays have shape (n,).

    Parameters
    ----------
    pairs : PairRows
        The observations.
    elevation : ndarray
        rad.
    stec_tecu, stec_sigma_tecu : ndarray
        Levelled phase content, satellite bias removed, and one sigma, TECU; NaN without phase or
        level. The bias of the receiver is removed where it was given.
    stec_code_tecu : ndarray
        From the code of this sample alone, the same biases removed.
    stec_phase_tecu : ndarray
        Phase content without level: differences within an arc are good to the phase noise.
    satellite_bias_tecu, satellite_bias_sigma_tecu : ndarray
        What was removed for the satellite, and its sigma; NaN where unknown (then nothing was).
    arc, break_reason : ndarray of int64
        As in `vtff_iono.links.arcs.Arcs`.
    rejected : ndarray of uint16
        `Rejection`.
    """

    pairs: PairRows
    elevation: FloatArray
    stec_tecu: FloatArray
    stec_sigma_tecu: FloatArray
    stec_code_tecu: FloatArray
    stec_phase_tecu: FloatArray
    satellite_bias_tecu: FloatArray
    satellite_bias_sigma_tecu: FloatArray
    arc: npt.NDArray[np.int64]
    break_reason: npt.NDArray[np.int64]
    rejected: npt.NDArray[np.uint16]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.arc)

    def part(self, start: int, end: int, first_observation: int) -> SlantTecRows:
        """Return rows `start` to `end` (not included) as those of a block of its own.

        Parameters
        ----------
        start, end : int
        first_observation : int
            The observation that the block begins with.
        """
        pairs = self.pairs.part(start, end)
        second = np.where(pairs.row_second < 0, -1, pairs.row_second - first_observation)
        pairs = replace(pairs, row_first=pairs.row_first - first_observation, row_second=second)
        others = (field.name for field in fields(self) if field.name != "pairs")
        return SlantTecRows(pairs, **{name: getattr(self, name)[start:end] for name in others})


def no_bias(link: Link, time: GpsTime) -> tuple[float, float]:
    """Return a bias of zero: for simulated signals, and for a receiver bias yet to be estimated."""
    return 0.0, 0.0


class SlantTecProcessor:
    """Slant content of one receiver, epoch by epoch or many epochs at once.

    Parameters
    ----------
    satellite_bias, receiver_bias : BiasFunction
        What to remove. An unknown satellite bias rejects the sample. An unknown receiver bias
        rejects it too, and nothing is removed.
    settings : SlantTecSettings
    arc_settings : ArcSettings
    pairs : sequence of SignalPair
    """

    def __init__(
        self,
        satellite_bias: BiasFunction = no_bias,
        receiver_bias: BiasFunction = no_bias,
        settings: SlantTecSettings = SlantTecSettings(),  # noqa: B008 - frozen
        arc_settings: ArcSettings = ArcSettings(),  # noqa: B008 - frozen
        pairs: Sequence[SignalPair] = DEFAULT_PAIRS,
    ) -> None:
        self._selector = PairSelector(pairs)
        self._arcs = ArcDetector(arc_settings)
        self._settings = settings
        self._satellite_bias = satellite_bias
        self._receiver_bias = receiver_bias
        self._levels = np.zeros((0, _STATE))
        self._known_biases: dict[int, FloatArray] = {}

    @property
    def links(self) -> list[Link]:
        """Links seen so far; their numbers are indices of this list."""
        return self._selector.links

    def update(
        self,
        time: npt.ArrayLike,
        columns: dict[str, npt.NDArray],  # type: ignore[type-arg]
        elevation: npt.ArrayLike,
    ) -> SlantTecRows:
        """Return the content of one or more whole epochs.

        Parameters
        ----------
        time, columns
            As in `PairSelector.rows`.
        elevation : array_like, shape (m,)
            Elevation of every observation, rad; NaN where unknown.
        """
        rows = self._selector.rows(time, columns)
        elevation = np.asarray(elevation, dtype=float)[rows.row_first]
        arcs = self._arcs.update(rows)
        rejected = self._rejections(rows, elevation)
        biases = self._biases(rows)
        return self._levelled(rows, arcs, elevation, rejected, biases)

    def _rejections(self, rows: PairRows, elevation: FloatArray) -> npt.NDArray[np.uint16]:
        settings = self._settings
        reasons = (
            (Rejection.NO_SECOND_SIGNAL, rows.link < 0),
            (Rejection.CODE_INVALID, ~rows.code_valid),
            (Rejection.PHASE_INVALID, ~rows.phase_valid),
            (Rejection.PARITY_UNKNOWN, ~rows.parity_known),
            (Rejection.LOW_CN0, rows.cn0_dbhz < settings.cn0_minimum_dbhz),
            (Rejection.LOW_ELEVATION, elevation < settings.elevation_minimum),
            (Rejection.NO_GEOMETRY, np.isnan(elevation)),
        )
        rejected = np.zeros(len(rows), dtype=np.uint16)
        for reason, applies in reasons:
            rejected |= np.where(applies, np.uint16(reason), np.uint16(0))
        return rejected

    def _biases(self, rows: PairRows) -> FloatArray:
        """Return satellite bias and sigma, receiver bias and sigma, TECU, shape (4, n)."""
        hour = rows.time // _BIAS_INTERVAL_NANOSECONDS
        keys, inverse = np.unique(hour << 16 | (rows.link & 0xFFFF), return_inverse=True)
        table = np.full((len(keys), 4), np.nan)
        for index, key in enumerate(keys.tolist()):
            number = key & 0xFFFF
            if number == 0xFFFF:
                continue
            if key not in self._known_biases:
                link = self.links[number]
                time = GpsTime((key >> 16) * _BIAS_INTERVAL_NANOSECONDS)
                scale = SPEED_OF_LIGHT * link.tecu_per_metre
                both = (*self._satellite_bias(link, time), *self._receiver_bias(link, time))
                table[index] = [scale * part for part in both]
                # One that is unknown may come with the next ephemeris.
                if np.isfinite(table[index, 0]):
                    self._known_biases[key] = table[index].copy()
            else:
                table[index] = self._known_biases[key]
        return np.asarray(table[inverse].T)

    def _levelled(
        self,
        rows: PairRows,
        arcs: Arcs,
        elevation: FloatArray,
        rejected: npt.NDArray[np.uint16],
        biases: FloatArray,
    ) -> SlantTecRows:
        satellite, satellite_sigma, receiver, receiver_sigma = biases
        known = np.isfinite(satellite)
        rejected = rejected | np.where(
            known | (rows.link < 0), np.uint16(0), np.uint16(Rejection.NO_SATELLITE_BIAS)
        )
        factor = self._factor(rows)
        if len(rows):
            self._grow(int(rows.link.max()) + 1)
        level, level_sigma, outlier = _level(
            rows.time,
            rows.link,
            arcs.number,
            # Without the bias, so that levels stay right when it becomes known within an arc.
            rows.stec_code_tecu - rows.stec_phase_tecu,
            np.sin(elevation),
            (rejected & np.uint16(_NOT_FOR_LEVELLING)) == 0,
            math.sqrt(2.0) * self._settings.pseudorange_sigma * factor,
            self._settings.code_outlier_sigmas,
            self._levels,
        )
        rejected |= np.where(outlier, np.uint16(Rejection.CODE_OUTLIER), np.uint16(0))
        unlevelled = np.isnan(level) & (arcs.number > 0)
        rejected |= np.where(unlevelled, np.uint16(Rejection.NOT_LEVELLED), np.uint16(0))
        has_receiver = np.isfinite(receiver)
        unknown = ~has_receiver & (rows.link >= 0)
        rejected |= np.where(unknown, np.uint16(Rejection.NO_RECEIVER_BIAS), np.uint16(0))
        # P_second - P_first = STEC / K - c DSB: biases are added to the observed difference.
        removed = np.where(known, satellite, 0.0) + np.where(has_receiver, receiver, 0.0)
        phase_sigma = math.sqrt(2.0) * self._settings.carrier_phase_sigma * factor
        variance = (
            phase_sigma**2
            + level_sigma**2
            + np.where(known, satellite_sigma, 0.0) ** 2
            + np.where(has_receiver, receiver_sigma, 0.0) ** 2
        )
        return SlantTecRows(
            pairs=rows,
            elevation=elevation,
            stec_tecu=rows.stec_phase_tecu + level + removed,
            stec_sigma_tecu=np.sqrt(variance),
            stec_code_tecu=rows.stec_code_tecu + removed,
            stec_phase_tecu=rows.stec_phase_tecu,
            satellite_bias_tecu=satellite,
            satellite_bias_sigma_tecu=satellite_sigma,
            arc=arcs.number,
            break_reason=arcs.break_reason,
            rejected=rejected,
        )

    def _factor(self, rows: PairRows) -> FloatArray:
        """Return TECU per metre of each row; NaN without a link."""
        table = np.full(len(self.links) + 1, np.nan)
        for number in np.unique(rows.link[rows.link >= 0]).tolist():
            table[number] = self.links[number].tecu_per_metre
        return table[rows.link]

    def _grow(self, links: int) -> None:
        missing = links - len(self._levels)
        if missing > 0:
            self._levels = np.concatenate((self._levels, np.zeros((missing, _STATE))))


class ArcLevels:
    """Levels of whole arcs, for work after the fact.

    Parameters
    ----------
    rows : SlantTecRows
        All rows of a file.
    """

    def __init__(self, rows: SlantTecRows) -> None:
        usable = np.isfinite(rows.stec_tecu)
        key = rows.pairs.link << 32 | rows.arc
        order = np.flatnonzero(usable)
        # The last row of each arc has the level of all its samples.
        reverse = order[::-1]
        keys, last = np.unique(key[reverse], return_index=True)
        final = reverse[last]
        place = np.minimum(np.searchsorted(keys, key), max(len(keys) - 1, 0))
        self.stec_tecu = np.full(len(rows), np.nan)
        self.stec_sigma_tecu = np.full(len(rows), np.nan)
        if len(keys):
            found = (keys[place] == key) & (rows.arc > 0)
            level = rows.stec_tecu[final] - rows.stec_phase_tecu[final]
            self.stec_tecu = np.where(found, rows.stec_phase_tecu + level[place], np.nan)
            self.stec_sigma_tecu = np.where(found, rows.stec_sigma_tecu[final][place], np.nan)


# Columns of the state of a link: sums over the samples of its arc, with weight sin^2 of elevation.
_ARC, _WEIGHT, _MEAN, _SQUARES, _COUNT = range(5)
_BLOCK, _BLOCK_WEIGHT, _BLOCK_MEAN, _BLOCKS, _BLOCK_SUM, _BLOCK_SQUARES = range(5, 11)
# The first sample, which the sums are relative to so that squares keep their digits, and how many
# outliers have come in a row.
_REFERENCE, _OUTLIERS = range(11, 13)
_STATE = 13

_BLOCK_NANOSECONDS = 60 * NANOSECONDS_PER_SECOND
_FEWEST_BLOCKS = 4
# The assumed noise counts as much as this many samples against the observed scatter.
_PRIOR_SAMPLES = 20.0
# So many outliers in a row: it was the level that was wrong.
_MOST_OUTLIERS = 10.0


@compiled
def _level_variance(state, sigma):  # type: ignore[no-untyped-def]
    """Return the variance of the level of an arc."""
    prior = _PRIOR_SAMPLES * sigma * sigma
    per_weight = (prior + state[_SQUARES]) / (_PRIOR_SAMPLES + state[_COUNT])
    variance = per_weight / state[_WEIGHT]
    blocks = state[_BLOCKS]
    if blocks >= _FEWEST_BLOCKS:
        spread = state[_BLOCK_SQUARES] - state[_BLOCK_SUM] * state[_BLOCK_SUM] / blocks
        variance = max(variance, spread / ((blocks - 1.0) * blocks))
    return variance


@compiled
def _take_in(state, difference, weight, block):  # type: ignore[no-untyped-def]
    """Add a sample of code minus phase to the sums of its arc."""
    if block != state[_BLOCK]:
        if state[_BLOCK_WEIGHT] > 0.0:
            state[_BLOCKS] += 1.0
            state[_BLOCK_SUM] += state[_BLOCK_MEAN]
            state[_BLOCK_SQUARES] += state[_BLOCK_MEAN] * state[_BLOCK_MEAN]
        state[_BLOCK] = block
        state[_BLOCK_WEIGHT] = 0.0
        state[_BLOCK_MEAN] = 0.0
    state[_BLOCK_WEIGHT] += weight
    state[_BLOCK_MEAN] += weight / state[_BLOCK_WEIGHT] * (difference - state[_BLOCK_MEAN])
    state[_WEIGHT] += weight
    deviation = difference - state[_MEAN]
    state[_MEAN] += weight / state[_WEIGHT] * deviation
    state[_SQUARES] += weight * deviation * (difference - state[_MEAN])
    state[_COUNT] += 1.0


@compiled
def _is_outlier(state, difference, weight, sigma, outlier_sigmas):  # type: ignore[no-untyped-def]
    """Return whether a sample of code minus phase is too far from the level of its arc."""
    if state[_COUNT] == 0.0:
        return False
    prior = _PRIOR_SAMPLES * sigma * sigma
    single = (prior + state[_SQUARES]) / (_PRIOR_SAMPLES + state[_COUNT]) / weight
    deviation = difference - state[_REFERENCE] - state[_MEAN]
    return deviation * deviation > outlier_sigmas**2 * (single + _level_variance(state, sigma))


@compiled
def _level(time, link, arc, difference, sine, usable, sigma, outlier_sigmas, states):  # type: ignore[no-untyped-def]
    """Return level and sigma of the arcs, NaN where none, and which samples were outliers."""
    count = len(time)
    level = np.full(count, np.nan)
    level_sigma = np.full(count, np.nan)
    outlier = np.zeros(count, dtype=np.bool_)
    for row in range(count):
        if link[row] < 0 or arc[row] == 0:
            continue
        state = states[link[row]]
        if state[_ARC] != arc[row]:
            state[:] = 0.0
            state[_ARC] = arc[row]
        if usable[row]:
            weight = sine[row] * sine[row]
            outlier[row] = _is_outlier(state, difference[row], weight, sigma[row], outlier_sigmas)
            state[_OUTLIERS] = state[_OUTLIERS] + 1.0 if outlier[row] else 0.0
            if state[_OUTLIERS] > _MOST_OUTLIERS:
                state[:] = 0.0
                state[_ARC] = arc[row]
                outlier[row] = False
            if state[_COUNT] == 0.0:
                state[_REFERENCE] = difference[row]
            if not outlier[row]:
                block = time[row] // _BLOCK_NANOSECONDS
                _take_in(state, difference[row] - state[_REFERENCE], weight, block)
        if state[_COUNT] > 0.0:
            level[row] = state[_REFERENCE] + state[_MEAN]
            level_sigma[row] = np.sqrt(_level_variance(state, sigma[row]))
    return level, level_sigma, outlier

"""Absolute slant electron content of links: phase levelled to code, with one sigma and reasons.

The phase content of an arc lacks a constant, its level. The level is the weighted mean of code
content minus phase content over the samples of the arc so far. It depends on the past only, so that
online and offline processing give the same numbers. `ArcLevels` gives the levels at the end of the
arcs, for offline processing.

One sigma of a sample has four parts: phase noise, levelling, satellite bias and receiver bias. The
levelling part is the larger of two estimates: one from the scatter of single samples, one from the
scatter of one-minute means, which contain the multipath.
"""

from __future__ import annotations

import dataclasses
import enum
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_iono.geometry.satellite_geometry import ELEVATION_MASK_DEG
from vtff_iono.links.arcs import ArcDetector, Arcs, ArcSettings, arc_keys
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, PairRows, PairSelector, SignalPair

__all__ = [
    "WITHOUT_CONTENT",
    "ArcLevels",
    "BiasFunction",
    "Rejection",
    "SlantTecProcessor",
    "SlantTecRows",
    "SlantTecSettings",
    "no_bias",
]

BiasFunction = Callable[[Link, GpsTime], tuple[float, float]]
"""Function that returns the code bias first - second of a link at a time and its sigma, s.

Both are NaN where the bias is unknown."""

# A bias is looked up again at the start of each hour.
_BIAS_INTERVAL_NANOSECONDS = 3600 * NANOSECONDS_PER_SECOND


class Rejection(enum.IntFlag):
    """Reasons for which a sample was rejected, summed; 0 for a good sample."""

    NONE = 0
    NO_SECOND_SIGNAL = 1
    """The satellite has an observation in a first band and in no second band."""
    CODE_INVALID = 2
    """A pseudorange is missing or its loop is not locked: the sample does not level the arc."""
    PHASE_INVALID = 4
    """A carrier phase is missing or its loop is not locked."""
    PARITY_UNKNOWN = 8
    """A phase may be off by half a cycle."""
    LOW_CN0 = 16
    """The C/N0 of the weaker signal is below the limit."""
    LOW_ELEVATION = 32
    """The satellite is below the elevation mask."""
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


WITHOUT_CONTENT = np.uint16(
    0xFFFF - Rejection.CODE_OUTLIER - Rejection.CODE_INVALID - Rejection.NO_RECEIVER_BIAS
)
"""A sample with any of these reasons has no content that a receiver bias can be estimated from."""

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
    """Limits of the samples, and their assumed noise.

    Parameters
    ----------
    elevation_mask : float
        Elevation mask, rad.
    cn0_minimum_dbhz : float
        Smallest C/N0 of the weaker signal, dB-Hz.
    pseudorange_sigma, carrier_phase_sigma : float
        Noise of a single signal at the zenith, m. The observed scatter of the code replaces
        `pseudorange_sigma` as samples come in.
    code_outlier_sigmas : float
        A sample whose code minus phase deviates from the level by more than this many sigmas does
        not level the arc.
    """

    elevation_mask: float = math.radians(ELEVATION_MASK_DEG)
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
        The combinations of observations.
    elevation : ndarray
        Elevation of the satellite, rad.
    stec_tecu, stec_sigma_tecu : ndarray
        Levelled phase content, satellite bias removed, and one sigma, TECU; NaN without phase or
        level. The bias of the receiver is removed where it was given.
    stec_code_tecu : ndarray
        Content from the code of this sample alone, the same biases removed, TECU.
    stec_phase_tecu : ndarray
        Phase content without level, TECU: differences within an arc are good to the phase noise.
    satellite_bias_tecu, satellite_bias_sigma_tecu : ndarray
        Satellite bias that was removed, and its sigma, TECU; NaN where the bias is unknown (then
        nothing was removed).
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

    def parts(
        self, first_row: Sequence[int], first_observation: npt.ArrayLike
    ) -> list[SlantTecRows]:
        """Return the rows of blocks that follow each other; arguments as of `PairRows.parts`."""
        columns = [getattr(self, name) for name in _CONTENT_COLUMNS]
        pairs = self.pairs.parts(first_row, first_observation)
        return [
            SlantTecRows(of_block, *[column[first:end] for column in columns])
            for of_block, (first, end) in zip(pairs, itertools.pairwise(first_row), strict=True)
        ]


_CONTENT_COLUMNS = tuple(
    field.name for field in dataclasses.fields(SlantTecRows) if field.name != "pairs"
)


def no_bias(link: Link, time: GpsTime) -> tuple[float, float]:
    """Return a bias of zero: for simulated signals, and for a receiver bias yet to be estimated."""
    return 0.0, 0.0


class SlantTecProcessor:
    """Slant content of one receiver, epoch by epoch or many epochs at once.

    Parameters
    ----------
    satellite_bias, receiver_bias : BiasFunction
        Biases that are removed. An unknown bias is not removed, and the sample is rejected.
    settings : SlantTecSettings
        Limits of the samples, and their assumed noise.
    arc_settings : ArcSettings
        Limits of the tests for cycle slips.
    pairs : sequence of SignalPair
        Pairs of signals that form links.
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
        self._states = np.zeros((0, _STATE_COLUMNS))
        # The biases of the links that are known, and the hour that they hold for.
        self._bias_of_link: dict[int, tuple[float, ...]] = {}
        self._bias_hour = -1

    @property
    def links(self) -> list[Link]:
        """Links seen so far; the number of a link is its index in this list."""
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
        return self._level_rows(rows, arcs, elevation, rejected, biases)

    def _rejections(self, rows: PairRows, elevation: FloatArray) -> npt.NDArray[np.uint16]:
        """Return the reasons that need neither biases nor levels."""
        settings = self._settings
        reasons = (
            (Rejection.NO_SECOND_SIGNAL, rows.link < 0),
            (Rejection.CODE_INVALID, ~rows.code_valid),
            (Rejection.PHASE_INVALID, ~rows.phase_valid),
            (Rejection.PARITY_UNKNOWN, ~rows.parity_known),
            (Rejection.LOW_CN0, rows.cn0_dbhz < settings.cn0_minimum_dbhz),
            (Rejection.LOW_ELEVATION, elevation < settings.elevation_mask),
            (Rejection.NO_GEOMETRY, np.isnan(elevation)),
        )
        rejected = np.zeros(len(rows), dtype=np.uint16)
        for reason, applies in reasons:
            rejected |= np.where(applies, np.uint16(reason), np.uint16(0))
        return rejected

    def _biases(self, rows: PairRows) -> FloatArray:
        """Return satellite bias and sigma, receiver bias and sigma, TECU, shape (4, n)."""
        hour = rows.time // _BIAS_INTERVAL_NANOSECONDS
        # One integer for each hour and link; rows without a link have the number -1.
        numbers = len(self.links) + 1
        keys, key_of_row = np.unique(hour * numbers + rows.link + 1, return_inverse=True)
        table = np.full((len(keys), 4), np.nan)
        for index, key in enumerate(keys.tolist()):
            hour_of_key, number = divmod(key, numbers)
            if number > 0:
                table[index] = self._look_up_biases(number - 1, hour_of_key)
        return np.asarray(table[key_of_row].T)

    def _look_up_biases(self, number: int, hour: int) -> tuple[float, ...]:
        """Return satellite bias and sigma, receiver bias and sigma of a link in an hour, TECU."""
        if hour != self._bias_hour:
            self._bias_hour = hour
            self._bias_of_link = {}
        if number in self._bias_of_link:
            return self._bias_of_link[number]
        link = self.links[number]
        time = GpsTime(hour * _BIAS_INTERVAL_NANOSECONDS)
        scale = SPEED_OF_LIGHT * link.tecu_per_metre
        delays = (*self._satellite_bias(link, time), *self._receiver_bias(link, time))
        biases = tuple(scale * delay for delay in delays)
        # A satellite bias that is unknown now may come with the next ephemeris.
        if math.isfinite(biases[0]):
            self._bias_of_link[number] = biases
        return biases

    def _level_rows(
        self,
        rows: PairRows,
        arcs: Arcs,
        elevation: FloatArray,
        rejected: npt.NDArray[np.uint16],
        biases: FloatArray,
    ) -> SlantTecRows:
        """Return rows with levelled contents, biases removed."""
        satellite, satellite_sigma, receiver, receiver_sigma = biases
        has_satellite = np.isfinite(satellite)
        rejected = rejected | np.where(
            has_satellite | (rows.link < 0), np.uint16(0), np.uint16(Rejection.NO_SATELLITE_BIAS)
        )
        factor = self._factor(rows)
        self._make_room()
        level, level_sigma, outlier = _level_arcs(
            rows.time,
            rows.link,
            arcs.number,
            # The satellite bias is not in it, so that the level stays right when the bias becomes
            # known within an arc.
            rows.stec_code_tecu - rows.stec_phase_tecu,
            np.sin(elevation),
            (rejected & np.uint16(_NOT_FOR_LEVELLING)) == 0,
            math.sqrt(2.0) * self._settings.pseudorange_sigma * factor,
            self._settings.code_outlier_sigmas,
            self._states,
        )
        rejected |= np.where(outlier, np.uint16(Rejection.CODE_OUTLIER), np.uint16(0))
        unlevelled = np.isnan(level) & (arcs.number > 0)
        rejected |= np.where(unlevelled, np.uint16(Rejection.NOT_LEVELLED), np.uint16(0))
        has_receiver = np.isfinite(receiver)
        lacks_receiver = ~has_receiver & (rows.link >= 0)
        rejected |= np.where(lacks_receiver, np.uint16(Rejection.NO_RECEIVER_BIAS), np.uint16(0))
        # P_second - P_first = STEC / K - c DSB: biases are added to the observed difference.
        removed = np.where(has_satellite, satellite, 0.0) + np.where(has_receiver, receiver, 0.0)
        phase_sigma = math.sqrt(2.0) * self._settings.carrier_phase_sigma * factor
        variance = (
            phase_sigma**2
            + level_sigma**2
            + np.where(has_satellite, satellite_sigma, 0.0) ** 2
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
        for number in np.flatnonzero(np.bincount(rows.link[rows.link >= 0])).tolist():
            table[number] = self.links[number].tecu_per_metre
        return table[rows.link]

    def _make_room(self) -> None:
        """Append states for the links that appear for the first time."""
        missing = len(self.links) - len(self._states)
        if missing > 0:
            self._states = np.concatenate((self._states, np.zeros((missing, _STATE_COLUMNS))))


class ArcLevels:
    """Contents with the levels at the end of the arcs, for offline processing.

    Parameters
    ----------
    rows : SlantTecRows
        All rows of a file.

    Attributes
    ----------
    stec_tecu, stec_sigma_tecu : ndarray, shape (n,)
        Content with the level that the last levelled sample of the arc has, and its sigma, TECU;
        NaN outside arcs and in arcs without a level.
    """

    def __init__(self, rows: SlantTecRows) -> None:
        self.stec_tecu = np.full(len(rows), np.nan)
        self.stec_sigma_tecu = np.full(len(rows), np.nan)
        keys_of_rows = arc_keys(rows.pairs.link, rows.arc)
        levelled = np.flatnonzero(np.isfinite(rows.stec_tecu))
        if not len(levelled):
            return
        # The first occurrence in reversed order is the last row of an arc.
        backwards = levelled[::-1]
        keys, occurrence = np.unique(keys_of_rows[backwards], return_index=True)
        last_row = backwards[occurrence]
        level = rows.stec_tecu[last_row] - rows.stec_phase_tecu[last_row]
        index = np.minimum(np.searchsorted(keys, keys_of_rows), len(keys) - 1)
        has_level = (keys[index] == keys_of_rows) & (rows.arc > 0)
        self.stec_tecu = np.where(has_level, rows.stec_phase_tecu + level[index], np.nan)
        self.stec_sigma_tecu = np.where(has_level, rows.stec_sigma_tecu[last_row][index], np.nan)


# Columns of the state of a link: sums over the samples of its arc, weighted with the squared sine
# of elevation; then the means of whole minutes (blocks).
_ARC, _WEIGHT, _MEAN, _SQUARES, _COUNT = range(5)
_BLOCK, _BLOCK_WEIGHT, _BLOCK_MEAN, _BLOCKS, _BLOCK_SUM, _BLOCK_SQUARES = range(5, 11)
# The first sample of the arc, which is subtracted from all so that squares keep their digits; and
# the number of outliers since the last good sample.
_REFERENCE, _OUTLIERS = range(11, 13)
_STATE_COLUMNS = 13

_BLOCK_NANOSECONDS = 60 * NANOSECONDS_PER_SECOND
_FEWEST_BLOCKS = 4
# The assumed noise counts as much as this many samples against the observed scatter.
_PRIOR_SAMPLES = 20.0
# After more outliers in a row than this, the level is taken to be wrong and begins anew.
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
def _add_sample(state, difference, weight, block):  # type: ignore[no-untyped-def]
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
def _level_arcs(time, link, arc, difference, sine, usable, sigma, outlier_sigmas, states):  # type: ignore[no-untyped-def]
    """Return level and sigma of the arc of each row, NaN without a level, and the outliers.

    `difference` is code content minus phase content, TECU; `states` of the links are updated.
    """
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
                _add_sample(state, difference[row] - state[_REFERENCE], weight, block)
        if state[_COUNT] > 0.0:
            level[row] = state[_REFERENCE] + state[_MEAN]
            level_sigma[row] = np.sqrt(_level_variance(state, sigma[row]))
    return level, level_sigma, outlier

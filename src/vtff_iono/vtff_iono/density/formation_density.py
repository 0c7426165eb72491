"""Electron density between two spacecraft, second by second, from phases and integers.

Relative navigation fixes integers of double differences. They are held while the phases are
continuous (`vtff_iono.density.integer_datum`), found again from the satellites that have integers
(`vtff_iono.density.integer_resolution`), and judged each second: all satellites must agree on one
density. Integers that are found tell the densities of the seconds before, if their signals went on.
"""

from __future__ import annotations

import functools
import math
import statistics
from collections import deque
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SPEED_OF_LIGHT
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.signals import SignalKey, carrier_frequency_hz
from vtff_iono.density.common_samples import NO_LINK, CommonSamples, common_samples
from vtff_iono.density.constant_check import ConstantCheck
from vtff_iono.density.differential_tec import (
    SecondAverage,
    SecondMeans,
    differential_stec,
    horizontal_sigma,
)
from vtff_iono.density.electron_density import (
    DensityEpoch,
    DensitySettings,
    ElectronDensityEstimator,
)
from vtff_iono.density.integer_datum import IntegerDatum
from vtff_iono.density.integer_resolution import FloatingContent, IntegerResolver
from vtff_iono.density.phase_differences import (
    DEVIATION,
    DEVIATION_SQUARED,
    ELEVATION_CHIEF,
    ELEVATION_DEPUTY,
    GEOMETRIC,
    STEC,
    STEP_SQUARED,
    WIDE_LANE,
    ReceiverSamples,
    phase_differences,
)
from vtff_iono.density.phase_stretches import LinkSignals, PhaseStretch, PhaseStretches
from vtff_iono.density.signal_continuity import SignalContinuity
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.formation_second import PairSecond, Track
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftResult

__all__ = ["DensityResult", "FormationDensity"]

IntArray = npt.NDArray[np.int64]

_FEWEST_SAMPLES = 2
# Smallest elevation of the satellites that show the vertical content above the chief, rad.
_VTEC_ELEVATION = math.radians(40.0)
# A scatter that exceeds the variance of the noise by this factor is scintillation.
_LARGE_SCATTER = 2.0
# Variance of the mean of a second over the scatter within it. Of fades that last half a second a
# third of the variance shows as scatter, the rest is in the mean; of faster fades little is in the
# mean. It is measured by the changes from second to second; at first it is that of fades of half a
# second, which counts as so many seconds of satellites.
_FIRST_MEAN_OVER_SCATTER, _FIRST_WEIGHT = 2.0, 20.0
_SMALLEST_RATIO, _LARGEST_RATIO = 0.05, 10.0
# A change counts at most as this many times its expected variance: a wrong integer is no fade.
_LARGEST_CHANGE = 16.0
# The same for a change from one second to the next, which has a single degree of freedom.
_LARGE_CHANGE = 9.0
# Noise is at least this fraction of the variance that the settings tell.
_LEAST_NOISE = 0.1
_SCATTER_MEMORY = 15.0  # seconds
# Fluctuations have ended when in so many seconds the fluctuation of so many satellite-seconds or
# more is below the remembered one by more than this factor: one fade ends by chance, not all.
_SECONDS_OF_END, _FEWEST_OF_END, _MARGIN_OF_END = 3, 9, 4.0
_SATELLITES = 5.0  # that fluctuate at once, as a rule
# The integers of a satellite are wrong when its content (see `DensitySettings.outlier_sigmas`) or
# its wide lane is off by more than this for `_MOST_DOUBTS` seconds in a row.
_WRONG_WIDE_LANE_SIGMAS = 5.0
_WRONG_WIDE_LANE = 0.5  # cycles
_MOST_DOUBTS = 3
# Integers are proved right after this many seconds of agreement. The density rests on proved
# integers only as soon as this many satellites have them.
_SECONDS_OF_PROOF = 3
_ENOUGH_PROVED = 4
# s; for which integers of relative navigation are left aside that nothing connects with the
# constant.
_PATIENCE = 10
# Relative navigation is less sure than it says by this factor: in fades phases bend by more than
# it expects of them.
_NAVIGATION_FACTOR = 3.0
# TECU; sigma of how far all contents may be off together where others are judged.
_ANY_SHIFT = 100.0
# Seconds before and after a late one whose fluctuation is that of this one too.
_AROUND = 5
# Most seconds without a density for which integers that are found later are used.
_LONGEST_WAIT = 30
# Fewest links with integers whose density is believed where integers of others are looked for: one
# may have slipped unseen.
_FEWEST_WITNESSES = 2


@dataclass(frozen=True, eq=False)
class DensityResult:
    """The density of one second.

    Parameters
    ----------
    time : int
        Mean time of the samples, GPS time, ns since 1980-01-06.
    position_itrf : ndarray, shape (3,)
        Middle between the two spacecraft, m.
    system, prn : ndarray of int, shape (n,)
        Satellites of the rows of `epoch`.
    epoch : DensityEpoch
    datum : int
        Number of the datum of the integers: with another one the constant of all satellites is a
        new one, and so is the error that it makes.
    is_late : bool
        Whether it is the density of a second before the last one, whose integers were not known
        then.
    """

    time: int
    position_itrf: FloatArray
    system: npt.NDArray[np.int64]
    prn: npt.NDArray[np.int64]
    epoch: DensityEpoch
    datum: int
    is_late: bool = False


@dataclass(frozen=True, eq=False)
class _LinkMeans:
    """Means of one second of n links, each with its stretch.

    Parameters
    ----------
    stretches : list of PhaseStretch
    samples : ndarray of int, shape (n,)
        Number of samples of each mean.
    columns : ndarray, shape (8, n)
        Means of the columns of `phase_differences`. Deviations are from the first sample of a
        stretch: without integers contents are so large that their own squares have lost what they
        scatter by.
    least_noise : float
        Smallest variance of the white noise of a sample, TECU^2.
    """

    stretches: list[PhaseStretch]
    samples: IntArray
    columns: FloatArray
    least_noise: float

    @property
    def stec(self) -> FloatArray:
        """Differential TEC, TECU, shape (n,)."""
        return np.asarray(self.columns[STEC])

    @property
    def wide_lane(self) -> FloatArray:
        """Wide lane of the single difference less its integers, cycles, shape (n,)."""
        return np.asarray(self.columns[WIDE_LANE])

    @property
    def geometric(self) -> FloatArray:
        """Wide lane of the phases less that of the ranges, less its integers, cycles, (n,)."""
        return np.asarray(self.columns[GEOMETRIC])

    @property
    def elevation_chief(self) -> FloatArray:
        """Elevations at the chief, rad, shape (n,)."""
        return np.asarray(self.columns[ELEVATION_CHIEF])

    @property
    def elevation_deputy(self) -> FloatArray:
        """Elevations at the deputy, rad, shape (n,)."""
        return np.asarray(self.columns[ELEVATION_DEPUTY])

    def select(self, chosen: npt.NDArray[np.bool_]) -> _LinkMeans:
        """Return the chosen links."""
        rows = np.flatnonzero(chosen)
        if len(rows) == len(chosen):
            return self
        return _LinkMeans(
            [self.stretches[row] for row in rows.tolist()],
            self.samples[rows],
            self.columns.take(rows, axis=1),
            self.least_noise,
        )

    @functools.cached_property
    def prns(self) -> list[int]:
        """Numbers of the satellites."""
        return [stretch.signals.prn for stretch in self.stretches]

    @functools.cached_property
    def step_variance(self) -> FloatArray:
        """Variance that the changes from sample to sample show, TECU^2, shape (n,)."""
        return np.asarray(0.5 * self.columns[STEP_SQUARED])

    @functools.cached_property
    def scatter(self) -> FloatArray:
        """Variance of the contents within the second, TECU^2, shape (n,)."""
        return np.asarray(self.columns[DEVIATION_SQUARED] - self.columns[DEVIATION] ** 2)

    @functools.cached_property
    def white_noise(self) -> FloatArray:
        """Variance of the white noise of a sample, TECU^2, shape (n,)."""
        return np.maximum(self.step_variance, self.least_noise)

    @functools.cached_property
    def excess(self) -> FloatArray:
        """Variance that the samples have beside white noise, TECU^2, shape (n,)."""
        is_large = self.scatter > _LARGE_SCATTER * self.white_noise
        return np.where(is_large, self.scatter - self.white_noise, 0.0)

    @functools.cached_property
    def has_integers(self) -> npt.NDArray[np.bool_]:
        """Which links have integers of both signals, shape (n,)."""
        return np.array([stretch.has_integers for stretch in self.stretches], dtype=bool)

    def with_integers(self, row: int, integers: tuple[float, float], content: float) -> _LinkMeans:
        """Return the means with the integers of one link, whose content (TECU) is removed."""
        stretches = list(self.stretches)
        stretches[row] = replace(stretches[row], integers=integers)
        is_row = np.arange(len(stretches)) == row
        wide_lane = np.where(is_row, integers[0] - integers[1], 0.0)
        columns = self.columns.copy()
        columns[STEC] -= np.where(is_row, content, 0.0)
        columns[WIDE_LANE] -= wide_lane
        columns[GEOMETRIC] -= wide_lane
        return _LinkMeans(stretches, self.samples, columns, self.least_noise)


@dataclass(frozen=True, eq=False)
class _Second:
    """A second: mean time, GPS time, ns, geometry, and contents.

    `doubt` is the factor by which geometry has shown the contents to fluctuate more than they seem
    to; `horizontal_sigma` as in `ElectronDensityEstimator.update`, TECU.
    """

    time: int
    altitudes: tuple[float, float]
    position_itrf: FloatArray
    means: _LinkMeans
    doubt: FloatArray
    horizontal_sigma: float


class FormationDensity:
    """Electron density between two spacecraft from their phases and the integers between them.

    Parameters
    ----------
    settings : DensitySettings
    bands : tuple of int
        RINEX frequency digits of the GPS signals.
    carrier_phase_sigma : float
        Noise of one carrier phase of one receiver at the full rate, m.
    """

    def __init__(
        self, settings: DensitySettings, bands: tuple[int, int], carrier_phase_sigma: float
    ) -> None:
        self._bands = bands
        self._datum = IntegerDatum()
        self._datum_number = 0
        self._signals = tuple(SignalContinuity(SYSTEM_GPS, bands) for _ in range(2))
        # Which phases both receivers have continuously, by signal, and by receiver.
        self._continuity: dict[SignalKey, tuple[int, int]] = {}
        self._continuity_of_both: tuple[dict[SignalKey, int], ...] = ()
        self._stretches = PhaseStretches()
        # Links of the density bands, numbered in the order in which either receiver has seen them,
        # and for each receiver these numbers by its own numbers of links.
        self._links: dict[LinkSignals, int] = {}
        self._link_numbers: tuple[IntArray, IntArray] = (np.zeros(0, np.int64),) * 2
        # Arcs at the end of the last second that had others than the one before: last arcs by link
        # of both receivers, and those of links that both have.
        self._last_arcs = np.zeros((2, 0), dtype=np.int64)
        self._arcs: dict[LinkSignals, tuple[int, int]] = {}
        # What stretches rest on, the stretches that links have now, and of these by number of the
        # link: number, integers, and content of the first sample, TECU.
        self._rest_on: tuple[object, ...] = ()
        self._current: dict[LinkSignals, PhaseStretch] = {}
        self._stretch_of_link = np.zeros(0, dtype=np.int64)
        self._integers_of_link = np.zeros((0, 2))
        self._origin_of_link = np.zeros(0)
        self._average = SecondAverage(_FEWEST_SAMPLES)
        self._settings = settings
        self._estimator = ElectronDensityEstimator(settings)
        frequencies = carrier_frequency_hz([SYSTEM_GPS] * 2, bands)
        self._frequencies = (float(frequencies[0]), float(frequencies[1]))
        self._wide_lanes_per_metre = (self._frequencies[0] - self._frequencies[1]) / SPEED_OF_LIGHT
        self._wavelengths = tuple(SPEED_OF_LIGHT / frequency for frequency in self._frequencies)
        self._tecu_per_metre = tecu_per_metre(*self._frequencies)
        # Sigma of the relative position in the second that is under way, in wide lanes.
        self._relative_sigma_cycles = math.inf
        # What relative navigation has fixed in that second.
        self._offered: Mapping[SignalKey, float] = {}
        # Sigma of the difference of two receivers and two signals at one epoch, TECU.
        sample_sigma = 2.0 * carrier_phase_sigma * self._tecu_per_metre
        self._least_noise = _LEAST_NOISE * sample_sigma**2
        # Variance that scintillation adds to the samples of each satellite, TECU^2, by PRN.
        self._excess: dict[int, float] = {}
        # What each of the last seconds alone shows of that variance.
        self._recent_excess: deque[dict[int, float]] = deque(maxlen=_SECONDS_OF_END)
        # Variances of means, and scatters, whose ratio says how long fades last: sums of late.
        self._of_means = _FIRST_MEAN_OVER_SCATTER * _FIRST_WEIGHT
        self._of_scatter = _FIRST_WEIGHT
        # Content of each satellite less the predicted one a second ago, TECU, by the number and the
        # integers of its stretch.
        self._last_errors: dict[tuple[int, tuple[float | None, float | None]], float] = {}
        # The same of satellites with integers, by PRN.
        self._last_fixed: dict[int, float] = {}
        # Seconds in a row for which the integers of a satellite were wrong, by PRN.
        self._doubts: dict[int, int] = {}
        self._resolver = IntegerResolver(*self._frequencies)
        self._seconds_unconnected = 0
        # Whether codes allow the integers that relative navigation had in the last second.
        self._is_offer_possible = True
        self._constant_check = ConstantCheck(self._content_of(1.0, 1.0))
        # How often the constant of integers that were found again has proved to be another one.
        self._shifts = 0
        # Seconds since the last density.
        self._without_density: deque[_Second] = deque(maxlen=_LONGEST_WAIT)

    def update(
        self,
        second: PairSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        links: tuple[Sequence[Link], Sequence[Link]],
        tracks: tuple[Track, Track],
    ) -> list[DensityResult]:
        """Process the next second and return the densities of the seconds that have ended.

        Densities of earlier seconds come first, once integers that were found since tell them.

        Parameters
        ----------
        second : PairSecond
        results : tuple of SpacecraftResult
            Results of chief and deputy for the second.
        links : tuple of sequence of Link
            All links of chief and deputy so far.
        tracks : tuple of Track
            Motion of chief and deputy.
        """
        chief, deputy = (
            self._with_new_links(numbers, of_craft)
            for numbers, of_craft in zip(self._link_numbers, links, strict=True)
        )
        self._link_numbers = (chief, deputy)
        rows = (results[0].rows, results[1].rows)
        samples, last_arcs = common_samples(rows, self._link_numbers)
        self._find_stretches(second, results, last_arcs)
        time, number, columns = self._differences(second, results, samples)
        sigma = _NAVIGATION_FACTOR * second.relative_sigma
        self._relative_sigma_cycles = self._wide_lanes_per_metre * sigma
        self._offered = second.integers
        densities = []
        ended = list(self._average.update(time, number, columns))
        for means in ended:
            densities += self._density_of_second(means, tracks, results[0])
        if ended:
            # Rows that wait for the end of their second are rows of this update.
            self._stretches.forget_ended(number.tolist())
            self._resolver.keep_only(self._stretches.numbers())
        return densities

    # ---- links and stretches -----------------------------------------------------------------

    def _with_new_links(self, numbers: IntArray, links: Sequence[Link]) -> IntArray:
        """Return the numbers of all links of a receiver from those of its first ones."""
        if len(numbers) == len(links):
            return numbers
        new = [self._number_of_link(link) for link in links[len(numbers) :]]
        return np.array([*numbers.tolist(), *new], dtype=np.int64)

    def _number_of_link(self, link: Link) -> int:
        """Return the number of a link of the density bands, `NO_LINK` for another link."""
        bands = (link.band_first, link.band_second)
        if link.system != SYSTEM_GPS or bands != self._bands:
            return NO_LINK
        signals = LinkSignals(
            SignalKey(SYSTEM_GPS, link.prn, link.band_first, ord(link.attribute_first)),
            SignalKey(SYSTEM_GPS, link.prn, link.band_second, ord(link.attribute_second)),
        )
        return self._links.setdefault(signals, len(self._links))

    def _take_last_arcs(self, last_arcs: IntArray) -> None:
        """Take the arcs of the links that both spacecraft have at the end of the second.

        `last_arcs` are those of `common_samples`.
        """
        if np.array_equal(last_arcs, self._last_arcs):
            return
        self._last_arcs = last_arcs
        links = list(self._links)
        numbers = np.flatnonzero((last_arcs > 0).all(axis=0)).tolist()
        chief, deputy = last_arcs.tolist()
        arcs = {links[number]: (chief[number], deputy[number]) for number in numbers}
        self._arcs = dict(sorted(arcs.items()))

    def _find_stretches(
        self,
        second: PairSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        last_arcs: IntArray,
    ) -> None:
        """Find the stretch of each link: its arcs and the integers that hold now."""
        chief, deputy = (
            signals.update(block, result.rows)
            for signals, block, result in zip(
                self._signals, second.observations, results, strict=True
            )
        )
        if self._continuity_of_both != (chief, deputy):
            self._continuity_of_both = (chief, deputy)
            self._continuity = {
                signal: (chief[signal], deputy[signal]) for signal in chief if signal in deputy
            }
        integers = self._datum.update(second.integers, self._continuity, self._may_begin_anew())
        self._take_last_arcs(last_arcs)
        self._count_unconnected(self._arcs, integers, second.integers)
        # As a rule nothing has changed since the second before: the same stretches go on.
        rest_on = (self._arcs, integers, self._continuity, len(self._links))
        if rest_on == self._rest_on:
            return
        self._rest_on = rest_on
        self._current = self._stretches.continue_or_begin(self._arcs, integers, self._continuity)
        self._stretch_of_link = np.full(len(self._links), -1, dtype=np.int64)
        self._integers_of_link = np.zeros((len(self._links), 2))
        self._origin_of_link = np.zeros(len(self._links))
        for signals, stretch in self._current.items():
            number = self._links[signals]
            self._stretch_of_link[number] = stretch.number
            self._origin_of_link[number] = stretch.origin
            if stretch.has_integers:
                self._integers_of_link[number] = stretch.integers

    def _may_begin_anew(self) -> bool:
        """Return whether the constant of all satellites may be given up for a new one.

        While it is known, integers are found in its datum again, unless that fails for long though
        relative navigation has integers enough, which the codes allow: behind long fades it may be
        metres off, and its integers are then as wrong.
        """
        is_lost = self._seconds_unconnected >= _PATIENCE and self._is_offer_possible
        return not self._estimator.is_bias_known or is_lost

    def _count_unconnected(
        self,
        links: Collection[LinkSignals],
        held: Mapping[SignalKey, float],
        fixed: Mapping[SignalKey, float],
    ) -> None:
        """Count the seconds in which only relative navigation has integers, and of many links."""
        if any(signal in held and other in held for signal, other in links):
            self._seconds_unconnected = 0
            return
        offered = sum(signal in fixed and other in fixed for signal, other in links)
        is_unconnected = offered >= _ENOUGH_PROVED
        self._seconds_unconnected = self._seconds_unconnected + 1 if is_unconnected else 0

    def _differences(
        self,
        second: PairSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        samples: CommonSamples,
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return times, stretches and `phase_differences` of what both spacecraft have observed."""
        is_begun = np.isfinite(self._origin_of_link).all()
        chief, deputy = (
            ReceiverSamples(
                block.columns["carrier_phase_cycles"],
                result.range,
                result.rows.pairs.row_first,
                result.rows.pairs.row_second,
                result.rows.pairs.wide_lane_cycles,
                result.rows.elevation,
            )
            for block, result in zip(second.observations, results, strict=True)
        )
        differences: FloatArray = phase_differences(
            samples.link,
            samples.chief,
            samples.deputy,
            chief,
            deputy,
            self._integers_of_link,
            self._origin_of_link,
            *self._wavelengths,
            self._tecu_per_metre,
            self._wide_lanes_per_metre,
        )
        if not is_begun:
            for signals, stretch in self._current.items():
                stretch.origin = float(self._origin_of_link[self._links[signals]])
        time = results[0].rows.pairs.time[samples.chief]
        return time, self._stretch_of_link[samples.link], differences

    # ---- density of a second -----------------------------------------------------------------

    def _density_of_second(
        self, averages: SecondMeans, tracks: tuple[Track, Track], chief: SpacecraftResult
    ) -> list[DensityResult]:
        """Return the density of a second from the means of its links, late ones before it.

        There is none without integers.
        """
        time = round(averages.time)
        when, positions = np.array([time]), np.empty((2, 3))
        for craft, track in enumerate(tracks):
            positions[craft] = track.positions(when)[0]
        if not np.isfinite(positions).all():
            return []
        geodetic = geodetic_from_itrf(positions)
        altitude_chief, altitude_deputy = geodetic[:, 2].tolist()
        if self._datum.number != self._datum_number:
            self._datum_number = self._datum.number
            self._estimator.reset_bias()
            self._constant_check.forget()
            self._resolver.reset()
            self._without_density.clear()
        seconds = time / NANOSECONDS_PER_SECOND
        stretches = [self._stretches[number] for number in averages.number.tolist()]
        means = _LinkMeans(stretches, averages.samples, averages.columns, self._least_noise)
        # A satellite without an orbit has phases, and maybe integers, but no content is predicted.
        means = means.select(np.isfinite(means.elevation_chief + means.elevation_deputy))
        sigma_of_all = self._sigma(means)
        seeming_sigma = sigma_of_all.copy()
        self._doubt_against_geometry(means, sigma_of_all)
        altitudes = (altitude_chief, altitude_deputy)
        horizontal_sigma = self._horizontal_sigma(chief, positions, geodetic[0])
        now = _Second(
            time,
            altitudes,
            0.5 * (positions[0] + positions[1]),
            means,
            sigma_of_all / seeming_sigma,
            horizontal_sigma,
        )
        had_integers = means.has_integers
        if not had_integers.any() and self._estimator.is_bias_known:
            self._constant_check.lose(self._estimator)
        means = self._resolve_integers(seconds, altitudes, means, sigma_of_all)
        has_integers = means.has_integers
        fixed = means.select(has_integers)
        satellites = fixed.prns
        sigma = sigma_of_all[has_integers]
        proved = [self._is_proved(stretch) for stretch in fixed.stretches]
        if not all(proved) and sum(proved) >= _ENOUGH_PROVED:
            sigma[~np.array(proved)] = np.nan
        constant = self._constant_check.compare(
            seconds,
            altitudes,
            fixed.elevation_chief,
            fixed.elevation_deputy,
            fixed.stec,
            sigma,
            satellites,
        )
        if constant.estimator is not None:
            self._estimator = constant.estimator
            self._shifts += 1
        if not constant.may_use:
            sigma[:] = np.nan
        epoch = self._estimator.update(
            seconds,
            altitude_chief,
            altitude_deputy,
            fixed.elevation_chief,
            fixed.elevation_deputy,
            fixed.stec,
            sigma,
            *_vertical_content(chief),
            satellites,
            horizontal_sigma,
            had_integers[has_integers],
            constant.spread_tecu,
        )
        self._constant_check.pass_second(seconds, math.isfinite(epoch.density))
        if math.isfinite(epoch.slow_time):
            predicted, covariance = self._predict(seconds, altitudes, means)
            error = means.stec - predicted
            spread = np.sqrt(np.diag(covariance)[has_integers])
            self._examine_integers(fixed, error[has_integers], spread, sigma, epoch.is_outlier)
            self._measure_fades(fixed, error[has_integers], sigma)
            self._add_changes(means, error)
        late: list[DensityResult] = []
        if math.isfinite(epoch.density):
            if self._without_density:
                late = self._late_densities(now, fixed.select(~epoch.is_outlier))
                self._without_density.clear()
        else:
            self._without_density.append(now)
        if not has_integers.any():
            return []
        return [*late, self._result(now, satellites, epoch)]

    def _result(
        self, second: _Second, satellites: list[int], epoch: DensityEpoch, is_late: bool = False
    ) -> DensityResult:
        return DensityResult(
            time=second.time,
            position_itrf=second.position_itrf,
            system=np.full(len(satellites), SYSTEM_GPS),
            prn=np.array(satellites, dtype=np.int64),
            epoch=epoch,
            datum=self._datum_number + self._shifts,
            is_late=is_late,
        )

    def _late_densities(self, now: _Second, fixed: _LinkMeans) -> list[DensityResult]:
        """Return the densities of the seconds without one that the links with integers now tell.

        An integer holds for as long as its signal goes on, backwards too: what has been found now
        was right before.
        """
        integers_now = {
            (stretch.signals, stretch.continuity): stretch.integers
            for stretch in fixed.stretches
            if None not in stretch.continuity
        }
        late = []
        excesses = [
            {
                stretch.signals.prn: excess
                for stretch, excess in zip(
                    second.means.stretches,
                    second.means.excess.tolist(),
                    strict=True,
                )
            }
            for second in (*self._without_density, now)
        ]
        for number, second in enumerate(self._without_density):
            rows, removed = [], []
            for row, stretch in enumerate(second.means.stretches):
                integers = integers_now.get((stretch.signals, stretch.continuity))
                if integers is None:
                    continue
                rows.append(row)
                removed.append(self._content_of(*integers) - self._content_of(*stretch.integers))
            # The seconds before and after show how much contents fluctuate.
            around = excesses[max(number - _AROUND, 0) : number + _AROUND + 1]
            sigma = self._sigma_among(second, around)
            satellites = [second.means.stretches[row].signals.prn for row in rows]
            epoch = self._estimator.past_density(
                (now.time - second.time) / NANOSECONDS_PER_SECOND,
                *second.altitudes,
                second.means.elevation_chief[rows],
                second.means.elevation_deputy[rows],
                second.means.stec[rows] - np.array(removed),
                sigma[rows],
                satellites,
                second.horizontal_sigma,
            )
            if math.isfinite(epoch.density):
                late.append(self._result(second, satellites, epoch, is_late=True))
        return late

    def _sigma_among(self, second: _Second, excesses: list[dict[int, float]]) -> FloatArray:
        """Return the sigma of mean contents of a second, TECU.

        `excesses` are what samples of the seconds around it scatter by beside their noise, by PRN.
        """
        excess = second.means.excess.copy()
        for row, stretch in enumerate(second.means.stretches):
            prn = stretch.signals.prn
            near = [of_second[prn] for of_second in excesses if prn in of_second]
            excess[row] = max(excess[row], statistics.fmean(near))
        white = second.means.white_noise / second.means.samples
        variance = white + excess * self._mean_over_scatter
        return np.asarray(second.doubt * np.sqrt(variance))

    def _predict(
        self, seconds: float, altitudes: tuple[float, float], means: _LinkMeans
    ) -> tuple[FloatArray, FloatArray]:
        """Return the contents that are predicted of links, TECU, and their covariance."""
        return self._estimator.predicted_stec(
            seconds,
            *altitudes,
            means.elevation_chief,
            means.elevation_deputy,
            means.prns,
        )

    def _is_proved(self, stretch: PhaseStretch) -> bool:
        first, second = stretch.signals
        return self._datum.is_proved(first) and self._datum.is_proved(second)

    def _sigma(self, means: _LinkMeans) -> FloatArray:
        """Return the sigma of mean contents: white noise, and what scintillation adds to it.

        Both are measured: the changes from sample to sample show the white noise (von Neumann
        1941), the rest of the scatter is a slow fluctuation.
        """
        # One second alone may be quiet by chance, so that the seconds before it count too.
        of_second: dict[int, float] = {}
        for prn, value in zip(means.prns, means.excess.tolist(), strict=True):
            mean = self._excess.get(prn, value)
            self._excess[prn] = mean + (value - mean) / _SCATTER_MEMORY
            of_second[prn] = value
        self._recent_excess.append(of_second)
        left = self._fluctuation_left()
        remembered = [left * self._excess[prn] for prn in means.prns]
        excess = np.maximum(means.excess, remembered)
        return np.sqrt(means.white_noise / means.samples + excess * self._mean_over_scatter)

    def _fluctuation_left(self) -> float:
        """Return the part of the remembered fluctuation that there may still be."""
        pairs = [
            (value, self._excess[prn])
            for of_second in self._recent_excess
            for prn, value in of_second.items()
            if self._excess[prn] > 0.0
        ]
        if len(pairs) < _FEWEST_OF_END or len(self._recent_excess) < _SECONDS_OF_END:
            return 1.0
        ratio = statistics.fmean(value / remembered for value, remembered in pairs)
        return min(1.0, _MARGIN_OF_END * ratio)

    @property
    def _mean_over_scatter(self) -> float:
        ratio = self._of_means / max(self._of_scatter, 1e-12)
        return min(max(ratio, _SMALLEST_RATIO), _LARGEST_RATIO)

    def _measure_fades(self, means: _LinkMeans, errors: FloatArray, sigma: FloatArray) -> None:
        """Measure how much of the fluctuation of a second is in its mean, and how much within it.

        `errors` are contents of links with integers less the predicted ones, `sigma` their own
        sigmas, TECU.
        """
        noise, scatter = means.step_variance, means.scatter
        now = dict(zip(means.prns, errors.tolist(), strict=True))
        # All errors of a second share the density that is estimated from them.
        share = max(len(now) - 1, 1) / max(len(now), 1)
        of_means, of_scatter, count = 0.0, 0.0, 0
        for row, (prn, error) in enumerate(now.items()):
            if prn not in self._last_fixed or scatter[row] <= _LARGE_SCATTER * noise[row]:
                continue
            change = 0.5 * (error - self._last_fixed[prn]) ** 2 / share
            # Neither a satellite without an orbit nor one that is not used tells anything.
            if not math.isfinite(change + sigma[row]):
                continue
            change = min(change, _LARGEST_CHANGE * float(sigma[row]) ** 2)
            weight = float(sigma[row]) ** -2
            of_means += weight * (change - float(noise[row]) / float(means.samples[row]))
            of_scatter += weight * float(scatter[row] - noise[row])
            count += 1
        self._last_fixed = now
        if count and of_scatter > 0.0:
            kept = math.exp(-count / (_SCATTER_MEMORY * _SATELLITES))
            self._of_means = kept * self._of_means + count * of_means / of_scatter
            self._of_scatter = kept * self._of_scatter + count

    def _add_changes(self, means: _LinkMeans, errors: FloatArray) -> None:
        """Let changes from second to second count as fluctuation where they exceed the noise.

        Fades that last for seconds hardly show in the scatter of one.
        """
        noise = means.step_variance / means.samples
        keys = [(stretch.number, stretch.integers) for stretch in means.stretches]
        errors_now = dict(zip(keys, errors.tolist(), strict=True))
        for key, stretch, variance in zip(keys, means.stretches, noise.tolist(), strict=True):
            last = self._last_errors.get(key)
            prn = stretch.signals.prn
            if last is None or prn not in self._excess:
                continue
            change = 0.5 * (errors_now[key] - last) ** 2
            if change > _LARGE_CHANGE * max(variance, self._least_noise):
                mean = self._excess[prn]
                self._excess[prn] = max(mean, mean + (change - mean) / _SCATTER_MEMORY)
                of_second = self._recent_excess[-1]
                of_second[prn] = max(of_second.get(prn, 0.0), change)
        self._last_errors = errors_now

    # ---- integers ----------------------------------------------------------------------------

    def _examine_integers(
        self,
        fixed: _LinkMeans,
        errors: FloatArray,
        spread: FloatArray,
        sigma: FloatArray,
        is_outlier: npt.NDArray[np.bool_],
    ) -> None:
        """Count for each link with integers whether its content agrees with the others.

        `errors` are measured less predicted differential contents, `spread` and `sigma` the sigmas
        of predictions and measurements, TECU.
        """
        settings = self._settings
        wide_lanes, samples = fixed.wide_lane.tolist(), fixed.samples.tolist()
        error_sigma = np.hypot(spread, sigma)
        fluctuates = fixed.excess > 0.0
        steps = still_right = 0
        largest = np.maximum(settings.outlier_sigmas * error_sigma, settings.outlier_tecu)
        is_off = np.abs(errors) > largest
        is_off |= self._contradicts_geometry(fixed, is_off | is_outlier, sigma)
        for row, (stretch, off) in enumerate(
            zip(fixed.stretches, (is_off | is_outlier).tolist(), strict=True)
        ):
            wide_lane_error = self._resolver.wide_lane_error(wide_lanes[row])
            is_wrong = off or abs(wide_lane_error) > max(
                _WRONG_WIDE_LANE, _WRONG_WIDE_LANE_SIGMAS * self._resolver.wide_lane_sigma
            )
            steps += self._judge(stretch, is_wrong)
            still_right += bool(fluctuates[row]) and not is_wrong and stretch.has_proved
            if not is_wrong:
                self._resolver.add_resolved(wide_lanes[row], samples[row])
        self._constant_check.add_steps(steps, still_right)

    def _contradicts_geometry(
        self, fixed: _LinkMeans, is_off: npt.NDArray[np.bool_], sigma: FloatArray
    ) -> npt.NDArray[np.bool_]:
        """Return which links have integers whose wide lane relative navigation contradicts, (n,).

        The links that agree show how well it knows them. Arguments as in `_examine_integers`.
        """
        contradicts = np.zeros(len(sigma), dtype=bool)
        wide_lanes, sigmas = self._geometric_errors(fixed).tolist(), sigma.tolist()
        known = [
            row
            for row, (value, off) in enumerate(zip(wide_lanes, is_off.tolist(), strict=True))
            if not off and math.isfinite(value + sigmas[row] + self._relative_sigma_cycles)
        ]
        if len(known) < _FEWEST_WITNESSES:
            return contradicts
        # The median is right while most are.
        clock = statistics.median([wide_lanes[row] for row in known])
        errors = []
        for row in known:
            error = wide_lanes[row] - clock
            variance = self._resolver.geometric_variance(sigmas[row], self._relative_sigma_cycles)
            limit = max(_WRONG_WIDE_LANE_SIGMAS * math.sqrt(variance), _WRONG_WIDE_LANE)
            contradicts[row] = abs(error) > limit
            if not contradicts[row]:
                errors.append((error, sigmas[row]))
        self._resolver.add_geometric(errors)
        return contradicts

    def _horizontal_sigma(
        self, chief: SpacecraftResult, positions: FloatArray, geodetic_chief: FloatArray
    ) -> float:
        """Return the sigma of what the vertical contents at two positions differ by, TECU.

        `positions` have shape (2, 3), m; `geodetic_chief` as in `horizontal_sigma`.
        """
        gradient = np.full(2, math.nan) if chief.epoch is None else chief.epoch.gradient_sigma
        if not np.isfinite(gradient).all():
            per_deg = self._settings.gradient_sigma_tecu_per_deg
            gradient = np.full(2, math.degrees(per_deg / float(np.linalg.norm(positions[0]))))
        return horizontal_sigma(gradient, positions[0], positions[1], geodetic_chief)

    def _resolve_integers(
        self,
        seconds: float,
        altitudes: tuple[float, float],
        means: _LinkMeans,
        sigma: FloatArray,
    ) -> _LinkMeans:
        """Return the means of links, those whose integers are found beside others with them.

        Contents are predicted from the constant, from the level that each satellite had before, and
        from the links that have integers. `sigma` are those of the means, TECU.
        """
        has_integers = means.has_integers
        is_predicted = self._estimator.is_bias_known or (
            self._estimator.has_bias and has_integers.any()
        )
        if has_integers.all() or not is_predicted:
            return means
        predicted, covariance = self._predict(seconds, altitudes, means)
        errors = means.stec - predicted
        known = has_integers & np.isfinite(sigma)
        of_known = covariance[np.ix_(known, known)] + np.diag(sigma[known] ** 2)
        agree = ~self._estimator.find_outliers(errors[known], of_known)
        if np.count_nonzero(agree) < _FEWEST_WITNESSES:
            agree[:] = False
        rows, of_known = np.flatnonzero(known)[agree], of_known[np.ix_(agree, agree)]
        # What the links with integers tell of the others.
        floating = np.flatnonzero(~has_integers)
        gain = np.linalg.solve(of_known, covariance[np.ix_(rows, floating)]).T
        learned = gain @ errors[rows]
        excess = errors[floating] - learned
        clock, clock_variance = self._clock(means, rows, sigma)
        geometric = means.geometric[floating] - clock
        geometric -= self._resolver.cycles_per_tecu * (predicted[floating] + learned)
        contents = [
            FloatingContent(
                means.stretches[row].number,
                float(means.wide_lane[row]),
                int(means.samples[row]),
                float(excess[place]),
                float(sigma[row]),
                means.stretches[row].integers,
                float(geometric[place]),
            )
            for place, row in enumerate(floating.tolist())
        ]
        spread = covariance[np.ix_(floating, floating)] - gain @ covariance[np.ix_(rows, floating)]
        found = self._resolver.resolve(
            contents, spread, len(rows) > 0, clock_variance, self._relative_sigma_cycles
        )
        if not has_integers.any():
            stretches = [means.stretches[row] for row in floating]
            found |= self._connect(stretches, contents, spread)
            self._is_offer_possible = self._resolver.agree_with_codes(
                {
                    stretch.number: offered[0] - offered[1]
                    for stretch, offered in zip(stretches, map(self._offer, stretches), strict=True)
                    if math.isfinite(sum(offered))
                }
            )
        result = means
        for row in floating.tolist():
            stretch = means.stretches[row]
            if stretch.number not in found:
                continue
            integers = found[stretch.number]
            # Without a witness the contents of this second have chosen the integers: they do not
            # check them. Those of the next second do.
            if len(rows):
                result = result.with_integers(row, integers, self._content_of(*integers))
            for signal, cycles, continuity in zip(
                stretch.signals, integers, stretch.continuity, strict=True
            ):
                # A stretch may have ended while its last second was averaged.
                if continuity is not None and self._continuity.get(signal) == continuity:
                    self._datum.resolve(signal, cycles, continuity)
        return result

    def _connect(
        self,
        stretches: Sequence[PhaseStretch],
        contents: Sequence[FloatingContent],
        covariance: FloatArray,
    ) -> dict[Hashable, tuple[float, float]]:
        """Return the integers of relative navigation in the datum, by the number of the stretch.

        None has been held, but the constant of all satellites is known: contents with the integers
        of relative navigation are off by the same two integers for all links.
        """
        rows, pairs = [], []
        known: tuple[float | None, float | None] = (None, None)
        for row, stretch in enumerate(stretches):
            offered = self._offer(stretch)
            if not math.isfinite(sum(offered) + contents[row].excess_tecu):
                continue
            rows.append(row)
            pairs.append(offered)
            shifts = [
                before if held is None else held - cycles
                for before, held, cycles in zip(known, stretch.integers, offered, strict=True)
            ]
            known = (shifts[0], shifts[1])
        if len(rows) < _ENOUGH_PROVED or not self._estimator.is_bias_known:
            return {}
        sigma = np.array([contents[row].sigma_tecu for row in rows])
        removed = np.array([self._content_of(*pair) for pair in pairs])
        excess = np.array([contents[row].excess_tecu for row in rows]) - removed
        spread = covariance[np.ix_(rows, rows)] + np.diag(sigma**2)
        # What all share is looked for.
        agree = ~self._estimator.find_outliers(excess - np.median(excess), spread + _ANY_SHIFT**2)
        if np.count_nonzero(agree) < _ENOUGH_PROVED:
            return {}
        weights = np.linalg.solve(spread[np.ix_(agree, agree)], np.ones(np.count_nonzero(agree)))
        wide_lanes = np.array([contents[row].wide_lane_cycles for row in rows])[agree]
        wide_lanes = wide_lanes - np.subtract(*np.array(pairs)[agree].T)
        shift = self._resolver.find_shift(
            float(weights @ excess[agree] / weights.sum()),
            float(1.0 / weights.sum()),
            wide_lanes,
            known,
        )
        if shift is None:
            return {}
        return {
            stretches[row].number: (pair[0] + shift[0], pair[1] + shift[1])
            for row, pair, agrees in zip(rows, pairs, agree.tolist(), strict=True)
            if agrees
        }

    def _offer(self, stretch: PhaseStretch) -> tuple[float, float]:
        """Return the integers that relative navigation has for a stretch, cycles; NaN without."""
        is_same = all(
            continuity is not None and self._continuity.get(signal) == continuity
            for signal, continuity in zip(stretch.signals, stretch.continuity, strict=True)
        )
        if not is_same:
            return math.nan, math.nan
        first, second = (self._offered.get(signal, math.nan) for signal in stretch.signals)
        return first, second

    def _doubt_against_geometry(self, means: _LinkMeans, sigma: FloatArray) -> None:
        """Raise the sigmas (TECU, in place) of contents that geometry shows to fluctuate more.

        A second of samples shows little of slow fades, and the seconds before were quieter. What
        bends the phases, and with them the contents, bends their wide lanes.
        """
        if not math.isfinite(self._relative_sigma_cycles):
            return
        shown = self._geometric_errors(means).tolist()
        rows = [
            row
            for row, stretch in enumerate(means.stretches)
            if stretch.has_integers and math.isfinite(shown[row] + sigma[row])
        ]
        fluctuates = np.array([self._excess[means.prns[row]] > 0.0 for row in rows], dtype=bool)
        if not fluctuates.any() or len(rows) < _FEWEST_WITNESSES:
            return
        values = np.array([shown[row] for row in rows])
        weights = 1.0 / self._resolver.geometric_variance(sigma[rows], self._relative_sigma_cycles)
        squares = weights * (values - weights @ values / weights.sum()) ** 2
        # All that fluctuate do so alike. The clock has taken a part of their errors.
        expected = np.count_nonzero(fluctuates) - float(weights[fluctuates].sum() / weights.sum())
        ratio = float(squares[fluctuates].sum()) / max(expected, 0.5)
        sigma[np.array(rows)[fluctuates]] *= math.sqrt(max(ratio, 1.0))

    def _clock(
        self, means: _LinkMeans, rows: npt.NDArray[np.intp], sigma: FloatArray
    ) -> tuple[float, float]:
        """Return the difference of the receiver clocks, wide lanes, and its variance.

        `rows` are those of links with integers, `sigma` the sigmas of contents, TECU. The clock is
        NaN where relative navigation has no state, or with no links.
        """
        shown = self._geometric_errors(means)[rows]
        variances = self._resolver.geometric_variance(sigma[rows], self._relative_sigma_cycles)
        is_known = np.isfinite(shown + variances)
        if not is_known.any():
            return math.nan, 0.0
        weights = 1.0 / variances[is_known]
        return float(weights @ shown[is_known] / weights.sum()), float(1.0 / weights.sum())

    def _geometric_errors(self, means: _LinkMeans) -> FloatArray:
        """Return wide lanes by geometry of links with integers: the clocks and errors, (n,)."""
        return np.asarray(means.geometric - self._resolver.cycles_per_tecu * means.stec)

    def _content_of(self, first: float | None, second: float | None) -> float:
        """Return the content that two integers make, TECU; none where one is not known."""
        if first is None or second is None:
            return 0.0
        return -float(differential_stec(0.0, 0.0, first, second, *self._frequencies))

    def _judge(self, stretch: PhaseStretch, is_wrong: bool) -> bool:
        """Count the seconds that speak against or for the integers of a stretch.

        Returns whether integers that had proved right have become wrong.
        """
        prn = stretch.signals.prn
        self._doubts[prn] = self._doubts.get(prn, 0) + 1 if is_wrong else 0
        stretch.seconds_of_agreement = 0 if is_wrong else stretch.seconds_of_agreement + 1
        if self._doubts[prn] >= _MOST_DOUBTS:
            # Either a slip that no test has seen, or a wrong fix: the integers are not those of
            # this arc.
            self._doubts[prn] = 0
            for signal in stretch.signals:
                self._datum.refuse(signal)
            had_proved, stretch.has_proved = stretch.has_proved, False
            return had_proved
        if stretch.seconds_of_agreement == _SECONDS_OF_PROOF:
            stretch.has_proved = True
            for signal in stretch.signals:
                self._datum.prove(signal)
        return False


def _vertical_content(result: SpacecraftResult) -> tuple[float, float]:
    """Return the vertical content above a spacecraft and its sigma, TECU, from high satellites.

    NaN without such a satellite.
    """
    epoch = result.epoch
    if epoch is None:
        return math.nan, math.nan
    good = (epoch.rejected == 0) & (epoch.elevation > _VTEC_ELEVATION) & (epoch.stec_tecu != 0.0)
    if not good.any():
        return math.nan, math.nan
    vertical = epoch.vtec_tecu[good]
    sigma = epoch.stec_sigma_tecu[good] * np.abs(vertical / epoch.stec_tecu[good])
    # Content that is not of the layer does not tell of it.
    of_layer = math.hypot(statistics.median(sigma.tolist()), epoch.vertical_sigma_tecu)
    return statistics.median(vertical.tolist()), of_layer

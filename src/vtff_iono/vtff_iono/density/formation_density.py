"""Electron density between two spacecraft, second by second, from phases and integers.

Relative navigation fixes integers of double differences. They are held while the phases are
continuous (`vtff_iono.density.integer_datum`), found again from the satellites that have integers
(`vtff_iono.density.integer_resolution`), and judged each second: all satellites must agree on one
density. Integers that are found tell the densities of the seconds before, if their signals went on.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass

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
    vertical_content,
)
from vtff_iono.density.electron_density import (
    DensityEpoch,
    ElectronDensityEstimator,
)
from vtff_iono.density.filter.settings import DensitySettings
from vtff_iono.density.fluctuations import (
    FEWEST_WITNESSES,
    LastErrors,
    add_changes,
    empty_fluctuations,
    empty_last_errors,
    mean_over_scatter,
    measure_fades,
    raise_doubted,
    weigh_contents,
)
from vtff_iono.density.integer_datum import IntegerDatum
from vtff_iono.density.integer_judgement import find_wrong_integers
from vtff_iono.density.integer_resolution import FloatingContent, IntegerResolver
from vtff_iono.density.link_means import LinkMeans, StretchRows
from vtff_iono.density.phase_differences import ReceiverSamples, phase_differences
from vtff_iono.density.phase_stretches import LinkSignals, PhaseStretch, PhaseStretches
from vtff_iono.density.signal_continuity import SignalContinuity
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.formation_second import PairSecond, Track
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftResult

__all__ = ["DensityResult", "FormationDensity"]

IntArray = npt.NDArray[np.int64]

_FEWEST_SAMPLES = 2
# Noise is at least this fraction of the variance that the settings tell.
_LEAST_NOISE = 0.1
# The integers of a satellite are given up when they were wrong in so many seconds in a row, see
# `find_wrong_integers`.
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
class _Second:
    """A second: mean time, GPS time, ns, geometry, and contents.

    `doubt` is the factor by which geometry has shown the contents to fluctuate more than they seem
    to; `horizontal_sigma` as in `ElectronDensityEstimator.update`, TECU.
    """

    time: int
    altitudes: tuple[float, float]
    position_itrf: FloatArray
    means: LinkMeans
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
        self._fluctuations = empty_fluctuations()
        # Content of each link less the predicted one a second ago.
        self._last_errors = empty_last_errors()
        # The links of the last second, and of those with integers whether nothing is left to be
        # counted of them while none is wrong.
        self._links_of_second = StretchRows(())
        self._settled: StretchRows | None = None
        # Which links have integers that are trusted, and for which links and changes that holds.
        self._are_proved: list[bool] = []
        self._proved_for: tuple[StretchRows, int] | None = None
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
        if not math.isfinite(positions.sum()):
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
        if not np.array_equal(averages.number, self._links_of_second.number):
            numbers = averages.number.tolist()
            self._links_of_second = StretchRows([self._stretches[number] for number in numbers])
        means = LinkMeans(
            self._links_of_second, averages.samples, averages.columns, self._least_noise
        )
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
        if not means.links.has_any and self._estimator.is_bias_known:
            self._constant_check.lose(self._estimator)
        means = self._resolve_integers(seconds, altitudes, means, sigma_of_all)
        has_integers = means.has_integers
        fixed = means if means.links.have_all else means.select(has_integers)
        satellites = fixed.prns
        sigma = sigma_of_all[has_integers]
        proved = self._proved(fixed.links)
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
            spread = np.sqrt(covariance.diagonal()[has_integers])
            errors = error[has_integers]
            self._examine_integers(fixed, errors, spread, sigma, epoch.is_outlier)
            measure_fades(
                self._fluctuations, fixed.prns, fixed.samples, fixed.columns, errors, sigma
            )
            now_errors = LastErrors(means.links.number, means.links.integers, error)
            add_changes(
                self._fluctuations,
                means.prns,
                means.samples,
                means.columns,
                self._last_errors,
                now_errors,
                self._least_noise,
            )
            self._last_errors = now_errors
        late: list[DensityResult] = []
        if math.isfinite(epoch.density):
            if self._without_density:
                late = self._late_densities(now, fixed.select(~epoch.is_outlier))
                self._without_density.clear()
        else:
            self._without_density.append(now)
        if not means.links.has_any:
            return []
        return [*late, self._result(now, satellites, epoch)]

    def _result(
        self, second: _Second, satellites: IntArray, epoch: DensityEpoch, is_late: bool = False
    ) -> DensityResult:
        return DensityResult(
            time=second.time,
            position_itrf=second.position_itrf,
            system=np.full(len(satellites), SYSTEM_GPS),
            prn=satellites.copy(),
            epoch=epoch,
            datum=self._datum_number + self._shifts,
            is_late=is_late,
        )

    def _late_densities(self, now: _Second, fixed: LinkMeans) -> list[DensityResult]:
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
                prn: excess
                for prn, excess in zip(
                    second.means.prns.tolist(),
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
            satellites = second.means.prns[rows]
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
        variance = white + excess * mean_over_scatter(self._fluctuations)
        return np.asarray(second.doubt * np.sqrt(variance))

    def _predict(
        self, seconds: float, altitudes: tuple[float, float], means: LinkMeans
    ) -> tuple[FloatArray, FloatArray]:
        """Return the contents that are predicted of links, TECU, and their covariance."""
        return self._estimator.predicted_stec(
            seconds,
            *altitudes,
            means.elevation_chief,
            means.elevation_deputy,
            means.prns,
        )

    def _proved(self, links: StretchRows) -> list[bool]:
        """Return which links have integers that are trusted."""
        known_for = (links, self._datum.changes)
        if known_for != self._proved_for:
            self._proved_for = known_for
            self._are_proved = [self._is_proved(stretch) for stretch in links.stretches]
        return self._are_proved

    def _is_proved(self, stretch: PhaseStretch) -> bool:
        first, second = stretch.signals
        return self._datum.is_proved(first) and self._datum.is_proved(second)

    def _sigma(self, means: LinkMeans) -> FloatArray:
        """Return the sigma of mean contents of a second, TECU, which is added to the memory."""
        sigma: FloatArray = weigh_contents(
            self._fluctuations, means.prns, means.samples, means.columns, self._least_noise
        )
        return sigma

    # ---- integers ----------------------------------------------------------------------------

    def _examine_integers(
        self,
        fixed: LinkMeans,
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
        is_wrong, is_any_wrong, fluctuating = find_wrong_integers(
            fixed.columns,
            fixed.samples,
            errors,
            spread,
            sigma,
            is_outlier,
            self._resolver.measured,
            self._resolver.cycles_per_tecu,
            self._resolver.noise_square,
            self._relative_sigma_cycles,
            settings.outlier_sigmas,
            settings.outlier_tecu,
            self._least_noise,
        )
        if fixed.links is self._settled and not is_any_wrong:
            # All have proved right: nothing is left to be counted.
            self._constant_check.add_steps(0, int(np.count_nonzero(fluctuating)))
            return
        steps = still_right = 0
        for stretch, wrong, fluctuates in zip(
            fixed.stretches, is_wrong.tolist(), fluctuating.tolist(), strict=True
        ):
            steps += self._judge(stretch, wrong)
            still_right += fluctuates and not wrong and stretch.has_proved
        self._constant_check.add_steps(steps, still_right)
        is_settled = not is_any_wrong and all(
            stretch.has_proved and stretch.seconds_of_agreement > _SECONDS_OF_PROOF
            for stretch in fixed.stretches
        )
        self._settled = fixed.links if is_settled else None

    def _horizontal_sigma(
        self, chief: SpacecraftResult, positions: FloatArray, geodetic_chief: FloatArray
    ) -> float:
        """Return the sigma of what the vertical contents at two positions differ by, TECU.

        `positions` have shape (2, 3), m; `geodetic_chief` as in `horizontal_sigma`.
        """
        gradient = None if chief.epoch is None else chief.epoch.gradient_sigma
        if gradient is None or not math.isfinite(gradient[0] + gradient[1]):
            per_deg = self._settings.gradient_sigma_tecu_per_deg
            gradient = np.full(2, math.degrees(per_deg / float(np.linalg.norm(positions[0]))))
        return horizontal_sigma(gradient, positions[0], positions[1], geodetic_chief)

    def _resolve_integers(
        self,
        seconds: float,
        altitudes: tuple[float, float],
        means: LinkMeans,
        sigma: FloatArray,
    ) -> LinkMeans:
        """Return the means of links, those whose integers are found beside others with them.

        Contents are predicted from the constant, from the level that each satellite had before, and
        from the links that have integers. `sigma` are those of the means, TECU.
        """
        has_integers = means.has_integers
        is_predicted = self._estimator.is_bias_known or (
            self._estimator.has_bias and means.links.has_any
        )
        if means.links.have_all or not is_predicted:
            return means
        predicted, covariance = self._predict(seconds, altitudes, means)
        errors = means.stec - predicted
        known = has_integers & np.isfinite(sigma)
        of_known = covariance[np.ix_(known, known)] + np.diag(sigma[known] ** 2)
        agree = ~self._estimator.find_outliers(errors[known], of_known)
        if np.count_nonzero(agree) < FEWEST_WITNESSES:
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
            stretches = [means.stretches[row] for row in floating.tolist()]
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

    def _doubt_against_geometry(self, means: LinkMeans, sigma: FloatArray) -> None:
        """Raise the sigmas (TECU, in place) of contents that geometry shows to fluctuate more.

        A second of samples shows little of slow fades, and the seconds before were quieter. What
        bends the phases, and with them the contents, bends their wide lanes.
        """
        if not math.isfinite(self._relative_sigma_cycles):
            return
        raise_doubted(
            self._fluctuations,
            means.prns,
            means.has_integers,
            means.columns,
            sigma,
            self._resolver.cycles_per_tecu,
            self._resolver.noise_square,
            self._resolver.geometric_variance(0.0, self._relative_sigma_cycles),
        )

    def _clock(
        self, means: LinkMeans, rows: npt.NDArray[np.intp], sigma: FloatArray
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

    def _geometric_errors(self, means: LinkMeans) -> FloatArray:
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
    """Return the vertical content above a spacecraft and its sigma, TECU; NaN for none."""
    epoch = result.epoch
    if epoch is None:
        return math.nan, math.nan
    content, sigma = vertical_content(
        epoch.rejected,
        epoch.elevation,
        epoch.stec_tecu,
        epoch.stec_sigma_tecu,
        epoch.vtec_tecu,
        float(epoch.vertical_sigma_tecu),
    )
    return content, sigma

"""Electron density between two spacecraft, second by second, from phases and integers.

Relative navigation fixes integers of double differences. They are kept while the phases last
(`vtff_iono.density.integer_datum`), found again from the satellites that have theirs
(`vtff_iono.density.integer_resolution`), and judged each second: the satellites must agree on one
density.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.signals import carrier_frequency_hz
from vtff_iono.content.slant_tec import Rejection, SlantTecRows
from vtff_iono.density.differential_tec import SecondAverage, differential_stec
from vtff_iono.density.electron_density import (
    DensityEpoch,
    DensitySettings,
    ElectronDensityEstimator,
)
from vtff_iono.density.integer_datum import IntegerDatum
from vtff_iono.density.integer_resolution import IntegerResolver
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.formation_second import FormationSecond, Group, Track
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftResult

__all__ = ["DensityResult", "FormationDensity"]

# A phase with one of these does not belong to its integer.
_NO_PHASE = np.uint16(
    Rejection.NO_SECOND_SIGNAL | Rejection.PHASE_INVALID | Rejection.PARITY_UNKNOWN
)
_FEWEST_SAMPLES = 2
_VTEC_ELEVATION = math.radians(40.0)
# Scintillation: a scatter that exceeds the variance of the noise by this factor. Of fades that last
# half a second a third of the variance shows as scatter within a second, the rest is in the mean.
_LARGE_SCATTER = 2.0
_MEAN_OVER_SCATTER = 2.0
_SCATTER_MEMORY = 15.0  # seconds
# Integers are wrong when their satellite is off by so much for so many seconds.
_WRONG_SIGMAS = 3.0
_WRONG_TECU = 0.1
_WRONG_WIDE_LANE = 0.5  # cycles; the mean of a second is good to 0.1
_MOST_DOUBTS = 3
# Integers are right after so many seconds of agreement; if there are so many, only these count.
_PROOF = 3
_ENOUGH_PROVED = 4


@dataclass(frozen=True, eq=False)
class DensityResult:
    """The density of one second.

    Parameters
    ----------
    time : int
        Mean time of the samples, GPS time, ns since 1980-01-06.
    position_itrf : ndarray, shape (3,)
        Middle between the spacecraft, m.
    system, prn : ndarray of int, shape (n,)
        Satellites of the rows of `epoch`.
    epoch : DensityEpoch
    """

    time: int
    position_itrf: FloatArray
    system: npt.NDArray[np.int64]
    prn: npt.NDArray[np.int64]
    epoch: DensityEpoch


@dataclass(frozen=True)
class _Piece:
    """A stretch of a link over which single differences may be averaged.

    Parameters
    ----------
    key : int
        Satellite and attributes of the signals.
    arcs : tuple of int
        Arcs of chief and deputy.
    integers : tuple of float or None
        Of both signals.
    """

    key: int
    arcs: tuple[int, int]
    integers: tuple[float, float] | None


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
        self._pieces: list[_Piece] = []
        self._piece_numbers: dict[_Piece, int] = {}
        self._piece_of_key: dict[int, int] = {}
        # Keys of the links of chief and deputy, by the numbers of the links.
        self._keys: tuple[list[int], list[int]] = ([], [])
        self._average = SecondAverage(_FEWEST_SAMPLES)
        self._estimator = ElectronDensityEstimator(settings)
        frequencies = carrier_frequency_hz([SYSTEM_GPS] * 2, bands)
        self._frequencies = (float(frequencies[0]), float(frequencies[1]))
        # Of the difference of two receivers and two signals at one epoch, TECU.
        self._sample_sigma = 2.0 * carrier_phase_sigma * tecu_per_metre(*self._frequencies)
        # Variance that scintillation adds to the samples of each satellite, TECU^2.
        self._excess: dict[int, float] = {}
        self._doubts: dict[int, int] = {}
        self._agreed: dict[_Piece, int] = {}
        self._resolver = IntegerResolver(*self._frequencies)

    def update(
        self,
        second: FormationSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        links: tuple[Sequence[Link], Sequence[Link]],
        tracks: tuple[Track, Track],
    ) -> list[DensityResult]:
        """Take a second in and return the densities of the seconds that have ended.

        Parameters
        ----------
        second : FormationSecond
        results, links, tracks : tuple
            Of chief and deputy: what has been made of the second, all links so far, and motion.
        """
        for keys, known in zip(self._keys, links, strict=True):
            keys += [self._link_key(link) for link in known[len(keys) :]]
        self._current_pieces(second, self._arcs_at_end(results))
        time, number, columns = self._differences(second, results)
        found = []
        for middle, numbers, means, samples in self._average.update(time, number, columns):
            result = self._density_of(round(middle), tracks, numbers, means, samples, results[0])
            if result is not None:
                found.append(result)
        return found

    def _arcs_at_end(
        self, results: tuple[SpacecraftResult, SpacecraftResult]
    ) -> dict[int, tuple[int, int]]:
        """Return the arcs that both spacecraft have at the end of the second, by link key."""
        latest: list[dict[int, int]] = []
        for craft, result in enumerate(results):
            rows = result.rows
            pairs = zip(rows.pairs.link.tolist(), rows.arc.tolist(), strict=True)
            last = {link: arc for link, arc in pairs if link >= 0}
            keys = self._keys[craft]
            latest.append({keys[n]: arc for n, arc in last.items() if keys[n] >= 0 and arc > 0})
        return {
            key: (latest[0][key], latest[1][key])
            for key in sorted(latest[0].keys() & latest[1].keys())
        }

    def _signals(self, key: int) -> tuple[tuple[Group, int], tuple[Group, int]]:
        """Return the two signals of a link key as group and satellite."""
        prn, first, second = key >> 16, key >> 8 & 0xFF, key & 0xFF
        one, two = self._bands
        return ((SYSTEM_GPS, one, first), prn), ((SYSTEM_GPS, two, second), prn)

    def _link_key(self, link: Link) -> int:
        """Return prn and attributes of a link of the density bands as one number, else -1."""
        bands = (link.band_first, link.band_second)
        if link.system != SYSTEM_GPS or bands != self._bands:
            return -1
        return link.prn << 16 | ord(link.attribute_first) << 8 | ord(link.attribute_second)

    def _current_pieces(self, second: FormationSecond, arcs: dict[int, tuple[int, int]]) -> None:
        """Give each link its piece: satellite, arcs and integers that hold now."""
        continuity = {signal: both for key, both in arcs.items() for signal in self._signals(key)}
        integers = self._datum.update(second.integers, continuity)
        self._piece_of_key = {}
        for key, both in arcs.items():
            one, two = (integers.get(signal) for signal in self._signals(key))
            known = None if one is None or two is None else (one, two)
            piece = _Piece(key, both, known)
            number = self._piece_numbers.setdefault(piece, len(self._pieces))
            if number == len(self._pieces):
                self._pieces.append(piece)
            self._piece_of_key[key] = number

    def _differences(
        self,
        second: FormationSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], dict[str, FloatArray]]:
        """Return times, pieces and single differences of what both spacecraft have observed."""
        keys, usable = [], []
        for craft, result in enumerate(results):
            rows = result.rows
            number = np.array([*self._keys[craft], -1])
            key = number[rows.pairs.link] if len(rows) else np.zeros(0, dtype=np.int64)
            good = (key >= 0) & (rows.arc > 0) & ((rows.rejected & _NO_PHASE) == 0)
            good &= self._in_last_arc(rows)
            keys.append(((rows.pairs.time - second.time) << 24) + key)
            usable.append(np.flatnonzero(good))
        common, one, other = np.intersect1d(
            keys[0][usable[0]], keys[1][usable[1]], return_indices=True
        )
        chosen = usable[0][one], usable[1][other]
        unique, place = np.unique(common & 0xFFFFFF, return_inverse=True)
        numbers = np.array([self._piece_of_key[key] for key in unique.tolist()], dtype=np.int64)
        known = [self._pieces[number].integers or (0.0, 0.0) for number in numbers.tolist()]
        integers = np.array(known).reshape(-1, 2)[place]
        phases = [
            self._single_difference(second, results, chosen, name)
            for name in ("row_first", "row_second")
        ]
        chief, deputy = (
            result.rows.pairs.wide_lane_cycles[row]
            for result, row in zip(results, chosen, strict=True)
        )
        stec = differential_stec(*phases, integers[:, 0], integers[:, 1], *self._frequencies)
        columns = {
            "stec": stec,
            "stec_squared": stec * stec,
            "wide_lane": deputy - chief - (integers[:, 0] - integers[:, 1]),
            "elevation_chief": results[0].rows.elevation[chosen[0]],
            "elevation_deputy": results[1].rows.elevation[chosen[1]],
        }
        return results[0].rows.pairs.time[chosen[0]], numbers[place], columns

    @staticmethod
    def _single_difference(
        second: FormationSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        chosen: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
        name: str,
    ) -> FloatArray:
        """Return the phases of the first or second signals, deputy less chief, cycles."""
        chief, deputy = (
            block.columns["carrier_phase_cycles"][getattr(result.rows.pairs, name)[row]]
            for block, result, row in zip(second.observations, results, chosen, strict=True)
        )
        return np.asarray(deputy - chief)

    @staticmethod
    def _in_last_arc(rows: SlantTecRows) -> npt.NDArray[np.bool_]:
        """Return which rows are of the arc that their link has at its last sample."""
        if not len(rows):
            return np.zeros(0, dtype=bool)
        latest = np.full(int(rows.pairs.link.max()) + 2, -1, dtype=np.int64)
        latest[rows.pairs.link] = rows.arc  # the last one stays
        return np.asarray(latest[rows.pairs.link] == rows.arc)

    def _density_of(
        self,
        time: int,
        tracks: tuple[Track, Track],
        numbers: npt.NDArray[np.int64],
        means: dict[str, FloatArray],
        samples: npt.NDArray[np.int64],
        chief: SpacecraftResult,
    ) -> DensityResult | None:
        when = np.array([time])
        places = np.concatenate([track.positions(when) for track in tracks])
        if not np.isfinite(places).all():
            return None
        altitudes = geodetic_from_itrf(places)[:, 2].tolist()
        if self._datum.number != self._datum_number:
            self._datum_number = self._datum.number
            self._estimator.reset_bias()
            self._resolver.reset()
        pieces = [self._pieces[number] for number in numbers.tolist()]
        has_integers = np.array([piece.integers is not None for piece in pieces], dtype=bool)
        part = {name: column[has_integers] for name, column in means.items()}
        known = [piece for piece in pieces if piece.integers is not None]
        satellites = [piece.key >> 16 for piece in known]
        sigma = self._sigma(satellites, part, samples[has_integers])
        proved = np.array([self._is_proved(piece) for piece in known], dtype=bool)
        if np.count_nonzero(proved) >= _ENOUGH_PROVED:
            sigma[~proved] = np.nan
        epoch = self._estimator.update(
            time / NANOSECONDS_PER_SECOND,
            *altitudes,
            part["elevation_chief"],
            part["elevation_deputy"],
            part["stec"],
            sigma,
            _vertical_content(chief),
        )
        if math.isfinite(epoch.density):
            self._resolve(pieces, has_integers, means, samples, altitudes)
        if not has_integers.any():
            return None
        return DensityResult(
            time=time,
            position_itrf=places.mean(axis=0),
            system=np.full(len(part["stec"]), SYSTEM_GPS),
            prn=np.array(satellites, dtype=np.int64),
            epoch=epoch,
        )

    def _is_proved(self, piece: _Piece) -> bool:
        return all(self._datum.is_proved(group, prn) for group, prn in self._signals(piece.key))

    def _sigma(
        self, satellites: list[int], means: dict[str, FloatArray], samples: npt.NDArray[np.int64]
    ) -> FloatArray:
        """Return the sigma of means: white noise, and what scintillation adds to it."""
        scatter = means["stec_squared"] - means["stec"] ** 2
        # What exceeds the noise of one sample by far fluctuates slowly. One second alone may be
        # quiet by chance, so that those before it count too.
        excess = np.where(scatter > _LARGE_SCATTER * self._sample_sigma**2, scatter, 0.0)
        for place, (prn, value) in enumerate(zip(satellites, excess.tolist(), strict=True)):
            mean = self._excess.get(prn, value)
            self._excess[prn] = mean + (value - mean) / _SCATTER_MEMORY
            excess[place] = max(value, self._excess[prn])
        return np.sqrt(self._sample_sigma**2 / samples + excess * _MEAN_OVER_SCATTER)

    def _resolve(
        self,
        pieces: list[_Piece],
        has_integers: npt.NDArray[np.bool_],
        means: dict[str, FloatArray],
        samples: npt.NDArray[np.int64],
        altitudes: list[float],
    ) -> None:
        """Find integers of pieces without from those that have some."""
        predicted = self._estimator.predicted_stec(
            *altitudes, means["elevation_chief"], means["elevation_deputy"]
        )
        for row in np.flatnonzero(has_integers).tolist():
            prn = pieces[row].key >> 16
            error = float(means["stec"][row] - predicted[row])
            wide_lane = float(means["wide_lane"][row])
            scatter = self._excess.get(prn, 0.0) * _MEAN_OVER_SCATTER + self._sample_sigma**2
            wrong = abs(error) > _WRONG_SIGMAS * math.sqrt(scatter) + _WRONG_TECU
            wrong |= abs(self._resolver.wide_lane_error(wide_lane)) > _WRONG_WIDE_LANE
            self._judge(pieces[row], wrong)
            if not wrong:
                self._resolver.add_known(wide_lane, int(samples[row]))
        for row in np.flatnonzero(~has_integers).tolist():
            piece = pieces[row]
            excess = float(means["stec"][row] - predicted[row])
            found = self._resolver.add_unknown(
                piece, float(means["wide_lane"][row]), int(samples[row]), excess
            )
            if found is not None:
                for (group, prn), cycles in zip(self._signals(piece.key), found, strict=True):
                    self._datum.resolve(group, prn, cycles, piece.arcs)

    def _judge(self, piece: _Piece, is_wrong: bool) -> None:
        """Count what tells against or for the integers of a piece."""
        prn = piece.key >> 16
        self._doubts[prn] = self._doubts.get(prn, 0) + 1 if is_wrong else 0
        self._agreed[piece] = 0 if is_wrong else self._agreed.get(piece, 0) + 1
        if self._doubts[prn] >= _MOST_DOUBTS:
            # A slip that no test has seen, or a wrong fix: the integers belong to another arc.
            self._doubts[prn] = 0
            for group, _ in self._signals(piece.key):
                self._datum.forget(group, prn)
        elif self._agreed[piece] == _PROOF:
            for group, _ in self._signals(piece.key):
                self._datum.prove(group, prn)


def _vertical_content(result: SpacecraftResult) -> float:
    """Return the vertical content above a spacecraft from its high satellites, TECU; else NaN."""
    epoch = result.epoch
    if epoch is None:
        return math.nan
    good = (epoch.rejected == 0) & (epoch.elevation > _VTEC_ELEVATION)
    return statistics.median(epoch.vtec_tecu[good].tolist()) if good.any() else math.nan

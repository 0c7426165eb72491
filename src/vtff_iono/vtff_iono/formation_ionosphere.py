"""The ionosphere that two spacecraft see together, second by second, online or from a recording.

Each second brings the observations of both receivers since the last one, their positions, and the
integers that relative navigation has fixed. From it come the contents and the scintillation of each
spacecraft (`vtff_iono.spacecraft_ionosphere`), and of both the electron density between them.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import carrier_frequency_hz
from vtff_iono.code_biases import CodeBiasTable
from vtff_iono.differential_tec import SecondAverage, differential_stec
from vtff_iono.electron_density import DensityEpoch, DensitySettings, ElectronDensityEstimator
from vtff_iono.formation_boundaries import (
    Boundary,
    BoundarySettings,
    DensitySample,
    FormationBoundaries,
)
from vtff_iono.geometry_free import tecu_per_metre
from vtff_iono.integer_datum import Group, IntegerDatum
from vtff_iono.integer_resolution import IntegerResolver
from vtff_iono.signal_pairs import Link
from vtff_iono.slant_tec import Rejection, SlantTecRows
from vtff_iono.spacecraft_ionosphere import (
    ObservationBlock,
    PreparedBlock,
    SpacecraftIonosphere,
    SpacecraftResult,
    SpacecraftSettings,
)

__all__ = [
    "DensityResult",
    "FormationIonosphere",
    "FormationResult",
    "FormationSecond",
    "FormationSettings",
    "Integers",
]

Integers = Mapping[tuple[Group, int], float]
"""Integers, cycles relative to a reference satellite of each group, by group and satellite."""

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
# Of a recording; bounds the memory.
_SECONDS_AT_ONCE = 100


@dataclass(frozen=True)
class FormationSettings:
    """How a formation is processed.

    Parameters
    ----------
    spacecraft : SpacecraftSettings
        Of both.
    density : DensitySettings
    boundaries : BoundarySettings
    density_bands : tuple of int
        RINEX frequency digits of the GPS signals that the density is made of.
    carrier_phase_sigma : float
        Noise of one carrier phase of one receiver at the full rate, m.
    """

    spacecraft: SpacecraftSettings = SpacecraftSettings()
    density: DensitySettings = DensitySettings()
    boundaries: BoundarySettings = BoundarySettings()
    density_bands: tuple[int, int] = (1, 2)
    carrier_phase_sigma: float = 0.001


@dataclass(frozen=True, eq=False)
class FormationSecond:
    """What is known of a second when it ends.

    Parameters
    ----------
    time : int
        Its end, GPS time, ns since 1980-01-06.
    observations : tuple of ObservationBlock
        Of chief and deputy: all epochs since the last second.
    states_itrf : tuple of ndarray or None, shape (6,)
        Of chief and deputy at `time`: position and Earth-fixed velocity; None where unknown.
    integers : Integers
        Fixed integers at `time`, deputy less chief.
    """

    time: int
    observations: tuple[ObservationBlock, ObservationBlock]
    states_itrf: tuple[FloatArray | None, FloatArray | None]
    integers: Integers


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


@dataclass(frozen=True, eq=False)
class FormationResult:
    """What a second has told.

    Parameters
    ----------
    spacecraft : tuple of SpacecraftResult
        Chief and deputy.
    density : tuple of DensityResult
        Of the seconds that have ended: one, as a rule, whose samples reach up to one before `time`.
    boundaries : tuple of Boundary
        Edges that have been confirmed.
    """

    spacecraft: tuple[SpacecraftResult, SpacecraftResult]
    density: tuple[DensityResult, ...]
    boundaries: tuple[Boundary, ...]


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


class _Track:
    """Motion of a spacecraft between its last two states."""

    def __init__(self, states: Sequence[tuple[int, FloatArray]] = ()) -> None:
        self._states = states

    def followed_by(self, time: int, state_itrf: FloatArray | None) -> _Track:
        """Return the track with the next state; an empty one if that is unknown."""
        return _Track(() if state_itrf is None else (*self._states[-1:], (time, state_itrf)))

    def positions(self, time: npt.NDArray[np.int64]) -> FloatArray:
        """Return the positions at times (n,), shape (n, 3); NaN where nothing is known."""
        if not self._states:
            return np.full((len(time), 3), np.nan)
        end, last = self._states[-1]
        seconds = (time - end) / NANOSECONDS_PER_SECOND
        if len(self._states) == 1:
            return np.asarray(last[:3] + seconds[:, np.newaxis] * last[3:])
        begin, first = self._states[0]
        return _between(seconds, (begin - end) / NANOSECONDS_PER_SECOND, first, last)


def _between(seconds: FloatArray, begin: float, first: FloatArray, last: FloatArray) -> FloatArray:
    """Return the positions of the cubic through two states, at `begin` and at 0 s, shape (n, 3)."""
    place = 1.0 - seconds / begin  # 0 at the first state, 1 at the last one
    rest = 1.0 - place
    weights = (
        rest**2 * (1.0 + 2.0 * place),
        place**2 * (1.0 + 2.0 * rest),
        -begin * place * rest**2,
        begin * place**2 * rest,
    )
    return np.stack(weights, axis=-1) @ np.stack((first[:3], last[:3], first[3:], last[3:]))


class FormationIonosphere:
    """Contents, scintillation and electron density of two spacecraft.

    Parameters
    ----------
    settings : FormationSettings
    code_biases : CodeBiasTable, optional
        Satellite biases; those of the ephemerides by default.

    Attributes
    ----------
    spacecraft : tuple of SpacecraftIonosphere
        Chief and deputy.
    """

    def __init__(
        self,
        settings: FormationSettings = FormationSettings(),  # noqa: B008 - frozen
        code_biases: CodeBiasTable | None = None,
    ) -> None:
        self._settings = settings
        self.spacecraft = (
            SpacecraftIonosphere(settings.spacecraft, code_biases),
            SpacecraftIonosphere(settings.spacecraft, code_biases),
        )
        self._tracks = (_Track(), _Track())
        self._datum = IntegerDatum()
        self._datum_number = 0
        self._pieces: list[_Piece] = []
        self._piece_numbers: dict[_Piece, int] = {}
        self._piece_of_key: dict[int, int] = {}
        self._keys: tuple[list[int], list[int]] = ([], [])
        self._average = SecondAverage(_FEWEST_SAMPLES)
        self._density = ElectronDensityEstimator(settings.density)
        self._boundaries = FormationBoundaries(settings.boundaries)
        frequencies = carrier_frequency_hz([SYSTEM_GPS] * 2, settings.density_bands)
        self._frequencies = (float(frequencies[0]), float(frequencies[1]))
        # Variance that scintillation adds to the samples of each satellite, TECU^2.
        self._excess: dict[int, float] = {}
        self._doubts: dict[int, int] = {}
        self._agreed: dict[_Piece, int] = {}
        self._resolver = IntegerResolver(*self._frequencies)

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take a broadcast ephemeris that either receiver has decoded."""
        for spacecraft in self.spacecraft:
            spacecraft.add_ephemeris(ephemeris)

    def process(self, second: FormationSecond) -> FormationResult:
        """Take the next second in."""
        return next(self._process_all([second]))

    def process_recording(
        self, recording: Iterable[tuple[Sequence[BroadcastEphemeris], FormationSecond]]
    ) -> Iterator[FormationResult]:
        """Take seconds in and yield what each has told.

        The results have the same bytes as those of `add_ephemeris` and `process` for each second,
        in half the time: what can be done for many seconds at once is.

        Parameters
        ----------
        recording : iterable
            New ephemerides and the second, in order of time.
        """
        waiting: list[FormationSecond] = []
        for ephemerides, second in recording:
            if ephemerides or len(waiting) == _SECONDS_AT_ONCE:
                yield from self._process_all(waiting)
                waiting = []
            for ephemeris in ephemerides:
                self.add_ephemeris(ephemeris)
            waiting.append(second)
        yield from self._process_all(waiting)

    def _process_all(self, seconds: Sequence[FormationSecond]) -> Iterator[FormationResult]:
        if not seconds:
            return
        tracks, prepared = [], []
        for craft, spacecraft in enumerate(self.spacecraft):
            track, own = self._tracks[craft], []
            for second in seconds:
                track = track.followed_by(second.time, second.states_itrf[craft])
                own.append(track)
            blocks = [second.observations[craft] for second in seconds]
            positions = [
                track.positions(block.time) for track, block in zip(own, blocks, strict=True)
            ]
            tracks.append(own)
            prepared.append(spacecraft.prepare(blocks, positions))
        for place, second in enumerate(seconds):
            self._tracks = (tracks[0][place], tracks[1][place])
            yield self._processed(second, (prepared[0][place], prepared[1][place]))

    def _processed(
        self, second: FormationSecond, prepared: tuple[PreparedBlock, PreparedBlock]
    ) -> FormationResult:
        chief, deputy = (
            spacecraft.process_prepared(part)
            for spacecraft, part in zip(self.spacecraft, prepared, strict=True)
        )
        density = tuple(self._densities(second, (chief, deputy)))
        samples = [
            DensitySample(
                one.time,
                one.epoch.altitude,
                one.epoch.separation,
                one.epoch.density,
                one.epoch.sigma,
            )
            for one in density
        ]
        boundaries = self._boundaries.update(
            second.observations,
            (prepared[0].position_itrf, prepared[1].position_itrf),
            (chief, deputy),
            (self.spacecraft[0].links, self.spacecraft[1].links),
            samples,
        )
        return FormationResult((chief, deputy), density, tuple(boundaries))

    # ---- density -----------------------------------------------------------------------------

    def _arcs_at_end(
        self, results: tuple[SpacecraftResult, SpacecraftResult]
    ) -> dict[int, tuple[int, int]]:
        """Return the arcs that both spacecraft have at the end of the second, by link key."""
        latest: list[dict[int, int]] = []
        for craft, result in enumerate(results):
            rows = result.rows
            pairs = zip(rows.pairs.link.tolist(), rows.arc.tolist(), strict=True)
            last = {link: arc for link, arc in pairs if link >= 0}
            keys = self._link_keys(craft)
            latest.append({keys[n]: arc for n, arc in last.items() if keys[n] >= 0 and arc > 0})
        return {
            key: (latest[0][key], latest[1][key])
            for key in sorted(latest[0].keys() & latest[1].keys())
        }

    def _signals(self, key: int) -> tuple[tuple[Group, int], tuple[Group, int]]:
        """Return the two signals of a link key as group and satellite."""
        prn, first, second = key >> 16, key >> 8 & 0xFF, key & 0xFF
        one, two = self._settings.density_bands
        return ((SYSTEM_GPS, one, first), prn), ((SYSTEM_GPS, two, second), prn)

    def _link_keys(self, craft: int) -> list[int]:
        """Return the keys of all links of a spacecraft."""
        known = self._keys[craft]
        known += [self._link_key(link) for link in self.spacecraft[craft].links[len(known) :]]
        return known

    def _link_key(self, link: Link) -> int:
        """Return prn and attributes of a link of the density bands as one number, else -1."""
        bands = (link.band_first, link.band_second)
        if link.system != SYSTEM_GPS or bands != self._settings.density_bands:
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

    def _densities(
        self, second: FormationSecond, results: tuple[SpacecraftResult, SpacecraftResult]
    ) -> list[DensityResult]:
        arcs = self._arcs_at_end(results)
        self._current_pieces(second, arcs)
        time, number, columns = self._differences(second, results)
        found = []
        for middle, numbers, means, samples in self._average.update(time, number, columns):
            result = self._density_of(round(middle), numbers, means, samples, results[0])
            if result is not None:
                found.append(result)
        return found

    def _differences(
        self,
        second: FormationSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], dict[str, FloatArray]]:
        """Return times, pieces and single differences of what both spacecraft have observed."""
        keys, usable = [], []
        for craft, result in enumerate(results):
            rows = result.rows
            number = np.array([*self._link_keys(craft), -1])
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
        numbers: npt.NDArray[np.int64],
        means: dict[str, FloatArray],
        samples: npt.NDArray[np.int64],
        chief: SpacecraftResult,
    ) -> DensityResult | None:
        when = np.array([time])
        places = np.concatenate([track.positions(when) for track in self._tracks])
        if not np.isfinite(places).all():
            return None
        altitudes = geodetic_from_itrf(places)[:, 2].tolist()
        if self._datum.number != self._datum_number:
            self._datum_number = self._datum.number
            self._density.reset_bias()
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
        epoch = self._density.update(
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
        one = 2.0 * self._settings.carrier_phase_sigma * tecu_per_metre(*self._frequencies)
        scatter = means["stec_squared"] - means["stec"] ** 2
        # What exceeds the noise of one sample by far fluctuates slowly. One second alone may be
        # quiet by chance, so that those before it count too.
        excess = np.where(scatter > _LARGE_SCATTER * one**2, scatter, 0.0)
        for place, (prn, value) in enumerate(zip(satellites, excess.tolist(), strict=True)):
            mean = self._excess.get(prn, value)
            self._excess[prn] = mean + (value - mean) / _SCATTER_MEMORY
            excess[place] = max(value, self._excess[prn])
        return np.sqrt(one**2 / samples + excess * _MEAN_OVER_SCATTER)

    def _resolve(
        self,
        pieces: list[_Piece],
        has_integers: npt.NDArray[np.bool_],
        means: dict[str, FloatArray],
        samples: npt.NDArray[np.int64],
        altitudes: list[float],
    ) -> None:
        """Find integers of pieces without from those that have some."""
        predicted = self._density.predicted_stec(
            *altitudes, means["elevation_chief"], means["elevation_deputy"]
        )
        one = 2.0 * self._settings.carrier_phase_sigma * tecu_per_metre(*self._frequencies)
        for row in np.flatnonzero(has_integers).tolist():
            prn = pieces[row].key >> 16
            error = float(means["stec"][row] - predicted[row])
            wide_lane = float(means["wide_lane"][row])
            scatter = self._excess.get(prn, 0.0) * _MEAN_OVER_SCATTER + one**2
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

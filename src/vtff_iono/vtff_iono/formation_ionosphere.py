"""The ionosphere that two spacecraft see together, second by second, online or from a recording.

Each second brings the observations of both receivers since the last one, their positions, and the
integers that relative navigation has fixed. From it come the contents and the scintillation of each
spacecraft (`vtff_iono.spacecraft_ionosphere`), and of both the electron density between them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import carrier_frequency_hz
from vtff_iono.code_biases import CodeBiasTable
from vtff_iono.differential_tec import SecondAverage, differential_stec
from vtff_iono.electron_density import DensityEpoch, DensitySettings, ElectronDensityEstimator
from vtff_iono.geometry_free import tecu_per_metre
from vtff_iono.integer_datum import FixedInteger, Group, IntegerDatum
from vtff_iono.signal_pairs import Link
from vtff_iono.slant_tec import Rejection, SlantTecRows
from vtff_iono.spacecraft_ionosphere import (
    ObservationBlock,
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

Integers = Mapping[tuple[Group, int], FixedInteger]

# A phase with one of these does not belong to its integer.
_NO_PHASE = np.uint16(
    Rejection.NO_SECOND_SIGNAL | Rejection.PHASE_INVALID | Rejection.PARITY_UNKNOWN
)
_FEWEST_SAMPLES = 2
_VTEC_ELEVATION = math.radians(40.0)
# What tells apart two integers of a satellite in one second.
_GENERATION = 1000


@dataclass(frozen=True)
class FormationSettings:
    """How a formation is processed.

    Parameters
    ----------
    spacecraft : SpacecraftSettings
        Of both.
    density : DensitySettings
    density_bands : tuple of int
        RINEX frequency digits of the GPS signals that the density is made of.
    carrier_phase_sigma : float
        Noise of one carrier phase of one receiver at the full rate, m.
    """

    spacecraft: SpacecraftSettings = SpacecraftSettings()
    density: DensitySettings = DensitySettings()
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
    """

    spacecraft: tuple[SpacecraftResult, SpacecraftResult]
    density: tuple[DensityResult, ...]


class _Track:
    """Motion of a spacecraft between its last two states."""

    def __init__(self) -> None:
        self._states: list[tuple[int, FloatArray]] = []

    def add(self, time: int, state_itrf: FloatArray | None) -> None:
        if state_itrf is None:
            self._states = []
            return
        self._states = [*self._states[-1:], (time, state_itrf)]

    def positions(self, time: npt.NDArray[np.int64]) -> FloatArray:
        """Return the positions at times (n,), shape (n, 3); NaN where nothing is known."""
        if not self._states:
            return np.full((len(time), 3), np.nan)
        end, last = self._states[-1]
        seconds = (time - end) / NANOSECONDS_PER_SECOND
        if len(self._states) == 1:
            return np.asarray(last[:3] + seconds[:, np.newaxis] * last[3:])
        begin, first = self._states[0]
        spline = CubicHermiteSpline(
            [(begin - end) / NANOSECONDS_PER_SECOND, 0.0],
            [first[:3], last[:3]],
            [first[3:], last[3:]],
        )
        return np.asarray(spline(seconds))


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
        self._generation: dict[int, tuple[tuple[float, float], int]] = {}
        self._average = SecondAverage(_FEWEST_SAMPLES)
        self._density = ElectronDensityEstimator(settings.density)
        frequencies = carrier_frequency_hz([SYSTEM_GPS] * 2, settings.density_bands)
        self._frequencies = (float(frequencies[0]), float(frequencies[1]))

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take a broadcast ephemeris that either receiver has decoded."""
        for spacecraft in self.spacecraft:
            spacecraft.add_ephemeris(ephemeris)

    def process(self, second: FormationSecond) -> FormationResult:
        """Take the next second in."""
        results, positions = [], []
        for spacecraft, track, block, state in zip(
            self.spacecraft, self._tracks, second.observations, second.states_itrf, strict=True
        ):
            track.add(second.time, state)
            position = track.positions(block.time)
            results.append(spacecraft.process(block, position))
            positions.append(position)
        chief, deputy = results
        integers = self._datum.update(second.integers)
        density = tuple(self._densities(second, (chief, deputy), integers))
        return FormationResult((chief, deputy), density)

    # ---- density -----------------------------------------------------------------------------

    def _densities(
        self,
        second: FormationSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        integers: Mapping[tuple[Group, int], float],
    ) -> list[DensityResult]:
        time, satellite, columns = self._differences(second, results, integers)
        found = []
        for middle, satellites, means, samples in self._average.update(time, satellite, columns):
            result = self._density_of(round(middle), satellites, means, samples, results[0])
            if result is not None:
                found.append(result)
        return found

    def _differences(
        self,
        second: FormationSecond,
        results: tuple[SpacecraftResult, SpacecraftResult],
        integers: Mapping[tuple[Group, int], float],
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], dict[str, FloatArray]]:
        """Return times, satellites and differential contents; both signals must have integers."""
        keys, usable = [], []
        for craft, result in zip(self.spacecraft, results, strict=True):
            rows = result.rows
            number = np.array([self._link_key(link) for link in craft.links] + [-1])
            key = number[rows.pairs.link] if len(rows) else np.zeros(0, dtype=np.int64)
            good = (key >= 0) & (rows.arc > 0) & ((rows.rejected & _NO_PHASE) == 0)
            good &= self._in_last_arc(rows)
            keys.append(((rows.pairs.time - second.time) << 24) + key)
            usable.append(np.flatnonzero(good))
        common, one, other = np.intersect1d(
            keys[0][usable[0]], keys[1][usable[1]], return_indices=True
        )
        row_chief, row_deputy = usable[0][one], usable[1][other]
        unique, place = np.unique(common & 0xFFFFFF, return_inverse=True)
        # Columns: integers of both signals, number of satellite and integers; NaN without.
        table = np.array([self._numbered(key, integers) for key in unique.tolist()])
        table = table.reshape(-1, 3)[place]
        fixed = np.isfinite(table[:, 0])
        row_chief, row_deputy, table = row_chief[fixed], row_deputy[fixed], table[fixed]
        phases = []
        for name in ("row_first", "row_second"):
            rows_both = [
                getattr(result.rows.pairs, name)[row]
                for result, row in zip(results, (row_chief, row_deputy), strict=True)
            ]
            chief_phase, deputy_phase = (
                block.columns["carrier_phase_cycles"][rows]
                for block, rows in zip(second.observations, rows_both, strict=True)
            )
            phases.append(deputy_phase - chief_phase)
        stec = differential_stec(*phases, table[:, 0], table[:, 1], *self._frequencies)
        time = results[0].rows.pairs.time[row_chief]
        columns = {
            "stec": stec,
            "elevation_chief": results[0].rows.elevation[row_chief],
            "elevation_deputy": results[1].rows.elevation[row_deputy],
        }
        return time, table[:, 2].astype(np.int64), columns

    def _link_key(self, link: Link) -> int:
        """Return prn and attributes of a link of the density bands as one number, else -1."""
        if (
            link.system != SYSTEM_GPS
            or (link.band_first, link.band_second) != self._settings.density_bands
        ):
            return -1
        return link.prn << 16 | ord(link.attribute_first) << 8 | ord(link.attribute_second)

    @staticmethod
    def _in_last_arc(rows: SlantTecRows) -> npt.NDArray[np.bool_]:
        """Return which rows are of the arc that their link has at its last sample."""
        if not len(rows):
            return np.zeros(0, dtype=bool)
        latest = np.full(int(rows.pairs.link.max()) + 2, -1, dtype=np.int64)
        latest[rows.pairs.link] = rows.arc  # the last one stays
        return np.asarray(latest[rows.pairs.link] == rows.arc)

    def _numbered(
        self, key: int, integers: Mapping[tuple[Group, int], float]
    ) -> tuple[float, float, float]:
        """Return the integers of a link and a number that changes with them; NaN without any.

        No mean may span two integers.
        """
        prn, first, second = key >> 16, key >> 8 & 0xFF, key & 0xFF
        one, two = self._settings.density_bands
        pair = (
            integers.get(((SYSTEM_GPS, one, first), prn), math.nan),
            integers.get(((SYSTEM_GPS, two, second), prn), math.nan),
        )
        if not math.isfinite(pair[0] + pair[1]):
            return math.nan, math.nan, math.nan
        known = self._generation.get(prn)
        if known is None or known[0] != pair:
            known = (pair, 0 if known is None else known[1] + 1)
            self._generation[prn] = known
        return *pair, float(prn + _GENERATION * known[1])

    def _density_of(
        self,
        time: int,
        satellites: npt.NDArray[np.int64],
        means: dict[str, FloatArray],
        samples: npt.NDArray[np.int64],
        chief: SpacecraftResult,
    ) -> DensityResult | None:
        when = np.array([time])
        places = np.concatenate([track.positions(when) for track in self._tracks])
        if not np.isfinite(places).all() or not len(satellites):
            return None
        altitudes = geodetic_from_itrf(places)[:, 2]
        if self._datum.number != self._datum_number:
            self._datum_number = self._datum.number
            self._density.reset_bias()
        one_sample = 2.0 * self._settings.carrier_phase_sigma * tecu_per_metre(*self._frequencies)
        epoch = self._density.update(
            time / NANOSECONDS_PER_SECOND,
            float(altitudes[0]),
            float(altitudes[1]),
            means["elevation_chief"],
            means["elevation_deputy"],
            means["stec"],
            one_sample / np.sqrt(samples),
            _vertical_content(chief),
        )
        return DensityResult(
            time=time,
            position_itrf=places.mean(axis=0),
            system=np.full(len(satellites), SYSTEM_GPS),
            prn=satellites % _GENERATION,
            epoch=epoch,
        )


def _vertical_content(result: SpacecraftResult) -> float:
    """Return the vertical content above a spacecraft from its high satellites, TECU; else NaN."""
    epoch = result.epoch
    if epoch is None:
        return math.nan
    good = (epoch.rejected == 0) & (epoch.elevation > _VTEC_ELEVATION)
    return float(np.median(epoch.vtec_tecu[good])) if good.any() else math.nan

"""The ionosphere above one spacecraft, block by block: the same online and from a recording.

A block is what the receiver has measured in a short time, a second as a rule. Contents, arcs and
scintillation go through the same code whatever the length of the blocks; the receiver bias is
estimated anew at fixed times, from what is known by then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_iono.bias.bias_samples import BiasSamples, ReceiverBiasError
from vtff_iono.bias.code_biases import CodeBiasTable, broadcast_code_biases
from vtff_iono.bias.receiver_bias import ReceiverBias, content_sigma, estimate_receiver_biases
from vtff_iono.content.rate_of_tec import RateOfTecMonitor, RateOfTecWindow
from vtff_iono.content.slant_tec import Rejection, SlantTecProcessor, SlantTecRows, SlantTecSettings
from vtff_iono.geometry.satellite_geometry import SatelliteGeometry, geometry_from_stores
from vtff_iono.geometry.vertical_mapping import VerticalMapping, vertical_mapping
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, SignalPair
from vtff_iono.scintillation.indices import (
    ScintillationMonitor,
    ScintillationSettings,
    ScintillationWindow,
)

__all__ = [
    "ObservationBlock",
    "PreparedBlock",
    "SlantTecEpoch",
    "SpacecraftIonosphere",
    "SpacecraftResult",
    "SpacecraftSettings",
]

Columns = dict[str, npt.NDArray]  # type: ignore[type-arg]

_UNKNOWN = (math.nan, math.nan)
# With one of these a content says nothing of the receiver bias.
_NOT_FOR_BIAS = np.uint16(
    0xFFFF - Rejection.CODE_OUTLIER - Rejection.CODE_INVALID - Rejection.NO_RECEIVER_BIAS
)
# The first estimates may be weak: they are repeated when the samples have grown by this part.
_BIAS_GROWTH = 0.1
_BIAS_SAMPLE_INTERVAL = 20 * NANOSECONDS_PER_SECOND


@dataclass(frozen=True)
class SpacecraftSettings:
    """How the observations of one spacecraft are processed.

    Parameters
    ----------
    slant_tec : SlantTecSettings
    scintillation : ScintillationSettings
    roti_interval : float
        s between the contents whose rate ROTI is formed of.
    pairs : sequence of SignalPair
    bias_interval, bias_delay : float
        s between estimates of the receiver biases at most, and from the first observation to the
        first. In between they follow whenever there are a tenth more samples.
    """

    slant_tec: SlantTecSettings = SlantTecSettings()
    scintillation: ScintillationSettings = ScintillationSettings()
    roti_interval: float = 1.0
    pairs: Sequence[SignalPair] = DEFAULT_PAIRS
    bias_interval: float = 300.0
    bias_delay: float = 600.0


@dataclass(frozen=True, eq=False)
class ObservationBlock:
    """Whole epochs of one receiver; arrays of shape (n,), one row an observation.

    Parameters
    ----------
    time : ndarray of int64
        GPS time, ns since 1980-01-06, not decreasing.
    columns : dict of str to ndarray
        Columns of `vtff_gnss.observations.OBSERVATION_COLUMNS`.
    """

    time: npt.NDArray[np.int64]
    columns: Columns


@dataclass(frozen=True, eq=False)
class PreparedBlock:
    """A block with what does not depend on receiver biases.

    Parameters
    ----------
    block : ObservationBlock
    position_itrf : ndarray, shape (n, 3)
    geometry : SatelliteGeometry
        Of all observations.
    rows : SlantTecRows
    epoch_rows : ndarray of int, shape (m,)
        Rows of the last epoch that have a link.
    vertical : VerticalMapping
        Of these.
    """

    block: ObservationBlock
    position_itrf: FloatArray
    geometry: SatelliteGeometry
    rows: SlantTecRows
    epoch_rows: npt.NDArray[np.intp]
    vertical: VerticalMapping


@dataclass(frozen=True, eq=False)
class SlantTecEpoch:
    """Absolute contents of one epoch; arrays of shape (m,), as in ``vtff_msgs/SlantTec``.

    Parameters
    ----------
    time : int
        GPS time, ns since 1980-01-06.
    links : list of Link
        Of each row.
    stec_tecu, stec_sigma_tecu, stec_code_tecu, vtec_tecu : ndarray
        All known biases removed.
    elevation, azimuth, pierce_latitude, pierce_longitude : ndarray
        rad.
    arc : ndarray of int64
    rejected : ndarray of uint16
        `Rejection`.
    """

    time: int
    links: list[Link]
    stec_tecu: FloatArray
    stec_sigma_tecu: FloatArray
    stec_code_tecu: FloatArray
    vtec_tecu: FloatArray
    elevation: FloatArray
    azimuth: FloatArray
    pierce_latitude: FloatArray
    pierce_longitude: FloatArray
    arc: npt.NDArray[np.int64]
    rejected: npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class SpacecraftResult:
    """What a block has told.

    Parameters
    ----------
    rows : SlantTecRows
        All epochs, receiver biases not removed.
    direction_itrf : ndarray, shape (n, 3)
        Unit vectors to the satellites of all observations.
    epoch : SlantTecEpoch or None
        The last one of the block; None without observations.
    scintillation : tuple of (ScintillationWindow, ndarray)
        Windows that have ended, and ROTI of their signals, TECU/min, shape (m,).
    """

    rows: SlantTecRows
    direction_itrf: FloatArray
    epoch: SlantTecEpoch | None
    scintillation: tuple[tuple[ScintillationWindow, FloatArray], ...]


@dataclass
class _BiasData:
    """Samples for the receiver bias, levelled anew whenever their arcs are."""

    time: list[FloatArray] = field(default_factory=list)
    link: list[npt.NDArray[np.int64]] = field(default_factory=list)
    arc: list[npt.NDArray[np.int64]] = field(default_factory=list)
    stec_phase_tecu: list[FloatArray] = field(default_factory=list)
    elevation: list[FloatArray] = field(default_factory=list)
    direction: list[FloatArray] = field(default_factory=list)
    position: list[FloatArray] = field(default_factory=list)
    # Level, its sigma and that of the satellite bias of (link, arc), TECU.
    levels: dict[tuple[int, int], tuple[float, float, float]] = field(default_factory=dict)


class SpacecraftIonosphere:
    """Slant contents, scintillation and the receiver bias of one spacecraft.

    Parameters
    ----------
    settings : SpacecraftSettings
    code_biases : CodeBiasTable, optional
        Satellite biases; those that the ephemerides tell by default.

    Attributes
    ----------
    receiver_biases : dict of (system, code, code) to ReceiverBias
        The latest estimates.
    """

    def __init__(
        self,
        settings: SpacecraftSettings = SpacecraftSettings(),  # noqa: B008 - frozen
        code_biases: CodeBiasTable | None = None,
    ) -> None:
        self._settings = settings
        self._given_biases = code_biases
        self._code_biases = code_biases or CodeBiasTable(())
        self._ephemerides: dict[int, list[BroadcastEphemeris]] = {}
        self._stores: dict[int, EphemerisStore] = {}
        self._processor = SlantTecProcessor(
            self._satellite_bias,
            lambda link, time: _UNKNOWN,
            settings.slant_tec,
            pairs=settings.pairs,
        )
        self._scintillation = ScintillationMonitor(settings.scintillation)
        self._roti = RateOfTecMonitor(settings.roti_interval, settings.scintillation.window)
        self._bias_data = _BiasData()
        self._bias_start: int | None = None
        self._bias_due = 0
        self.receiver_biases: dict[tuple[int, str, str], ReceiverBias] = {}

    @property
    def links(self) -> list[Link]:
        """Links seen so far; their numbers are indices of this list."""
        return self._processor.links

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take a broadcast ephemeris; repetitions cost nothing."""
        known = self._ephemerides.setdefault(ephemeris.system, [])
        if ephemeris in known:
            return
        known.append(ephemeris)
        # An unhealthy satellite is where it says, and its signals pass the same ionosphere.
        self._stores[ephemeris.system] = EphemerisStore(known, healthy_only=False)
        if self._given_biases is None:
            everything = [
                e for system in sorted(self._ephemerides) for e in self._ephemerides[system]
            ]
            self._code_biases = broadcast_code_biases(everything)

    def process(self, block: ObservationBlock, position_itrf: FloatArray) -> SpacecraftResult:
        """Take the next block in.

        Parameters
        ----------
        block : ObservationBlock
        position_itrf : ndarray, shape (n, 3)
            Of the antenna at the time of each row, m; NaN where unknown.
        """
        return self.process_prepared(self.prepare([block], [position_itrf])[0])

    def prepare(
        self, blocks: Sequence[ObservationBlock], positions_itrf: Sequence[FloatArray]
    ) -> list[PreparedBlock]:
        """Take the next blocks in, as far as that can be done for all of them at once.

        Of many short blocks most of the time goes into the calls; here they are one. The results
        have the same bytes. `process_prepared` is to be called with each in its order.

        Parameters
        ----------
        blocks, positions_itrf : sequence
            As for `process`; ephemerides must not come between the blocks.
        """
        time = np.concatenate([block.time for block in blocks])
        columns = {
            name: np.concatenate([block.columns[name] for block in blocks])
            for name in blocks[0].columns
        }
        position = np.concatenate(positions_itrf)
        geometry = geometry_from_stores(
            self._stores, time, columns["system"], columns["prn"], position
        )
        rows = self._processor.update(time, columns, geometry.elevation)
        observation = np.cumsum([0, *(len(block.time) for block in blocks)])
        row = np.searchsorted(rows.pairs.row_first, observation)
        has_rows = row[1:] > row[:-1]
        end = np.full(len(rows), -1, dtype=np.int64)
        for first, last in zip(row[:-1][has_rows], row[1:][has_rows], strict=True):
            end[first:last] = rows.pairs.time[last - 1]
        of_epoch = np.flatnonzero((rows.pairs.time == end) & (rows.pairs.link >= 0))
        sight = rows.pairs.row_first[of_epoch]
        vertical = vertical_mapping(
            position[sight], geometry.direction_itrf[sight], rows.elevation[of_epoch]
        )
        edge = np.searchsorted(of_epoch, row)
        return [
            PreparedBlock(
                block=block,
                position_itrf=place,
                geometry=geometry.part(observation[i], observation[i + 1]),
                rows=rows.part(row[i], row[i + 1], observation[i]),
                epoch_rows=of_epoch[edge[i] : edge[i + 1]] - row[i],
                vertical=vertical.part(edge[i], edge[i + 1]),
            )
            for i, (block, place) in enumerate(zip(blocks, positions_itrf, strict=True))
        ]

    def process_prepared(self, prepared: PreparedBlock) -> SpacecraftResult:
        """Return what a block tells: the rest of `process`."""
        block, geometry, rows = prepared.block, prepared.geometry, prepared.rows
        roti = list(self._roti.update(rows))
        windows = self._scintillation.update(
            block.time, block.columns, geometry.elevation, geometry.azimuth
        )
        scintillation = tuple((window, self._roti_of(window, roti)) for window in windows)
        epoch = None
        if len(rows):
            last = rows.pairs.time == rows.pairs.time[-1]
            self._collect(rows, geometry, prepared.position_itrf, last)
            epoch = self._epoch(prepared)
        return SpacecraftResult(rows, geometry.direction_itrf, epoch, scintillation)

    def _satellite_bias(self, link: Link, time: GpsTime) -> tuple[float, float]:
        return self._code_biases.satellite_bias(
            link.system, link.prn, link.code_first, link.code_second, time
        )

    def _roti_of(self, window: ScintillationWindow, windows: list[RateOfTecWindow]) -> FloatArray:
        """Return ROTI of the signals of a scintillation window: that of their first pair."""
        values: dict[tuple[int, ...], float] = {}
        for other in windows:
            if other.time != window.time:
                continue
            for number, roti in zip(other.link.tolist(), other.roti_tecu_per_minute, strict=True):
                link = self.links[number]
                for band, attribute in (
                    (link.band_first, link.attribute_first),
                    (link.band_second, link.attribute_second),
                ):
                    values.setdefault((link.system, link.prn, band, ord(attribute)), float(roti))
        signals = zip(
            *(getattr(window, n).tolist() for n in ("system", "prn", "band", "attribute")),
            strict=True,
        )
        return np.array([values.get(signal, math.nan) for signal in signals])

    # ---- receiver bias -----------------------------------------------------------------------

    def _collect(
        self,
        rows: SlantTecRows,
        geometry: SatelliteGeometry,
        position_itrf: FloatArray,
        last: npt.NDArray[np.bool_],
    ) -> None:
        """Keep samples of the last epoch for the receiver bias, and estimate it when it is time."""
        time = int(rows.pairs.time[-1])
        if self._bias_start is None:
            self._bias_start = time
            self._bias_due = time + round(self._settings.bias_delay * NANOSECONDS_PER_SECOND)
        kept = self._bias_data
        good = last & ((rows.rejected & _NOT_FOR_BIAS) == 0) & np.isfinite(rows.stec_tecu)
        for row in np.flatnonzero(good).tolist():
            level = float(rows.stec_tecu[row] - rows.stec_phase_tecu[row])
            key = (int(rows.pairs.link[row]), int(rows.arc[row]))
            kept.levels[key] = (
                level,
                float(rows.stec_sigma_tecu[row]),
                float(rows.satellite_bias_sigma_tecu[row]),
            )
        if time % _BIAS_SAMPLE_INTERVAL == 0 and good.any():
            first = rows.pairs.row_first[good]
            kept.time.append(np.full(len(first), 1e-9 * time))
            kept.link.append(rows.pairs.link[good])
            kept.arc.append(rows.arc[good])
            kept.stec_phase_tecu.append(rows.stec_phase_tecu[good])
            kept.elevation.append(rows.elevation[good])
            kept.direction.append(geometry.direction_itrf[first])
            kept.position.append(position_itrf[first])
        if time >= self._bias_due:
            interval = round(self._settings.bias_interval * NANOSECONDS_PER_SECOND)
            growth = round(_BIAS_GROWTH * (time - self._bias_start))
            self._bias_due = time + min(interval, max(growth, _BIAS_SAMPLE_INTERVAL))
            self._estimate_biases()

    def _estimate_biases(self) -> None:
        kept = self._bias_data
        if not kept.time:
            return
        link, arc = np.concatenate(kept.link), np.concatenate(kept.arc)
        levels = np.array(
            [kept.levels[key] for key in zip(link.tolist(), arc.tolist(), strict=True)]
        )
        keys = [(one.system, one.code_first, one.code_second) for one in self.links]
        groups = sorted({keys[number] for number in np.unique(link).tolist()})
        place = np.array([groups.index(key) if key in groups else -1 for key in keys])
        samples = BiasSamples(
            time=np.concatenate(kept.time),
            group=place[link],
            stec_tecu=np.concatenate(kept.stec_phase_tecu) + levels[:, 0],
            stec_sigma_tecu=levels[:, 1],
            elevation=np.concatenate(kept.elevation),
            direction_itrf=np.concatenate(kept.direction),
            position_receiver_itrf=np.concatenate(kept.position),
            arc=link << 32 | arc,
            link=link,
            satellite_sigma_tecu=levels[:, 2],
        )
        try:
            biases = estimate_receiver_biases(samples)
        except ReceiverBiasError:
            return
        self.receiver_biases = dict(zip(groups, biases, strict=True))

    # ---- absolute contents -------------------------------------------------------------------

    def _epoch(self, prepared: PreparedBlock) -> SlantTecEpoch:
        """Return the contents of the last epoch, known receiver biases removed."""
        rows, chosen = prepared.rows, prepared.epoch_rows
        links = [self.links[number] for number in rows.pairs.link[chosen].tolist()]
        keys = [(link.system, link.code_first, link.code_second) for link in links]
        known = [self.receiver_biases.get(key) for key in keys]
        bias = np.array([0.0 if one is None else one.bias_tecu for one in known])
        sigma = content_sigma(
            rows.stec_sigma_tecu[chosen],
            rows.satellite_bias_sigma_tecu[chosen],
            known,
            np.arange(len(known)),
        )
        rejected = rows.rejected[chosen] & np.where(
            [one is None for one in known],
            np.uint16(0xFFFF),
            np.uint16(0xFFFF - Rejection.NO_RECEIVER_BIAS),
        ).astype(np.uint16)
        stec = rows.stec_tecu[chosen] - bias
        return SlantTecEpoch(
            time=int(rows.pairs.time[-1]),
            links=links,
            stec_tecu=stec,
            stec_sigma_tecu=sigma,
            stec_code_tecu=rows.stec_code_tecu[chosen] - bias,
            vtec_tecu=stec / prepared.vertical.factor,
            elevation=rows.elevation[chosen],
            azimuth=prepared.geometry.azimuth[rows.pairs.row_first[chosen]],
            pierce_latitude=prepared.vertical.pierce_latitude,
            pierce_longitude=prepared.vertical.pierce_longitude,
            arc=rows.arc[chosen],
            rejected=rejected,
        )

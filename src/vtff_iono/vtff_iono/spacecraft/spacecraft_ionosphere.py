"""The ionosphere above one spacecraft, block by block.

A block holds the epochs that the receiver has measured in a short time, a second as a rule.
Contents, arcs and scintillation do not depend on the length of the blocks. The receiver biases are
estimated anew at fixed times, from the samples of the last hours before.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore, validity_interval
from vtff_gnss.signals import SignalKey
from vtff_iono.bias.bias_samples import ReceiverBiasError
from vtff_iono.bias.code_biases import CodeBiasTable, broadcast_code_biases
from vtff_iono.bias.profile_bias import ProfileBiases
from vtff_iono.bias.receiver_bias import ReceiverBias, content_sigma, estimate_receiver_biases
from vtff_iono.content.rate_of_tec import RateOfTecMonitor, RateOfTecWindow
from vtff_iono.content.slant_tec import Rejection, SlantTecProcessor, SlantTecRows, SlantTecSettings
from vtff_iono.geometry.satellite_geometry import SatelliteGeometry, geometry_from_stores
from vtff_iono.geometry.vertical_mapping import vertical_mapping
from vtff_iono.geometry.wind_up import WindUpCounter, wind_up_cycles
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, SignalPair
from vtff_iono.scintillation.indices import (
    ScintillationMonitor,
    ScintillationSettings,
    ScintillationWindow,
)
from vtff_iono.spacecraft.arc_offsets import ArcContents, ArcOffsets
from vtff_iono.spacecraft.bias_sample_window import (
    BIAS_SAMPLE_INTERVAL,
    BiasGroup,
    BiasSampleWindow,
    bias_group,
)

__all__ = [
    "ObservationBlock",
    "SlantTecEpoch",
    "SpacecraftIonosphere",
    "SpacecraftResult",
    "SpacecraftSeries",
    "SpacecraftSettings",
]

Columns = dict[str, npt.NDArray[Any]]

_UNKNOWN = (math.nan, math.nan)
# The first estimates may be weak: they are repeated when the time of the samples has grown by this
# fraction.
_BIAS_GROWTH = 0.1
# ns after the end of its validity for which an ephemeris is kept. Satellite biases are those of the
# beginning of an hour, so that an hour is needed.
_EPHEMERIS_KEPT = 7200 * NANOSECONDS_PER_SECOND


@dataclass(frozen=True)
class SpacecraftSettings:
    """Settings of the processing of a spacecraft's observations.

    Parameters
    ----------
    slant_tec : SlantTecSettings
    scintillation : ScintillationSettings
    roti_interval : float
        Time between the contents that the rates of ROTI are formed of, s.
    pairs : sequence of SignalPair
        Pairs of signals that are used.
    bias_interval : float
        Longest time between estimates of the receiver biases, s. The first estimates follow each
        other faster: whenever the time of the samples has grown by a tenth.
    bias_delay : float
        Time from the first observation to the first estimate of the receiver biases, s.
    bias_window : float
        Age of the oldest samples that the receiver biases are estimated from, s.
    """

    slant_tec: SlantTecSettings = SlantTecSettings()
    scintillation: ScintillationSettings = ScintillationSettings()
    roti_interval: float = 1.0
    pairs: Sequence[SignalPair] = DEFAULT_PAIRS
    bias_interval: float = 120.0
    bias_delay: float = 600.0
    bias_window: float = 4.0 * 3600.0


@dataclass(frozen=True, eq=False)
class ObservationBlock:
    """Whole epochs of one receiver; arrays of shape (n,), one row for each observation.

    Parameters
    ----------
    time : ndarray of int64
        GPS time, ns since 1980-01-06, not decreasing.
    columns : dict of str to ndarray
        Columns of `vtff_gnss.observations.OBSERVATION_COLUMNS`.
    """

    time: npt.NDArray[np.int64]
    columns: Columns

    @classmethod
    def join(cls, blocks: Sequence[ObservationBlock]) -> ObservationBlock:
        """Return the observations of one or more blocks, which follow each other in time."""
        if len(blocks) == 1:
            return blocks[0]
        return cls(
            np.concatenate([block.time for block in blocks]),
            {
                name: np.concatenate([block.columns[name] for block in blocks])
                for name in blocks[0].columns
            },
        )


@dataclass(frozen=True, eq=False)
class SlantTecEpoch:
    """Absolute contents of one epoch; arrays of shape (m,), as in ``vtff_msgs/SlantTec``.

    Parameters
    ----------
    time : int
        GPS time, ns since 1980-01-06.
    links : list of Link
        Link of each row.
    stec_tecu, stec_sigma_tecu, stec_code_tecu, vtec_tecu : ndarray
        Contents and sigma, TECU; the biases of satellites and receiver are removed where they are
        known.
    elevation, azimuth, pierce_latitude, pierce_longitude : ndarray
        Angles, rad.
    arc : ndarray of int64
        Number of the arc within its link.
    rejected : ndarray of uint16
        Bits of `Rejection`; 0 for a good content.
    vertical_sigma_tecu : float
        Sigma of the vertical content that is not of one layer, TECU; zero until the samples have
        shown it.
    gradient_sigma : ndarray, shape (2,)
        Sigmas of the gradients of the vertical content to the east and north that the samples have
        shown, TECU/m; NaN until they have.
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
    vertical_sigma_tecu: float
    gradient_sigma: FloatArray


@dataclass(frozen=True, eq=False)
class SpacecraftResult:
    """Results of one block.

    Parameters
    ----------
    rows : SlantTecRows
        Contents of all epochs, receiver biases not removed.
    direction_itrf : ndarray, shape (n, 3)
        Unit vectors to the satellites of all observations.
    range : ndarray, shape (n,)
        Distances of the satellites of all observations, m; NaN where unknown.
    epoch : SlantTecEpoch or None
        Contents of the last epoch of the block; None without observations.
    scintillation : tuple of (ScintillationWindow, ndarray)
        Windows that have ended, and ROTI of their signals, TECU/min, shape (m,).
    """

    rows: SlantTecRows
    direction_itrf: FloatArray
    range: FloatArray
    epoch: SlantTecEpoch | None
    scintillation: tuple[tuple[ScintillationWindow, FloatArray], ...]


@dataclass(frozen=True, eq=False)
class SpacecraftSeries:
    """Observations and results of k blocks that follow each other.

    Parameters
    ----------
    block : ObservationBlock
        All observations.
    position_itrf : ndarray, shape (n, 3)
        Position of the antenna at each observation, m; NaN where unknown.
    rows : SlantTecRows
        Contents of all blocks.
    first_observation, first_row : ndarray of int64, shape (k + 1,)
        Where the observations and the rows of each block begin; last their numbers.
    results : list of SpacecraftResult
        Results of each block.
    """

    block: ObservationBlock
    position_itrf: FloatArray
    rows: SlantTecRows
    first_observation: npt.NDArray[np.int64]
    first_row: npt.NDArray[np.int64]
    results: list[SpacecraftResult]


class SpacecraftIonosphere:
    """Slant contents, scintillation and the receiver bias of one spacecraft.

    Parameters
    ----------
    settings : SpacecraftSettings
    code_biases : CodeBiasTable, optional
        Satellite biases; by default those that the ephemerides contain.

    Attributes
    ----------
    receiver_biases : dict of BiasGroup to ReceiverBias
        The latest estimates.
    bias_error : str or None
        Why the latest estimate of the receiver biases has failed; None if it has not failed.
    """

    def __init__(
        self,
        settings: SpacecraftSettings = SpacecraftSettings(),  # noqa: B008 - frozen
        code_biases: CodeBiasTable | None = None,
    ) -> None:
        self._settings = settings
        self._given_biases = code_biases
        self._code_biases = code_biases or CodeBiasTable(())
        # The keys of a dictionary keep their order.
        self._ephemerides: dict[int, dict[BroadcastEphemeris, None]] = {}
        self._changed_systems: set[int] = set()
        self._newest = 0
        self._stores: dict[int, EphemerisStore] = {}
        self._processor = SlantTecProcessor(
            self._satellite_bias,
            lambda link, time: _UNKNOWN,
            settings.slant_tec,
            pairs=settings.pairs,
        )
        self._scintillation = ScintillationMonitor(settings.scintillation)
        self._roti = RateOfTecMonitor(settings.roti_interval, settings.scintillation.window)
        self._bias_samples = BiasSampleWindow(settings.bias_window)
        self._arc_offsets = ArcOffsets()
        self._wind_up = WindUpCounter()
        self._profile: ProfileBiases | None = None
        self._vertical_sigma_tecu = 0.0
        self._gradient_sigma = np.full(2, np.nan)
        self._bias_start: int | None = None
        self._bias_due = 0
        self.receiver_biases: dict[BiasGroup, ReceiverBias] = {}
        self.bias_error: str | None = None

    @property
    def links(self) -> list[Link]:
        """Links observed so far; the number of a link is its index in this list."""
        return self._processor.links

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Add a broadcast ephemeris; one that was added before is ignored at once."""
        ephemerides = self._ephemerides.setdefault(ephemeris.system, {})
        if ephemeris not in ephemerides:
            ephemerides[ephemeris] = None
            self._changed_systems.add(ephemeris.system)

    def _take_new_ephemerides(self) -> None:
        """Renew orbits and satellite biases if ephemerides were added since the last block.

        Ephemerides come in tens at the beginning of an hour, so that one renewal serves them all.
        """
        if not self._changed_systems:
            return
        self._forget_expired_ephemerides()
        for system in self._changed_systems:
            # The orbit of an unhealthy satellite is usable here, and its signals pass the same
            # ionosphere.
            self._stores[system] = EphemerisStore(self._ephemerides[system], healthy_only=False)
        self._changed_systems.clear()
        if self._given_biases is None:
            self._code_biases = broadcast_code_biases(
                [e for system in sorted(self._ephemerides) for e in self._ephemerides[system]]
            )

    def _forget_expired_ephemerides(self) -> None:
        """Forget the ephemerides that ended long before the newest observation."""
        oldest = self._newest - _EPHEMERIS_KEPT
        for system, ephemerides in self._ephemerides.items():
            self._ephemerides[system] = {
                e: None for e in ephemerides if validity_interval(e)[1].nanoseconds >= oldest
            }

    def process(
        self, blocks: Sequence[ObservationBlock], position_itrf: FloatArray
    ) -> SpacecraftSeries:
        """Process the next blocks and return their results.

        Several blocks at once have the results that they have one after the other, for less time.

        Parameters
        ----------
        blocks : sequence of ObservationBlock
            One or more.
        position_itrf : ndarray, shape (n, 3)
            Position of the antenna at the time of each row of all blocks, m; NaN where unknown.
        """
        self._take_new_ephemerides()
        block = ObservationBlock.join(blocks)
        columns = block.columns
        if len(block.time):
            self._newest = int(block.time[-1])
        geometry = geometry_from_stores(
            self._stores, block.time, columns["system"], columns["prn"], position_itrf
        )
        rows = self._processor.update(block.time, columns, geometry.elevation)
        roti = list(self._roti.update(rows))
        windows = self._scintillation.update(
            block.time, columns, geometry.elevation, geometry.azimuth
        )
        first_observation = np.cumsum([0, *(len(of_block.time) for of_block in blocks)])
        scintillation: list[list[tuple[ScintillationWindow, FloatArray]]] = [[] for _ in blocks]
        for window in windows:
            # The first observation after a window ends it.
            ending = np.searchsorted(block.time, window.time)
            number = int(np.searchsorted(first_observation, ending, "right")) - 1
            scintillation[number].append((window, self._roti_of_signals(window, roti)))
        # Rows are in the order of their first observations, epoch by epoch.
        block_of_row = np.searchsorted(first_observation[1:], rows.pairs.row_first, "right")
        first_row = np.searchsorted(block_of_row, np.arange(len(blocks) + 1))
        parts = [rows]
        if len(blocks) > 1:
            parts = rows.parts(first_row.tolist(), first_observation[:-1])
        results = [
            SpacecraftResult(
                part,
                geometry.direction_itrf[begin:end],
                geometry.range[begin:end],
                epoch,
                tuple(of_block),
            )
            for part, (begin, end), epoch, of_block in zip(
                parts,
                itertools.pairwise(first_observation.tolist()),
                self._last_epochs(rows, first_row, geometry, position_itrf),
                scintillation,
                strict=True,
            )
        ]
        return SpacecraftSeries(block, position_itrf, rows, first_observation, first_row, results)

    def _satellite_bias(self, link: Link, time: GpsTime) -> tuple[float, float]:
        return self._code_biases.satellite_bias(
            link.system, link.prn, link.code_first, link.code_second, time
        )

    def _roti_of_signals(
        self, window: ScintillationWindow, roti_windows: list[RateOfTecWindow]
    ) -> FloatArray:
        """Return ROTI of the signals of a scintillation window, from the first pair of each."""
        values: dict[SignalKey, float] = {}
        for roti_window in roti_windows:
            if roti_window.time != window.time:
                continue
            for number, roti in zip(
                roti_window.link.tolist(), roti_window.roti_tecu_per_minute, strict=True
            ):
                link = self.links[number]
                for band, attribute in (
                    (link.band_first, link.attribute_first),
                    (link.band_second, link.attribute_second),
                ):
                    signal = SignalKey(link.system, link.prn, band, ord(attribute))
                    values.setdefault(signal, float(roti))
        signals = zip(*(getattr(window, name).tolist() for name in SignalKey._fields), strict=True)
        return np.array([values.get(SignalKey(*signal), math.nan) for signal in signals])

    def _last_epochs(
        self,
        rows: SlantTecRows,
        first_row: npt.NDArray[np.int64],
        geometry: SatelliteGeometry,
        position_itrf: FloatArray,
    ) -> list[SlantTecEpoch | None]:
        """Return the contents of the last epoch of each block; None for a block without rows.

        The last epochs are added to the samples of the receiver biases on the way, and these are
        estimated where it is time: from that block on the new ones are removed.
        """
        blocks = np.flatnonzero(np.diff(first_row))
        last = first_row[blocks + 1] - 1
        time = rows.pairs.time
        first = np.searchsorted(time, time[last])
        wind_up = self._wind_up_tecu(rows, first, last, geometry, position_itrf)
        arguments = geometry.direction_itrf, position_itrf, wind_up
        found: list[SlantTecEpoch] = []
        begin = sampled = 0
        for index, now in enumerate(time[first].tolist()):
            if self._is_bias_due(now):
                chosen, new = slice(begin, index), slice(sampled, index + 1)
                found += self._epochs(
                    rows, first[chosen], last[chosen], geometry, position_itrf, wind_up
                )
                self._bias_samples.add_epochs(rows, first[new], last[new], *arguments)
                begin, sampled = index, index + 1
                self._estimate_biases()
        self._bias_samples.add_epochs(rows, first[sampled:], last[sampled:], *arguments)
        found += self._epochs(rows, first[begin:], last[begin:], geometry, position_itrf, wind_up)
        epochs: list[SlantTecEpoch | None] = [None] * (len(first_row) - 1)
        for number, epoch in zip(blocks.tolist(), found, strict=True):
            epochs[number] = epoch
        return epochs

    def _wind_up_tecu(
        self,
        rows: SlantTecRows,
        first: npt.NDArray[np.int64],
        last: npt.NDArray[np.int64],
        geometry: SatelliteGeometry,
        position_itrf: FloatArray,
    ) -> FloatArray:
        """Return what the wind-up since arcs began looks like, TECU, (n,), zero between epochs.

        `first` and `last` are the rows of the epochs.
        """
        wind_up = np.zeros(len(rows))
        chosen, _ = _rows_of_epochs(rows, first, last)
        if not len(chosen):
            return wind_up
        observation = rows.pairs.row_first[chosen]
        cycles = wind_up_cycles(
            position_itrf[observation],
            geometry.direction_itrf[observation],
            geometry.range[observation],
            geometry.velocity_satellite_itrf[observation],
        )
        link = rows.pairs.link[chosen]
        tecu_per_cycle = np.array([of_link.tecu_per_cycle for of_link in self.links])[link]
        wind_up[chosen] = tecu_per_cycle * self._wind_up.count(link, rows.arc[chosen], cycles)
        return wind_up

    def _is_bias_due(self, time: int) -> bool:
        """Return whether the receiver biases are to be estimated at a time, ns."""
        if self._bias_start is None:
            self._bias_start = time
            self._bias_due = time + round(self._settings.bias_delay * NANOSECONDS_PER_SECOND)
        if time < self._bias_due:
            return False
        interval = round(self._settings.bias_interval * NANOSECONDS_PER_SECOND)
        growth = round(_BIAS_GROWTH * (time - self._bias_start))
        self._bias_due = time + min(interval, max(growth, BIAS_SAMPLE_INTERVAL))
        return True

    def _estimate_biases(self) -> None:
        """Estimate the receiver biases; an estimate that fails leaves the biases as they are."""
        try:
            groups, samples = self._bias_samples.collect(self.links)
            estimate = estimate_receiver_biases(samples, self._profile)
        except ReceiverBiasError as error:
            self.bias_error = str(error)
            return
        self.bias_error = None
        self.receiver_biases = dict(zip(groups, estimate.biases, strict=True))
        self._profile = profile = estimate.profile
        self._vertical_sigma_tecu = 0.0 if profile is None else profile.vertical_sigma_tecu
        self._gradient_sigma = np.full(2, np.nan) if profile is None else profile.gradient_sigma
        self._arc_offsets.renew(estimate.profile, self._bias_samples.levels())

    def _epochs(
        self,
        rows: SlantTecRows,
        first: npt.NDArray[np.int64],
        last: npt.NDArray[np.int64],
        geometry: SatelliteGeometry,
        position_itrf: FloatArray,
        wind_up_tecu: FloatArray,
    ) -> list[SlantTecEpoch]:
        """Return the contents of epochs from their first to their last rows.

        The receiver biases are removed where they are estimated; arcs have the levels that a
        density profile tells.
        """
        if not len(first):
            return []
        chosen, epoch_of_row = _rows_of_epochs(rows, first, last)
        edges = np.searchsorted(epoch_of_row, np.arange(len(first) + 1)).tolist()
        observation = rows.pairs.row_first[chosen]
        vertical = vertical_mapping(
            position_itrf[observation],
            geometry.direction_itrf[observation],
            rows.elevation[chosen],
        )
        number = rows.pairs.link[chosen]
        links = [self.links[index] for index in number.tolist()]
        biases = [self.receiver_biases.get(bias_group(link)) for link in self.links]
        bias_tecu = np.array([0.0 if bias is None else bias.bias_tecu for bias in biases])[number]
        sigma = content_sigma(
            rows.stec_sigma_tecu[chosen], rows.satellite_bias_sigma_tecu[chosen], biases, number
        )
        has_bias = np.array([bias is not None for bias in biases], dtype=bool)[number]
        arc = rows.arc[chosen]
        without_reason = rows.rejected[chosen] & ~np.uint16(Rejection.NO_RECEIVER_BIAS)
        rejected = np.where(has_bias, without_reason, rows.rejected[chosen])
        stec, sigma = self._arc_offsets.improve(
            ArcContents(
                rows.pairs.time[chosen],
                number,
                arc,
                rejected == 0,
                rows.stec_phase_tecu[chosen],
                wind_up_tecu[chosen],
                rows.stec_tecu[chosen] - bias_tecu,
                sigma,
                position_itrf[observation],
                geometry.direction_itrf[observation],
            )
        )
        stec_code = rows.stec_code_tecu[chosen] - bias_tecu
        vtec = stec / vertical.factor
        elevation, azimuth = rows.elevation[chosen], geometry.azimuth[observation]
        epochs = []
        for time, begin, end in zip(
            rows.pairs.time[first].tolist(), edges[:-1], edges[1:], strict=True
        ):
            part = slice(begin, end)
            epochs.append(
                SlantTecEpoch(
                    time=time,
                    links=links[part],
                    stec_tecu=stec[part],
                    stec_sigma_tecu=sigma[part],
                    stec_code_tecu=stec_code[part],
                    vtec_tecu=vtec[part],
                    elevation=elevation[part],
                    azimuth=azimuth[part],
                    pierce_latitude=vertical.pierce_latitude[part],
                    pierce_longitude=vertical.pierce_longitude[part],
                    arc=arc[part],
                    rejected=rejected[part],
                    vertical_sigma_tecu=self._vertical_sigma_tecu,
                    gradient_sigma=self._gradient_sigma,
                )
            )
        return epochs


def _rows_of_epochs(
    rows: SlantTecRows, first: npt.NDArray[np.int64], last: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the rows with a link from the first to the last ones of epochs, and their epochs."""
    counts = last + 1 - first
    starts = np.cumsum(counts) - counts
    chosen = np.arange(int(counts.sum())) + np.repeat(first - starts, counts)
    epoch_of_row = np.repeat(np.arange(len(first)), counts)
    is_link = rows.pairs.link[chosen] >= 0
    return chosen[is_link], epoch_of_row[is_link]

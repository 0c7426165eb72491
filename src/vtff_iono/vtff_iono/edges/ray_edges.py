"""Horizontal edges of irregularities, found ray by ray while the rays of a spacecraft cross them.

Three quantities of a ray show each second whether it crosses an irregularity: the variance of the
intensity relative to that of noise (S4), the spread of the rate of TEC (ROTI), and the gradient of
TEC. Vertical motion of the spacecraft changes the contents of all satellites alike, so that the
median of the rates, mapped to the vertical, is removed first.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import satellite_number
from vtff_iono.edges.boundary import Boundary, BoundaryKind, BoundarySource
from vtff_iono.edges.edge_detectors import (
    Edge,
    ExceedanceDetector,
    edge_position,
    intensity_variance,
)
from vtff_iono.geometry.mapping import mapping_factor
from vtff_iono.scintillation.indices import linear_power, noise_s4
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftSeries

__all__ = ["RayEdgeFinder", "RayEdgeSettings"]

# Fewest epochs of a second in which the variance of the intensity is looked at.
_FEWEST_EPOCHS = 10
# Part of the epochs of a second in which a signal must have samples.
_COVERAGE = 0.9
# Seconds over which the rates of a ray are averaged, and over which their spread is computed.
_RATE_SECONDS = 5
# Fewest rays whose median shows the vertical motion.
_FEWEST_RATES = 4
_SECONDS_PER_MINUTE = 60.0
_KILOMETRES_PER_METRE = 1e-3


@dataclass(frozen=True)
class RayEdgeSettings:
    """Thresholds above which a ray crosses an irregularity.

    Parameters
    ----------
    variance_ratio : float
        Variance of the intensity in a second relative to that of noise. Without scintillation one
        second in a thousand exceeds 2.1, with an S4 of 0.4 nine in ten do.
    roti_tecu_per_minute : float
        Standard deviation of the rate of TEC over 5 s, TECU/min.
    gradient_tecu_per_km : float
        Mean gradient of TEC along the path of the spacecraft over 5 s, TECU/km.
    irregularity_altitude : float
        Altitude at which rays are taken to meet an irregularity, m; for a spacecraft above it, the
        altitude of the spacecraft.
    elevation_mask : float
        Lowest elevation of rays whose intensity is looked at, rad.
    rate_elevation_mask : float
        Lowest elevation of rays whose rate of TEC is looked at, rad. The rates of low rays change
        with their mapping, which is not known well enough.
    """

    variance_ratio: float = 2.5
    roti_tecu_per_minute: float = 2.0
    gradient_tecu_per_km: float = 0.05
    irregularity_altitude: float = 320e3
    elevation_mask: float = 0.0
    rate_elevation_mask: float = math.radians(25.0)


class _RayQuantity(NamedTuple):
    """A quantity of the ray of a group of rows in a second that ends at a time, ns."""

    group: int
    time: int
    source: BoundarySource
    value: float


class _SecondContent(NamedTuple):
    """Mean content (TECU) of a link in an arc, in the second that ends at a time, ns."""

    end: int
    arc: int
    stec_tecu: float


class _SecondRate(NamedTuple):
    """Change of a content (TECU) in the second to a time, ns, vertical motion removed."""

    end: int
    change_tecu: float


class _ContentChanges(NamedTuple):
    """Changes of content (TECU) to a second, with the groups of rows and elevations (rad)."""

    second: int
    end: int
    duration: float
    groups: list[int]
    elevations: FloatArray
    changes: FloatArray


@dataclass(frozen=True, eq=False)
class _RayGroups:
    """Rows of links, those of each link and second together; m groups by second and link.

    Parameters
    ----------
    order : ndarray of int, shape (n,)
        Rows with a link, group by group, in each by time.
    starts, counts : ndarray of int, shape (m,)
        Where each group begins in `order`, and its number of rows.
    second, link : ndarray of int, shape (m,)
        Second, counted from the beginning of the series, and link of each group.
    of_rows : ndarray of int
        Group of each row; -1 for a row without a link.
    """

    order: npt.NDArray[np.intp]
    starts: npt.NDArray[np.intp]
    counts: npt.NDArray[np.intp]
    second: npt.NDArray[np.intp]
    link: npt.NDArray[np.int64]
    of_rows: npt.NDArray[np.intp]

    @classmethod
    def of(cls, series: SpacecraftSeries) -> _RayGroups:
        """Return the groups of the rows of a series."""
        link = series.rows.pairs.link
        second_of_row = np.repeat(np.arange(len(series.results)), np.diff(series.first_row))
        key = second_of_row * (int(link.max(initial=0)) + 1) + link
        row = np.flatnonzero(link >= 0)
        order = row[np.argsort(key[row], kind="stable")]
        is_first = np.diff(key[order], prepend=-1) != 0
        starts = np.flatnonzero(is_first)
        of_rows = np.full(len(link), -1, dtype=np.intp)
        of_rows[order] = np.cumsum(is_first) - 1
        counts = np.diff(np.append(starts, len(order)))
        first_row = order[starts]
        return cls(order, starts, counts, second_of_row[first_row], link[first_row], of_rows)


class RayEdgeFinder:
    """Finds the edges that the rays of one spacecraft cross.

    Parameters
    ----------
    spacecraft : int
        Number of the spacecraft in the edges: 0 chief, 1 deputy.
    settings : RayEdgeSettings
    """

    def __init__(
        self,
        spacecraft: int,
        settings: RayEdgeSettings = RayEdgeSettings(),  # noqa: B008 - frozen
    ) -> None:
        self._spacecraft = spacecraft
        self._settings = settings
        self._thresholds = {
            BoundarySource.S4: settings.variance_ratio,
            BoundarySource.ROTI: settings.roti_tecu_per_minute,
            BoundarySource.TEC_GRADIENT: settings.gradient_tecu_per_km,
        }
        # By system and PRN of the satellite and by quantity.
        self._detectors: dict[tuple[int, int, BoundarySource], ExceedanceDetector] = {}
        # By number of the link.
        self._last_content: dict[int, _SecondContent] = {}
        self._rates: dict[int, deque[_SecondRate]] = {}

    def update(self, series: SpacecraftSeries) -> list[list[Boundary]]:
        """Process the next seconds and return the edges that each of them confirms.

        Parameters
        ----------
        series : SpacecraftSeries
            Observations and results of the spacecraft, a block for each second.
        """
        columns, rows = series.block.columns, series.rows
        groups = _RayGroups.of(series)
        quantities = self._variance_ratios(series, groups)
        for number, of_rates in enumerate(self._rate_quantities(series, groups)):
            quantities[number] += of_rates
        boundaries: list[list[Boundary]] = [[] for _ in quantities]
        last_rows = groups.order[groups.starts + groups.counts - 1]
        observations = rows.pairs.row_first[last_rows]
        systems = columns["system"][observations].tolist()
        prns = columns["prn"][observations].tolist()
        for number, quantities_of_second in enumerate(quantities):
            for group, time, source, value in quantities_of_second:
                system, prn = systems[group], prns[group]
                detector = self._detectors.get((system, prn, source))
                if detector is None:
                    detector = ExceedanceDetector(self._thresholds[source])
                    self._detectors[system, prn, source] = detector
                for edge in detector.update(time / NANOSECONDS_PER_SECOND, value):
                    observation = int(observations[group])
                    position = series.position_itrf[observation]
                    direction = series.results[number].direction_itrf[
                        observation - int(series.first_observation[number])
                    ]
                    if np.isfinite(position).all() and np.isfinite(direction).all():
                        boundaries[number].append(
                            self._boundary(source, system, prn, edge, position, direction)
                        )
        return boundaries

    def _boundary(
        self,
        source: BoundarySource,
        system: int,
        prn: int,
        edge: Edge,
        position_itrf: FloatArray,
        direction_itrf: FloatArray,
    ) -> Boundary:
        return Boundary(
            kind=BoundaryKind.HORIZONTAL,
            source=source,
            spacecraft=self._spacecraft,
            system=system,
            prn=prn,
            time=round(edge.time * NANOSECONDS_PER_SECOND),
            time_sigma=edge.time_sigma,
            is_entry=edge.is_entry,
            position_itrf=edge_position(
                position_itrf, direction_itrf, self._settings.irregularity_altitude
            ),
            confidence=edge.confidence,
        )

    # ---- intensity ---------------------------------------------------------------------------

    def _variance_ratios(
        self, series: SpacecraftSeries, groups: _RayGroups
    ) -> list[list[_RayQuantity]]:
        """Return for each second the variances of the intensity relative to that of noise.

        They are those of the first signal of each satellite.
        """
        rows, columns = series.rows, series.block.columns
        time = rows.pairs.time
        seconds = len(series.results)
        epochs_of_second, sample_length = np.zeros(seconds), np.ones(seconds)
        for number, (first, end) in enumerate(itertools.pairwise(series.first_row.tolist())):
            times = time[first:end]
            epochs = times[np.diff(times, prepend=times[:1] - 1) != 0]
            if len(epochs) >= _FEWEST_EPOCHS:
                epochs_of_second[number] = len(epochs)
                step = statistics.median(np.diff(epochs).tolist())
                sample_length[number] = step / NANOSECONDS_PER_SECOND
        is_high = rows.elevation[groups.order] >= self._settings.elevation_mask
        has_high = np.logical_or.reduceat(is_high, groups.starts) if len(groups.starts) else is_high
        needed = epochs_of_second[groups.second]
        candidates = np.flatnonzero(has_high & (needed > 0) & (groups.counts >= _COVERAGE * needed))
        # The first link of each satellite and second.
        observation = rows.pairs.row_first[groups.order[groups.starts[candidates]]]
        satellite = satellite_number(columns["system"][observation], columns["prn"][observation])
        key = groups.second[candidates] * (int(satellite.max(initial=0)) + 1) + satellite
        chosen = candidates[np.sort(np.unique(key, return_index=True)[1])]
        ratios = np.empty(len(chosen))
        # Links with equal numbers of samples, as a rule all links, are computed together.
        for count in np.unique(groups.counts[chosen]).tolist():
            of_count = np.flatnonzero(groups.counts[chosen] == count)
            table = groups.starts[chosen[of_count], np.newaxis] + np.arange(count)
            power = linear_power(columns["cn0_dbhz"][rows.pairs.row_first[groups.order[table]]])
            length = sample_length[groups.second[chosen[of_count]]]
            noise = noise_s4(10.0 * np.log10(power.mean(axis=-1)), length) ** 2
            ratios[of_count] = intensity_variance(power) / noise
        quantities: list[list[_RayQuantity]] = [[] for _ in series.results]
        for group, ratio in zip(chosen.tolist(), ratios.tolist(), strict=True):
            number = int(groups.second[group])
            end = int(time[series.first_row[number + 1] - 1])
            quantities[number].append(_RayQuantity(group, end, BoundarySource.S4, ratio))
        return quantities

    # ---- rate of TEC -------------------------------------------------------------------------

    def _rate_quantities(
        self, series: SpacecraftSeries, groups: _RayGroups
    ) -> list[list[_RayQuantity]]:
        """Return for each second ROTI and gradients of TEC of links with rates for long enough."""
        quantities: list[list[_RayQuantity]] = [[] for _ in series.results]
        time, position = series.rows.pairs.time, series.position_itrf
        ends = [
            (number, int(time[end - 1]), float(time[end - 1] - time[first]))
            for number, (first, end) in enumerate(itertools.pairwise(series.first_row.tolist()))
            if end > first and np.isfinite(position[series.first_observation[number + 1] - 1]).all()
        ]
        changes = self._content_changes(series, groups, ends)
        changes = [
            change
            for change in changes
            if len(change.groups) >= _FEWEST_RATES and change.duration > 0.0
        ]
        if not changes:
            return quantities
        numbers = np.array([change.second for change in changes])
        first, last = (
            position[series.first_observation[numbers]],
            position[series.first_observation[numbers + 1] - 1],
        )
        counts = [len(change.groups) for change in changes]
        factors = mapping_factor(
            np.concatenate([change.elevations for change in changes]),
            np.repeat(np.linalg.norm(last, axis=-1), counts),
            np.repeat(geodetic_from_itrf(last)[:, 2], counts),
        )
        steps = np.concatenate([change.changes for change in changes])
        verticals = steps / factors
        edges = np.cumsum([0, *counts])
        medians = [
            statistics.median(verticals[begin:end].tolist())
            for begin, end in itertools.pairwise(edges.tolist())
        ]
        steps = steps - factors * np.repeat(medians, counts)
        distance = np.linalg.norm(last - first, axis=-1)
        kilometres_per_second = (
            _KILOMETRES_PER_METRE * distance / [change.duration for change in changes]
        )
        found, tables = [], []
        for row, (change, begin, end) in enumerate(
            zip(changes, edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        ):
            chosen, rates = self._recent_rates(change, groups, steps[begin:end])
            found += [(row, group) for group in chosen]
            tables += rates
        table = np.array(tables).reshape(-1, _RATE_SECONDS)
        roti = (_SECONDS_PER_MINUTE * table.std(axis=-1, ddof=1)).tolist()
        speed = kilometres_per_second[[row for row, _ in found]] if found else np.zeros(0)
        gradient = (np.abs(table.mean(axis=-1)) / speed).tolist()
        for index, (row, group) in enumerate(found):
            number, end = changes[row].second, changes[row].end
            quantities[number] += [
                _RayQuantity(group, end, BoundarySource.ROTI, roti[index]),
                _RayQuantity(group, end, BoundarySource.TEC_GRADIENT, gradient[index]),
            ]
        return quantities

    def _content_changes(
        self,
        series: SpacecraftSeries,
        groups: _RayGroups,
        ends: Sequence[tuple[int, int, float]],
    ) -> list[_ContentChanges]:
        """Return the changes of content since the second before, for some seconds.

        `ends` are the number of each second, its end and its duration, ns. A link has a change if
        its arc has lasted through both seconds.
        """
        rows = series.rows
        in_arc = rows.arc > 0
        row = groups.order[in_arc[groups.order]]
        group = groups.of_rows[row]
        count = np.bincount(group, minlength=len(groups.starts))
        total = np.bincount(group, rows.stec_phase_tecu[row], minlength=len(groups.starts))
        mean = (total / np.maximum(count, 1)).tolist()
        last_row = np.zeros(len(groups.starts), dtype=np.intp)
        last_row[group] = row  # of several rows the last one stays
        elevation = rows.elevation[last_row]
        arc = rows.arc[last_row].tolist()
        is_seen = (count > 0) & (elevation >= self._settings.rate_elevation_mask)
        first_group = np.searchsorted(groups.second, np.arange(len(series.results) + 1)).tolist()
        link = groups.link.tolist()
        result = []
        for number, end, duration in ends:
            begin = first_group[number]
            changed: list[int] = []
            changes: list[float] = []
            for index in (
                begin + np.flatnonzero(is_seen[begin : first_group[number + 1]])
            ).tolist():
                content = _SecondContent(end, arc[index], mean[index])
                previous = self._last_content.get(link[index])
                self._last_content[link[index]] = content
                if (
                    previous is not None
                    and previous.arc == content.arc
                    and end - previous.end == NANOSECONDS_PER_SECOND
                ):
                    changed.append(index)
                    changes.append(content.stec_tecu - previous.stec_tecu)
            result.append(
                _ContentChanges(
                    number,
                    end,
                    duration / NANOSECONDS_PER_SECOND,
                    changed,
                    elevation[changed],
                    np.array(changes),
                )
            )
        return result

    def _recent_rates(
        self, change: _ContentChanges, groups: _RayGroups, rates_now: FloatArray
    ) -> tuple[list[int], list[list[float]]]:
        """Return the groups that have a rate in each of the last seconds, and these rates.

        The rates are changes over a second, TECU, `_RATE_SECONDS` of each.
        """
        begin = change.end - _RATE_SECONDS * NANOSECONDS_PER_SECOND
        chosen, recent = [], []
        for group, rate in zip(change.groups, rates_now.tolist(), strict=True):
            rates = self._rates.setdefault(int(groups.link[group]), deque(maxlen=_RATE_SECONDS))
            rates.append(_SecondRate(change.end, rate))
            if len(rates) == _RATE_SECONDS and rates[0].end > begin:
                chosen.append(group)
                recent.append([of_second.change_tecu for of_second in rates])
        return chosen, recent

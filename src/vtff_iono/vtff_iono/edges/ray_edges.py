"""Horizontal edges of irregularities, found ray by ray while the rays of a spacecraft cross them.

Three quantities of a ray show each second whether it crosses an irregularity: the variance of the
intensity relative to that of noise (S4), the spread of the rate of TEC (ROTI), and the gradient of
TEC. Vertical motion of the spacecraft changes the contents of all satellites alike, so that the
median of the rates, mapped to the vertical, is removed first.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.content.slant_tec import SlantTecRows
from vtff_iono.edges.boundary import Boundary, BoundaryKind, BoundarySource
from vtff_iono.edges.edge_detectors import (
    Edge,
    ExceedanceDetector,
    edge_position,
    intensity_variance,
)
from vtff_iono.geometry.mapping import mapping_factor
from vtff_iono.scintillation.indices import linear_power, noise_s4
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock, SpacecraftResult

__all__ = ["RayEdgeFinder", "RayEdgeSettings"]

RowsOfLinks = dict[int, npt.NDArray[np.intp]]
"""Rows of each link, in order of time, by the number of the link."""

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
    """A quantity of the ray of a link in a second that ends at a time, ns."""

    link: int
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

    def update(
        self, block: ObservationBlock, position_itrf: FloatArray, result: SpacecraftResult
    ) -> list[Boundary]:
        """Process the next second and return the edges that it confirms.

        Parameters
        ----------
        block : ObservationBlock
        position_itrf : ndarray, shape (n, 3)
            Position of the antenna at each observation, m.
        result : SpacecraftResult
            Results of the spacecraft for the block.
        """
        rows = result.rows
        rows_of_links = _group_rows(rows)
        quantities = self._variance_ratios(block, rows, rows_of_links)
        quantities += self._rate_quantities(position_itrf, rows, rows_of_links)
        boundaries = []
        for link, time, source, value in quantities:
            observation = int(rows.pairs.row_first[rows_of_links[link][-1]])
            system = int(block.columns["system"][observation])
            prn = int(block.columns["prn"][observation])
            detector = self._detectors.get((system, prn, source))
            if detector is None:
                detector = ExceedanceDetector(self._thresholds[source])
                self._detectors[system, prn, source] = detector
            position = position_itrf[observation]
            direction = result.direction_itrf[observation]
            for edge in detector.update(time / NANOSECONDS_PER_SECOND, value):
                if np.isfinite(position).all() and np.isfinite(direction).all():
                    boundaries.append(
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
        self, block: ObservationBlock, rows: SlantTecRows, rows_of_links: RowsOfLinks
    ) -> list[_RayQuantity]:
        """Return the variance of the intensity of first signals relative to that of noise."""
        time = rows.pairs.time
        epochs = time[np.flatnonzero(np.diff(time, prepend=time[:1] - 1))]
        if len(epochs) < _FEWEST_EPOCHS:
            return []
        sample_length = statistics.median(np.diff(epochs).tolist()) / NANOSECONDS_PER_SECOND
        is_high = rows.elevation >= self._settings.elevation_mask
        system, prn = block.columns["system"], block.columns["prn"]
        # Observations of the first signal of each satellite, by the number of its first link.
        observations: dict[int, npt.NDArray[np.int64]] = {}
        satellites: set[tuple[int, int]] = set()
        for link, rows_of_link in rows_of_links.items():
            if not is_high[rows_of_link].any():
                continue
            first = rows.pairs.row_first[rows_of_link]
            satellite = int(system[first[0]]), int(prn[first[0]])
            if satellite not in satellites and len(first) >= _COVERAGE * len(epochs):
                satellites.add(satellite)
                observations[link] = first
        ratios: dict[int, float] = {}
        # Links with equal numbers of samples, as a rule all links, are computed together.
        for count in {len(first) for first in observations.values()}:
            links = [link for link, first in observations.items() if len(first) == count]
            table = np.stack([observations[link] for link in links])
            power = linear_power(block.columns["cn0_dbhz"][table])
            noise = noise_s4(10.0 * np.log10(power.mean(axis=-1)), sample_length) ** 2
            ratios.update(zip(links, (intensity_variance(power) / noise).tolist(), strict=True))
        end = int(epochs[-1])
        return [_RayQuantity(link, end, BoundarySource.S4, ratios[link]) for link in observations]

    # ---- rate of TEC -------------------------------------------------------------------------

    def _rate_quantities(
        self, position_itrf: FloatArray, rows: SlantTecRows, rows_of_links: RowsOfLinks
    ) -> list[_RayQuantity]:
        """Return ROTI and the gradient of TEC of the links that have rates for long enough."""
        if not len(rows) or not np.isfinite(position_itrf[-1]).all():
            return []
        end = int(rows.pairs.time[-1])
        distance = float(np.linalg.norm(position_itrf[-1] - position_itrf[0]))
        duration = (rows.pairs.time[-1] - rows.pairs.time[0]) / NANOSECONDS_PER_SECOND
        links, elevations, changes = self._content_changes(end, rows, rows_of_links)
        if len(links) < _FEWEST_RATES or duration <= 0.0:
            return []
        radius = np.linalg.norm(position_itrf[-1])
        factors = mapping_factor(elevations, radius, geodetic_from_itrf(position_itrf[-1])[2])
        changes = changes - factors * statistics.median((changes / factors).tolist())
        links_with_rates, table = self._recent_rates(end, links, changes)
        roti = _SECONDS_PER_MINUTE * table.std(axis=-1, ddof=1)
        kilometres_per_second = _KILOMETRES_PER_METRE * distance / duration
        gradient = np.abs(table.mean(axis=-1)) / kilometres_per_second
        quantities = []
        for row, link in enumerate(links_with_rates):
            quantities.append(_RayQuantity(link, end, BoundarySource.ROTI, float(roti[row])))
            quantities.append(
                _RayQuantity(link, end, BoundarySource.TEC_GRADIENT, float(gradient[row]))
            )
        return quantities

    def _content_changes(
        self, end: int, rows: SlantTecRows, rows_of_links: RowsOfLinks
    ) -> tuple[list[int], FloatArray, FloatArray]:
        """Return links, their elevations (rad) and changes of content since last second (TECU).

        A link has a change if its arc has lasted through both seconds.
        """
        links: list[int] = []
        elevations: list[float] = []
        changes: list[float] = []
        in_arc = (rows.arc > 0) & (rows.pairs.link >= 0)
        link_in_arc = rows.pairs.link[in_arc]
        totals = np.bincount(link_in_arc, rows.stec_phase_tecu[in_arc])
        counts = np.bincount(link_in_arc)
        for link, rows_of_link in rows_of_links.items():
            if link >= len(counts) or not counts[link]:
                continue
            last_row = rows_of_link[in_arc[rows_of_link]][-1]
            if not rows.elevation[last_row] >= self._settings.rate_elevation_mask:
                continue
            content = _SecondContent(
                end, int(rows.arc[last_row]), float(totals[link] / counts[link])
            )
            previous = self._last_content.get(link)
            self._last_content[link] = content
            if (
                previous is not None
                and previous.arc == content.arc
                and content.end - previous.end == NANOSECONDS_PER_SECOND
            ):
                links.append(link)
                elevations.append(rows.elevation[last_row])
                changes.append(content.stec_tecu - previous.stec_tecu)
        return links, np.array(elevations), np.array(changes)

    def _recent_rates(
        self, end: int, links: list[int], changes: FloatArray
    ) -> tuple[list[int], FloatArray]:
        """Return the links that have a rate in each of the last seconds, and these rates.

        The rates are changes over a second, TECU, shape (links, `_RATE_SECONDS`).
        """
        begin = end - _RATE_SECONDS * NANOSECONDS_PER_SECOND
        links_with_rates, recent = [], []
        for link, change in zip(links, changes.tolist(), strict=True):
            rates = self._rates.setdefault(link, deque(maxlen=_RATE_SECONDS))
            rates.append(_SecondRate(end, change))
            newest = [rate.change_tecu for rate in rates if rate.end > begin]
            if len(newest) == _RATE_SECONDS:
                links_with_rates.append(link)
                recent.append(newest)
        return links_with_rates, np.array(recent).reshape(-1, _RATE_SECONDS)


def _group_rows(rows: SlantTecRows) -> RowsOfLinks:
    """Return the rows of each link."""
    if not len(rows):
        return {}
    order = np.argsort(rows.pairs.link, kind="stable")
    link = rows.pairs.link[order]
    starts = np.flatnonzero(np.diff(link, prepend=link[:1] - 1))
    groups = np.split(order, starts[1:])
    return {
        number: rows_of_link
        for number, rows_of_link in zip(link[starts].tolist(), groups, strict=True)
        if number >= 0
    }

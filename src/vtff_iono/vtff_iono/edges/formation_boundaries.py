"""Edges that a formation crosses, told while it flies.

Vertical edges are found in the density between the spacecraft. The moment at which each spacecraft
crosses the edge itself follows from the contents, whose slopes change there. Horizontal edges
are found ray by ray and second by second in three quantities: variance of the intensity relative to
that of noise (S4), spread of the rate of TEC (ROTI), and gradient of TEC. What changes for all
satellites at once is vertical motion, so that the median of the vertical rates is taken out first.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.content.slant_tec import SlantTecRows
from vtff_iono.edges.boundaries import (
    BoundaryKind,
    BoundarySource,
    DensityEdgeDetector,
    Edge,
    ExceedanceDetector,
    edge_position,
    intensity_variance,
)
from vtff_iono.edges.content_history import ContentHistory
from vtff_iono.edges.edge_crossing import EdgeCrossing, fit_edge_crossings
from vtff_iono.geometry.mapping import mapping_factor
from vtff_iono.links.signal_pairs import Link
from vtff_iono.scintillation.indices import linear_power, noise_s4
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock, SpacecraftResult

__all__ = ["Boundary", "BoundarySettings", "DensitySample", "FormationBoundaries"]

# How far to either side of an edge contents are fitted, s, and the least. A long window helps in
# scintillation; no other edge may lie in it.
_CROSSING_WINDOW = 40.0
_SHORTEST_WINDOW = 10.0
# Of the deputy behind the chief, on top of the window, s.
_LARGEST_LAG = 5.0
# Scintillation is correlated from second to second, so that sigmas of means are too small.
_LEAST_CHANGE_SIGMAS = 6.0
_HISTORY = 150.0
_EDGES_KEPT = 8
# Samples of a signal that a second must have, as a part of its epochs.
_COVERAGE = 0.9
# Seconds over which rates are averaged and their spread is formed.
_RATES = 5


@dataclass(frozen=True)
class BoundarySettings:
    """Thresholds.

    Parameters
    ----------
    variance_ratio : float
        Variance of the intensity in a second relative to that of noise. Without scintillation one
        second in a thousand exceeds 2.1, with an S4 of 0.4 nine in ten do.
    roti_tecu_per_minute : float
        Spread of the rate of TEC over 5 s, TECU/min.
    gradient_tecu_per_km : float
        Mean gradient along the way of the ray over 5 s, TECU/km.
    irregularity_altitude : float
        At which rays are said to meet an irregularity, m; for a spacecraft above it, its own.
    elevation_minimum, rate_elevation_minimum : float
        Of rays whose intensity is looked at, and of those whose rate of TEC is, rad. The rates of
        low rays change with their mapping, which is not known well enough.
    """

    variance_ratio: float = 2.5
    roti_tecu_per_minute: float = 2.0
    gradient_tecu_per_km: float = 0.05
    irregularity_altitude: float = 320e3
    elevation_minimum: float = 0.0
    rate_elevation_minimum: float = math.radians(25.0)


@dataclass(frozen=True)
class DensitySample:
    """A density, as the detector takes it in.

    Parameters
    ----------
    time : int
        GPS time, ns since 1980-01-06.
    altitude, separation : float
        m.
    density, sigma : float
        Electrons per cubic metre.
    """

    time: int
    altitude: float
    separation: float
    density: float
    sigma: float


@dataclass(frozen=True, eq=False)
class Boundary:
    """An edge; see ``vtff_msgs/IrregularityBoundary``.

    Parameters
    ----------
    kind : BoundaryKind
    source : BoundarySource
    spacecraft : int
        0 chief, 1 deputy.
    system, prn : int
        Of the ray; 255 and 0 for a vertical edge.
    time : int
        GPS time, ns since 1980-01-06.
    time_sigma : float
        s.
    is_entry : bool
    position_itrf : ndarray, shape (3,)
        m; of the spacecraft (vertical) or of the pierce point.
    confidence : float
        0 to 1.
    """

    kind: BoundaryKind
    source: BoundarySource
    spacecraft: int
    system: int
    prn: int
    time: int
    time_sigma: float
    is_entry: bool
    position_itrf: FloatArray
    confidence: float


class FormationBoundaries:
    """Finds the edges that chief and deputy cross.

    Parameters
    ----------
    settings : BoundarySettings
    """

    def __init__(self, settings: BoundarySettings = BoundarySettings()) -> None:  # noqa: B008
        self._settings = settings
        self._density = DensityEdgeDetector(sigmas=_LEAST_CHANGE_SIGMAS)
        self._thresholds = {
            BoundarySource.S4: settings.variance_ratio,
            BoundarySource.ROTI: settings.roti_tecu_per_minute,
            BoundarySource.TEC_GRADIENT: settings.gradient_tecu_per_km,
        }
        self._rays: dict[tuple[int, int, int, BoundarySource], ExceedanceDetector] = {}
        self._history = (ContentHistory(_HISTORY), ContentHistory(_HISTORY))
        self._waiting: list[Edge] = []
        self._edge_times: deque[float] = deque(maxlen=_EDGES_KEPT)
        # Contents of the last seconds of (spacecraft, link): time, arc, mapping, content.
        self._rates: dict[tuple[int, int], deque[tuple[int, int, float]]] = {}

    def update(
        self,
        blocks: tuple[ObservationBlock, ObservationBlock],
        positions_itrf: tuple[FloatArray, FloatArray],
        results: tuple[SpacecraftResult, SpacecraftResult],
        links: tuple[Sequence[Link], Sequence[Link]],
        densities: list[DensitySample],
    ) -> list[Boundary]:
        """Take a second in and return the edges that it confirms.

        Parameters
        ----------
        blocks, positions_itrf, results : tuple
            Observations of chief and deputy, positions of the antenna for each, shape (n, 3), and
            what has been made of them.
        links : tuple of sequence of Link
            Those of chief and deputy whose numbers the results tell.
        densities : list of DensitySample
        """
        found: list[Boundary] = []
        for craft in (0, 1):
            self._history[craft].add(positions_itrf[craft], results[craft], links[craft])
            found += self._horizontal(craft, blocks[craft], positions_itrf[craft], results[craft])
        for sample in densities:
            edges = self._density.update(
                sample.time / NANOSECONDS_PER_SECOND,
                sample.altitude,
                sample.separation,
                sample.density,
                sample.sigma,
            )
            self._waiting += edges
            self._edge_times.extend(edge.time for edge in edges)
        waiting, self._waiting = self._waiting, []
        for edge in waiting:
            guesses = [history.crossing(edge.altitude) for history in self._history]
            if not all(self._is_over(guess) for guess in guesses):
                self._waiting.append(edge)
            else:
                found += self._vertical(edge, guesses)
        return found

    # ---- vertical ----------------------------------------------------------------------------

    def _is_over(self, guess: int | None) -> bool:
        """Return whether all is there that the fit of a crossing needs."""
        ends = [
            times[-1] for times, _ in (history.way() for history in self._history) if len(times)
        ]
        return guess is None or min(ends) - guess >= _CROSSING_WINDOW * NANOSECONDS_PER_SECOND

    def _vertical(self, edge: Edge, guesses: list[int | None]) -> list[Boundary]:
        """Return the crossings of an edge by chief and deputy."""
        crossing = None
        known = [guess for guess in guesses if guess is not None]
        if len(known) == len(guesses):
            crossing = self._crossing(edge, sum(known) // len(known))
        found = []
        for craft, (history, guess) in enumerate(zip(self._history, guesses, strict=True)):
            if guess is None:
                continue
            time, sigma = guess, edge.time_sigma
            if crossing is not None:
                origin, fit = crossing
                time = origin + round(float(fit.time[craft]) * NANOSECONDS_PER_SECOND)
                sigma = float(fit.time_sigma[craft])
            found.append(
                Boundary(
                    kind=BoundaryKind.VERTICAL,
                    source=BoundarySource.DENSITY,
                    spacecraft=craft,
                    system=255,
                    prn=0,
                    time=time,
                    time_sigma=sigma,
                    is_entry=edge.is_entry,
                    position_itrf=history.position_at(time),
                    confidence=edge.confidence,
                )
            )
        return found

    def _crossing(self, edge: Edge, origin: int) -> tuple[int, EdgeCrossing] | None:
        """Return the fit of an edge near a time, and the origin of its times, ns."""
        chief, deputy = self._history
        reach = round((_CROSSING_WINDOW + _LARGEST_LAG) * NANOSECONDS_PER_SECOND)
        epochs = chief.epochs(origin - reach, origin + reach)
        if len(epochs) < 3:
            return None
        # Even epochs: one that no receiver has told stays without contents.
        step = int(np.median(np.diff(epochs)))
        epochs = np.arange(epochs[0], epochs[-1] + step, step)
        common = set(deputy.links)
        links = [link for link in chief.links if link in common]
        others = [abs(time - edge.time) for time in self._edge_times if time != edge.time]
        half_window = float(
            np.clip(0.8 * min(others, default=math.inf), _SHORTEST_WINDOW, _CROSSING_WINDOW)
        )
        heights = geodetic_from_itrf(
            np.array([chief.position_at(origin + shift) for shift in (-reach // 4, reach // 4)])
        )[:, 2]
        is_rising = bool(heights[1] > heights[0])
        fit = fit_edge_crossings(
            (epochs - origin) / NANOSECONDS_PER_SECOND,
            chief.series(epochs, links),
            deputy.series(epochs, links),
            edge.altitude,
            is_dense_above=is_rising != edge.is_entry,
            half_window=half_window,
        )
        return None if fit is None else (origin, fit)

    # ---- horizontal --------------------------------------------------------------------------

    def _horizontal(
        self,
        craft: int,
        block: ObservationBlock,
        position: FloatArray,
        result: SpacecraftResult,
    ) -> list[Boundary]:
        rows = result.rows
        of_links = _rows_of_links(rows)
        values = self._variance_ratios(block, rows, of_links)
        values += self._rate_quantities(craft, position, rows, of_links)
        found = []
        for link, time, source, value in values:
            row = int(rows.pairs.row_first[of_links[link][-1]])
            system, prn = int(block.columns["system"][row]), int(block.columns["prn"][row])
            key = (craft, system, prn, source)
            detector = self._rays.get(key)
            if detector is None:
                detector = self._rays[key] = ExceedanceDetector(self._thresholds[source])
            for edge in detector.update(time / NANOSECONDS_PER_SECOND, value):
                if (
                    np.isfinite(position[row]).all()
                    and np.isfinite(result.direction_itrf[row]).all()
                ):
                    found.append(
                        self._ray_boundary(
                            craft,
                            source,
                            system,
                            prn,
                            edge,
                            position[row],
                            result.direction_itrf[row],
                        )
                    )
        return found

    def _ray_boundary(
        self,
        craft: int,
        source: BoundarySource,
        system: int,
        prn: int,
        edge: Edge,
        position: FloatArray,
        direction: FloatArray,
    ) -> Boundary:
        return Boundary(
            kind=BoundaryKind.HORIZONTAL,
            source=source,
            spacecraft=craft,
            system=system,
            prn=prn,
            time=round(edge.time * NANOSECONDS_PER_SECOND),
            time_sigma=edge.time_sigma,
            is_entry=edge.is_entry,
            position_itrf=edge_position(position, direction, self._settings.irregularity_altitude),
            confidence=edge.confidence,
        )

    def _variance_ratios(
        self,
        block: ObservationBlock,
        rows: SlantTecRows,
        of_links: dict[int, npt.NDArray[np.intp]],
    ) -> list[tuple[int, int, BoundarySource, float]]:
        """Return the variance of the intensity of first signals relative to that of noise."""
        time = rows.pairs.time
        epochs = time[np.flatnonzero(np.diff(time, prepend=time[:1] - 1))]
        if len(epochs) < 10:
            return []
        sample_length = statistics.median(np.diff(epochs).tolist()) / NANOSECONDS_PER_SECOND
        is_high = rows.elevation >= self._settings.elevation_minimum
        system, prn = block.columns["system"], block.columns["prn"]
        chosen: dict[int, npt.NDArray[np.int64]] = {}
        seen: set[tuple[int, int]] = set()
        for link, own in of_links.items():
            if not is_high[own].any():
                continue
            first = rows.pairs.row_first[own]
            satellite = int(system[first[0]]), int(prn[first[0]])
            if satellite not in seen and len(first) >= _COVERAGE * len(epochs):
                seen.add(satellite)
                chosen[link] = first
        ratios: dict[int, float] = {}
        # Links with as many samples as each other, which are all of them as a rule, at once.
        for count in {len(first) for first in chosen.values()}:
            links = [link for link, first in chosen.items() if len(first) == count]
            power = linear_power(block.columns["cn0_dbhz"][np.stack([chosen[n] for n in links])])
            noise = noise_s4(10.0 * np.log10(power.mean(axis=-1)), sample_length) ** 2
            ratios.update(zip(links, (intensity_variance(power) / noise).tolist(), strict=True))
        return [(link, int(epochs[-1]), BoundarySource.S4, ratios[link]) for link in chosen]

    def _rate_quantities(
        self,
        craft: int,
        position: FloatArray,
        rows: SlantTecRows,
        of_links: dict[int, npt.NDArray[np.intp]],
    ) -> list[tuple[int, int, BoundarySource, float]]:
        """Return spread of the rate and gradient of TEC of links, vertical motion taken out."""
        if not len(rows):
            return []
        end = int(rows.pairs.time[-1])
        place = position[-1]
        if not np.isfinite(place).all():
            return []
        speed = float(np.linalg.norm(position[-1] - position[0]))
        span = (rows.pairs.time[-1] - rows.pairs.time[0]) / NANOSECONDS_PER_SECOND
        rates: dict[int, float] = {}
        elevations = []
        in_arc = (rows.arc > 0) & (rows.pairs.link >= 0)
        link_in_arc = rows.pairs.link[in_arc]
        totals = np.bincount(link_in_arc, rows.stec_phase_tecu[in_arc])
        counts = np.bincount(link_in_arc)
        for link, all_rows in of_links.items():
            if link >= len(counts) or not counts[link]:
                continue
            last = all_rows[in_arc[all_rows]][-1]
            if not rows.elevation[last] >= self._settings.rate_elevation_minimum:
                continue
            arc, content = int(rows.arc[last]), float(totals[link] / counts[link])
            kept = self._rates.setdefault((craft, link), deque(maxlen=_RATES))
            if kept and kept[-1][1] == arc and end - kept[-1][0] == NANOSECONDS_PER_SECOND:
                rates[link] = content - kept[-1][2]
                elevations.append(rows.elevation[last])
            kept.append((end, arc, content))
        if len(rates) < 4 or span <= 0.0:
            return []
        factors = mapping_factor(elevations, np.linalg.norm(place), geodetic_from_itrf(place)[2])
        change = np.array(list(rates.values()))
        change = change - factors * statistics.median((change / factors).tolist())
        recent: dict[int, list[float]] = {}
        for link, rate in zip(rates, change.tolist(), strict=True):
            own_rates = self._rates.setdefault((craft, -1 - link), deque(maxlen=_RATES))
            own_rates.append((end, 0, rate))
            newest = [r for time, _, r in own_rates if end - time < _RATES * NANOSECONDS_PER_SECOND]
            if len(newest) == _RATES:
                recent[link] = newest
        table = np.array(list(recent.values())).reshape(-1, _RATES)
        roti = 60.0 * table.std(axis=-1, ddof=1)
        gradient = np.abs(table.mean(axis=-1)) / (1e-3 * speed / span)
        values = []
        for link, *both in zip(recent, roti.tolist(), gradient.tolist(), strict=True):
            values.append((link, end, BoundarySource.ROTI, both[0]))
            values.append((link, end, BoundarySource.TEC_GRADIENT, both[1]))
        return values


def _rows_of_links(rows: SlantTecRows) -> dict[int, npt.NDArray[np.intp]]:
    """Return the rows of each link, in order of time, by its number."""
    if not len(rows):
        return {}
    order = np.argsort(rows.pairs.link, kind="stable")
    link = rows.pairs.link[order]
    starts = np.flatnonzero(np.diff(link, prepend=link[:1] - 1))
    parts = np.split(order, starts[1:])
    return {
        number: part
        for number, part in zip(link[starts].tolist(), parts, strict=True)
        if number >= 0
    }

"""Edges that a formation crosses, told while it flies.

Vertical edges are found in the density between the spacecraft. The moment at which each spacecraft
crosses the edge itself follows from its own contents, whose slope changes there. Horizontal edges
are found ray by ray and second by second in three quantities: variance of the intensity relative to
that of noise (S4), spread of the rate of TEC (ROTI), and gradient of TEC. What changes for all
satellites at once is vertical motion, so that the median of the vertical rates is taken out first.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.boundaries import (
    BoundaryKind,
    BoundarySource,
    DensityEdgeDetector,
    Edge,
    ExceedanceDetector,
    edge_position,
    fit_kink,
    intensity_variance,
)
from vtff_iono.mapping import mapping_factor
from vtff_iono.scintillation import linear_power, noise_s4
from vtff_iono.slant_tec import SlantTecRows
from vtff_iono.spacecraft_ionosphere import ObservationBlock, SpacecraftResult

__all__ = ["Boundary", "BoundarySettings", "DensitySample", "FormationBoundaries"]

_KINK_WINDOW = 15.0
_LEAST_SIGNIFICANCE = 5.0
# Scintillation is correlated from second to second, so that sigmas of means are too small.
_LEAST_CHANGE_SIGMAS = 6.0
_HISTORY = 150.0
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


@dataclass(frozen=True, eq=False)
class _Piece:
    """Phase contents of one second of one spacecraft."""

    time: npt.NDArray[np.int64]
    link: npt.NDArray[np.int64]
    arc: npt.NDArray[np.int64]
    stec: FloatArray
    elevation: FloatArray
    position: FloatArray


class FormationBoundaries:
    """Finds the edges that chief and deputy cross.

    Parameters
    ----------
    settings : BoundarySettings
    """

    def __init__(self, settings: BoundarySettings = BoundarySettings()) -> None:  # noqa: B008
        self._settings = settings
        self._density = DensityEdgeDetector(sigmas=_LEAST_CHANGE_SIGMAS)
        self._rays: dict[tuple[int, int, int, BoundarySource], ExceedanceDetector] = {}
        self._history: tuple[deque[_Piece], deque[_Piece]] = (deque(), deque())
        self._waiting: list[tuple[int, Edge]] = []
        # Contents of the last seconds of (spacecraft, link): time, arc, mapping, content.
        self._rates: dict[tuple[int, int], deque[tuple[int, int, float]]] = {}

    def update(
        self,
        blocks: tuple[ObservationBlock, ObservationBlock],
        positions_itrf: tuple[FloatArray, FloatArray],
        results: tuple[SpacecraftResult, SpacecraftResult],
        densities: list[DensitySample],
    ) -> list[Boundary]:
        """Take a second in and return the edges that it confirms.

        Parameters
        ----------
        blocks, positions_itrf, results : tuple
            Observations of chief and deputy, positions of the antenna for each, shape (n, 3), and
            what has been made of them.
        densities : list of DensitySample
        """
        found: list[Boundary] = []
        for craft in (0, 1):
            self._remember(craft, positions_itrf[craft], results[craft])
            found += self._horizontal(craft, blocks[craft], positions_itrf[craft], results[craft])
        for sample in densities:
            edges = self._density.update(
                sample.time / NANOSECONDS_PER_SECOND,
                sample.altitude,
                sample.separation,
                sample.density,
                sample.sigma,
            )
            self._waiting += [(craft, edge) for edge in edges for craft in (0, 1)]
        waiting, self._waiting = self._waiting, []
        for craft, edge in waiting:
            guess = self._crossing_time(craft, edge.altitude)
            if guess is not None and guess > -_KINK_WINDOW:
                self._waiting.append((craft, edge))
            elif guess is not None:
                found.append(self._vertical(craft, edge, guess))
        return found

    # ---- vertical ----------------------------------------------------------------------------

    def _remember(self, craft: int, position: FloatArray, result: SpacecraftResult) -> None:
        pairs = result.rows.pairs
        if not len(pairs):
            return
        history = self._history[craft]
        history.append(
            _Piece(
                pairs.time,
                pairs.link,
                result.rows.arc,
                result.rows.stec_phase_tecu,
                result.rows.elevation,
                position[pairs.row_first],
            )
        )
        oldest = int(pairs.time[-1]) - _HISTORY * NANOSECONDS_PER_SECOND
        while history and history[0].time[-1] < oldest:
            history.popleft()

    def _way(self, craft: int) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Return the times, ns, and positions (n, 3) of a spacecraft at the ends of seconds."""
        ends = [(int(p.time[-1]), p.position[-1]) for p in self._history[craft]]
        ends = [end for end in ends if np.isfinite(end[1]).all()]
        return (
            np.array([time for time, _ in ends], dtype=np.int64),
            np.array([place for _, place in ends]).reshape(-1, 3),
        )

    def _crossing_time(self, craft: int, altitude: float) -> float | None:
        """Return when a spacecraft was at an altitude, s before now as a negative number."""
        times, places = self._way(craft)
        if len(times) < 2:
            return None
        seconds = (times - times[-1]) / NANOSECONDS_PER_SECOND
        heights = geodetic_from_itrf(places)[:, 2]
        order = slice(None) if heights[-1] > heights[0] else slice(None, None, -1)
        return float(np.interp(altitude, heights[order], seconds[order]))

    def _vertical(self, craft: int, edge: Edge, guess: float) -> Boundary:
        """Return the crossing of an edge by one spacecraft."""
        times, places = self._way(craft)
        seconds = (times - times[-1]) / NANOSECONDS_PER_SECOND
        time, sigma = guess, edge.time_sigma
        kink = self._kink(craft, int(times[-1]), guess)
        if kink is not None:
            time, sigma = kink
        position = np.array([np.interp(time, seconds, column) for column in places.T])
        return Boundary(
            kind=BoundaryKind.VERTICAL,
            source=BoundarySource.DENSITY,
            spacecraft=craft,
            system=255,
            prn=0,
            time=int(times[-1]) + round(time * NANOSECONDS_PER_SECOND),
            time_sigma=sigma,
            is_entry=edge.is_entry,
            position_itrf=position,
            confidence=edge.confidence,
        )

    def _kink(self, craft: int, origin: int, guess: float) -> tuple[float, float] | None:
        """Return when the contents of a spacecraft change their slope, and its sigma, s."""
        near = [
            piece
            for piece in self._history[craft]
            if abs((piece.time[-1] - origin) / NANOSECONDS_PER_SECOND - guess) < _KINK_WINDOW + 1.0
        ]
        if not near:
            return None
        time, link, arc, stec, elevation = (
            np.concatenate([getattr(piece, name) for piece in near])
            for name in ("time", "link", "arc", "stec", "elevation")
        )
        epochs, row = np.unique(time, return_inverse=True)
        seconds = (epochs - origin) / NANOSECONDS_PER_SECOND
        inside = np.abs(seconds - guess) <= _KINK_WINDOW
        # Entering an empty layer changes the slope of each content by its mapping factor times the
        # same amount. The sum that shows this change best is that of a single content.
        total, weight = np.zeros(len(epochs)), 0.0
        for number in np.unique(link[link >= 0]).tolist():
            own = link == number
            values = np.full(len(epochs), np.nan)
            values[row[own]] = stec[own]
            is_whole = bool(np.isfinite(values[inside]).all()) and np.count_nonzero(inside) >= 40
            factor = float(np.mean(1.0 / np.sin(elevation[own])))
            is_one_arc = arc[own][0] > 0 and len(np.unique(arc[own])) == 1
            if not (is_whole and is_one_arc and factor > 0.0):
                continue
            values = values - values[inside][0]
            rough = values[inside] - _smooth(seconds[inside] - guess, values[inside])
            variance = max(float(np.var(rough)), 1e-8)
            total += factor / variance * np.where(inside, values, 0.0)
            weight += factor**2 / variance
        if weight == 0.0:
            return None
        kink = fit_kink(
            seconds[inside],
            (total[inside] / weight)[:, np.newaxis],
            [1.0 / math.sqrt(weight)],
            guess,
            _KINK_WINDOW,
        )
        if kink.significance < _LEAST_SIGNIFICANCE or not math.isfinite(kink.time_sigma):
            return None
        return kink.time, kink.time_sigma

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
            threshold = {
                BoundarySource.S4: self._settings.variance_ratio,
                BoundarySource.ROTI: self._settings.roti_tecu_per_minute,
                BoundarySource.TEC_GRADIENT: self._settings.gradient_tecu_per_km,
            }[source]
            row = int(rows.pairs.row_first[of_links[link][-1]])
            system, prn = int(block.columns["system"][row]), int(block.columns["prn"][row])
            detector = self._rays.setdefault(
                (craft, system, prn, source), ExceedanceDetector(threshold)
            )
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
        sample_length = float(np.median(np.diff(epochs))) / NANOSECONDS_PER_SECOND
        is_high = rows.elevation >= self._settings.elevation_minimum
        system, prn = block.columns["system"], block.columns["prn"]
        chosen: dict[int, npt.NDArray[np.int64]] = {}
        seen: set[tuple[int, int]] = set()
        for link in np.unique(rows.pairs.link[is_high & (rows.pairs.link >= 0)]).tolist():
            first = rows.pairs.row_first[of_links[link]]
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
        for link, all_rows in of_links.items():
            own = all_rows[rows.arc[all_rows] > 0]
            if not len(own) or not rows.elevation[own[-1]] >= self._settings.rate_elevation_minimum:
                continue
            arc, content = int(rows.arc[own[-1]]), float(rows.stec_phase_tecu[own].mean())
            kept = self._rates.setdefault((craft, link), deque(maxlen=_RATES))
            if kept and kept[-1][1] == arc and end - kept[-1][0] == NANOSECONDS_PER_SECOND:
                rates[link] = content - kept[-1][2]
                elevations.append(rows.elevation[own[-1]])
            kept.append((end, arc, content))
        if len(rates) < 4 or span <= 0.0:
            return []
        factors = mapping_factor(elevations, np.linalg.norm(place), geodetic_from_itrf(place)[2])
        change = np.array(list(rates.values()))
        change = change - factors * np.median(change / factors)
        recent: dict[int, list[float]] = {}
        for link, rate in zip(rates, change.tolist(), strict=True):
            own_rates = self._rates.setdefault((craft, -1 - link), deque(maxlen=_RATES))
            own_rates.append((end, 0, rate))
            last = [r for time, _, r in own_rates if end - time < _RATES * NANOSECONDS_PER_SECOND]
            if len(last) == _RATES:
                recent[link] = last
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


def _smooth(place: FloatArray, values: FloatArray) -> FloatArray:
    """Return the polynomial of degree 8 that follows values, a kink included."""
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(place / np.abs(place).max(), 8))
    return np.asarray(basis @ (basis.T @ values))

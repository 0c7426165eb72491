"""Vertical edges of irregularities, found while both spacecraft cross them.

An edge is found in the density between the spacecraft. The moment at which each spacecraft crosses
it follows later from the slant contents, whose slopes change there.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.formation_density import DensityResult
from vtff_iono.edges.boundary import NO_SYSTEM, Boundary, BoundaryKind, BoundarySource
from vtff_iono.edges.content_history import ContentHistory
from vtff_iono.edges.density_edges import DensityEdgeDetector
from vtff_iono.edges.edge_crossing import EdgeCrossing, fit_edge_crossings
from vtff_iono.edges.edge_detectors import Edge
from vtff_iono.edges.wall_width import combine_widths
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftResult

__all__ = ["VerticalEdgeFinder", "choose_half_window"]

# Contents are fitted for this time before and after the crossing of an edge, s: the usual and the
# shortest time. A long window helps in scintillation, but no other edge may lie in it.
_CROSSING_WINDOW = 40.0
_SHORTEST_WINDOW = 10.0
# The window reaches over this part of the time to the next edge.
_WINDOW_TO_NEXT_EDGE = 0.8
# s; largest lag of the deputy behind the chief, by which more contents are needed than the window.
_LARGEST_LAG = 5.0
# s; contents that are kept: those before a wall of 20 km, the time that it takes to be told, and
# those behind it.
_HISTORY = 360.0
# m; sigma of the altitude of a wall at one of the spacecraft, if it is known at the other, and m/s:
# vertical speeds are counted as at least this.
_ALTITUDE_SIGMA, _SLOWEST = 5.0, 1e-2
# m; an edge whose place is less sure is not told. Densities in fades may show that there is a wall,
# but not where: contents often do.
_LARGEST_PLACE_SIGMA = 1.5e3
# Sigmas within which contents must show an edge that densities alone do not tell.
_AGREEMENT = 3.0
# Number of edges whose times are kept.
_EDGES_KEPT = 8


class VerticalEdgeFinder:
    """Finds the vertical edges that chief and deputy cross, and when each of them does."""

    def __init__(self) -> None:
        self._detector = DensityEdgeDetector()
        self._datum = 0
        self._histories = (ContentHistory(_HISTORY), ContentHistory(_HISTORY))
        # Edges whose crossings cannot be fitted yet, because later contents are missing.
        self._waiting: list[Edge] = []
        self._edge_times: deque[float] = deque(maxlen=_EDGES_KEPT)

    def update(
        self,
        positions_itrf: tuple[FloatArray, FloatArray],
        results: tuple[SpacecraftResult, SpacecraftResult],
        links: tuple[Sequence[Link], Sequence[Link]],
        densities: Sequence[DensityResult],
    ) -> list[Boundary]:
        """Process the next second and return the crossings that it completes.

        Parameters
        ----------
        positions_itrf : tuple of ndarray, shape (n, 3)
            Positions of the antennas of chief and deputy at each observation, m.
        results : tuple of SpacecraftResult
            Results of chief and deputy for the second.
        links : tuple of sequence of Link
            All links of chief and deputy, by the numbers in `results`.
        densities : sequence of DensityResult
            Densities between the spacecraft that this second has brought.
        """
        for history, position, result, links_of_craft in zip(
            self._histories, positions_itrf, results, links, strict=True
        ):
            history.add(position, result, links_of_craft)
        edges = self._detector.flush_after_gap(self._histories[0].last_time)
        for density in densities:
            if density.datum != self._datum:
                self._datum = density.datum
                edges += self._detector.flush()
            edges += self._detector.update(
                density.time / NANOSECONDS_PER_SECOND,
                density.epoch.altitude,
                density.epoch.separation,
                density.epoch.density,
                density.epoch.fast_sigma,
                dict(zip(density.prn.tolist(), density.epoch.slow_parts.tolist(), strict=True)),
                density.epoch.slow_time,
                density.epoch.common_sigma,
            )
        self._waiting += edges
        self._edge_times.extend(edge.time for edge in edges if not edge.is_doubtful)
        boundaries: list[Boundary] = []
        waiting, self._waiting = self._waiting, []
        for edge in waiting:
            guesses = [history.time_at_altitude(edge.altitude) for history in self._histories]
            if all(self._has_contents_after(guess, edge) for guess in guesses):
                boundaries += self._boundaries_of(edge, guesses)
            else:
                self._waiting.append(edge)
        return boundaries

    def _has_contents_after(self, guess: int | None, edge: Edge) -> bool:
        """Return whether the contents reach far enough beyond a crossing (ns) to fit it."""
        window = self._half_window(edge)
        last_times = [
            times[-1]
            for times, _ in (history.trajectory() for history in self._histories)
            if len(times)
        ]
        return guess is None or (min(last_times) - guess >= window * NANOSECONDS_PER_SECOND)

    def _boundaries_of(self, edge: Edge, guesses: list[int | None]) -> list[Boundary]:
        """Return the crossings of an edge by chief and deputy.

        `guesses` are the times, ns, at which each was at the altitude of the edge; None for a
        spacecraft without positions, which has no crossing. There is none of an edge, or of a
        place, that densities and contents together do not tell.
        """
        crossing = None
        times = [guess for guess in guesses if guess is not None]
        if len(times) == len(guesses):
            crossing = self._fit_crossing(edge, sum(times) // len(times))
        if not self._is_told(edge, None if crossing is None else crossing[1]):
            return []
        # The density tells the altitude, and so both times, by which these err together.
        own_sigma = _ALTITUDE_SIGMA / self._vertical_speed()
        sigmas = [math.hypot(edge.time_sigma, own_sigma)] * len(guesses)
        covariance = edge.time_sigma**2
        widths = [] if edge.widths is None else [edge.widths]
        # Contents tell more than the density, unless L2 is lost too often.
        if crossing is not None:
            origin, fit = crossing
            if float(fit.time_sigma @ fit.time_sigma) < math.fsum(s**2 for s in sigmas):
                guesses = [
                    origin + round(time * NANOSECONDS_PER_SECOND) for time in fit.time.tolist()
                ]
                sigmas, covariance = fit.time_sigma.tolist(), fit.time_covariance
            widths.append(fit.widths)
        width, width_sigma = edge.width, edge.width_sigma
        if widths:
            width, width_sigma = combine_widths(*widths)
        boundaries = []
        for craft, (history, time, sigma) in enumerate(
            zip(self._histories, guesses, sigmas, strict=True)
        ):
            if time is None:
                continue
            boundaries.append(
                Boundary(
                    kind=BoundaryKind.VERTICAL,
                    source=BoundarySource.DENSITY,
                    spacecraft=craft,
                    system=NO_SYSTEM,
                    prn=0,
                    time=time,
                    time_sigma=sigma,
                    is_entry=edge.is_entry,
                    position_itrf=history.position_at(time),
                    confidence=edge.confidence,
                    width=width,
                    width_sigma=width_sigma,
                    time_covariance=covariance,
                )
            )
        return boundaries

    def _is_told(self, edge: Edge, crossing: EdgeCrossing | None) -> bool:
        """Return whether densities and contents together tell an edge and its place."""
        if crossing is None:
            return not (edge.is_doubtful or edge.altitude_sigma > _LARGEST_PLACE_SIGMA)
        of_contents = float(crossing.altitude_sigma.max())
        far = float(np.abs(crossing.altitude - edge.altitude).max())
        sigma = math.hypot(of_contents, edge.altitude_sigma)
        if edge.is_doubtful and not far <= _AGREEMENT * sigma:
            return False
        return not min(of_contents, edge.altitude_sigma) > _LARGEST_PLACE_SIGMA

    def _vertical_speed(self) -> float:
        """Return how fast the spacecraft climb or fall, m/s."""
        speeds = (abs(history.vertical_speed()) for history in self._histories)
        return max([_SLOWEST, *(speed for speed in speeds if math.isfinite(speed))])

    def _fit_crossing(self, edge: Edge, origin: int) -> tuple[int, EdgeCrossing] | None:
        """Return the fit of an edge near a time, ns, and that time as the origin of its times."""
        chief, deputy = self._histories
        half_window = self._half_window(edge)
        reach = round((half_window + _LARGEST_LAG) * NANOSECONDS_PER_SECOND)
        epochs = chief.epochs(origin - reach, origin + reach)
        if len(epochs) < 3:
            return None
        # Even epochs: an epoch that the receiver has left out stays without contents.
        step = int(np.median(np.diff(epochs)))
        epochs = np.arange(epochs[0], epochs[-1] + step, step)
        links_of_deputy = set(deputy.links)
        links = [link for link in chief.links if link in links_of_deputy]
        altitudes = geodetic_from_itrf(
            np.array([chief.position_at(origin + shift) for shift in (-reach // 4, reach // 4)])
        )[:, 2]
        is_rising = bool(altitudes[1] > altitudes[0])
        fit = fit_edge_crossings(
            (epochs - origin) / NANOSECONDS_PER_SECOND,
            chief.series(epochs, links),
            deputy.series(epochs, links),
            edge.altitude,
            is_dense_above=is_rising != edge.is_entry,
            half_window=half_window,
            width=edge.width,
            altitude_sigma=float(np.nan_to_num(edge.altitude_sigma)),
        )
        return None if fit is None else (origin, fit)

    def _half_window(self, edge: Edge) -> float:
        """Return for how long before and after an edge contents are fitted, s."""
        crossing = 0.0
        if math.isfinite(edge.width):
            crossing = min(0.5 * edge.width / self._vertical_speed(), _CROSSING_WINDOW)
        return crossing + choose_half_window(edge.time, self._edge_times)


def choose_half_window(edge_time: float, edge_times: Iterable[float]) -> float:
    """Return for how long before and after the crossing of an edge contents are fitted, s.

    Parameters
    ----------
    edge_time : float
        Time of the edge, s.
    edge_times : iterable of float
        Times of all edges, this one included, s. No other edge lies in the window, unless it is
        nearer than the shortest window.
    """
    to_other_edges = [abs(time - edge_time) for time in edge_times if time != edge_time]
    return float(
        np.clip(
            _WINDOW_TO_NEXT_EDGE * min(to_other_edges, default=math.inf),
            _SHORTEST_WINDOW,
            _CROSSING_WINDOW,
        )
    )

"""Pictures of cluster flights, of studies and reports: paths about the lead, sides over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vtff_analysis.cluster.cluster_flight import ClusterFlight
from vtff_analysis.plot_style import AXIS_COLOURS, make_figure, save_figure

__all__ = ["draw_paths", "draw_sides"]


def draw_paths(flights: Sequence[ClusterFlight], path: Path) -> None:
    """Draw the paths of flights in the orbital plane about the lead, one panel a flight.

    Parameters
    ----------
    flights
        Flights.
    path
        File.
    """
    figure = make_figure(4.6)
    for column, flight in enumerate(flights):
        axes = figure.add_subplot(1, len(flights), column + 1)
        for craft in range(flight.positions.shape[1]):
            track = 1e-3 * flight.positions[:, craft]
            colour = AXIS_COLOURS[craft % len(AXIS_COLOURS)]
            axes.plot(track[:, 1], track[:, 0], color=colour, linewidth=1.0)
            axes.plot(*track[0, [1, 0]], "o", color=colour)
            axes.plot(*track[-1, [1, 0]], "s", color=colour)
        axes.set(xlabel="in-track (km)", aspect="equal")
        if not column:
            axes.set_ylabel("radial (km)")
    save_figure(figure, path, "Paths about the lead (blue): starts (circles), ends (squares)")


def draw_sides(flights: Sequence[ClusterFlight], wanted: float, path: Path) -> None:
    """Draw the sides of flights over time.

    Parameters
    ----------
    flights
        Flights.
    wanted
        Side of the equilibrium, m.
    path
        File.
    """
    figure = make_figure(5.0)
    axes = figure.add_subplot()
    for flight in flights:
        axes.plot(
            flight.times / flight.period,
            1e-3 * flight.sides,
            color=AXIS_COLOURS[0],
            linewidth=0.7,
            alpha=0.5,
        )
    axes.axhline(1e-3 * wanted, color="0.2", linestyle=":")
    axes.axhline(0.5, color=AXIS_COLOURS[1], linestyle="--")
    axes.set(xlabel="time (orbits)", ylabel="side (km)", ylim=(0.0, None))
    save_figure(figure, path, "Sides of all starts; dotted: equilibrium, dashed: smallest allowed")

"""`vtff study potential_field`: the published program, and the same idea made to work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from vtff_analysis.cluster.cluster_flight import ClusterFlight
from vtff_analysis.cluster.flight import Decay, draw_starts, fly_cluster
from vtff_analysis.cluster.literal import run_literal
from vtff_analysis.cluster.pictures import draw_paths, draw_sides
from vtff_analysis.paper_comparison import ComparisonRow, PaperComparison, write_comparison
from vtff_analysis.plot_style import AXIS_COLOURS, STYLE, make_figure, save_figure
from vtff_control.cluster.elements_field import SHAPES, ElementsField
from vtff_control.cluster.potential_field import equilibrium_distance, potential
from vtff_sim_bridge.on_board.range_sensor import RangeSensor

__all__ = ["run_potential_field"]

_ORBITS = 3.0
_OUTAGES = ((9000.0, 9600.0), (9000.0, 14400.0))  # s: ten minutes, an orbit
_DECAY = 12000.0  # s
_DECELERATION = 5e-5  # m/s2
_ORBITS_FROM = 7000.0  # s: all have gathered
_ORBITS_OF_ELEMENTS = 6.0
_SENSOR_IN_ORBIT = RangeSensor(misalignment_sigma=3e-4)
_DECAY_IN_ORBIT = 20000.0  # s: the cluster goes round in orbits
_ORBITS_OF_DECAY = 9.4


@rc_context(STYLE)
def run_potential_field(
    folder: Path, starts: int = 30, seed: int = 0, say: Callable[[str], None] = print
) -> PaperComparison:
    """Run the published program and fly the corrected guidance; write table and figures.

    Parameters
    ----------
    folder
        Existing folder for potential_field.csv and the figures.
    starts
        Drawn starts of two chasers.
    seed
        Seed of the first start and its sensors; the other starts have the seeds that follow.
    say
        Takes a line on what is flown.
    """
    wanted = equilibrium_distance()
    rows = [*_literal_rows(), _row("equilibrium", "side", "a triangle", f"{1e-3 * wanted:.4f} km")]
    flights = []
    for number in range(starts):
        if number % 5 == 0:
            say(f"start {number + 1} of {starts}")
        chosen = seed + number
        flights.append(fly_cluster(draw_starts(chosen), _ORBITS, RangeSensor(), seed=chosen))
    rows += _start_rows(flights, wanted, "in the orbital plane")
    in_space = [
        fly_cluster(draw_starts(seed + i, dimensions=3), _ORBITS, RangeSensor(), seed=seed + i)
        for i in range(max(1, starts // 10))
    ]
    rows += _start_rows(in_space, wanted, "in space")
    say("one to five chasers")
    for count in range(1, 6):
        flight = fly_cluster(draw_starts(seed, count), _ORBITS, RangeSensor(), seed=seed)
        last = flight.sides[flight.last_orbit]
        hold = flight.velocity_change(flight.times[-1] - flight.period, np.inf)
        rows.append(
            _row(
                f"lead and {count} chaser{'s' if count > 1 else ''}",
                "closest; sides in the last orbit; hold of each",
                "any number",
                f"{flight.closest:.0f} m; {last.min():.0f} to {last.max():.0f} m; "
                + ", ".join(f"{value:.1f}" for value in hold)
                + " m/s an orbit",
            )
        )
    say("a sensor that fails, a neighbour that decays")
    for outage in _OUTAGES:
        blind = fly_cluster(draw_starts(seed), 4.0, RangeSensor(outage=outage), seed=seed)
        rows.append(
            _row(
                f"sensor of a chaser blind for {outage[1] - outage[0]:.0f} s",
                "closest; largest side; sides in the last orbit",
                "-",
                f"{blind.closest:.0f} m; {blind.sides[900:].max():.0f} m; "
                f"{_percent(blind.sides[blind.last_orbit].mean(axis=0) / wanted - 1.0)} %",
            )
        )
    decays = {
        watched: fly_cluster(
            draw_starts(seed),
            5.0,
            RangeSensor(),
            seed=seed,
            decay=Decay(_DECAY, _DECELERATION, watched),
        )
        for watched in (False, True)
    }
    for watched, flight in decays.items():
        rows.append(
            _row(
                "a chaser fails and decays, " + ("watched" if watched else "followed blindly"),
                "distance of the other from the lead at the end",
                "the others follow it (conclusion)",
                f"{1e-3 * flight.sides[-1, 0]:.3f} km",
            )
        )
    say("held by orbits")
    for shape in SHAPES:
        rows += _orbit_rows(shape, seed, max(1, starts // 10))
    for chasers, dimensions in ((3, 2), (4, 2), (5, 2), (3, 3)):
        rows += _orbit_rows("helix", seed, max(1, starts // 10), chasers, dimensions)
    rows += [_decay_in_orbit_row(shape, seed) for shape in ("ellipse", "helix")]
    _write_potential(folder / "figure_2.png")
    draw_paths(flights[:4], folder / "paths.png")
    draw_sides(flights, wanted, folder / "sides.png")
    _write_decay(decays, folder / "decay.png")
    write_comparison(rows, folder / "potential_field.csv")
    return PaperComparison(_sentence(flights, wanted), rows)


def _sentence(flights: Sequence[ClusterFlight], wanted: float) -> str:
    settled = sum(np.isfinite(flight.settling_time()) for flight in flights)
    means = [f.sides[f.last_orbit].mean(axis=0) / wanted - 1.0 for f in flights]
    error = 100.0 * np.abs(means).max()
    hold = [f.velocity_change(f.times[-1] - f.period, np.inf) for f in flights]
    return (
        f"{settled} of {len(flights)} drawn starts of two chasers gather to the triangle of "
        f"{wanted:.0f} m, whose sides err by at most {error:.2f} % on average over the last orbit; "
        f"no two come nearer than {min(f.closest for f in flights):.0f} m, and holding it at rest "
        f"takes {np.min(hold):.1f} to {np.max(hold):.1f} m/s an orbit. The paper shows a triangle "
        "without numbers; its program as printed forms none."
    )


def _row(subject: str, quantity: str, paper: str, measured: str) -> ComparisonRow:
    return ComparisonRow(subject, quantity, paper, measured)


def _percent(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{100.0 * value:+.2f}" for value in values)


def _literal_rows() -> list[ComparisonRow]:
    literal = run_literal()
    changes = ", ".join(f"{value:.1e}" for value in literal.velocity_changes)
    sides = ", ".join(f"{value:.0f}" for value in literal.separations)
    subject = "program as published, 150 s"
    return [
        _row(subject, "velocity changes of the chasers", "a formation", f"{changes} km/s"),
        _row(subject, "separations at the end", "a triangle", f"{sides} km"),
    ]


def _start_rows(flights: Sequence[ClusterFlight], wanted: float, where: str) -> list[ComparisonRow]:
    times = np.array([flight.settling_time() for flight in flights])
    means = np.array([f.sides[f.last_orbit].mean(axis=0) / wanted - 1.0 for f in flights])
    largest = max(float(np.abs(f.sides[f.last_orbit] / wanted - 1.0).max()) for f in flights)
    settle = [
        float(f.velocity_change(0.0, time).max()) for f, time in zip(flights, times, strict=True)
    ]
    hold = np.array([f.velocity_change(f.times[-1] - f.period, np.inf) for f in flights])
    settled = times[np.isfinite(times)]
    subject = f"{len(flights)} drawn starts {where}, two chasers"
    return [
        _row(subject, "settled within 2.5 %", "a triangle", f"{len(settled)}"),
        _row(
            subject,
            "time: median, longest",
            "-",
            f"{np.median(times):.0f}, {times.max():.0f} s",
        ),
        _row(
            subject,
            "sides in the last orbit: largest error of a mean, of any time",
            "-",
            f"{100.0 * np.abs(means).max():.2f} %, {100.0 * largest:.2f} %",
        ),
        _row(subject, "closest", "-", f"{min(f.closest for f in flights):.0f} m"),
        _row(
            subject,
            "velocity change of a chaser to settle",
            "-",
            f"{min(settle):.1f} to {max(settle):.1f} m/s",
        ),
        _row(
            subject,
            "hold of a chaser: the price of a side at rest in the rotating frame",
            "-",
            f"{hold.min():.1f} to {hold.max():.1f} m/s an orbit (mean {hold.mean():.1f})",
        ),
    ]


def _orbit_rows(
    shape: str, seed: int, starts: int, chasers: int = 2, dimensions: int = 2
) -> list[ComparisonRow]:
    """Return what a cluster of a shape costs that has gathered at rest and goes over to orbits."""
    flights = [
        fly_cluster(
            draw_starts(chosen, chasers, dimensions=dimensions),
            _ORBITS_OF_ELEMENTS,
            _SENSOR_IN_ORBIT,
            seed=chosen,
            orbits_from=_ORBITS_FROM,
            held=ElementsField(shape),
        )
        for chosen in range(seed, seed + starts)
    ]
    last = [flight.sides[flight.last_orbit] for flight in flights]
    change = [
        flight.velocity_change(_ORBITS_FROM, _ORBITS_FROM + flight.period).max()
        for flight in flights
    ]
    hold = [
        flight.velocity_change(flight.times[-1] - flight.period, np.inf).max() for flight in flights
    ]
    place = " in space" if dimensions == 3 else ""
    subject = f"{starts} drawn starts{place}, {chasers} chasers, held by orbits: {shape}"
    return [
        _row(subject, "closest", "future work", f"{min(f.closest for f in flights):.0f} m"),
        _row(
            subject,
            "distances in the last orbit",
            "-",
            f"{min(side.min() for side in last):.0f} to {max(side.max() for side in last):.0f} m",
        ),
        _row(subject, "first orbit, from rest", "-", f"at most {max(change):.1f} m/s"),
        _row(
            subject,
            "hold of a chaser in the last orbit",
            "-",
            f"{1e3 * min(hold):.0f} to {1e3 * max(hold):.0f} mm/s",
        ),
    ]


def _decay_in_orbit_row(shape: str, seed: int) -> ComparisonRow:
    """Return how near a chaser that fails in orbit comes to the others."""
    flight = fly_cluster(
        draw_starts(seed),
        _ORBITS_OF_DECAY,
        _SENSOR_IN_ORBIT,
        seed=seed,
        decay=Decay(_DECAY_IN_ORBIT, _DECELERATION),
        orbits_from=_ORBITS_FROM,
        held=ElementsField(shape),
    )
    nearest = flight.sides[flight.times >= _DECAY_IN_ORBIT].min(axis=0)
    hold = flight.velocity_change(flight.times[-1] - flight.period, np.inf)
    return _row(
        f"a chaser in orbit fails and decays: {shape}",
        "closest to the lead, to the other; hold of the other in the last orbit",
        "the others follow it (conclusion)",
        f"{nearest[1]:.0f}, {nearest[2]:.0f} m; {1e3 * hold[0]:.0f} mm/s",
    )


def _write_potential(path: Path) -> None:
    neighbours = np.array([[0.0, -500.0], [700.0, 600.0]])
    axis = np.linspace(-2500.0, 3000.0, 160)
    field = np.array(
        [[max(potential(neighbours, np.array([t, r])), 0.0) for t in axis] for r in axis]
    )
    figure = make_figure(7.0)
    axes = figure.add_subplot()
    drawn = axes.contourf(1e-3 * axis, 1e-3 * axis, field, levels=24, cmap="cividis")
    figure.colorbar(drawn, label="potential")
    axes.plot(*(1e-3 * neighbours.T), "o", color="#D55E00")
    axes.set(xlabel="in-track (km)", ylabel="radial (km)", aspect="equal")
    save_figure(figure, path, "Figure 2: potential of two satellites (dots)")


def _write_decay(decays: dict[bool, ClusterFlight], path: Path) -> None:
    figure = make_figure(4.6)
    axes = figure.add_subplot()
    for watched, flight in decays.items():
        axes.plot(
            flight.times / flight.period,
            1e-3 * flight.sides[:, 0],
            color=AXIS_COLOURS[int(watched)],
            linestyle="-" if watched else "--",
            label="decay watched for" if watched else "followed blindly",
        )
    axes.axvline(_DECAY / next(iter(decays.values())).period, color="0.35", linestyle=":")
    axes.set(xlabel="time (orbits)", ylabel="distance from the lead (km)", ylim=(0.0, None))
    axes.legend()
    save_figure(figure, path, "The other chaser, when one fails and decays (dotted line)")

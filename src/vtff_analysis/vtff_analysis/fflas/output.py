"""`vtff study fflas`: tables 3 and 5, figures 4 to 6 and 9 to 15 of paper 002, paper | measured."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from vtff_analysis.fflas.extension import (
    BUDGET,
    TABLE_3,
    TABLE_5,
    PhasingFlight,
    deorbit,
    extension_years,
    fly_phasing,
    separation_inputs,
)
from vtff_analysis.fflas.keeping import Keeping, keep_formation
from vtff_analysis.fflas.reconfiguration import (
    FFLAS_MASS,
    FFLAS_PERIOD,
    FFLAS_THRUST,
    ORBITS,
    Reconfiguration,
    fly_reconfiguration,
    formation_states,
    reconfiguration_planner,
    triangle_states,
)
from vtff_analysis.paper_comparison import ComparisonRow, PaperComparison, write_comparison
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    AXIS_NAMES,
    AXIS_STYLES,
    STYLE,
    make_figure,
    save_figure,
)
from vtff_analysis.studies.formation_designs import FFLAS_AXIS, fflas_formations, fly_formation
from vtff_control.guidance.phasing import (
    InfeasiblePhasingError,
    Phasing,
    impulsive_phasing_velocity,
    least_phasing_orbits,
    phase,
)
from vtff_dynamics.vectors import FloatArray

__all__ = ["FAULTS", "run_fflas"]

FAULTS = (
    "equations (7) and (8) with delta lambda = 2 rho_x cos alpha put B and C on a collision course "
    "(0.12 m); the formation closes with delta lambda = 0",
    "10 deg in 15 orbits for 15 m/s needs 2.15e-4 m/s2, 344 mN on 1600 kg; 1 mN (the paper's "
    "limit) takes 271 orbits, 25 mN 54 orbits",
    "table 5 beyond 2 % is not proportional to the propellant at 30 mm/s a day",
    "table 3 follows from no single difference of the orbits and from no single differential drag; "
    "the paper gives neither",
    "table 1 has an inclination of 98.78 deg, tables 2 and 4 have 98.51 deg",
    "the eccentricity and inclination vectors of the PCO are perpendicular: pairs meet in the R-N "
    "plane, and only the in-track separation keeps them apart",
)
"""Faults of the paper."""

_NAMES = ("A", "B", "C")
_PAIRS = ((0, 1), (0, 2), (1, 2))
_ANGLE = 10.0  # deg
_PHASING_ORBITS = 15.0
_PAPER_ACCELERATION = 2.15e-4  # m/s2: the one that 15 m/s needs


@rc_context(STYLE)
def run_fflas(
    folder: Path, days: float = 1.0, say: Callable[[str], None] = print
) -> PaperComparison:
    """Plan, fly, write the table and the figures, and return what was found.

    Parameters
    ----------
    folder
        Existing folder for fflas.csv, the CSV of figure 4 and the figures.
    days
        Length of the keeping; the paper's is one.
    say
        Takes a line on what is being done.
    """
    rows: list[ComparisonRow] = []
    say("phasing, figures 4 to 6")
    rows += _phasing(folder)
    rows += _table_3()
    say("reconfiguration, figures 9 to 11")
    final = formation_states("pco", ORBITS * FFLAS_PERIOD)
    for objective, axes, drift in (
        ("norms", "RTN", 0.0),
        ("axes", "RTN", 0.0),
        ("axes", "TN", 0.0),
        ("norms", "RTN", 1.0),
    ):
        plan = reconfiguration_planner(objective, axes, drift).plan(triangle_states(), final)
        flown = fly_reconfiguration(plan, final)
        rows += _reconfiguration_rows(flown, objective, axes, bool(drift))
        if axes == "TN":
            flown_in_plane = flown
            _write_reconfiguration(flown, folder)
    flights: dict[str, Keeping] = {}
    for formation in ("pco", "helix"):
        for thrust in (False, True):
            say(f"{formation} {'kept' if thrust else 'drifting'} for {days:g} day")
            key = f"{formation} {'kept' if thrust else 'free'}"
            duration = days * 86400.0 + FFLAS_PERIOD
            flights[key] = keep_formation(formation, duration, thrust=thrust)
        rows += _keeping_rows(flights[f"{formation} free"], flights[f"{formation} kept"])
    _write_keeping(flights["pco free"], flights["pco kept"], folder)
    literal = min(
        fly_formation("pco_literal", fflas_formations()["pco_literal"]), key=lambda p: p.closest
    )
    rows.append(
        ComparisonRow(
            "equation (7) as printed",
            f"closest {literal.first}-{literal.second}, 15 orbits",
            "-",
            f"{literal.closest:.2f} m",
        )
    )
    rows += _table_5(float(flights["pco kept"].velocity_change_per_day.max()))
    rows += _deorbit_rows()
    write_comparison(rows, folder / "fflas.csv")
    return PaperComparison(_sentence(flown_in_plane, flights["pco kept"]), rows)


def _sentence(flown: Reconfiguration, kept: Keeping) -> str:
    changes = 100.0 * flown.plan.velocity_changes_axes.sum(1)
    cost = 1e3 * kept.velocity_change_per_day
    return (
        "The triangle becomes the projected circular orbit for "
        f"{' / '.join(f'{change:.1f}' for change in changes)} cm/s (A / B / C, thrust in track and "
        f"across; paper: each below 5) with no two nearer than {flown.closest_approach:.1f} m "
        f"(asked: 10). Keeping it takes {cost.min():.1f} to {cost.max():.1f} mm/s a day with ideal "
        f"navigation (paper about 30) and holds it to {100.0 * kept.rms.max():.1f} cm RMS."
    )


def _phasing(folder: Path) -> list[ComparisonRow]:
    angle = math.radians(_ANGLE)
    angles, revolutions = np.arange(1.0, 51.0), (5, 10, 15, 20, 30)
    with (folder / "figure_4.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["angle_deg", *(f"velocity_change_{n}_orbits" for n in revolutions)])
        table = np.array(
            [
                [impulsive_phasing_velocity(FFLAS_AXIS, math.radians(a), n) for n in revolutions]
                for a in angles
            ]
        )
        writer.writerows(np.column_stack((angles, table)).tolist())
    figure = make_figure(5.0)
    axes = figure.add_subplot()
    for column, count in enumerate(revolutions):
        axes.plot(angles, table[:, column], label=f"{count} orbits", color=f"{0.15 * column}")
        axes.annotate(f"{count} orbits", (angles[-1], table[-1, column]), fontsize=11)
    axes.set(xlabel="separation (deg)", ylabel="velocity change (m/s)", xlim=(0, 56))
    save_figure(figure, folder / "figure_4.png", "Figure 4: impulsive phasing")

    paper = phase(FFLAS_AXIS, angle, _PHASING_ORBITS, _PAPER_ACCELERATION)
    flight = fly_phasing(paper)
    _write_phasing(paper, flight, folder)
    engine = FFLAS_THRUST / FFLAS_MASS
    least = least_phasing_orbits(FFLAS_AXIS, angle, engine)
    strong = phase(FFLAS_AXIS, angle, least * (1.0 + 1e-9), engine)
    try:
        weak = f"{phase(FFLAS_AXIS, angle, _PHASING_ORBITS, 1e-3 / FFLAS_MASS)}"
    except InfeasiblePhasingError as error:
        weak = str(error)
    subject = "phasing 10 deg in 15 orbits"
    limit = impulsive_phasing_velocity(FFLAS_AXIS, angle, _PHASING_ORBITS)
    return [
        ComparisonRow(subject, "two impulses (figure 4)", "-", f"{limit:.2f} m/s"),
        ComparisonRow(
            subject,
            f"low thrust, {_PAPER_ACCELERATION:.3g} m/s2 (figures 5, 6)",
            "about 15 m/s, at most 1 mN",
            f"{paper.velocity_change:.2f} m/s; {1e3 * _PAPER_ACCELERATION * FFLAS_MASS:.0f} mN",
        ),
        ComparisonRow(
            subject,
            "the same flown by equation (1)",
            "10 deg",
            f"{math.degrees(flight.angle[-1]):.3f} deg, axis "
            f"{flight.semi_major_axis[-1] - FFLAS_AXIS:+.0f} m, e {flight.eccentricity:.1e}",
        ),
        ComparisonRow(subject, "1 mN on 1600 kg", "feasible", weak),
        ComparisonRow(
            "phasing 10 deg, 25 mN",
            "least time, velocity change",
            "-",
            f"{least:.1f} orbits, {strong.velocity_change:.2f} m/s",
        ),
    ]


def _write_phasing(phasing: Phasing, flight: PhasingFlight, folder: Path) -> None:
    orbits = flight.times / FFLAS_PERIOD
    figure = make_figure(7.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(orbits, 1e-3 * flight.semi_major_axis, color=AXIS_COLOURS[0])
    upper.set(ylabel="semi-major axis (km)")
    lower.plot(orbits, np.degrees(flight.angle), color=AXIS_COLOURS[0])
    lower.set(ylabel="angle ahead (deg)", xlabel="time (orbits)")
    save_figure(
        figure, folder / "figure_5.png", "Figure 5: phasing by 10 deg, flown by equation (1)"
    )
    legs = np.array([0.0, phasing.thrust_time, phasing.thrust_time + phasing.coast_time])
    ends = np.append(legs[1:], flight.times[-1])
    thrust = 1e3 * phasing.acceleration * FFLAS_MASS * np.array([-1.0, 0.0, 1.0])
    figure = make_figure(4.0)
    axes = figure.add_subplot()
    axes.step(
        np.append(legs, ends[-1]) / FFLAS_PERIOD,
        np.append(thrust, thrust[-1]),
        where="post",
        color=AXIS_COLOURS[1],
    )
    axes.set(xlabel="time (orbits)", ylabel="along-track thrust (mN)")
    save_figure(figure, folder / "figure_6.png", "Figure 6: thrust that 15 m/s in 15 orbits needs")


def _table_3() -> list[ComparisonRow]:
    rows = []
    for angle, months in TABLE_3.items():
        axis, acceleration = separation_inputs(angle, months)
        rows.append(
            ComparisonRow(
                "table 3: until 100 m apart",
                f"{angle} deg",
                f"about {months} months",
                f"needs {axis:.2f} m between the axes, or {acceleration:.2e} m/s2 of "
                "differential drag (not given)",
            )
        )
    return rows


def _reconfiguration_rows(
    flown: Reconfiguration, objective: str, axes: str, safe: bool
) -> list[ComparisonRow]:
    plan = flown.plan
    subject = f"triangle to PCO, least {objective} on {axes}" + (", passively safe" if safe else "")
    changes = plan.velocity_changes if objective == "norms" else plan.velocity_changes_axes.sum(1)
    drift = f"{flown.closest_drifts.min():.2f} m"
    if plan.safe_step is not None and plan.closest_drifts_during is not None:
        later = flown.closest_drifts[plan.safe_step :].min()
        drift += f"; from step {plan.safe_step} ({plan.safe_step * plan.step:.0f} s) {later:.2f} m"
        unsafe = plan.closest_drifts_during[plan.safe_step :] < 10.0 - 0.01
        drift += f"; not safe during {unsafe.sum()} of {len(unsafe)} steps"
    paper = "each < 5 cm/s" if axes == "TN" else "-"
    return [
        ComparisonRow(
            subject,
            "velocity changes, total",
            paper,
            ", ".join(f"{100.0 * value:.2f}" for value in changes)
            + f"; {100.0 * changes.sum():.2f} cm/s",
        ),
        ComparisonRow(
            subject,
            "closest, planned; flown in nonlinear motion",
            ">= 10 m",
            f"{plan.closest_approach:.3f}; {flown.closest_approach:.3f} m",
        ),
        ComparisonRow(subject, "closest in an orbit after thrust is lost", "-", drift),
    ]


def _write_reconfiguration(flown: Reconfiguration, folder: Path) -> None:
    positions = flown.flight.relative_states[:, :, :3]
    figure = make_figure(6.0)
    for index, (horizontal, vertical) in enumerate(((1, 2), (1, 0))):
        axes = figure.add_subplot(1, 2, index + 1)
        for craft, name in enumerate(_NAMES):
            path = positions[:, craft]
            axes.plot(
                path[:, horizontal],
                path[:, vertical],
                color=AXIS_COLOURS[craft],
                linestyle=AXIS_STYLES[craft],
                label=name,
            )
            axes.plot(*path[0, [horizontal, vertical]], "o", color=AXIS_COLOURS[craft])
            axes.plot(*path[-1, [horizontal, vertical]], "s", color=AXIS_COLOURS[craft])
        axes.set(xlabel=f"{AXIS_NAMES[horizontal]} (m)", ylabel=f"{AXIS_NAMES[vertical]} (m)")
        axes.set_aspect("equal")
        axes.legend()
    save_figure(
        figure, folder / "figure_9.png", "Figure 9: triangle (circles) to PCO (squares), T-N thrust"
    )
    _write_distances(
        flown.flight.times / 60.0,
        "time (min)",
        positions,
        folder / "figure_10.png",
        "Figure 10: distances during the reconfiguration",
    )
    figure = make_figure(4.5)
    axes = figure.add_subplot()
    plan = flown.plan
    times = plan.step * np.arange(plan.accelerations.shape[1] + 1) / 60.0
    for craft, name in enumerate(_NAMES):
        summed = plan.step * np.abs(plan.accelerations[craft]).sum(axis=1).cumsum()
        axes.plot(
            times,
            100.0 * np.append(0.0, summed),
            color=AXIS_COLOURS[craft],
            linestyle=AXIS_STYLES[craft],
            label=name,
        )
    axes.set(xlabel="time (min)", ylabel="velocity change, sum over axes (cm/s)")
    axes.legend()
    save_figure(figure, folder / "figure_11.png", "Figure 11: velocity changes, T-N thrust")


def _write_distances(
    times: FloatArray, label: str, positions: FloatArray, path: Path, title: str
) -> None:
    figure = make_figure(4.5)
    axes = figure.add_subplot()
    _draw_distances(axes, times, positions)
    axes.axhline(10.0, color="0.35", linestyle=":")
    axes.set(xlabel=label, ylabel="distance (m)", ylim=(0.0, None))
    axes.legend(loc="lower right")
    save_figure(figure, path, title)


def _draw_distances(axes: object, times: FloatArray, positions: FloatArray) -> None:
    for index, (first, second) in enumerate(_PAIRS):
        axes.plot(  # type: ignore[attr-defined]
            times,
            np.linalg.norm(positions[:, second] - positions[:, first], axis=1),
            color=AXIS_COLOURS[index],
            linestyle=AXIS_STYLES[index],
            label=f"{_NAMES[first]}-{_NAMES[second]}",
        )


def _keeping_rows(free: Keeping, kept: Keeping) -> list[ComparisonRow]:
    subject = (
        f"keeping {kept.formation} on 8x8 truth, {kept.times[-1] / FFLAS_PERIOD - 1.0:.1f} orbits"
    )
    cost = ", ".join(f"{1e3 * value:.1f}" for value in kept.velocity_change_per_day)
    rms = ", ".join(f"{100.0 * value:.1f}" for value in kept.rms)
    paper = kept.formation == "pco"
    return [
        ComparisonRow(
            subject,
            "mm/s in a day: A, B, C",
            "about 30, ideal navigation" if paper else "-",
            cost,
        ),
        ComparisonRow(subject, "deviation from the design, RMS", "-", f"{rms} cm"),
        ComparisonRow(
            subject,
            "closest pair; in the R-N plane",
            "-",
            f"{kept.closest_pair:.2f} m; {kept.closest_pair_radial_normal:.2f} m",
        ),
        ComparisonRow(
            f"{kept.formation} without thrust",
            "closest pair; in the R-N plane",
            "far apart for 15 orbits" if paper else "-",
            f"{free.closest_pair:.2f} m; {free.closest_pair_radial_normal:.2f} m",
        ),
    ]


def _write_keeping(free: Keeping, kept: Keeping, folder: Path) -> None:
    for craft, (name, number) in enumerate(zip(_NAMES, (12, 13, 14), strict=True)):
        figure = make_figure(7.0)
        for column, (flight, what) in enumerate(((free, "without thrust"), (kept, "kept"))):
            axes = figure.add_subplot(1, 2, column + 1)
            path = flight.positions[:, craft]
            axes.plot(path[:, 1], path[:, 2], color=AXIS_COLOURS[craft], linewidth=0.8)
            axes.plot(*path[0, 1:], "o", color="0.2")
            axes.set(xlabel="in-track (m)", ylabel="cross-track (m)", title=what)
            axes.set_aspect("equal")
            axes.set_xlim(-20.0, 20.0)
            axes.set_ylim(-20.0, 20.0)
        save_figure(
            figure, folder / f"figure_{number}.png", f"Figure {number}: PCO, satellite {name}"
        )
    figure = make_figure(7.0)
    for row, (flight, what) in enumerate(((free, "without thrust"), (kept, "kept"))):
        axes = figure.add_subplot(2, 1, row + 1)
        _draw_distances(axes, flight.times / FFLAS_PERIOD, flight.positions)
        axes.set(ylabel="distance (m)", title=what, ylim=(20.0, 34.0))
        axes.legend(loc="upper left", ncols=3)
        if row:
            axes.set_xlabel("time (orbits)")
    save_figure(figure, folder / "figure_15.png", "Figure 15: distances in the PCO")


def _table_5(velocity_change_per_day: float) -> list[ComparisonRow]:
    rows = []
    for percent, years in TABLE_5.items():
        printed = extension_years(percent, 0.030)
        rows.append(
            ComparisonRow(
                "table 5: extension in the PCO",
                f"{percent} % of {BUDGET:g} m/s",
                f"about {years} years; its 30 mm/s a day give {printed:.1f}",
                f"{extension_years(percent, velocity_change_per_day):.0f} years at "
                f"{1e3 * velocity_change_per_day:.1f} mm/s a day, ideal navigation",
            )
        )
    return rows


def _deorbit_rows() -> list[ComparisonRow]:
    rows: Sequence[tuple[str, float]] = (("one engine", 1.0), ("four engines", 4.0))
    result = []
    for name, engines in rows:
        down = deorbit(engines * FFLAS_THRUST, FFLAS_MASS)
        met = "met" if down.days <= 91.0 else "not met"
        result.append(
            ComparisonRow(
                "deorbit to 120 km",
                f"{name} of 25 mN",
                "less than three months",
                f"{down.velocity_change:.0f} m/s, {down.days:.0f} days: three months are {met}",
            )
        )
    return result

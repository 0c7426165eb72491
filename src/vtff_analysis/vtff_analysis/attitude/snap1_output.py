"""Tables and figures of the SNAP-1 study: the paper's numbers beside the measured ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path

import numpy as np

from vtff_analysis.attitude.loop import AttitudeHistory
from vtff_analysis.attitude.orbit_raising import LAUNCH, OrbitRaising, fly_orbit_raising
from vtff_analysis.attitude.raising_orbits import DeterminedOrbits, determine_raising_orbits
from vtff_analysis.attitude.snap1 import (
    CompassResult,
    DipoleResult,
    KickResult,
    ThreeAxisResult,
    fly_compass,
    fly_dipole_estimation,
    fly_kick,
    fly_three_axis,
)
from vtff_analysis.paper_comparison import ComparisonRow, PaperComparison, write_comparison
from vtff_analysis.plot_style import AXIS_COLOURS, make_figure, save_figure
from vtff_dynamics.vectors import FloatArray

__all__ = ["run_snap1"]


# The averaging method is tried from so many drawn attitudes, over so many hours each.
_AVERAGING_STARTS, _AVERAGING_HOURS = 3, 4.0
_FINDING_SECONDS = 1800.0  # within which the attitude is found and taken up


def run_snap1(
    folder: Path, hours: float = 28.0, seed: int = 1, say: Callable[[str], None] = print
) -> PaperComparison:
    """Fly the cases of the paper, write figures 2 to 11 and the table, and return what was found.

    Parameters
    ----------
    folder : Path
        Existing folder for snap1.csv and the figures.
    hours : float
        Length of the three-axis flights; the paper's are 28 h. Compass mode is flown for at most a
        day.
    seed : int
        Seed of the noise and of everything that is drawn.
    say : callable
        Takes a line on what is flown.
    """
    rows: list[ComparisonRow] = []
    say("compass mode without and with the wheel")
    for speed, paper in ((0.0, "5.2, 10.1, -29.9 uT"), (-1000.0, "(equation 4 rests on it)")):
        compass = fly_compass(speed, min(hours, 24.0), seed)
        rows += _compass_rows(compass, speed, paper)
        if speed == 0.0:
            _write_lines(
                folder / "figure_2.png",
                "Figure 2: measured field in compass mode",
                compass.history,
                [("field (uT)", 1e6 * compass.history.field_body, "xyz")],
                last=3.0,
            )
    say("averaging of the field over swings that nothing has damped")
    rows += _averaging_rows(min(hours, _AVERAGING_HOURS), seed)
    say("dipole estimator, figure 5")
    dipole = fly_dipole_estimation(seed=seed)
    rows += _dipole_rows(dipole)
    _write_dipole(dipole, folder / "figure_5.png")
    flights: dict[str, ThreeAxisResult] = {}
    for name, paper_name, figures in (
        ("first", "compensation (6)", (3, 4)),
        ("final", "compensation (14)", (6, 7)),
        ("none", "no compensation", None),
        ("estimated", "estimated on board", None),
    ):
        say(f"three axes, {paper_name}")
        flights[name] = fly_three_axis(name, hours, seed=seed)  # type: ignore[arg-type]
        rows += _three_axis_rows(flights[name], paper_name)
        if figures is not None:
            _write_three_axis(flights[name], paper_name, figures, folder)
    say("thruster firings, figures 8 and 9")
    kick = fly_kick(seed=seed)
    free = fly_kick(damped=False, strengths=(1.0,), seed=seed)
    rows += _kick_rows(kick, free)
    _write_lines(
        folder / "figure_8.png",
        "Figure 8: measured field with five firings in compass mode",
        kick.history,
        [("field (uT)", 1e6 * kick.history.field_body, "xyz")],
    )
    _write_lines(
        folder / "figure_9.png",
        "Figure 9: swing of the dipole against the field",
        kick.history,
        [("swing (deg)", kick.swing_deg[:, None], ("dipole to field",))],
    )
    say("orbit raising, figures 10 and 11")
    raising = fly_orbit_raising()
    rows += _raising_rows(raising)
    say("orbits of the campaign from GPS fixes, one in three days")
    orbits = determine_raising_orbits(raising, seed=seed)
    rows += _determined_rows(orbits, raising)
    _write_raising(raising, orbits, folder)
    write_comparison(rows, folder / "snap1.csv")
    return PaperComparison(_sentence(flights, free, raising, hours), rows)


def _sentence(
    flights: Mapping[str, ThreeAxisResult], free: KickResult, raising: OrbitRaising, hours: float
) -> str:
    final, onboard = (
        " / ".join(f"{sigma:.2f}" for sigma in flights[name].statistics.sigma_deg)
        for name in ("final", "estimated")
    )
    return (
        f"With the paper's compensation (14) SNAP-1 points to {final} deg over {hours:g} h (roll / "
        f"pitch / yaw, one sigma; the paper's 28 h of flight 2.9 / 0.3 / 2.6), with the dipole "
        f"estimated on board to {onboard} deg. A firing swings it by "
        f"{max(free.peak_deg):.0f} deg (paper 55), and orbit "
        f"raising leads it {raising.peak_deg:.0f} deg away from Tsinghua-1 (paper 124)."
    )


def _numbers(values: Sequence[float] | FloatArray, unit: str, digits: int = 2) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values) + f" {unit}"


def _averaging_rows(hours: float, seed: int) -> list[ComparisonRow]:
    rows = []
    for speed in (0.0, -1000.0):
        seeds = range(seed, seed + _AVERAGING_STARTS)
        errors = [fly_compass(speed, hours, s, released=True).direction_error_deg for s in seeds]
        rows.append(
            ComparisonRow(
                f"averaging method, wheel {speed:.0f} rpm, drawn starts at rest",
                "direction of the mean field against the dipole",
                "taken as equal",
                _numbers(errors, "deg", 1),
            )
        )
    return rows


def _compass_rows(result: CompassResult, speed: float, paper: str) -> list[ComparisonRow]:
    subject = f"compass mode, wheel {speed:.0f} rpm"
    return [
        ComparisonRow(
            subject, "mean field (table 2)", paper, _numbers(result.mean_field_ut, "uT", 1)
        ),
        ComparisonRow(
            subject,
            "direction of the mean field against the dipole",
            "taken as equal",
            f"{result.direction_error_deg:.1f} deg",
        ),
        ComparisonRow(
            subject,
            "oscillations in an orbit",
            "10" if speed == 0.0 else "-",
            f"{result.oscillations_per_orbit:.1f}",
        ),
    ]


def _dipole_rows(result: DipoleResult) -> list[ComparisonRow]:
    error = 1e3 * (result.dipole[-1] - result.true_dipole)
    return [
        ComparisonRow(
            "dipole estimator (figure 5), wheel -2700 rpm",
            "error after the last sample",
            "not known",
            _numbers(error, "mA m2"),
        ),
        ComparisonRow(
            "dipole estimator (figure 5), wheel -2700 rpm",
            "its sigma; y is the axis of the wheel",
            "not given",
            _numbers(1e3 * result.sigma[-1], "mA m2"),
        ),
    ]


_TABLE_5 = {
    "compensation (6)": ("1.6, -0.7, 1.6 deg", "11.4, 2.0, 6.6 deg", "+-300 rpm"),
    "compensation (14)": ("1.5, -0.2, 1.6 deg", "2.9, 0.3, 2.6 deg", "+-100 rpm"),
}


def _three_axis_rows(result: ThreeAxisResult, name: str) -> list[ComparisonRow]:
    mean, sigma, wheel = _TABLE_5.get(name, ("-", "-", "-"))
    low, high = result.wheel_variation_rpm
    subject = f"three axes, {name}"
    statistics = result.statistics
    return [
        ComparisonRow(
            subject, "mean roll, pitch, yaw (table 5)", mean, _numbers(statistics.mean_deg, "deg")
        ),
        ComparisonRow(
            subject,
            "1 sigma roll, pitch, yaw (table 5)",
            sigma,
            _numbers(statistics.sigma_deg, "deg"),
        ),
        ComparisonRow(subject, "wheel around -2700 rpm", wheel, f"{low:+.0f} to {high:+.0f} rpm"),
    ]


def _kick_rows(damped: KickResult, free: KickResult) -> list[ComparisonRow]:
    subject = "firing of 3 s, 0.19 mN m, compass mode"
    return [
        ComparisonRow(subject, "peak without damping", "55 deg", _numbers(free.peak_deg, "deg", 1)),
        ComparisonRow(
            subject,
            "pendulum with the field at the place of the firing",
            "-",
            _numbers(free.formula_deg, "deg", 1),
        ),
        ComparisonRow(
            subject,
            "pendulum with the mean of the field until the peak",
            "-",
            _numbers(free.mean_field_formula_deg, "deg", 1),
        ),
        ComparisonRow(
            subject,
            "pendulum from the state after the firing",
            "-",
            _numbers(free.actual_deg, "deg", 1),
        ),
        ComparisonRow(
            subject, "peaks with damping, five firings", "-", _numbers(damped.peak_deg, "deg", 1)
        ),
        ComparisonRow(
            subject,
            "left an orbit after the first firing",
            "damped within one orbit",
            f"{damped.after_an_orbit_deg:.1f} deg",
        ),
    ]


def _raising_rows(result: OrbitRaising) -> list[ComparisonRow]:
    subject = "orbit raising towards Tsinghua-1 (figures 10, 11)"
    peak, raised = (
        (LAUNCH + timedelta(days=day)).strftime("%d %B")
        for day in (result.peak_day, result.raised_day)
    )
    return [
        ComparisonRow(
            subject,
            "largest separation",
            "124 deg, 11 September",
            f"{result.peak_deg:.0f} deg, {peak}",
        ),
        ComparisonRow(subject, "1 km above", "19 September", raised),
        ComparisonRow(subject, "closest approach", "16.7 deg", f"{result.closest_deg:.1f} deg"),
        ComparisonRow(
            subject,
            'closest approach, if "nearly 90 deg" on 15 August was 89, 88 deg',
            "which it was is not given",
            _numbers([fly_orbit_raising(seen).closest_deg for seen in (89.0, 88.0)], "deg", 1),
        ),
        ComparisonRow(
            subject, "turn of the perigee", "115 days", f"{result.perigee_period:.0f} days"
        ),
        ComparisonRow(
            subject,
            "decay against Tsinghua-1; raise in October (both fitted)",
            "not given",
            f"{result.decay_difference:.1f} m a day; {result.last_firings:.0f} m",
        ),
    ]


def _determined_rows(orbits: DeterminedOrbits, raising: OrbitRaising) -> list[ComparisonRow]:
    subject = "orbits from GPS fixes of 20 s, 3.5 orbits a day (figures 10, 11)"
    axis, _, x, y, *_ = np.sqrt((orbits.errors**2).mean(axis=0))
    ratio = orbits.error_over_sigma
    mean_axis = float(orbits.elements_mean[:, 0].mean())
    decay, sigma = orbits.decay()
    return [
        ComparisonRow(
            subject,
            f"error of the mean semi-major axis, RMS of {len(orbits.days)} arcs; over its sigma",
            "not given",
            f"{axis:.2f} m; {ratio[0]:.2f}",
        ),
        ComparisonRow(
            subject,
            "error of the mean eccentricity vector, RMS of both parts; over their sigmas",
            "not given",
            f"{x / mean_axis:.1e}, {y / mean_axis:.1e}; {ratio[2]:.2f}, {ratio[3]:.2f}",
        ),
        ComparisonRow(
            subject,
            "decay before the firings by these orbits; true",
            "not given",
            f"{decay:.3f} +- {sigma:.3f} m a day; {raising.decay_difference:.3f} m a day",
        ),
    ]


def _write_raising(result: OrbitRaising, orbits: DeterminedOrbits, folder: Path) -> None:
    zero = result.elements_mean[0, 0] - result.axis_difference[0]  # axis of Tsinghua-1, m
    nothing = np.full(len(orbits.days), np.nan)
    for number, title, panels in (
        (
            10,
            "SNAP-1 against Tsinghua-1",
            (
                (
                    "semi-major axis (km)",
                    1e-3 * result.axis_difference,
                    1e-3 * (orbits.elements_mean[:, 0] - zero),
                ),
                ("separation (deg)", result.separation_deg, nothing),
            ),
        ),
        (
            11,
            "mean eccentricity of SNAP-1",
            (("eccentricity", result.eccentricity, orbits.eccentricity),),
        ),
    ):
        figure = make_figure(1.5 + 3.2 * len(panels))
        for row, (label, values, determined) in enumerate(panels):
            axes = figure.add_subplot(len(panels), 1, row + 1)
            axes.plot(result.days, values, color=AXIS_COLOURS[0], linewidth=1.2, label="true")
            axes.set_ylabel(label)
            if determined is nothing:
                continue
            axes.plot(orbits.days, determined, ".", color=AXIS_COLOURS[1], label="from GPS fixes")
            axes.legend(loc="lower right")
        axes.set_xlabel("days since 28 June 2000")
        save_figure(figure, folder / f"figure_{number}.png", f"Figure {number}: {title}")


def _write_lines(
    path: Path,
    title: str,
    history: AttitudeHistory,
    panels: Sequence[tuple[str, FloatArray, Sequence[str]]],
    last: float | None = None,
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw columns over hours, one panel each; `last` keeps the last so many hours.

    `limits` are those of all panels, where what lies beyond them is not to be seen.
    """
    figure = make_figure(1.5 + 3.2 * len(panels))
    late = history.time >= (0.0 if last is None else history.time[-1] - 3600.0 * last)
    for number, (label, values, names) in enumerate(panels):
        axes = figure.add_subplot(len(panels), 1, number + 1)
        for column, name in enumerate(names):
            axes.plot(
                history.time[late] / 3600.0,
                values[late, column],
                color=AXIS_COLOURS[column],
                linewidth=1.0,
                label=name,
            )
        axes.set_ylabel(label)
        axes.set_ylim(limits)
        if len(names) > 1:
            axes.legend(loc="upper right", ncols=len(names))
    axes.set_xlabel("time (h)")
    save_figure(figure, path, title)


def _write_three_axis(
    result: ThreeAxisResult, name: str, figures: tuple[int, int], folder: Path
) -> None:
    history = result.history
    panels: tuple[tuple[str, str, FloatArray, Sequence[str]], ...] = (
        ("attitude", "angle (deg)", history.angles_deg, ("roll", "pitch", "yaw")),
        ("wheel", "speed (rpm)", history.wheel_speed_rpm[:, None], ("wheel",)),
    )
    for number, (subject, label, values, names) in zip(figures, panels, strict=True):
        # The first half hour, in which the attitude is found, would hide what the paper shows.
        settled = values[history.time > _FINDING_SECONDS]
        margin = 0.25 * float(settled.max() - settled.min())
        _write_lines(
            folder / f"figure_{number}.png",
            f"Figure {number}: {subject} with {name}",
            history,
            [(label, values, names)],
            limits=(float(settled.min()) - margin, float(settled.max()) + margin),
        )


def _write_dipole(result: DipoleResult, path: Path) -> None:
    figure = make_figure(4.7)
    axes = figure.add_subplot()
    for column, name in enumerate("xyz"):
        colour = AXIS_COLOURS[column]
        estimate, sigma = result.dipole[:, column], result.sigma[:, column]
        axes.plot(result.time / 60.0, estimate, color=colour, label=name)
        axes.fill_between(
            result.time / 60.0, estimate - sigma, estimate + sigma, color=colour, alpha=0.2
        )
        axes.axhline(result.true_dipole[column], color=colour, linestyle=":")
    axes.set_ylim(
        float(result.true_dipole.min()) - 0.05, float(np.abs(result.true_dipole).max()) + 0.05
    )
    axes.set_xlabel("time (min)")
    axes.set_ylabel("dipole (A m²)")
    axes.legend(loc="upper right", ncols=3)
    save_figure(figure, path, "Figure 5: dipole estimated in compass mode (dotted: true)")

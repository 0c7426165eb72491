"""Sensitivity of formation acquisition to the thrust cap (Peng and others, appendix A, figure A2).

Each point is one closed-loop run of the reference scenario with another cap on the acceleration of
every axis: the campaign config/campaign/thrust_cap.yaml.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vtff_analysis.recordings.history import AXES

PAPER_SMALLEST_OPERABLE_CAP = 0.02
"""Cap in m/s2 below which the paper's formation is never reached (appendix A.1)."""

PAPER_SIGN_CHANGE_CAP = 1.20
"""Cap in m/s2 below which the paper's deputy passes the chief (region 1 of appendix A.1)."""

PAPER_OPTIMUM = (1.4, 75.48)
"""Cap in m/s2 and in-track total in m/s at the paper's local fuel optimum (appendix A.1)."""

PAPER_MINIMUM_AT_OPTIMUM = (1.4, 38.17)
"""Cap in m/s2 and smallest in-track separation in m of the paper's reference run."""

PAPER_LARGEST_MINIMUM = (1.95, 69.02)
"""Cap in m/s2 and largest of the smallest in-track separations in m (appendix A.1)."""

# Okabe-Ito colours, told apart with any colour vision, in the order of the paper's blue, red,
# green for radial, in-track and cross-track.
_AXIS_COLOURS = ("#0072B2", "#D55E00", "#009E73")
_AXIS_STYLES = ("-", "--", ":")
_PAPER_COLOUR = "#000000"

_COLUMNS = (
    "cap_m_per_s2",
    "delta_v_radial_m_per_s",
    "delta_v_in_track_m_per_s",
    "delta_v_cross_track_m_per_s",
    "minimum_in_track_m",
    "minimum_in_track_time_s",
    "settling_time_s",
)


@dataclass(frozen=True)
class ThrustCapPoint:
    """Result of one run.

    Attributes
    ----------
    cap
        Cap of each axis in m/s2.
    delta_v_radial, delta_v_in_track, delta_v_cross_track
        Totals of the run in m/s.
    minimum_in_track, minimum_in_track_time
        Smallest in-track position relative to the chief in m, and its time in s.
    settling_time
        Time in s from which the deputy stays within 1 m of the target; infinite if it never does.
    """

    cap: float
    delta_v_radial: float
    delta_v_in_track: float
    delta_v_cross_track: float
    minimum_in_track: float
    minimum_in_track_time: float
    settling_time: float


@dataclass(frozen=True)
class ThrustCapFindings:
    """Landmarks of the study, the numbers that appendix A.1 of the paper names.

    Attributes
    ----------
    smallest_settling_cap
        Smallest cap in m/s2 with which the formation is reached within the run.
    sign_change_cap
        Cap in m/s2 from which the deputy no longer passes the chief, interpolated.
    optimum_cap, optimum_delta_v
        Local minimum of the in-track total between the sign change and the largest minimum:
        cap in m/s2 and total in m/s.
    largest_minimum_cap, largest_minimum_in_track
        Cap in m/s2 at which the smallest in-track position is largest, and that position in m.
    asymptotic_delta_v
        In-track total in m/s at the largest cap of the study.
    """

    smallest_settling_cap: float
    sign_change_cap: float
    optimum_cap: float
    optimum_delta_v: float
    largest_minimum_cap: float
    largest_minimum_in_track: float
    asymptotic_delta_v: float

    def describe(self) -> str:
        """Return the findings in one sentence, with those of the paper beside them."""
        return (
            f"The formation is reached with caps from {self.smallest_settling_cap:.3f} m/s² on "
            f"(paper {PAPER_SMALLEST_OPERABLE_CAP:g}); from {self.sign_change_cap:.2f} m/s² on "
            f"(paper {PAPER_SIGN_CHANGE_CAP:.2f}) the deputy does not pass the chief, and with "
            f"{self.largest_minimum_cap:.2f} m/s² it stays farthest from it, "
            f"{self.largest_minimum_in_track:.2f} m (paper: with {PAPER_LARGEST_MINIMUM[0]:.2f}, "
            f"{PAPER_LARGEST_MINIMUM[1]:.2f} m)."
        )


def thrust_cap_point(cap: float, figures: Mapping[str, float | None]) -> ThrustCapPoint:
    """Return the point of a run.

    Parameters
    ----------
    cap
        Thrust cap of the run in m/s2.
    figures
        Figures of the run by the names of docs/summary.md.
    """
    settling_time = figures["settling_time_s"]
    radial, in_track, cross_track = (
        _number(figures, f"delta_v_total_{axis}_m_per_s") for axis in AXES
    )
    return ThrustCapPoint(
        cap=cap,
        delta_v_radial=radial,
        delta_v_in_track=in_track,
        delta_v_cross_track=cross_track,
        minimum_in_track=_number(figures, "minimum_in_track_m"),
        minimum_in_track_time=_number(figures, "minimum_in_track_time_s"),
        settling_time=float("inf") if settling_time is None else settling_time,
    )


def _number(figures: Mapping[str, float | None], name: str) -> float:
    value = figures[name]
    if value is None:
        raise ValueError(f"thrust caps: a run has no {name}")
    return value


def find_landmarks(points: Sequence[ThrustCapPoint]) -> ThrustCapFindings:
    """Find the numbers that the paper names in the points of a study.

    Parameters
    ----------
    points
        Points in the order of their caps, on both sides of every landmark.

    Returns
    -------
    ThrustCapFindings

    Raises
    ------
    ValueError
        If the points do not contain a landmark; the message names it.
    """
    settling = [point.cap for point in points if np.isfinite(point.settling_time)]
    if not settling:
        raise ValueError("thrust caps: the formation is not reached with any of them")
    largest = max(points, key=lambda point: point.minimum_in_track)
    pairs = zip(points, points[1:], strict=False)
    crossing = [(a, b) for a, b in pairs if a.minimum_in_track < 0.0 <= b.minimum_in_track]
    if not crossing:
        raise ValueError("thrust caps: the smallest in-track position does not change sign")
    below, above = crossing[-1]
    fraction = below.minimum_in_track / (below.minimum_in_track - above.minimum_in_track)
    sign_change = below.cap + fraction * (above.cap - below.cap)
    middle = [point for point in points if sign_change <= point.cap <= largest.cap]
    optimum = min(middle, key=lambda point: point.delta_v_in_track)
    return ThrustCapFindings(
        smallest_settling_cap=min(settling),
        sign_change_cap=sign_change,
        optimum_cap=optimum.cap,
        optimum_delta_v=optimum.delta_v_in_track,
        largest_minimum_cap=largest.cap,
        largest_minimum_in_track=largest.minimum_in_track,
        asymptotic_delta_v=points[-1].delta_v_in_track,
    )


def write_csv(points: Sequence[ThrustCapPoint], path: str | Path) -> None:
    """Write the points as CSV, one row each, column names with units; ``inf`` = never settles."""
    with open(path, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for point in points:
            writer.writerow([f"{value:.9g}" for value in dataclasses.astuple(point)])


def write_plot(points: Sequence[ThrustCapPoint], path: str | Path) -> None:
    """Draw the points in the form of the paper's figure A2, with the paper's own numbers marked.

    Parameters
    ----------
    points
        Points in the order of their caps.
    path
        Picture to write; its suffix gives the format.
    """
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    totals_axes, minimum_axes = figure.subplots(1, 2)
    caps = [point.cap for point in points]
    _draw_totals(totals_axes, caps, points)
    _draw_minimum(minimum_axes, caps, points)
    for axes in (totals_axes, minimum_axes):
        axes.set_xscale("log")
        axes.set_xlim(min(caps), max(caps))
        axes.set_xlabel("thrust cap per axis (m/s²)")
        axes.grid(True, which="major", color="0.88")
        axes.axvspan(min(caps), PAPER_SMALLEST_OPERABLE_CAP, color="0.92", zorder=0)
        axes.text(
            1.08 * min(caps),
            0.98,
            "never settles (paper)",
            transform=axes.get_xaxis_transform(),
            rotation="vertical",
            va="top",
            fontsize=8,
        )
    figure.savefig(path, dpi=150)


def _draw_totals(axes: Axes, caps: Sequence[float], points: Sequence[ThrustCapPoint]) -> None:
    """Draw panel A: total thrust against the cap."""
    names = ("radial", "in-track", "cross-track")
    totals = np.array(
        [[p.delta_v_radial, p.delta_v_in_track, p.delta_v_cross_track] for p in points]
    )
    for column, name in enumerate(names):
        axes.plot(
            caps, totals[:, column], _AXIS_STYLES[column], color=_AXIS_COLOURS[column], label=name
        )
    axes.plot(
        *PAPER_OPTIMUM, "o", color=_PAPER_COLOUR, fillstyle="none", label="paper, local optimum"
    )
    axes.set_ylabel("total thrust (m/s)")
    axes.set_ylim(-3.0, 1.25 * float(totals.max()))
    axes.set_title("A  total thrust of the run", loc="left")
    axes.legend(loc="center right", bbox_to_anchor=(0.98, 0.42), fontsize=9)


def _draw_minimum(axes: Axes, caps: Sequence[float], points: Sequence[ThrustCapPoint]) -> None:
    """Draw panel B: smallest in-track offset against the cap."""
    axes.plot(
        caps, [p.minimum_in_track for p in points], color=_AXIS_COLOURS[1], label="this study"
    )
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    marks = (
        ((PAPER_SIGN_CHANGE_CAP, 0.0), "s", "paper, sign change at 1.20"),
        (PAPER_MINIMUM_AT_OPTIMUM, "o", "paper, 38.17 m at 1.40"),
        (PAPER_LARGEST_MINIMUM, "^", "paper, largest 69.02 m at 1.95"),
    )
    for (cap, minimum), marker, label in marks:
        axes.plot(cap, minimum, marker, color=_PAPER_COLOUR, fillstyle="none", label=label)
    axes.set_ylabel("smallest in-track offset (m)")
    axes.set_title("B  smallest in-track offset", loc="left")
    axes.legend(loc="lower right", fontsize=9)

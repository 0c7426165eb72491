"""Plots of paper 000, figures 8 to 11, from a run: plateau, density profile, scintillation map."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_bringup.executables import ExecutableNotFoundError, share_file
from vtff_bringup.report.history import Boundary, DensityHistory, FloatArray, SatelliteColumns
from vtff_bringup.report.plot_style import (
    AXIS_COLOURS,
    MARK_COLOUR,
    STYLE,
    make_figure,
    save_figure,
)
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile, read_profile

_SECOND = 1_000_000_000
_KILOMETRE = 1e3
_WEAK_SCINTILLATION = 0.2
#: Profile that the receivers of a scenario saw.
_TABLES = {"esf": "esf", "esf_paper": "esf", "plumex": "plumex"}
#: Corners of the scintillation events of the paper's figure 10, deg north and deg east.
_PAPER_EVENTS = ((-7.1, -82.7), (-8.8, -67.6))
_PAPER_SCENARIOS = ("esf", "esf_paper")


def true_profile(scenario: str) -> ElectronDensityProfile | None:
    """Return the density that the receivers of a known scenario saw, else None."""
    table = _TABLES.get(scenario)
    if table is None:
        return None
    try:
        return read_profile(share_file("vtff_bringup", f"config/ionosphere/{table}.csv"))
    except (ExecutableNotFoundError, OSError):
        return None


def plot_density_profile(
    density: DensityHistory,
    boundaries: Sequence[Boundary],
    scenario: str,
    path: pathlib.Path,
    title: str,
) -> tuple[pathlib.Path, float]:
    """Draw density against altitude, measured and true, and their difference.

    Returns the path, and the mean absolute difference, electrons per cubic metre (NaN without
    a true profile).
    """
    profile = true_profile(scenario)
    falling = np.gradient(density.altitude) < 0.0
    lowest, highest = density.altitude.min(), density.altitude.max()
    difference = np.full(len(density.time), np.nan)
    if profile is not None:
        half = 0.5 * np.abs(density.separation)
        true = profile.mean_density(density.altitude - half, density.altitude + half)
        difference = density.density - true
    with mpl.rc_context(STYLE):
        figure = make_figure(8.0)
        axes: Any = figure.subplots(1, 2, sharey=True, width_ratios=(2, 1))
        for chosen, name, colour, marker in (
            (falling, "falling", AXIS_COLOURS[0], "o"),
            (~falling, "rising", AXIS_COLOURS[1], "x"),
        ):
            altitude = density.altitude[chosen] / _KILOMETRE
            style = {"color": colour, "marker": marker, "linestyle": "none", "markersize": 4}
            axes[0].plot(density.density[chosen], altitude, label=f"measured, {name}", **style)
            axes[1].plot(difference[chosen], altitude, **style)
        if profile is not None:
            height = np.linspace(lowest, highest, 4000)
            axes[0].plot(profile.density(height), height / _KILOMETRE, "k-", lw=1.2, label="true")
        for boundary in boundaries:
            if boundary.kind == "vertical":
                axes[0].axhline(boundary.altitude / _KILOMETRE, color=MARK_COLOUR, ls=":", lw=1.0)
        axes[0].set(xlabel="electron density (m$^{-3}$)", ylabel="altitude (km)")
        axes[0].set_title("density between the spacecraft; dotted: edges found")
        axes[1].set(xlabel="measured - true (m$^{-3}$)", title="difference")
        axes[0].legend()
        save_figure(figure, path, title)
    finite = difference[np.isfinite(difference)]
    return path, float(np.abs(finite).mean()) if len(finite) else float("nan")


def plot_plateau(
    slant_tec: dict[str, SatelliteColumns],
    start_time: int,
    path: pathlib.Path,
    title: str,
) -> pathlib.Path | None:
    """Draw vertical TEC of both spacecraft with the two satellites that are high for longest."""
    crafts = {topic.split("/")[1]: c for topic, c in slant_tec.items() if "/iono/" in topic}
    if not crafts:
        return None
    high = [c.prn[c.values["elevation"] > np.radians(30.0)] for c in crafts.values()]
    numbers, counts = np.unique(np.concatenate(high), return_counts=True)
    best = numbers[np.argsort(-counts, kind="stable")[:2]]
    with mpl.rc_context(STYLE):
        figure = make_figure(8.0)
        axes: Any = figure.subplots(len(best), len(crafts), sharex=True, sharey=True, squeeze=False)
        for column, (craft, values) in enumerate(sorted(crafts.items())):
            for row, prn in enumerate(best):
                mine = (values.prn == prn) & (values.values["elevation"] > np.radians(10.0))
                axis = axes[row, column]
                axis.plot(
                    (values.time[mine] - start_time) / _SECOND,
                    values.values["vtec_tecu"][mine],
                    ".",
                    ms=3,
                    color=AXIS_COLOURS[column],
                )
                axis.set_title(f"{craft}, PRN {int(prn)}")
                for edge in (30.10, 30.17):
                    axis.axhline(edge, color=MARK_COLOUR, ls=":", lw=1.0)
                if column == 0:
                    axis.set_ylabel("vertical TEC (TECU)")
                if row == len(best) - 1:
                    axis.set_xlabel("time into the run (s)")
        return save_figure(figure, path, title)


def plot_scintillation_map(
    scintillation: SatelliteColumns,
    density: DensityHistory,
    scenario: str,
    path: pathlib.Path,
    title: str,
) -> pathlib.Path | None:
    """Draw S4 against altitude, and where along the path of the formation it is high."""
    first = (scintillation.values["band"] == 1) & np.isfinite(scintillation.values["s4_corrected"])
    if not first.any():
        return None
    # The index is that of the minute before its stamp: it belongs to the middle of it.
    time = scintillation.time[first] - 30 * _SECOND
    s4 = scintillation.values["s4_corrected"][first]
    altitude, latitude, longitude = (
        _at(time, density.time, values)
        for values in (
            density.altitude / _KILOMETRE,
            density.latitude_deg,
            np.degrees(np.unwrap(np.radians(density.longitude_deg))),
        )
    )
    longitude = (longitude + 180.0) % 360.0 - 180.0
    with mpl.rc_context(STYLE):
        figure = make_figure(6.5)
        axes: Any = figure.subplots(1, 2, width_ratios=(1, 1.6))
        axes[0].plot(s4, altitude, "o", ms=4, color=AXIS_COLOURS[0], alpha=0.6)
        axes[0].axvline(_WEAK_SCINTILLATION, color=MARK_COLOUR, ls="--", lw=1.0)
        axes[0].set(xlabel="S4 of L1, noise removed", ylabel="altitude (km)")
        axes[0].set_title("each satellite and minute")
        order = np.argsort(s4, kind="stable")
        drawn = axes[1].scatter(
            longitude[order], latitude[order], c=s4[order], s=40, cmap="viridis", vmin=0.0, vmax=0.5
        )
        figure.colorbar(drawn, ax=axes[1], label="S4, highest on top")
        if scenario in _PAPER_SCENARIOS:
            corners = np.array(_PAPER_EVENTS)
            axes[1].plot(
                corners[:, 1], corners[:, 0], "D", color=AXIS_COLOURS[1], ms=9, mfc="none", mew=2,
                label="first and last event of the paper",
            )  # fmt: skip
            axes[1].legend(loc="lower left")
        axes[1].set(xlabel="longitude (deg east)", ylabel="latitude (deg north)")
        axes[1].set_title("along the path of the formation")
        return save_figure(figure, path, title)


def _at(time: Any, known: Any, values: FloatArray) -> FloatArray:
    origin = known[0]
    return np.interp((time - origin) / _SECOND, (known - origin) / _SECOND, values)

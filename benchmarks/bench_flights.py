"""Shipped flights over the whole graph, their figures taken from the reports.

Each flight is a `vtff run` of an hour; `--folder` keeps the runs, and takes again those that are
there. Figures are those of `summary.json` (docs/summary.md).
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
from typing import Any, NamedTuple

from tables import add_write_option, markdown_table, write_rows

AXES = ("radial", "in_track", "cross_track")
PAPER = (
    "relative_ekf.estimator:=paper",
    "sdre_controller.design:=paper",
    "formation_safety.reaction_time:=0",
)
REMOTE = ("scenario:=config/scenario/remote_sensing.yaml",)
FLIGHT_COLUMNS = (
    "flight",
    "keeping RMS from 600 s on, R / T / N, mm",
    "the same from 125 s on, mm",
    "dv while keeping, m/s per hour",
    "navigation 3-D RMS after 60 s, mm",
    "NEES",
    "total dv R / T / N, m/s",
)
TRUTH_FED_COLUMNS = (
    "flight",
    "closest in-track, m",
    "at, s",
    "within 1 m from, s",
    "dv R / T / N, m/s",
    "largest keeping error R / N, mm",
)
IONOSPHERE_COLUMNS = ("figure", "vtff", "published")

Summary = dict[str, Any]


class Flight(NamedTuple):
    """A flight: name of its row, fragment, and arguments of `vtff run`."""

    name: str
    fragment: str
    arguments: tuple[str, ...]


FLIGHTS = (
    Flight("realistic", "flights", ("realistic",)),
    Flight("reference", "flights", ("reference",)),
    Flight("reference, paper's filter and design", "flights", ("reference", *PAPER)),
    Flight("reference, paper's design", "truth_fed", ("reference_software",)),
    Flight(
        "reference, delay_aware",
        "truth_fed",
        ("reference_software", "sdre_controller.design:=delay_aware"),
    ),
    Flight(
        "reference, navigation_aware",
        "truth_fed",
        ("reference_software", "sdre_controller.design:=navigation_aware"),
    ),
    Flight(
        "remote_sensing, cap 1.0 m/s2",
        "truth_fed",
        ("reference_software", *REMOTE, "sdre_controller.acceleration_cap:=1.0"),
    ),
    Flight(
        "remote_sensing, feedforward",
        "truth_fed",
        ("reference_software", *REMOTE, "sdre_controller.feedforward:=true"),
    ),
    Flight("esf", "ionosphere", ("esf",)),
    Flight("plumex", "ionosphere", ("plumex",)),
)


def fly(flight: Flight, folder: pathlib.Path, duration: float | None) -> Summary:
    """Return the summary of a flight, which is flown if its folder is not there."""
    run = folder / flight.name.replace(" ", "_").replace(",", "").replace("'", "").replace("/", "")
    if not run.exists():
        command = [sys.executable, "-m", "vtff_bringup.cli", "run", *flight.arguments]
        command += ["--out", str(run)] + (["--duration", f"{duration:g}"] if duration else [])
        subprocess.run(command, check=True, capture_output=True)
    summary: Summary = json.loads((run / "report/summary.json").read_text(encoding="utf-8"))
    return summary


def number(value: float | None, factor: float, digits: int) -> str:
    """Return a value times a factor, or a dash where there is none."""
    return "-" if value is None or math.isnan(value) else f"{factor * value:.{digits}f}"


def axes(summary: Summary, key: str, factor: float, digits: int) -> str:
    """Return the values of a key of all three axes, or one dash where there is none."""
    cells = [number(summary.get(key.format(axis)), factor, digits) for axis in AXES]
    return "-" if set(cells) == {"-"} else " / ".join(cells)


def flight_row(name: str, summary: Summary) -> list[str]:
    """Return the cells of a flight on navigation."""
    return [
        name,
        axes(summary, "settled_keeping_{}_rms_m", 1e3, 2),
        axes(summary, "keeping_{}_rms_m", 1e3, 2),
        number(summary.get("settled_keeping_delta_v_m_per_s_per_h"), 1.0, 4),
        number(summary.get("navigation_error_settled_3d_rms_m"), 1e3, 2),
        number(summary.get("navigation_error_settled_nees"), 1.0, 2),
        axes(summary, "delta_v_total_{}_m_per_s", 1.0, 2),
    ]


def truth_fed_row(name: str, summary: Summary) -> list[str]:
    """Return the cells of a flight on truth."""
    largest = [
        max(
            abs(summary[f"keeping_{axis}_{end}_m"] - summary[f"target_{axis}_m"])
            for end in ("minimum", "maximum")
        )
        if f"keeping_{axis}_minimum_m" in summary
        else None
        for axis in ("radial", "cross_track")
    ]
    return [
        name,
        number(summary.get("minimum_in_track_m"), 1.0, 2),
        number(summary.get("minimum_in_track_time_s"), 1.0, 0),
        number(summary.get("settling_time_s"), 1.0, 0),
        axes(summary, "delta_v_total_{}_m_per_s", 1.0, 2),
        " / ".join(number(value, 1e3, 1) for value in largest),
    ]


def ionosphere_rows(name: str, summary: Summary) -> list[list[str]]:
    """Return the figures of a flight through an ionosphere, one a row, those that it has."""
    start = "ionosphere_"
    rows = []
    if f"{start}true_separation_rising_m" in summary and f"{start}separation_rising_m" in summary:
        ratio = summary[f"{start}separation_rising_m"] / summary[f"{start}true_separation_rising_m"]
        text = f"{100.0 * abs(ratio - 1.0):.1f} % off, rising"
        rows.append([f"separation in altitude from edges, {name}", text, "-"])
    if f"{start}density_error_single_satellite_per_cm3" in summary:
        one = number(summary[f"{start}density_error_single_satellite_per_cm3"], 1e-4, 1)
        every = number(summary.get(f"{start}density_error_per_cm3"), 1e-4, 1)
        text = f"one satellite {one}e4, all satellites in bins of 1 km {every}e4 cm-3"
        rows.append([f"electron density, {name}", text, "-"])
    if f"{start}chief_slant_tec_error_rms_tecu" in summary:
        contents = " and ".join(
            number(summary.get(f"{start}{craft}_slant_tec_error_rms_tecu"), 1.0, 2)
            for craft in ("chief", "deputy")
        )
        rows.append([f"absolute slant TEC, {name}", f"{contents} TECU RMS", "-"])
    return rows


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [flight.name for flight in FLIGHTS]
    parser.add_argument("--only", default="", help="flights with this in their name")
    parser.add_argument("--duration", type=float, help="s; default: of the scenario")
    parser.add_argument("--folder", type=pathlib.Path, help="folder in which runs are kept")
    add_write_option(parser, "flights, truth_fed, ionosphere")
    given = parser.parse_args()
    chosen = [flight for flight in FLIGHTS if given.only in flight.name]
    if not chosen:
        parser.error(f"--only: {given.only!r} is in none of {', '.join(names)}")
    found: dict[str, list[list[str]]] = {"flights": [], "truth_fed": [], "ionosphere": []}
    with tempfile.TemporaryDirectory() as folder:
        for flight in chosen:
            summary = fly(flight, given.folder or pathlib.Path(folder), given.duration)
            if flight.fragment == "flights":
                found["flights"].append(flight_row(flight.name, summary))
            elif flight.fragment == "truth_fed":
                found["truth_fed"].append(truth_fed_row(flight.name, summary))
            else:
                found["ionosphere"] += ionosphere_rows(flight.name, summary)
    columns = {
        "flights": FLIGHT_COLUMNS,
        "truth_fed": TRUTH_FED_COLUMNS,
        "ionosphere": IONOSPHERE_COLUMNS,
    }
    for fragment, rows in found.items():
        if rows:
            print(markdown_table(columns[fragment], rows))
        if rows and given.write:
            write_rows(fragment, columns[fragment], rows, seeds="1")


if __name__ == "__main__":
    main()

"""A scene as lines of text, for terminals without a browser."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vtff_analysis.recordings.topics import CHIEF
from vtff_analysis.view.scene import Scene, Series
from vtff_dynamics.frames.geodetic import geodetic_from_itrf

#: s; a satellite whose last observation is older is no longer tracked.
LONGEST_HOLD = 2.5

#: Name, unit and width of each column; together 80 characters.
COLUMNS = (
    ("time", "s", 6),
    ("lat", "deg", 6),
    ("lon", "deg", 7),
    ("alt", "km", 5),
    ("radial", "m", 8),
    ("in-trk", "m", 8),
    ("cross", "m", 7),
    ("sat", "", 3),
    ("C/N0", "dBHz", 4),
    ("thrust", "m/s2", 6),
    ("VTEC", "TECU", 5),
    ("S4", "", 4),
)


def heading() -> str:
    """Return two lines: names and units of the columns."""
    names = (name.rjust(width) for name, _, width in COLUMNS)
    units = (unit.rjust(width) for _, unit, width in COLUMNS)
    return " ".join(names) + "\n" + " ".join(units)


def scene_line(scene: Scene, time: float) -> str:
    """Return the row of a time, s after the start of the scene, as one line."""
    widths = (width for _, _, width in COLUMNS)
    return " ".join(v.rjust(w) for v, w in zip(scene_row(scene, time), widths, strict=True))


def scene_text(scene: Scene, rows: int = 25) -> str:
    """Return the run as a table: chief's position, deputy's relative position, links, thrust, TEC.

    Parameters
    ----------
    scene
        The run.
    rows
        Number of times, evenly spaced from the first to the last.
    """
    times = np.linspace(0.0, scene.duration, max(rows, 2))
    lines = [f"{scene.name}, {scene.duration:.0f} s", heading()]
    return "\n".join([*lines, *(scene_line(scene, float(time)) for time in times)])


def scene_row(scene: Scene, time: float) -> list[str]:
    """Return the texts of `COLUMNS` at a time in s; '-' where there is no sample."""
    deputies = {series.labels["deputy"] for series in scene.of_kind("relative")}
    crafts = sorted(
        {series.labels["craft"] for series in scene.of_kind("orbit")},
        key=lambda craft: (craft in deputies, craft != CHIEF, craft),
    )
    texts = [f"{time:.1f}"]
    texts += _position_texts(scene, crafts[0], time) if crafts else ["-"] * 3
    states = scene.of_kind("relative")
    best = next((s for s in states if s.labels["source"] == "estimate"), None) or next(
        (s for s in states if s.labels["source"] == "truth"), None
    )
    texts += _value_texts(best, time, ("radial", "in_track", "cross_track"))
    cn0 = _current_values(scene.of_kind("link"), time, "cn0_dbhz")
    texts += [str(len(cn0)), _mean_text(cn0, ".1f")]
    thrust = scene.of_kind("thrust")
    applied = next((s for s in thrust if s.labels["source"] == "applied"), None)
    sample = applied.at(time) if applied is not None else None
    texts.append("-" if sample is None else f"{math.hypot(*sample.values()):.3f}")
    texts.append(_mean_text(_current_values(scene.of_kind("pierce"), time, "vtec_tecu"), ".1f"))
    s4 = _current_values(scene.of_kind("scintillation"), time, "s4", hold=120.0)
    texts.append(f"{max(s4):.2f}" if s4 else "-")
    return texts


def _position_texts(scene: Scene, craft: str, time: float) -> list[str]:
    orbits = (scene.series.get(f"orbit/{craft}/{source}") for source in ("truth", "receiver"))
    orbit = next((series for series in orbits if series is not None), None)
    sample = orbit.at(time) if orbit is not None else None
    if sample is None:
        return ["-"] * 3
    position = np.array([sample["x"], sample["y"], sample["z"]])
    latitude, longitude, altitude = geodetic_from_itrf(position)
    return [
        f"{math.degrees(latitude):.2f}",
        f"{math.degrees(longitude):.2f}",
        f"{altitude / 1e3:.1f}",
    ]


def _value_texts(series: Series | None, time: float, columns: Sequence[str]) -> list[str]:
    sample = series.at(time) if series is not None else None
    if sample is None:
        return ["-"] * len(columns)
    return [f"{sample[name]:.{1 if abs(sample[name]) >= 1e3 else 2}f}" for name in columns]


def _current_values(
    series: Sequence[Series], time: float, column: str, hold: float = LONGEST_HOLD
) -> list[float]:
    """Return the newest finite value of each series that is at most `hold` s old."""
    samples = (single.at(time, hold) for single in series)
    values = (sample[column] for sample in samples if sample is not None)
    return [value for value in values if math.isfinite(value)]


def _mean_text(values: Sequence[float], form: str) -> str:
    return f"{np.mean(values):{form}}" if values else "-"

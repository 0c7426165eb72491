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


def deputies_of(scene: Scene) -> list[str]:
    """Return the names of the deputies that have a relative position, in alphabetical order.

    Without any of these, the names of the spacecraft that thrust.
    """
    names = [
        {series.labels["deputy"] for series in scene.of_kind(kind)}
        for kind in ("relative", "thrust")
    ]
    return sorted(names[0] or names[1])


def scene_lines(scene: Scene, time: float) -> list[str]:
    """Return the rows of a time, s after the start of the scene: one line for each deputy.

    Where there are several, a line ends with the name of its deputy.
    """
    deputies = deputies_of(scene)
    if len(deputies) < 2:
        return [_scene_line(scene, time, "".join(deputies))]
    return [f"{_scene_line(scene, time, deputy)}  {deputy}" for deputy in deputies]


def scene_text(scene: Scene, rows: int = 25) -> str:
    """Return the run as a table: chief's position, deputy's relative position, links, thrust, TEC.

    Each deputy of several has a table of its own.

    Parameters
    ----------
    scene
        The run.
    rows
        Number of times, evenly spaced from the first to the last.
    """
    times = np.linspace(0.0, scene.duration, max(rows, 2))
    lines = [f"{scene.name}, {scene.duration:.0f} s"]
    deputies = deputies_of(scene)
    for deputy in deputies or [""]:
        if len(deputies) > 1:
            lines += ["", f"deputy {deputy}"]
        lines.append(heading())
        lines += [_scene_line(scene, float(time), deputy) for time in times]
    return "\n".join(lines)


def _scene_line(scene: Scene, time: float, deputy: str) -> str:
    widths = (width for _, _, width in COLUMNS)
    row = _scene_row(scene, time, deputy)
    return " ".join(text.rjust(width) for text, width in zip(row, widths, strict=True))


def _scene_row(scene: Scene, time: float, deputy: str) -> list[str]:
    """Return the texts of `COLUMNS` at a time in s; '-' where there is no sample.

    Links, contents and scintillation are those of all spacecraft.
    """
    deputies = deputies_of(scene)
    crafts = sorted(
        {series.labels["craft"] for series in scene.of_kind("orbit")},
        key=lambda craft: (craft in deputies, craft != CHIEF, craft),
    )
    texts = [f"{time:.1f}"]
    texts += _position_texts(scene, crafts[0], time) if crafts else ["-"] * 3
    sources = (scene.series.get(f"relative/{deputy}/{name}") for name in ("estimate", "truth"))
    best = next((series for series in sources if series is not None), None)
    texts += _value_texts(best, time, ("radial", "in_track", "cross_track"))
    cn0 = _current_values(scene.of_kind("link"), time, "cn0_dbhz")
    texts += [str(len(cn0)), _mean_text(cn0, ".1f")]
    applied = scene.series.get(f"thrust/{deputy}/applied")
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

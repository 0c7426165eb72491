"""The report as one HTML file that holds its pictures and needs nothing else.

It is written for somebody who was not there: what was flown, with what, how well it went,
beside the paper's numbers, and what was wrong.
"""

from __future__ import annotations

import base64
import dataclasses
import html
import pathlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from vtff_analysis.paper_reference import formation_columns
from vtff_analysis.recordings.history import HealthItem, RunHistory
from vtff_analysis.report.ionosphere_table import (
    IONOSPHERE_HEADS,
    IONOSPHERE_REMARK,
    ionosphere_rows,
)
from vtff_analysis.report.receiver_ionosphere import ReceiverComparison, compare_with_receiver
from vtff_analysis.report.summary import key_part, utc_text
from vtff_analysis.report.tables import (
    formation_remarks,
    formation_rows,
    number_text,
    receiver_rows,
)
from vtff_bag.run.description import RunDescription, node_parameters
from vtff_gnss.signals import satellite_name

STYLE_FILE = pathlib.Path(__file__).with_name("report.css")

_LEVEL_NAMES = ("ok", "warning", "error", "stale")

_AXES_TEXT = (
    "Positions are those of the deputy relative to the chief in the chief's rotating frame: "
    "radial (outward), in-track (along the motion) and cross-track (along the orbit normal)."
)


@dataclasses.dataclass(frozen=True)
class Picture:
    """A plot with what it shows.

    Attributes
    ----------
    path
        PNG file.
    caption
        One or two sentences.
    part
        Part of the report: ``formation``, ``navigation``, ``gnss``, ``ionosphere``, ``timing``.
    """

    path: pathlib.Path
    caption: str
    part: str


def render_report(
    summary: Mapping[str, Any],
    history: RunHistory,
    described: RunDescription,
    deputies: Sequence[str],
    pictures: Sequence[Picture],
    notes: Iterable[str],
) -> str:
    """Return the HTML text of a report.

    Parameters
    ----------
    summary
        Summary of the run, keys of docs/summary.md.
    history
        The run as recorded.
    described
        System, arguments, versions and parameters.
    deputies
        Names of the deputies in the summary.
    pictures
        Plots, in the order in which they are shown.
    notes
        What could not be read, one line each.
    """
    name = str(summary["run_name"])
    sections = [
        ("Result", _result(summary, deputies)),
        ("Formation", _formation(summary, deputies) + _figures(pictures, "formation")),
        ("Navigation", _figures(pictures, "navigation")),
        ("GNSS", _receivers(summary, list(history.receivers)) + _figures(pictures, "gnss")),
        ("Ionosphere", _ionosphere(summary, history, pictures)),
        ("Health", _health(history.health, history.start_time)),
        ("Timing", _timing(history) + _figures(pictures, "timing")),
        ("How it was run", _provenance(summary, described)),
        ("Parameters", _parameters(described)),
        ("Recorded topics", _topics(history)),
    ]
    filled = [(title, body) for title, body in sections if body]
    contents = " · ".join(f'<a href="#{key_part(t)}">{_text(t)}</a>' for t, _ in filled)
    remarks = "".join(f'<p class="note">{_text(note)}</p>' for note in notes)
    body = "".join(
        f'<section id="{key_part(title)}"><h2>{_text(title)}</h2>{content}</section>'
        for title, content in filled
    )
    return (
        "<!DOCTYPE html>\n"
        '<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        # A page opened from a disk asks for an icon otherwise.
        '<link rel="icon" href="data:,">'
        f"<title>{_text(name)}</title><style>{STYLE_FILE.read_text(encoding='utf-8')}</style>"
        f"</head><body><header><h1>{_text(name)}</h1>{_lead(summary, history, deputies)}"
        f"{remarks}<nav>{contents}</nav></header><main>{body}</main></body></html>\n"
    )


def _text(value: Any) -> str:
    return html.escape(str(value))


def _lead(summary: Mapping[str, Any], history: RunHistory, deputies: Sequence[str]) -> str:
    """Say in words what this is."""
    seconds = f"{summary['run_duration_s']:.0f} s"
    parts = []
    if deputies:
        crafts = "a deputy spacecraft" if len(deputies) == 1 else f"{len(deputies)} deputies"
        parts.append(f"A formation flight of {seconds}: {crafts} with reference to a chief.")
    elif history.receivers:
        parts.append(f"GNSS observations of {', '.join(history.receivers)} over {seconds}.")
    else:
        parts.append(f"A recording of {seconds}.")
    if "scenario" in summary:
        parts.append(f"Scenario “{summary['scenario']}”.")
    if summary.get("run_complete") is False:
        parts.append("The run was ended before its planned end.")
    if "run_start_utc" in summary:
        parts.append(f"Scenario time begins at {summary['run_start_utc']}.")
    return f"<p>{_text(' '.join(parts))}</p>"


def _result(summary: Mapping[str, Any], deputies: Sequence[str]) -> str:
    """Show the few numbers that sum the run up."""
    tiles = []
    for name in deputies:
        own = _own(summary, name, deputies)
        label = f"{name}: " if len(deputies) > 1 else ""
        total = [own.get(f"delta_v_total_{axis}_m_per_s") for axis in ("radial", "in_track")]
        if None not in total:
            spent = f"{total[0]:.2f} / {total[1]:.2f} m/s"
            tiles.append((f"{label}Δv radial / in-track", spent))
        if "minimum_separation_m" in own:
            tiles.append((f"{label}closest approach", f"{own['minimum_separation_m']:.2f} m"))
        if "settling_time_s" in own:
            settled = own["settling_time_s"]
            text = "not within 1 m" if settled is None else f"{settled:.0f} s"
            tiles.append((f"{label}settled on the target", text))
        if "navigation_error_maximum_m" in own:
            worst = own["navigation_error_maximum_m"]
            tiles.append((f"{label}largest navigation error", f"{worst:.3f} m"))
    if "real_time_factor" in summary:
        tiles.append(("speed", f"{summary['real_time_factor']:.0f} × real time"))
    if summary.get("late_commands"):
        tiles.append(("late commands", str(summary["late_commands"])))
    tiles.append(("messages recorded", f"{summary['message_count']:,}".replace(",", " ")))
    shown = "".join(
        f"<div><dt>{_text(label)}</dt><dd>{_text(value)}</dd></div>" for label, value in tiles
    )
    return f'<dl class="tiles">{shown}</dl>'


def _own(summary: Mapping[str, Any], name: str, deputies: Sequence[str]) -> dict[str, Any]:
    prefix = f"{key_part(name)}_" if len(deputies) > 1 else ""
    return {key.removeprefix(prefix): value for key, value in summary.items()}


def _formation(summary: Mapping[str, Any], deputies: Sequence[str]) -> str:
    """Set the measured numbers beside the paper's."""
    blocks = []
    columns = formation_columns(summary.get("scenario"))
    for name in deputies:
        own = _own(summary, name, deputies)
        heads = ["", "measured", *[column.title.replace("\n", " ") for column in columns]]
        rows: list[Sequence[str]] = []
        for heading, section in formation_rows(own, columns):
            rows.append(heading)
            rows.extend([label, measured, *printed] for label, measured, printed in section)
        title = f"<h3>{_text(name)}</h3>" if len(deputies) > 1 else ""
        remarks = " ".join(_sentence(line) for line in formation_remarks(own, columns))
        blocks.append(f"{title}{_table(heads, rows)}<p class='small'>{_text(remarks)}</p>")
    return f"<p>{_text(_AXES_TEXT)}</p>{''.join(blocks)}" if blocks else ""


def _sentence(line: str) -> str:
    begun = line[:1].upper() + line[1:]
    return begun if begun.endswith(".") else f"{begun}."


def _receivers(summary: Mapping[str, Any], receivers: Sequence[str]) -> str:
    rows = [[label, *values] for label, values in receiver_rows(summary, receivers)]
    return _table(["", *receivers], rows) if rows else ""


def _ionosphere(
    summary: Mapping[str, Any], history: RunHistory, pictures: Sequence[Picture]
) -> str:
    """Set paper, measured and true beside each other; plots, the receiver's own, edges."""
    rows = ionosphere_rows(summary)
    table = _table(IONOSPHERE_HEADS, rows) if rows else ""
    remark = f"<p class='small'>{_text(IONOSPHERE_REMARK)}</p>" if rows else ""
    own = _receivers_own(compare_with_receiver(history))
    return table + remark + own + _figures(pictures, "ionosphere") + _boundaries(history)


def _receivers_own(comparisons: Sequence[ReceiverComparison]) -> str:
    if not comparisons:
        return ""
    rows = [
        [
            f"{c.craft} {c.quantity.replace('_', ' ')} {c.signal}".strip(),
            str(len(c.ours)),
            f"{c.mean:.3f} {c.unit}",
            f"{c.scatter:.3f} {c.unit}",
        ]
        for c in comparisons
    ]
    heads = ["", "samples", "mean difference", "scatter"]
    return f"<h3>Ours less the receiver's own (GPStation-6)</h3>{_table(heads, rows)}"


def _boundaries(history: RunHistory) -> str:
    if not history.boundaries:
        return ""
    rows = [
        [
            utc_text(edge.time),
            edge.spacecraft,
            f"{edge.kind}, {'entered' if edge.entry else 'left'}",
            edge.source,
            satellite_name(edge.system, edge.prn) if edge.prn else "",
            f"{edge.latitude_deg:.2f}°, {edge.longitude_deg:.2f}°",
            f"{edge.altitude / 1e3:.1f} km",
        ]
        for edge in history.boundaries
    ]
    heads = ["time", "spacecraft", "edge", "from", "satellite", "latitude, longitude", "altitude"]
    return f"<h3>Edges of irregularities</h3>{_table(heads, rows)}"


def _health(items: Sequence[HealthItem], start: int) -> str:
    """Show what every node reported on /diagnostics, and each time it was not well."""
    if not items:
        return ""
    rows = []
    for item in items:
        level = _LEVEL_NAMES[item.level]
        values = ", ".join(f"{key} {value}" for key, value in item.values.items())
        not_well = sum(item.counts[1:])
        rows.append(
            f"<tr><td>{_text(item.name)}</td><td class='{level}'>{level}</td>"
            f"<td>{_text(item.message)}<br><span class='small'>{_text(values)}</span></td>"
            f"<td class='number'>{sum(item.counts)}</td><td class='number'>{not_well}</td></tr>"
        )
    table = (
        "<table><thead><tr><th>part</th><th>state</th><th>last report</th>"
        "<th class='number'>reports</th><th class='number'>not ok</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )
    events = [
        [f"{max(0, time - start) * 1e-9:.0f} s" if time else "start", item.name, text]
        for item in items
        for time, text in item.changes
    ]
    if not events:
        return table
    listed = _table(["scenario time", "part", "what it reported"], events, numbers=False)
    return f"{table}<h3>Reports other than ok</h3>{listed}"


def _timing(history: RunHistory) -> str:
    """List how long the steps of each node took."""
    rows = [
        [
            node,
            str(times.size),
            *(f"{1e3 * value:.3g} ms" for value in np.quantile(times, [0.5, 0.99, 1.0])),
        ]
        for node, times in history.compute_time.items()
        if times.size
    ]
    heads = ["node", "steps", "median", "99 % below", "longest"]
    return _table(heads, rows) if rows else ""


def _provenance(summary: Mapping[str, Any], described: RunDescription) -> str:
    known = [
        ("system", described.arguments.get("system")),
        ("scenario", summary.get("scenario")),
        ("pacing", summary.get("pacing")),
        ("seed", summary.get("run_seed")),
        ("vtff", summary.get("vtff_version")),
        ("commit", _commit(summary)),
        ("Python", summary.get("machine_python")),
        ("platform", summary.get("machine_platform")),
        ("processor", summary.get("machine_cpu_model")),
        ("processor cores", summary.get("machine_cpu_cores")),
        *[
            (f"argument {name}", value)
            for name, value in described.arguments.items()
            if name != "system"
        ],
    ]
    rows = [[name, _value(value)] for name, value in known if value is not None]
    return _table(["", ""], rows, numbers=False)


def _commit(summary: Mapping[str, Any]) -> str | None:
    commit = summary.get("git_commit")
    if commit is None:
        return None
    return f"{commit[:12]} (with changes)" if summary.get("git_modified") else commit[:12]


def _parameters(described: RunDescription) -> str:
    blocks = []
    for text in described.parameter_texts.values():
        for node, values in sorted(node_parameters(text).items()):
            rows = [[name, _value(value)] for name, value in sorted(values.items())]
            table = _table(["parameter", "value"], rows, numbers=False)
            blocks.append(f"<details><summary>{_text(node)}</summary>{table}</details>")
    if described.scenario_text:
        blocks.append(
            "<details><summary>scenario file</summary>"
            f"<pre>{_text(described.scenario_text)}</pre></details>"
        )
    return "".join(blocks)


def _value(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return yaml.safe_dump(value, default_flow_style=True, width=4096).strip()
    return number_text(value, 6) if isinstance(value, float) and value % 1 else str(value)


def _topics(history: RunHistory) -> str:
    rows = [[name, str(count)] for name, count in sorted(history.message_counts.items())]
    return _table(["topic", "messages"], rows)


def _figures(pictures: Sequence[Picture], part: str) -> str:
    return "".join(
        f'<figure><img src="data:image/png;base64,{_encoded(picture.path)}" '
        f'alt="{_text(picture.caption)}"><figcaption>{_text(picture.caption)}</figcaption></figure>'
        for picture in pictures
        if picture.part == part
    )


def _encoded(path: pathlib.Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = True) -> str:
    """Return a table; columns after the first are numbers, a row that is a text is a heading."""

    def cell(tag: str, place: int, value: str) -> str:
        style = ' class="number"' if numbers and place else ""
        return f"<{tag}{style}>{_text(value)}</{tag}>"

    head = "".join(cell("th", place, value) for place, value in enumerate(heads))
    lines = []
    for row in rows:
        if isinstance(row, str):
            lines.append(f'<tr class="part"><th colspan="{len(heads)}">{_text(row)}</th>')
        else:
            lines.append("<tr>" + "".join(cell("td", place, v) for place, v in enumerate(row)))
        lines.append("</tr>")
    shown = f"<thead><tr>{head}</tr></thead>" if any(heads) else ""
    return f"<table>{shown}<tbody>{''.join(lines)}</tbody></table>"

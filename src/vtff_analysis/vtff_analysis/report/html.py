"""The report of a run as one HTML file that holds its pictures and needs nothing else.

It is written for a reader who did not see the run: what was flown and with which system, how well,
beside the paper's numbers, and what went wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from vtff_analysis.evaluation.receiver_comparison import (
    ReceiverComparison,
    compare_with_receiver,
)
from vtff_analysis.evaluation.summary import utc_text
from vtff_analysis.page.page import (
    Picture,
    breakable,
    escape,
    render_figures,
    render_page,
    render_table,
)
from vtff_analysis.paper_reference import formation_columns, paper_columns
from vtff_analysis.recordings.history import HealthItem, RunHistory
from vtff_analysis.recordings.topics import key_part
from vtff_analysis.report.guidance_section import render_guidance
from vtff_analysis.report.ionosphere_table import (
    ionosphere_columns,
    ionosphere_prefixes,
    ionosphere_remark,
    ionosphere_rows,
)
from vtff_analysis.report.tables import (
    formation_heads,
    formation_remarks,
    formation_rows,
    receiver_rows,
)
from vtff_analysis.report.verdict import SECTIONS, Verdict, find_verdict, printed_navigation_error
from vtff_bag.run.description import RunDescription, node_parameters
from vtff_gnss.signals import satellite_name
from vtff_node.plain_yaml import format_yaml
from vtff_node.start.listeners import TOPICS_SUBJECT

_LEVEL_NAMES = ("ok", "warning", "error", "stale")

_AXES_TEXT = (
    "Positions are those of the deputy relative to the chief in the chief's rotating frame: "
    "radial (outward), in-track (along the motion) and cross-track (along the orbit normal)."
)


def render_report(
    summary: Mapping[str, Any],
    history: RunHistory,
    described: RunDescription,
    deputies: Sequence[str],
    pictures: Sequence[Picture],
    notes: Iterable[str],
    remarks: Iterable[str] = (),
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
        One line for each thing that could not be read or went wrong.
    remarks
        One line for each thing that the verdict leaves out.
    """
    name = str(summary["run_name"])
    verdict = find_verdict(summary, deputies)
    subjects = [
        (
            "Formation",
            _render_formation(summary, deputies) + render_figures(pictures, "formation"),
        ),
        ("Guidance", render_guidance(history, pictures)),
        ("Navigation", render_figures(pictures, "navigation")),
        ("Attitude", render_figures(pictures, "attitude")),
        (
            "GNSS",
            _render_receivers(summary, list(history.receivers)) + render_figures(pictures, "gnss"),
        ),
        ("Ionosphere", _render_ionosphere(summary, history, pictures)),
    ]
    order = SECTIONS[verdict.subject]
    sections = [
        *sorted(subjects, key=lambda section: order.index(section[0])),
        ("Health", _render_health(history.health, history.start_time)),
        ("Timing", _render_timing(history) + render_figures(pictures, "timing")),
        ("How it was run", _render_provenance(summary, described)),
        ("Parameters", _render_parameters(described)),
        ("Recorded topics", _render_topics(history)),
    ]
    filled = [(title, body) for title, body in sections if body]
    contents = " · ".join(f'<a href="#{key_part(t)}">{escape(t)}</a>' for t, _ in filled)
    told = "".join(f'<p class="note">{escape(note)}</p>' for note in notes)
    told += "".join(f"<p class='small'>{escape(remark)}.</p>" for remark in remarks)
    body = "".join(
        f'<section id="{key_part(title)}"><h2>{escape(title)}</h2>{content}</section>'
        for title, content in filled
    )
    head = (
        f"{_render_verdict(verdict)}{_render_lead(summary, history, deputies)}{told}"
        f"<nav>{contents}</nav>"
    )
    return render_page(name, head, body, _papers(summary, verdict), described.command)


def _papers(summary: Mapping[str, Any], verdict: Verdict) -> list[str]:
    """Return the paper whose numbers stand beside those of the run, if any does."""
    if verdict.subject == "navigation" and printed_navigation_error(summary) is not None:
        return ["004"]
    printed = formation_columns(summary.get("scenario")) or paper_columns(summary.get("scenario"))
    compared = verdict.subject in ("formation", "navigation", "ionosphere")
    return ["000"] if printed and compared else []


def _render_lead(summary: Mapping[str, Any], history: RunHistory, deputies: Sequence[str]) -> str:
    """Return the introduction: what was recorded, for how long, and of which scenario."""
    seconds = f"{summary['run_duration_s']:.0f} s"
    sentences = []
    if deputies:
        crafts = "a deputy spacecraft" if len(deputies) == 1 else f"{len(deputies)} deputies"
        sentences.append(f"A formation flight of {seconds}: {crafts} with reference to a chief.")
    elif history.receivers:
        sentences.append(f"GNSS observations of {', '.join(history.receivers)} over {seconds}.")
    else:
        sentences.append(f"A recording of {seconds}.")
    if "scenario" in summary:
        sentences.append(f"Scenario “{summary['scenario']}”.")
    if summary.get("run_complete") is False:
        sentences.append("The run was ended before its planned end.")
    if "run_start_utc" in summary:
        sentences.append(f"Scenario time begins at {summary['run_start_utc']}.")
    return f"<p>{escape(' '.join(sentences))}</p>"


def _render_verdict(verdict: Verdict) -> str:
    """Return the block that opens the report: one sentence, its conditions and its figures."""
    columns = [
        ("", [figure.label for figure in verdict.figures]),
        ("this run", [figure.measured for figure in verdict.figures]),
        ("paper", [figure.paper for figure in verdict.figures]),
        (verdict.bound, [figure.bound for figure in verdict.figures]),
        ("against the paper", [figure.ratio for figure in verdict.figures]),
    ]
    filled = [(head, texts) for head, texts in columns if any(texts)]
    rows = list(zip(*(texts for _, texts in filled), strict=True))
    table = render_table([head for head, _ in filled], rows) if rows else ""
    state = "good" if verdict.is_good else "bad"
    return (
        f'<div class="verdict {state}"><p class="sentence">{escape(verdict.sentence)}</p>'
        f'<p class="small">{escape(verdict.conditions)}</p>{table}</div>'
    )


def _numbers_of_deputy(
    summary: Mapping[str, Any], name: str, deputies: Sequence[str]
) -> dict[str, Any]:
    prefix = f"{key_part(name)}_" if len(deputies) > 1 else ""
    return {key.removeprefix(prefix): value for key, value in summary.items()}


def _render_formation(summary: Mapping[str, Any], deputies: Sequence[str]) -> str:
    """Return the measured numbers beside the paper's."""
    blocks = []
    columns = formation_columns(summary.get("scenario"))
    for name in deputies:
        numbers = _numbers_of_deputy(summary, name, deputies)
        heads = ["", *[head.replace("\n", " ") for head in formation_heads(columns)]]
        rows: list[Sequence[str]] = []
        for heading, section in formation_rows(numbers, columns):
            rows.append(heading)
            rows.extend([label, measured, *printed] for label, measured, printed in section)
        title = f"<h3>{escape(name)}</h3>" if len(deputies) > 1 else ""
        remarks = " ".join(_as_sentence(line) for line in formation_remarks(numbers, columns))
        blocks.append(f"{title}{render_table(heads, rows)}<p class='small'>{escape(remarks)}</p>")
    return f"<p>{escape(_AXES_TEXT)}</p>{''.join(blocks)}" if blocks else ""


def _as_sentence(line: str) -> str:
    sentence = line[:1].upper() + line[1:]
    return sentence if sentence.endswith(".") else f"{sentence}."


def _render_receivers(summary: Mapping[str, Any], receivers: Sequence[str]) -> str:
    rows = [[label, *values] for label, values in receiver_rows(summary, receivers)]
    return render_table(["", *receivers], rows) if rows else ""


def _render_ionosphere(
    summary: Mapping[str, Any], history: RunHistory, pictures: Sequence[Picture]
) -> str:
    """Return paper, measured and true numbers, the receiver's own values, plots and edges."""
    table = ""
    for deputy, prefix in ionosphere_prefixes(list(history.pairs)):
        rows = ionosphere_rows(summary, prefix)
        if rows:
            table += f"<h3>Ionosphere{escape(deputy)}</h3>" if deputy else ""
            table += render_table(*ionosphere_columns(rows))
    told = ionosphere_remark(summary)
    remark = f"<p class='small'>{escape(told)}</p>" if told and table else ""
    comparisons = _render_comparisons(compare_with_receiver(history))
    return (
        table
        + remark
        + comparisons
        + render_figures(pictures, "ionosphere")
        + "".join(_render_boundaries(pair) for pair in history.pair_histories())
    )


def _render_comparisons(comparisons: Sequence[ReceiverComparison]) -> str:
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
    return f"<h3>Ours less the receiver's own (GPStation-6)</h3>{render_table(heads, rows)}"


def _render_boundaries(history: RunHistory) -> str:
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
            _width_text(edge.width, edge.width_sigma),
        ]
        for edge in history.boundaries
    ]
    heads = ["time", "spacecraft", "edge", "from", "satellite", "latitude, longitude"]
    heads += ["altitude", "width (1 sigma)"]
    pair = f": {escape(history.deputy)}" if len(history.pairs) > 1 else ""
    table = render_table(heads, rows)
    listed = f"<details><summary>{len(rows)} edges</summary>{table}</details>"
    return f"<h3>Edges of irregularities{pair}</h3>{listed}"


def _width_text(width: float, sigma: float) -> str:
    """Return the width of an edge, m, or what it is below; empty if it is not known."""
    if not math.isfinite(width) or not math.isfinite(sigma):
        return ""
    if width < 3.0 * sigma:
        return f"below {(width + 2.0 * sigma) / 1e3:.1f} km"
    return f"{width / 1e3:.2f} ± {sigma / 1e3:.2f} km"


def _render_health(items: Sequence[HealthItem], start: int) -> str:
    """Return what every node reported on /diagnostics, and each report that was not OK."""
    if not items:
        return ""
    rows = []
    # What nodes state of their topics is for the recorder, not for a reader.
    for item in (item for item in items if not item.name.endswith(TOPICS_SUBJECT)):
        level = _LEVEL_NAMES[item.level]
        values = ", ".join(f"{key} {value}" for key, value in item.values.items())
        listed = f"<details><summary>values</summary>{escape(values)}</details>" if values else ""
        part, device = item.name.removesuffix(f" ({item.hardware_id})"), item.hardware_id
        rows.append(
            f"<tr><td>{breakable(part)}<br><span class='small'>{breakable(device)}</span></td>"
            f"<td class='{level}'>{level}</td><td>{escape(item.message)}{listed}</td>"
            f"<td class='number'>{sum(item.counts[1:])} of {sum(item.counts)}</td></tr>"
        )
    table = (
        "<table class='health'><thead><tr><th>part</th><th>state</th><th>last report</th>"
        f"<th class='number'>not ok</th></tr></thead><tbody>{''.join(rows)}</tbody></table>"
    )
    changes = sorted((time, item.name, text) for item in items for time, text in item.changes)
    events = [
        [f"{max(0, time - start) * 1e-9:.0f} s" if time else "start", name, text]
        for time, name, text in changes
    ]
    if not events:
        return table
    listed = render_table(["scenario time", "part", "what it reported"], events, numbers=False)
    return f"{table}<h3>Reports other than ok</h3>{listed}"


def _render_timing(history: RunHistory) -> str:
    """Return how long the steps of each node took, and in real time the way to the command."""
    latency = {
        f"last byte of a second to the command of {spacecraft} on its bus": times
        for spacecraft, times in history.command_latency.items()
    }
    rows = [
        [
            name,
            str(times.size),
            *(f"{1e3 * value:.3g} ms" for value in np.quantile(times, [0.5, 0.99, 1.0])),
        ]
        for name, times in {**history.compute_time, **latency}.items()
        if times.size
    ]
    heads = ["node", "steps", "median", "99 % below", "longest"]
    return render_table(heads, rows) if rows else ""


def _render_provenance(summary: Mapping[str, Any], described: RunDescription) -> str:
    entries = [
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
    rows = [[name, _format_value(value)] for name, value in entries if value is not None]
    return render_table(["", ""], rows, numbers=False)


def _commit(summary: Mapping[str, Any]) -> str | None:
    commit = summary.get("git_commit")
    if commit is None:
        return None
    return f"{commit[:12]} (with changes)" if summary.get("git_modified") else commit[:12]


def _render_parameters(described: RunDescription) -> str:
    blocks = []
    for text in described.parameter_texts.values():
        for node, values in sorted(node_parameters(text).items()):
            rows = [[name, _format_value(value)] for name, value in sorted(values.items())]
            table = render_table(["parameter", "value"], rows, numbers=False)
            blocks.append(f"<details><summary>{escape(node)}</summary>{table}</details>")
    if described.scenario_text:
        blocks.append(
            "<details><summary>scenario file</summary>"
            f"<pre>{escape(described.scenario_text)}</pre></details>"
        )
    return "".join(blocks)


def _format_value(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return format_yaml(value, on_one_line=True)
    return f"{value:.6g}" if isinstance(value, float) and value % 1 else str(value)


def _render_topics(history: RunHistory) -> str:
    rows = [[name, str(count)] for name, count in sorted(history.message_counts.items())]
    return render_table(["topic", "messages"], rows)

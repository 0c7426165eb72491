"""Tables of a run: measured numbers, beside the paper's where it has them.

Rows are the lists below and heads are `formation_heads`, for console and ``report.html`` alike.
The numbers come from `vtff_analysis.evaluation.summary`, the columns of the papers from
`vtff_analysis.paper_reference`; the ionosphere has `vtff_analysis.report.ionosphere_table`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from vtff_analysis.evaluation.formation_flight import ACQUISITION_DURATION, SETTLED_AFTER
from vtff_analysis.evaluation.summary import SETTLED_WITHIN
from vtff_analysis.paper_reference import PAPER_DURATION, PaperColumn, formation_columns
from vtff_analysis.recordings.history import AXES
from vtff_analysis.recordings.topics import key_part
from vtff_analysis.report.verdict import describe_receivers

Summary = Mapping[str, Any]


class Row(NamedTuple):
    """A row of a table of numbers.

    Attributes
    ----------
    label, key
        Text with the unit, and key of the summary.
    decimals
        Number of decimals.
    scale
        Factor of the number, for a unit other than that of the key.
    """

    label: str
    key: str
    decimals: int
    scale: float = 1.0


Section = Sequence[Row]
MILLIMETRES = 1e3  # of a metre

#: What fed a controller, by the summary's `control_input`; navigation is described further.
_FED = {"truth": "truth", "own sensor": "its own fix and its own sensor of range and direction"}

_AXIS_LABELS = dict(zip(AXES, ("radial", "in-track", "cross-track"), strict=True))


def _axis_rows(label: str, unit: str, key: str, decimals: int, scale: float = 1.0) -> list[Row]:
    """Return one row per axis; ``{}`` in the key stands for the axis."""
    return [
        Row(f"{label} {_AXIS_LABELS[axis]}, {unit}", key.format(axis), decimals, scale)
        for axis in AXES
    ]


_STATISTICS = {"maximum": "maximum", "minimum": "minimum", "mean": "mean", "rms": "RMS"}

_CLOSEST = Row("closest approach, m", "minimum_separation_m", 2)

_ACQUISITION: Section = [
    Row("minimum in-track, m", "minimum_in_track_m", 2),
    Row("  at, s", "minimum_in_track_time_s", 0),
    _CLOSEST,
    *_axis_rows("settled", "s", "settling_time_{}_s", 0),
    *_axis_rows("dv", "m/s", "delta_v_acquisition_{}_m_per_s", 3),
]

_KEEPING: Section = [
    Row("begins at, s", "keeping_start_time_s", 0),
    *[
        Row(f"{_AXIS_LABELS[axis]} {label}, m", f"keeping_{axis}_{what}_m", 5)
        for axis in AXES
        for what, label in _STATISTICS.items()
    ],
    *_axis_rows("dv", "m/s", "delta_v_keeping_{}_m_per_s", 4),
]

_SETTLED_KEEPING: Section = [
    *_axis_rows("RMS", "mm", "settled_keeping_{}_rms_m", 3, MILLIMETRES),
    *_axis_rows("RMS, truth-fed twin,", "mm", "truth_fed_settled_keeping_{}_rms_m", 3, MILLIMETRES),
    Row("dv of all axes, m/s per hour", "settled_keeping_delta_v_m_per_s_per_h", 4),
    Row("dv, truth-fed twin, m/s per hour", "truth_fed_settled_keeping_delta_v_m_per_s_per_h", 4),
]

_TOTAL: Section = _axis_rows("dv", "m/s", "delta_v_total_{}_m_per_s", 3)

_NAVIGATION: Section = [
    *_axis_rows("RMS", "mm", "navigation_error_{}_rms_m", 3, MILLIMETRES),
    Row("largest, mm", "navigation_error_maximum_m", 3, MILLIMETRES),
    Row("3-D RMS after 60 s, mm", "navigation_error_settled_3d_rms_m", 3, MILLIMETRES),
    Row("3-D RMS after 60 s, mm/s", "navigation_error_settled_3d_rms_m_per_s", 4, MILLIMETRES),
    Row("NEES after 60 s", "navigation_error_settled_nees", 2),
]

_RECEIVER: Section = [
    Row("epochs", "gnss_epochs", 0),
    Row("time span, s", "gnss_time_span_s", 1),
    Row("interval, s", "gnss_interval_s", 3),
    Row("gaps", "gnss_gaps", 0),
    Row("  longest, s", "gnss_longest_gap_s", 1),
    Row("  missing epochs", "gnss_missing_epochs", 0),
    Row("satellites", "gnss_satellites", 0),
    Row("  per epoch, mean", "gnss_satellites_per_epoch_mean", 1),
    Row("mean C/N0, dB-Hz", "gnss_cn0_mean_dbhz", 1),
    Row("possible cycle slips", "gnss_possible_cycle_slips", 0),
    Row("position fixes", "gnss_fixes", 0),
    Row("  usable", "gnss_fixes_usable", 0),
    Row("ephemerides", "gnss_ephemerides", 0),
    Row("  of satellites", "gnss_ephemeris_satellites", 0),
    Row("observations", "gnss_observations", 0),
]


def print_formation(
    console: Console, summary: Summary, deputies: Sequence[str], run_name: str
) -> None:
    """Print one table per deputy, the paper's numbers beside the measured ones.

    Parameters
    ----------
    console
        Console that the tables are printed on.
    summary
        Summary of the run.
    deputies
        Names of the deputies in the summary.
    run_name
        Name of the run for the title.
    """
    for name in deputies:
        prefix = f"{key_part(name)}_" if len(deputies) > 1 else ""
        numbers = {key.removeprefix(prefix): value for key, value in summary.items()}
        columns = formation_columns(summary.get("scenario"))
        title = f"{run_name}: {name}" if len(deputies) > 1 else run_name
        title = f"{title}, {_length_text(summary)}"
        console.print(_formation_table(title, numbers, columns))
        for line in formation_remarks(numbers, columns):
            console.print(Padding(escape(line), (0, 0, 0, 2), expand=False), style="dim")


def print_receivers(
    console: Console, summary: Summary, receivers: Sequence[str], run_name: str
) -> None:
    """Print one table of observations with a column per receiver.

    Parameters
    ----------
    console
        Console that the tables are printed on.
    summary
        Summary of the run.
    receivers
        Names of the receivers in the summary.
    run_name
        Name of the run for the title.
    """
    table = _table(f"{run_name}: GNSS observations", receivers)
    for label, values in receiver_rows(summary, receivers):
        table.add_row(label, *values)
    console.print(table)
    damaged = summary.get("receiver_logs_damaged")
    if damaged is not None:
        undecoded = summary["receiver_logs_undecoded"]
        console.print(f"receiver logs: {damaged} damaged, {undecoded} of a kind not decoded")


def receiver_rows(summary: Summary, receivers: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Return the texts of the receiver table: a label and one number for each receiver."""
    prefixes = [f"{key_part(name)}_" for name in receivers]
    signals = sorted(
        {
            key.removeprefix(prefix)
            for prefix in prefixes
            for key in summary
            if key.startswith(f"{prefix}gnss_observations_")
        }
    )
    rows = []
    for row in [
        *_RECEIVER,
        *[Row(f"  {key.removeprefix('gnss_observations_').upper()}", key, 0) for key in signals],
    ]:
        values = [summary.get(prefix + row.key) for prefix in prefixes]
        if any(value is not None for value in values):
            rows.append((row.label, [number_text(value, row.decimals) for value in values]))
    return rows


def print_message_counts(console: Console, counts: Mapping[str, int], run_name: str) -> None:
    """Print the topics of a run that has neither a formation nor a receiver."""
    table = _table(f"{run_name}: messages", ["messages"])
    for topic, count in sorted(counts.items()):
        table.add_row(escape(topic), str(count))
    console.print(table)


def _length_text(summary: Summary) -> str:
    """Return the length of the run, and whether it was interrupted."""
    length = f"{summary['run_duration_s']:.0f} s"
    if summary.get("run_complete", True):
        return length
    return f"interrupted after {length}"


def formation_rows(
    summary: Summary, columns: Sequence[PaperColumn]
) -> list[tuple[str, list[tuple[str, str, list[str]]]]]:
    """Return the texts of the formation table: heading and rows of each section.

    Parameters
    ----------
    summary
        Summary of the run, keys without the deputy's name.
    columns
        The paper's results, which stand beside the measured numbers.

    Returns
    -------
    list
        Heading and rows; a row is a label, the measured number, and one number for each column.
    """
    left_out = incomparable_keys(summary["run_duration_s"])
    absent = "not yet" if _is_short(summary["run_duration_s"]) else "never"
    sections = []
    for heading, section in _sections(summary):
        rows = []
        for row in section:
            if row.key not in summary:
                continue
            printed = ["" if row.key in left_out else paper_text(c, row) for c in columns]
            value = summary[row.key]
            measured = absent if value is None else scaled_text(value, row.decimals, row.scale)
            rows.append((row.label, measured, printed))
        if rows:
            sections.append((heading, rows))
    return sections


def formation_heads(columns: Sequence[PaperColumn]) -> list[str]:
    """Return the heads of the columns of numbers; a title of two lines has a line break."""
    return ["measured", *[column.title for column in columns]]


def _formation_table(title: str, summary: Summary, columns: Sequence[PaperColumn]) -> Table:
    table = _table(title, formation_heads(columns))
    for heading, rows in formation_rows(summary, columns):
        table.add_section()
        table.add_row(f"[bold]{heading}[/bold]")
        for label, measured, printed in rows:
            table.add_row(f"  {label}", measured, *printed)
    return table


def _is_short(duration: float) -> bool:
    """Return whether a run of so many s is shorter than those of the paper."""
    return duration < PAPER_DURATION - 1.0


def incomparable_keys(duration: float) -> set[str]:
    """Return the keys of sums of the paper that a run of so many s is too short for."""
    keys: set[str] = set()
    if _is_short(duration):
        keys.update(row.key for row in _TOTAL)
        keys.update(row.key for row in _KEEPING if row.key.startswith("delta_v_"))
    if duration < ACQUISITION_DURATION:
        keys.update(row.key for row in _ACQUISITION if row.key.startswith("delta_v_"))
    return keys


def _comes_to_a_target(summary: Summary) -> bool:
    """Return whether a run is an acquisition of one target, as those of the paper.

    Chasers of a cluster have none, nor has a formation without a controller; guidance moves it.
    """
    if "keeping_in_track_mean_m" in summary and "keeping_in_track_rms_m" not in summary:
        return False
    return not {"cluster_closest_m", "guidance_closest_m"} & set(summary)


def _sections(summary: Summary) -> Iterable[tuple[str, Section]]:
    if not _comes_to_a_target(summary):
        yield f"whole run, {summary['run_duration_s']:.0f} s", [_CLOSEST, *_TOTAL]
        yield "navigation error", _NAVIGATION
        return
    acquisition = min(ACQUISITION_DURATION, summary["run_duration_s"])
    yield f"acquisition, {acquisition:.0f} s", _ACQUISITION
    if "keeping_in_track_mean_m" in summary:
        yield "keeping, from then on", _KEEPING
        yield f"keeping, after {SETTLED_AFTER:.0f} s", _SETTLED_KEEPING
        yield f"whole run, {summary['run_duration_s']:.0f} s", _TOTAL
    yield "navigation error", _NAVIGATION


def formation_remarks(summary: Summary, columns: Sequence[PaperColumn]) -> list[str]:
    """Return the lines under the table that say which numbers may be compared."""
    lines = []
    control_input = summary.get("control_input")
    if control_input is not None:
        fed = _FED.get(control_input) or _describe_navigation(summary)
        lines.append(f"measured: controller fed with {fed}{_comparable_column(summary, columns)}.")
    for column in columns:
        fed = (
            "GNSS navigation of real receivers in the loop (HIL)"
            if column.hardware_in_the_loop
            else "fed with truth"
        )
        lines.append(f"{_join_lines(column.title)}: {column.source}; {fed}.")
    duration = summary["run_duration_s"]
    if columns and _is_short(duration):
        lines.append(
            f"the paper's runs have {PAPER_DURATION:.0f} s, this one {duration:.0f} s: "
            "its totals are left out, its statistics are of the longer time."
        )
    elif columns and duration > PAPER_DURATION + 1.0:
        lines.append(
            f"this run has {duration:.0f} s; the paper's totals and statistics are "
            f"of {PAPER_DURATION:.0f} s."
        )
    comes = _comes_to_a_target(summary)
    if comes and "settling_time_s" in summary:
        lines.append(
            f"settled: stays within {SETTLED_WITHIN:g} m of the target on that axis "
            "(the paper's bound in section 4.1)."
        )
    if comes and "truth_fed_settled_keeping_in_track_rms_m" in summary:
        lines.append(
            "truth-fed twin: the same scenario and controller without ROS, with the truth instead "
            "of navigation."
        )
    if comes and "keeping_in_track_rms_m" in summary:
        lines.append("RMS: of the deviation from the target. dv: sum of |acceleration| x time.")
    return lines


def _describe_navigation(summary: Summary) -> str:
    """Return what the controller was fed with: which receivers, in which world."""
    receivers = describe_receivers(summary)
    return f"GNSS navigation of {receivers}" if receivers else "GNSS navigation"


def _comparable_column(summary: Summary, columns: Sequence[PaperColumn]) -> str:
    """Return which column of the paper was controlled by the same kind of state as the run."""
    if not columns:
        return ""
    navigated = summary["control_input"] == "navigation"
    alike = [
        _join_lines(column.title) for column in columns if column.hardware_in_the_loop == navigated
    ]
    return f", like '{alike[0]}'" if alike else "; the paper prints no such run"


def _join_lines(title: str) -> str:
    return title.replace("\n", " ")


def _table(title: str, columns: Sequence[str]) -> Table:
    table = Table(
        title=escape(title),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1),
    )
    table.add_column("", no_wrap=True)
    for column in columns:
        table.add_column(escape(column), justify="right", no_wrap=True)
    return table


def number_text(value: Any, decimals: int) -> str:
    """Return a measured number; a dash stands for None, a number that does not exist."""
    if value is None:
        return "-"
    if not isinstance(value, float):
        return str(value)
    if value != 0.0 and decimals > 0 and abs(value) < 0.5 * 10.0**-decimals:
        return f"{value:.1e}"  # else it would be shown as zero
    return f"{value:.{decimals}f}"


def scaled_text(value: Any, decimals: int, scale: float) -> str:
    """Return a measured number in another unit."""
    return number_text(value if scale == 1.0 or value is None else value * scale, decimals)


def paper_text(column: PaperColumn, row: Row) -> str:
    """Return the number that the paper prints for a row, with its digits; blank without."""
    value = column.values.get(row.key)
    return "" if value is None else f"{value * row.scale:.7g}"

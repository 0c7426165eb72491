"""The page of a command that computes results: tables and pictures in sections."""

from __future__ import annotations

import pathlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vtff_analysis.page.page import Picture, escape, render_figures, render_page, render_table

__all__ = ["Section", "flat_rows", "write_results"]


@dataclass(frozen=True)
class Section:
    """A section of a page.

    Attributes
    ----------
    title
        Heading; empty for none.
    heads
        Heads of the columns of the table.
    rows
        Rows of the table as texts.
    pictures
        PNG files with the caption of each.
    remarks
        One line for each thing that the reader has to know.
    numbers
        Whether the columns after the first are numbers; else texts of any length.
    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    pictures: Sequence[tuple[pathlib.Path, str]] = ()
    remarks: Sequence[str] = ()
    numbers: bool = True


def write_results(
    path: pathlib.Path,
    title: str,
    sections: Iterable[Section],
    papers: Iterable[str] = (),
    command: str = "",
) -> None:
    """Write a page of results.

    Parameters
    ----------
    path
        HTML file to write.
    title
        Title of the page.
    sections
        Sections in their order.
    papers
        Numbers of the papers whose results stand beside the measured ones.
    command
        Command that makes the page again.

    Raises
    ------
    OSError
        If a picture cannot be read or the page cannot be written.
    """
    body = "".join(_render(section) for section in sections)
    path.write_text(render_page(title, "", body, papers, command), encoding="utf-8")


def flat_rows(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return a nested mapping as rows of a name and a text; what is None or empty is left out."""
    rows: list[tuple[str, str]] = []
    for name, value in values.items():
        label = f"{prefix}{name}".replace("_", " ")
        if isinstance(value, Mapping):
            rows += flat_rows(value, f"{prefix}{name}, ")
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], Mapping):
            for number, item in enumerate(value, 1):
                rows += flat_rows(item, f"{prefix}{name} {number}, ")
        elif value is not None and value != [] and value != ():
            rows.append((label, _text(value)))
    return rows


def _text(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _render(section: Section) -> str:
    heading = f"<h2>{escape(section.title)}</h2>" if section.title else ""
    remarks = "".join(f'<p class="note">{escape(remark)}</p>' for remark in section.remarks)
    rows = section.rows
    table = render_table(section.heads, rows, numbers=section.numbers) if rows else ""
    pictures = [Picture(path, caption, "") for path, caption in section.pictures]
    return f"<section>{heading}{remarks}{table}{render_figures(pictures, '')}</section>"

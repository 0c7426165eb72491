"""The page of a command that computes results: tables and pictures in sections."""

from __future__ import annotations

import pathlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from vtff_analysis.page.page import Picture, escape, render_figures, render_page, render_table

__all__ = ["Section", "write_results"]


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
    points
        Explanations, shown as a list under the pictures.
    numbers
        Whether the columns after the first are numbers; else texts of any length.
    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    pictures: Sequence[tuple[pathlib.Path, str]] = ()
    remarks: Sequence[str] = ()
    numbers: bool = True
    points: Sequence[str] = ()


def write_results(
    path: pathlib.Path,
    title: str,
    sections: Iterable[Section],
    papers: Iterable[str] = (),
    command: str = "",
    lead: str = "",
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
    lead
        The result in one sentence, which opens the page.

    Raises
    ------
    OSError
        If a picture cannot be read or the page cannot be written.
    """
    body = "".join(_render(section) for section in sections)
    head = f'<div class="verdict"><p class="sentence">{escape(lead)}</p></div>' if lead else ""
    path.write_text(render_page(title, head, body, papers, command), encoding="utf-8")


def _render(section: Section) -> str:
    heading = f"<h2>{escape(section.title)}</h2>" if section.title else ""
    remarks = "".join(f'<p class="note">{escape(remark)}</p>' for remark in section.remarks)
    rows = section.rows
    table = render_table(section.heads, rows, numbers=section.numbers) if rows else ""
    pictures = [Picture(path, caption, "") for path, caption in section.pictures]
    points = "".join(f"<li>{escape(point)}</li>" for point in section.points)
    listed = f'<ul class="small">{points}</ul>' if points else ""
    return f"<section>{heading}{remarks}{table}{render_figures(pictures, '')}{listed}</section>"

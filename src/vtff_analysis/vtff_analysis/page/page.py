"""A page of results as one HTML file that holds its pictures and needs nothing else."""

from __future__ import annotations

import base64
import html
import io
import json
import pathlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import jinja2
from PIL import Image

from vtff_analysis.page.citation import PAPERS
from vtff_analysis.view.page_modules import import_map
from vtff_bag.run.environment import vtff_version

__all__ = [
    "Picture",
    "breakable",
    "escape",
    "lines_path",
    "render_figures",
    "render_page",
    "render_table",
    "render_template",
]

_FOLDER = pathlib.Path(__file__).resolve().parent
_COLOURS = 128  # of a picture in a page; the PNG files have all
_FIGURES_MODULE = "figures.js"
_NUMBER_WITH_UNIT = re.compile(r"[-+−]?[\d.]+ \S{1,6}")


@dataclass(frozen=True)
class Picture:
    """A plot and its explanation.

    Attributes
    ----------
    path
        PNG file; its lines may stand beside it (`vtff_analysis.page.line_data`).
    caption
        One or two sentences.
    section
        Section of the page.
    """

    path: pathlib.Path
    caption: str
    section: str


def render_page(
    title: str, head: str, body: str, papers: Iterable[str] = (), command: str = ""
) -> str:
    """Return the HTML text of a page.

    Parameters
    ----------
    title
        Title of the page.
    head, body
        HTML under the title, and of the sections.
    papers
        Numbers of the papers whose results stand on the page.
    command
        Command that makes the page again.
    """
    return render_template(
        "page.html.j2", _FOLDER, title=title, head=head, body=body, papers=papers, command=command
    )


def render_template(name: str, folder: pathlib.Path, **values: Any) -> str:
    """Return the HTML text of a template that extends ``page.html.j2``.

    Parameters
    ----------
    name, folder
        File of the template and its folder.
    values
        Values of the template; ``title`` and those of `render_page`.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, _FOLDER]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["breakable"] = breakable
    shown = {"head": "", "body": "", "command": "", **values}
    shown["papers"] = [PAPERS[number] for number in values.get("papers", ())]
    has_lines = "data-lines" in shown["body"]
    modules, main = import_map(_FOLDER / _FIGURES_MODULE) if has_lines else ({}, "")
    return environment.get_template(name).render(
        **shown,
        style=(_FOLDER / "page.css").read_text(encoding="utf-8"),
        import_map=json.dumps({"imports": modules}) if modules else "",
        figures_module=main,
        version=vtff_version(),
    )


def escape(value: Any) -> str:
    """Return a value as text of HTML."""
    return html.escape(str(value))


def breakable(value: Any) -> str:
    """Return a value as HTML; names of topics, files and figures may break between their parts."""
    # A unit such as m/s stays whole.
    return re.sub(r"/(?!s\d?\b)", "/<wbr>", escape(value)).replace("_", "_<wbr>")


def render_figures(pictures: Sequence[Picture], section: str) -> str:
    """Return the pictures of a section with their captions, and their lines where they have any."""
    return "".join(
        f"<figure{_lines_attribute(picture.path)}>"
        f'<img src="data:image/png;base64,{_encode_picture(picture.path)}" '
        f'alt="{escape(picture.caption)}"><figcaption>{escape(picture.caption)}</figcaption></figure>'
        for picture in pictures
        if picture.section == section
    )


def lines_path(picture: pathlib.Path) -> pathlib.Path:
    """Return the file of the lines of a picture."""
    return picture.with_suffix(".lines.json")


def _lines_attribute(picture: pathlib.Path) -> str:
    path = lines_path(picture)
    if not path.is_file():
        return ""
    lines, name = escape(path.read_text(encoding="utf-8")), escape(picture.stem)
    return f' data-lines="{lines}" data-name="{name}"'


def _encode_picture(path: pathlib.Path) -> str:
    """Return a picture in base64, with a palette: a quarter of the size, and no eye sees it."""
    with Image.open(path) as picture:
        plain = picture.convert("RGB")
    reduced = plain.quantize(_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    content = io.BytesIO()
    reduced.save(content, "PNG")
    return base64.b64encode(content.getvalue()).decode("ascii")


def render_table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = True
) -> str:
    """Return a table; a row that is a text is a heading.

    Columns after the first are set as numbers unless `numbers` is False.
    """

    def cell(tag: str, column: int, value: str) -> str:
        if _NUMBER_WITH_UNIT.fullmatch(value):
            value = value.replace(" ", "\N{NO-BREAK SPACE}")
        # A unit such as m/s is not broken.
        if numbers and column:
            return f'<{tag} class="number">{escape(value)}</{tag}>'
        return f"<{tag}>{breakable(value)}</{tag}>"

    head = "".join(cell("th", column, value) for column, value in enumerate(heads))
    lines = []
    for row in rows:
        if isinstance(row, str):
            lines.append(f'<tr class="part"><th colspan="{len(heads)}">{escape(row)}</th>')
        else:
            lines.append("<tr>" + "".join(cell("td", column, v) for column, v in enumerate(row)))
        lines.append("</tr>")
    shown = f"<thead><tr>{head}</tr></thead>" if any(heads) else ""
    return f"<table>{shown}<tbody>{''.join(lines)}</tbody></table>"

"""The page of results: one template, escaped texts, papers, commands, lines of figures."""

import pathlib

import numpy as np

from vtff_analysis.page.citation import PAPERS
from vtff_analysis.page.page import Picture, render_figures, render_page, render_table
from vtff_analysis.page.results import Section, write_results
from vtff_analysis.plot_style import make_figure, save_figure
from vtff_node.plain_yaml import parse_yaml


def test_texts_are_escaped_and_papers_and_command_stand_at_the_end():
    page = render_page("a <b>", "", render_table(["x"], [["<script>"]]), ["000"], "vtff run a&b")
    assert "<title>a &lt;b&gt;</title>" in page and "&lt;script&gt;" in page
    assert "vtff run a&amp;b" in page
    assert PAPERS["000"].doi in page and "https://doi.org/10.1002/navi.354" in page
    assert "importmap" not in page  # no figure needs it


def test_figures_with_lines_bring_the_script(tmp_path):
    figure = make_figure(3.0)
    figure.subplots().plot([0, 1], [2, 3], label='"quoted" <b>')
    lines = Picture(save_figure(figure, tmp_path / "a.png", "t"), "A caption.", "s")
    figure = make_figure(3.0)
    figure.subplots().imshow(np.eye(2))
    image = Picture(save_figure(figure, tmp_path / "b.png", "t"), "Another.", "s")
    text = render_figures([lines, image], "s")
    assert text.count("<figure") == 2 and text.count("data-lines") == 1 and "<b>" not in text
    assert "importmap" in render_page("t", "", text)
    assert render_figures([lines], "other") == ""


def test_the_citation_file_names_the_same_papers():
    root = pathlib.Path(__file__).resolve().parents[4]
    citation = parse_yaml((root / "CITATION.cff").read_text(encoding="utf-8"))
    cited = {entry["doi"] for entry in citation["references"] if "doi" in entry}
    assert cited == {paper.doi for paper in PAPERS.values() if paper.doi}
    changes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## {citation['version']}" in changes


def test_results_are_tables_remarks_and_pictures(tmp_path):
    figure = make_figure(3.0)
    figure.subplots().plot([0, 1], [2, 3])
    picture = save_figure(figure, tmp_path / "a.png", "t")
    rows = [("a b", "1.23457"), ("list", "<z>")]
    section = Section("Head", ("", "value"), rows, [(picture, "caption")], ("beware",))
    write_results(tmp_path / "r.html", "Title", [section], ["004"], "vtff tec x", "Good <b>.")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    for text in (
        "Title",
        "Good &lt;b&gt;.",
        "Head",
        "&lt;z&gt;",
        "beware",
        "caption",
        "data-lines",
        "vtff tec x",
    ):
        assert text in page, text
    assert PAPERS["004"].doi in page

"""The documentation site: links between files become links between pages; faults are named."""

from __future__ import annotations

import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs"))

from site_pages.check_site import find_dead_links  # noqa: E402
from site_pages.python_pages import find_rooms, public_objects  # noqa: E402
from site_pages.repository_links import LinkRewriter, show_file  # noqa: E402


@pytest.fixture
def repository(tmp_path: pathlib.Path) -> pathlib.Path:
    for name in ("docs/guide.md", "src/a/README.md", "config/x.yaml", "docs/images/p.png"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("value: 1\n")
    return tmp_path


@pytest.fixture
def rewriter(repository: pathlib.Path) -> LinkRewriter:
    pages = {"docs/guide.md": "guide.md", "src/a/README.md": "generated/packages/a.md"}
    return LinkRewriter(repository, pages)


@pytest.mark.parametrize(
    ("origin", "page", "text", "expected"),
    [
        ("docs/guide.md", "guide.md", "[a](../src/a/README.md)", "[a](generated/packages/a.md)"),
        (
            "src/a/README.md",
            "generated/packages/a.md",
            "[g](../../docs/guide.md#two)",
            "[g](../../guide.md#two)",
        ),
        ("docs/guide.md", "guide.md", "[w](https://example.org/x)", "[w](https://example.org/x)"),
        ("docs/guide.md", "guide.md", "![p](images/p.png)", "![p](images/p.png)"),
        ("docs/guide.md", "guide.md", "```\n[a](nowhere.md)\n```", "```\n[a](nowhere.md)\n```"),
    ],
)
def test_links_lead_to_pages(rewriter, origin, page, text, expected):
    assert rewriter.rewrite(text, origin, page) == expected


def test_another_file_gets_a_page_that_shows_it(rewriter, repository):
    text = rewriter.rewrite("[x](../config/x.yaml#L3)", "docs/guide.md", "guide.md")
    page = rewriter.shown["config/x.yaml"]
    assert text == f"[x]({page})"
    assert "literalinclude" in show_file(repository, "config/x.yaml", page)


def test_a_link_to_nothing_is_named(rewriter):
    with pytest.raises(ValueError, match=r"docs/guide\.md: link to 'docs/none\.md'"):
        rewriter.rewrite("[n](none.md)", "docs/guide.md", "guide.md")


def test_public_objects_are_those_of_the_modules():
    names = public_objects(ROOT)
    assert "vtff_analysis.library.functions.fly" in names
    assert not any(part.startswith("_") for name in names for part in name.split("."))
    assert len(find_rooms(ROOT)) > 40


def test_dead_links_and_files_from_elsewhere_are_named(tmp_path):
    (tmp_path / "other.html").write_text('<h1 id="top">x</h1><a href="index.html">back</a>')
    (tmp_path / "index.html").write_text(
        '<a href="none.html">a</a><a href="#no">b</a><img src="https://example.org/i.png">'
        '<a href="other.html#top">c</a><a href="https://example.org">d</a>'
    )
    faults = find_dead_links(tmp_path)
    assert len(faults) == 3
    assert "none.html, which is not there" in faults[0]
    assert "no such anchor" in faults[1]
    assert "from another machine" in faults[2]

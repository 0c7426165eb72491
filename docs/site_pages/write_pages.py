"""Writes the pages of the site that come from the code and from files outside ``docs/``.

``docs/conf.py`` calls `write_pages` before Sphinx reads its sources.
"""

from __future__ import annotations

import pathlib
import shutil

from site_pages.command_pages import command_page
from site_pages.message_pages import message_page
from site_pages.node_pages import find_nodes, node_page
from site_pages.python_pages import find_rooms, room_page
from site_pages.repository_links import GENERATED, LinkRewriter, show_file

#: Files outside ``docs/`` that are pages of the site.
COPIED = {
    "README.md": f"{GENERATED}/readme.md",
    "CHANGELOG.md": f"{GENERATED}/changelog.md",
    "CONTRIBUTING.md": f"{GENERATED}/contributing.md",
    "benchmarks/README.md": f"{GENERATED}/benchmarks.md",
    "bags/README.md": f"{GENERATED}/bags.md",
}


def find_pages(root: pathlib.Path) -> dict[str, str]:
    """Return the files and folders of the repository that are pages: path -> page below docs/."""
    pages = dict(COPIED)
    for readme in sorted(root.glob("src/*/README.md")):
        name = readme.parent.name
        pages[f"src/{name}/README.md"] = f"{GENERATED}/packages/{name}.md"
        pages[f"src/{name}"] = f"{GENERATED}/packages/{name}.md"
    for room, modules in find_rooms(root).items():
        package = room.partition(".")[0]
        for name in (room, *modules):
            path = f"src/{package}/{name.replace('.', '/')}"
            page = f"{GENERATED}/python/{room}.md"
            pages[path if name == room else f"{path}.py"] = page
    for page in _written_pages(root):
        pages[f"docs/{page}"] = page
    return pages


def write_pages(root: pathlib.Path) -> LinkRewriter:
    """Write all generated pages anew; return the rewriter for the pages that are written by hand.

    Parameters
    ----------
    root
        Folder of the repository.

    Raises
    ------
    ValueError
        If a link of a Markdown file names a file that does not exist.
    OSError
        If a page cannot be written.
    """
    docs = root / "docs"
    shutil.rmtree(docs / GENERATED, ignore_errors=True)
    pages = find_pages(root)
    rewriter = LinkRewriter(root, pages)
    for page in _written_pages(root):
        rewriter.rewrite((docs / page).read_text(encoding="utf-8"), f"docs/{page}", page)
    for origin, page in pages.items():
        if origin.endswith(".md") and not origin.startswith("docs/"):
            text = (root / origin).read_text(encoding="utf-8")
            _write(docs / page, rewriter.rewrite(text, origin, page))
    for room, modules in find_rooms(root).items():
        _write(docs / GENERATED / "python" / f"{room}.md", room_page(room, modules))
    for executable, (package, node_class) in find_nodes().items():
        page = node_page(executable, package, node_class)
        _write(docs / GENERATED / "nodes" / f"{executable}.md", page)
    _write(docs / GENERATED / "messages.md", message_page(root))
    _write(docs / GENERATED / "commands.md", command_page())
    for target, page in rewriter.shown.items():
        _write(docs / page, show_file(root, target, page))
    return rewriter


def _written_pages(root: pathlib.Path) -> list[str]:
    docs = root / "docs"
    folders = ("", "tutorials/", "papers/", "notebook/")
    files = [file for folder in folders for file in docs.glob(f"{folder}*.md")]
    return sorted(str(file.relative_to(docs)) for file in files)


def _write(path: pathlib.Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")

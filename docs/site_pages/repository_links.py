"""Links between files of the repository, turned into links between pages of the site."""

from __future__ import annotations

import os
import pathlib
import posixpath
import re

LINK = re.compile(r"(?<!\\)(\]\()(?!https?:|mailto:|#)([^)\s]+)(\))")
FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)

#: Folder of the pages that are written from the code, below the folder of the documentation.
GENERATED = "generated"


class LinkRewriter:
    """Rewrites relative links of Markdown files, which hold in the repository, for the site.

    A file that the site has as a page is linked as that page. Any other file of the repository
    gets a page that shows it, so that no link leads out of the site.

    Parameters
    ----------
    root
        Folder of the repository.
    pages
        Path of a file or folder relative to `root` -> its page relative to ``docs/``.
    """

    def __init__(self, root: pathlib.Path, pages: dict[str, str]) -> None:
        self._root = root
        self._pages = pages
        self.shown: dict[str, str] = {}  # file of the repository -> page that shows it

    def rewrite(self, text: str, origin: str, page: str) -> str:
        """Return the text of a Markdown file with links that hold on its page.

        Parameters
        ----------
        text
            Content of the file.
        origin
            Path of the file relative to the repository.
        page
            Path of its page relative to ``docs/``.

        Raises
        ------
        ValueError
            If a link names a file that is not in the repository; the text names both.
        """
        code = [match.span() for match in FENCE.finditer(text)]

        def replace(match: re.Match[str]) -> str:
            if any(start <= match.start() < end for start, end in code):
                return match.group(0)
            path, _, anchor = match.group(2).partition("#")
            target = posixpath.normpath(posixpath.join(posixpath.dirname(origin), path))
            linked = posixpath.relpath(self._page_of(target, origin), posixpath.dirname(page))
            # Lines of a file that is shown have no anchors, headings have.
            end = f"#{anchor}" if anchor and target not in self.shown else ""
            return f"{match.group(1)}{linked}{end}{match.group(3)}"

        return LINK.sub(replace, text)

    def _page_of(self, target: str, origin: str) -> str:
        if target in self._pages:
            return self._pages[target]
        file = self._root / target
        if not file.exists():
            raise ValueError(f"{origin}: link to '{target}', which does not exist")
        if file.suffix in (".png", ".svg"):
            return os.path.relpath(file, self._root / "docs")
        page = f"{GENERATED}/files/{target.replace('/', '_').replace('.', '_')}.md"
        self.shown[target] = page
        return page


def show_file(root: pathlib.Path, target: str, page: str) -> str:
    """Return the text of the page that shows a file or the names of the files of a folder."""
    path = root / target
    if path.is_dir():
        names = sorted(
            entry.name + ("/" if entry.is_dir() else "")
            for entry in path.iterdir()
            if not entry.name.startswith((".", "__pycache__"))
        )
        listing = "\n".join(names)
        return f"---\norphan: true\n---\n\n# {target}\n\n```text\n{listing}\n```\n"
    language = {".py": "python", ".yaml": "yaml", ".sh": "bash", ".toml": "toml"}
    above = os.path.relpath(path, (root / "docs" / page).parent)
    kind = language.get(path.suffix, "text")
    return (
        f"---\norphan: true\n---\n\n# {target}\n\n"
        f"```{{literalinclude}} {above}\n:language: {kind}\n```\n"
    )

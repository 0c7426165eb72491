"""Checks a built site: ``python -m site_pages.check_site FOLDER`` in ``docs/``.

Every link between pages leads to a page and to an anchor that it has, nothing is loaded from
another machine, and every public function and class has its entry. Exit code 1 and one line for
each fault.
"""

from __future__ import annotations

import functools
import html.parser
import pathlib
import sys
import urllib.parse

from site_pages.python_pages import public_objects

#: Attributes by which a page loads something, by element.
LOADING = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}


class _Page(html.parser.HTMLParser):
    """Links, loaded files and anchors of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value for name, value in attrs if value}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        is_canonical = tag == "link" and given.get("rel") in ("canonical", "search", "index")
        if LOADING.get(tag) in given and not is_canonical:
            self.loaded.append(given[LOADING[tag]])


@functools.cache
def _read(path: pathlib.Path) -> _Page:
    page = _Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def find_missing(site: pathlib.Path, root: pathlib.Path) -> list[str]:
    """Return one line for each public object of the repository that no page of a site describes."""
    # Imported here, so that links can be checked without Sphinx.
    from sphinx.util.inventory import InventoryFile

    described = set()
    inventory = InventoryFile.loads((site / "objects.inv").read_bytes(), uri="")
    for kind, objects in inventory.data.items():
        if kind.startswith("py:"):
            described |= set(objects)
    missing = sorted(public_objects(root) - described)
    return [f"{name}: public, but not in the reference" for name in missing]


def find_dead_links(site: pathlib.Path) -> list[str]:
    """Return one line for each link that leads nowhere and each file from another machine."""
    faults = []
    for file in sorted(site.rglob("*.html")):
        page, name = _read(file), file.relative_to(site)
        for target in [*page.links, *page.loaded]:
            parts = urllib.parse.urlsplit(target)
            if parts.scheme or parts.netloc:
                if target in page.loaded and parts.scheme != "data":
                    faults.append(f"{name}: loads {target} from another machine")
                continue
            path = urllib.parse.unquote(parts.path)
            linked = (file.parent / path).resolve() if path else file
            linked = linked / "index.html" if linked.is_dir() else linked
            if not linked.is_file():
                faults.append(f"{name}: link to {target}, which is not there")
            elif parts.fragment and linked.suffix == ".html":
                if urllib.parse.unquote(parts.fragment) not in _read(linked).anchors:
                    faults.append(f"{name}: link to {target}; the page has no such anchor")
    return faults


def main() -> int:
    """Print the faults of the site in the folder of the first argument."""
    site = pathlib.Path(sys.argv[1]).resolve()
    root = pathlib.Path(__file__).resolve().parents[2]
    faults = [*find_dead_links(site), *find_missing(site, root)]
    for fault in faults:
        print(fault)
    pages = sum(1 for _ in site.rglob("*.html"))
    print(f"{pages} pages, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())

"""The Markdown files name files, folders and modules that exist."""

from __future__ import annotations

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(
    path
    for pattern in ("*.md", "docs/*.md", "src/*/README.md", "bags/README.md", "benchmarks/*.md")
    for path in ROOT.glob(pattern)
)
#: Entries of the notebook name the code of their day; only their links must hold.
LINKED = [*DOCUMENTS, *sorted((ROOT / "docs/notebook").glob("*.md"))]
PACKAGES = {path.name for path in (ROOT / "src").glob("vtff_*")}
#: Folders of the repository; others (`.venv`, `build`, `bag/` of a run) are made later.
TRACKED = ("src", "config", "docs", "test", "tools", "requirements", "benchmarks", "rosdep", ".ci")
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
FENCE = re.compile(r"```.*?```", re.S)


def names(path):
    return path.relative_to(ROOT).as_posix()


def anchors(document):
    """Return the anchors that a forge makes of the headings of a document."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", document.read_text(encoding="utf-8")), re.M)
    return {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings
    }


@pytest.mark.parametrize("document", LINKED, ids=names)
def test_links_lead_somewhere(document):
    for target in LINK.findall(FENCE.sub("", document.read_text(encoding="utf-8"))):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        file = document.parent / path if path else document
        assert file.exists(), f"{names(document)}: no {target}"
        if anchor:
            assert anchor in anchors(file), f"{names(document)}: no heading for {target}"


def is_there(span, document):
    """Whether a path in a document names a file: from the root, its folder, or its package."""
    if "/" not in span:
        return any(next((ROOT / folder).rglob(span), None) is not None for folder in TRACKED)
    package = document.parent.name
    folders = [ROOT, document.parent, ROOT / "src", document.parent / package]
    return any(next(folder.glob(span.rstrip("/")), None) is not None for folder in folders)


def paths_of(text):
    """Return what stands in code marks or code blocks and is a path of the repository."""
    spans = {word for span in CODE.findall(FENCE.sub("", text)) for word in span.split()}
    spans |= {word for block in FENCE.findall(text) for word in block.split()}
    clean = {span.strip(",;()\"'").partition(":=")[2] or span.strip(",;()\"'") for span in spans}
    return {
        span
        for span in clean
        if re.fullmatch(r"[\w.*/-]+", span)
        and (span.split("/")[0] in TRACKED and "/" in span or re.search(r"[\w*]\.(py|sh)$", span))
    }


@pytest.mark.parametrize("document", DOCUMENTS, ids=names)
def test_named_paths_exist(document):
    text = document.read_text(encoding="utf-8")
    missing = sorted(span for span in paths_of(text) if not is_there(span, document))
    assert not missing, f"{names(document)} names {missing}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=names)
def test_named_modules_exist(document):
    """`vtff_nav.relative.cdgps` is a folder or module; one more name must stand in its file."""
    for dotted in re.findall(r"\bvtff_\w+(?:\.\w+)+", document.read_text(encoding="utf-8")):
        package, *rest = dotted.split(".")
        if package not in PACKAGES or rest[-1] in {"py", "yaml", "md", "dbc"}:
            continue
        place = ROOT / "src" / package / package
        while rest and (place / rest[0]).is_dir():
            place /= rest.pop(0)
        if rest and (place / f"{rest[0]}.py").is_file():
            place /= f"{rest.pop(0)}.py"
        if rest:
            file = place / "__init__.py" if place.is_dir() else place
            known = file.is_file() and re.search(
                rf"\b{rest[0]}\b", file.read_text(encoding="utf-8")
            )
            assert known, f"{names(document)} names {dotted}"


def test_missing_files_are_seen():
    """The searches above can fail."""
    document = ROOT / "README.md"
    assert paths_of("`tools/no_such.py` and `config/system/reference.yaml`") == {
        "tools/no_such.py",
        "config/system/reference.yaml",
    }
    assert not is_there("tools/no_such.py", document)
    assert is_there("config/system/reference.yaml", document)

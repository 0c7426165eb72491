"""The glossary names what is in the code, and each name once."""

from __future__ import annotations

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
ROWS = re.findall(
    r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$",
    (ROOT / "docs/glossary.md").read_text(encoding="utf-8"),
    re.M,
)
NAMES = [name for name, *_ in ROWS]


@pytest.fixture(scope="module")
def source() -> str:
    """Return the text of the code and the messages."""
    files = [
        path
        for pattern in ("src/*/vtff_*/**/*.py", "src/vtff_msgs/*/*.*")
        for path in ROOT.glob(pattern)
    ]
    return "\n".join(path.read_text(encoding="utf-8") for path in files)


def is_named(name: str, source: str) -> bool:
    """Whether a name is a word of the code, or a part of one between underscores."""
    return re.search(rf"(?<![A-Za-z]){re.escape(name)}(?![a-z])", source) is not None


def test_every_name_is_in_the_code(source):
    missing = [name for name in NAMES if not is_named(name, source)]
    assert not missing
    assert not is_named("no_such_name_in_the_code", source)


def test_names_and_terms_are_there_once():
    assert len(NAMES) >= 150
    assert len(NAMES) == len(set(NAMES))
    terms = [term for _, term, *_ in ROWS]
    repeated = {term for term in terms if terms.count(term) > 1}
    assert not repeated


def test_every_row_is_complete():
    text = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    assert text.count("\n| `") == len(ROWS)
    assert all(cell.strip() for row in ROWS for cell in row)

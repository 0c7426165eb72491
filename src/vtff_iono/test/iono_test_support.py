"""Reference files and settings shared by the vtff_iono tests."""

from __future__ import annotations

import os
import pathlib

import pytest
from hypothesis import settings

SHARED = pathlib.Path(
    os.environ.get("VTFF_SHARED", pathlib.Path(__file__).resolve().parents[3].parent / "shared")
)
BELE = SHARED / "data" / "ionosphere" / "bele_2024010"


def examples(count: int) -> settings:
    """Return settings of a property test: the same examples in every run, nothing stored."""
    return settings(max_examples=count)


def bele_file(name: str) -> pathlib.Path:
    """Return a file of the night of plasma bubbles over Belem, or skip the test."""
    path = BELE / name
    if not path.is_file():
        pytest.skip(f"reference data {path} is not there")
    return path

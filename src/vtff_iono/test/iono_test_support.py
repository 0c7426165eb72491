"""Reference files and settings shared by the vtff_iono tests."""

from __future__ import annotations

import pathlib

from hypothesis import settings
from shared_data import require_shared


def examples(count: int) -> settings:
    """Return settings of a property test: the same examples in every run, nothing stored."""
    return settings(max_examples=count)


def bele_file(name: str) -> pathlib.Path:
    """Return a file of the night of plasma bubbles over Belem, or skip the test."""
    return require_shared(f"data/ionosphere/bele_2024010/{name}")

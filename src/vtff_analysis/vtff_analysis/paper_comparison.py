"""Tables of studies: a number of a paper beside the measured one."""

from __future__ import annotations

import csv
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["ComparisonRow", "PaperComparison", "write_comparison"]


@dataclass(frozen=True)
class ComparisonRow:
    """One number of the paper and what was measured, as text with units."""

    subject: str
    quantity: str
    paper: str
    measured: str


@dataclass(frozen=True)
class PaperComparison:
    """Results of a study beside those of its paper.

    Attributes
    ----------
    sentence
        The result in plain words, with the paper's beside it.
    rows
        Its numbers.
    """

    sentence: str
    rows: list[ComparisonRow]


def write_comparison(rows: Sequence[ComparisonRow], path: pathlib.Path) -> None:
    """Write rows as CSV."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("subject", "quantity", "paper", "measured"))
        for row in rows:
            writer.writerow([row.subject, row.quantity, row.paper, row.measured])

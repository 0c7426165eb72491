"""Numbers of a verdict as texts, in the unit that fits them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from vtff_analysis.recordings.topics import key_part

__all__ = [
    "Figure",
    "Summary",
    "complete_numbers",
    "length_figure",
    "length_text",
    "length_unit",
    "numbers_of",
    "short_text",
    "times_text",
]

Summary = Mapping[str, Any]

_KILOMETRES_FROM = 1e4  # m


@dataclasses.dataclass(frozen=True)
class Figure:
    """One number of a verdict, as texts.

    Attributes
    ----------
    label
        Name of the number.
    measured, paper, bound
        Number with unit; empty where there is none. The bound is what the same run reaches at best
        (the controller fed with truth), or the true value.
    ratio
        Comparison with the paper in words; empty without one.
    """

    label: str
    measured: str
    paper: str = ""
    bound: str = ""
    ratio: str = ""


def length_figure(label: str, measured: float, paper: float | None, bound: float | None) -> Figure:
    """Return a figure that is a length in m, with its ratio to the paper's."""
    ratio = "" if not paper or not measured else times_text(paper / measured, "smaller", "larger")
    return Figure(label, length_text(measured), length_text(paper), length_text(bound), ratio)


def length_text(value: float | None) -> str:
    """Return a length in m as a text in mm, m or km, to three digits; empty for None."""
    if value is None:
        return ""
    scale, unit = length_unit(abs(value))
    return f"{short_text(value / scale)} {unit}"


def length_unit(length: float) -> tuple[float, str]:
    """Return size (m) and name of the unit: mm for what is kept, m and km for flights."""
    if length >= _KILOMETRES_FROM:
        return 1e3, "km"
    return (1.0, "m") if length >= 1.0 else (1e-3, "mm")


def times_text(ratio: float, less: str, more: str) -> str:
    """Return a ratio as "3 times less", or as "3 times more" where it is below one."""
    factor, word = (ratio, less) if ratio >= 1.0 else (1.0 / ratio, more)
    return f"{short_text(factor, 2)} times {word}"


def short_text(value: float, digits: int = 3) -> str:
    """Return a number to some significant digits, without an exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    rounded = round(value, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{rounded:.{decimals}f}"


def complete_numbers(values: Sequence[Any]) -> list[float]:
    """Return values if all are numbers; empty where one is missing."""
    return [] if any(value is None for value in values) else [float(value) for value in values]


def numbers_of(summary: Summary, name: str, deputies: Sequence[str]) -> dict[str, Any]:
    """Return the summary with the keys of one deputy of several without its name."""
    prefix = f"{key_part(name)}_" if len(deputies) > 1 else ""
    return {key.removeprefix(prefix): value for key, value in summary.items()}

"""Bounds that a campaign must keep, judged with the confidence that its cases give."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.special import betaincinv

from vtff_analysis.studies.figures import describe_name, unit_of
from vtff_sim_bridge.truth.scenario_fields import Section

__all__ = ["Bound", "Verdict", "judge_bound", "lower_confidence_limit", "read_bound"]

_DEFAULT_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Bound:
    """A bound on a figure.

    Attributes
    ----------
    figure
        Name of the figure.
    at_least, at_most
        Limits, infinite where there is none.
    fraction
        Part of all cases that must keep the limits; with 1, every case that was flown must.
    confidence
        Probability with which the statement on all cases is right.
    """

    figure: str
    at_least: float = -math.inf
    at_most: float = math.inf
    fraction: float = 1.0
    confidence: float = _DEFAULT_CONFIDENCE

    def keeps(self, value: float | None) -> bool:
        """Tell whether a case keeps the limits; one without a value does not."""
        return value is not None and self.at_least <= value <= self.at_most

    def excess(self, value: float | None) -> float:
        """Return by how much a value is outside (positive) or inside the nearer limit."""
        if value is None or math.isnan(value):
            return math.inf
        return max(self.at_least - value, value - self.at_most)

    def __str__(self) -> str:
        limits = []
        if self.at_least > -math.inf:
            limits.append(f"at least {self.at_least:g}")
        if self.at_most < math.inf:
            limits.append(f"at most {self.at_most:g}")
        whole = "every case" if self.fraction == 1.0 else f"{100.0 * self.fraction:g} % of cases"
        unit = unit_of(self.figure)
        limit = f"{' and '.join(limits)} {unit}".rstrip()
        return f"{describe_name(self.figure)} {limit} in {whole}"


@dataclass(frozen=True)
class Verdict:
    """Verdict of the cases of a campaign on a bound.

    Attributes
    ----------
    bound
        The bound.
    kept, total
        Number of cases that keep it, and of all; a case that failed does not keep it.
    lower_limit
        With the bound's confidence, at least this part of all possible cases keeps it.
    holds
        With a fraction of 1: every case keeps it. Else: `lower_limit` reaches the fraction.
    """

    bound: Bound
    kept: int
    total: int
    lower_limit: float
    holds: bool

    @property
    def state(self) -> str:
        """What is known of the bound: ``holds``, ``does not hold`` or ``not shown``.

        Not shown: as many cases keep it as it asks for, but too few were flown for its confidence.
        """
        if self.holds:
            return "holds"
        enough = self.total > 0 and self.kept / self.total >= self.bound.fraction
        return "not shown" if enough else "does not hold"

    def __str__(self) -> str:
        confidence, limit = 100.0 * self.bound.confidence, 100.0 * self.lower_limit
        state = self.state if self.holds else self.state.upper()
        return (
            f"{self.bound}: {state}, {self.kept} of {self.total} cases; with {confidence:g} % "
            f"confidence at least {limit:.4g} % of all"
        )


def judge_bound(bound: Bound, values: Sequence[float | None]) -> Verdict:
    """Judge a bound by the figures of all cases, None for a case without a figure."""
    kept = sum(bound.keeps(value) for value in values)
    limit = lower_confidence_limit(kept, len(values), bound.confidence)
    every = 0 < len(values) == kept
    holds = every if bound.fraction == 1.0 else limit >= bound.fraction
    return Verdict(bound, kept, len(values), limit, holds)


def lower_confidence_limit(successes: int, trials: int, confidence: float) -> float:
    """Return the one-sided lower limit of a binomial probability (Clopper and Pearson, 1934).

    Parameters
    ----------
    successes, trials
        Counts of independent trials.
    confidence
        Probability with which the true probability is not below the limit, 0 to 1.
    """
    if successes == 0:
        return 0.0
    return float(betaincinv(successes, trials - successes + 1, 1.0 - confidence))


def read_bound(section: Section, figure: str) -> Bound:
    """Read one entry of ``must``.

    Raises
    ------
    ScenarioError
        Naming file and field.
    """
    entry = section.section(figure)
    limits = {name: entry.number(name) for name in ("at_least", "at_most") if name in entry}
    parts = {
        name: entry.number(name, minimum=0.0)
        for name in ("fraction", "confidence")
        if name in entry
    }
    entry.finish()
    if not limits:
        raise entry.error("", "at_least, at_most or both expected")
    bound = Bound(figure, **limits, **parts)
    if bound.at_least > bound.at_most:
        raise entry.error("at_least", f"not above at_most expected, got {bound.at_least:g}")
    if not 0.0 < bound.fraction <= 1.0:
        raise entry.error("fraction", f"more than 0 and at most 1 expected, got {bound.fraction:g}")
    if not 0.0 < bound.confidence < 1.0:
        raise entry.error("confidence", f"between 0 and 1 expected, got {bound.confidence:g}")
    return bound

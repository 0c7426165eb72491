"""What a survey is asked for, and a timeline of it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from vtff_control.guidance.requests import (
    RequestError,
    read_number,
    read_setting,
    read_timed_lines,
)

__all__ = ["GOAL_KINDS", "SurveyGoal", "TimedGoal", "read_goals"]

GOAL_KINDS = ("edge_altitudes", "both_walls", "profile", "default")
"""An edge at two altitudes; both walls of a bubble at two altitudes in one pass; the profile of a
region by many altitude differences; the default ellipse, which ends a survey."""


@dataclass(frozen=True)
class SurveyGoal:
    """What to sample.

    Parameters
    ----------
    kind
        One of `GOAL_KINDS`.
    altitude_difference
        Difference of the altitudes of the spacecraft at a crossing, m: the least for edges and
        walls, the largest for a profile.

    Raises
    ------
    RequestError
        If a value is impossible.
    """

    kind: str = "edge_altitudes"
    altitude_difference: float = 2000.0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.kind not in GOAL_KINDS:
            raise RequestError(f"kind: one of {', '.join(GOAL_KINDS)} expected, got '{self.kind}'")
        if not (math.isfinite(self.altitude_difference) and self.altitude_difference > 0.0):
            raise RequestError(
                f"altitude_difference: more than 0 m expected, got {self.altitude_difference:g}"
            )


@dataclass(frozen=True)
class TimedGoal:
    """A goal and when it begins.

    Attributes
    ----------
    time
        s after the first states.
    goal
        What to sample from then on.
    """

    time: float
    goal: SurveyGoal


def read_goals(lines: Sequence[str]) -> list[TimedGoal]:
    """Return the goals of a timeline in the order of their times.

    Parameters
    ----------
    lines
        One goal each: time in s, kind, and fields of `SurveyGoal` as ``name=value``, such as
        ``0 edge_altitudes altitude_difference=2000``.

    Raises
    ------
    RequestError
        If a line has another form; the text names the line.
    """
    expected = "time and kind expected, such as '0 edge_altitudes'"
    return [TimedGoal(time, goal) for time, goal in read_timed_lines(lines, _read_goal, expected)]


def _read_goal(words: list[str]) -> SurveyGoal:
    names = [field.name for field in dataclasses.fields(SurveyGoal) if field.name != "kind"]
    settings = [read_setting(text, names) for text in words[1:]]
    return SurveyGoal(words[0], **{name: read_number(name, text) for name, text in settings})

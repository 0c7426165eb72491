"""What a survey is asked for, and a timeline of it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["GOAL_KINDS", "GoalError", "SurveyGoal", "TimedGoal", "read_goals"]

GOAL_KINDS = ("edge_altitudes", "both_walls", "profile", "default")
"""An edge at two altitudes; both walls of a bubble at two altitudes in one pass; the profile of a
region by many altitude differences; the default ellipse, which ends a survey."""


class GoalError(ValueError):
    """A goal cannot be taken; one line that says why."""


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
    GoalError
        If a value is impossible.
    """

    kind: str = "edge_altitudes"
    altitude_difference: float = 2000.0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.kind not in GOAL_KINDS:
            raise GoalError(f"kind: one of {', '.join(GOAL_KINDS)} expected, got '{self.kind}'")
        if not (math.isfinite(self.altitude_difference) and self.altitude_difference > 0.0):
            raise GoalError(
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
    GoalError
        If a line has another form; the text names the line.
    """
    goals = []
    for line in lines:
        try:
            goals.append(_read_line(line))
        except GoalError as error:
            raise GoalError(f"timeline, '{line}': {error}") from error
    return sorted(goals, key=lambda timed: timed.time)


def _read_line(line: str) -> TimedGoal:
    words = line.split()
    if len(words) < 2:
        raise GoalError("time and kind expected, such as '0 edge_altitudes'")
    time = _number("time", words[0])
    if time < 0.0:
        raise GoalError(f"time: 0 s or more expected, got {words[0]}")
    names = [field.name for field in dataclasses.fields(SurveyGoal) if field.name != "kind"]
    values = {}
    for setting in words[2:]:
        name, equals, text = setting.partition("=")
        if not equals or name not in names:
            raise GoalError(f"'{setting}': name=value expected, of {', '.join(names)}")
        values[name] = _number(name, text)
    return TimedGoal(time, SurveyGoal(words[1], **values))


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise GoalError(f"{name}: a number expected, got '{text}'")
    return value

"""What survey_guidance has learnt and decided in a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_node.stamps import to_nanoseconds

__all__ = [
    "SURVEY_TOPIC",
    "SurveyCollector",
    "SurveyCrossing",
    "SurveyDecision",
    "SurveyHistory",
    "SurveyPrediction",
    "SurveyWall",
]

SURVEY_TOPIC = "/formation/survey"


@dataclass(frozen=True)
class SurveyCrossing:
    """A supported crossing of a wall.

    Attributes
    ----------
    time
        ns since 1970.
    spacecraft
        Name.
    is_entry
        Whether the irregularity begins there.
    longitude_deg, latitude_deg
        deg.
    altitude, sigma
        Above the ellipsoid, and sigma along the equator, m.
    """

    time: int
    spacecraft: str
    is_entry: bool
    longitude_deg: float
    latitude_deg: float
    altitude: float
    sigma: float


@dataclass(frozen=True)
class SurveyWall:
    """A wall as it was known at a decision.

    Attributes
    ----------
    is_entry
        Whether the irregularity begins there.
    passes
        In how many passes it was crossed.
    longitude_deg
        At the decision, deg.
    drift, drift_sigma
        Zonal, m/s.
    """

    is_entry: bool
    passes: int
    longitude_deg: float
    drift: float
    drift_sigma: float


@dataclass(frozen=True)
class SurveyPrediction:
    """A crossing to come.

    Attributes
    ----------
    wall
        Index of the wall at the decision.
    spacecraft
        Name.
    time
        ns since 1970.
    sigma
        Sigma of the time, s.
    """

    wall: int
    spacecraft: str
    time: int
    sigma: float


@dataclass(frozen=True)
class SurveyDecision:
    """A decision.

    Attributes
    ----------
    time
        ns since 1970.
    phase, reason
        As in vtff_msgs/SurveyGuidance.
    drift, drift_sigma
        Zonal, m/s.
    plans
        Changes of ellipse asked for by then.
    ellipse_size
        Size of the last ellipse, m.
    velocity_change
        Velocity change of all ellipses together, by impulses, m/s.
    walls
        Walls known by then.
    predictions
        Crossings to come, in order of time.
    """

    time: int
    phase: str
    reason: str
    drift: float
    drift_sigma: float
    plans: int
    ellipse_size: float
    velocity_change: float
    walls: tuple[SurveyWall, ...] = ()
    predictions: tuple[SurveyPrediction, ...] = ()


@dataclass
class SurveyHistory:
    """A survey; the crossings are those of the last decision.

    Attributes
    ----------
    decisions
        In order of time.
    crossings
        In order of time.
    unsupported
        Crossings left out as false.
    """

    decisions: list[SurveyDecision] = field(default_factory=list)
    crossings: list[SurveyCrossing] = field(default_factory=list)
    unsupported: int = 0

    @property
    def plans(self) -> list[SurveyDecision]:
        """Decisions that asked for a change of ellipse."""
        found, count = [], 0
        for decision in self.decisions:
            if decision.plans > count:
                found.append(decision)
            count = decision.plans
        return found


class SurveyCollector:
    """Takes the messages of the survey."""

    def __init__(self) -> None:
        self.history: SurveyHistory | None = None

    def add(self, message: Any) -> None:
        """Take a vtff_msgs/SurveyGuidance."""
        if self.history is None:
            self.history = SurveyHistory()
        history = self.history
        time = to_nanoseconds(message.header.stamp)
        history.decisions.append(
            SurveyDecision(
                time,
                message.phase,
                message.reason,
                message.drift,
                message.drift_sigma,
                message.plans,
                message.ellipse_size,
                message.velocity_change,
                _walls(message),
                _predictions(message, time),
            )
        )
        columns = zip(
            message.crossing_time,
            message.crossing_spacecraft,
            message.crossing_entry,
            message.crossing_longitude_deg,
            message.crossing_latitude_deg,
            message.crossing_altitude,
            message.crossing_sigma,
            strict=True,
        )
        history.crossings = sorted(
            (
                SurveyCrossing(time - round(before * NANOSECONDS_PER_SECOND), *values)
                for before, *values in columns
            ),
            key=lambda crossing: crossing.time,
        )
        history.unsupported = message.unsupported_crossings


def _walls(message: Any) -> tuple[SurveyWall, ...]:
    columns = zip(
        message.wall_entry,
        message.wall_passes,
        message.wall_longitude_deg,
        message.wall_drift,
        message.wall_drift_sigma,
        strict=True,
    )
    return tuple(SurveyWall(*values) for values in columns)


def _predictions(message: Any, time: int) -> tuple[SurveyPrediction, ...]:
    columns = zip(
        message.next_wall,
        message.next_spacecraft,
        message.next_time,
        message.next_sigma,
        strict=True,
    )
    return tuple(
        SurveyPrediction(wall, spacecraft, time + round(after * NANOSECONDS_PER_SECOND), sigma)
        for wall, spacecraft, after, sigma in columns
    )

"""What survey_guidance has learnt and decided in a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_node.stamps import to_nanoseconds

__all__ = ["SURVEY_TOPIC", "SurveyCollector", "SurveyCrossing", "SurveyDecision", "SurveyHistory"]

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
    """

    time: int
    phase: str
    reason: str
    drift: float
    drift_sigma: float
    plans: int
    ellipse_size: float
    velocity_change: float


@dataclass
class SurveyHistory:
    """A survey; walls and crossings are those of the last decision.

    Attributes
    ----------
    decisions
        In order of time.
    crossings
        In order of time.
    wall_longitude_deg, wall_drift, wall_time
        Longitude (deg) and speed (m/s) of each wall, and the time (ns since 1970) of the longitude.
    unsupported
        Crossings left out as false.
    """

    decisions: list[SurveyDecision] = field(default_factory=list)
    crossings: list[SurveyCrossing] = field(default_factory=list)
    wall_longitude_deg: list[float] = field(default_factory=list)
    wall_drift: list[float] = field(default_factory=list)
    wall_passes: list[int] = field(default_factory=list)
    wall_time: int = 0
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
        history.wall_longitude_deg = list(message.wall_longitude_deg)
        history.wall_drift = list(message.wall_drift)
        history.wall_passes = list(message.wall_passes)
        history.wall_time = time
        history.unsupported = message.unsupported_crossings

"""Guidance of a survey: learns where walls of plasma are and chooses orbits to sample them.

Each step takes the states of the formation and what its instruments have told since; the answer is
at most one request to `formation_guidance`. The formation flies free ellipses: it thrusts only to
change from one to another, when the samples gained are worth it, and drifts safely in between.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vtff_control.guidance.interface import FormationState, describe_field
from vtff_control.guidance.requests import ModeRequest, ReconfigurationRequest, Request
from vtff_control.survey.crossings import CrossingFinder, RayEdge, WallCrossing
from vtff_control.survey.goals import SurveyGoal
from vtff_control.survey.prediction import (
    PredictedCrossing,
    fly_ground_track,
    predict_crossings,
)
from vtff_control.survey.relative_orbits import (
    EllipseLimits,
    Transfer,
    cheapest_transfer,
    choose_ellipse,
    information,
    is_safe,
)
from vtff_control.survey.walls import LocatedCrossing, WallEstimate, estimate_walls
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements
from vtff_dynamics.relative.relative_elements import mean_relative_elements
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["SurveyGuidance", "SurveyParameters", "SurveyPlan", "SurveyResult"]

_TRANSFER_ORBITS = (0.6, 0.75, 0.9, 1.05)
"""Durations that a change of ellipse may have, orbits."""
_LARGEST_GAP = 60.0
"""Time between positions, s, over which the chord is the orbit to 20 m."""
_ORBIT_SPEED = 7.2e3
"""Speed over the plasma, m/s: turns the sigma of a time into that of a place."""


@dataclass(frozen=True)
class SurveyParameters:
    """Parameters of `SurveyGuidance`."""

    decision_interval: float = describe_field(60.0, "time between decisions", "s", 1.0)
    settling_time: float = describe_field(
        450.0, "after the last crossing of a pass, before its walls are judged", "s"
    )
    horizon_orbits: float = describe_field(
        3.5, "how far ahead crossings are counted, orbits", "", 0.5
    )
    worth: float = describe_field(
        0.5, "velocity change that one crossing sampled as asked is worth", "m/s", 1e-6
    )
    velocity_change_rate: float = describe_field(
        0.1, "largest mean velocity change after the first ellipse is reached, for an hour", "m/s"
    )
    least_probability: float = describe_field(
        0.8, "of the history of crossings, below which nothing is planned on it"
    )
    navigation_sigma: float = describe_field(
        5.0, "relative position sigma above which navigation is degraded", "m"
    )
    navigation_patience: float = describe_field(
        60.0, "time of degraded navigation after which the formation drifts", "s"
    )
    largest_size: float = describe_field(
        EllipseLimits.largest_size, "largest radial amplitude of a deputy", "m"
    )
    separation: float = describe_field(
        EllipseLimits.separation, "least distance of any pair across the track", "m"
    )
    along_track: float = describe_field(
        EllipseLimits.along_track, "mean distance of each deputy behind the one before", "m"
    )
    passive_safety_orbits: float = describe_field(
        2.0, "orbits of drift in which a loss of thrust in a change of ellipse is safe"
    )
    refusal_patience: float = describe_field(
        600.0, "time after a refusal in which nothing is asked for", "s"
    )


@dataclass(frozen=True)
class SurveyPlan:
    """A change of ellipse and its reason.

    Attributes
    ----------
    time
        When it was asked for, s.
    formation
        Name of the ellipse.
    size, phase
        Radial amplitude (m) and argument of latitude at which the deputies are lowest (rad).
    gain, gain_before
        Crossings expected to be sampled as asked, with it and with the ellipse before.
    velocity_change
        Velocity change of the farthest deputy by impulses, m/s.
    reason
        One line.
    """

    time: float
    formation: str
    size: float
    phase: float
    gain: float
    gain_before: float
    velocity_change: float
    reason: str


@dataclass(frozen=True, eq=False)
class SurveyResult:
    """Outcome of one step.

    Attributes
    ----------
    request
        What to ask of `formation_guidance`; None for nothing.
    phase
        ``default`` (safe ellipse, nothing planned), ``transfer``, ``survey`` or ``degraded``.
    reason
        Why, one line.
    """

    request: Request | None
    phase: str
    reason: str


class SurveyGuidance:
    """Memory, prediction and decisions of one survey.

    Parameters
    ----------
    chief, deputies
        Names of the spacecraft.
    parameters
        Parameters.

    Attributes
    ----------
    goal
        What is sampled; None without a survey.
    estimate
        Walls so far.
    crossings
        All crossings that were told, supported or not.
    predictions
        Crossings to come at the last decision.
    plans
        Changes of ellipse asked for.
    """

    def __init__(
        self, chief: str, deputies: tuple[str, ...], parameters: SurveyParameters | None = None
    ) -> None:
        self._chief, self._deputies = chief, tuple(deputies)
        self._parameters = parameters or SurveyParameters()
        self.goal: SurveyGoal | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what was: time has jumped back."""
        self._finder = CrossingFinder()
        self._first: int | None = None
        self._positions: deque[tuple[float, dict[str, FloatArray]]] = deque(maxlen=240)
        self.estimate: WallEstimate = estimate_walls([])
        self.crossings: list[WallCrossing] = []
        self._located: list[LocatedCrossing] = []
        self.predictions: list[PredictedCrossing] = []
        self.plans: list[SurveyPlan] = []
        self._decided = -math.inf
        self._judged = 0
        self._good = -math.inf
        self._arrived = math.nan
        self._spent = 0.0
        self._phase, self._reason = "default", "no walls yet"
        self._drifts = True
        self._refused = -math.inf

    @property
    def phase(self) -> str:
        """Phase, as in `SurveyResult`."""
        return self._phase

    @property
    def reason(self) -> str:
        """Reason of the last decision, one line."""
        return self._reason

    @property
    def arrived(self) -> float:
        """When the first ellipse was reached, s; not a number before that."""
        return self._arrived

    @property
    def spent(self) -> float:
        """Velocity change asked for after the first ellipse was reached, m/s."""
        return self._spent

    def seconds(self, stamp: int) -> float:
        """Return a stamp in s after the first states; nan before them."""
        return math.nan if self._first is None else 1e-9 * (stamp - self._first)

    # ---- what is told ------------------------------------------------------------------------

    def add_edge(
        self, stamp: int, sigma: float, spacecraft: str, ray: tuple[int, int], is_entry: bool
    ) -> None:
        """Take an edge of a ray; the stamp in ns, the sigma in s."""
        if self._first is not None:
            edge = RayEdge(self.seconds(stamp), sigma, spacecraft, ray, is_entry)
            self._finder.add_edge(edge)

    def add_scintillation(
        self,
        stamp: int,
        window: float,
        spacecraft: str,
        azimuths: Mapping[tuple[int, int], float],
        s4: Mapping[tuple[int, int], float],
    ) -> None:
        """Take the scintillation of all rays of a spacecraft in a window that ends at a stamp.

        Parameters
        ----------
        stamp
            ns.
        window
            Length of the window, s.
        spacecraft, azimuths, s4
            As for `CrossingFinder.add_scintillation`.
        """
        if self._first is not None:
            end = self.seconds(stamp)
            self._finder.add_scintillation(end - window, end, spacecraft, azimuths, s4)

    def refused(self, reason: str) -> None:
        """Note that `formation_guidance` has refused the last request."""
        if self.plans and self._phase == "transfer":
            self.plans.pop()
            self._phase = "survey" if math.isfinite(self._arrived) else "default"
        self._reason = f"refused: {reason}"
        self._drifts = True
        self._refused = self._decided

    # ---- steps -------------------------------------------------------------------------------

    def step(self, stamp: int, state: FormationState | None, mode: str) -> SurveyResult:
        """Return what to ask of `formation_guidance` now.

        Parameters
        ----------
        stamp
            Time of the step, ns.
        state
            The formation; None without navigation.
        mode
            Mode of `formation_guidance` in this step.
        """
        if self._first is None:
            self._first = stamp
        time = self.seconds(stamp)
        request = self._navigation_request(time, state, mode)
        if request is None and self._phase != "degraded" and state is not None:
            self._note_positions(time, state)
            self._learn(time)
            request = self._arrival_request(time, mode)
            if request is None and time - self._decided >= self._parameters.decision_interval:
                self._decided = time
                self._predict(time, state)
                request = self._decide(time, state, mode)
        return SurveyResult(request, self._phase, self._reason)

    def _navigation_request(
        self, time: float, state: FormationState | None, mode: str
    ) -> Request | None:
        """Fall back to free drift without navigation, and come back from it."""
        given = self._parameters
        limit = given.navigation_sigma**2
        good = state is not None and all(
            float(np.diag(covariance)[:3].max()) <= limit
            for covariance in state.covariances.values()
        )
        if good:
            self._good = time
            if self._phase == "degraded":
                self._phase = "survey" if math.isfinite(self._arrived) else "default"
                self._reason = "navigation is back"
                # A plan that ran is not taken up where it would be by now.
                if mode != "free_drift":
                    return ModeRequest("free_drift")
            return None
        if self._good == -math.inf:
            self._good = time
        if time - self._good >= given.navigation_patience and self._phase != "degraded":
            self._phase = "degraded"
            self._reason = "navigation is degraded: free drift on a safe ellipse"
            if mode != "free_drift":
                return ModeRequest("free_drift")
        return None

    def _note_positions(self, time: float, state: FormationState) -> None:
        rotation = rotation_gcrf_to_itrf(GpsTime.from_unix_nanoseconds(state.stamp))
        positions = {name: rotation @ gcrf[:3] for name, gcrf in self._states_gcrf(state).items()}
        self._positions.append((time, positions))

    def _states_gcrf(self, state: FormationState) -> dict[str, FloatArray]:
        chief = state.state_chief_gcrf
        return {
            self._chief: chief,
            **{n: deputy_state_gcrf(chief, state.relative_states[n]) for n in self._deputies},
        }

    def _learn(self, time: float) -> None:
        for crossing in self._finder.take(time):
            self.crossings.append(crossing)
            if crossing.is_supported:
                located = self._locate(crossing)
                if located is not None:
                    self._located.append(located)
        if len(self._located) == self._judged:
            return
        if time - max(c.time for c in self._located) >= self._parameters.settling_time:
            self._judged = len(self._located)
            self.estimate = estimate_walls(self._located)
            # They are of the walls before, whose numbers may differ.
            self.predictions = []

    def _locate(self, crossing: WallCrossing) -> LocatedCrossing | None:
        times = [time for time, _ in self._positions]
        after = bisect.bisect_left(times, crossing.time)
        if not 0 < after < len(times) or times[after] - times[after - 1] > _LARGEST_GAP:
            return None
        part = (crossing.time - times[after - 1]) / (times[after] - times[after - 1])
        ends = [self._positions[index][1][crossing.spacecraft] for index in (after - 1, after)]
        position = (1.0 - part) * ends[0] + part * ends[1]
        # Between two samples a chord; their radius is that of the arc.
        radius = (1.0 - part) * np.linalg.norm(ends[0]) + part * np.linalg.norm(ends[1])
        latitude, longitude, altitude = geodetic_from_itrf(
            position * float(radius / np.linalg.norm(position))
        ).tolist()
        return LocatedCrossing(
            crossing.time,
            crossing.spacecraft,
            crossing.is_entry,
            longitude,
            latitude,
            altitude,
            _ORBIT_SPEED * crossing.time_sigma,
        )

    def _arrival_request(self, time: float, mode: str) -> Request | None:
        """Let the formation drift when a change of ellipse has ended."""
        if self._phase == "transfer" and mode != "reconfigure":
            if not math.isfinite(self._arrived):
                self._arrived = time
            else:
                self._spent += self.plans[-1].velocity_change
            self._phase = "survey"
            self._reason = f"on {self.plans[-1].formation}"
            self._drifts = False
        if not self._drifts and mode in ("keep", "hold"):
            self._drifts = True
            return ModeRequest("free_drift")
        return None

    def _predict(self, time: float, state: FormationState) -> None:
        """Predict the crossings of walls that two passes or two spacecraft have told."""
        confirmed = {
            number: wall
            for number, wall in enumerate(self.estimate.walls)
            if wall.passes >= 2 or len(wall.spacecraft) >= 2
        }
        self.predictions = []
        if confirmed:
            moment = GpsTime.from_unix_nanoseconds(state.stamp)
            horizon = self._parameters.horizon_orbits * _period(state)
            track = fly_ground_track(self._states_gcrf(state), moment, time, horizon)
            self.predictions = predict_crossings(track, confirmed)

    def _decide(self, time: float, state: FormationState, mode: str) -> Request | None:
        given, goal = self._parameters, self.goal
        if self._phase == "transfer" or mode == "reconfigure":
            return None
        if time - self._refused < given.refusal_patience:
            return None
        if goal is None or goal.kind == "default":
            self._reason = "no goal: safe ellipse kept"
            return None
        if not self.predictions:
            told = sum(not crossing.is_supported for crossing in self.crossings)
            doubt = f", {told} unsupported crossings left out" if told else ""
            self._reason = f"no walls confirmed: safe ellipse kept{doubt}"
            return None
        if self.estimate.probability < given.least_probability:
            self._reason = (
                f"walls of the passes are ambiguous ({self.estimate.probability:.2f}): "
                "safe ellipse kept"
            )
            return None
        return self._change(time, state, _period(state))

    def _change(self, time: float, state: FormationState, period: float) -> Request | None:
        """Ask for the ellipse that is worth most, if it is worth its velocity change."""
        given, goal, estimate = self._parameters, self.goal, self.estimate
        assert goal is not None
        ahead = [c for c in self.predictions if c.spacecraft == self._chief]
        farthest = self._deputies[-1]
        current = mean_relative_elements(state.state_chief_gcrf, state.relative_states[farthest])
        before = information(ahead, goal, current, estimate.probability)
        budget = math.inf
        if math.isfinite(self._arrived):
            hours = (time - self._arrived) / 3600.0
            budget = given.velocity_change_rate * hours - self._spent
        best: tuple[float, Transfer, float] | None = None
        for orbits in _TRANSFER_ORBITS:
            # What comes before the arrival is sampled on the way, as asked or not: not counted.
            later = [c for c in ahead if c.time >= time + orbits * period]
            transfer = self._transfer(state, later, current, orbits, budget)
            if transfer is None or transfer.velocity_change > budget:
                continue
            gain = information(
                later,
                goal,
                transfer.ellipse.designs(len(self._deputies))[-1],
                estimate.probability,
            )
            value = (gain - before) * given.worth - transfer.velocity_change
            if best is None or value > best[0]:
                best = value, transfer, gain
        if best is None:
            self._reason = "no ellipse within the velocity change allowed so far"
            return None
        if best[0] <= 0.0:
            self._reason = (
                "no other ellipse is worth its velocity change: "
                f"{before:.0f} crossings to come as asked"
            )
            return None
        if not is_safe(best[1].ellipse.designs(len(self._deputies)), given.separation):
            self._reason = "no safe ellipse"
            return None
        return self._ask(
            time, best[1], round(best[1].orbits * period / 60.0) * 60.0, best[2], before
        )

    def _transfer(
        self,
        state: FormationState,
        later: list[PredictedCrossing],
        current: FloatArray,
        orbits: float,
        budget: float,
    ) -> Transfer | None:
        """Return the best ellipse for crossings after a transfer, and the transfer to it."""
        given = self._parameters
        assert self.goal is not None
        chief_mean = mean_elements(elements_from_state(state.state_chief_gcrf))
        mean_motion = math.sqrt(GM_EARTH / float(chief_mean[0]) ** 3)
        deputies = len(self._deputies)
        limits = EllipseLimits(given.largest_size, given.separation, given.along_track, deputies)
        ellipse = choose_ellipse(
            later,
            self.goal,
            current,
            limits,
            mean_motion,
            given.worth,
            self.estimate.probability,
            budget,
        )
        if ellipse is None:
            return None
        return cheapest_transfer(ellipse, current, chief_mean, mean_motion, orbits, deputies)

    def _ask(
        self, time: float, transfer: Transfer, duration: float, gain: float, before: float
    ) -> Request:
        name = f"survey_{len(self.plans) + 1}"
        ellipse, change = transfer.ellipse, transfer.velocity_change
        self._reason = (
            f"{name}: {ellipse.size / 1e3:.1f} km, lowest at {math.degrees(ellipse.phase):.0f} "
            f"deg, for {gain:.0f} crossings instead of {before:.0f}, {change:.2f} m/s"
        )
        self._phase = "transfer"
        self.plans.append(
            SurveyPlan(time, name, ellipse.size, ellipse.phase, gain, before, change, self._reason)
        )
        designs = ellipse.designs(len(self._deputies))
        return ReconfigurationRequest(
            name,
            duration,
            closest_approach=0.5 * self._parameters.separation,
            passive_safety_orbits=self._parameters.passive_safety_orbits,
            designs={
                self._chief: np.zeros(6),
                **dict(zip(self._deputies, designs, strict=True)),
            },
        )


def _period(state: FormationState) -> float:
    """Return the period of the chief's mean orbit, s."""
    axis = float(mean_elements(elements_from_state(state.state_chief_gcrf))[0])
    return 2.0 * math.pi * math.sqrt(axis**3 / GM_EARTH)

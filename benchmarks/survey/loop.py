"""Closed loop of a survey without ROS: truth, drawn navigation, guidance, emulated ray edges."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np

from survey.night import Night
from vtff_control.guidance.formation_guidance import (
    FormationGuidance,
    FormationGuidanceParameters,
)
from vtff_control.guidance.interface import FormationState, GuidanceSetting
from vtff_control.guidance.keeping import KeepingEngine
from vtff_control.guidance.requests import ModeRequest, RequestError
from vtff_control.survey.goals import SurveyGoal
from vtff_control.survey.prediction import PredictedCrossing
from vtff_control.survey.relative_orbits import RelativeEllipse
from vtff_control.survey.survey_guidance import SurveyGuidance, SurveyParameters
from vtff_control.survey.walls import Wall
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.atmosphere.ray_edge_emulation import RayEdgeEmulation
from vtff_sim_bridge.atmosphere.walls import WallTruth, find_wall_truth
from vtff_sim_bridge.truth.formation_truth import FormationTruth

STEP = 10.0
DEFAULT_ELLIPSE = RelativeEllipse(300.0, 210.0, 0.0, 2000.0)
ENGINE = KeepingEngine(largest=1.0, smallest=1e-3, step=1e-4)
MASS = 100.0


@dataclass(frozen=True)
class FalseEdge:
    """An edge that rays of both spacecraft tell and that is not there.

    Attributes
    ----------
    time
        s.
    is_entry
        Kind.
    rays
        How many rays tell it, of those on the side that counts.
    """

    time: float
    is_entry: bool
    rays: int


@dataclass
class Case:
    """What is varied.

    Attributes
    ----------
    has_bubbles
        Whether the bubbles of the night are there.
    false_edges
        In order of time.
    interference
        Start and end (s) of times in which all rays of both spacecraft scintillate at once.
    outage
        Start and end (s) of lost contact: neither states nor ionosphere.
    goal
        What is asked.
    position_sigma, velocity_sigma
        Of drawn relative navigation, m and m/s.
    """

    has_bubbles: bool = True
    false_edges: tuple[FalseEdge, ...] = ()
    interference: tuple[tuple[float, float], ...] = ()
    outage: tuple[float, float] | None = None
    goal: SurveyGoal = field(default_factory=SurveyGoal)
    position_sigma: float = 2e-3
    velocity_sigma: float = 2e-5
    parameters: SurveyParameters = field(default_factory=SurveyParameters)


@dataclass(frozen=True)
class Prediction:
    """Crossings of walls predicted at a time (s) after a number of passes."""

    time: float
    passes: int
    walls: list[Wall]
    crossings: list[PredictedCrossing]


class _Track:
    """True positions of the spacecraft over the turning Earth."""

    def __init__(self, night: Night, names: tuple[str, ...]) -> None:
        self._night, self._names = night, names
        self._times: list[float] = []
        self._positions_itrf: list[list[FloatArray]] = []

    def look(self, time: float, positions_gcrf: list[FloatArray]) -> None:
        """Take the positions (m) at a time (s)."""
        rotation = rotation_gcrf_to_itrf(self._night.start + time)
        self._times.append(time)
        self._positions_itrf.append([rotation @ position for position in positions_gcrf])

    def truth(self) -> WallTruth:
        """Return what was crossed."""
        positions = np.array(self._positions_itrf)
        tracks = {
            name: (self._times, positions[:, index]) for index, name in enumerate(self._names)
        }
        return find_wall_truth(self._night.regions, self._night.start, tracks)


@dataclass(eq=False)
class Flown:
    """What was flown.

    Attributes
    ----------
    guidance
        With memory and plans.
    truth
        Bubbles and true crossings.
    velocity_change
        Commanded at each step, all spacecraft, m/s.
    closest, closest_drift
        Smallest distance flown, and in a free drift of two orbits from any time, m.
    predictions
        First ones after each pass.
    drifts
        Time (s), drift and its sigma (m/s) after each pass.
    log
        What was decided, one line a change.
    """

    guidance: SurveyGuidance
    truth: WallTruth
    velocity_change: FloatArray
    closest: float
    closest_drift: float
    predictions: list[Prediction]
    drifts: list[tuple[float, float, float]]
    log: list[str]


def fly(night: Night, case: Case | None = None, duration: float | None = None) -> Flown:
    """Return what a survey of a night does."""
    case = case or Case()
    names = ("chief", "deputy")
    chief = night.state_chief_gcrf()
    start_relative = relative_state_of_mean_elements(
        night.chief_mean, DEFAULT_ELLIPSE.designs(1)[0]
    )
    truth = FormationTruth(
        night.start,
        [("chief", chief), ("deputy", deputy_state_gcrf(chief, start_relative))],
        ForceModel(drag="harris_priester"),
        step=STEP,
    )
    regions = night.regions if case.has_bubbles else ()
    emulation = RayEdgeEmulation(regions, night.start, names, night.seed)
    setting = GuidanceSetting("chief", ("deputy",), STEP, engine=ENGINE, mass=MASS)
    formation = FormationGuidance(
        setting, FormationGuidanceParameters(closest_approach=100.0, tracking_bandwidth=1e-3)
    )
    guidance = SurveyGuidance("chief", ("deputy",), case.parameters)
    guidance.goal = case.goal
    random = np.random.default_rng(np.random.SeedSequence((night.seed, 7)))
    sigma = np.repeat([case.position_sigma, case.velocity_sigma], 3)
    track = _Track(dataclasses.replace(night, regions=regions), names)
    pending = np.zeros((2, 3))
    changes, log, drifts = [], [], []
    predictions: list[Prediction] = []
    everywhere = [
        FalseEdge(moment, moment == begin, len(emulation.azimuths))
        for begin, end in case.interference
        for moment in (begin, end)
    ]
    false_edges = sorted((*case.false_edges, *everywhere), key=lambda edge: edge.time)
    closest, closest_drift, last_reason = math.inf, math.inf, ""
    passes, predicted = 0, 0
    begun = False
    epoch = night.start.to_unix_nanoseconds()
    for index in range(int((duration or night.duration) / STEP)):
        time = index * STEP
        states = {name: truth.state_gcrf(name) for name in names}
        track.look(time, [state[:3] for state in states.values()])
        relative = relative_state_rtn(states["chief"], states["deputy"])
        closest = min(closest, float(np.linalg.norm(relative[:3])))
        if index % 6 == 0:
            closest_drift = min(closest_drift, _drift_distance(states))
        stamp = epoch + round(time * 1e9)
        lost = case.outage is not None and case.outage[0] <= time < case.outage[1]
        edges, windows = emulation.advance(time, states)
        if not lost:
            for edge in edges:
                guidance.add_edge(
                    epoch + round(edge.time * 1e9),
                    1.0,
                    edge.spacecraft,
                    (0, edge.ray),
                    edge.is_entry,
                )
            for window in windows:
                begin = window.time - emulation.settings.window
                disturbed = any(b < window.time and begin < e for b, e in case.interference)
                s4 = np.maximum(window.s4, 0.6 if disturbed else 0.0)
                rays = [(0, ray) for ray in range(len(window.s4))]
                guidance.add_scintillation(
                    epoch + round(window.time * 1e9),
                    emulation.settings.window,
                    window.spacecraft,
                    dict(zip(rays, emulation.azimuths.tolist(), strict=True)),
                    dict(zip(rays, s4.tolist(), strict=True)),
                )
            while false_edges and false_edges[0].time <= time:
                _tell(guidance, epoch, names, emulation.azimuths, false_edges.pop(0))
        wanted = np.zeros((2, 3))
        mode = "free_drift"
        state = None
        if not lost:
            measured = relative + sigma * random.standard_normal(6)
            absolute = states["chief"] + np.repeat([0.5, 1e-3], 3) * random.standard_normal(6)
            state = FormationState(
                stamp, absolute, {"deputy": measured}, {"deputy": np.diag(sigma**2)}
            )
            result = formation.step(state)
            if not begun:
                formation.request(ModeRequest("free_drift"))
                begun = True
            mode = result.mode
            wanted = np.array([result.targets[name].acceleration_rtn for name in names])
        answer = guidance.step(stamp, state, mode)
        if answer.request is not None and not lost:
            try:
                formation.request(answer.request)
            except RequestError as error:
                guidance.refused(str(error))
                log.append(f"{time:.0f} refused: {error}")
        text = f"{answer.phase}: {answer.reason}"
        if text != last_reason:
            log.append(f"{time:.0f} {text}")
            last_reason = text
        if guidance.estimate.passes > passes:
            passes = guidance.estimate.passes
            drifts.append((time, guidance.estimate.drift, guidance.estimate.drift_sigma))
        if passes > predicted and guidance.predictions:
            predicted = passes
            predictions.append(
                Prediction(time, passes, guidance.estimate.walls, guidance.predictions)
            )
        changes.append(float(np.linalg.norm(pending, axis=1).sum()) * STEP)
        truth.advance({name: pending[i] for i, name in enumerate(names)})
        pending = wanted
    return Flown(
        guidance,
        track.truth(),
        np.array(changes),
        closest,
        closest_drift,
        predictions,
        drifts,
        log,
    )


def _tell(
    guidance: SurveyGuidance,
    epoch: int,
    names: tuple[str, ...],
    azimuths: FloatArray,
    edge: FalseEdge,
) -> None:
    """Tell an edge by rays on the side that counts: behind an entry, ahead of an exit."""
    is_ahead = np.sin(azimuths) >= 0.0
    rays = np.flatnonzero(is_ahead != edge.is_entry)[: edge.rays].tolist()
    for name in names:
        for ray in rays:
            guidance.add_edge(epoch + round(edge.time * 1e9), 0.5, name, (0, ray), edge.is_entry)


def _drift_distance(states: dict[str, FloatArray]) -> float:
    """Return the smallest distance in two orbits without thrust, m."""
    flown = free_flight(np.array(list(states.values())), np.arange(0.0, 11200.0, 20.0))
    return closest_on_path(flown[:, 1, :3] - flown[:, 0, :3])


def fly_fixed(night: Night) -> WallTruth:
    """Return what the fixed formation crosses: the deputy held 1 km below and 15 km behind."""
    chief = night.state_chief_gcrf()
    truth = FormationTruth(
        night.start, [("chief", chief)], ForceModel(drag="harris_priester"), step=STEP
    )
    held = np.array([-1000.0, -15000.0, 0.0, 0.0, 0.0, 0.0])
    track = _Track(night, ("chief", "deputy"))
    for index in range(int(night.duration / STEP)):
        state = truth.state_gcrf("chief")
        track.look(index * STEP, [state[:3], deputy_state_gcrf(state, held)[:3]])
        truth.advance({})
    return track.truth()

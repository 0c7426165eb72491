"""Guidance of a formation by modes: hold, keep, reconfigure, phase, free drift, abort.

All spacecraft thrust, the chief too. What counts is how they stand to each other: their designs are
relative to a virtual orbit without thrust, and that orbit is the one from which they deviate least
(the mean of their deviations is zero). So no absolute navigation takes part, and nobody spends
thrust on where the whole formation is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from vtff_control.guidance.elements_estimator import ElementsEstimator
from vtff_control.guidance.free_drift import closest_during_steps, closest_of_paths, fly_drifts
from vtff_control.guidance.interface import (
    FormationState,
    GuidanceResult,
    GuidanceSetting,
    SpacecraftTarget,
    describe_field,
)
from vtff_control.guidance.keeping import FormationKeeper, drift_is_known
from vtff_control.guidance.phasing import InfeasiblePhasingError, Phasing, phase
from vtff_control.guidance.plan_flight import PlanFlight
from vtff_control.guidance.reconfiguration import ReconfigurationPlanner
from vtff_control.guidance.reconfiguration_plan import (
    InfeasibleReconfigurationError,
    ReconfigurationLimits,
)
from vtff_control.guidance.requests import (
    ModeRequest,
    ReconfigurationRequest,
    Request,
    RequestError,
)
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import (
    elements_from_state,
    mean_elements,
    osculating_elements,
    state_from_elements,
)
from vtff_dynamics.relative.linearised import LinearisedMotion, linearise_motion
from vtff_dynamics.relative.relative_elements import (
    elements_of_deputy,
    mean_relative_elements,
    relative_state_of_mean_elements,
)
from vtff_dynamics.vectors import FloatArray

__all__ = ["FormationGuidance", "FormationGuidanceParameters", "Reconfiguration"]

_SAFE_PLANS = 4
"""Plans at most, each with a larger distance after drifts in nonlinear motion fell short."""
_REHEARSAL = 10.0
"""Interval of constant thrust in a rehearsal of a plan, at least, s."""
_RAISE = 1.2
"""How many times the shortfall of the drifts is added to the distance."""


@dataclass(frozen=True)
class FormationGuidanceParameters:
    """Parameters of `FormationGuidance`."""

    formation: str = field(
        default="", metadata={"description": "formation in which the flight begins; empty: none"}
    )
    closest_approach: float = describe_field(
        10.0, "smallest distance of any pair in a reconfiguration", "m", 0.0
    )
    tracking_margin: float = describe_field(
        0.2, "added to it in plans, for deviations from them", "m", 0.0
    )
    plan_share: float = describe_field(
        0.95, "share of the largest thrust that plans use; the rest corrects deviations", "", 0.01
    )
    plan_step: float = describe_field(
        60.0, "length for which the thrust of a plan is constant", "s", 1.0
    )
    largest_steps: int = field(
        default=240,
        metadata={"description": "most steps of a plan; more are refused", "minimum": 1},
    )
    lead_time: float = describe_field(
        60.0, "time between a request and the start of its plan", "s", 0.0
    )
    tracking_bandwidth: float = describe_field(
        5e-3, "natural frequency of the return to a plan", "rad/s", 1e-6
    )
    update_interval: float = describe_field(
        60.0, "time between states that the filters of relative elements take", "s", 1.0
    )


@dataclass
class Reconfiguration:
    """A reconfiguration, as who asked for it follows it.

    Attributes
    ----------
    request
        Request that began it.
    flight
        The plan under way.
    velocity_changes
        Velocity change commanded to each spacecraft, m/s.
    finished, success, message
        Whether and how it ended.
    """

    request: ReconfigurationRequest
    flight: PlanFlight
    velocity_changes: dict[str, float]
    finished: bool = False
    success: bool = False
    message: str = ""

    def end(self, success: bool, message: str = "") -> None:
        """Note the end."""
        self.finished, self.success, self.message = True, success, message


@dataclass(frozen=True)
class _PhasingFlight:
    start: float
    phasing: Phasing
    sign: float  # of the along-track thrust of the first leg

    @property
    def end(self) -> float:
        return self.start + 2.0 * self.phasing.thrust_time + self.phasing.coast_time

    def acceleration(self, time: float) -> float:
        leg = self.phasing.thrust_time
        if self.start <= time < self.start + leg:
            return self.sign * self.phasing.acceleration
        if self.end - leg <= time < self.end:
            return -self.sign * self.phasing.acceleration
        return 0.0


class FormationGuidance:
    """Targets and feedforward thrust of all spacecraft of a formation.

    Parameters
    ----------
    setting
        Spacecraft, engine and formations.
    parameters
        Values.

    Raises
    ------
    ValueError
        If there is no such formation.
    """

    Parameters = FormationGuidanceParameters

    def __init__(self, setting: GuidanceSetting, parameters: FormationGuidanceParameters) -> None:
        self._setting = setting
        self._parameters = parameters
        self._names = setting.spacecraft
        self._delay = setting.sample_time * setting.delay_steps
        self.reset()

    def reset(self) -> None:
        """Begin anew: keep the formation of the parameters, or hold where there is none."""
        self._first: int | None = None
        # Formations of requests that brought their own designs.
        self._asked_formations: dict[str, Mapping[str, FloatArray]] = {}
        self._updated = -math.inf
        self._estimators = {name: ElementsEstimator() for name in self._names}
        # Thrust that was commanded and has not been noted yet, (m, 3) each.
        self._commanded: deque[FloatArray] = deque()
        self._keepers: dict[str, FormationKeeper] = {}
        self._formation = self._parameters.formation
        self._designs: Mapping[str, FloatArray] | None = None
        if self._formation:
            self._designs = self._designs_of(self._formation)
        self._mode = "keep" if self._formation else "hold"
        self._reason = ""
        self._phasing: _PhasingFlight | None = None
        self.reconfiguration: Reconfiguration | None = None
        self._state: FormationState | None = None
        self._time = math.nan

    # ---- requests ----------------------------------------------------------------------------

    def check(self, request: Request) -> None:
        """Refuse a request that can never be met.

        Raises
        ------
        RequestError
            If it names a formation that there is not, or has not a design for every spacecraft.
        """
        if isinstance(request, ReconfigurationRequest) and request.designs is not None:
            if set(request.designs) != set(self._names):
                raise RequestError(f"designs: one for each of {', '.join(self._names)} expected")
        elif isinstance(request, ReconfigurationRequest) or request.mode == "keep":
            self._designs_of(request.formation)

    def request(self, request: Request) -> Reconfiguration | None:
        """Begin a mode or a reconfiguration; a reconfiguration is returned.

        Raises
        ------
        RequestError
            If it is refused; what was under way goes on.
        """
        try:
            self.check(request)
            if isinstance(request, ReconfigurationRequest):
                return self._begin_reconfiguration(request)
            self._begin_mode(request)
        except RequestError as error:
            self._reason = str(error)
            raise
        return None

    def _designs_of(self, formation: str) -> Mapping[str, FloatArray]:
        formations = {**self._setting.formations, **self._asked_formations}
        designs = formations.get(formation)
        if designs is None:
            names = ", ".join(formations) or "none"
            raise RequestError(f"no formation '{formation}'; there are: {names}")
        return designs

    def _begin_mode(self, request: ModeRequest) -> None:
        if request.mode in ("abort", "free_drift"):
            self._end_plan(f"ended by mode {request.mode}")
        elif self._running() is not None:
            raise RequestError(
                f"mode '{request.mode}' refused: {self._running_text()}; free_drift or abort end it"
            )
        if request.mode == "phase":
            self._begin_phasing(request)
        if request.mode in ("hold", "keep"):
            if self._state is None:
                raise RequestError(f"mode '{request.mode}' refused: no states yet")
            self._formation = request.formation
            self._begin_keeping()
        self._mode, self._reason = request.mode, ""

    def _begin_phasing(self, request: ModeRequest) -> None:
        if self._state is None:
            raise RequestError("mode 'phase' refused: no states yet")
        axis = float(mean_elements(elements_from_state(self._state.state_chief_gcrf))[0])
        acceleration = self._setting.engine.largest / self._setting.mass
        angle = math.radians(request.angle_deg)
        try:
            phasing = phase(axis, angle, request.orbits, acceleration)
        except InfeasiblePhasingError as error:
            raise RequestError(str(error)) from error
        self._phasing = _PhasingFlight(
            self._time + self._delay, phasing, -math.copysign(1.0, angle)
        )

    def _begin_keeping(self) -> None:
        """Make the keepers of the formation, or, without one, of the elements of the moment."""
        setting = self._setting
        designs: Mapping[str, FloatArray]
        if self._formation:
            designs = self._designs_of(self._formation)
        else:
            designs = {name: self._estimators[name].elements.copy() for name in self._names}
        self._designs = designs
        self._keepers = {
            name: FormationKeeper(
                designs[name],
                setting.engine,
                setting.mass,
                setting.sample_time,
                estimator=self._estimators[name],
            )
            for name in self._names
        }
        self._centre_keepers()

    def _centre_keepers(self) -> None:
        centre = self._centre({name: self._estimators[name].elements for name in self._names})
        for name, errors in zip(self._names, self._engine_errors(), strict=True):
            self._keepers[name].centre = centre
            self._keepers[name].engine_errors = errors

    def _running(self) -> Reconfiguration | None:
        running = self.reconfiguration
        return None if running is None or running.finished else running

    def _running_text(self) -> str:
        running = self._running()
        assert running is not None
        left = running.flight.end - self._time
        return f"a reconfiguration to '{running.request.formation}' runs for {left:.0f} s more"

    def _end_plan(self, message: str) -> None:
        running = self._running()
        if running is not None:
            running.end(False, message)
            self._formation, self._designs = "", None

    def _begin_reconfiguration(self, request: ReconfigurationRequest) -> Reconfiguration:
        if self._running() is not None and not request.preempt:
            raise RequestError(
                f"reconfiguration to '{request.formation}' refused: {self._running_text()}"
            )
        if self._state is None:
            raise RequestError(f"reconfiguration to '{request.formation}' refused: no states yet")
        flight = self._plan(self._state, request)
        if request.designs is not None:
            self._asked_formations[request.formation] = request.designs
        self._end_plan(f"preempted by a reconfiguration to '{request.formation}'")
        self._mode, self._reason = "reconfigure", flight.unsafe_losses_text()
        self.reconfiguration = Reconfiguration(request, flight, dict.fromkeys(self._names, 0.0))
        self._formation = request.formation
        return self.reconfiguration

    def _plan(self, state: FormationState, request: ReconfigurationRequest) -> PlanFlight:
        given, setting = self._parameters, self._setting
        start = self._time + max(given.lead_time, self._delay)
        count = math.floor((request.duration - (start - self._time)) / given.plan_step + 1e-6)
        if count < 1:
            raise RequestError(
                f"duration: {request.duration:g} s; the lead time and one step of a plan are "
                f"{start - self._time + given.plan_step:g} s"
            )
        if count > given.largest_steps:
            raise RequestError(
                f"duration: {request.duration:g} s; plans have at most {given.largest_steps} steps "
                f"of {given.plan_step:g} s (largest_steps, plan_step)"
            )
        craft = self._predict(state, start - self._time)
        reference = self._reference(start, craft)
        axis = float(mean_elements(elements_from_state(reference))[0])
        drift = request.passive_safety_orbits * 2.0 * math.pi * math.sqrt(axis**3 / GM_EARTH)
        if drift > given.largest_steps * given.plan_step:
            raise RequestError(
                f"passive_safety_orbits: {request.passive_safety_orbits:g}; a drift is followed "
                f"for at most {given.largest_steps} steps of {given.plan_step:g} s "
                "(largest_steps, plan_step)"
            )
        motion = linearise_motion(
            reference, given.plan_step, count + math.ceil(drift / given.plan_step)
        )
        at_end = mean_elements(elements_from_state(motion.states_reference_gcrf[count]))
        designs = request.designs or self._designs_of(request.formation)
        final = [relative_state_of_mean_elements(at_end, designs[name]) for name in self._names]
        cap = request.acceleration_cap or setting.engine.largest / setting.mass
        limits = ReconfigurationLimits(
            given.plan_share * cap,
            (request.closest_approach or given.closest_approach) + given.tracking_margin,
            request.axes,
            request.objective,
        )
        try:
            return self._plan_safely(motion, limits, count, craft, final, start, request.formation)
        except InfeasibleReconfigurationError as error:
            raise RequestError(
                f"reconfiguration to '{request.formation}' impossible: {error}"
            ) from error

    def _plan_safely(
        self,
        motion: LinearisedMotion,
        limits: ReconfigurationLimits,
        count: int,
        craft_gcrf: FloatArray,
        final: list[FloatArray],
        start: float,
        formation: str,
    ) -> PlanFlight:
        """Return a plan that keeps its distance after a loss of thrust in nonlinear motion, too."""
        given = self._parameters
        cap = limits.acceleration_cap / given.plan_share
        reference = motion.states_reference_gcrf[0]
        initial = [relative_state_rtn(reference, gcrf) for gcrf in craft_gcrf]
        wanted = limits.closest_approach - given.tracking_margin
        planner = ReconfigurationPlanner(motion, len(self._names), limits, count)
        plan, bends, reached = None, None, -math.inf
        for _ in range(_SAFE_PLANS):
            plan = planner.plan(initial, final, plan, bends)
            flight = PlanFlight(plan, start, formation, given.tracking_bandwidth)
            if plan.safe_step is None:
                return flight
            flown = flight.rehearse(craft_gcrf, cap, max(self._setting.sample_time, _REHEARSAL))
            paths = fly_drifts(flown, motion.states_reference_gcrf, motion.step)
            reached = float(closest_of_paths(paths)[plan.safe_step :].min())
            if reached >= wanted:
                during = closest_during_steps(paths)
                flight.unsafe_losses = [
                    (step, float(during[step]))
                    for step in range(plan.safe_step, count)
                    if during[step] < wanted
                ]
                return flight
            if bends is not None:
                shortfall = wanted - reached
                planner.keep_apart(planner.limits.closest_approach + _RAISE * shortfall)
            bends = planner.bends(plan, paths)
        raise InfeasibleReconfigurationError(
            f"passive_safety: {wanted:g} m wanted after a loss of thrust, {reached:.3f} m reached "
            "in nonlinear motion",
            "passive_safety",
            wanted,
            reached,
        )

    def _predict(self, state: FormationState, duration: float) -> FloatArray:
        """Return the states of all spacecraft in GCRF after a free flight, (m, 6)."""
        chief = state.state_chief_gcrf
        states = [
            chief,
            *(
                deputy_state_gcrf(chief, state.relative_states[name])
                for name in self._setting.deputies
            ),
        ]
        steps = max(1, math.ceil(duration / 10.0))
        flown: FloatArray = free_flight(states, np.linspace(0.0, duration, steps + 1))[-1]
        return flown

    def _reference(self, time: float, craft: FloatArray) -> FloatArray:
        """Return the state in GCRF of the orbit that the formation is about, m and m/s, (6,)."""
        chief = craft[0]
        relative = [relative_state_rtn(chief, gcrf) for gcrf in craft]
        running = self._running()
        if running is not None and time >= running.flight.start:
            planned = running.flight.planned_states(time)
            return deputy_state_gcrf(chief, np.mean(np.array(relative) - planned, axis=0))
        centre = self._centre(
            {
                name: mean_relative_elements(chief, state)
                for name, state in zip(self._names, relative, strict=True)
            }
        )
        chief_mean = mean_elements(elements_from_state(chief))
        return state_from_elements(osculating_elements(elements_of_deputy(chief_mean, centre)))

    def _centre(self, elements: Mapping[str, FloatArray]) -> FloatArray:
        """Return the relative elements of the orbit that the designs are relative to, m, (6,)."""
        designs = self._designs
        if designs is None:
            return _mean(elements.values())
        return _mean(elements[name] - designs[name] for name in self._names)

    # ---- steps -------------------------------------------------------------------------------

    def step(self, state: FormationState) -> GuidanceResult:
        """Return targets and thrust for the states of one time.

        Parameters
        ----------
        state
            The formation now.
        """
        if self._first is None:
            self._first = state.stamp
        self._time = 1e-9 * (state.stamp - self._first)
        self._state = state
        self._note_thrust()
        self._update_estimators(state)
        begins = self._time + self._delay
        relative = [np.zeros(6), *(state.relative_states[n] for n in self._setting.deputies)]
        running = self._running()
        if running is not None:
            targets, wanted = self._fly_plan(running, begins, relative)
        else:
            targets, wanted = self._fly_mode(begins)
        thrust = self._setting.engine.acceleration(wanted, self._setting.mass)
        self._commanded.append(thrust)
        if running is not None and not running.finished:
            sizes = np.linalg.norm(thrust, axis=1) * self._setting.sample_time
            for name, size in zip(self._names, sizes.tolist(), strict=True):
                running.velocity_changes[name] += size
        return self._result(targets, thrust)

    def _update_estimators(self, state: FormationState) -> None:
        if self._time - self._updated < self._parameters.update_interval:
            return
        self._updated = self._time
        for name in self._names:
            relative = state.relative_states.get(name, np.zeros(6))
            covariance = state.covariances.get(name)
            self._estimators[name].update(self._time, state.state_chief_gcrf, relative, covariance)
        if not self._keepers:
            self._begin_keeping()
        self._centre_keepers()

    def _note_thrust(self) -> None:
        """Tell the filters the thrust of the sample interval that ends now."""
        if len(self._commanded) <= self._setting.delay_steps:
            return
        duration = self._setting.sample_time
        thrust = self._commanded.popleft()
        elapsed = self._time - self._updated - 0.5 * duration
        for name, own in zip(self._names[1:], thrust[1:], strict=True):
            self._estimators[name].add_thrust(own, duration, elapsed, thrust[0])

    def _engine_errors(self) -> FloatArray:
        """Return the matrices by which true thrust exceeds the commanded one, (m, 3, 3)."""
        deputies = [self._estimators[name] for name in self._names[1:]]
        # Every deputy sees the engine of the chief.
        of_chief = np.mean([estimator.engine_errors_chief for estimator in deputies], axis=0)
        return np.array([of_chief, *(estimator.engine_errors for estimator in deputies)])

    def _fly_plan(
        self, running: Reconfiguration, begins: float, relative: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        flight = running.flight
        planned = flight.planned_states(self._time)
        if self._time >= flight.start:
            flight.watch(relative)
        if self._time >= flight.end:
            running.end(True)
            self._mode = "keep"
            self._begin_keeping()
        if begins < flight.start or begins >= flight.end:
            return planned - planned[0], np.zeros((len(self._names), 3))
        wanted = flight.planned_accelerations(begins)
        if self._time >= flight.start:
            wanted = wanted + flight.correction(self._time, relative)
        engines = np.eye(3) + self._engine_errors()
        commanded = np.linalg.solve(engines, wanted[:, :, np.newaxis])[:, :, 0]
        return planned - planned[0], np.asarray(commanded, dtype=float)

    def _fly_mode(self, begins: float) -> tuple[FloatArray, FloatArray]:
        wanted = np.zeros((len(self._names), 3))
        phasing = self._phasing
        if self._mode == "phase" and phasing is not None:
            wanted[:, 1] = phasing.acceleration(begins)
            if begins >= phasing.end:
                self._mode, self._phasing = "keep" if self._formation else "hold", None
        elif self._mode in ("hold", "keep"):
            may_begin = drift_is_known(self._keepers.values())
            for index, name in enumerate(self._names):
                wanted[index] = self._keepers[name].command(self._time, may_begin)
        return self._kept_states(), wanted

    def _kept_states(self) -> FloatArray:
        """Return the wanted states relative to the chief in the modes without a plan, (m, 6)."""
        assert self._state is not None
        chief_mean = mean_elements(elements_from_state(self._state.state_chief_gcrf))
        return np.array(
            [
                relative_state_of_mean_elements(chief_mean, keeper.design + keeper.centre)
                for keeper in (self._keepers[name] for name in self._names)
            ]
        )

    def _result(self, targets: FloatArray, thrust: FloatArray) -> GuidanceResult:
        running = self._running()
        ends = math.inf
        closest = math.nan
        left: dict[str, float] = {}
        if running is not None:
            ends = running.flight.end
            closest = running.flight.plan.closest_approach
            changes = running.flight.velocity_changes_left(self._time).tolist()
            left = dict(zip(self._names, changes, strict=True))
        elif self._phasing is not None and self._mode == "phase":
            ends = self._phasing.end
        return GuidanceResult(
            {
                name: SpacecraftTarget(target, acceleration)
                for name, target, acceleration in zip(self._names, targets, thrust, strict=True)
            },
            self._mode,
            self._formation,
            self._reason,
            ends - self._time,
            closest,
            left,
        )


def _mean(elements: Iterable[FloatArray]) -> FloatArray:
    mean: FloatArray = np.mean(np.array(list(elements)), axis=0)
    return mean

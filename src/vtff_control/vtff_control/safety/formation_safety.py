"""Decision about every thrust command: pass it on, replace it, or shut a thruster off.

The monitor trusts neither guidance nor controllers nor what a thruster reports, and uses none of
their code. Every step it takes the navigated relative states with their covariance, the thrust that
is reported for now, and the commands that wait for their thrusters.

A command passes on while, with all thrust off after it, every pair stays clear for some orbits; or
while an evasive manoeuvre that starts some seconds after it still keeps every pair clear (mode
WATCH: a powered approach leads to the other spacecraft by intent, and is none of its business as
long as there is a way out). The deputy is taken over when that way out closes, when nobody acts
although a pair will soon not be clear, or when a thruster does not do what it reports; the axis of
such a thruster is isolated. Taken over it stays, until a reset: commands are those of the evasive
manoeuvre, planned anew every step, and zero while every pair is clear.

A chief that thrusts is heard as the deputies are: what moves them to it is the difference of the
thrusts. It never evades, the deputies do; its commands are zero from the moment in which its
thruster fails or a deputy must evade it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from vtff_control.safety.escape import ClearBounds, find_escape
from vtff_control.safety.prediction import (
    FreeMotion,
    PairPrediction,
    predict_chief_motion,
)
from vtff_control.safety.step_flight import advance_deputy, fly_chief
from vtff_control.safety.thrust_monitor import (
    ThrustDifference,
    ThrustMonitor,
    accused_axes,
    describe_fault,
)
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.orbit.elements import osculating_mean_motion
from vtff_dynamics.relative.motion import hcw_transition_matrix
from vtff_dynamics.vectors import FloatArray, norm

__all__ = [
    "MODE_EVADE",
    "MODE_HOLD",
    "MODE_MONITOR",
    "MODE_WATCH",
    "SpacecraftDecision",
    "SpacecraftInput",
    "FormationSafety",
    "SafetySetting",
    "SafetyStep",
    "judge_synthetic_formation",
]

MODE_MONITOR = 0
"""Every pair stays clear with thrust off; commands pass on."""
MODE_WATCH = 1
"""A pair does not stay clear with thrust off, an evasive manoeuvre is at hand; commands pass on."""
MODE_EVADE = 2
"""Taken over: an evasive manoeuvre replaces the commands."""
MODE_HOLD = 3
"""Taken over: every pair stays clear, commands are zero until a reset."""

_PASSIVE_STEPS = 3
_PASSIVE_SHARE = 0.05  # of the time that is left: a weak thruster coasts for long
_MISSING_STEPS = 5
_ABSENT_STEPS = 10
_WEAK_STEPS = 2
_SOON = 60.0  # s
_THRUSTER_WATCH = 3.0  # s: a thruster ends its thrust 2 s after the last command; and a step
_REPORT_FLOOR = 0.02  # of the cap: difference of report and command that is not looked at
_HYSTERESIS = 0.25  # of the margin; and in sigma
_NO_THRUST = np.zeros(3)


@dataclass(frozen=True)
class SafetySetting:
    """What is safe, and what the deputies can do.

    Parameters
    ----------
    hard_radius
        Distance below which no pair may come, m.
    margin
        Added to it for the expected distance, m.
    probability
        Largest probability of a pair to be inside the hard radius at any moment.
    orbits
        Length of the prediction with thrust off.
    acceleration_cap
        Largest acceleration on each axis of a thruster, m/s2.
    smallest_thrust
        Smallest acceleration of a thruster along one of its axes but none, m/s2, where these axes
        turn with the body: what it reports may then differ by half of it on each of them.
    velocity_limit
        Largest change of the velocity by one evasive manoeuvre, m/s on an axis.
    reaction_time
        How much later than the next command an evasive manoeuvre must still work, s.
    thrust_share
        Share of the cap that an evasive manoeuvre counts with.
    navigation_sigma
        Error of a position that covariances do not contain, m.
    thrust_sigma
        Error of reported thrust by which a prediction without navigation grows.
    step
        s.
    delay_steps
        Steps from a command's stamp to its start.
    """

    hard_radius: float = 10.0
    margin: float = 2.0
    probability: float = 1e-4
    orbits: float = 2.0
    acceleration_cap: float = 1.0
    smallest_thrust: float = 0.0
    velocity_limit: float = 50.0
    reaction_time: float = 2.0
    thrust_share: float = 0.9
    navigation_sigma: float = 0.2
    thrust_sigma: float = 0.05
    step: float = 1.0
    delay_steps: int = 1

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: 0 or more expected, got {value!r}")
        for name in ("hard_radius", "probability", "orbits", "acceleration_cap", "step"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: more than 0 expected, got {getattr(self, name)!r}")
        if not self.probability < 0.5:
            raise ValueError(f"probability: less than 0.5 expected, got {self.probability!r}")

    @functools.cached_property
    def bounds(self) -> ClearBounds:
        """Return when a pair is clear."""
        return ClearBounds(
            self.hard_radius, self.hard_radius + self.margin, float(-ndtri(self.probability))
        )

    @functools.cached_property
    def planning_bounds(self) -> ClearBounds:
        """Return the stricter bounds of a manoeuvre, so that it is not repeated for a trifle."""
        bounds = self.bounds
        return ClearBounds(
            bounds.hard_radius,
            bounds.clear_radius + _HYSTERESIS * self.margin,
            bounds.clear_sigmas + _HYSTERESIS,
        )

    @property
    def escape_horizon(self) -> float:
        """Return for how long an evasive manoeuvre must keep pairs clear at once, s.

        Three times what the thruster needs to cross the hard radius twice, at least ten minutes.
        """
        crossing = math.sqrt(4.0 * self.bounds.clear_radius / self.acceleration_cap)
        return max(600.0, 3.0 * crossing)


@dataclass(frozen=True, eq=False)
class SpacecraftInput:
    """What is known of a deputy at a step, or of a chief that thrusts, which has no relative state.

    Attributes
    ----------
    relative_rtn, covariance_rtn
        Navigated relative state (m, m/s, shape (6,)) and its covariance (6, 6), None for an exact
        one. A state of None is missing or not usable: the deputy is predicted from the last one.
    state_chief_gcrf
        State of the chief that defines the frame, m and m/s, shape (6,); None without a state.
    reported_rtn
        Acceleration that the thruster reports for the step that begins, m/s2, shape (3,); None
        without a report.
    command_rtn
        Command that waits for the thruster, m/s2, shape (3,); None if none has come.
    is_predicted
        Whether navigation had no measurement for the state.
    """

    relative_rtn: FloatArray | None = None
    covariance_rtn: FloatArray | None = None
    state_chief_gcrf: FloatArray | None = None
    reported_rtn: FloatArray | None = None
    command_rtn: FloatArray | None = None
    is_predicted: bool = False


_NOTHING_KNOWN = SpacecraftInput()


@dataclass(frozen=True, eq=False)
class SpacecraftDecision:
    """What happens to the command of a spacecraft.

    Attributes
    ----------
    mode
        `MODE_MONITOR`, `MODE_WATCH`, `MODE_EVADE` or `MODE_HOLD`.
    command_rtn
        Command in place of the one that came, m/s2, shape (3,); None passes that one on.
    isolated
        Axes R, T, N of the thruster that are to be shut off, shape (3,), bool.
    reason
        Why it was taken over, one line; of a deputy in WATCH, what is watched. Else empty.
    """

    mode: int
    command_rtn: FloatArray | None
    isolated: np.ndarray[tuple[int], np.dtype[np.bool_]]
    reason: str


@dataclass(frozen=True, eq=False)
class SafetyStep:
    """Result of a step: a decision for each that thrusts, a prediction for every pair."""

    decisions: dict[str, SpacecraftDecision]
    pairs: list[PairPrediction]


@dataclass(eq=False)
class _Thruster:
    """What the monitor knows of a thruster from the steps before."""

    # Without a report: the middle of what the thruster may give, and how far that is from its ends.
    reported: FloatArray = field(default_factory=lambda: np.zeros(3))
    unreported: FloatArray = field(default_factory=lambda: np.zeros(3))
    last_report: FloatArray = field(default_factory=lambda: np.zeros(3))
    steps_without_report: int = 0
    expected: list[list[float]] = field(default_factory=list)
    reason: str = ""
    isolated: np.ndarray[tuple[int], np.dtype[np.bool_]] = field(
        default_factory=lambda: np.zeros(3, dtype=bool)
    )
    weak_steps: list[int] = field(default_factory=lambda: [0, 0, 0])

    def accuse(self, axes: np.ndarray[tuple[int], np.dtype[np.bool_]], reason: str) -> None:
        """Isolate axes, and keep the first reason."""
        self.isolated = self.isolated | axes
        self.reason = self.reason or reason

    def reset(self) -> None:
        """Forget what was isolated, and why."""
        self.reason = ""
        self.isolated = np.zeros(3, dtype=bool)
        self.expected.clear()
        self.steps_without_report = 0


@dataclass(eq=False)
class _Track(_Thruster):
    """What the monitor knows of a deputy from the steps before."""

    monitor: ThrustMonitor = field(kw_only=True)
    relative: FloatArray | None = None
    covariance: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))
    # By the errors of the reported thrust of deputy and chief, (6, 18), and by thrust that nobody
    # reports, (6, 6); None where there is none.
    thrust_effect: FloatArray | None = None
    unreported_effect: FloatArray | None = None
    passive_steps: int = 0
    missing_steps: int = 0

    def reset(self) -> None:
        """Forget what was isolated, and why, and who acts."""
        super().reset()
        self.passive_steps = self.missing_steps = 0
        self.monitor.reset()


class FormationSafety:
    """Safety monitor of a chief and its deputies; call `step` once a step.

    Parameters
    ----------
    chief
        Name of the chief.
    deputies
        Names of the deputies.
    setting
        Bounds and capabilities.
    chief_thrusts
        Whether the chief has a thruster of its own.

    Raises
    ------
    ValueError
        If a name is there twice, or there is no deputy.
    """

    def __init__(
        self,
        chief: str,
        deputies: Sequence[str],
        setting: SafetySetting,
        chief_thrusts: bool = False,
    ) -> None:
        if not deputies:
            raise ValueError("deputies: at least one name expected")
        if len({chief, *deputies}) != len(deputies) + 1:
            raise ValueError(f"deputies: different names expected, got {chief}, {list(deputies)}")
        self._names = (chief, *deputies)
        self._setting = setting
        self._tracks = {
            name: _Track(monitor=ThrustMonitor(setting.acceleration_cap, setting.step))
            for name in deputies
        }
        # Without a thruster this one never thrusts.
        self._chief_thruster = _Thruster()
        self._chief_thrusts = chief_thrusts
        self._chief: FloatArray | None = None
        # Covariance of the errors of positions that covariances do not contain.
        self._covariance_floor = np.zeros((6, 6))
        self._covariance_floor[:3, :3] = setting.navigation_sigma**2 * np.eye(3)

    def reset(self, spacecraft: str | None = None) -> None:
        """Give a spacecraft, or all, back to the controllers, and forget what was isolated.

        Raises
        ------
        KeyError
            If there is no such spacecraft with a thruster.
        """
        thrusters: dict[str, _Thruster] = dict(self._tracks)
        if self._chief_thrusts:
            thrusters[self._names[0]] = self._chief_thruster
        for name in thrusters if spacecraft is None else (spacecraft,):
            thrusters[name].reset()

    def step(self, inputs: Mapping[str, SpacecraftInput]) -> SafetyStep:
        """Decide about the commands of a step.

        Parameters
        ----------
        inputs
            Inputs of every deputy, and of a chief that thrusts, by name; a deputy that is absent
            is predicted.
        """
        self._watch_states(inputs)
        for name, track in self._tracks.items():
            self._take_report(track, inputs.get(name, _NOTHING_KNOWN))
        if self._chief_thrusts:
            self._take_report(self._chief_thruster, inputs.get(self._names[0], _NOTHING_KNOWN))
        if self._chief is None:
            # Nothing has been navigated yet: there is nothing to judge by.
            reason = "not judged: no navigation yet"
            unjudged = {
                name: SpacecraftDecision(MODE_MONITOR, None, np.zeros(3, dtype=bool), reason)
                for name in self._guarded_names()
            }
            return SafetyStep(unjudged, [])
        motion = self._motion_after(inputs, with_command=True)
        pairs = self._pairs(motion, self._setting.bounds)
        decisions = {}
        for name, track in self._tracks.items():
            given = inputs.get(name, _NOTHING_KNOWN)
            decisions[name] = self._decide(name, track, given, motion, pairs)
            self._expect(track, given, decisions[name])
        if self._chief_thrusts:
            name_chief = self._names[0]
            decisions[name_chief] = self._decide_chief(decisions, pairs)
            given = inputs.get(name_chief, _NOTHING_KNOWN)
            self._expect(self._chief_thruster, given, decisions[name_chief])
        return SafetyStep(decisions, pairs)

    def _known_names(self) -> list[str]:
        """Return the names of the deputies whose relative state is known."""
        return [name for name, track in self._tracks.items() if track.relative is not None]

    def _guarded_names(self) -> tuple[str, ...]:
        """Return the names of those that thrust."""
        return (*self._tracks, *self._names[: int(self._chief_thrusts)])

    # ---- states ------------------------------------------------------------------------------

    def _watch_states(self, inputs: Mapping[str, SpacecraftInput]) -> None:
        """Take what is navigated, predict what is not, and watch the thrusters."""
        step = self._setting.step
        previous_chief = self._chief
        self._chief = self._navigated_chief(inputs)
        if self._chief is None and previous_chief is not None:
            thrust_chief = self._chief_thruster.reported
            self._chief = fly_chief(previous_chief, thrust_chief[np.newaxis], step)[1]
        found = {}
        for name, track in self._tracks.items():
            given = inputs.get(name, _NOTHING_KNOWN)
            if previous_chief is not None:
                self._grow_unreported(track, previous_chief)
            is_informative = self._is_informative(given)
            if not is_informative and track.relative is not None and previous_chief is not None:
                self._predict(track, previous_chief)
            if is_informative or self._is_better(track, given):
                assert given.relative_rtn is not None and self._chief is not None
                covariance = given.covariance_rtn
                track.covariance = np.zeros((6, 6)) if covariance is None else covariance
                track.thrust_effect = None
                if not given.is_predicted:  # a measurement contains what the thruster gave
                    track.unreported_effect = None
                track.relative = given.relative_rtn
                difference = track.monitor.update(
                    self._chief,
                    track.relative,
                    track.covariance,
                    track.reported,
                    track.unreported + self._chief_thruster.unreported,
                    self._chief_thruster.reported,
                    is_predicted=given.is_predicted,
                )
                if difference is not None:
                    found[name] = difference
            else:
                track.monitor.reset()
        if found:
            self._accuse(found)

    def _navigated_chief(self, inputs: Mapping[str, SpacecraftInput]) -> FloatArray | None:
        """Return the chief as the first deputy that is navigated knows it; None if none is.

        Each deputy knows it a little differently: the first in order counts, not the first that
        came.
        """
        for name in self._tracks:
            given = inputs.get(name, _NOTHING_KNOWN)
            if given.relative_rtn is not None and given.state_chief_gcrf is not None:
                return given.state_chief_gcrf
        return None

    def _accuse(self, found: Mapping[str, ThrustDifference]) -> None:
        """Isolate the axes of thrusters that do not do what they report."""
        step = self._setting.step
        is_chief_accused = False
        for name, difference in found.items():
            axes, axes_chief = difference.axes, np.zeros(3, dtype=bool)
            if self._chief_thrusts:
                others = [track.monitor for other, track in self._tracks.items() if other != name]
                axes, axes_chief = accused_axes(difference, others)
            seconds = difference.age * step
            if axes.any():
                text = describe_fault(axes, difference.residual, difference.reported, seconds)
                if (axes & axes_chief).any():
                    text += f"; its own or that of {self._names[0]}, which one is not to be told"
                self._tracks[name].accuse(axes, text)
            if axes_chief.any():
                text = describe_fault(
                    axes_chief, -difference.residual, difference.reported_chief, seconds
                )
                if (axes & axes_chief).any():
                    text += f"; its own or that of {name}, which one is not to be told"
                self._chief_thruster.accuse(axes_chief, text)
                is_chief_accused = True
        if is_chief_accused:
            # What the chief has pushed until now is in the past of every deputy.
            for track in self._tracks.values():
                track.monitor.reset()

    def _predict(self, track: _Track, chief: FloatArray) -> None:
        """Carry the last state of a deputy over a step with the reported thrusts."""
        assert track.relative is not None
        thrust, thrust_chief = track.reported, self._chief_thruster.reported
        step = self._setting.step
        chief_after = fly_chief(chief, thrust_chief[np.newaxis], step)[1]
        track.relative = advance_deputy(track.relative, chief, chief_after, thrust, step)
        transition, push = self._step_matrices(chief)
        track.covariance = transition @ track.covariance @ transition.T
        pushes = np.kron(np.eye(3), np.concatenate((thrust, thrust_chief)))
        effect = np.zeros((6, 18)) if track.thrust_effect is None else track.thrust_effect
        track.thrust_effect = transition @ effect + push @ pushes

    def _grow_unreported(self, track: _Track, chief: FloatArray) -> None:
        """Carry the effect of thrust that nobody reported over a step."""
        unreported_chief = self._chief_thruster.unreported
        before = track.unreported_effect
        if before is None:
            if not any(track.unreported.tolist()) and not any(unreported_chief.tolist()):
                return
            before = np.zeros((6, 6))
        transition, push = self._step_matrices(chief)
        effect = np.hstack((push * track.unreported, push * unreported_chief))
        track.unreported_effect = transition @ before @ transition.T + effect @ effect.T

    def _step_matrices(self, chief: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the matrices (6, 6) and (6, 3) of state and acceleration over a step."""
        step = self._setting.step
        transition = hcw_transition_matrix(osculating_mean_motion(chief), step)
        return transition, np.vstack((0.5 * step**2 * np.eye(3), step * np.eye(3)))

    def _is_informative(self, given: SpacecraftInput) -> bool:
        """Return whether a state can be judged by.

        A filter that has just started knows the velocity to some m/s: with that nothing stays clear
        for the time of an evasive manoeuvre, and no manoeuvre helps.
        """
        if given.relative_rtn is None or self._chief is None:
            return False
        if given.covariance_rtn is None:
            return True
        setting = self._setting
        gap = norm(given.relative_rtn[:3]) - setting.hard_radius
        error = _error_after(setting.escape_horizon, given.covariance_rtn)
        return setting.bounds.clear_sigmas * error < gap

    def _is_better(self, track: _Track, given: SpacecraftInput) -> bool:
        """Return whether a poor state is still better than the prediction from the last one."""
        if given.relative_rtn is None or given.covariance_rtn is None or track.relative is None:
            return False
        predicted = self._covariance(track)
        return _error_after(_SOON, given.covariance_rtn) <= _error_after(_SOON, predicted)

    def _covariance(self, track: _Track) -> FloatArray:
        """Return the covariance of a deputy's relative state with what predictions add to it."""
        covariance = track.covariance
        if track.thrust_effect is not None:
            thrust = self._setting.thrust_sigma**2 * track.thrust_effect @ track.thrust_effect.T
            covariance = covariance + thrust
        if track.unreported_effect is not None:
            covariance = covariance + track.unreported_effect
        return covariance

    def _take_report(self, track: _Thruster, given: SpacecraftInput) -> None:
        """Take the report of a step; without one, what the thruster may give in it.

        The command may have reached the thruster or not, and a thruster that hears none goes on
        with what it gave last until its watch ends that.
        """
        cap = self._setting.acceleration_cap
        told = None
        if len(track.expected) >= max(self._setting.delay_steps, 1):
            told = [min(max(value, -cap), cap) for value in track.expected.pop(0)]
        if given.reported_rtn is not None:
            track.reported = track.last_report = given.reported_rtn
            track.unreported = np.zeros(3)
            track.steps_without_report = 0
            if told is not None:
                self._compare_report(track, given.reported_rtn, told)
            return
        track.steps_without_report += 1
        possible = [np.zeros(3)]
        if told is not None:
            possible.append(np.array(told))
        if track.steps_without_report * self._setting.step <= _THRUSTER_WATCH:
            possible.append(track.last_report)
        low, high = np.min(possible, axis=0), np.max(possible, axis=0)
        track.reported, track.unreported = 0.5 * (low + high), 0.5 * (high - low)

    def _compare_report(
        self, track: _Thruster, reported_rtn: FloatArray, told: Sequence[float]
    ) -> None:
        """Look whether the thruster reports more than it was told."""
        cap = self._setting.acceleration_cap
        # Half the smallest thrust on each of three axes, along one of the orbit.
        floor = max(_REPORT_FLOOR * cap, 0.5 * math.sqrt(3.0) * self._setting.smallest_thrust)
        over, weak = [False] * 3, [False] * 3
        for axis, (reported, command) in enumerate(zip(reported_rtn.tolist(), told, strict=True)):
            # In the direction of the command, up to its size; against it, nothing.
            along, wanted = reported if command >= 0.0 else -reported, abs(command)
            over[axis] = along > 1.1 * wanted + floor or along < -floor
            is_under = along < 0.5 * wanted - floor
            track.weak_steps[axis] = track.weak_steps[axis] + 1 if is_under else 0
            weak[axis] = track.weak_steps[axis] >= _WEAK_STEPS
        for axes, text in (
            (over, "stuck on along {}: reports a thrust that nobody commanded"),
            (weak, "stuck off or weak along {}: reports less than half of what it was told"),
        ):
            if any(axes):
                names = ", ".join(axis for axis, is_it in zip("RTN", axes, strict=True) if is_it)
                track.accuse(np.array(axes), "thruster " + text.format(names))

    def _expect(
        self, track: _Thruster, given: SpacecraftInput, decision: SpacecraftDecision
    ) -> None:
        """Keep what the thruster is told, for comparison with its report."""
        if not self._setting.delay_steps:
            return
        command = given.command_rtn if decision.command_rtn is None else decision.command_rtn
        wanted = [0.0] * 3 if command is None else command.tolist()
        isolated = decision.isolated.tolist()
        track.expected.append(
            [0.0 if is_it else value for value, is_it in zip(wanted, isolated, strict=True)]
        )

    def _thrusts(
        self, name: str, inputs: Mapping[str, SpacecraftInput], with_command: bool
    ) -> list[FloatArray]:
        """Return the thrust in each step until a command starts, or ends, to act."""
        cap, delay_steps = self._setting.acceleration_cap, self._setting.delay_steps
        thruster = self._tracks.get(name, self._chief_thruster)
        reported = [thruster.reported, *([_NO_THRUST] * (delay_steps - 1))][:delay_steps]
        if not with_command:
            return reported
        command = inputs.get(name, _NOTHING_KNOWN).command_rtn
        if command is None or thruster.reason:
            return [*reported, _NO_THRUST]
        return [*reported, np.minimum(np.maximum(command, -cap), cap)]

    def _chief_steps(self, inputs: Mapping[str, SpacecraftInput], with_command: bool) -> FloatArray:
        """Return the chief of now, and after each step until a command starts, or ends, to act."""
        assert self._chief is not None
        thrusts = self._thrusts(self._names[0], inputs, with_command)
        return fly_chief(self._chief, np.array(thrusts).reshape(-1, 3), self._setting.step)

    def _motion_after(
        self, inputs: Mapping[str, SpacecraftInput], with_command: bool
    ) -> FreeMotion:
        """Return the motion without thrust from when a command of now starts, or ends, to act."""
        setting, known = self._setting, self._known_names()
        chief_steps = self._chief_steps(inputs, with_command)
        states, covariances = [], []
        for name in known:
            track = self._tracks[name]
            relative = track.relative
            assert relative is not None
            for number, thrust in enumerate(self._thrusts(name, inputs, with_command)):
                relative = advance_deputy(
                    relative, chief_steps[number], chief_steps[number + 1], thrust, setting.step
                )
            states.append(relative)
            covariances.append(self._covariance(track) + self._covariance_floor)
        chief = predict_chief_motion(chief_steps[-1], setting.orbits)
        return chief.formation((self._names[0], *known), states, covariances)

    def _pairs(self, motion: FreeMotion, bounds: ClearBounds) -> list[PairPrediction]:
        count = len(motion.names)
        return [
            motion.predict_pair(
                first, second, bounds.hard_radius, bounds.clear_radius, bounds.clear_sigmas
            )
            for first in range(count)
            for second in range(first + 1, count)
        ]

    # ---- decisions ---------------------------------------------------------------------------

    def _decide(
        self,
        name: str,
        track: _Track,
        given: SpacecraftInput,
        motion: FreeMotion,
        pairs: Sequence[PairPrediction],
    ) -> SpacecraftDecision:
        command = given.command_rtn
        if command is not None:
            track.passive_steps = 0 if any(command.tolist()) else track.passive_steps + 1
        track.missing_steps = track.missing_steps + 1 if command is None else 0
        if track.relative is None:
            if track.reason:  # a thruster was isolated before anything was navigated
                return SpacecraftDecision(
                    MODE_HOLD, np.zeros(3), track.isolated.copy(), track.reason
                )
            reason = "not judged: navigation is not good enough yet"
            return SpacecraftDecision(MODE_MONITOR, None, track.isolated.copy(), reason)
        watched = ""
        if not track.reason:
            own = [pair for pair in pairs if name in (pair.first, pair.second)]
            worst = min(own, key=lambda pair: pair.violation_time)
            if math.isfinite(worst.violation_time):
                watched = _describe_pair(worst)
                track.reason = self._reason_to_take_over(name, track, motion, worst, watched)
        if track.reason:
            return self._take_over(name, track)
        mode = MODE_WATCH if watched else MODE_MONITOR
        return SpacecraftDecision(mode, None, track.isolated.copy(), watched)

    def _decide_chief(
        self, decisions: Mapping[str, SpacecraftDecision], pairs: Sequence[PairPrediction]
    ) -> SpacecraftDecision:
        """Return what happens to the command of a chief that thrusts."""
        chief, thruster = self._names[0], self._chief_thruster
        watched = ""
        for pair in pairs:
            if chief == pair.first and math.isfinite(pair.violation_time):
                watched = watched or _describe_pair(pair)
                if decisions[pair.second].mode == MODE_EVADE:
                    thruster.reason = thruster.reason or f"{pair.second} evades; {watched}"
        isolated = thruster.isolated.copy()
        if thruster.reason:
            return SpacecraftDecision(MODE_HOLD, np.zeros(3), isolated, thruster.reason)
        mode = MODE_WATCH if watched else MODE_MONITOR
        return SpacecraftDecision(mode, None, isolated, watched)

    def _reason_to_take_over(
        self, name: str, track: _Track, motion: FreeMotion, worst: PairPrediction, watched: str
    ) -> str:
        """Return why a deputy must be taken over now; empty if it need not."""
        setting = self._setting
        is_soon = worst.violation_time <= setting.escape_horizon
        if track.missing_steps >= (_MISSING_STEPS if is_soon else _ABSENT_STEPS):
            return f"no commands for {track.missing_steps * setting.step:g} s; {watched}"
        if not is_soon:
            return ""
        patience = max(_PASSIVE_STEPS * setting.step, _PASSIVE_SHARE * worst.violation_time)
        if track.passive_steps * setting.step >= patience:
            return f"nobody acts: no thrust is commanded; {watched}"
        escape = find_escape(
            motion,
            motion.names.index(name),
            setting.bounds,
            self._available(track),
            setting.velocity_limit,
            setting.reaction_time,
            setting.escape_horizon,
        )
        return f"the last way out closes; {watched}" if escape is None else ""

    def _take_over(self, name: str, track: _Track) -> SpacecraftDecision:
        """Return the command of the evasive manoeuvre, or zero while every pair is clear."""
        setting = self._setting
        isolated = track.isolated.copy()
        motion = self._motion_after({}, with_command=False)
        index = motion.names.index(name)
        bounds = setting.bounds
        soonest = min(
            motion.violation_time(
                min(index, other),
                max(index, other),
                bounds.hard_radius,
                bounds.clear_radius,
                bounds.clear_sigmas,
            )
            for other in range(len(motion.names))
            if other != index
        )
        if not math.isfinite(soonest):
            return SpacecraftDecision(MODE_HOLD, np.zeros(3), isolated, track.reason)
        available = self._available(track)
        horizons = [float(motion.times[-1])]
        if soonest <= setting.escape_horizon:
            horizons.append(setting.escape_horizon)
        velocity = None
        for horizon in horizons:
            for planning in (setting.planning_bounds, bounds):
                if velocity is None:
                    velocity = find_escape(
                        motion, index, planning, available, setting.velocity_limit, 0.0, horizon
                    )
        if velocity is None:
            if soonest > setting.escape_horizon:
                return SpacecraftDecision(MODE_HOLD, np.zeros(3), isolated, track.reason)
            velocity = _away(motion, index, soonest) * setting.velocity_limit
        command = self._command(velocity, available)
        return SpacecraftDecision(MODE_EVADE, command, isolated, track.reason)

    def _available(self, track: _Track) -> FloatArray:
        """Return the acceleration that a manoeuvre counts with, on R, T and N, m/s2."""
        share = self._setting.thrust_share * self._setting.acceleration_cap
        return np.where(track.isolated, 0.0, share)

    def _command(self, velocity: FloatArray, available: FloatArray) -> FloatArray:
        """Return the acceleration of the coming step of a burn, m/s2."""
        usable = available > 0.0
        wanted = np.where(usable, velocity, 0.0)
        durations = np.abs(wanted[usable]) / available[usable]
        duration = max(float(durations.max(initial=0.0)), self._setting.step)
        return np.asarray(wanted / duration)


def _error_after(seconds: float, covariance: FloatArray) -> float:
    """Return the sigma that a position has after a time, in its worst direction, about, m."""
    position = float(np.linalg.eigvalsh(covariance[:3, :3])[-1])
    velocity = float(np.linalg.eigvalsh(covariance[3:, 3:])[-1])
    return math.sqrt(max(position, 0.0)) + seconds * math.sqrt(max(velocity, 0.0))


def judge_synthetic_formation(setting: SafetySetting) -> None:
    """Judge a deputy that runs into the chief, and one that stays far away, each with a monitor.

    The first predictions and manoeuvres compile, for which no step can wait.

    Parameters
    ----------
    setting
        Setting of the monitors.
    """
    radius = 7.0e6
    chief = np.array([radius, 0.0, 0.0, 0.0, math.sqrt(GM_EARTH / radius), 0.0])
    distance = 2.0 * setting.bounds.clear_radius
    # Good enough for any setting to judge it.
    covariance = np.diag([1e-6] * 3 + [1e-12] * 3)
    for place, speed in ((distance, -0.1 * distance), (100.0 * distance, 0.0)):
        state = np.array([0.0, place, 0.0, 0.0, speed, 0.0])
        safety = FormationSafety("chief", ("deputy",), setting)
        heard = SpacecraftInput(state, covariance, chief, np.zeros(3), np.zeros(3))
        for values in (heard, heard, SpacecraftInput(reported_rtn=np.zeros(3)), heard):
            for pair in safety.step({"deputy": values}).pairs:
                _ = pair.probability


def _away(motion: FreeMotion, index: int, moment: float) -> FloatArray:
    """Return the direction in RTN from the spacecraft that is nearest at a moment, shape (3,)."""
    sample = min(int(np.searchsorted(motion.times, moment)), len(motion.times) - 1)
    differences = [
        motion.rotation[sample] @ (motion.relative[index] - other)[sample, :3]
        for number, other in enumerate(motion.relative)
        if number != index
    ]
    nearest = min(differences, key=lambda difference: float(np.linalg.norm(difference)))
    size = float(np.linalg.norm(nearest))
    return nearest / size if size > 0.0 else np.array([0.0, 0.0, 1.0])


def _describe_pair(pair: PairPrediction) -> str:
    """Return what is predicted of a pair, in words."""
    return (
        f"{pair.first}-{pair.second}: with thrust off {pair.separation:.1f} m in "
        f"{pair.separation_time:.0f} s, {pair.sigmas:.1f} sigma from the hard radius, "
        f"first not clear in {pair.violation_time:.0f} s"
    )

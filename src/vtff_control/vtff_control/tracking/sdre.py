"""State-dependent Riccati equation (SDRE) control of a formation.

The controller turns the state of a deputy relative to the chief into an acceleration command.
State and command are given in the chief's RTN frame (R radial outward, T along-track, N orbit
normal); the relative velocity is the derivative seen in the rotating frame.

The feedback law is ``u = -K (x - x_d)`` with a gain ``K`` from a Riccati equation of the relative
dynamics ``x' = A(x) x + B u`` and the cost ``integral of (x - x_d)' Q (x - x_d) + u' R u``
(Peng and others, "VTFF testbed ... ionospheric remote sensing", section 3.5, equation 7).
Four designs are offered, see `SdreDesign`. Options add what the paper's loop lacks: a feedforward,
an observer of disturbances, a bandwidth that follows the covariance of navigation, a speed that can
be stopped, and a command that averages to what is wanted although the thruster rounds it.

No function of this module reads a clock or knows ROS: the same calls in the same order give the
same numbers in a node, in a notebook and on replay.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_control.tracking.bandwidth import BandwidthSchedule, weights_at_level
from vtff_control.tracking.controller import ControlResult
from vtff_control.tracking.deviation_observer import DeviationObserver
from vtff_control.tracking.feedforward import target_acceleration, velocity_at_rest
from vtff_control.tracking.navigation_bounds import (
    sigma_reason,
    unsafe_velocity,
    usable_covariance,
)
from vtff_control.tracking.riccati import Weights, delayed_riccati_gain, riccati_gain
from vtff_dynamics.constants import J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.orbit.elements import osculating_mean_motion
from vtff_dynamics.relative.motion import (
    frame_rates_rtn,
    hcw_state_matrix,
    state_dependent_matrix,
)
from vtff_dynamics.vectors import FloatArray, is_finite, norm

DESIGNS = ("paper", "state_dependent", "delay_aware", "navigation_aware")
"""Names accepted by `SdreDesign.design`."""

FEEDFORWARD_GRAVITY = ("j2", "two_body")
"""Names accepted by `SdreDesign.feedforward_gravity`."""

MEAN_MOTION_TOLERANCE = 0.01
"""Relative change of the chief's mean motion after which a gain is solved anew.

The osculating mean motion of a low orbit breathes by about 0.15 % under J2, to which the gain
answers in its fourth digit. The band is wide enough that a gain never moves within an unperturbed
run and that a manoeuvred, decayed or replaced chief is still followed.
"""

DEFAULT_WEIGHTS = {
    "paper": Weights(position=1e-4, velocity=1e-4, control=1.0),
    "state_dependent": Weights(position=1e-4, velocity=1e-4, control=1.0),
    "delay_aware": Weights(position=1e-4, velocity=1e-2, control=1.0),
    "navigation_aware": Weights(position=1e-4, velocity=1e-2, control=1.0),
}
"""Weights of each design, in 1/m2, s2/m2 and s4/m2.

``paper`` uses Q = 1e-4 I6 and R = I3: a change of Q by 10 % moves the smallest in-track
separation of the paper's appendix A.1 by 10 m, so the value is pinned by the paper's 38.17 m.
``delay_aware`` weighs the velocity 100 times more: with its own delay in the model the loop then
is well damped (ratio 0.87 instead of 0.71), which removes the overshoot and with it a fifth of
the fuel.
"""


class Options(NamedTuple):
    """Additions of a design to the feedback; see the parameters of these names of `SdreDesign`."""

    feedforward: bool = False
    disturbance_observer: bool = False
    tolerated_deviation: float = 0.0
    braking_share: float = 0.0
    quantum: float = 0.0


DEFAULT_OPTIONS = {
    **dict.fromkeys(("paper", "state_dependent", "delay_aware"), Options()),
    "navigation_aware": Options(
        feedforward=True,
        disturbance_observer=True,
        tolerated_deviation=1e-3,
        braking_share=0.6,
        quantum=1e-5,
    ),
}
"""Options of each design.

A deviation of 1 mm is the error of navigation where it is good. With 0.6 of the cap the deputy
still stops when its thrust is a tenth too weak and a sample late; with 0.8 it comes within 34 m.
The quantum is a count of the CAN thruster (docs/can.md); a finer thruster is not hurt by it.
"""


@dataclass(frozen=True)
class SdreDesign:
    """Parameters of an `SdreController`.

    Parameters
    ----------
    design
        ``paper``: continuous Riccati equation on the Hill-Clohessy-Wiltshire (HCW) coefficients
        of a circular chief orbit, as in the paper.
        ``state_dependent``: the same cost, but with the nonlinear matrix A(x) of an eccentric
        chief orbit, solved anew at every step.
        ``delay_aware``: discrete Riccati equation of the HCW model sampled with zero-order hold,
        with the commands that are still waiting in the thruster as additional states.
        ``navigation_aware``: the same equation, with all options of `DEFAULT_OPTIONS`.
    acceleration_cap
        Largest magnitude of the command in m/s2, one value for all axes or one for each of
        R, T, N. The paper's default is 1.0, its reference run uses 1.4.
    feedforward
        Adds the acceleration that holds the target in the eccentric, nonlinear rotating frame;
        ``navigation_aware`` always does.
    feedforward_gravity
        Gravity for which the feedforward is exact: ``j2`` (any real orbit) or ``two_body``
        (scenarios with that force model).
    position_weight, velocity_weight, control_weight
        Weights of the cost; None takes the default of the design (`DEFAULT_WEIGHTS`).
    disturbance_observer
        Estimates the deviation and the disturbing acceleration from states and commands, and
        compensates the disturbance; see `vtff_control.tracking.deviation_observer`. None here
        and below takes the option of the design (`DEFAULT_OPTIONS`).
    tolerated_deviation
        With it the bandwidth follows the covariance of the states: deviation of the position that
        is tolerated with perfect navigation, m; see `vtff_control.tracking.bandwidth`. 0 keeps the
        bandwidth of the weights.
    braking_share
        Share of the acceleration cap with which the way to a far target is planned: the deviation
        that the feedback sees is shortened so that the deputy never flies faster than it can stop
        with that share. A linear feedback under a cap flies past targets that are too far. 0 is
        the linear feedback.
    quantum
        Smallest change of the thruster's acceleration in m/s2. Commands then are multiples of it,
        and what is left over is added to the next command, so that the mean is exact; 0 leaves
        rounding to the thruster.
    maximum_sigma, maximum_sigma_ratio
        Bounds up to which a state is tracked: sigma of the position in its worst direction in m,
        and in proportion to the distance from the chief. Beyond, the controller brakes: to coast
        towards the chief is not safe; see `vtff_control.tracking.navigation_bounds`.
    sample_time
        Interval between commands in s, which is also the time for which one is held.
    delay_steps
        Whole sample intervals between the state and the start of its command. Only
        ``delay_aware``, ``navigation_aware`` and the feedforward use it; the thruster is what
        delays.
    mean_motion
        Mean motion of the HCW model in rad/s. None takes the osculating mean motion of the first
        usable chief state and keeps it until the osculating one has moved away by
        `MEAN_MOTION_TOLERANCE`; so the gain depends on the states only, never on wall time.

    Raises
    ------
    ValueError
        If a value is out of its range; the message names the parameter.
    """

    design: str = "paper"
    acceleration_cap: float | Sequence[float] = 1.0
    feedforward: bool = False
    feedforward_gravity: str = "j2"
    position_weight: float | None = None
    velocity_weight: float | None = None
    control_weight: float | None = None
    disturbance_observer: bool | None = None
    tolerated_deviation: float | None = None
    braking_share: float | None = None
    quantum: float | None = None
    maximum_sigma: float = 100.0
    maximum_sigma_ratio: float = 0.25
    sample_time: float = 1.0
    delay_steps: int = 1
    mean_motion: float | None = None

    def __post_init__(self) -> None:
        """Check every parameter."""
        if self.design not in DESIGNS:
            raise ValueError(f"design: {self.design!r} is not one of {', '.join(DESIGNS)}")
        if self.feedforward_gravity not in FEEDFORWARD_GRAVITY:
            raise ValueError(
                f"feedforward_gravity: {self.feedforward_gravity!r} is not one of "
                f"{', '.join(FEEDFORWARD_GRAVITY)}"
            )
        caps = np.asarray(self.acceleration_cap, dtype=float)
        if caps.shape not in ((), (3,)) or not np.all(caps > 0.0):
            raise ValueError(
                f"acceleration_cap: one or three positive numbers (m/s2) expected, "
                f"got {self.acceleration_cap!r}"
            )
        for name in ("position_weight", "velocity_weight", "control_weight", "mean_motion"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: a positive number or None expected, got {value!r}")
        options = self.options
        if not 0.0 <= options.braking_share <= 1.0:
            raise ValueError(f"braking_share: 0 to 1 expected, got {options.braking_share!r}")
        for name, value in (
            ("tolerated_deviation", options.tolerated_deviation),
            ("quantum", options.quantum),
            ("maximum_sigma", self.maximum_sigma),
            ("maximum_sigma_ratio", self.maximum_sigma_ratio),
        ):
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: 0 or more expected, got {value!r}")
        if options.quantum > float(caps.min()):
            raise ValueError(
                f"quantum: at most the acceleration_cap expected, got {options.quantum!r}"
            )
        if not (np.isfinite(self.sample_time) and self.sample_time > 0.0):
            raise ValueError(f"sample_time: positive seconds expected, got {self.sample_time!r}")
        if isinstance(self.delay_steps, bool) or not isinstance(self.delay_steps, int):
            raise ValueError(f"delay_steps: a whole number expected, got {self.delay_steps!r}")
        if not 0 <= self.delay_steps <= 100:
            raise ValueError(f"delay_steps: 0 to 100 expected, got {self.delay_steps!r}")

    @property
    def weights(self) -> Weights:
        """Weights in force: the given ones, else those of the design."""
        default = DEFAULT_WEIGHTS[self.design]
        return Weights(
            default.position if self.position_weight is None else self.position_weight,
            default.velocity if self.velocity_weight is None else self.velocity_weight,
            default.control if self.control_weight is None else self.control_weight,
        )

    @property
    def options(self) -> Options:
        """Options in force: the given ones, else those of the design."""
        default = DEFAULT_OPTIONS[self.design]
        given = {
            name: value
            for name in Options._fields
            if name != "feedforward" and (value := getattr(self, name)) is not None
        }
        return default._replace(feedforward=default.feedforward or self.feedforward, **given)

    @property
    def caps(self) -> FloatArray:
        """Cap of each RTN axis in m/s2, shape (3,)."""
        return np.array(np.broadcast_to(np.asarray(self.acceleration_cap, dtype=float), (3,)))


def stale_state_reason(stamp_state: int, stamp_now: int, maximum_age: float) -> str:
    """Judge the age of a state by its stamps.

    Parameters
    ----------
    stamp_state, stamp_now
        Time of validity of the state and scenario time, in whole nanoseconds of one scale.
    maximum_age
        Largest accepted age in s.

    Returns
    -------
    str
        Empty if the state is fresh, else one line that says how old it is.
    """
    age = (stamp_now - stamp_state) * 1e-9
    if age > maximum_age:
        return f"relative state is {age:.3f} s old, more than {maximum_age:g} s"
    if age < -maximum_age:
        return f"relative state is stamped {-age:.3f} s ahead of scenario time"
    return ""


class SdreController:
    """Formation controller of one deputy; see `SdreDesign` for the four designs.

    The controller remembers its gain, the commands that still wait in the thruster and, with these
    options, the estimates of its observer, the level of its bandwidth and what the quantum has
    left over. Call `reset` when the queue of commands was lost, for example after a jump in time.
    """

    def __init__(self, design: SdreDesign) -> None:
        self.design = design
        self._weights = design.weights
        self._options = design.options
        self._caps = design.caps
        self._j2 = J2_EARTH if design.feedforward_gravity == "j2" else 0.0
        self._gain: FloatArray | None = None
        self._gain_mean_motion = 0.0
        self._gain_solutions = 0
        self._gains: dict[int, FloatArray] = {}
        self._waiting: deque[FloatArray] = deque(maxlen=design.delay_steps)
        self._stamp: int | None = None
        self._observer = (
            DeviationObserver(design.sample_time) if self._options.disturbance_observer else None
        )
        self._schedule: BandwidthSchedule | None = None
        if self._options.tolerated_deviation > 0.0:
            bandwidth = (self._weights.position / self._weights.control) ** 0.25
            self._schedule = BandwidthSchedule(bandwidth, self._options.tolerated_deviation)
        self._left_over: FloatArray = np.zeros(3)
        quantum = self._options.quantum
        # 1.4 / 1e-5 is 139999.99...: the slack keeps what is a multiple of the quantum.
        self._slack = (1.0 + 1e-12) / quantum if quantum > 0.0 else 0.0
        self._quantised_caps = np.minimum(np.floor(self._caps * self._slack) * quantum, self._caps)
        self._target: FloatArray | None = None
        self.reset()

    @property
    def gain(self) -> FloatArray | None:
        """Gain of the last step, shape (3, 6) or (3, 6 + 3 delay_steps); None before it."""
        return None if self._gain is None else self._gain.copy()

    @property
    def gain_solutions(self) -> int:
        """Number of Riccati equations solved so far."""
        return self._gain_solutions

    @property
    def disturbance_rtn(self) -> FloatArray:
        """Disturbing acceleration that is compensated, m/s2, shape (3,)."""
        return np.zeros(3) if self._observer is None else self._observer.disturbance_rtn

    def reset(self) -> None:
        """Forget the waiting commands; gain and disturbance stay."""
        self._stamp = None
        self._waiting.clear()
        self._waiting.extend(np.zeros(3) for _ in range(self.design.delay_steps))
        self._left_over = np.zeros(3)
        if self._observer is not None:
            self._observer.restart()

    def control(
        self,
        relative_state_rtn: npt.ArrayLike,
        state_chief_gcrf: npt.ArrayLike,
        target_rtn: npt.ArrayLike,
        stamp: int | None = None,
        covariance_rtn: npt.ArrayLike | None = None,
    ) -> ControlResult:
        """Compute the command for one state; to be called once per sample.

        Parameters
        ----------
        relative_state_rtn
            Position (m) and rotating-frame velocity (m/s) of the deputy in RTN, shape (6,).
        state_chief_gcrf
            Position (m) and velocity (m/s) of the chief in GCRF, shape (6,).
        target_rtn
            Wanted relative state in RTN, shape (6,).
        stamp
            Time of validity of the state in whole nanoseconds. If given, a gap or a jump between
            two calls empties the queue of waiting commands, because the thruster did not get
            those that were not computed.
        covariance_rtn
            Covariance of the relative state, shape (6, 6); None for the truth.

        Returns
        -------
        ControlResult
            With anything unusable in the input: zero acceleration, ``valid`` False and a reason.
            With a covariance out of bounds: the command that brakes, ``degraded`` says why.
            This method does not raise.
        """
        self._follow_stamp(stamp)
        with np.errstate(all="ignore"):
            try:
                relative_state = _usable_state(relative_state_rtn, "relative state")
                state_chief = _usable_state(state_chief_gcrf, "chief state")
                if norm(state_chief[:3]) < RADIUS_EARTH_JGM3:
                    raise ValueError("chief state: inside the Earth; is it in metres?")
                target = _usable_state(target_rtn, "target")
                covariance = None if covariance_rtn is None else usable_covariance(covariance_rtn)
                degraded = (
                    "" if covariance is None else self._bounds_reason(relative_state, covariance)
                )
                if degraded:
                    assert covariance is not None
                    wanted, feedforward = self._brake(relative_state, state_chief, covariance)
                else:
                    wanted, feedforward = self._track(
                        relative_state, state_chief, target, covariance
                    )
            except (ValueError, np.linalg.LinAlgError, ArithmeticError) as error:
                return self._refuse(str(error))
            if not is_finite(wanted):
                return self._refuse("command is not finite")
        acceleration = np.minimum(np.maximum(wanted, -self._caps), self._caps)
        saturated = acceleration.tolist() != wanted.tolist()
        if self._options.quantum > 0.0:
            acceleration = self._quantise(acceleration)
        acting = self._enqueue(acceleration - feedforward)
        if self._observer is not None and not degraded:
            self._observer.predict(acting, osculating_mean_motion(state_chief))
        return ControlResult(acceleration, saturated, True, degraded=degraded)

    def _follow_stamp(self, stamp: int | None) -> None:
        """Empty the queue of waiting commands unless the stamp is one sample after the last."""
        if stamp is None:
            return
        sample = round(self.design.sample_time * 1e9)
        if self._stamp is not None and stamp - self._stamp != sample:
            self.reset()
        self._stamp = stamp

    def _refuse(self, reason: str) -> ControlResult:
        """Command nothing and remember that nothing was commanded."""
        self._enqueue(np.zeros(3))
        if self._observer is not None:
            self._observer.restart()
        return ControlResult(np.zeros(3), False, False, " ".join(reason.split()))

    def _enqueue(self, acceleration: FloatArray) -> FloatArray:
        """Let a command wait, and return the one that acts in the coming sample, shape (3,)."""
        acting = self._waiting[0] if self._waiting else acceleration
        self._waiting.append(acceleration)
        return acting

    def _quantise(self, acceleration: FloatArray) -> FloatArray:
        """Return whole quanta towards zero, with what was left over before added.

        A quantum is given when a whole one is due. Rounded to the nearest, the thruster would
        answer its own ripple, at ten times the fuel.
        """
        quantum, slack, limit = self._options.quantum, self._slack, self._quantised_caps
        wanted = acceleration + self._left_over
        given = np.minimum(np.maximum(np.trunc(wanted * slack) * quantum, -limit), limit)
        # What the cap has cut off is not made up for.
        self._left_over = np.minimum(np.maximum(wanted - given, -quantum), quantum)
        return given + 0.0

    def _bounds_reason(self, relative_state: FloatArray, covariance: FloatArray) -> str:
        return sigma_reason(
            relative_state,
            covariance,
            self.design.maximum_sigma,
            self.design.maximum_sigma_ratio,
        )

    def _track(
        self,
        relative_state: FloatArray,
        state_chief: FloatArray,
        target: FloatArray,
        covariance: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the acceleration that leads to the target, and the part that holds it there."""
        feedforward = np.zeros(3)
        deviation = relative_state - target
        if self._options.feedforward:
            feedforward = target_acceleration(
                state_chief, target, self.design.delay_steps, self.design.sample_time, self._j2
            )
        disturbance = np.zeros(3)
        if self._observer is not None:
            deviation[3:] -= velocity_at_rest(state_chief, relative_state[:3], self._j2)
            if self._target is not None and target.tolist() != self._target.tolist():
                self._observer.restart()
            self._target = target
            deviation = self._observer.update(deviation, covariance)
            disturbance = self._observer.disturbance_rtn
        elif self._options.feedforward:
            deviation[3:] -= velocity_at_rest(state_chief, target[:3], self._j2)
        level = 0
        if self._schedule is not None and covariance is not None:
            level = self._schedule.update(relative_state, deviation, covariance)
        if self._options.braking_share > 0.0:
            deviation = self._shorten(deviation, weights_at_level(self._weights, level))
        feedback = self._feedback(relative_state, state_chief, deviation, disturbance, level)
        return feedback - disturbance + feedforward, feedforward

    def _shorten(self, deviation: FloatArray, weights: Weights) -> FloatArray:
        """Return a deviation to which the feedback answers with a speed that can be stopped.

        The feedback of a double integrator leads to the velocity (position gain / velocity gain)
        times the deviation, which here is at most sqrt(2 acceleration distance).
        """
        distance = norm(deviation[:3])
        position_gain = (weights.position / weights.control) ** 0.5
        velocity_gain = (weights.velocity / weights.control + 2.0 * position_gain) ** 0.5
        acceleration = self._options.braking_share * float(self._caps.min())
        longest = velocity_gain / position_gain * (2.0 * acceleration * distance) ** 0.5
        if distance <= longest:
            return deviation
        return np.concatenate((longest / distance * deviation[:3], deviation[3:]))

    def _brake(
        self, relative_state: FloatArray, state_chief: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the acceleration that removes the unsafe relative velocity."""
        if self._observer is not None:
            self._observer.restart()
        deviation = np.zeros(6)
        deviation[3:] = unsafe_velocity(relative_state, covariance)
        feedback = self._feedback(relative_state, state_chief, deviation, np.zeros(3), 0)
        if not deviation.any():
            feedback = np.zeros(3)
        return feedback, np.zeros(3)

    def _feedback(
        self,
        relative_state: FloatArray,
        state_chief: FloatArray,
        deviation: FloatArray,
        disturbance: FloatArray,
        level: int,
    ) -> FloatArray:
        """Return ``-K (x - x_d)`` with the gain of the design, shape (3,)."""
        weights = weights_at_level(self._weights, level)
        if self.design.design == "state_dependent":
            rates = frame_rates_rtn(state_chief)
            state_matrix = state_dependent_matrix(
                relative_state,
                norm(state_chief[:3]),
                float(rates.angular_velocity_rtn[2]),
                float(rates.angular_acceleration_rtn[2]),
            )
            self._gain = self._solved(riccati_gain(state_matrix, weights))
        elif self.design.design in ("delay_aware", "navigation_aware"):
            self._keep_gain(
                state_chief,
                level,
                lambda matrix: delayed_riccati_gain(
                    matrix, weights, self.design.sample_time, self.design.delay_steps
                ),
            )
            # What compensates a disturbance does not move the deputy.
            waiting = [command + disturbance for command in self._waiting]
            deviation = np.concatenate((deviation, *waiting))
        else:
            self._keep_gain(state_chief, level, lambda matrix: riccati_gain(matrix, weights))
        assert self._gain is not None
        return -(self._gain @ deviation)

    def _keep_gain(
        self, state_chief: FloatArray, level: int, solve: Callable[[FloatArray], FloatArray]
    ) -> None:
        """Take the gain of a level for the HCW model; solve if the mean motion has changed."""
        mean_motion = self.design.mean_motion
        if mean_motion is None:
            mean_motion = osculating_mean_motion(state_chief)
            change = abs(mean_motion - self._gain_mean_motion)
            if self._gains and change <= MEAN_MOTION_TOLERANCE * self._gain_mean_motion:
                mean_motion = self._gain_mean_motion
        if mean_motion != self._gain_mean_motion:
            self._gains.clear()
        if level not in self._gains:
            self._gains[level] = self._solved(solve(hcw_state_matrix(mean_motion)))
            self._gain_mean_motion = mean_motion
        self._gain = self._gains[level]

    def _solved(self, gain: FloatArray) -> FloatArray:
        """Count a solved gain and return it."""
        self._gain_solutions += 1
        return gain


def _usable_state(values: npt.ArrayLike, name: str) -> FloatArray:
    """Return six finite numbers or raise ValueError with the name of what is wrong."""
    try:
        state = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: not numeric") from None
    if state.shape != (6,):
        raise ValueError(f"{name}: shape (6,) expected, got {state.shape}")
    if not is_finite(state):
        raise ValueError(f"{name}: not finite")
    return state

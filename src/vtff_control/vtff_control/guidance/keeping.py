"""Keeping of a formation by pulses of an engine that has a smallest thrust and steps.

Every half orbit the mean relative elements are compared with the design; the least impulses of the
coming half orbit lead back to it, so that the drift of J2 carries the formation evenly about it,
and are planned anew several times on the way, with what the filter has learnt. The relative
semi-major axis gets the offset that stops the drift along-track. The first comparison comes as soon
as the filter knows where the drift leads: what is left of a reconfiguration drifts by decimetres in
a quarter of an orbit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_control.guidance.elements_estimator import ElementsEstimator
from vtff_dynamics.relative.impulses import Impulse, least_impulses
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements
from vtff_dynamics.relative.transition import j2_transition_matrix
from vtff_dynamics.vectors import FloatArray

__all__ = ["T5_ENGINE", "FormationKeeper", "KeepingEngine", "drift_is_known"]

_KNOWN_DRIFT = 0.03  # m: sigma of the mean longitude after the coming interval
_KNOWN_SHARE = 0.3  # the same as a share of where it leads
_REPLANNING = 0.1
"""Part of an interval after which the pulses that are left are planned anew."""
_LAST_PLANNING = 0.3
"""Part of an interval that has to be left for that: in less, pulses come where they are dear."""
_DEVIATION_PRICE = 2.0
"""See `least_impulses`: of all pulses that cost the least, the earliest."""
_PATIENT_PRICE = 0.01
"""This price where an engine is too weak for a return at once: propellant counts, then time."""
_QUICK_DUTY, _LARGEST_DUTY = 0.03, 0.25
"""Part of a span in which an axis thrusts at most, in a return at once and in a patient one.

Plans are of impulses, and are flown by pulses: where those are long, they come too late."""
_LONGEST_SPAN = 8.0
"""Longest span of a plan, in intervals, for an engine that is too weak for a return in one."""


@dataclass(frozen=True)
class KeepingEngine:
    """An engine that can be throttled.

    Parameters
    ----------
    largest, smallest, step
        Thrust on an axis and its steps, N.
    """

    largest: float
    smallest: float
    step: float

    def __post_init__(self) -> None:
        """Check the values."""
        if not 0.0 < self.step <= self.smallest <= self.largest < math.inf:
            raise ValueError(
                "step, smallest, largest: positive thrusts in this order expected, got "
                f"{self.step:g}, {self.smallest:g}, {self.largest:g} N"
            )

    def acceleration(self, wanted: npt.ArrayLike, mass: float) -> FloatArray:
        """Return the acceleration that the engine gives for a wanted one, m/s2, of any shape.

        Below half of the smallest thrust an axis is off.

        Parameters
        ----------
        wanted
            m/s2 on each axis.
        mass
            kg.
        """
        thrust = mass * np.asarray(wanted, dtype=float)
        size = np.abs(thrust)
        # Whole steps within the limits, which need not be whole themselves.
        fewest = math.ceil(self.smallest / self.step - 1e-9)
        most = math.floor(self.largest / self.step + 1e-9)
        fired = self.step * np.clip(np.rint(size / self.step), fewest, max(fewest, most))
        given: FloatArray = np.where(
            size < 0.5 * self.smallest, 0.0, np.copysign(fired, thrust) / mass
        )
        return given


T5_ENGINE = KeepingEngine(largest=25e-3, smallest=1e-3, step=12e-6)
"""QinetiQ T5: continuous throttling from 1 mN in steps of 12 uN (Edwards, Wallace, Tato and van Put
(2004), The T5 Ion Propulsion Assembly for Drag Compensation on GOCE, ESA SP-569); 25 mN is its
nominal largest thrust there and the limit of paper 002, table 1."""


def drift_is_known(keepers: Iterable[FormationKeeper]) -> bool:
    """Whether the filters of keepers know where the drift of the coming interval leads.

    Known is what is certain to some centimetres or to a part of the largest drift.

    Parameters
    ----------
    keepers
        Keepers with a common centre, which decide together: it moves with what each corrects.
    """
    drifts = [keeper.drift() for keeper in keepers if not math.isnan(keeper.estimator.time)]
    largest = max((abs(leads) for leads, _ in drifts), default=0.0)
    sigma = max((sigma for _, sigma in drifts), default=math.inf)
    return sigma <= max(_KNOWN_DRIFT, _KNOWN_SHARE * largest)


class FormationKeeper:
    """Pulses that keep one deputy on its design.

    Parameters
    ----------
    design
        Mean relative elements to keep, m, shape (6,).
    engine
        Thrust on each axis.
    mass
        kg.
    step
        Length for which thrust is constant, s; pulses are whole numbers of it.
    interval
        Between decisions, in orbits.
    longest_pulse
        s.
    estimator
        Filter of the relative elements; default a new one.

    Attributes
    ----------
    centre
        Relative elements of the orbit that the design is relative to, m, shape (6,); zero for that
        of the chief.
    engine_errors
        Matrix by which the true thrust of the engine exceeds the commanded one, shape (3, 3).
    """

    def __init__(
        self,
        design: npt.ArrayLike,
        engine: KeepingEngine,
        mass: float,
        step: float,
        interval: float = 0.5,
        longest_pulse: float = 300.0,
        estimator: ElementsEstimator | None = None,
    ) -> None:
        self.design = np.asarray(design, dtype=float)
        self.estimator = ElementsEstimator() if estimator is None else estimator
        self.centre = np.zeros(6)
        self.engine_errors: FloatArray = np.zeros((3, 3))
        self._engine = engine
        self._mass = mass
        self._step = step
        self._interval = interval
        self._longest = max(1, int(longest_pulse / step))
        self._ends = math.nan
        self._decided = math.nan
        self._has_decided = False
        self._schedule: dict[int, FloatArray] = {}

    def target(self) -> FloatArray:
        """Return the relative state of the design at the last update, m and m/s, shape (6,)."""
        wanted = self.design + self.centre
        return relative_state_of_mean_elements(self.estimator.chief_mean, wanted)

    def drift(self) -> tuple[float, float]:
        """Return where the drift of an interval leads along the track, and its sigma, m."""
        estimator = self.estimator
        transition = j2_transition_matrix(estimator.chief_mean, self._span)[1]
        leads = float(transition @ (estimator.elements - self.centre - self.design))
        return leads, math.sqrt(float(transition @ estimator.covariance @ transition))

    @property
    def _span(self) -> float:
        return self._interval * 2.0 * math.pi / self.estimator.mean_motion

    def command(self, time: float, may_begin: bool | None = None) -> FloatArray:
        """Return the thrust from a time on for one step, m/s2 in RTN, shape (3,).

        Parameters
        ----------
        time
            s, that of the last update of the estimator or later.
        may_begin
            Whether the first decision may be made before half an interval is over; default whether
            the keeper knows its own drift. See `drift_is_known`.
        """
        if math.isnan(self.estimator.time):
            return np.zeros(3)
        span = self._span
        if math.isnan(self._ends):
            self._ends = time + 0.5 * span
        if may_begin is None:
            may_begin = drift_is_known([self])
        begins = may_begin and not self._has_decided
        if begins or time >= self._ends:
            self._has_decided = True
            self._decide(time, span)
        elif (
            self._has_decided
            and time - self._decided >= _REPLANNING * span
            and self._ends - time >= _LAST_PLANNING * span
        ):
            self._decide(time, self._ends - time)
        return self._schedule.pop(round(time / self._step), np.zeros(3))

    def _decide(self, time: float, span: float) -> None:
        """Plan the pulses from a time on for a span, s, or a longer one if the engine is weak."""
        self._decided = time
        impulses = self._plan(span, _DEVIATION_PRICE)
        if not self._can_fly(impulses, _QUICK_DUTY * span):
            span = self._span
            impulses = self._plan(span, _PATIENT_PRICE)
            longest = _LONGEST_SPAN * self._span
            while span < longest and not self._can_fly(impulses, _LARGEST_DUTY * span):
                span *= 2.0
                impulses = self._plan(span, _PATIENT_PRICE)
        self._ends = time + span
        latitude = float(self.estimator.chief_mean[1])
        self._schedule.clear()
        free_from = [math.ceil(time / self._step)] * 3
        for impulse in impulses:
            moment = time + (impulse.mean_latitude - latitude) / self.estimator.mean_motion
            self._add_pulses(impulse, moment, free_from)

    def _can_fly(self, impulses: Sequence[Impulse], time: float) -> bool:
        """Whether the engine gives impulses in that time of thrust on each axis, s."""
        size = np.sum([np.abs(impulse.velocity_rtn) for impulse in impulses], axis=0)
        return float(np.max(size)) * self._mass <= time * self._engine.largest

    def _plan(self, span: float, price: float) -> list[Impulse]:
        """Return the impulses that lead back to the design within a span from now, s."""
        estimator = self.estimator
        # The offset of the semi-major axis under which the mean longitude stays.
        centred = self.design.copy()
        interval = j2_transition_matrix(estimator.chief_mean, self._span)
        drift = interval @ centred - centred
        centred[0] -= drift[1] / interval[1, 0]
        drift = (interval @ centred - centred) * (span / self._span)
        transition = j2_transition_matrix(estimator.chief_mean, span)
        change = centred - transition @ (estimator.elements - self.centre)
        latitude = float(estimator.chief_mean[1])
        turn = span * estimator.mean_motion
        return least_impulses(
            change,
            estimator.mean_motion,
            latitude,
            latitude + turn,
            samples=61,
            deviation_price=price,
            drift=drift,
        )

    def _add_pulses(self, impulse: Impulse, moment: float, free_from: list[int]) -> None:
        """Put the pulses of an impulse about a moment into the schedule.

        The pulses of an axis follow one another; `free_from` is the step after the last pulse of
        each axis.
        """
        engine = self._engine
        limits = (engine.smallest, engine.step, engine.largest)
        smallest, step, strongest = (limit / self._mass for limit in limits)
        commanded = np.linalg.solve(np.eye(3) + self.engine_errors, impulse.velocity_rtn)
        for axis, size in enumerate(commanded.tolist()):
            count = min(self._longest, int(abs(size) / (smallest * self._step)))
            if count == 0:
                continue  # less than the smallest pulse: the next decision sees it again
            # Rather a longer pulse than less than planned.
            count = max(count, math.ceil(abs(size) / (strongest * self._step)))
            level = step * round(abs(size) / (count * self._step) / step)
            level = min(max(level, smallest), strongest)
            first = round((moment - 0.5 * count * self._step) / self._step)
            first = max(first, free_from[axis])
            free_from[axis] = first + count
            for index in range(first, min(first + count, math.ceil(self._ends / self._step))):
                thrust = self._schedule.setdefault(index, np.zeros(3))
                thrust[axis] = math.copysign(level, size)

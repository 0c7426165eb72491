"""Flight of one deputy on one time axis: position, target and thrust."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from vtff_analysis.recordings.history import (
    AccelerationHistory,
    DeputyHistory,
    RelativeStateHistory,
    TimeArray,
    seconds_since,
)
from vtff_analysis.recordings.settings import ControllerSettings
from vtff_dynamics.vectors import FloatArray

__all__ = ["ACQUISITION_DURATION", "SETTLED_AFTER", "FormationFlight", "formation_flight"]

ACQUISITION_DURATION = 125.0
"""Formation keeping begins this many s after the controller (Peng and others, appendix A.1)."""

SETTLED_AFTER = 600.0
"""Formation keeping is judged without the tail of the acquisition so many s after the controller's
start: at 125 s that is still millimetres, for minutes."""

_DEFAULT_STEP = 1.0  # s, where a single message leaves the step open


@dataclass(frozen=True, eq=False)
class FormationFlight:
    """Flight of one deputy on the time axis of the run; plots and summary are made from it.

    Attributes
    ----------
    name
        Name of the deputy.
    source
        Where `position_rtn` comes from: ``true`` or ``navigated``.
    time
        Times of the states in s since the start of the run, shape (n,).
    position_rtn
        Position relative to the chief in m, shape (n, 3); the estimate where truth is missing.
    deviation_rtn
        Position minus target in m, shape (n, 3); None without a target.
    target_rtn
        Target in force at the end in m, shape (3,); None without a target.
    estimate_time, estimate_rtn
        Times in s, shape (k,), and navigated positions in m, shape (k, 3); None without them.
    thrust_time
        Starts of the applied thrust within the run in s, shape (m,).
    thrust_rtn
        Applied acceleration in m/s2, shape (m, 3).
    thrust_duration
        Time for which each acceleration acts within the run in s, shape (m,).
    keeping_start
        Begin of the keeping phase in s.
    """

    name: str
    source: str
    time: FloatArray
    position_rtn: FloatArray
    deviation_rtn: FloatArray | None
    target_rtn: FloatArray | None
    estimate_time: FloatArray | None
    estimate_rtn: FloatArray | None
    thrust_time: FloatArray
    thrust_rtn: FloatArray
    thrust_duration: FloatArray
    keeping_start: float

    @property
    def keeping(self) -> slice:
        """States of the keeping phase."""
        return slice(int(np.searchsorted(self.time, self.keeping_start)), None)

    @property
    def settled_start(self) -> float:
        """Begin of the part of the keeping phase without a tail of the acquisition in s."""
        return self.keeping_start - ACQUISITION_DURATION + SETTLED_AFTER

    def until(self, end: float) -> FormationFlight:
        """Return the flight up to a time in s, the thrust that acts beyond it cut off."""
        states = self.time <= end
        thrust = self.thrust_time < end
        return dataclasses.replace(
            self,
            time=self.time[states],
            position_rtn=self.position_rtn[states],
            deviation_rtn=None if self.deviation_rtn is None else self.deviation_rtn[states],
            thrust_time=self.thrust_time[thrust],
            thrust_rtn=self.thrust_rtn[thrust],
            thrust_duration=np.minimum(
                self.thrust_duration[thrust], end - self.thrust_time[thrust]
            ),
        )

    def minimum_in_track(self) -> tuple[float, float]:
        """Return the smallest in-track position in m and its time in s."""
        index = int(np.argmin(self.position_rtn[:, 1]))
        return float(self.position_rtn[index, 1]), float(self.time[index])


def formation_flight(
    history: DeputyHistory, settings: ControllerSettings | None = None
) -> FormationFlight | None:
    """Bring the history of a deputy on one time axis.

    Parameters
    ----------
    history
        Recorded arrays.
    settings
        Settings of the deputy's controller; their target holds until one is published.

    Returns
    -------
    FormationFlight or None
        None if no relative state was recorded.
    """
    states = history.truth or history.estimate
    if states is None:
        return None
    start, end = int(states.time[0]), int(states.time[-1])
    targets = _targets_in_force(states.time, history.target, settings)
    thrust_time, thrust, duration = _thrust_within(history.applied, start, end)
    estimate = history.estimate if history.truth is not None else None
    controlled = history.command or history.applied
    return FormationFlight(
        name=history.name,
        source="true" if history.truth is not None else "navigated",
        time=seconds_since(start, states.time),
        position_rtn=states.position_rtn,
        deviation_rtn=None if targets is None else states.position_rtn - targets,
        target_rtn=None if targets is None else targets[-1],
        estimate_time=None if estimate is None else seconds_since(start, estimate.time),
        estimate_rtn=None if estimate is None else estimate.position_rtn,
        thrust_time=thrust_time,
        thrust_rtn=thrust,
        thrust_duration=duration,
        keeping_start=_control_start(controlled, start) + ACQUISITION_DURATION,
    )


def _control_start(controlled: AccelerationHistory | None, start: int) -> float:
    """Return the time in s at which control starts: that of the first non-zero acceleration.

    While navigation starts, the controller sends zeros.
    """
    if controlled is None:
        return 0.0
    acting = np.flatnonzero(np.any(controlled.acceleration_rtn != 0.0, axis=1))
    first = int(acting[0]) if len(acting) else 0
    return float(seconds_since(start, controlled.time[first : first + 1])[0])


def _targets_in_force(
    time: TimeArray,
    published: RelativeStateHistory | None,
    settings: ControllerSettings | None,
) -> FloatArray | None:
    """Return the target at each time, shape (n, 3): the newest published one, else the set one."""
    configured = settings.target_position_rtn if settings is not None else None
    if published is None:
        return None if configured is None else np.tile(configured, (len(time), 1))
    newest = np.searchsorted(published.time, time, side="right") - 1
    before = published.position_rtn[0] if configured is None else configured
    targets = published.position_rtn[np.maximum(newest, 0)]
    return np.where((newest < 0)[:, np.newaxis], before, targets)


def _thrust_within(
    applied: AccelerationHistory | None, start: int, end: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return start times (s), accelerations and durations (s) of the thrust within the run."""
    if applied is None:
        return np.empty(0), np.empty((0, 3)), np.empty(0)
    times = seconds_since(start, applied.time)
    step = float(np.median(np.diff(times))) if len(times) > 1 else _DEFAULT_STEP
    run_end = (end - start) * 1e-9
    duration = np.clip(np.minimum(times + step, run_end) - np.maximum(times, 0.0), 0.0, step)
    within = duration > 0.0
    return times[within], applied.acceleration_rtn[within], duration[within]

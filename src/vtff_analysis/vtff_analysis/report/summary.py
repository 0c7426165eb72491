"""Summary of a run: a flat dictionary of numbers, documented key by key in docs/summary.md."""

from __future__ import annotations

import datetime
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.history import (
    AXES,
    AccelerationHistory,
    DeputyHistory,
    FloatArray,
    RelativeStateHistory,
    RunHistory,
    TimeArray,
)
from vtff_analysis.recordings.settings import ControllerSettings, RunSettings
from vtff_analysis.report.gnss_summary import summarise_receiver

ACQUISITION_DURATION = 125.0
"""Formation keeping begins this many s after the controller (Peng and others, appendix A.1)."""

SETTLED_WITHIN = 1.0
"""Largest deviation from the target in m that counts as settled (section 4.1 of the same paper)."""

NAVIGATION_START_DURATION = 60.0
"""s after its first solution in which the errors of navigation are those of its start; the paper
starts its filter with as many seconds of code (section 3.4)."""

DEFAULT_STEP = 1.0  # s, where a single message leaves the step open

Summary = dict[str, Any]


@dataclass(frozen=True, eq=False)
class FormationFlight:
    """Flight of one deputy on the time axis of the run; what plots and summary are made of.

    Attributes
    ----------
    name
        Name of the deputy.
    source
        What `position_rtn` is: ``true`` or ``navigated``.
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
        Time for which each acts within the run in s, shape (m,).
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
        Gives the target until one was published.

    Returns
    -------
    FormationFlight or None
        None if no relative state was recorded.
    """
    states = history.truth or history.estimate
    if states is None:
        return None
    start, end = int(states.time[0]), int(states.time[-1])
    targets = _targets(states.time, history.target, settings)
    thrust_time, thrust, duration = _thrust_within(history.applied, start, end)
    estimate = history.estimate if history.truth is not None else None
    controlled = history.command or history.applied
    return FormationFlight(
        name=history.name,
        source="true" if history.truth is not None else "navigated",
        time=_seconds(states.time, start),
        position_rtn=states.position_rtn,
        deviation_rtn=None if targets is None else states.position_rtn - targets,
        target_rtn=None if targets is None else targets[-1],
        estimate_time=None if estimate is None else _seconds(estimate.time, start),
        estimate_rtn=None if estimate is None else estimate.position_rtn,
        thrust_time=thrust_time,
        thrust_rtn=thrust,
        thrust_duration=duration,
        keeping_start=_control_start(controlled, start) + ACQUISITION_DURATION,
    )


def summarise_run(
    history: RunHistory, settings: RunSettings, flights: Mapping[str, FormationFlight]
) -> Summary:
    """Summarise a run.

    Parameters
    ----------
    history
        The recorded run.
    settings
        Its settings.
    flights
        `formation_flight` of each deputy that has one.

    Returns
    -------
    dict
        Flat; text, numbers, booleans, or None for a number that does not exist (for example
        the settling time of a run that never settles). Keys of a part that the run does not
        have are absent.
    """
    summary = _summarise_simulation(history, settings)
    for name, flight in flights.items():
        prefix = f"{key_part(name)}_" if len(flights) > 1 else ""
        part = summarise_flight(flight)
        part.update(_summarise_control(history.deputies[name], settings.controller(name)))
        part.update(_summarise_navigation(history.deputies[name]))
        summary.update({prefix + key: value for key, value in part.items()})
    for receiver in history.receivers.values():
        prefix = f"{key_part(receiver.name)}_"
        part = summarise_receiver(receiver)
        summary.update({prefix + key: value for key, value in part.items()})
    summary["message_count"] = sum(history.message_counts.values())
    for topic, count in sorted(history.message_counts.items()):
        summary[f"message_count_{key_part(topic)}"] = count
    return {key: plain(value) for key, value in summary.items()}


def key_part(name: str) -> str:
    """Return a topic or spacecraft name as part of a key: ``/sim/status`` -> ``sim_status``."""
    return name.strip("/").replace("/", "_").lower()


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it; None for a number that is not finite."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, pathlib.PurePath):
        return str(value)
    return value


def utc_text(time: int) -> str:
    """Return ns since 1970 as ISO 8601 text in UTC to the millisecond."""
    seconds, nanoseconds = divmod(time, 1_000_000_000)
    moment = datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc)  # noqa: UP017 (3.10)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{nanoseconds // 1_000_000:03d}Z"


def summarise_flight(flight: FormationFlight) -> Summary:
    """Summarise positions and thrust of one deputy; keys without the deputy's name."""
    summary: Summary = {"keeping_start_time_s": flight.keeping_start}
    for column, axis in enumerate(AXES):
        summary[f"initial_{axis}_m"] = flight.position_rtn[0, column]
        summary[f"final_{axis}_m"] = flight.position_rtn[-1, column]
    summary["minimum_in_track_m"], summary["minimum_in_track_time_s"] = flight.minimum_in_track()
    separation = np.linalg.norm(flight.position_rtn, axis=1)
    closest = int(np.argmin(separation))
    summary["minimum_separation_m"] = separation[closest]
    summary["minimum_separation_time_s"] = flight.time[closest]
    summary.update(_summarise_settling(flight))
    summary.update(_summarise_keeping(flight))
    summary.update(_summarise_thrust(flight))
    return summary


def _summarise_simulation(history: RunHistory, settings: RunSettings) -> Summary:
    filled = history.end_time > history.start_time > 0
    duration = (history.end_time - history.start_time) * 1e-9 if filled else 0.0
    summary: Summary = {}
    if history.start_time > 0:
        summary["run_start_utc"] = utc_text(history.start_time)
    simulator = history.simulator
    if simulator is not None:
        duration = simulator.time_into_run
        summary["scenario"] = simulator.scenario
        summary["pacing"] = simulator.pacing
        summary["run_complete"] = simulator.complete
        summary["real_time_factor"] = simulator.real_time_factor
        summary["late_commands"] = simulator.late_commands
    if settings.seed is not None:
        summary["run_seed"] = settings.seed
    summary["run_duration_s"] = duration
    return summary


def _summarise_settling(flight: FormationFlight) -> Summary:
    if flight.deviation_rtn is None or flight.target_rtn is None:
        return {}
    distance = np.linalg.norm(flight.deviation_rtn, axis=1)
    summary: Summary = {"settling_time_s": _settling_time(flight.time, distance)}
    for column, axis in enumerate(AXES):
        summary[f"target_{axis}_m"] = flight.target_rtn[column]
        summary[f"settling_time_{axis}_s"] = _settling_time(
            flight.time, np.abs(flight.deviation_rtn[:, column])
        )
    return summary


def _settling_time(time: FloatArray, deviation: FloatArray) -> float | None:
    """Return from when on the deviation stays small to the end; None if it does not."""
    outside = np.flatnonzero(deviation > SETTLED_WITHIN)
    if outside.size == 0:
        return float(time[0])
    if outside[-1] == len(time) - 1:
        return None
    return float(time[outside[-1] + 1])


def _summarise_keeping(flight: FormationFlight) -> Summary:
    """Statistics of the keeping phase as in table A1 of the paper; empty for a shorter run."""
    position = flight.position_rtn[flight.keeping]
    if len(position) == 0:
        return {}
    summary: Summary = {}
    for column, axis in enumerate(AXES):
        summary[f"keeping_{axis}_maximum_m"] = position[:, column].max()
        summary[f"keeping_{axis}_minimum_m"] = position[:, column].min()
        summary[f"keeping_{axis}_mean_m"] = position[:, column].mean()
        summary[f"keeping_{axis}_standard_deviation_m"] = position[:, column].std()
        if flight.deviation_rtn is not None:
            deviation = flight.deviation_rtn[flight.keeping, column]
            summary[f"keeping_{axis}_rms_m"] = _rms(deviation)
    return summary


def _summarise_thrust(flight: FormationFlight) -> Summary:
    """Sum |acceleration| times duration; a thrust belongs to the phase in which it starts."""
    if flight.thrust_time.size == 0:
        return {}
    spent = np.abs(flight.thrust_rtn) * flight.thrust_duration[:, np.newaxis]
    keeping = flight.thrust_time >= flight.keeping_start
    phases = {"total": spent, "acquisition": spent[~keeping]}
    if flight.time[-1] >= flight.keeping_start:
        phases["keeping"] = spent[keeping]
    summary: Summary = {}
    for phase, values in phases.items():
        for column, axis in enumerate(AXES):
            summary[f"delta_v_{phase}_{axis}_m_per_s"] = values[:, column].sum()
    for column, axis in enumerate(AXES):
        peak = np.abs(flight.thrust_rtn[:, column]).max()
        summary[f"peak_acceleration_{axis}_m_per_s2"] = peak
    return summary


def _summarise_control(history: DeputyHistory, settings: ControllerSettings) -> Summary:
    summary: Summary = {}
    if history.command is not None:
        summary["control_input"] = "truth" if history.estimate is None else "navigation"
    known = {
        "controller_design": settings.design,
        "controller_feedforward": settings.feedforward,
        "acceleration_cap_m_per_s2": settings.acceleration_cap,
    }
    summary.update({key: value for key, value in known.items() if value is not None})
    return summary


def _summarise_navigation(history: DeputyHistory) -> Summary:
    """Estimate minus truth where both have the same time."""
    if history.truth is None or history.estimate is None:
        return {}
    _, in_truth, in_estimate = np.intersect1d(
        history.truth.time, history.estimate.time, assume_unique=True, return_indices=True
    )
    if in_truth.size == 0:
        return {}
    error = history.estimate.position_rtn[in_estimate] - history.truth.position_rtn[in_truth]
    summary: Summary = {"navigation_error_samples": in_truth.size}
    for column, axis in enumerate(AXES):
        summary[f"navigation_error_{axis}_mean_m"] = error[:, column].mean()
        summary[f"navigation_error_{axis}_rms_m"] = _rms(error[:, column])
    summary["navigation_error_maximum_m"] = np.linalg.norm(error, axis=1).max()
    settled = is_settled(_seconds(history.estimate.time[in_estimate], history.estimate.time[0]))
    if settled.any():
        rate = history.estimate.velocity_rtn[in_estimate] - history.truth.velocity_rtn[in_truth]
        summary["navigation_error_settled_3d_rms_m"] = _rms_3d(error[settled])
        summary["navigation_error_settled_3d_rms_m_per_s"] = _rms_3d(rate[settled])
    return summary


def is_settled(time: FloatArray) -> npt.NDArray[np.bool_]:
    """Tell which errors of navigation count when its start does not; `time` in s since then."""
    return time >= NAVIGATION_START_DURATION


def _rms_3d(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _control_start(controlled: AccelerationHistory | None, start: int) -> float:
    """Return the time of the first acceleration in s; while navigation starts all are zero."""
    if controlled is None:
        return 0.0
    acting = np.flatnonzero(np.any(controlled.acceleration_rtn != 0.0, axis=1))
    first = int(acting[0]) if len(acting) else 0
    return float(_seconds(controlled.time[first : first + 1], start)[0])


def _targets(
    time: TimeArray,
    published: RelativeStateHistory | None,
    settings: ControllerSettings | None,
) -> FloatArray | None:
    """Return the target in force at each time, shape (n, 3): the newest published, else set."""
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
    times = _seconds(applied.time, start)
    step = float(np.median(np.diff(times))) if len(times) > 1 else DEFAULT_STEP
    run_end = (end - start) * 1e-9
    duration = np.clip(np.minimum(times + step, run_end) - np.maximum(times, 0.0), 0.0, step)
    within = duration > 0.0
    return times[within], applied.acceleration_rtn[within], duration[within]


def _seconds(time: TimeArray, start: int) -> FloatArray:
    """Return seconds since the start; the difference is exact before it becomes a float."""
    return np.asarray((time - start) * 1e-9)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""Summary of a run: a flat dictionary of numbers, documented key by key in docs/summary.md.

A further number: here, in docs/summary.md and, for campaigns, `vtff_analysis.studies.figures`.
`vtff_analysis.report.write` adds the numbers of the ionosphere and of the flight fed with truth,
and draws the pictures.
"""

from __future__ import annotations

import datetime
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vtff_analysis.cluster.cluster_flight import cluster_of_run, summarise_cluster
from vtff_analysis.evaluation.attitude import summarise_attitude
from vtff_analysis.evaluation.deputy_pairs import normalised_error, summarise_pairs
from vtff_analysis.evaluation.formation_flight import FormationFlight
from vtff_analysis.evaluation.gnss_summary import summarise_receiver
from vtff_analysis.evaluation.guidance import summarise_guidance
from vtff_analysis.evaluation.navigation import navigation_error
from vtff_analysis.evaluation.safety import summarise_safety
from vtff_analysis.recordings.history import AXES, DeputyHistory, HealthItem, RunHistory
from vtff_analysis.recordings.settings import ControllerSettings, RunSettings
from vtff_analysis.recordings.topics import key_part
from vtff_analysis.survey.figures import summarise_survey
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "SETTLED_WITHIN",
    "Summary",
    "plain_value",
    "summarise_flight",
    "summarise_run",
    "utc_text",
]

SETTLED_WITHIN = 1.0
"""Largest deviation from the target in m that counts as settled (Peng and others, section 4.1)."""

_FRAMES_DAMAGED = ("CRC-bad", "dropped")
"""Counts that a receiver driver reports on /diagnostics."""

_LATE_CALLS = "late calls"
"""Count that a node reports on /diagnostics whose plug-in is slower than real time."""

Summary = dict[str, Any]


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
        the settling time of a run that never settles). Keys of a subject that the run does not
        have are absent.
    """
    summary = _summarise_simulation(history, settings)
    cluster = cluster_of_run(history)
    for name, flight in flights.items():
        prefix = f"{key_part(name)}_" if len(flights) > 1 else ""
        numbers = summarise_flight(flight)
        decides_alone = cluster is not None and f"/{name}/neighbours" in history.message_counts
        controller = settings.controller(name)
        numbers.update(_summarise_control(history.deputies[name], controller, decides_alone))
        numbers.update(_summarise_navigation(history.deputies[name]))
        summary.update({prefix + key: value for key, value in numbers.items()})
    summary.update(summarise_pairs({name: history.deputies[name] for name in flights}))
    for receiver in history.receivers.values():
        prefix = f"{key_part(receiver.name)}_"
        numbers = summarise_receiver(receiver)
        summary.update({prefix + key: value for key, value in numbers.items()})
    summary.update(_summarise_receiver_logs(history.health))
    summary.update(_summarise_late_calls(history.health))
    summary.update(summarise_safety(history.safety, history.start_time))
    summary.update(summarise_guidance(history))
    summary.update(summarise_survey(history.survey))
    summary.update(summarise_cluster(cluster))
    summary.update(summarise_attitude(history.attitude, history.start_time))
    summary["message_count"] = sum(history.message_counts.values())
    for topic, count in sorted(history.message_counts.items()):
        summary[f"message_count_{key_part(topic)}"] = count
    return {key: plain_value(value) for key, value in summary.items()}


def _summarise_receiver_logs(health: Sequence[HealthItem]) -> Summary:
    """Return the logs of all receiver drivers that were damaged or of an unknown kind."""
    streams = [item.values for item in health if _FRAMES_DAMAGED[0] in item.values]
    if not streams:
        return {}
    return {
        "receiver_logs_damaged": sum(
            int(values.get(name, 0)) for values in streams for name in _FRAMES_DAMAGED
        ),
        "receiver_logs_undecoded": sum(int(values.get("unknown", 0)) for values in streams),
    }


def _summarise_late_calls(health: Sequence[HealthItem]) -> Summary:
    """Return how often algorithms took longer than the time between their samples."""
    slow = [item.values for item in health if _LATE_CALLS in item.values]
    if not slow:
        return {}
    shares = [int(values[_LATE_CALLS]) / max(1, int(values["calls"])) for values in slow]
    return {
        "late_calls_percent": 100.0 * max(shares),
        "late_calls_longest_s": max(float(values["longest call, s"]) for values in slow),
    }


def plain_value(value: Any) -> Any:
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
    seconds, nanoseconds = divmod(time, NANOSECONDS_PER_SECOND)
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
    summary.update(_summarise_settled_keeping(flight))
    summary.update(_summarise_thrust(flight))
    return summary


def _summarise_simulation(history: RunHistory, settings: RunSettings) -> Summary:
    has_times = history.end_time > history.start_time > 0
    duration = (history.end_time - history.start_time) * 1e-9 if has_times else 0.0
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
    if settings.receivers is not None:
        summary["receivers"] = settings.receivers
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
    """Return the statistics of table A1 of the paper; empty for a run without a keeping phase."""
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


def _summarise_settled_keeping(flight: FormationFlight) -> Summary:
    """Return deviation and fuel without the tail of the acquisition; empty for a shorter run."""
    start, end = flight.settled_start, float(flight.time[-1])
    if start >= end:
        return {}
    summary: Summary = {}
    if flight.deviation_rtn is not None:
        deviation = flight.deviation_rtn[int(np.searchsorted(flight.time, start)) :]
        for column, axis in enumerate(AXES):
            summary[f"settled_keeping_{axis}_rms_m"] = _rms(deviation[:, column])
    if flight.thrust_time.size > 0:
        spent = np.abs(flight.thrust_rtn).sum(axis=1) * flight.thrust_duration
        hours = (end - start) / 3600.0
        total = spent[flight.thrust_time >= start].sum()
        summary["settled_keeping_delta_v_m_per_s_per_h"] = total / hours
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


def _summarise_control(
    history: DeputyHistory, settings: ControllerSettings, decides_alone: bool
) -> Summary:
    summary: Summary = {}
    if history.command is not None:
        summary["control_input"] = "truth" if history.estimate is None else "navigation"
        if decides_alone:
            summary["control_input"] = "own sensor"
    values = {
        "controller_design": settings.design,
        "controller_feedforward": settings.feedforward,
        "acceleration_cap_m_per_s2": settings.acceleration_cap,
    }
    summary.update({key: value for key, value in values.items() if value is not None})
    return summary


def _summarise_navigation(history: DeputyHistory) -> Summary:
    """Summarise the estimate minus the truth where both have the same time."""
    error = navigation_error(history)
    if error is None:
        return {}
    position, velocity = error.position_rtn, error.velocity_rtn
    summary: Summary = {"navigation_error_samples": len(position)}
    for column, axis in enumerate(AXES):
        summary[f"navigation_error_{axis}_mean_m"] = position[:, column].mean()
        summary[f"navigation_error_{axis}_rms_m"] = _rms(position[:, column])
    summary["navigation_error_maximum_m"] = np.linalg.norm(position, axis=1).max()
    settled = error.is_settled
    if settled.any():
        summary["navigation_error_settled_samples"] = int(np.count_nonzero(settled))
        summary["navigation_error_settled_3d_rms_m"] = _rms_3d(position[settled])
        summary["navigation_error_settled_3d_rms_m_per_s"] = _rms_3d(velocity[settled])
        covariance = error.position_covariance_rtn[settled]
        summary["navigation_error_settled_nees"] = normalised_error(position[settled], covariance)
    return summary


def _rms_3d(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))

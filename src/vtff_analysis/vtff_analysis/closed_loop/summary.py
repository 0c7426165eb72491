"""Figures of a closed loop without ROS, under the names that the report of a run gives them."""

from __future__ import annotations

from typing import Any

import numpy as np

from vtff_analysis.closed_loop.simulation import ClosedLoopResult
from vtff_analysis.evaluation.formation_flight import ACQUISITION_DURATION, FormationFlight
from vtff_analysis.evaluation.summary import plain_value, summarise_flight
from vtff_analysis.recordings.history import AXES

__all__ = ["summarise_closed_loop"]


def summarise_closed_loop(result: ClosedLoopResult) -> dict[str, Any]:
    """Return the figures of a closed loop; with more than one deputy under the deputy's name."""
    summary: dict[str, Any] = {}
    for name in result.deputies:
        flight = summarise_flight(_flight(result, name))
        totals = result.total_delta_v(name)
        for axis, total in zip(AXES, totals, strict=True):
            flight[f"delta_v_total_{axis}_m_per_s"] = total
        prefix = f"{name}_" if len(result.deputies) > 1 else ""
        summary.update({prefix + key: plain_value(value) for key, value in flight.items()})
    return summary


def _flight(result: ClosedLoopResult, name: str) -> FormationFlight:
    history = result.deputies[name]
    position = history.state_relative_rtn[:, :3]
    acting = np.flatnonzero(np.any(history.command_rtn != 0.0, axis=1))
    start = float(result.time[acting[0]]) if len(acting) else 0.0
    return FormationFlight(
        name=name,
        source="true",
        time=result.time,
        position_rtn=position,
        deviation_rtn=position - history.target_rtn[:3],
        target_rtn=history.target_rtn[:3],
        estimate_time=None,
        estimate_rtn=None,
        thrust_time=result.time[:-1],
        thrust_rtn=history.applied_rtn,
        thrust_duration=np.full(len(history.applied_rtn), result.step),
        keeping_start=start + ACQUISITION_DURATION,
    )

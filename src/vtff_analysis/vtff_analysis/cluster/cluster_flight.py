"""Flight of a cluster, of a study or of a run: sides, closest approach, settling, price."""

from __future__ import annotations

import functools
import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vtff_analysis.recordings.history import RunHistory, seconds_since
from vtff_control.cluster.potential_field import equilibrium_distance
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "LEAD_RADIUS",
    "ClusterFlight",
    "cluster_of_run",
    "describe_cluster",
    "summarise_cluster",
]

LEAD_RADIUS = 6678e3
"""Radius of the lead's orbit, m: table 1 of paper 001."""

_SENSOR_TOPIC = re.compile(r"^/(?P<chaser>.+)/neighbours$")


@dataclass(frozen=True, eq=False)
class ClusterFlight:
    """Flight of a lead, which never thrusts, and chasers.

    Attributes
    ----------
    times
        s, shape (k,).
    positions
        In the RTN frame of the lead, which is the first, m, shape (k, m, 3).
    impulses
        Velocity changes of the chasers, m/s, shape (k, m - 1, 3).
    period
        Length of an orbit, s.
    """

    times: FloatArray
    positions: FloatArray
    impulses: FloatArray
    period: float = field(default=2.0 * math.pi * math.sqrt(LEAD_RADIUS**3 / GM_EARTH))

    @property
    def sides(self) -> FloatArray:
        """Distances of all pairs, m, shape (k, pairs)."""
        pairs = itertools.combinations(range(self.positions.shape[1]), 2)
        sides: FloatArray = np.array(
            [np.linalg.norm(self.positions[:, j] - self.positions[:, i], axis=1) for i, j in pairs]
        ).T
        return sides

    @property
    def closest(self) -> float:
        """Smallest distance of a pair, m."""
        pairs = itertools.combinations(range(self.positions.shape[1]), 2)
        return min(closest_on_path(self.positions[:, j] - self.positions[:, i]) for i, j in pairs)

    @property
    def last_orbit(self) -> slice:
        """Samples of the last orbit."""
        return slice(int(np.searchsorted(self.times, self.times[-1] - self.period)), None)

    def settling_time(self, share: float = 0.025) -> float:
        """Return the time after which all sides stay within a share of the equilibrium, s."""
        wanted = equilibrium_distance()
        outside = np.flatnonzero((np.abs(self.sides / wanted - 1.0) > share).any(axis=1))
        if not len(outside):
            return 0.0
        last = int(outside[-1]) + 1
        return float(self.times[last]) if last < len(self.times) else math.inf

    def velocity_change(self, start: float, end: float) -> FloatArray:
        """Return the sum of the impulses of each chaser in a span, m/s, shape (m - 1,)."""
        chosen = (self.times >= start) & (self.times < end)
        change: FloatArray = np.linalg.norm(self.impulses[chosen], axis=2).sum(axis=0)
        return change


def cluster_of_run(history: RunHistory) -> ClusterFlight | None:
    """Return the flight of a recorded cluster; None for a run of another kind.

    Parameters
    ----------
    history
        The run; chasers are the deputies whose sensor topics it has.
    """
    topics = [_SENSOR_TOPIC.match(topic) for topic in history.message_counts]
    names = sorted(match["chaser"] for match in topics if match is not None)
    deputies = [history.deputies[name] for name in names if name in history.deputies]
    truths = [deputy.truth for deputy in deputies if deputy.truth is not None]
    thrusts = [deputy.applied for deputy in deputies if deputy.applied is not None]
    if not names or len(truths) < len(names) or len(thrusts) < len(names):
        return None
    common = functools.reduce(np.intersect1d, [truth.time for truth in truths])
    if len(common) < 2:
        return None
    step = seconds_since(int(common[0]), common[1:2])[0]
    positions = np.zeros((len(common), len(names) + 1, 3))
    impulses = np.zeros((len(common), len(names), 3))
    for column, (truth, thrust) in enumerate(zip(truths, thrusts, strict=True)):
        rows = np.searchsorted(truth.time, common)
        positions[:, column + 1] = truth.position_rtn[rows]
        _, at, given = np.intersect1d(common, thrust.time, return_indices=True)
        impulses[at, column] = step * thrust.acceleration_rtn[given]
    fixes = [history.receivers[name].fix_position_itrf for name in names]
    radius = float(np.linalg.norm(np.concatenate(fixes), axis=1).mean())
    period = 2.0 * math.pi * math.sqrt(radius**3 / GM_EARTH)
    return ClusterFlight(seconds_since(int(common[0]), common), positions, impulses, period)


def summarise_cluster(flight: ClusterFlight | None) -> dict[str, Any]:
    """Return the keys ``cluster_...`` of docs/summary.md; empty without a cluster.

    Figures of the last orbit are left out where the cluster has not settled before it, figures of
    settling where it has not settled.
    """
    if flight is None:
        return {}
    wanted, settled = equilibrium_distance(), flight.settling_time()
    summary: dict[str, Any] = {
        "cluster_equilibrium_m": wanted,
        "cluster_closest_m": flight.closest,
        "cluster_side_minimum_end_m": flight.sides[-1].min(),
        "cluster_side_maximum_end_m": flight.sides[-1].max(),
        "cluster_settling_time_s": settled,
    }
    if math.isfinite(settled):
        spent = flight.velocity_change(0.0, settled)
        summary["cluster_settling_delta_v_m_per_s"] = spent.max()
    if settled <= flight.times[-1] - flight.period:
        last = flight.sides[flight.last_orbit] / wanted - 1.0
        hold = flight.velocity_change(flight.times[-1] - flight.period, math.inf)
        summary["cluster_side_mean_error_percent"] = 100.0 * np.abs(last.mean(axis=0)).max()
        summary["cluster_side_largest_error_percent"] = 100.0 * np.abs(last).max()
        summary["cluster_last_orbit_delta_v_m_per_s"] = hold.max()
    return summary


def describe_cluster(summary: Mapping[str, Any]) -> str:
    """Return what a cluster reached in a sentence or two; empty without a cluster.

    Parameters
    ----------
    summary
        Keys of `summarise_cluster`.
    """
    if "cluster_closest_m" not in summary:
        return ""
    wanted = 1e-3 * summary["cluster_equilibrium_m"]
    settled = summary.get("cluster_settling_time_s")
    if settled is None or not math.isfinite(settled):
        low, high = (1e-3 * summary[f"cluster_side_{end}_end_m"] for end in ("minimum", "maximum"))
        text = f"The sides of the cluster, {low:.3f} to {high:.3f} km at the end, have not settled"
        text += f" at {wanted:.4f} km"
    else:
        text = (
            f"All sides of the cluster stay within 2.5 % of {wanted:.4f} km from {settled:.0f} s "
            f"on, reached with at most {summary['cluster_settling_delta_v_m_per_s']:.1f} m/s"
        )
    if "cluster_side_mean_error_percent" in summary:
        text += (
            f"; in the last orbit their means are {summary['cluster_side_mean_error_percent']:.2f} "
            f"% off, at most {summary['cluster_side_largest_error_percent']:.2f} % at any time, "
            f"for {summary['cluster_last_orbit_delta_v_m_per_s']:.1f} m/s a chaser"
        )
    return f"{text}. No two came nearer than {summary['cluster_closest_m']:.0f} m."

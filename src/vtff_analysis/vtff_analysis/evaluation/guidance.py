"""Phases of a guided flight: what was wanted, what it cost, how near the spacecraft came."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.guidance import MODE_NAMES, GuidanceHistory
from vtff_analysis.recordings.history import RunHistory, interpolate
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "GuidancePhase",
    "flown_positions",
    "phases_of",
    "smallest_distance",
    "summarise_guidance",
]

_MILLIMETRE = 1e-3


@dataclass(frozen=True)
class GuidancePhase:
    """A span in one mode with one formation.

    Attributes
    ----------
    first, last
        Times of its first and last step, ns since 1970.
    mode, formation
        Name of the mode, and of the formation; empty without one.
    planned_closest, flown_closest
        Smallest distance of any pair, m: of the plan, and of the true states; NaN without.
    velocity_change
        Commanded in this span, m/s, by spacecraft.
    deviation
        Root mean square of true less wanted relative position, m, by deputy.
    """

    first: int
    last: int
    mode: str
    formation: str
    planned_closest: float
    flown_closest: float
    velocity_change: dict[str, float]
    deviation: dict[str, float]

    @property
    def name(self) -> str:
        """Mode and formation in words."""
        return f"{self.mode} {self.formation}".strip()


def flown_positions(history: RunHistory, guidance: GuidanceHistory) -> FloatArray:
    """Return the true positions relative to the chief at the steps, m, (n, k, 3); NaN without.

    Where the truth is not recorded, the positions are those of navigation.
    """
    flown = np.full(guidance.position_rtn.shape, np.nan)
    for column, name in enumerate(guidance.spacecraft):
        if name == guidance.spacecraft[0]:
            flown[:, column] = 0.0
            continue
        deputy = history.deputies.get(name)
        states = None if deputy is None else deputy.truth or deputy.estimate
        if states is None or len(states.time) < 2:
            continue
        for axis in range(3):
            values = states.position_rtn[:, axis]
            flown[:, column, axis] = interpolate(guidance.time, states.time, values, outside=np.nan)
    return flown


def smallest_distance(positions: FloatArray) -> FloatArray:
    """Return the smallest distance of any pair at each step, m, (n,), of positions (n, k, 3)."""
    pairs = itertools.combinations(range(positions.shape[1]), 2)
    distances = [np.linalg.norm(positions[:, i] - positions[:, j], axis=-1) for i, j in pairs]
    if not distances:
        return np.full(len(positions), np.nan)
    return np.asarray(np.min(distances, axis=0))


def phases_of(guidance: GuidanceHistory, flown: FloatArray) -> list[GuidancePhase]:
    """Return the phases of a flight in the order of time.

    Parameters
    ----------
    guidance
        What was wanted.
    flown
        `flown_positions`.
    """
    keys = list(zip(guidance.mode.tolist(), guidance.formation, strict=True))
    changes = [row for row in range(1, len(keys)) if keys[row] != keys[row - 1]]
    edges = [0, *changes, len(keys)]
    distance = smallest_distance(flown)
    phases = []
    for begin, end in itertools.pairwise(edges):
        span = slice(begin, end)
        before = guidance.velocity_change[max(0, begin - 1)]
        spent = guidance.velocity_change[end - 1] - (before if begin else 0.0)
        planned = guidance.closest_approach[span]
        phases.append(
            GuidancePhase(
                first=int(guidance.time[begin]),
                last=int(guidance.time[end - 1]),
                mode=MODE_NAMES[keys[begin][0]],
                formation=keys[begin][1],
                planned_closest=_smallest(planned),
                flown_closest=_smallest(distance[span]),
                velocity_change=dict(
                    zip(guidance.spacecraft, np.ravel(spent).tolist(), strict=True)
                ),
                deviation=_deviation(guidance, flown, span),
            )
        )
    return phases


def summarise_guidance(history: RunHistory) -> dict[str, Any]:
    """Return the keys ``guidance_...`` of docs/summary.md; empty without guidance."""
    guidance = history.guidance
    if guidance is None or not len(guidance.time):
        return {}
    phases = phases_of(guidance, flown_positions(history, guidance))
    last = phases[-1]
    return {
        "guidance_last_phase": last.name,
        "guidance_last_phase_start_time_s": (last.first - history.start_time) * 1e-9,
        "guidance_last_phase_deviation_rms_m": max(last.deviation.values(), default=math.nan),
        "guidance_closest_m": _smallest(np.array([phase.flown_closest for phase in phases])),
        "guidance_planned_closest_m": _smallest(np.array([p.planned_closest for p in phases])),
        "guidance_delta_v_m_per_s": float(guidance.velocity_change[-1].sum()),
    }


def _smallest(values: npt.NDArray[np.float64]) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else float("nan")


def _deviation(guidance: GuidanceHistory, flown: FloatArray, span: slice) -> dict[str, float]:
    deviations = {}
    for column, name in enumerate(guidance.spacecraft[1:], 1):
        difference = flown[span, column] - guidance.position_rtn[span, column]
        lengths = np.linalg.norm(difference, axis=-1)
        finite = lengths[np.isfinite(lengths)]
        if finite.size:
            deviations[name] = float(np.sqrt(np.mean(finite**2)))
    return deviations

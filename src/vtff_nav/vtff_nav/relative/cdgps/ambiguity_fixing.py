"""Fixing of the float ambiguities of a filter: an ambiguity with an integer leaves the state.

The single-difference ambiguity of satellite i on a signal is ``A_i = wavelength N_i + beta``, beta
being a bias of the receivers that all satellites share on that signal. While A_i is a real number
it is a state. When the integers of a signal become known, one A_i becomes beta and the others leave
the state: the phase is then predicted from beta and N_i. An integer is given up again by adding A_i
as a new, unknown state.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.ambiguity_arcs import Arc
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.integers.validation import FixStatus, partial_fix

__all__ = ["FixAttempt", "fix_ambiguities"]

# Largest sigma, and largest distance from a half integer, with which a lost half cycle is certain,
# cycles.
_HALF_CYCLE_SIGMA = 0.04
_HALF_CYCLE_TOLERANCE = 0.15


@dataclass(frozen=True)
class FixAttempt:
    """Result of an attempt to fix ambiguities.

    Parameters
    ----------
    fixed : tuple of SignalKey
        Signals whose ambiguities were fixed.
    ratio, success_rate : float
        Ratio and bootstrapped success rate of the search; 0 if there was nothing to test.
    reason : str
        Why some ambiguities were not fixed; empty if all were.
    """

    fixed: tuple[SignalKey, ...]
    ratio: float
    success_rate: float
    reason: str


def fix_ambiguities(
    state: GaussianState,
    time: GpsTime,
    arcs: Sequence[Arc],
    wavelength: dict[SignalKey, float],
    elevation: dict[SignalKey, float],
    success_rate: float,
    failure_rate: float,
    smallest_ratio: float,
    scattered: Container[SignalKey] = (),
) -> FixAttempt:
    """Fix those float ambiguities of arcs that pass the tests.

    Parameters
    ----------
    state : GaussianState
        State with the members ``("ambiguity", key)`` (m) of the arcs and ``("phase_bias", group)``
        (m) of the signals that have integers already. It is changed where ambiguities are fixed.
    time : GpsTime
    arcs : sequence of Arc
        Arcs whose ambiguities may be fixed.
    wavelength, elevation : dict
        Wavelength (m) and elevation (rad) of each signal.
    success_rate, failure_rate, smallest_ratio : float
        See `vtff_nav.relative.integers.validation.partial_fix`.
    scattered : container of SignalKey, optional
        Signals in scintillation. A half integer is not accepted there as a lost half cycle.
    """
    candidates, references = _choose_references(state, arcs, elevation)
    if not candidates:
        return FixAttempt((), 0.0, 0.0, "")
    design = np.zeros((len(candidates), len(state)))
    for row, arc in enumerate(candidates):
        scale = 1.0 / wavelength[arc.key]
        design[row, state.index(("ambiguity", arc.key))] = scale
        design[row, state.index(_reference_label(arc, references))] = -scale
    floats = design @ state.mean
    covariance = design @ state.covariance @ design.T
    covariance = 0.5 * (covariance + covariance.T)
    result = partial_fix(
        floats,
        covariance,
        success_rate=success_rate,
        failure_rate=failure_rate,
        minimum_ratio=smallest_ratio,
    )
    values = np.rint(result.ambiguities)
    accepted = result.determined.copy()
    if result.status in (FixStatus.RATIO, FixStatus.RESIDUAL, FixStatus.WEAK):
        accepted, values = _round_to_half_cycles(
            candidates, references, floats, covariance, failure_rate
        )
        accepted &= [arc.key not in scattered for arc in candidates]
    rows = np.flatnonzero(accepted)
    ratio = float(result.ratio) if np.isfinite(result.ratio) else 0.0
    if len(rows) == 0:
        return FixAttempt((), ratio, result.success_rate, result.reason)
    state.constrain(design[rows], (values - floats)[rows], covariance[np.ix_(rows, rows)])
    fixed = _move_to_integers(
        state, time, [candidates[row] for row in rows], values[rows], references
    )
    return FixAttempt(fixed, ratio, result.success_rate, result.reason)


def _choose_references(
    state: GaussianState, arcs: Sequence[Arc], elevation: dict[SignalKey, float]
) -> tuple[list[Arc], dict[tuple[int, int, int], Arc]]:
    """Return the arcs to fix and the reference of each signal that has no integers yet."""
    groups: dict[tuple[int, int, int], list[Arc]] = {}
    for arc in arcs:
        groups.setdefault(arc.key.group, []).append(arc)
    candidates: list[Arc] = []
    references: dict[tuple[int, int, int], Arc] = {}
    for group, members in groups.items():
        if ("phase_bias", group) not in state:
            # The highest satellite with a known half cycle.
            reference = max(members, key=lambda arc: elevation[arc.key])
            references[group] = reference
            members = [arc for arc in members if arc is not reference]
        candidates.extend(members)
    return candidates, references


def _reference_label(
    arc: Arc, references: dict[tuple[int, int, int], Arc]
) -> tuple[str, SignalKey] | tuple[str, tuple[int, int, int]]:
    """Return the label of the member that the ambiguity of an arc is differenced with."""
    reference = references.get(arc.key.group)
    if reference is None:
        return ("phase_bias", arc.key.group)
    return ("ambiguity", reference.key)


def _round_to_half_cycles(
    candidates: list[Arc],
    references: dict[tuple[int, int, int], Arc],
    floats: FloatArray,
    covariance: FloatArray,
    failure_rate: float,
) -> tuple[npt.NDArray[np.bool_], FloatArray]:
    """Return which ambiguities are certain without a search, and their nearest half integers.

    Where the bias of a signal is known already, each ambiguity is predicted to a few hundredths of
    a cycle, so that a lost half cycle is as certain as an integer. Where it is not, as after an
    outage of a receiver, all ambiguities of the signal must lie near half integers, and so many of
    them that chance does so with less than `failure_rate`.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    values = 0.5 * np.rint(2.0 * floats)
    tolerance = np.minimum(4.0 * sigma + 0.02, _HALF_CYCLE_TOLERANCE)
    is_certain = (sigma < _HALF_CYCLE_SIGMA) & (np.abs(floats - values) < tolerance)
    by_group: dict[tuple[int, int, int], list[int]] = {}
    for row, arc in enumerate(candidates):
        by_group.setdefault(arc.key.group, []).append(row)
    for group, rows in by_group.items():
        if group not in references:
            continue
        # A number anywhere is within the tolerance of a half integer with this probability.
        chance = float(np.prod(4.0 * tolerance[rows]))
        if not (is_certain[rows].all() and chance < failure_rate):
            is_certain[rows] = False
    return is_certain, values


def _move_to_integers(
    state: GaussianState,
    time: GpsTime,
    arcs: list[Arc],
    values: FloatArray,
    references: dict[tuple[int, int, int], Arc],
) -> tuple[SignalKey, ...]:
    """Set the integers of arcs and remove their ambiguities from the state; return the signals."""
    fixed = []
    for arc, value in zip(arcs, values.tolist(), strict=True):
        reference = references.get(arc.key.group)
        if reference is not None and reference.integer is None:
            reference.integer, reference.fixed_since = 0.0, time
            state.rename(("ambiguity", reference.key), ("phase_bias", arc.key.group))
            fixed.append(reference.key)
        arc.integer, arc.fixed_since = value, time
        fixed.append(arc.key)
    state.remove([("ambiguity", arc.key) for arc in arcs])
    return tuple(fixed)

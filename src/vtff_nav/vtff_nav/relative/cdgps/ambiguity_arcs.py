"""Bookkeeping of the carrier-phase ambiguities between two receivers: arcs, integers, breaks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.measurements import SingleDifferences

__all__ = ["Arc", "ArcBook"]

# The ionosphere between the receivers may change a geometry-free phase by this much in a second.
_GEOMETRY_FREE_ALLOWANCE = 0.01
_GEOMETRY_FREE_SIGMAS = 5.0


@dataclass(eq=False)
class Arc:
    """Continuous phase of one signal at both receivers.

    Parameters
    ----------
    key : SignalKey
    number : int
        Counts the arcs.
    offset_cycles : float
        Whole cycles taken off the phase, so that the numbers in the filter are small.
    time : GpsTime
        Last epoch with a measurement.
    phase : float
        Single-differenced phase then, m.
    phase_variance : float
    lock_time : tuple of 2 float
        Of chief and deputy then, s.
    half_cycles : int
        As in `SingleDifferences`.
    is_parity_known : bool
    integer : float or None
        Cycles less `offset_cycles` and those of the receiver bias of the group; None while it is a
        real number. Half-integers occur where a receiver has lost half a cycle.
    fixed_since : GpsTime or None
    epochs : int
        With a measurement that was used or could have been.
    """

    key: SignalKey
    number: int
    offset_cycles: float
    time: GpsTime
    phase: float
    phase_variance: float
    lock_time: tuple[float, float]
    half_cycles: int
    is_parity_known: bool
    integer: float | None = None
    fixed_since: GpsTime | None = None
    epochs: int = 0


class ArcBook:
    """All arcs that are alive.

    Parameters
    ----------
    longest_gap : float
        s without a measurement after which an arc has ended whatever the lock time says.
    """

    def __init__(self, longest_gap: float = 30.0) -> None:
        self._longest_gap = longest_gap
        self._count = 0
        self.arcs: dict[SignalKey, Arc] = {}

    def __contains__(self, key: SignalKey) -> bool:
        """Return whether there is an arc of a signal."""
        return key in self.arcs

    def __getitem__(self, key: SignalKey) -> Arc:
        """Return the arc of a signal."""
        return self.arcs[key]

    def broken(
        self, time: GpsTime, measured: SingleDifferences, interval: float
    ) -> dict[SignalKey, str]:
        """Return the arcs that have ended, and why.

        Parameters
        ----------
        time : GpsTime
            Epoch of the measurements.
        measured : SingleDifferences
        interval : float
            s since the epoch before.
        """
        reasons: dict[SignalKey, str] = {}
        lost, half = measured.is_lock_lost.tolist(), measured.half_cycles.tolist()
        known, lock = measured.is_parity_known.tolist(), measured.lock_time.T.tolist()
        for row, key in enumerate(measured.keys):
            arc = self.arcs.get(key)
            if arc is None:
                continue
            gap = time - arc.time
            if lost[row]:
                reasons[key] = "lock was lost"
            elif half[row] != arc.half_cycles:
                reasons[key] = "half a cycle was added"
            elif known[row] and not arc.is_parity_known:
                reasons[key] = "parity has become known"
            elif gap > 1.5 * interval and not _has_kept_lock(lock[row], gap):
                reasons[key] = "gap"
            elif _lock_restarted(lock[row], arc.lock_time, gap):
                reasons[key] = "lock time has restarted"
        reasons.update(self._geometry_free(measured, reasons))
        present = set(measured.keys)
        for key, arc in self.arcs.items():
            if time - arc.time > self._longest_gap and key not in present:
                reasons[key] = "not seen any more"
        return reasons

    def _geometry_free(
        self, measured: SingleDifferences, reasons: dict[SignalKey, str]
    ) -> dict[SignalKey, str]:
        """Return pairs of signals of a satellite whose difference has jumped."""
        found: dict[SignalKey, str] = {}
        phase, variance = measured.phase.tolist(), measured.phase_variance.tolist()
        rows = range(len(measured.keys))
        for first, second in pairwise(rows):
            a, b = measured.keys[first], measured.keys[second]
            if a.satellite != b.satellite or a in reasons or b in reasons:
                continue
            if a not in self.arcs or b not in self.arcs:
                continue
            last_a, last_b = self.arcs[a], self.arcs[b]
            if last_a.time != last_b.time:
                continue
            jump = (phase[first] - phase[second]) - (last_a.phase - last_b.phase)
            noise = (
                variance[first] + variance[second] + last_a.phase_variance + last_b.phase_variance
            )
            if abs(jump) > _GEOMETRY_FREE_SIGMAS * math.sqrt(noise) + _GEOMETRY_FREE_ALLOWANCE:
                found[a] = found[b] = "geometry-free phase has jumped"
        return found

    def start(
        self, time: GpsTime, measured: SingleDifferences, row: int, expected_phase: float
    ) -> Arc:
        """Begin an arc; `expected_phase` (m) is what the phase would be without ambiguity."""
        key = measured.keys[row]
        self._count += 1
        phase = float(measured.phase[row])
        wavelength = float(measured.wavelength[row])
        arc = Arc(
            key=key,
            number=self._count,
            offset_cycles=float(round((phase - expected_phase) / wavelength)),
            time=time,
            phase=phase,
            phase_variance=float(measured.phase_variance[row]),
            lock_time=(float(measured.lock_time[0, row]), float(measured.lock_time[1, row])),
            half_cycles=int(measured.half_cycles[row]),
            is_parity_known=bool(measured.is_parity_known[row]),
        )
        self.arcs[key] = arc
        return arc

    def end(self, key: SignalKey) -> None:
        """Forget an arc."""
        self.arcs.pop(key, None)

    def keep(self, time: GpsTime, measured: SingleDifferences) -> None:
        """Remember what the signals were at this epoch."""
        phase, variance = measured.phase.tolist(), measured.phase_variance.tolist()
        lock = measured.lock_time.T.tolist()
        known, half = measured.is_parity_known.tolist(), measured.half_cycles.tolist()
        for row, key in enumerate(measured.keys):
            arc = self.arcs.get(key)
            if arc is None:
                continue
            arc.time, arc.phase, arc.phase_variance = time, phase[row], variance[row]
            arc.lock_time = (lock[row][0], lock[row][1])
            arc.is_parity_known, arc.half_cycles = known[row], half[row]
            arc.epochs += 1

    def fixed_groups(self) -> dict[tuple[int, int, int], list[Arc]]:
        """Return the arcs with integers by what shares a receiver bias, oldest first."""
        groups: dict[tuple[int, int, int], list[Arc]] = {}
        for arc in sorted(self.arcs.values(), key=lambda arc: arc.number):
            if arc.integer is not None:
                groups.setdefault(arc.key.group, []).append(arc)
        return groups


def _has_kept_lock(lock_time: list[float], gap: float) -> bool:
    """Return whether both receivers say that they have tracked all through a gap."""
    return all(value >= gap for value in lock_time)


def _lock_restarted(lock_time: list[float], before: tuple[float, float], gap: float) -> bool:
    """Return whether a lock time has grown by less than the time that passed.

    Lock times that saturate stay as they are; compressed logs have units of 1/32 s.
    """
    return any(
        math.isfinite(now) and now < last and now < last + gap - 0.1
        for now, last in zip(lock_time, before, strict=True)
    )

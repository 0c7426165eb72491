"""Arcs of the carrier phase between two receivers: their integers, and how they break."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.common.measurements import SingleDifferences

__all__ = ["Arc", "ArcBook", "has_lock_restarted"]

# Change of a geometry-free phase in a second that the ionosphere may cause, m.
_GEOMETRY_FREE_ALLOWANCE = 0.01
_GEOMETRY_FREE_SIGMAS = 5.0


@dataclass(eq=False)
class Arc:
    """Continuous phase of one signal at both receivers.

    Parameters
    ----------
    key : SignalKey
    number : int
        Number of the arc; arcs are numbered in the order of their starts.
    offset_cycles : float
        Whole cycles subtracted from the phase, so that the ambiguity in the filter is small.
    time : GpsTime
        Last epoch with a measurement.
    phase, phase_variance : float
        Single-differenced phase of that epoch, m, and its variance, m2.
    lock_time : tuple of 2 float
        Lock times of chief and deputy at that epoch, s.
    half_cycles : int
        As in `SingleDifferences`, at that epoch.
    is_parity_known : bool
        As in `SingleDifferences`, at that epoch.
    integer : float or None
        Ambiguity less `offset_cycles` and the receiver bias of the group, cycles; None while it is
        a real number. Half-integers occur where a receiver has lost half a cycle.
    fixed_since : GpsTime or None
        Epoch at which the integer was fixed.
    epochs : int
        Number of epochs with a measurement.
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
    """The arcs that go on, by signal.

    Parameters
    ----------
    longest_gap : float
        Time without a measurement after which an arc ends whatever the lock time says, s.
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

    def find_breaks(
        self, time: GpsTime, measured: SingleDifferences, interval: float
    ) -> dict[SignalKey, str]:
        """Return the signals whose arcs have ended, and why.

        Parameters
        ----------
        time : GpsTime
            Epoch of the measurements.
        measured : SingleDifferences
        interval : float
            Time since the last epoch, s.
        """
        reasons: dict[SignalKey, str] = {}
        is_lock_lost, half_cycles = measured.is_lock_lost.tolist(), measured.half_cycles.tolist()
        is_parity_known = measured.is_parity_known.tolist()
        lock_times = measured.lock_time.T.tolist()
        last, gap = time, 0.0
        arcs = [self.arcs.get(key) for key in measured.keys]
        for row, (key, arc) in enumerate(zip(measured.keys, arcs, strict=True)):
            if arc is None:
                continue
            if arc.time is not last:
                last, gap = arc.time, time - arc.time
            if is_lock_lost[row]:
                reasons[key] = "lock was lost"
            elif half_cycles[row] != arc.half_cycles:
                reasons[key] = "half a cycle was added"
            elif is_parity_known[row] and not arc.is_parity_known:
                reasons[key] = "parity has become known"
            elif gap > 1.5 * interval and not _has_kept_lock(lock_times[row], gap):
                reasons[key] = "gap"
            elif has_lock_restarted(lock_times[row], arc.lock_time, gap):
                reasons[key] = "lock time has restarted"
        reasons.update(_find_geometry_free_jumps(measured, arcs, reasons))
        if len(self.arcs) > len(arcs) - arcs.count(None):
            present = set(measured.keys)
            for key, arc in self.arcs.items():
                if key not in present and time - arc.time > self._longest_gap:
                    reasons[key] = "not seen any more"
        return reasons

    def start(
        self, time: GpsTime, measured: SingleDifferences, row: int, expected_phase: float
    ) -> Arc:
        """Start an arc.

        Parameters
        ----------
        time : GpsTime
        measured : SingleDifferences
        row : int
            Row of the signal.
        expected_phase : float
            Phase without its ambiguity, m.
        """
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

    def record(self, time: GpsTime, measured: SingleDifferences) -> None:
        """Keep the measurements of an epoch, against which the next epoch is tested."""
        phase, variance = measured.phase.tolist(), measured.phase_variance.tolist()
        lock_times, half_cycles = measured.lock_time.T.tolist(), measured.half_cycles.tolist()
        is_parity_known = measured.is_parity_known.tolist()
        for row, key in enumerate(measured.keys):
            arc = self.arcs.get(key)
            if arc is None:
                continue
            arc.time, arc.phase, arc.phase_variance = time, phase[row], variance[row]
            arc.lock_time = (lock_times[row][0], lock_times[row][1])
            arc.is_parity_known, arc.half_cycles = is_parity_known[row], half_cycles[row]
            arc.epochs += 1

    def fixed_groups(self) -> dict[tuple[int, int, int], list[Arc]]:
        """Return the arcs with integers by `SignalKey.group`, oldest first."""
        groups: dict[tuple[int, int, int], list[Arc]] = {}
        for arc in sorted(self.arcs.values(), key=operator.attrgetter("number")):
            if arc.integer is not None:
                groups.setdefault(arc.key.group, []).append(arc)
        return groups


def _find_geometry_free_jumps(
    measured: SingleDifferences, arcs: Sequence[Arc | None], reasons: Mapping[SignalKey, str]
) -> dict[SignalKey, str]:
    """Return the signals whose difference to another one of the satellite has jumped.

    Signals without an arc, and signals whose arcs have ended for other `reasons`, are left out.
    """
    jumps: dict[SignalKey, str] = {}
    phase, variance = measured.phase.tolist(), measured.phase_variance.tolist()
    satellite = measured.satellite.tolist()
    for first, second in pairwise(range(len(arcs))):
        last_a, last_b = arcs[first], arcs[second]
        if satellite[first] != satellite[second] or last_a is None or last_b is None:
            continue
        a, b = measured.keys[first], measured.keys[second]
        if a in reasons or b in reasons or last_a.time != last_b.time:
            continue
        jump = (phase[first] - phase[second]) - (last_a.phase - last_b.phase)
        noise = variance[first] + variance[second] + last_a.phase_variance + last_b.phase_variance
        if abs(jump) > _GEOMETRY_FREE_SIGMAS * math.sqrt(noise) + _GEOMETRY_FREE_ALLOWANCE:
            jumps[a] = jumps[b] = "geometry-free phase has jumped"
    return jumps


def _has_kept_lock(lock_time: list[float], gap: float) -> bool:
    """Return whether both lock times are at least as long as a gap, s."""
    return all(value >= gap for value in lock_time)


def has_lock_restarted(now: Iterable[float], before: Iterable[float], gap: float) -> bool:
    """Return whether a lock time is shorter than it was, or should be by now.

    Parameters
    ----------
    now, before : iterable of float
        Lock times now and at the last epoch, s. Lock times that saturate do not grow; compressed
        logs have units of 1/32 s.
    gap : float
        Since the last epoch, s.
    """
    for lock, last in zip(now, before, strict=True):
        if lock < last and lock < last + gap - 0.1 and math.isfinite(lock):
            return True
    return False

"""Arcs of the carrier phase between two receivers: their integers, and how they break."""

from __future__ import annotations

import functools
import operator
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.signals import SignalKey
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.measurements import SingleDifferences
from vtff_nav.relative.common.signal_set import SignalPlaces, SignalSet, read_only, with_places
from vtff_nav.relative.common.solution import AMBIGUITY_FLOAT, AMBIGUITY_HELD
from vtff_nav.relative.kernels.arcs import find_arc_breaks, record_arcs

__all__ = ["ARC_BREAKS", "Arc", "ArcBook", "ArcColumns"]

ARC_BREAKS = (
    "",
    "lock was lost",
    "half a cycle was added",
    "parity has become known",
    "gap",
    "lock time has restarted",
    "geometry-free phase has jumped",
)
"""Why arcs end, in the order of the numbers of `find_arc_breaks`."""


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
    integer : float or None
        Ambiguity less `offset_cycles` and the receiver bias of the group, cycles; None while it is
        a real number. Half-integers occur where a receiver has lost half a cycle.
    fixed_since : GpsTime or None
        Epoch at which the integer was fixed.
    """

    key: SignalKey
    number: int
    offset_cycles: float
    integer: float | None = None
    fixed_since: GpsTime | None = None


@dataclass(frozen=True, eq=False)
class ArcColumns:
    """What the arcs of n signals and the labels of a state say of each signal, shape (n,).

    Parameters
    ----------
    arcs : tuple of Arc
    has_integer : ndarray of bool
    cycles : ndarray
        Offset, and integer where there is one, cycles.
    phase_columns : ndarray of int64
        Member of the ambiguity, or of the bias of the group where the arc has an integer.
    code_columns : ndarray of int64
        Member of the bias of the code; -1 for codes of the reference group.
    slow_columns, offset_columns, wave_columns : ndarray of int64
        Members of the slow error of the phase, of the position of the satellite and of the plasma's
        wave in its ray; -1 where there is none.
    reference_prn : ndarray of uint8
        Satellite of the oldest integer of the group; 0 for an arc without integer.
    reference_cycles : ndarray
        Its offset and integer, cycles; 0 for an arc without integer.
    pairs : ndarray of int64, shape (m, 2)
        Rows of the first two carriers of each satellite that have integers.
    """

    arcs: tuple[Arc, ...]
    has_integer: npt.NDArray[np.bool_]
    cycles: FloatArray
    phase_columns: npt.NDArray[np.int64]
    code_columns: npt.NDArray[np.int64]
    slow_columns: npt.NDArray[np.int64]
    offset_columns: npt.NDArray[np.int64]
    wave_columns: npt.NDArray[np.int64]
    reference_prn: npt.NDArray[np.uint8]
    reference_cycles: FloatArray
    pairs: npt.NDArray[np.int64]

    @functools.cached_property
    def has_integers_only(self) -> bool:
        """Whether every arc has an integer."""
        return bool(self.has_integer.all())

    @functools.cached_property
    def integer_cycles(self) -> FloatArray:
        """Offset and integer of each phase, cycles; NaN without an integer."""
        return np.where(self.has_integer, self.cycles, np.nan)

    @functools.cached_property
    def states_held(self) -> npt.NDArray[np.uint8]:
        """State of each ambiguity, ``AMBIGUITY_*``, where none was fixed at this epoch."""
        states = np.where(self.has_integer, AMBIGUITY_HELD, AMBIGUITY_FLOAT)
        return read_only(states.astype(np.uint8))

    @functools.cached_property
    def fixed_since(self) -> tuple[GpsTime | None, ...]:
        """Epoch at which each integer was fixed; None without one."""
        return tuple(arc.fixed_since if arc.integer is not None else None for arc in self.arcs)

    @functools.cached_property
    def pair_names(self) -> tuple[npt.NDArray[np.uint8], ...]:
        """System, number, and bands of first and second carrier of the pairs, shape (m,) each."""
        pairs = [(self.arcs[a].key, self.arcs[b].key) for a, b in self.pairs.tolist()]
        names = [(a.system, a.prn, a.band, b.band) for a, b in pairs]
        columns = np.array(names, dtype=np.uint8).reshape(-1, 4).T
        return tuple(read_only(column.copy()) for column in columns)

    @functools.cached_property
    def pair_numbers(self) -> npt.NDArray[np.uint32]:
        """Number of the newer arc of each pair, shape (m,)."""
        numbers = [max(self.arcs[a].number, self.arcs[b].number) for a, b in self.pairs.tolist()]
        return read_only(np.array(numbers, dtype=np.uint32))


class ArcBook:
    """The arcs that go on, by signal, and their measurements at the last epoch.

    Parameters
    ----------
    longest_gap : float
        Time without a measurement after which an arc ends whatever the lock time says, s.
    """

    def __init__(self, longest_gap: float = 30.0) -> None:
        self._longest_gap = longest_gap
        self._count = 0
        self.arcs: dict[SignalKey, Arc] = {}
        # Columns by place: whether there is an arc, its last epoch (GPS, ns), its phase (m) and
        # variance (m2) then, the lock times of chief and deputy (s), `half_cycles` and
        # `is_parity_known` of `SingleDifferences`, and the number of its epochs.
        self._places = SignalPlaces()
        self._is_open = np.zeros(0, dtype=bool)
        self._times = np.zeros(0, dtype=np.int64)
        self._numbers = np.zeros((4, 0))
        self._half_cycles = np.zeros(0, dtype=np.int64)
        self._is_parity_known = np.zeros(0, dtype=bool)
        self._epochs = np.zeros(0, dtype=np.int64)
        self._columns: tuple[SignalSet, object, int, ArcColumns] | None = None
        self._changes = 0

    def __contains__(self, key: SignalKey) -> bool:
        """Return whether there is an arc of a signal."""
        return key in self.arcs

    def __getitem__(self, key: SignalKey) -> Arc:
        """Return the arc of a signal."""
        return self.arcs[key]

    def _places_of(self, signals: SignalSet) -> npt.NDArray[np.int64]:
        """Return the place of each signal, shape (n,), which all columns have."""
        places = self._places.of(signals)
        if len(self._places) > len(self._is_open):
            self._is_open = with_places(self._is_open, self._places)
            self._times = with_places(self._times, self._places)
            self._numbers = with_places(self._numbers, self._places)
            self._half_cycles = with_places(self._half_cycles, self._places)
            self._is_parity_known = with_places(self._is_parity_known, self._places)
            self._epochs = with_places(self._epochs, self._places)
        return places

    def are_open(self, signals: SignalSet) -> npt.NDArray[np.bool_]:
        """Return whether there is an arc of each signal, shape (n,)."""
        places = self._places_of(signals)  # before the columns, which may grow
        return self._is_open[places]

    def epochs(self, signals: SignalSet) -> npt.NDArray[np.int64]:
        """Return the number of epochs with a measurement in the arc of each signal, shape (n,)."""
        places = self._places_of(signals)
        return self._epochs[places]

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
        signals = measured.keys
        numbers, arcs, breaks = find_arc_breaks(
            self._places_of(signals),
            time.nanoseconds,
            interval,
            measured.satellite,
            measured.is_lock_lost,
            measured.half_cycles,
            measured.is_parity_known,
            measured.lock_time,
            measured.phase,
            measured.phase_variance,
            self._is_open,
            self._times,
            self._numbers,
            self._half_cycles,
            self._is_parity_known,
        )
        reasons: dict[SignalKey, str] = {}
        if breaks:
            # Jumps come after what the receivers have told.
            for is_jump in (False, True):
                for key, number in zip(signals, numbers.tolist(), strict=True):
                    if number and (ARC_BREAKS[number] is ARC_BREAKS[-1]) is is_jump:
                        reasons[key] = ARC_BREAKS[number]
        if len(self.arcs) > arcs:
            for key in self.arcs:
                last = int(self._times[self._places[key]])
                absence = (time.nanoseconds - last) / NANOSECONDS_PER_SECOND
                if key not in signals.rows and absence > self._longest_gap:
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
        phase = measured.phase.item(row)
        wavelength = measured.wavelength.item(row)
        arc = Arc(key, self._count, float(round((phase - expected_phase) / wavelength)))
        place = self._places_of(measured.keys).item(row)
        self._is_open[place], self._times[place] = True, time.nanoseconds
        self._numbers[:2, place] = phase, measured.phase_variance[row]
        self._numbers[2:, place] = measured.lock_time[:, row]
        self._half_cycles[place] = measured.half_cycles[row]
        self._is_parity_known[place] = measured.is_parity_known[row]
        self._epochs[place] = 0
        self.arcs[key] = arc
        self._changes += 1
        return arc

    def end(self, key: SignalKey) -> None:
        """Forget an arc."""
        if self.arcs.pop(key, None) is not None:
            self._is_open[self._places[key]] = False
            self._changes += 1

    def record(self, time: GpsTime, measured: SingleDifferences) -> None:
        """Keep the measurements of an epoch, against which the next epoch is tested."""
        record_arcs(
            self._places_of(measured.keys),
            time.nanoseconds,
            measured.phase,
            measured.phase_variance,
            measured.lock_time,
            measured.half_cycles,
            measured.is_parity_known,
            self._is_open,
            self._times,
            self._numbers,
            self._half_cycles,
            self._is_parity_known,
            self._epochs,
        )

    def is_continued_by(self, key: SignalKey, lock_time_deputy: float, half_cycles: int) -> bool:
        """Return whether the deputy's phase of a later epoch belongs to the arc of a signal.

        Parameters
        ----------
        key : SignalKey
            Signal with an arc.
        lock_time_deputy : float
            s.
        half_cycles : int
            As in `SingleDifferences`, of the deputy alone.
        """
        place = self._places[key]
        last = self._half_cycles.item(place) & 2
        return lock_time_deputy >= self._numbers.item(3, place) and half_cycles == last

    def fixed_groups(self) -> dict[tuple[int, int, int], list[Arc]]:
        """Return the arcs with integers by `SignalKey.group`, oldest first."""
        groups: dict[tuple[int, int, int], list[Arc]] = {}
        for arc in sorted(self.arcs.values(), key=operator.attrgetter("number")):
            if arc.integer is not None:
                groups.setdefault(arc.key.group, []).append(arc)
        return groups

    def has_integers(self) -> bool:
        """Return whether any arc has an integer."""
        return any(arc.integer is not None for arc in self.arcs.values())

    def columns(self, signals: SignalSet, state: GaussianState) -> ArcColumns:
        """Return the columns of signals with arcs; the same object while nothing has changed.

        An ambiguity leaves the state when it becomes an integer, and comes back when it is given
        up: where neither arcs nor the labels of the state have changed, no integer has.
        """
        known = self._columns
        if (
            known is None
            or known[0] is not signals
            or known[1] is not state.labels_mark
            or known[2] != self._changes
        ):
            columns = self._make_columns(signals, state)
            known = self._columns = (signals, state.labels_mark, self._changes, columns)
        return known[3]

    def _make_columns(self, signals: SignalSet, state: GaussianState) -> ArcColumns:
        arcs = tuple(self.arcs[key] for key in signals)
        references = {group: members[0] for group, members in self.fixed_groups().items()}
        phases, cycles, prns, reference_cycles = [], [], [], []
        rows_of_satellite: dict[tuple[int, int], list[int]] = {}
        for row, (key, arc) in enumerate(zip(signals, arcs, strict=True)):
            if arc.integer is None:
                phases.append(state.index(("ambiguity", key)))
                cycles.append(arc.offset_cycles)
                prns.append(0)
                reference_cycles.append(0.0)
                continue
            reference = references[key.group]
            phases.append(state.index(("phase_bias", key.group)))
            cycles.append(arc.offset_cycles + arc.integer)
            prns.append(reference.key.prn)
            reference_cycles.append((reference.integer or 0.0) + reference.offset_cycles)
            rows_of_satellite.setdefault(key.satellite, []).append(row)

        def members(kind: str, names: Sequence[Hashable]) -> npt.NDArray[np.int64]:
            found = [state.find((kind, name)) for name in names]
            return np.array(found, dtype=np.int64)

        return ArcColumns(
            arcs=arcs,
            has_integer=np.array([arc.integer is not None for arc in arcs], dtype=bool),
            cycles=np.array(cycles, dtype=float),
            phase_columns=np.array(phases, dtype=np.int64),
            code_columns=members("code_bias", [key.group for key in signals]),
            slow_columns=members("phase_error", signals),
            offset_columns=members("satellite_offset", signals.satellites),
            wave_columns=members("plasma_wave", signals.satellites),
            reference_prn=read_only(np.array(prns, dtype=np.uint8)),
            reference_cycles=np.array(reference_cycles, dtype=float),
            pairs=np.array(
                [rows[:2] for rows in rows_of_satellite.values() if len(rows) > 1], dtype=np.int64
            ).reshape(-1, 2),
        )

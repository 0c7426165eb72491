"""Combinations of carriers of the chief: what its receiver said of them, and their ambiguities."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.orbit_single_point import Combinations
from vtff_nav.relative.kernels.orbit import find_carrier_breaks, record_carriers

__all__ = ["CarrierBook", "CarrierColumns", "CarrierLabel"]

CarrierLabel = tuple[str, int, int]
"""Kind, `satellite_number` and second band of an ambiguity of the chief."""


@dataclass(frozen=True, eq=False)
class CarrierColumns:
    """What a state says of n combinations of carriers, k of which have codes.

    Parameters
    ----------
    labels : list of CarrierLabel
        Their ambiguities.
    places : ndarray of int64, shape (n,)
        Places in the columns of what the receiver said of them.
    ambiguities : ndarray of int64, shape (n,)
        Members of the state; -1 where there is none.
    range_errors : ndarray of int64, shape (k,)
        Members of the range errors of the satellites with codes; -1 where there is none.
    code_rows : ndarray of intp, shape (k,)
        Rows with two carriers, whose codes are used.
    systems : ndarray of int64
        Systems of the satellites, increasing.
    """

    labels: list[CarrierLabel]
    places: npt.NDArray[np.int64]
    ambiguities: npt.NDArray[np.int64]
    range_errors: npt.NDArray[np.int64]
    code_rows: npt.NDArray[np.intp]
    systems: npt.NDArray[np.int64]

    @functools.cached_property
    def are_members(self) -> bool:
        """Whether all of them are members of the state."""
        return bool((self.ambiguities >= 0).all() and (self.range_errors >= 0).all())


class CarrierBook:
    """What the receiver said of each combination of carriers when it was seen last."""

    def __init__(self) -> None:
        # Places of all combinations that there were, and those that are known.
        self._places: dict[CarrierLabel, int] = {}
        self._known: set[CarrierLabel] = set()
        # Columns by place: last epoch (GPS, ns; -1 without), half cycles, and lock times, s.
        self._times = np.full(0, -1, dtype=np.int64)
        self._half_cycles = np.zeros(0, dtype=np.int64)
        self._lock_times = np.zeros((0, 2))
        self._columns: tuple[bytes, bytes, object, CarrierColumns] | None = None

    def __len__(self) -> int:
        """Return the number of combinations that are known."""
        return len(self._known)

    @property
    def satellites(self) -> set[int]:
        """Numbers of the satellites whose carriers are known."""
        return {satellite for _, satellite, _ in self._known}

    def columns(self, measured: Combinations, state: GaussianState) -> CarrierColumns:
        """Return the columns of combinations; the same object while these and the labels stay."""
        known = self._columns
        names = (measured.satellite.tobytes(), measured.second_band.tobytes())
        if known is not None and known[:2] == names:
            if known[2] is state.labels_mark:
                return known[3]
        satellites = measured.satellite.tolist()
        labels = [
            ("chief_ambiguity", satellite, band)
            for satellite, band in zip(satellites, measured.second_band.tolist(), strict=True)
        ]
        code_rows = np.flatnonzero(measured.second_band > 0)
        range_errors = [state.find(("range_error", satellites[row])) for row in code_rows.tolist()]
        columns = CarrierColumns(
            labels=labels,
            places=np.array([self._place_of(label) for label in labels], dtype=np.int64),
            ambiguities=np.array([state.find(label) for label in labels], dtype=np.int64),
            range_errors=np.array(range_errors, dtype=np.int64),
            code_rows=code_rows,
            systems=np.array(sorted(set(measured.system.tolist())), dtype=np.int64),
        )
        self._columns = (*names, state.labels_mark, columns)
        return columns

    def _place_of(self, label: CarrierLabel) -> int:
        """Return the place of a combination in the columns."""
        place = self._places.setdefault(label, len(self._places))
        if place >= len(self._times):
            more = place + 32
            self._times = np.append(self._times, np.full(more, -1, dtype=np.int64))
            self._half_cycles = np.append(self._half_cycles, np.zeros(more, dtype=np.int64))
            self._lock_times = np.vstack((self._lock_times, np.zeros((more, 2))))
        return place

    def find_breaks(
        self, time: GpsTime, measured: Combinations, columns: CarrierColumns
    ) -> npt.NDArray[np.bool_]:
        """Return which combinations have another ambiguity than when they were seen last, (n,)."""
        is_broken: npt.NDArray[np.bool_] = find_carrier_breaks(
            columns.places,
            time.nanoseconds,
            measured.is_lock_lost,
            measured.half_cycles,
            measured.lock_time,
            self._times,
            self._half_cycles,
            self._lock_times,
        )
        return is_broken

    def record(self, time: GpsTime, measured: Combinations, columns: CarrierColumns) -> None:
        """Keep what the receiver says of the carriers of an epoch."""
        self._known.update(columns.labels)
        record_carriers(
            columns.places,
            time.nanoseconds,
            measured.half_cycles,
            measured.lock_time,
            self._times,
            self._half_cycles,
            self._lock_times,
        )

    def forget(self, labels: Iterable[CarrierLabel]) -> None:
        """Forget some combinations; those that are not known are ignored."""
        for label in labels:
            if label in self._known:
                self._known.remove(label)
                self._times[self._places[label]] = -1

    def find_old(self, time: GpsTime, longest_gap: float) -> list[CarrierLabel]:
        """Return the combinations that were seen last longer ago than a time, s."""
        old = []
        for label in self._known:
            last = self._times.item(self._places[label])
            if (time.nanoseconds - last) / NANOSECONDS_PER_SECOND > longest_gap:
                old.append(label)
        return old

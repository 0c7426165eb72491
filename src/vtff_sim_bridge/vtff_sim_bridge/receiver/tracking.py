"""Tracking of signals by a receiver: channels, lock, lock time, ambiguities, half cycles, slips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    FLAG_CODE_VALID,
    FLAG_HALF_CYCLE_ADDED,
    FLAG_PARITY_KNOWN,
    FLAG_PHASE_VALID,
)
from vtff_sim_bridge.gnss.configuration import TrackingModel
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.gnss.link_plan import Link
from vtff_sim_bridge.noise.random_streams import EPOCHS_PER_SECOND, Effect, generator

__all__ = ["Arc", "Tracker", "Tracks"]

BoolArray = npt.NDArray[np.bool_]

_AMBIGUITY_LIMIT = 1000
_LOCKED = FLAG_CODE_VALID | FLAG_PHASE_VALID


@dataclass(frozen=True)
class Arc:
    """Beginning of tracking, or a change of the ambiguity within: a row of the truth file.

    Parameters
    ----------
    epoch : int
        Number since the start.
    link : Link
    event : str
        ``lock``, ``lost``, ``slip``, ``half_cycle`` or ``parity``.
    cycles : float
        Carrier phase (RINEX sign) less the true range from now on, cycles.
    """

    epoch: int
    link: Link
    event: str
    cycles: float


@dataclass(frozen=True, eq=False)
class Tracks:
    """State of m links at k epochs; all of shape (k, m)."""

    is_tracked: BoolArray
    lock_time: FloatArray
    cycles: FloatArray
    flags: npt.NDArray[np.uint16]


class Tracker:
    """State of all links of one receiver.

    Parameters
    ----------
    links : sequence of Link
        All signals of all satellites that may ever be tracked.
    model : TrackingModel
    faults : sequence of Fault
        Faults of this receiver.
    seed, receiver : int
        Seed of the run; number of the receiver.
    report : callable
        Called with every `Arc`.
    """

    def __init__(
        self,
        links: Sequence[Link],
        model: TrackingModel,
        faults: Sequence[Fault],
        seed: int,
        receiver: int,
        report: Callable[[Arc], None],
    ) -> None:
        self._links = links
        self._model = model
        self._seed = seed
        self._receiver = receiver
        self._report = report
        count = len(links)
        self._is_tracked = np.zeros(count, dtype=bool)
        self._lock_epoch = np.zeros(count, dtype=np.int64)
        self._available_since = np.full(count, -1, dtype=np.int64)
        self._cycles = np.zeros(count)
        self._is_half_added = np.zeros(count, dtype=bool)
        self._parity_epoch = np.zeros(count, dtype=np.int64)
        self._parity_offset = np.zeros(count)
        self._has_parity = np.zeros(count, dtype=bool)
        self._outages = [f for f in faults if f.kind == "outage"]
        self._phase_faults = [f for f in faults if f.kind in ("slip", "half_cycle")]
        self._fault_epochs = {f.first_epoch for f in self._phase_faults}
        self._channel_of: dict[tuple[int, int], int] = {}

    def channels(self, satellites: Sequence[tuple[int, int]]) -> npt.NDArray[np.uint8]:
        """Return the channel number of each satellite (system, number); 0 for those without.

        GPS has the first ones, Galileo those behind.
        """
        numbers = [
            self._channel_of[satellite] + (self._model.channels if satellite[0] else 0)
            if satellite in self._channel_of
            else 0
            for satellite in satellites
        ]
        return np.array(numbers, dtype=np.uint8)

    def with_channel(
        self,
        satellites: Sequence[tuple[int, int]],
        elevation: FloatArray,
        is_visible: BoolArray,
    ) -> BoolArray:
        """Return which satellites have a channel at one epoch, shape (n,).

        A satellite keeps its channel while it is visible; free ones go to the highest others.

        Parameters
        ----------
        satellites : sequence of (int, int)
            System and number.
        elevation : ndarray, shape (n,)
        is_visible : ndarray of bool, shape (n,)
        """
        held = self._channel_of
        for index, satellite in enumerate(satellites):
            if satellite in held and not is_visible[index]:
                del held[satellite]
        for satellite in set(held) - set(satellites):
            del held[satellite]
        for index in np.argsort(-elevation, kind="stable").tolist():
            system = satellites[index][0]
            if not is_visible[index] or satellites[index] in held:
                continue
            taken = {number for (other, _), number in held.items() if other == system}
            free = set(range(self._model.channels)) - taken
            if free:
                held[satellites[index]] = min(free)
        return np.array([satellite in held for satellite in satellites], dtype=bool)

    def advance(
        self,
        first_epoch: int,
        rows: npt.NDArray[np.intp],
        can_track: BoolArray,
        slips: FloatArray | None = None,
    ) -> Tracks:
        """Go on over consecutive epochs.

        Parameters
        ----------
        first_epoch : int
            Number since the start.
        rows : ndarray of int, shape (m,)
            Links that may be tracked; all others are lost.
        can_track : ndarray of bool, shape (k, m)
            Signal is strong enough and has a channel.
        slips : ndarray, shape (k, m), optional
            By how many cycles each loop slips at each epoch, if it tracks; half cycles come with
            the half-cycle bit.

        Returns
        -------
        Tracks
            Tracking of all links, arrays of shape (k, m).
        """
        can_track = self._without_outages(first_epoch, rows, can_track)
        shape = can_track.shape
        tracks = Tracks(
            np.empty(shape, dtype=bool),
            np.empty(shape),
            np.empty(shape),
            np.empty(shape, np.uint16),
        )
        # Where something is to be done that the states of the links do not tell.
        is_event = np.zeros(len(can_track), dtype=bool)
        for epoch in self._fault_epochs:
            if first_epoch <= epoch < first_epoch + len(can_track):
                is_event[epoch - first_epoch] = True
        if slips is not None:
            is_event |= slips.any(axis=1)
        begin, is_settled = 0, False
        while True:
            begin = _follow_tracks(
                begin, is_settled, first_epoch, rows, can_track, is_event,
                self._is_tracked, self._available_since, self._acquisition_epochs,
                self._has_parity, self._parity_epoch, self._is_half_added,
                self._cycles, self._lock_epoch,
                tracks.is_tracked, tracks.lock_time, tracks.cycles, tracks.flags,
            )  # fmt: skip
            if begin == len(can_track):
                return tracks
            self._step(first_epoch + begin, rows, can_track[begin])
            if slips is not None:
                self._slip(first_epoch + begin, rows, slips[begin])
            is_settled = True

    def _without_outages(
        self, first_epoch: int, rows: npt.NDArray[np.intp], can_track: BoolArray
    ) -> BoolArray:
        for fault in self._outages:
            active = [fault.is_active(first_epoch + index) for index in range(len(can_track))]
            if any(active):
                hit = np.array([self._concerns(fault, row) for row in rows.tolist()], dtype=bool)
                can_track = can_track & ~(np.array(active)[:, None] & hit)
        return can_track

    def _concerns(self, fault: Fault, row: int) -> bool:
        link = self._links[row]
        return fault.concerns(link.system, link.prn, link.signal.name)

    @property
    def _acquisition_epochs(self) -> int:
        return round(self._model.acquisition_delay * EPOCHS_PER_SECOND)

    def _step(self, epoch: int, rows: npt.NDArray[np.intp], can_track: BoolArray) -> None:
        """Go on to an epoch at which something may change."""
        can = np.zeros(len(self._links), dtype=bool)
        can[rows[can_track]] = True
        lost = np.flatnonzero(self._is_tracked & ~can)
        self._is_tracked[lost] = False
        self._available_since[~can] = -1
        for row in lost.tolist():
            self._report(Arc(epoch, self._links[row], "lost", float(self._cycles[row])))
        begins = can & (self._available_since < 0)
        # What is there at the start of the run is locked at once.
        self._available_since[begins] = epoch if epoch else -self._acquisition_epochs
        locks = can & ~self._is_tracked
        locks &= epoch >= self._available_since + self._acquisition_epochs
        for row in np.flatnonzero(locks).tolist():
            self._lock(epoch, row)
        resolved = np.flatnonzero(
            self._is_tracked & ~self._has_parity & (self._parity_epoch <= epoch)
        )
        for row in resolved.tolist():
            self._resolve_parity(epoch, row)
        if epoch in self._fault_epochs:
            self._apply_phase_faults(epoch)

    def _lock(self, epoch: int, row: int) -> None:
        link = self._links[row]
        signal = link.signal
        random = generator(
            self._seed, Effect.AMBIGUITY, self._receiver,
            link.system, link.prn, signal.band, signal.attribute, epoch,
        )  # fmt: skip
        ambiguity = int(random.integers(-_AMBIGUITY_LIMIT, _AMBIGUITY_LIMIT + 1))
        is_half_off = bool(random.integers(2)) and signal.has_data
        delay = round(self._model.parity_delay * EPOCHS_PER_SECOND) if signal.has_data else 0
        self._is_tracked[row] = True
        self._lock_epoch[row] = epoch
        self._has_parity[row] = delay == 0
        self._parity_epoch[row] = epoch + delay
        self._parity_offset[row] = 0.5 if is_half_off else 0.0
        self._is_half_added[row] = is_half_off and delay == 0
        self._cycles[row] = ambiguity - (self._parity_offset[row] if delay else 0.0)
        self._report(Arc(epoch, link, "lock", float(self._cycles[row])))

    def _resolve_parity(self, epoch: int, row: int) -> None:
        """Add the half cycle that the carrier loop was off by, and set its bit in the status."""
        self._has_parity[row] = True
        self._is_half_added[row] = self._parity_offset[row] != 0.0
        self._cycles[row] += self._parity_offset[row]
        self._report(Arc(epoch, self._links[row], "parity", float(self._cycles[row])))

    def _slip(self, epoch: int, rows: npt.NDArray[np.intp], slips: FloatArray) -> None:
        """Let loops slip that do not notice it: their lock times grow on."""
        for column in np.flatnonzero((slips != 0.0) & self._is_tracked[rows]).tolist():
            row = int(rows[column])
            self._cycles[row] += slips[column]
            is_half = slips[column] % 1.0 != 0.0
            self._is_half_added[row] ^= is_half
            event = "half_cycle" if is_half else "slip"
            self._report(Arc(epoch, self._links[row], event, float(self._cycles[row])))

    def _apply_phase_faults(self, epoch: int) -> None:
        for fault in self._phase_faults:
            if fault.first_epoch != epoch:
                continue
            for row in np.flatnonzero(self._is_tracked).tolist():
                if not self._concerns(fault, row):
                    continue
                if fault.kind == "half_cycle":
                    self._cycles[row] += 0.5
                    self._is_half_added[row] ^= True
                else:
                    self._cycles[row] += fault.cycles
                    if not fault.is_silent_slip:
                        self._lock_epoch[row] = epoch
                self._report(Arc(epoch, self._links[row], fault.kind, float(self._cycles[row])))


@compiled
def _follow_tracks(  # type: ignore[no-untyped-def]
    begin,
    is_settled,
    first_epoch,
    rows,
    can_track,
    is_event,
    is_tracked,
    available_since,
    acquisition_epochs,
    has_parity,
    parity_epoch,
    is_half_added,
    cycles,
    lock_epoch,
    tracked_out,
    lock_time_out,
    cycles_out,
    flags_out,
):
    """Fill in the tracks from an epoch on, as long as the state of no link has to change.

    Parameters
    ----------
    begin : int
        Index of that epoch.
    is_settled : bool
        Whether the states are already those of this epoch.
    first_epoch, rows, can_track
        As in `Tracker.advance`.
    is_event : ndarray of bool, shape (k,)
        Where states change for other reasons than those that the states tell.
    is_tracked, ..., lock_epoch : ndarray, shape (links,)
        States of all links.
    tracked_out, ..., flags_out : ndarray, shape (k, m)
        Fields of `Tracks`.

    Returns
    -------
    int
        Index of the first epoch that is not filled in, whose states are to be found first.
    """
    epochs, links = can_track.shape
    # Links that may no longer be tracked are lost at the first epoch.
    known = 0
    for m in range(links):
        known += is_tracked[rows[m]] or available_since[rows[m]] >= 0
    for row in range(len(is_tracked)):
        known -= is_tracked[row] or available_since[row] >= 0
    for k in range(begin, epochs):
        epoch = first_epoch + k
        if k > begin or not is_settled:
            if known != 0 or is_event[k]:
                return k
            for m in range(links):
                row = rows[m]
                if is_tracked[row]:
                    if not can_track[k, m] or (not has_parity[row] and parity_epoch[row] <= epoch):
                        return k
                elif can_track[k, m]:
                    since = available_since[row]
                    if since < 0 or epoch >= since + acquisition_epochs:
                        return k
                elif available_since[row] >= 0:
                    return k
        for m in range(links):
            row = rows[m]
            tracked_out[k, m] = is_tracked[row]
            lock_time_out[k, m] = (epoch - lock_epoch[row]) / EPOCHS_PER_SECOND
            cycles_out[k, m] = cycles[row]
            flags = _LOCKED
            if has_parity[row]:
                flags |= FLAG_PARITY_KNOWN
            if is_half_added[row]:
                flags |= FLAG_HALF_CYCLE_ADDED
            flags_out[k, m] = flags
    return epochs

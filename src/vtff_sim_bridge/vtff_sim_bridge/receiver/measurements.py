"""Measurements of a simulated receiver, and the observations that its logs carry."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.observations import ObservationSeries
from vtff_sim_bridge.noise.random_streams import EPOCH_NANOSECONDS
from vtff_sim_bridge.receiver.arriving_signals import ArrivingSignals
from vtff_sim_bridge.receiver.observables import Observables
from vtff_sim_bridge.receiver.tracking import Tracks

__all__ = ["Measurements", "epoch_times"]


@functools.lru_cache(maxsize=2)
def epoch_times(start: GpsTime, first: int, last: int) -> tuple[GpsTime, ...]:
    """Return the times of epochs `first` to `last` since the start of a run.

    All receivers ask for the same ones.
    """
    return tuple(
        GpsTime(start.nanoseconds + epoch * EPOCH_NANOSECONDS) for epoch in range(first, last + 1)
    )


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measurements of a receiver at consecutive epochs of a second: k epochs, m links.

    Parameters
    ----------
    start : GpsTime
        Start of the run.
    time_status : int
        Time status that the receiver states.
    first_epoch : int
        Number of the first epoch since the start of the run.
    signals : ArrivingSignals
        The truth that was measured.
    tracks : Tracks
        State of the tracking loops, (k, m).
    observables : Observables
        (k, m).
    channel : ndarray of uint8, shape (k, n)
        Channel number of each satellite.
    """

    start: GpsTime
    time_status: int
    first_epoch: int
    signals: ArrivingSignals
    tracks: Tracks
    observables: Observables
    channel: npt.NDArray[np.uint8]

    @cached_property
    def series(self) -> ObservationSeries:
        """Observations in the precision of the log, of the links tracked at any of the epochs."""
        plan, observables = self.signals.plan, self.observables
        is_tracked = self.tracks.is_tracked
        used = np.flatnonzero(is_tracked.any(axis=0))
        if len(used) == len(plan.row):
            used = slice(None)  # type: ignore[assignment]
        last_epoch = self.first_epoch + len(is_tracked) - 1
        return ObservationSeries(
            times=epoch_times(self.start, self.first_epoch, last_epoch),
            time_status=self.time_status,
            receiver_status=0,
            log_name="RANGE",
            is_observed=is_tracked[:, used],
            system=plan.system[used],
            prn=plan.prn[used],
            band=plan.band[used],
            attribute=plan.attribute[used],
            glonass_channel=np.zeros(plan.system[used].shape, dtype=np.int8),
            pseudorange=observables.pseudorange[:, used],
            carrier_phase_cycles=observables.carrier_phase_cycles[:, used],
            doppler_hz=observables.doppler_hz[:, used].astype(np.float32),
            cn0_dbhz=observables.cn0_dbhz[:, used].astype(np.float32),
            pseudorange_sigma=observables.sigmas.code[:, used].astype(np.float32),
            carrier_phase_sigma_cycles=(observables.sigmas.phase / plan.wavelength)[:, used].astype(
                np.float32
            ),
            lock_time=self.tracks.lock_time[:, used].astype(np.float32),
            flags=self.tracks.flags[:, used],
            channel=self.channel[:, plan.satellite[used]],
        )

    def tracked_satellites(self, index: int) -> list[int]:
        """Return the columns of the satellites that are tracked at an epoch."""
        counts = np.bincount(self.signals.plan.satellite[self.tracks.is_tracked[index]])
        columns: list[int] = np.flatnonzero(counts).tolist()
        return columns

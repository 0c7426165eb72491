"""Measurements of a simulated receiver, and the observations that its logs carry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.observations import EpochTimes, ObservationSeries
from vtff_sim_bridge.noise.random_streams import EPOCH_NANOSECONDS
from vtff_sim_bridge.receiver.arriving_signals import ArrivingSignals
from vtff_sim_bridge.receiver.observables import Observables
from vtff_sim_bridge.receiver.tracking import Tracks

__all__ = ["Measurements"]


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
    channel : ndarray of uint8, shape (k, m)
        Channel number of each link.
    """

    start: GpsTime
    time_status: int
    first_epoch: int
    signals: ArrivingSignals
    tracks: Tracks
    observables: Observables
    channel: npt.NDArray[np.uint8]

    @cached_property
    def times(self) -> EpochTimes:
        """Times of the epochs."""
        begin = self.start.nanoseconds + self.first_epoch * EPOCH_NANOSECONDS
        end = begin + self.signals.epoch_count * EPOCH_NANOSECONDS
        return EpochTimes(range(begin, end, EPOCH_NANOSECONDS))

    @cached_property
    def series(self) -> ObservationSeries:
        """Observations of all links, whether tracked or not, in full precision."""
        plan, observables, tracks = self.signals.plan, self.observables, self.tracks
        return ObservationSeries(
            times=self.times,
            time_status=self.time_status,
            receiver_status=0,
            log_name="RANGE",
            is_observed=tracks.is_tracked,
            system=plan.system,
            prn=plan.prn,
            band=plan.band,
            attribute=plan.attribute,
            glonass_channel=plan.glonass_channel,
            pseudorange=observables.pseudorange,
            carrier_phase_cycles=observables.carrier_phase_cycles,
            doppler_hz=observables.doppler_hz,
            cn0_dbhz=observables.cn0_dbhz,
            pseudorange_sigma=observables.sigmas.code,
            carrier_phase_sigma_cycles=observables.sigmas.phase / plan.wavelength,
            lock_time=tracks.lock_time,
            flags=tracks.flags,
            channel=self.channel,
        )

    def tracked_satellites(self, index: int) -> list[int]:
        """Return the columns of the satellites that are tracked at an epoch."""
        counts = np.bincount(self.signals.plan.satellite[self.tracks.is_tracked[index]])
        columns: list[int] = np.flatnonzero(counts).tolist()
        return columns

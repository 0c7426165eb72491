"""What a simulated receiver has measured, and its observations as an epoch of a log."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.observations import ObservationSeries
from vtff_gnss.orbits.line_of_sight import LineOfSight
from vtff_sim_bridge.gnss.random_streams import EPOCH_NANOSECONDS
from vtff_sim_bridge.receiver.observables import LinkPlan, Sigmas
from vtff_sim_bridge.receiver.tracking import Tracks

__all__ = ["Measurements"]


@dataclass(frozen=True, eq=False)
class Measurements:
    """What a receiver has measured in a part of a second: k epochs, m links, n satellites.

    Parameters
    ----------
    start : GpsTime
        Of the run.
    time_status : int
        What the receiver knows of the time.
    first_epoch : int
        Number of the first epoch since the start of the run.
    plan : LinkPlan
    line_of_sight : LineOfSight
        True geometry, (k, n).
    position_itrf, velocity_itrf : ndarray, shape (k, 3)
        True, at reception.
    clock_offset, clock_drift : ndarray, shape (k,)
        s, s/s; receiver clock less GPS time.
    slant_tec_tecu : ndarray, shape (k, n)
    s4_l1 : ndarray, shape (k, n)
        Greatest of the regions that the ray crosses.
    tracks : Tracks
        (k, m).
    pseudorange, carrier_phase_cycles, doppler_hz, cn0_dbhz : ndarray, shape (k, m)
    sigmas : Sigmas
        (k, m).
    channel : ndarray of uint8, shape (k, n)
    """

    start: GpsTime
    time_status: int
    first_epoch: int
    plan: LinkPlan
    line_of_sight: LineOfSight
    position_itrf: FloatArray
    velocity_itrf: FloatArray
    clock_offset: FloatArray
    clock_drift: FloatArray
    slant_tec_tecu: FloatArray
    s4_l1: FloatArray
    tracks: Tracks
    pseudorange: FloatArray
    carrier_phase_cycles: FloatArray
    doppler_hz: FloatArray
    cn0_dbhz: FloatArray
    sigmas: Sigmas
    channel: npt.NDArray[np.uint8]

    @cached_property
    def series(self) -> ObservationSeries:
        """Observations in the precision of the log, of the links tracked at any of the epochs."""
        plan, is_tracked = self.plan, self.tracks.is_tracked
        used = np.flatnonzero(is_tracked.any(axis=0))
        if len(used) == len(plan.row):
            used = slice(None)  # type: ignore[assignment]
        epochs = range(self.first_epoch, self.first_epoch + len(is_tracked))
        start = self.start.nanoseconds
        return ObservationSeries(
            times=[GpsTime(start + epoch * EPOCH_NANOSECONDS) for epoch in epochs],
            time_status=self.time_status,
            receiver_status=0,
            log_name="RANGE",
            is_observed=is_tracked[:, used],
            system=plan.system[used],
            prn=plan.prn[used],
            band=plan.band[used],
            attribute=plan.attribute[used],
            glonass_channel=np.zeros(plan.system[used].shape, dtype=np.int8),
            pseudorange=self.pseudorange[:, used],
            carrier_phase_cycles=self.carrier_phase_cycles[:, used],
            doppler_hz=self.doppler_hz[:, used].astype(np.float32),
            cn0_dbhz=self.cn0_dbhz[:, used].astype(np.float32),
            pseudorange_sigma=self.sigmas.code[:, used].astype(np.float32),
            carrier_phase_sigma_cycles=(self.sigmas.phase / plan.wavelength)[:, used].astype(
                np.float32
            ),
            lock_time=self.tracks.lock_time[:, used].astype(np.float32),
            flags=self.tracks.flags[:, used],
            channel=self.channel[:, plan.satellite[used]],
        )

    def tracked_satellites(self, index: int) -> list[int]:
        """Return the columns of the satellites that are tracked at an epoch."""
        counts = np.bincount(self.plan.satellite[self.tracks.is_tracked[index]])
        columns: list[int] = np.flatnonzero(counts).tolist()
        return columns

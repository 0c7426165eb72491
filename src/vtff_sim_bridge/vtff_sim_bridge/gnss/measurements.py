"""What a simulated receiver has measured, and its observations as an epoch of a log."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vtff_dynamics.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.line_of_sight import LineOfSight
from vtff_gnss.novatel.encode_frame import TIME_STATUS_FINE_STEERING
from vtff_gnss.observations import ObservationEpoch
from vtff_sim_bridge.gnss.observables import LinkPlan, Sigmas
from vtff_sim_bridge.gnss.tracking import Tracks

__all__ = ["Measurements", "VehicleTrack"]


@dataclass(frozen=True, eq=False)
class VehicleTrack:
    """Motion of a vehicle at the 20 time tags of a second; Earth-fixed, each of shape (20, 3)."""

    position_itrf: FloatArray
    velocity_itrf: FloatArray
    acceleration_itrf: FloatArray


@dataclass(frozen=True, eq=False)
class Measurements:
    """What a receiver has measured in a part of a second: k epochs, m links, n satellites.

    Parameters
    ----------
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
    channel : ndarray of uint8, shape (n,)
    """

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
    def _used(self) -> npt.NDArray[np.intp]:
        """Links that are tracked at any of the epochs."""
        return np.flatnonzero(self.tracks.is_tracked.any(axis=0))

    @cached_property
    def _is_used_tracked(self) -> npt.NDArray[np.bool_]:
        return self.tracks.is_tracked[:, self._used]

    @cached_property
    def _names(self) -> dict[str, npt.NDArray[np.generic]]:
        """Columns of the log that do not change, shape (used links,)."""
        plan, used = self.plan, self._used
        return {
            "system": plan.system[used],
            "prn": plan.prn[used],
            "band": plan.band[used],
            "attribute": plan.attribute[used],
            "glonass_channel": np.zeros(len(used), dtype=np.int8),
        }

    @cached_property
    def _logged(self) -> dict[str, npt.NDArray[np.generic]]:
        """Columns of the log in its precision, shape (k, used links)."""
        used = self._used
        phase_sigma_cycles = self.sigmas.phase / self.plan.wavelength
        return {
            "pseudorange": self.pseudorange[:, used],
            "carrier_phase_cycles": self.carrier_phase_cycles[:, used],
            "doppler_hz": self.doppler_hz[:, used].astype(np.float32),
            "cn0_dbhz": self.cn0_dbhz[:, used].astype(np.float32),
            "pseudorange_sigma": self.sigmas.code[:, used].astype(np.float32),
            "carrier_phase_sigma_cycles": phase_sigma_cycles[:, used].astype(np.float32),
            "lock_time": self.tracks.lock_time[:, used].astype(np.float32),
            "flags": self.tracks.flags[:, used],
        }

    def tracked_satellites(self, index: int) -> list[int]:
        """Return the columns of the satellites that are tracked at an epoch."""
        columns: list[int] = np.unique(self.plan.satellite[self.tracks.is_tracked[index]]).tolist()
        return columns

    def epoch(self, index: int, time: GpsTime) -> ObservationEpoch:
        """Return the observations of the epoch with a number in this part of a second."""
        is_tracked = self._is_used_tracked[index]
        columns = {name: column[index] for name, column in self._logged.items()} | self._names
        if not is_tracked.all():
            columns = {name: column[is_tracked] for name, column in columns.items()}
        return ObservationEpoch(
            time=time,
            time_status=TIME_STATUS_FINE_STEERING,
            receiver_status=0,
            log_name="RANGE",
            **columns,  # type: ignore[arg-type]
        )

"""Observations of a receiver without errors, as a small synthetic input of algorithms."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    DELAY_PER_TECU,
    FLAG_CODE_VALID,
    FLAG_PARITY_KNOWN,
    FLAG_PHASE_VALID,
    FREQUENCY_L1,
    FREQUENCY_L2,
)
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.satellite_table import SatelliteTable

__all__ = ["ideal_observations"]

_LOWEST_ELEVATION = 0.2  # rad


def ideal_observations(
    table: SatelliteTable, time: GpsTime, state_itrf: FloatArray, content_tecu: float = 0.0
) -> ObservationEpoch:
    """Return what a receiver observes of the signals L1C and L2W, without noise and ambiguities.

    Parameters
    ----------
    table : SatelliteTable
    time : GpsTime
    state_itrf : ndarray, shape (6,)
        Position (m) and velocity (m/s) of the antenna.
    content_tecu : float
        Slant TEC of each signal.
    """
    sight = lines_of_sight(table, time, np.zeros(1), state_itrf[None, :3], state_itrf[None, 3:])
    rows = np.flatnonzero(sight.elevation[0] > _LOWEST_ELEVATION).repeat(2)
    frequency = np.resize((FREQUENCY_L1, FREQUENCY_L2), len(rows))
    wavelength = SPEED_OF_LIGHT / frequency
    ranges = (sight.range - SPEED_OF_LIGHT * sight.clock_offset_satellite)[0, rows]
    delay = DELAY_PER_TECU * content_tecu / frequency**2
    columns = {
        "system": table.system[rows],
        "prn": table.prn[rows],
        "band": np.resize((1, 2), len(rows)),
        "attribute": np.resize((ord("C"), ord("W")), len(rows)),
        "pseudorange": ranges + delay,
        "carrier_phase_cycles": (ranges - delay) / wavelength,
        "doppler_hz": -sight.range_rate[0, rows] / wavelength,
        "cn0_dbhz": np.full(len(rows), 45.0),
        "lock_time": np.full(len(rows), 1e5),
        "flags": np.full(len(rows), FLAG_CODE_VALID | FLAG_PHASE_VALID | FLAG_PARITY_KNOWN),
    }
    typed = {
        name: np.asarray(columns.get(name, np.zeros(len(rows))), dtype=kind)
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    return ObservationEpoch(time, 180, 0, "ideal", **typed)

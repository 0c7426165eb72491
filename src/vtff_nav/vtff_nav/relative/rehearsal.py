"""Some epochs of an imagined formation, in which an estimator compiles all that it needs.

The first epochs of a node cannot wait for compilation, which takes seconds without a cache.
"""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import GM_EARTH, SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import state_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.orbit.gravity import predict_state
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import (
    FLAG_CODE_VALID,
    FLAG_PARITY_KNOWN,
    FLAG_PHASE_VALID,
    FREQUENCY_L1,
    FREQUENCY_L2,
)
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_nav.relative.common.solution import RelativeEstimator, RelativeSolution

__all__ = ["rehearse"]

_START = GpsTime.from_week_tow(2000, 0.0)
_RADIUS, _DISTANCE = 7e6, 500.0
_LOWEST_ELEVATION = 0.2
# The noise is learnt, and all of its models weighed, from the third epoch on.
_EPOCHS = 6


def rehearse(estimator: RelativeEstimator, *, is_in_orbit: bool = True) -> RelativeSolution:
    """Have an estimator process some epochs, of which it is told nothing but what it must compile.

    Parameters
    ----------
    estimator : RelativeEstimator
        An estimator that is not used for anything else.
    is_in_orbit : bool
        Whether the receivers fly; on the ground otherwise.

    Returns
    -------
    RelativeSolution
        Solution of the last epoch.
    """
    ephemerides = nominal_gps_constellation(_START, _START + 60.0)
    for ephemeris in ephemerides:
        estimator.add_ephemeris(ephemeris)
    table = EphemerisStore(ephemerides).table(_START)
    rest = np.array([6.37e6, 0.0, 0.0, 0.0, 0.0, 0.0])
    speed = np.sqrt(GM_EARTH / _RADIUS)
    chief_gcrf = state_itrf_to_gcrf(_START, [_RADIUS, 0.0, 0.0, 0.0, 0.7 * speed, 0.7 * speed])
    for second in range(_EPOCHS):
        time = _START + float(second)
        chief = rest
        if is_in_orbit:
            chief = state_gcrf_to_itrf(time, predict_state(chief_gcrf, float(second)))
        deputy = chief + np.array([0.0, _DISTANCE, 0.0, 0.0, 0.0, 0.0])
        estimator.add_thrust(time, 1.0, [0.0, 1e-6, 0.0])
        observed = [_observe(table, time, state) for state in (chief, deputy)]
        solution = estimator.process(time, observed[0], observed[1])
    return solution


def _observe(table: SatelliteTable, time: GpsTime, state_itrf: FloatArray) -> ObservationEpoch:
    """Return the observations of a receiver without errors."""
    sight = lines_of_sight(table, time, np.zeros(1), state_itrf[None, :3], state_itrf[None, 3:])
    rows = np.flatnonzero(sight.elevation[0] > _LOWEST_ELEVATION).repeat(2)
    wavelength = SPEED_OF_LIGHT / np.resize((FREQUENCY_L1, FREQUENCY_L2), len(rows))
    ranges = (sight.range - SPEED_OF_LIGHT * sight.clock_offset_satellite)[0, rows]
    columns = {
        "system": table.system[rows],
        "prn": table.prn[rows],
        "band": np.resize((1, 2), len(rows)),
        "attribute": np.resize((ord("C"), ord("W")), len(rows)),
        "pseudorange": ranges,
        "carrier_phase_cycles": ranges / wavelength,
        "doppler_hz": -sight.range_rate[0, rows] / wavelength,
        "lock_time": np.full(len(rows), 100.0 + (time - _START)),
        "flags": np.full(len(rows), FLAG_CODE_VALID | FLAG_PHASE_VALID | FLAG_PARITY_KNOWN),
    }
    typed = {
        name: np.asarray(columns.get(name, np.zeros(len(rows))), dtype=kind)
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    return ObservationEpoch(time, 180, 0, "rehearsal", **typed)

"""Some seconds of an imagined formation, in which the processing compiles what it needs."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.earth import state_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.orbit.gravity import predict_state
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.ideal_receiver import ideal_observations
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_gnss.signals import SignalKey
from vtff_iono.formation_ionosphere import FormationIonosphere
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

__all__ = ["process_synthetic_seconds"]

_START = GpsTime.from_week_tow(2000, 0.0)
_RADIUS = 6.8e6
_BEHIND, _ABOVE = 500.0, 300.0  # m that the deputy is from the chief
_SECONDS, _RATE = 5, 10
_WALL, _BEFORE, _AFTER = 2.0, 20.0, 60.0  # s after the start at which the content changes, TECU


def process_synthetic_seconds(formation: FormationIonosphere) -> None:
    """Process some seconds of a formation that crosses a wall of plasma.

    Parameters
    ----------
    formation : FormationIonosphere
        A formation of two that is used for nothing else.
    """
    ephemerides = nominal_gps_constellation(_START, _START + _SECONDS)
    for ephemeris in ephemerides:
        formation.add_ephemeris(ephemeris)
    table = EphemerisStore(ephemerides).table(_START)
    speed = np.sqrt(GM_EARTH / _RADIUS)
    orbit = state_itrf_to_gcrf(_START, [_RADIUS, 0.0, 0.0, 0.0, 0.7 * speed, 0.7 * speed])
    for second in range(1, _SECONDS + 1):
        blocks, states = [], []
        for behind, above in ((0.0, 0.0), (_BEHIND / speed, _ABOVE)):
            since = second - 1.0 + np.arange(1, _RATE + 1) / _RATE
            of_epochs = [_state(orbit, each, behind, above) for each in since]
            blocks.append(_observe(table, since, of_epochs, behind))
            states.append(of_epochs[-1])
        keys = zip(*(blocks[0].columns[name].tolist() for name in SignalKey._fields), strict=True)
        integers = {SignalKey(*key): 0.0 for key in keys}
        time = (_START + float(second)).nanoseconds
        formation.process(FormationSecond(time, tuple(blocks), tuple(states), (integers,), (0.01,)))


def _state(orbit: FloatArray, since: float, behind: float, above: float) -> FloatArray:
    state = predict_state(orbit, since - behind)
    state[:3] *= 1.0 + above / _RADIUS
    return state_gcrf_to_itrf(_START + since, state)


def _observe(
    table: SatelliteTable, since: FloatArray, states: list[FloatArray], behind: float
) -> ObservationBlock:
    epochs = []
    for moment, state in zip(since, states, strict=True):
        content = _BEFORE if moment - behind < _WALL else _AFTER
        epochs.append(ideal_observations(table, _START + moment, state, content))
    times = [np.full(len(epoch), epoch.time.nanoseconds) for epoch in epochs]
    columns = {
        name: np.concatenate([getattr(epoch, name) for epoch in epochs])
        for name in OBSERVATION_COLUMNS
    }
    return ObservationBlock(np.concatenate(times), columns)

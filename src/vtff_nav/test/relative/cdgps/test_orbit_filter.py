"""Ambiguities of the chief's orbit filter when a satellite is out of sight for seconds."""

import numpy as np
import pytest
from cdgps_test_support import START, configuration, simulate

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_nav.relative.cdgps.orbit_filter import AbsoluteFilter
from vtff_nav.relative.common.measurements import (
    SignalReader,
    compute_geometry,
    satellite_mask,
    satellite_numbers,
)

SECONDS = 12
LAST_SEEN = 2


@pytest.fixture(scope="module")
def scenario():
    return simulate(SECONDS)


def ambiguities_by_second(scenario, absent=None):
    """Return the ambiguities of each second; a satellite is `absent` after second `LAST_SEEN`."""
    parameters = configuration()
    orbit = AbsoluteFilter(parameters)
    reader = SignalReader(parameters.measurement_noise, parameters.bands)
    store = EphemerisStore(scenario.ephemerides)
    labels, ambiguities = set(), []
    for second in range(SECONDS):
        time = START + float(second)
        table = store.table(time)
        epoch, state = scenario.chief[time], scenario.chief_gcrf[second]
        signals = reader.read(epoch, satellite_mask(satellite_numbers(table)))
        if second > LAST_SEEN and absent is not None:
            signals = signals.select(np.flatnonzero(signals.satellite != absent))
        if second == 0:
            assert orbit.start(time, epoch.time, signals, table)
        else:
            # The motion is known, so that only the observations are judged.
            mean = np.concatenate((state, np.zeros(3)))
            orbit.predict(mean, np.eye(9), np.zeros((9, 9)))
        states = np.tile(state_gcrf_to_itrf(time, state), (2, 1))
        offsets = np.full(2, epoch.time - time - orbit.clock)
        seen = compute_geometry(table, time, offsets, states, rotation_gcrf_to_itrf(time))
        orbit.update(time, signals, table, seen)
        labels |= {("ambiguity", satellite, 2) for satellite in signals.satellite.tolist()}
        ambiguities.append({label for label in labels if label in orbit.state})
    return ambiguities


def test_an_ambiguity_is_forgotten_after_5_s_without_its_satellite(scenario):
    """Later a slip between the last and the next sight of it would be as likely as none."""
    undisturbed = ambiguities_by_second(scenario)
    assert len(undisturbed[-1]) >= 8
    assert all(labels == undisturbed[0] for labels in undisturbed)
    label = min(undisturbed[0])
    present = [label in labels for labels in ambiguities_by_second(scenario, absent=label[1])]
    assert present == [second <= LAST_SEEN + 5 for second in range(SECONDS)]

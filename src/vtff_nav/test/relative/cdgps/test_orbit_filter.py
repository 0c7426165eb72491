"""Ambiguities of the chief's orbit filter when a satellite is out of sight for seconds."""

import dataclasses

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


def filter_by_second(scenario, change=None):
    """Yield the filter after each second; `change(signals)` is used after second `LAST_SEEN`."""
    parameters = configuration()
    orbit = AbsoluteFilter(parameters)
    reader = SignalReader(parameters.measurement_noise, parameters.bands)
    store = EphemerisStore(scenario.ephemerides)
    for second in range(SECONDS):
        time = START + float(second)
        table = store.table(time)
        epoch, state = scenario.chief[time], scenario.chief_gcrf[second]
        signals = reader.read(epoch, satellite_mask(satellite_numbers(table)))
        if second > LAST_SEEN and change is not None:
            signals = change(signals)
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
        yield orbit
        if orbit.state is None:
            return


def ambiguities_by_second(scenario, absent=None):
    """Return the ambiguities of each second; a satellite is `absent` after second `LAST_SEEN`."""

    def leave_out(signals):
        return signals.select(np.flatnonzero(signals.satellite != absent))

    change = None if absent is None else leave_out
    return [
        {label for label in orbit.state.labels if label[0] == "ambiguity"}
        for orbit in filter_by_second(scenario, change)
    ]


def test_the_filter_starts_anew_after_seconds_in_which_most_measurements_are_wrong(scenario):
    generator = np.random.default_rng(7)

    def spoil(signals):
        errors = generator.normal(0.0, 1e4, (2, len(signals)))
        return dataclasses.replace(
            signals,
            pseudorange=signals.pseudorange + errors[0],
            carrier_range=signals.carrier_range + errors[1],
        )

    alive = [orbit.state is not None for orbit in filter_by_second(scenario, spoil)]
    bad = len(alive) - 1 - LAST_SEEN
    assert alive == [True] * (LAST_SEEN + bad) + [False]
    assert bad == 5


def test_an_ambiguity_is_forgotten_after_5_s_without_its_satellite(scenario):
    """Later a slip between the last and the next sight of it would be as likely as none."""
    undisturbed = ambiguities_by_second(scenario)
    assert len(undisturbed[-1]) >= 8
    assert all(labels == undisturbed[0] for labels in undisturbed)
    label = min(undisturbed[0])
    present = [label in labels for labels in ambiguities_by_second(scenario, absent=label[1])]
    assert present == [second <= LAST_SEEN + 5 for second in range(SECONDS)]

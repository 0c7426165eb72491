"""Ambiguities of the chief's orbit filter when a satellite is out of sight for seconds."""

import dataclasses

import numpy as np
import pytest
from cdgps_test_support import START, configuration, simulate

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_gnss.constants import FLAG_HALF_CYCLE_ADDED
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_nav.relative.cdgps.orbit_filter import (
    _QUIET_EVIDENCE,
    AbsoluteFilter,
    mean_of_receivers,
)
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.measurements import (
    SignalReader,
    compute_geometry,
    satellite_mask,
    satellite_numbers,
)
from vtff_nav.relative.common.orbit_single_point import Combinations

SECONDS = 12
LAST_SEEN = 2


@pytest.fixture(scope="module")
def scenario():
    return simulate(SECONDS)


def filter_by_second(scenario, change=None, first=LAST_SEEN + 1, position_noise=0.0):
    """Yield the filter after each second; `change(signals)` is used from second `first` on.

    The motion is known but for white noise of the position on each axis, m.
    """
    noise = np.diag(np.repeat((position_noise**2, 0.0), (3, 6)))
    parameters = configuration()
    orbit = AbsoluteFilter(parameters)
    reader = SignalReader(parameters.measurement_noise, parameters.bands)
    store = EphemerisStore(scenario.ephemerides)
    for second in range(SECONDS):
        time = START + float(second)
        table = store.table(time)
        epoch, state = scenario.chief[time], scenario.chief_gcrf[second]
        signals = reader.read(epoch, satellite_mask(satellite_numbers(table)))
        if second >= first and change is not None:
            signals = change(signals)
        if second == 0:
            assert orbit.start(time, epoch.time, signals, table)
        else:
            mean = np.concatenate((state, np.zeros(3)))
            orbit.predict(mean, np.eye(9), noise, 1.0)
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
        {label for label in orbit.state.labels if label[0] == "chief_ambiguity"}
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


@pytest.mark.parametrize("told_by", ["flags", "lock_time"])
def test_half_a_cycle_that_a_receiver_adds_or_loses_is_no_motion(scenario, told_by):
    """A tenth of a metre in every other satellite at once: more than faults can be told by."""

    def correct(signals):
        is_corrected = (signals.satellite % 2 == 0) & (signals.band == 1)
        half = 0.5 * signals.wavelength * is_corrected
        columns = {"carrier_range": signals.carrier_range + half}
        if told_by == "flags":
            columns["flags"] = signals.flags ^ np.where(
                is_corrected, FLAG_HALF_CYCLE_ADDED, 0
            ).astype(signals.flags.dtype)
        else:
            columns["lock_time"] = np.where(is_corrected, 0.5, signals.lock_time)
        return dataclasses.replace(signals, **columns)

    positions = []
    for change in (None, correct):
        filters = filter_by_second(scenario, change, LAST_SEEN, position_noise=1.0)
        positions.append([orbit.mean[:3].copy() for orbit in filters][LAST_SEEN])
    assert np.linalg.norm(positions[1] - positions[0]) < 0.1


def range_errors(scenario, sigma):
    """Return the filter after satellites with range errors of a sigma (m), and the errors."""
    generator = np.random.default_rng(5)
    errors: dict[int, float] = {}

    def shift(signals):
        satellites = signals.satellite.tolist()
        for satellite in satellites:
            errors.setdefault(satellite, sigma * generator.standard_normal())
        error = np.array([errors[satellite] for satellite in satellites])
        return dataclasses.replace(
            signals,
            pseudorange=signals.pseudorange + error,
            carrier_range=signals.carrier_range + error,
        )

    *_, orbit = filter_by_second(scenario, shift, first=0)
    return orbit, np.array(list(errors.values()))


def test_the_sigma_of_range_errors_is_that_of_the_satellites(scenario):
    orbit, errors = range_errors(scenario, 3.0)
    assert orbit.broadcast_sigma == pytest.approx(float(np.std(errors)), rel=0.4)
    orbit, _ = range_errors(scenario, 0.0)
    assert orbit.broadcast_sigma < 0.7


def test_the_sigma_of_small_range_errors_does_not_collapse(scenario):
    """Ten satellites cannot tell that their codes are without biases."""
    bias = configuration().code_bias_sigma
    orbit, _ = range_errors(scenario, 0.1)
    sigmas = [orbit.state.sigma(label) for label in orbit.state.labels if label[0] == "range_error"]
    assert 0.4 * bias < min(sigmas) <= max(sigmas) < 1.5 * bias


def test_range_errors_do_not_average_out(scenario):
    """The stated sigma of the position stays that of the range errors, not of their mean."""
    orbit, _ = range_errors(scenario, 3.0)
    sigma = np.sqrt(np.trace(orbit.covariance[:3, :3]))
    assert sigma > 0.5 * orbit.broadcast_sigma


@pytest.mark.parametrize(("offset", "is_quiet"), [(0.0, True), (2.0, False)])
def test_offsets_of_satellites_tell_of_broadcast_errors(offset, is_quiet):
    """Where ranges as small as biases do not decide; also when the offsets have left."""
    generator = np.random.default_rng(4)
    orbit, count = AbsoluteFilter(configuration()), 7
    ranges, offsets = (
        [(kind, index) for index in range(count)] for kind in ("range_error", "satellite_offset")
    )
    sigmas = np.repeat([orbit._range_sigma, orbit.broadcast_sigma], count)
    orbit.state = GaussianState([*ranges, *offsets], np.zeros(2 * count), np.diag(sigmas**2))
    noise = np.repeat([1.5, 0.2], count)
    values = np.repeat([0.3, offset], count) * generator.standard_normal(2 * count)
    values += noise * generator.standard_normal(2 * count)
    design, empty = np.eye(2 * count), np.zeros((2 * count, 0))
    orbit.state.update(orbit.state.innovation(design, values, noise**2, empty))
    needed = np.log(_QUIET_EVIDENCE)
    assert (orbit._quiet_evidence() > needed) == is_quiet
    orbit.state.remove(offsets)
    of_ranges = orbit._quiet_evidence() - orbit._offset_evidence
    assert of_ranges < needed
    assert (orbit._offset_evidence == needed) == is_quiet


@pytest.mark.parametrize("kind", ["code", "phase"])
def test_measurements_of_the_deputy_are_further_ones_of_the_chief(kind):
    """The mean of both has half the variance, and neither the deputy's clock nor its place."""
    generator = np.random.default_rng(2)
    satellites, count = np.arange(40, 50), 10
    ranges = generator.uniform(2.0e7, 2.4e7, (2, count))
    noise = generator.normal(0.0, 0.9, (2, count))

    def combinations(receiver, clock):
        columns = {name: np.zeros(count) for name in Combinations.__dataclass_fields__}
        columns |= {"phase": np.full(count, np.nan), "is_lock_lost": np.zeros(count, dtype=bool)}
        columns[kind] = ranges[receiver] + clock + noise[receiver]
        columns |= {"code_sigma": np.full(count, 0.9), "phase_sigma": np.full(count, 0.9)}
        return Combinations(**columns | {"satellite": satellites, "second_band": np.full(count, 2)})

    seen = Sky(ranges, np.zeros((2, count)))
    chief, deputy = combinations(0, 100.0), combinations(1, -3e5)
    mean, shares = mean_of_receivers(chief, deputy, seen)
    np.testing.assert_allclose(getattr(mean, f"{kind}_sigma"), 0.9 / np.sqrt(2.0))
    np.testing.assert_array_equal(shares[("code", "phase").index(kind)], 0.5)
    error = getattr(mean, kind) - ranges[0]
    expected = noise.mean(axis=0)
    # But for a clock that all satellites share.
    np.testing.assert_allclose(error - error.mean(), expected - expected.mean(), atol=1e-6)


def test_phases_of_the_deputy_that_do_not_fit_are_not_used():
    """One of unknown ambiguity, one that has slipped, and one whose chief has lost lock."""
    count = 8
    columns = {name: np.zeros(count) for name in Combinations.__dataclass_fields__}
    columns |= {"satellite": np.arange(40, 48), "second_band": np.full(count, 2)}
    columns |= {"code_sigma": np.full(count, 0.9), "phase_sigma": np.full(count, 0.003)}
    columns["is_lock_lost"] = np.zeros(count, dtype=bool)
    chief = Combinations(**columns)
    deputy = Combinations(**columns | {"phase": np.array([np.nan, 0.2, *np.zeros(6)])})
    chief.is_lock_lost[2] = True
    mean, shares = mean_of_receivers(chief, deputy, Sky(np.zeros((2, 8)), np.zeros((2, 8))))
    np.testing.assert_array_equal(shares[1], [0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(mean.phase, 0.0)
    np.testing.assert_allclose(mean.phase_sigma[:4] / 0.003, [1.0, 1.0, 1.0, np.sqrt(0.5)])


class Sky:
    """Ranges and clocks of satellites in the order of the measurements."""

    def __init__(self, ranges, clocks):
        self.range, self.clock = ranges, clocks

    def columns(self, satellite):
        """Return the columns of satellites."""
        return satellite - 40

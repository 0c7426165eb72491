"""Emulated sensor of range and direction, and the own fix."""

import dataclasses

import numpy as np
import pytest

from vtff_dynamics.frames.earth import state_itrf_to_gcrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.on_board.own_fix import FixErrors, OwnFixEmulation
from vtff_sim_bridge.on_board.range_sensor import RangeSensor, RangeSensorEmulation

OWN = np.array([6678e3, 0.0, 0.0, 0.0, 4798.9, 6054.7])
PLACES = {"lead": [300.0, -800.0, 40.0], "other": [-2000.0, 1500.0, 0.0]}
OTHERS = {name: deputy_state_gcrf(OWN, [*place, 0.0, 0.0, 0.0]) for name, place in PLACES.items()}
SECOND = 10**9


def test_without_errors_the_nearest_neighbour_stands_first():
    eye = RangeSensorEmulation(RangeSensor(10e3, 0.0, 0.0, 0.0), "chaser", 1)
    np.testing.assert_allclose(eye.detect(0, OWN, OTHERS), list(PLACES.values()), atol=1e-6)
    turned = dict(reversed(OTHERS.items()))
    np.testing.assert_array_equal(eye.detect(0, OWN, turned), eye.detect(0, OWN, OTHERS))


def test_limit_failure_and_dropout():
    near = RangeSensorEmulation(RangeSensor(1e3, 0.0, 0.0, 0.0, outage=(20.0, 30.0)), "chaser", 1)
    assert [len(near.detect(t * SECOND, OWN, OTHERS)) for t in (10, 20, 29, 30)] == [1, 0, 0, 1]
    blinking = RangeSensorEmulation(RangeSensor(dropout=0.25), "chaser", 1)
    seen = sum(len(blinking.detect(t * SECOND, OWN, OTHERS)) for t in range(400))
    assert seen == pytest.approx(600, abs=5.0 * np.sqrt(800 * 0.25 * 0.75))


def test_noise_has_the_stated_sigmas_and_does_not_depend_on_the_order_of_calls():
    sensor = RangeSensor(10e3, 0.5, 1e-3, 0.0)
    eye, again = (RangeSensorEmulation(sensor, "chaser", 7) for _ in range(2))
    times = [t * SECOND for t in range(600)]
    seen = np.array([eye.detect(t, OWN, OTHERS) for t in times])
    backwards = [again.detect(t, OWN, OTHERS) for t in times[::-1]]
    np.testing.assert_array_equal(seen, backwards[::-1])
    for index, place in enumerate(PLACES.values()):
        distance = np.linalg.norm(place)
        ranges = np.linalg.norm(seen[:, index], axis=1)
        across = seen[:, index] / ranges[:, None] - place / distance
        assert ranges.std() == pytest.approx(0.5, rel=0.15)
        assert np.sqrt((across**2).sum(axis=1).mean() / 2.0) == pytest.approx(1e-3, rel=0.15)


def test_misalignment_turns_all_neighbours_alike_and_slowly():
    sensor = RangeSensor(10e3, 0.0, 0.0, 0.0, misalignment_sigma=1e-3, misalignment_time=600.0)
    eye = RangeSensorEmulation(sensor, "chaser", 3)
    seen = np.array([eye.detect(t * SECOND, OWN, OTHERS) for t in range(0, 60_000, 100)])
    first, second = (np.array(place) for place in PLACES.values())
    angle = np.arccos(first @ second / np.linalg.norm(first) / np.linalg.norm(second))
    units = seen / np.linalg.norm(seen, axis=2, keepdims=True)
    np.testing.assert_allclose(np.arccos((units[:, 0] * units[:, 1]).sum(axis=1)), angle, atol=1e-5)
    errors = units[:, 0] - first / np.linalg.norm(first)
    sigma = np.sqrt((errors**2).sum(axis=1).mean() / 2.0)
    assert sigma == pytest.approx(1e-3, rel=0.3)
    assert np.linalg.norm(np.diff(errors, axis=0), axis=1).mean() < 1.2 * sigma


def test_the_fix_has_the_stated_errors_and_is_earth_fixed():
    errors = FixErrors(2.0, 1800.0, 0.05)
    emulation = OwnFixEmulation(errors, "chaser", 5)
    states = np.array([emulation.measure(t * SECOND, OWN) for t in range(0, 600_000, 500)]) - OWN
    np.testing.assert_allclose(states[:, :3].std(axis=0), 2.0, rtol=0.25)
    np.testing.assert_allclose(states[:, 3:].std(axis=0), 0.05, rtol=0.1)
    epoch = GpsTime.from_week_tow(1889, 90_000.0)
    fix = emulation.fix(epoch, 10 * SECOND, OWN)
    np.testing.assert_allclose(
        state_itrf_to_gcrf(epoch, [*fix.position, *fix.velocity]),
        emulation.measure(10 * SECOND, OWN),
        rtol=1e-12,
        atol=1e-6,
    )


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (RangeSensor, "range_sigma", -1.0),
        (RangeSensor, "dropout", 1.5),
        (RangeSensor, "dropout", float("nan")),
        (RangeSensor, "misalignment_time", 0.0),
        (FixErrors, "velocity_sigma", float("nan")),
        (FixErrors, "correlation_time", 0.0),
    ],
)
def test_impossible_errors_are_named(kind, name, value):
    with pytest.raises(ValueError, match=name):
        dataclasses.replace(kind(), **{name: value})

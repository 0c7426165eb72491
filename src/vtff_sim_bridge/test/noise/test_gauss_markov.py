"""Gauss-Markov processes: variance, correlation time and independence of their streams."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from vtff_sim_bridge.noise.gauss_markov import GaussMarkovField, SlowGaussMarkov
from vtff_sim_bridge.noise.random_streams import Effect, generator

COUNT = 400
"""Processes of a field; each is an independent sample."""


def field(correlation_time: float, seed: int = 1, receiver: int = 7) -> GaussMarkovField:
    """Return a field of many processes."""
    addresses = [(receiver, 0, number, 1, 67) for number in range(COUNT)]
    return GaussMarkovField(seed, Effect.CODE_MULTIPATH, addresses, correlation_time)


def samples(source: GaussMarkovField, seconds: int) -> np.ndarray:
    """Return all epochs of the first seconds, shape (20 * seconds, processes)."""
    rows = np.arange(COUNT)
    return np.concatenate([source.second(second, rows) for second in range(seconds)])


@pytest.mark.parametrize("correlation_time", [0.05, 1.0, 10.0])
def test_variance_and_autocorrelation_from_the_first_epoch_on(correlation_time: float) -> None:
    drawn = samples(field(correlation_time), 130)
    # Also at the start, and across the ends of blocks at 64 and 128 s.
    for epoch in (0, 20 * 64 - 1, 20 * 64, 20 * 129):
        assert drawn[epoch].std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * COUNT))
    for lag in (1, round(20.0 * correlation_time), round(40.0 * correlation_time)):
        product = np.mean(drawn[:-lag] * drawn[lag:])
        assert product == pytest.approx(np.exp(-lag / (20.0 * correlation_time)), abs=0.02)
    border = np.mean(drawn[20 * 64 - 1] * drawn[20 * 64])
    assert border == pytest.approx(np.exp(-0.05 / correlation_time), abs=4.0 / np.sqrt(COUNT))


def test_the_order_of_calls_does_not_matter() -> None:
    rows = np.array([3, 8])
    late, early = field(10.0), field(10.0)
    last = late.second(200, rows)
    for second in (0, 70, 199):
        early.second(second, rows)
    np.testing.assert_array_equal(last, early.second(200, rows))
    np.testing.assert_array_equal(late.second(70, rows), early.second(70, rows))


def test_streams_of_addresses_receivers_and_seeds_are_independent() -> None:
    drawn = samples(field(0.05), 20)
    correlation = np.corrcoef(drawn[:, :40].T) - np.eye(40)
    assert np.abs(correlation).max() < 0.4
    for other in (field(0.05, seed=2), field(0.05, receiver=8)):
        assert abs(np.mean(drawn * samples(other, 20))) < 5.0 / np.sqrt(drawn.size / 2.0)


def test_slow_processes_have_their_variance_and_correlation_time_and_no_steps() -> None:
    period = 7200.0
    times = np.array([0.0, 12.5 * 60.0, period, 2.0 * period, 40000.0])
    sources = [SlowGaussMarkov(1, Effect.ORBIT_DRIFT, (0, n), 4, period) for n in range(COUNT)]
    values = np.array([source.at(times) for source in sources])
    for index in range(len(times)):
        assert values[:, index].std() == pytest.approx(1.0, abs=0.08)
    for first, second in ((0, 2), (2, 3), (0, 3)):
        product = np.mean(values[:, first] * values[:, second])
        lag = (times[second] - times[first]) / period
        assert product == pytest.approx(np.exp(-lag), abs=0.1)
    # Radial, along-track, normal and clock are four processes.
    assert abs(np.mean(values[:, 0, 0] * values[:, 0, 3])) < 4.0 / np.sqrt(COUNT)
    steps = np.diff(sources[0].at(np.arange(0.0, 20000.0, 1.0)), axis=0)
    # Between knots 300 s apart the change has a sigma of 0.28 / 300; a step would have some 0.1.
    assert np.abs(steps).max() < 0.01
    later = SlowGaussMarkov(1, Effect.ORBIT_DRIFT, (0, 0), 4, period)
    np.testing.assert_array_equal(later.at([40000.0]), sources[0].at([40000.0]))


def test_processes_are_those_of_a_recursive_filter() -> None:
    address, decay = (3,), math.exp(-1.0 / 24.0)
    expected = [generator(5, Effect.ORBIT_DRIFT, *address, 0).standard_normal((1, 4))]
    for block in (1, 2):
        draws = generator(5, Effect.ORBIT_DRIFT, *address, block).standard_normal((64, 4))
        gain = math.sqrt(1.0 - decay**2)
        knots, _ = lfilter([gain], [1.0, -decay], draws, axis=0, zi=decay * expected[-1][-1:])
        expected.append(knots)
    process = SlowGaussMarkov(5, Effect.ORBIT_DRIFT, address, 4, 24.0)
    np.testing.assert_allclose(
        process.at(np.arange(128.0)), np.concatenate(expected)[:128], rtol=1e-12, atol=1e-15
    )

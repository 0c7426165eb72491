"""ROTI: what counts as a rate where an arc may be broken."""

import numpy as np
import pytest
from link_simulation import START, observations, pieces
from scipy import stats

from vtff_iono.content.rate_of_tec import RateOfTecMonitor
from vtff_iono.content.slant_tec import SlantTecProcessor
from vtff_iono.links.arcs import ArcBreak

# Rates are formed between multiples of 30 s of GPS time.
FIRST = -(START // 10**9) % 30


def processed(seconds, content, **changes):
    time, columns = observations(seconds, content, **changes)
    return SlantTecProcessor().update(time, columns, np.full(len(time), 1.0))


def windows(rows, interval, length):
    monitor = RateOfTecMonitor(interval, length)
    return [*monitor.update(rows), *monitor.flush()]


def test_a_slip_in_quiet_air_is_no_rate():
    """Four cycles on both signals: the wide lane does not tell, the content jumps by 2 TECU."""
    seconds = FIRST + np.arange(40) * 30.0
    content = 20.0 + np.random.default_rng(1).normal(0.0, 0.01, (40, 1))
    slips = {(0, 0): (24, 4.0), (0, 1): (24, 4.0)}
    rows = processed(seconds, content, slips=slips)
    assert rows.break_reason[24] == ArcBreak.GEOMETRY_FREE
    found = windows(rows, 30.0, 300.0)
    assert np.nanmax(np.concatenate([one.roti_tecu_per_minute for one in found])) < 0.1
    assert sum(int(one.rates.sum()) for one in found) == 38


def test_the_wall_of_a_bubble_is_one():
    """The first large steps break the arc, as they may be slips; yet they are the disturbance."""
    seconds = FIRST + np.arange(60) * 30.0
    generator = np.random.default_rng(3)
    steps = np.concatenate([generator.normal(0.0, 0.02, 33), generator.normal(0.0, 0.9, 27)])
    content = 20.0 + np.cumsum(steps)[:, np.newaxis]
    rows = processed(seconds, content)
    broken = np.flatnonzero(rows.break_reason == ArcBreak.GEOMETRY_FREE)
    assert len(broken)
    disturbed = int(rows.pairs.time[33])
    compared = 0
    for one in windows(rows, 30.0, 300.0):
        begin = one.time - 300 * 10**9
        inside = np.flatnonzero((rows.pairs.time >= begin) & (rows.pairs.time < one.time))
        # Most rates in the window of the first steps are quiet, and tell nothing of the others.
        if begin > disturbed and len(inside) == 10:
            expected = np.std(np.diff(content[inside[0] - 1 : inside[-1] + 1, 0]) / 0.5, ddof=1)
            assert one.rates[0] == 10
            assert one.roti_tecu_per_minute[0] == pytest.approx(expected, rel=0.05)
            compared += 1
    assert compared >= 1


@pytest.mark.parametrize("epochs", [1, 7, 10_000])
def test_a_slip_between_samples_of_a_high_rate_is_never_bridged(epochs):
    """At 20 Hz a jump of the content is a slip, also at the instant of a rate in a bubble."""
    seconds = np.arange(2400) * 0.05
    content = 20.0 + np.cumsum(np.random.default_rng(5).normal(0.0, 0.03, (2400, 1)), axis=0)
    time, columns = observations(seconds, content, slips={(0, 0): (1800, 1.0)})
    processor, monitor, found = SlantTecProcessor(), RateOfTecMonitor(1.0, 60.0), []
    for part in pieces(time, columns, np.full(len(time), 1.0), epochs):
        found += monitor.update(processor.update(*part))
    found += monitor.flush()
    assert sum(int(one.rates.sum()) for one in found) == 119 - 1


def test_roti_and_mean_rate_of_known_contents():
    """Rates in TECU/min over seconds, from the last sample of the window before on."""
    seconds = -(START // 10**9) % 60 + np.arange(120.0)
    content = 20.0 + np.cumsum(np.random.default_rng(2).normal(0.01, 0.02, (120, 2)), axis=0)
    rows = processed(seconds, content, phase_sigma=0.0)
    first, second = windows(rows, 1.0, 60.0)
    for window, rates in (
        (first, 60.0 * np.diff(content[:60], axis=0)),
        (second, 60.0 * np.diff(content[59:], axis=0)),
    ):
        assert window.interval == 1.0
        assert window.link.tolist() == [0, 1]
        assert window.rates.tolist() == [len(rates)] * 2
        assert window.roti_tecu_per_minute == pytest.approx(np.std(rates, axis=0, ddof=1), rel=1e-3)
        assert window.mean_rate_tecu_per_minute == pytest.approx(rates.mean(axis=0), rel=1e-3)
    assert second.time - first.time == 60 * 10**9
    assert first.time % (60 * 10**9) == 0


@pytest.mark.parametrize(("rates", "is_enough"), [(4, False), (5, True)])
def test_five_rates_are_enough(rates, is_enough):
    seconds = -(START // 10**9) % 60 + np.arange(rates + 1.0)
    content = 20.0 + np.random.default_rng(3).normal(0.0, 0.01, (rates + 1, 1))
    (window,) = windows(processed(seconds, content), 1.0, 60.0)
    assert window.rates.tolist() == [rates]
    assert np.isfinite(window.roti_tecu_per_minute[0]) == is_enough
    assert np.isfinite(window.mean_rate_tecu_per_minute[0])


@pytest.mark.parametrize(("offset", "is_used"), [(0.019, True), (-0.019, True), (0.021, False)])
def test_a_sample_belongs_to_an_instant_that_is_near(offset, is_used):
    """Within a fiftieth of the interval, on either side."""
    seconds = -(START // 10**9) % 60 + 1.0 + np.arange(30.0) + offset
    rows = processed(seconds, np.full((30, 1), 20.0))
    found = windows(rows, 1.0, 60.0)
    assert sum(int(window.rates.sum()) for window in found) == (29 if is_used else 0)


def test_a_rate_over_a_gap_does_not_count():
    """Two seconds at 1 Hz break no arc; the next rate is that of the next second."""
    seconds = -(START // 10**9) % 60 + np.delete(np.arange(30.0), 10)
    rows = processed(seconds, np.full((29, 1), 20.0))
    assert (rows.arc == 1).all()
    (window,) = windows(rows, 1.0, 60.0)
    assert window.rates.tolist() == [27]


def test_a_doubtful_rate_counts_within_the_scatter_of_the_others():
    """The bound is 99.9 % of Student's distribution about the mean of the certain rates."""
    generator = np.random.default_rng(4)
    steps = np.concatenate((np.zeros(9), generator.normal(0.5, 0.3, 20)))
    for jump in (1.2, 1.4, 1.6, 1.8, 2.0, 2.4):
        changed = steps.copy()
        changed[19] = jump
        content = 20.0 + np.cumsum(changed)[:, None]
        rows = processed(FIRST + np.arange(29) * 30.0, content, phase_sigma=0.0)
        window = windows(rows, 30.0, 600.0)
        is_doubtful = rows.break_reason == ArcBreak.GEOMETRY_FREE
        for one in window:
            inside = (rows.pairs.time >= one.time - 600 * 10**9) & (rows.pairs.time < one.time)
            index = np.flatnonzero(inside)
            index = index[index > 0]
            rates = 2.0 * np.diff(content[:, 0])[index - 1]
            certain = rates[~is_doubtful[index]]
            count = len(certain)
            if count < 5:
                continue
            limit = stats.t.ppf(0.9995, count - 1) * certain.std(ddof=1) * np.sqrt(1 + 1 / count)
            is_like = np.abs(rates - certain.mean()) <= limit
            assert one.rates[0] == np.count_nonzero(is_like | ~is_doubtful[index])


def test_certain_rates_are_too_few_to_judge_by():
    """No doubtful rate counts in a window with four certain rates."""
    content = 20.0 + np.concatenate((np.zeros(5), np.full(4, 2.0)))[:, None]
    rows = processed(FIRST + np.arange(9) * 30.0, content, phase_sigma=0.0)
    assert rows.break_reason[5] == ArcBreak.GEOMETRY_FREE
    found = windows(rows, 30.0, 300.0)
    assert sum(int(window.rates.sum()) for window in found) == 7


def test_a_block_without_rows_changes_nothing():
    """Also the shortest interval of epochs, which is found between blocks of one row."""
    seconds = -(START // 10**9) % 60 + np.arange(30.0)
    time, columns = observations(seconds, np.full((30, 1), 20.0))
    processor, monitor, found = SlantTecProcessor(), RateOfTecMonitor(1.0, 60.0), []
    for number, part in enumerate(pieces(time, columns, np.full(len(time), 1.0), 1)):
        if number % 5 == 0:
            nothing = {name: column[:0] for name, column in columns.items()}
            found += monitor.update(processor.update(time[:0], nothing, np.zeros(0)))
        found += monitor.update(processor.update(*part))
    (window,) = [*found, *monitor.flush()]
    assert window.rates.tolist() == [29]

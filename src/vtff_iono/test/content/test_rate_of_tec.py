"""ROTI: what counts as a rate where an arc may be broken."""

import numpy as np
import pytest
from link_simulation import START, observations, pieces

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
        # Of the window of the first steps most rates are quiet, and tell nothing of the others.
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

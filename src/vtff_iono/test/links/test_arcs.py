"""Arcs: every slip that matters is found at 20 Hz, quiet data are left whole."""

import numpy as np
import pytest
from link_simulation import LIGHT, START, observations

from vtff_gnss import constants as c
from vtff_iono.links.arcs import ArcBreak, ArcDetector
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.links.signal_pairs import PairRows, PairSelector

L1, L2 = 1575.42e6, 1227.60e6
FACTOR = tecu_per_metre(L1, L2)
SLIP_PAIRS = [
    (first, second)
    for first in range(-10, 11)
    for second in range(-10, 11)
    if abs(FACTOR * LIGHT * (first / L1 - second / L2)) >= 0.24
]


def reasons(time, columns):
    selector = PairSelector()
    rows = selector.rows(time, columns)
    return rows, ArcDetector().update(rows)


def many_links(content, interval, phase_sigma=1e-3, code_sigma=0.3, seed=0, slips=None):
    """Rows of m L1/L2 links, made directly because there are more of them than satellites."""
    generator = np.random.default_rng(seed)
    epochs, links = content.shape
    phase = phase_sigma * generator.standard_normal((2, epochs, links))
    code = code_sigma * generator.standard_normal((2, epochs, links))
    cycles = np.zeros((2, epochs, links))
    for link, (epoch, first, second) in enumerate(slips or ()):
        cycles[:, epoch:, link] += np.array([first, second])[:, None]
    first, second = (phase[i] * f / LIGHT + cycles[i] for i, f in enumerate((L1, L2)))
    narrow = (L1 * code[0] + L2 * code[1]) / (L1 + L2)
    time = START + np.round(np.arange(epochs) * interval * 1e9).astype(np.int64)
    size = epochs * links
    number = np.tile(np.arange(links), epochs)
    yes, no = np.ones(size, dtype=bool), np.zeros(size, dtype=bool)
    return PairRows(
        time=np.repeat(time, links),
        link=number,
        satellite=number,
        row_first=np.arange(size),
        row_second=np.arange(size),
        stec_code_tecu=content.ravel(),
        stec_phase_tecu=(content + FACTOR * LIGHT * (first / L1 - second / L2)).ravel(),
        wide_lane_cycles=(first - second - narrow * (L1 - L2) / LIGHT).ravel(),
        lock_time=np.full(size, 1e5),
        cn0_dbhz=np.full(size, 45.0),
        code_valid=yes,
        phase_valid=yes,
        parity_known=yes,
        lock_lost=no,
        half_cycle=np.zeros(size, dtype=np.int64),
    )


def test_there_are_slips_to_find():
    assert len(SLIP_PAIRS) == 438
    assert (5, 4) in SLIP_PAIRS and (9, 7) not in SLIP_PAIRS


@pytest.mark.parametrize("wall_rate", [0.0, 1.5])
def test_every_slip_of_a_quarter_tecu_is_found_at_20_hz(wall_rate):
    """Also while the content changes by 1.5 TECU/s, as at the wall of a bubble."""
    epochs = 600
    generator = np.random.default_rng(11)
    seconds = np.arange(epochs) * 0.05
    content = 20.0 + 0.02 * seconds + wall_rate * np.clip(seconds - 5.0, 0.0, 20.0)
    content = np.tile(content[:, None], (1, len(SLIP_PAIRS)))
    at = generator.integers(50, 550, len(SLIP_PAIRS))
    slips = [(int(e), *pair) for e, pair in zip(at, SLIP_PAIRS, strict=True)]
    arcs = ArcDetector().update(many_links(content, 0.05, seed=3, slips=slips))
    reason = arcs.break_reason.reshape(epochs, -1)
    found = reason[at, np.arange(len(at))] != ArcBreak.NONE
    assert found.all(), [slips[i] for i in np.flatnonzero(~found)]


def test_no_arc_of_a_quiet_day_is_broken():
    epochs = 86400 * 20 // 8
    seconds = np.arange(epochs) * 0.05
    # Eight satellites for three hours make one day of arcs.
    phase = np.arange(8)
    content = 30.0 + 20.0 * np.sin(seconds[:, None] / 300.0 + phase)
    arcs = ArcDetector().update(many_links(content, 0.05, seed=5))
    assert (arcs.number == 1).all()


def test_no_arc_of_a_quiet_day_on_the_ground_is_broken():
    seconds = np.arange(2880) * 30.0
    content = 40.0 + 30.0 * np.sin(2e-4 * seconds[:, None] + np.arange(10))
    arcs = ArcDetector().update(many_links(content, 30.0, seed=6))
    assert (arcs.number == 1).all()


@pytest.mark.parametrize("pair", [(1, 0), (0, 1), (2, 1), (3, 1)])
def test_slips_of_the_wide_lane_are_found_at_30_s_in_a_bubble(pair):
    """The content moves too much for the geometry-free test; the wide lane does not."""
    generator = np.random.default_rng(2)
    content = np.cumsum(generator.normal(0.0, 1.0, (400, 20)), axis=0)
    slips = [(200, *pair)] * 20
    arcs = ArcDetector().update(many_links(content, 30.0, code_sigma=0.1, seed=8, slips=slips))
    assert (arcs.break_reason.reshape(400, 20)[200] != ArcBreak.NONE).all()


def test_what_the_receiver_tells():
    time, columns = observations(np.arange(200) * 0.05, np.full((200, 1), 20.0))
    last = np.flatnonzero(time == time[300])
    columns["flags"][last[0]] |= c.FLAG_LOCK_LOST
    rows, arcs = reasons(time, columns)
    assert np.flatnonzero(arcs.break_reason).tolist() == [0, 150]
    assert arcs.break_reason[150] == ArcBreak.LOCK
    columns["flags"][last[0]] &= ~np.uint16(c.FLAG_LOCK_LOST)
    columns["flags"][last[0] :] |= c.FLAG_HALF_CYCLE_ADDED
    rows, arcs = reasons(time, columns)
    assert arcs.break_reason[150] == ArcBreak.HALF_CYCLE
    columns["flags"][:] &= ~np.uint16(c.FLAG_HALF_CYCLE_ADDED)
    columns["lock_time"][300:] -= 1005.0
    rows, arcs = reasons(time, columns)
    assert arcs.break_reason[150] == ArcBreak.LOCK
    assert arcs.number[[149, 150]].tolist() == [1, 2]


def test_gaps_and_missing_phases():
    seconds = np.arange(400) * 0.05
    time, columns = observations(seconds, np.full((400, 1), 20.0))
    kept = (time < START + 5_000_000_000) | (time > START + 7_000_000_000)
    columns = {name: column[kept] for name, column in columns.items()}
    rows, arcs = reasons(time[kept], columns)
    assert np.count_nonzero(arcs.break_reason == ArcBreak.GAP) == 1
    # A phase that is not valid belongs to no arc, and the next one begins a new one.
    columns["flags"][20] &= ~np.uint16(c.FLAG_PHASE_VALID)
    rows, arcs = reasons(time[kept], columns)
    assert arcs.number[[9, 10, 11]].tolist() == [1, 0, 2]
    assert arcs.break_reason[11] == ArcBreak.START


def test_a_slip_breaks_all_links_of_the_satellite_and_no_other():
    content = np.full((300, 3), 20.0)
    signals = ((1, "C"), (2, "W"), (5, "Q"))
    # (5, 4) on L1 and L2 is hardly seen by L1/L2; L5 did not slip, but L1 did.
    time, columns = observations(
        np.arange(300) * 0.05, content, signals, slips={(1, 0): (150, 9), (1, 1): (150, 7)}
    )
    rows, arcs = reasons(time, columns)
    broken = arcs.break_reason.reshape(300, 3, 2)
    assert (broken[150, 1] != ArcBreak.NONE).all()
    broken[150, 1] = 0
    assert not broken[1:].any()


def test_the_closure_of_three_frequencies():
    """A jump of the content that is none of the ionosphere, and that no other test can see."""
    content = np.full((300, 1), 20.0)
    time, columns = observations(np.arange(300) * 30.0, content, ((1, "C"), (2, "W"), (5, "Q")))
    first_l5 = columns["band"] == 5
    columns["carrier_phase_cycles"][first_l5 & (time >= time[450])] += 0.1
    rows, arcs = reasons(time, columns)
    broken = arcs.break_reason.reshape(300, 2)
    assert ArcBreak.CLOSURE in broken[150]
    assert not broken[1:150].any() and not broken[151:].any()


def test_arcs_do_not_depend_on_how_the_data_are_cut():
    generator = np.random.default_rng(4)
    content = np.cumsum(generator.normal(0.0, 0.05, (600, 4)), axis=0)
    time, columns = observations(
        np.arange(600) * 0.05, content, slips={(0, 0): (100, 3), (2, 1): (433, 1)}
    )
    whole, arcs = reasons(time, columns)
    selector, detector = PairSelector(), ArcDetector()
    parts = []
    for start in range(0, len(time), 8):
        one = {name: column[start : start + 8] for name, column in columns.items()}
        parts.append(detector.update(selector.rows(time[start : start + 8], one)))
    assert np.array_equal(arcs.number, np.concatenate([part.number for part in parts]))
    assert np.array_equal(arcs.break_reason, np.concatenate([p.break_reason for p in parts]))

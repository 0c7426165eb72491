"""Arcs: every slip that matters is found at 20 Hz, quiet data are left whole."""

import numpy as np
import pytest
from link_simulation import LIGHT, START, observations

from vtff_gnss import constants as c
from vtff_iono.links.arcs import ArcBreak, ArcDetector, arc_keys
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


def test_epochs_without_links_have_no_arcs_and_change_none():
    rows, nothing = many_links(np.zeros((20, 3)), 1.0), many_links(np.zeros((1, 0)), 1.0)
    detector = ArcDetector()
    assert len(detector.update(nothing).number) == 0
    first = detector.update(rows)
    assert len(detector.update(nothing).number) == 0
    np.testing.assert_array_equal(first.number, ArcDetector().update(rows).number)


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


# Rows that are set value by value: every limit is tested from both sides.


def rows_of(interval, content, wide_lane=None, **columns):
    """Return rows of a link at a constant interval; the other columns are quiet unless given."""
    count = len(content)
    quiet = {
        "wide_lane_cycles": np.zeros(count) if wide_lane is None else np.asarray(wide_lane),
        "lock_time": np.full(count, 1e5),
        "code_valid": np.full(count, wide_lane is not None),
        "phase_valid": np.ones(count, dtype=bool),
        "lock_lost": np.zeros(count, dtype=bool),
        "half_cycle": np.zeros(count, dtype=np.int64),
        "satellite": np.zeros(count, dtype=np.int64),
        "link": np.zeros(count, dtype=np.int64),
        "row_first": np.arange(count),
        "time": START + np.round(np.arange(count) * interval * 1e9).astype(np.int64),
    }
    return PairRows(
        **{**quiet, **columns},
        row_second=np.arange(count),
        stec_code_tecu=np.asarray(content, dtype=float),
        stec_phase_tecu=np.asarray(content, dtype=float),
        cn0_dbhz=np.full(count, 45.0),
        parity_known=np.ones(count, dtype=bool),
    )


def reasons_of(*arguments, **columns):
    return ArcDetector().update(rows_of(*arguments, **columns)).break_reason


@pytest.mark.parametrize(
    ("interval", "settled", "unsettled"), [(0.05, 0.1515, 0.1925), (30.0, 1.05, 7.68)]
)
def test_the_limits_of_a_jump_of_the_content(interval, settled, unsettled):
    """0.15 TECU + 0.03 TECU/s; until the fifth sample 0.18 TECU + 0.25 TECU/s."""
    for epoch, limit in ((4, unsettled), (5, settled), (60, settled)):
        for factor, reason in ((0.999, ArcBreak.NONE), (1.001, ArcBreak.GEOMETRY_FREE)):
            for sign in (1.0, -1.0):
                content = np.zeros(100)
                content[epoch] = sign * factor * limit
                assert reasons_of(interval, content)[epoch] == reason, (epoch, factor)


def test_the_limit_follows_the_scatter_up_to_the_cap():
    """White noise of 0.5 TECU at 30 s: the limit is 5.5 times the scatter of the innovations."""
    generator = np.random.default_rng(9)
    content = generator.normal(0.0, 0.5, 400)
    assert not reasons_of(30.0, content)[1:].any()
    # The filter amplifies the noise; its innovations have 0.65 TECU, the limit is 3.6 TECU.
    for jump, breaks in ((2.0, False), (6.0, True)):
        content[300] = np.mean(content[290:300]) + jump
        assert (reasons_of(30.0, content)[300] == ArcBreak.GEOMETRY_FREE) == breaks
    rough = generator.normal(0.0, 3.0, 400)
    rough[300:] += 60.0
    assert reasons_of(30.0, rough)[300] == ArcBreak.GEOMETRY_FREE


def test_the_prediction_follows_value_and_rate():
    """After a step of d in a quiet series the next value is predicted at 0.7 d: gains 0.5, 0.2."""
    step = 0.12
    for offset, reason in (
        (0.1510, ArcBreak.NONE),
        (0.1520, ArcBreak.GEOMETRY_FREE),
        (-0.1510, ArcBreak.NONE),
        (-0.1520, ArcBreak.GEOMETRY_FREE),
    ):
        content = np.zeros(80)
        content[60], content[61] = step, 0.7 * step + offset
        assert reasons_of(0.05, content)[61] == reason, offset


def test_a_steady_rate_is_predicted():
    """0.2 TECU/s at 30 s are 6 TECU from sample to sample; the limit is 1 TECU."""
    content = 0.2 * 30.0 * np.arange(50)
    assert reasons_of(30.0, content).tolist() == [ArcBreak.START] + [ArcBreak.NONE] * 49
    content[30:] += 1.1
    assert reasons_of(30.0, content)[30] == ArcBreak.GEOMETRY_FREE


@pytest.mark.parametrize(("epoch", "limit"), [(10, 3.0), (19, 3.0), (20, 0.6), (50, 0.6)])
def test_the_limits_of_the_wide_lane(epoch, limit):
    """Five times 0.6 cycles until 20 samples have shown the spread, then 0.6 cycles."""
    for factor, reason in ((0.999, ArcBreak.NONE), (1.001, ArcBreak.WIDE_LANE)):
        wide_lane = np.zeros(60)
        wide_lane[epoch] = factor * limit
        assert reasons_of(30.0, np.zeros(60), wide_lane)[epoch] == reason


def test_the_wide_lane_is_averaged_over_three_seconds():
    """A single sample at 1 Hz counts a third: 1.8 cycles."""
    for jump, reason in ((1.79, ArcBreak.NONE), (1.81, ArcBreak.WIDE_LANE)):
        wide_lane = np.zeros(60)
        wide_lane[40] = jump
        assert reasons_of(1.0, np.zeros(60), wide_lane)[40] == reason
    # A jump that stays is found when the average has followed: 1 - (2/3)^n of 1 cycle.
    wide_lane = np.zeros(60)
    wide_lane[40:] = 1.0
    reason = reasons_of(1.0, np.zeros(60), wide_lane)
    assert reason[40:43].tolist() == [ArcBreak.NONE, ArcBreak.NONE, ArcBreak.WIDE_LANE]


def test_the_spread_of_the_wide_lane_widens_its_limit():
    """At 30 s the average is the sample: 5 standard deviations of 1 cycle."""
    wide_lane = np.where(np.arange(200) % 2 == 0, 1.0, -1.0)
    for jump, reason in ((4.6, ArcBreak.NONE), (5.4, ArcBreak.WIDE_LANE)):
        changed = wide_lane.copy()
        changed[150] = jump
        reasons_found = reasons_of(30.0, np.zeros(200), changed)
        assert not reasons_found[1:150].any()
        assert reasons_found[150] == reason


def test_the_wide_lane_needs_code():
    wide_lane = np.zeros(60)
    wide_lane[40] = 10.0
    has_code = np.ones(60, dtype=bool)
    has_code[40] = False
    reason = reasons_of(30.0, np.zeros(60), wide_lane, code_valid=has_code)
    assert not reason[1:].any()


@pytest.mark.parametrize(
    ("interval", "gap", "reason"),
    [
        (0.05, 1.45, ArcBreak.NONE),
        (0.05, 1.55, ArcBreak.GAP),
        (1.0, 2.0, ArcBreak.NONE),
        (1.0, 3.0, ArcBreak.GAP),
        (30.0, 60.0, ArcBreak.NONE),
        (30.0, 90.0, ArcBreak.GAP),
    ],
)
def test_the_limits_of_a_gap(interval, gap, reason):
    """Longer than 1.5 s and than 2.5 intervals; the other link of the satellite is not broken."""
    time = np.arange(40) * interval
    time[20:] += gap - interval
    nanoseconds = START + np.round(time * 1e9).astype(np.int64)
    assert reasons_of(interval, np.zeros(40), time=nanoseconds)[20] == reason
    both = np.repeat(nanoseconds, 2)
    link = np.tile([0, 1], 40)
    kept = (link == 0) | (np.arange(80) < 40) | (both >= nanoseconds[21])
    found = reasons_of(
        interval, np.zeros(kept.sum()), time=both[kept], link=link[kept], row_first=link[kept]
    )
    assert np.count_nonzero(found) >= 2 and not np.any(found == ArcBreak.OTHER_LINK)


@pytest.mark.parametrize(("lock_time", "reason"), [(99.96, ArcBreak.NONE), (99.94, ArcBreak.LOCK)])
def test_a_lock_time_that_goes_back(lock_time, reason):
    """By more than the rounding of compressed logs, 1/32 s."""
    lock_times = np.full(40, 100.0)
    lock_times[20:] = lock_time
    assert reasons_of(1.0, np.zeros(40), lock_time=lock_times)[20] == reason


@pytest.mark.parametrize(("lock_time", "reason"), [(0.91, ArcBreak.NONE), (0.89, ArcBreak.LOCK)])
def test_a_lock_time_shorter_than_the_interval(lock_time, reason):
    assert reasons_of(1.0, np.zeros(40), lock_time=np.full(40, lock_time))[20] == reason


def closure_rows(closure, interval=30.0):
    """Return rows of two links that share the first signal; the second sees `closure` more."""
    count = len(closure)
    content = np.stack((np.zeros(count), closure), axis=1).ravel()
    time = START + np.repeat(np.round(np.arange(count) * interval * 1e9).astype(np.int64), 2)
    link = np.tile([0, 1], count)
    row_first = np.repeat(np.arange(count), 2)
    return rows_of(interval, content, time=time, link=link, row_first=row_first)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limits_of_the_closure(sign):
    for jump, reason in ((0.149, ArcBreak.NONE), (0.151, ArcBreak.CLOSURE)):
        closure = np.full(50, 3.0)
        closure[40] += sign * jump
        arcs = ArcDetector().update(closure_rows(closure))
        found = arcs.break_reason.reshape(-1, 2)
        assert found[40, 1] == reason
        # The other link of the satellite may have slipped instead.
        assert found[40, 0] == (ArcBreak.OTHER_LINK if reason else ArcBreak.NONE)
        assert arcs.number[-2:].tolist() == ([2, 2] if reason else [1, 1])


def test_mean_and_spread_of_the_closure_follow_within_a_minute():
    """At 30 s by half: after a deviation d the mean is at d / 2, its spread d / sqrt(2)."""
    step = 0.14
    limit = 0.5 * step + 5.5 * step / np.sqrt(2.0)
    for factor, reason in ((0.999, ArcBreak.NONE), (1.001, ArcBreak.CLOSURE)):
        closure = np.full(50, 3.0)
        closure[40] += step
        closure[41] += factor * limit
        found = ArcDetector().update(closure_rows(closure)).break_reason.reshape(-1, 2)
        assert not found[1:41].any()
        assert found[41, 1] == reason


def test_the_spread_of_the_closure_widens_its_limit():
    """A closure that changes by 0.14 all the time: 5.5 standard deviations."""
    closure = 3.0 + 0.07 * np.where(np.arange(100) % 2 == 0, 1.0, -1.0)
    # The mean follows by half: deviations of 0.093 about it, and a limit of 0.51 + 0.05.
    for jump, breaks in ((0.40, False), (0.75, True)):
        changed = closure.copy()
        changed[80] = 3.0 + jump
        found = ArcDetector().update(closure_rows(changed)).break_reason.reshape(-1, 2)
        assert not found[1:80].any()
        assert (found[80, 1] == ArcBreak.CLOSURE) == breaks


def test_numbers_of_arcs_and_links_make_one_key():
    link, arc = np.array([0, 0, 1, 1, 2]), np.array([1, 2, 1, 2, 1])
    keys = arc_keys(link, arc)
    assert len(set(keys.tolist())) == 5
    assert keys.tolist() == sorted(keys.tolist())
    assert arc_keys(np.array([-1]), np.array([0]))[0] < 0


def geometry_free_limits(content, interval):
    """Return prediction and limit of a sample after a series, by the formulas of the module."""
    value = rate = scatter = 0.0
    for count, sample in enumerate(content):
        if count == 0:
            value = sample
            continue
        innovation = sample - value - rate * interval
        if count == 1:
            value, rate = sample, innovation / interval
            continue
        gain_value = max(0.5, (4 * count + 2) / ((count + 1) * (count + 2)))
        gain_rate = max(0.2, 6 / ((count + 1) * (count + 2)))
        value += rate * interval + gain_value * innovation
        rate += gain_rate * innovation / interval
        if count >= 4:
            scatter += max(1 / 30, 1 / (count - 3)) * (innovation**2 - scatter)
    limit = max(0.15 + 0.03 * interval, 5.5 * np.sqrt(scatter))
    return value + rate * interval, min(limit, 0.18 + 0.25 * interval)


@pytest.mark.parametrize("count", [5, 6, 9, 14, 25, 33, 34, 50, 120])
def test_the_limit_of_noisy_contents(count):
    """Scatter of all innovations at first, then of about thirty."""
    noise = np.random.default_rng(count).normal(0.0, 0.35, count)
    prediction, limit = geometry_free_limits(noise, 30.0)
    for factor, reason in ((0.999, ArcBreak.NONE), (1.001, ArcBreak.GEOMETRY_FREE)):
        for sign in (1.0, -1.0):
            content = np.append(noise, prediction + sign * factor * limit)
            found = reasons_of(30.0, content)
            assert not found[1:-1].any()
            assert found[-1] == reason


def wide_lane_limits(wide_lane, interval):
    """Return mean and limit of a sample after a series whose interval exceeds the average."""
    mean = spread = 0.0
    for count, sample in enumerate(wide_lane):
        if count == 0:
            mean = sample
            continue
        deviation = sample - mean
        gain = max(1 / (count + 1), min(1.0, interval / 1800.0))
        mean += gain * deviation
        spread += gain * (deviation**2 - spread)
    return mean, max(0.6, 5.0 * np.sqrt(spread))


@pytest.mark.parametrize("count", [20, 40, 59, 60, 100, 300])
def test_the_limit_of_a_noisy_wide_lane(count):
    """Mean and spread of all samples at first, then of half an hour."""
    wide_lane = 7.0 + np.random.default_rng(count).normal(0.0, 0.3, count)
    wide_lane[count // 2 :] += 0.5
    mean, limit = wide_lane_limits(wide_lane, 30.0)
    assert limit > 0.6
    for factor, reason in ((0.999, ArcBreak.NONE), (1.001, ArcBreak.WIDE_LANE)):
        changed = np.append(wide_lane, mean + factor * limit)
        found = reasons_of(30.0, np.zeros(count + 1), changed)
        assert not found[1:-1].any()
        assert found[-1] == reason

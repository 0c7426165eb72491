"""Combinations of two signals: contents, wide lane, flags, numbers of links and satellites."""

import numpy as np
import pytest
from link_simulation import LIGHT, START, observations

from vtff_gnss import constants as c
from vtff_iono.links.signal_pairs import PairSelector, SignalPair, link_keys

TWO = ((1, "C"), (2, "W"))
L1, L2 = 1575.42e6, 1227.60e6


def exact(content, signals=TWO):
    """Return times and columns of observations without noise, one epoch a second."""
    return observations(
        np.arange(float(len(content))), content, signals, code_sigma=0.0, phase_sigma=0.0
    )


def changed(columns, band, **values):
    """Return columns in which a band has other values."""
    result = {name: column.copy() for name, column in columns.items()}
    for name, value in values.items():
        result[name][columns["band"] == band] = value
    return result


def test_code_and_phase_give_the_same_content():
    """The plasma delays the code and advances the phase: the signs are opposite."""
    content = 20.0 + np.array([[0.0, 1.0], [3.0, -2.0], [7.5, 30.0]])
    time, columns = exact(content)
    rows = PairSelector().rows(time, columns)
    assert rows.stec_code_tecu == pytest.approx(content.ravel(), abs=1e-6)
    # Cycles begin at -1000 and -2000.
    constant = 9.51775 * (-1000.0 * LIGHT / L1 + 2000.0 * LIGHT / L2)
    assert rows.stec_phase_tecu - constant == pytest.approx(content.ravel(), abs=0.02)
    assert np.ptp(rows.stec_phase_tecu - content.ravel()) < 1e-5


def test_wide_lane_has_neither_geometry_nor_ionosphere():
    """The wide lane is the difference of the ambiguities, -1000 and -2000 cycles."""
    time, columns = exact(np.array([[10.0, 200.0], [90.0, 0.0]]))
    rows = PairSelector().rows(time, columns)
    assert rows.wide_lane_cycles == pytest.approx(1000.0, abs=1e-5)


def test_the_weaker_signal_counts():
    time, columns = exact(np.full((1, 1), 20.0))
    for weak, strong in ((1, 2), (2, 1)):
        columns = changed(columns, weak, lock_time=7.0, cn0_dbhz=31.0)
        columns = changed(columns, strong, lock_time=8.0, cn0_dbhz=33.0)
        rows = PairSelector().rows(time, columns)
        assert (rows.lock_time[0], rows.cn0_dbhz[0]) == (7.0, 31.0)


@pytest.mark.parametrize("band", [1, 2])
def test_a_flag_of_one_signal_is_enough(band):
    valid = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN
    time, columns = exact(np.full((1, 1), 20.0))

    def flags(value):
        rows = PairSelector().rows(time, changed(columns, band, flags=value))
        return rows.code_valid[0], rows.phase_valid[0], rows.parity_known[0], rows.lock_lost[0]

    assert flags(valid) == (True, True, True, False)
    assert flags(valid & ~c.FLAG_CODE_VALID) == (False, True, True, False)
    assert flags(valid & ~c.FLAG_PHASE_VALID) == (True, False, True, False)
    assert flags(valid & ~c.FLAG_PARITY_KNOWN) == (True, True, False, False)
    assert flags(valid | c.FLAG_LOCK_LOST) == (True, True, True, True)


@pytest.mark.parametrize("band", [1, 2])
def test_nan_is_a_missing_value_whatever_the_flags_say(band):
    time, columns = exact(np.full((1, 1), 20.0))
    rows = PairSelector().rows(time, changed(columns, band, pseudorange=np.nan))
    assert not rows.code_valid[0] and rows.phase_valid[0] and np.isnan(rows.stec_code_tecu[0])
    rows = PairSelector().rows(time, changed(columns, band, carrier_phase_cycles=np.nan))
    assert rows.code_valid[0] and not rows.phase_valid[0] and np.isnan(rows.stec_phase_tecu[0])


def test_half_cycles_of_both_signals_are_told_apart():
    time, columns = exact(np.full((1, 1), 20.0))
    half = columns["flags"][0] | c.FLAG_HALF_CYCLE_ADDED
    first = changed(columns, 1, flags=half)
    cases = (columns, first, changed(columns, 2, flags=half), changed(first, 2, flags=half))
    states = [int(PairSelector().rows(time, case).half_cycle[0]) for case in cases]
    assert len(set(states)) == 4 and states[0] == 0


def test_links_and_satellites_are_numbered_as_they_appear():
    """Also if the second call brings satellites with smaller numbers."""
    signals = (*TWO, (5, "Q"))
    time, columns = exact(np.full((2, 3), 20.0), signals)
    first = (time == time[0]) & (columns["prn"] == 3) & (columns["band"] != 2)
    second = time != time[0]
    selector = PairSelector()
    rows = selector.rows(time[first], {n: column[first] for n, column in columns.items()})
    assert (rows.link.tolist(), rows.satellite.tolist()) == ([0], [0])
    rows = selector.rows(time[second], {n: column[second] for n, column in columns.items()})
    assert rows.satellite.tolist() == [1, 1, 2, 2, 0, 0]
    assert rows.link.tolist() == [1, 2, 3, 4, 5, 0]
    names = [(link.prn, link.code_first, link.code_second) for link in selector.links]
    assert names == [
        (3, "C1C", "C5Q"),
        *((1, "C1C", code) for code in ("C2W", "C5Q")),
        *((2, "C1C", code) for code in ("C2W", "C5Q")),
        (3, "C1C", "C2W"),
    ]
    assert rows.row_first.tolist() == [0, 0, 3, 3, 6, 6]
    assert rows.row_second.tolist() == [1, 2, 4, 5, 7, 8]


def test_a_satellite_without_a_second_signal_has_one_row():
    time, columns = exact(np.full((1, 2), 20.0), (*TWO, (5, "Q")))
    kept = (columns["prn"] == 1) | (columns["band"] == 1)
    rows = PairSelector().rows(time[kept], {n: column[kept] for n, column in columns.items()})
    assert rows.link.tolist() == [0, 1, -1]
    assert rows.satellite.tolist() == [0, 0, 1]
    assert rows.row_second.tolist() == [1, 2, -1]
    assert rows.code_valid.tolist() == rows.phase_valid.tolist() == [True, True, False]
    assert np.isnan(rows.stec_code_tecu[2]) and np.isnan(rows.stec_phase_tecu[2])
    # A second band alone makes no row.
    alone = columns["band"] == 2
    rows = PairSelector().rows(time[alone], {n: column[alone] for n, column in columns.items()})
    assert len(rows) == 0


def test_the_best_attribute_is_that_of_each_epoch():
    time, columns = exact(np.full((2, 1), 20.0), ((1, "C"), (2, "X"), (2, "W")))
    kept = (time == time[0]) | (columns["attribute"] != ord("W"))
    selector = PairSelector([SignalPair(c.SYSTEM_GPS, 1, 2, "C", "WX")])
    rows = selector.rows(time[kept], {n: column[kept] for n, column in columns.items()})
    assert [selector.links[number].code_second for number in rows.link] == ["C2W", "C2X"]
    assert rows.time.tolist() == [START, START + 1_000_000_000]


def test_a_glonass_channel_gives_the_frequency():
    """A channel that becomes known makes a new link; negative channels are told from positive."""
    time, columns = exact(np.full((4, 1), 20.0), ((1, "C"), (2, "C")))
    columns["system"][:] = c.SYSTEM_GLONASS
    for epoch, channel in enumerate((c.GLONASS_CHANNEL_UNKNOWN, -7, 6, -7)):
        columns["glonass_channel"][2 * epoch : 2 * epoch + 2] = channel
    selector = PairSelector()
    rows = selector.rows(time, columns)
    assert rows.link.tolist() == [0, 1, 2, 1]
    assert rows.satellite.tolist() == [0, 0, 0, 0]
    unknown, low, high = selector.links
    assert np.isnan(unknown.frequency_first) and np.isnan(unknown.tecu_per_metre)
    assert (low.frequency_first, low.frequency_second) == (1598.0625e6, 1242.9375e6)
    assert (high.frequency_first, high.frequency_second) == (1605.375e6, 1248.625e6)
    factor = 1.0 / (40.308193e16 * (1242.9375e6**-2 - 1598.0625e6**-2))
    assert low.tecu_per_metre == pytest.approx(factor, rel=1e-6)


def test_links_of_different_signals_have_different_keys():
    """Attributes are bytes: neither their order nor a carry into the band may be lost."""
    signals = [(band, attribute) for band in (0, 1, 2) for attribute in (0, 1, 254, 255)]
    columns = {
        name: np.zeros(len(signals), dtype=np.uint8)
        for name in ("system", "prn", "band", "attribute", "glonass_channel")
    }
    columns["band"], columns["attribute"] = np.array(signals, dtype=np.uint8).T
    first, second = np.indices((len(signals), len(signals))).reshape(2, -1)
    assert len(np.unique(link_keys(columns, first, second))) == len(first)

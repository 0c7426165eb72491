"""A signal is continuous while its receiver reports no interruption and no test blames it."""

from __future__ import annotations

import numpy as np

from vtff_gnss import constants as c
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_gnss.signals import SignalKey
from vtff_iono.content.slant_tec import SlantTecProcessor, no_bias
from vtff_iono.density.signal_continuity import SignalContinuity
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock

L1, L2 = (SignalKey(c.SYSTEM_GPS, 5, band, ord(a)) for band, a in ((1, "C"), (2, "W")))
LOCKED = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN
RATE = 20


def numbers(seconds, lock_time=None, flags=None, phase=None, cn0=None):
    """Return the number of the stretch of L1 and L2 after each second; changes by (second, row)."""
    lock_time, flags, phase, cn0 = (table or {} for table in (lock_time, flags, phase, cn0))
    continuity, result = SignalContinuity(c.SYSTEM_GPS, (1, 2)), []
    processor = SlantTecProcessor(no_bias, no_bias)
    for second in range(seconds):
        columns = {name: np.zeros(2 * RATE) for name in OBSERVATION_COLUMNS}
        columns["prn"] = np.full(2 * RATE, 5)
        columns["band"] = np.tile([1, 2], RATE)
        columns["attribute"] = np.tile([ord("C"), ord("W")], RATE)
        columns["system"] = np.zeros(2 * RATE, dtype=int)
        columns["glonass_channel"] = np.zeros(2 * RATE, dtype=np.int8)
        columns["pseudorange"] = np.full(2 * RATE, 2e7)
        columns["cn0_dbhz"] = np.full(2 * RATE, 40.0)
        time = 10**9 * second + np.repeat(np.arange(1, RATE + 1), 2) * 10**9 // RATE
        columns["lock_time"] = 100.0 + 1e-9 * time
        columns["flags"] = np.full(2 * RATE, LOCKED, dtype=np.uint16)
        row = np.arange(RATE)
        for table, name in ((lock_time, "lock_time"), (flags, "flags"), (cn0, "cn0_dbhz")):
            for (at, band), values in table.items():
                if at == second:
                    columns[name][2 * row + band - 1] = values
        for (at, band), cycles in phase.items():
            if second >= at:
                columns["carrier_phase_cycles"][2 * row + band - 1] += cycles
        block = ObservationBlock(time, columns)
        rows = processor.update(time, columns, np.full(2 * RATE, 1.0))
        found = continuity.update(block, rows)
        result.append((found.get(L1), found.get(L2)))
    return result


def test_a_loss_of_l2_leaves_l1_what_it_is():
    begun = np.arange(RATE) / RATE
    quiet = numbers(6)
    assert len(set(quiet)) == 1
    lost = numbers(6, lock_time={(3, 2): begun, (4, 2): 1.0 + begun, (5, 2): 2.0 + begun})
    assert [first for first, _ in lost] == [first for first, _ in quiet]
    assert [second - lost[0][1] for _, second in lost] == [0, 0, 0, 1, 1, 1]


def test_half_a_cycle_and_a_phase_that_is_not_valid_end_a_stretch_of_their_signal():
    half = np.full(RATE, LOCKED | c.FLAG_HALF_CYCLE_ADDED)
    changed = numbers(4, flags={(2, 1): half, (3, 1): half})
    assert [first - changed[0][0] for first, _ in changed] == [0, 0, 1, 1]
    invalid = np.full(RATE, LOCKED)
    invalid[4] = c.FLAG_CODE_VALID
    broken = numbers(4, flags={(2, 2): invalid})
    assert [second - broken[0][1] > 0 for _, second in broken] == [False, False, True, True]
    assert len({first for first, _ in broken}) == 1


def test_a_slip_that_no_receiver_reports_may_be_of_either_signal():
    slipped = numbers(5, phase={(3, 1): 1.0})
    for signal in (0, 1):
        changes = [numbers_now[signal] - slipped[0][signal] for numbers_now in slipped]
        assert changes[:3] == [0, 0, 0] and changes[3] > 0 and changes[4] == changes[3]


def test_the_signal_that_has_faded_is_blamed_alone():
    faded = np.full(RATE, 40.0)
    faded[5] = 27.0
    slipped = numbers(5, phase={(3, 2): 1.0}, cn0={(3, 2): faded})
    assert len({first for first, _ in slipped}) == 1
    assert [second - slipped[0][1] > 0 for _, second in slipped] == [False] * 3 + [True] * 2


def test_a_fade_counts_as_a_slip_while_no_test_can_see_one():
    """The phase of L1 may be wound up in a fade while L2 is lost."""
    faded = np.full(RATE, 40.0)
    faded[5] = 30.0
    without_l2 = {(second, 2): np.full(RATE, c.FLAG_CODE_VALID) for second in (2, 3)}
    for flags, at, breaks in (({}, 3, 0), (without_l2, 3, 1), (without_l2, 5, 0)):
        found = [first for first, _ in numbers(7, flags=flags, cn0={(at, 1): faded})]
        assert found[-1] - found[0] == breaks

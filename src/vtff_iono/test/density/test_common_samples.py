"""Samples of chief and deputy that belong together, against sets and sorted arrays."""

import types

import numpy as np
import pytest

from vtff_iono.content.slant_tec import Rejection
from vtff_iono.density.common_samples import NO_LINK, common_samples, squared_steps


def draw_rows(generator, epochs, links):
    """Rows of a receiver that misses epochs and links; arcs end, phases are rejected."""
    rows = [
        (epoch, link, (epoch > 12) + 1 if link == 2 else 1)
        for epoch in epochs
        for link in generator.permutation(links)
        if generator.random() < 0.8
    ]
    time, link, arc = np.array(rows, dtype=np.int64).T
    arc[generator.random(len(arc)) < 0.05] = 0
    link[generator.random(len(link)) < 0.1] = -1
    reasons = np.array([0, int(Rejection.PHASE_INVALID), int(Rejection.NO_RECEIVER_BIAS)])
    rejected = generator.choice(reasons, len(time), p=[0.6, 0.1, 0.3]).astype(np.uint16)
    pairs = types.SimpleNamespace(time=time, link=link)

    class Rows(types.SimpleNamespace):
        def __len__(self):
            return len(time)

    return Rows(pairs=pairs, arc=arc, rejected=rejected)


def samples_by_name(rows, numbers):
    """Rows with a phase in the last arc of their link, by epoch and common link."""
    last = dict(zip(rows.pairs.link.tolist(), rows.arc.tolist(), strict=True))
    return {
        (int(time), numbers[link]): row
        for row, (time, link) in enumerate(zip(rows.pairs.time, rows.pairs.link, strict=True))
        if link >= 0
        and numbers[link] != NO_LINK
        and rows.arc[row] > 0
        and rows.arc[row] == last[link]
        and not rows.rejected[row] & Rejection.PHASE_INVALID
    }


@pytest.mark.parametrize("seed", range(6))
def test_samples_of_both_are_those_of_one_epoch_and_link(seed):
    generator = np.random.default_rng(seed)
    numbers = (np.array([3, NO_LINK, 0, 1, 2]), np.array([0, 1, 2, NO_LINK, 3, 5]))
    chief = draw_rows(generator, np.flatnonzero(generator.random(20) < 0.8), 5)
    deputy = draw_rows(generator, np.flatnonzero(generator.random(20) < 0.8), 6)
    (first, second, link), last_arcs = common_samples((chief, deputy), numbers)
    names = [
        samples_by_name(rows, table) for rows, table in zip((chief, deputy), numbers, strict=True)
    ]
    expected = {(names[0][name], names[1][name], name[1]) for name in names[0].keys() & names[1]}
    found = list(zip(first.tolist(), second.tolist(), link.tolist(), strict=True))
    assert len(found) > 5 and set(found) == expected and len(set(found)) == len(found)
    assert (np.diff(first) > 0).all()
    for rows, table, arcs in zip((chief, deputy), numbers, last_arcs, strict=True):
        expected_arcs = np.zeros(6, dtype=int)
        for own, arc in zip(rows.pairs.link.tolist(), rows.arc.tolist(), strict=True):
            if own >= 0 and table[own] != NO_LINK:
                expected_arcs[table[own]] = arc
        assert arcs.tolist() == expected_arcs.tolist()


def test_without_rows_nothing_is_common():
    generator = np.random.default_rng(1)
    rows = draw_rows(generator, np.arange(3), 2)
    nothing = types.SimpleNamespace(
        pairs=types.SimpleNamespace(time=rows.pairs.time[:0], link=rows.pairs.link[:0]),
        arc=rows.arc[:0],
        rejected=rows.rejected[:0],
    )
    nothing = type("Rows", (), {**vars(nothing), "__len__": lambda self: 0})()
    none = np.zeros(0, dtype=np.int64)
    for both, numbers in (
        ((rows, nothing), (np.array([0, 1]), none)),
        ((nothing, nothing), (none, none)),
    ):
        samples, _ = common_samples(both, numbers)
        assert all(len(part) == 0 for part in samples)


@pytest.mark.parametrize("seed", range(4))
def test_steps_are_those_of_each_link(seed):
    generator = np.random.default_rng(seed)
    link = generator.integers(0, 5, 60)
    link[link == 3] = 4
    link[7] = 3
    content = 1e3 + generator.standard_normal(60)
    first, steps = squared_steps(link, content, 6)
    for number in range(6):
        of_link = content[link == number]
        if not len(of_link):
            assert np.isnan(first[number])
            continue
        squares = np.diff(of_link) ** 2
        mean = squares.mean() if len(squares) else 0.0
        assert first[number] == of_link[0]
        np.testing.assert_allclose(steps[link == number], [mean, *squares], rtol=1e-12)

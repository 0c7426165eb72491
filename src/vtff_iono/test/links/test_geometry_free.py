"""Slant TEC per metre of two frequencies: published factors."""

from __future__ import annotations

import pytest

from vtff_iono.links.geometry_free import tecu_per_metre

L1, L2, L5 = 1575.42e6, 1227.60e6, 1176.45e6


def test_published_factors():
    # 9.51775 TECU/m for L1/L2: facts/ionosphere.md; 0.163 and 0.267 m/TECU: NovAtel APN-070.
    assert tecu_per_metre(L1, L2) == pytest.approx(9.5177, abs=2e-3)
    assert tecu_per_metre(L1, L5) == pytest.approx(7.7627, abs=2e-3)
    assert tecu_per_metre(L2, L1) == -tecu_per_metre(L1, L2)


@pytest.mark.parametrize(("first", "second"), [(L1, L1), (0.0, L2), (L1, -1.0)])
def test_impossible_frequencies_are_named(first, second):
    with pytest.raises(ValueError, match="frequencies"):
        tecu_per_metre(first, second)

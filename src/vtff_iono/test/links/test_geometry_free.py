"""Slant TEC of two frequencies: known factors, and code and phase of opposite sign."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_iono.links.geometry_free import (
    relative_stec_from_code,
    relative_stec_from_phase,
    tecu_per_metre,
)

L1, L2, L5 = 1575.42e6, 1227.60e6, 1176.45e6
SPEED_OF_LIGHT = 299_792_458.0


def test_published_factors():
    # 9.51775 TECU/m for L1/L2: facts/ionosphere.md; 0.163 and 0.267 m/TECU: NovAtel APN-070.
    assert tecu_per_metre(L1, L2) == pytest.approx(9.5177, abs=2e-3)
    assert tecu_per_metre(L1, L5) == pytest.approx(7.7627, abs=2e-3)
    assert tecu_per_metre(L2, L1) == -tecu_per_metre(L1, L2)


def test_code_and_phase_see_the_same_content_with_opposite_signs():
    stec = np.array([0.0, 0.5, 30.17, 150.0])
    delay_first, delay_second = (40.308193e16 / f**2 * stec for f in (L1, L2))
    distance = 2.2e7
    code = relative_stec_from_code(distance + delay_first, distance + delay_second, L1, L2)
    np.testing.assert_allclose(code, stec, atol=1e-6)
    phase_first = (distance - delay_first) * L1 / SPEED_OF_LIGHT
    phase_second = (distance - delay_second) * L2 / SPEED_OF_LIGHT
    phase = relative_stec_from_phase(phase_first, phase_second, L1, L2)
    np.testing.assert_allclose(phase, stec, atol=1e-6)


@pytest.mark.parametrize(("first", "second"), [(L1, L1), (0.0, L2), (L1, -1.0)])
def test_impossible_frequencies_are_named(first, second):
    with pytest.raises(ValueError, match="frequencies"):
        tecu_per_metre(first, second)

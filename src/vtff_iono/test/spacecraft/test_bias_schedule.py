"""When receiver biases are estimated: after a delay, then ever more rarely, up to an interval."""

from __future__ import annotations

import types

import numpy as np

from vtff_iono.spacecraft.bias_sample_window import BIAS_SAMPLE_INTERVAL
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftIonosphere, SpacecraftSettings


def test_estimates_become_rarer_as_the_arc_grows():
    settings = SpacecraftSettings(bias_interval=300.0)
    estimated: list[int] = []
    craft = types.SimpleNamespace(_settings=settings, _bias_start=None, _bias_due=0)
    start = 1_000_000_000_000_000_000
    for second in range(0, 4 * 3600, 20):
        time = start + second * 10**9
        if SpacecraftIonosphere._is_bias_due(craft, time):
            estimated.append(time)
    gaps = np.diff(estimated)
    assert estimated[0] - start >= settings.bias_delay * 1e9
    assert (gaps >= BIAS_SAMPLE_INTERVAL).all()
    assert (np.diff(gaps) >= 0).all()
    assert gaps[-1] > 2 * gaps[0]
    assert gaps[-1] <= settings.bias_interval * 1e9 + BIAS_SAMPLE_INTERVAL

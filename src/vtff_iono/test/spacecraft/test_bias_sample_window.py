"""Samples of the receiver bias: levels of their arcs, groups, and a window that forgets."""

from __future__ import annotations

import numpy as np
import pytest
from formation_drawing import START, DrawnFormation, layer

from vtff_iono.bias.bias_samples import ReceiverBiasError
from vtff_iono.content.slant_tec import SlantTecProcessor
from vtff_iono.formation_ionosphere import FormationIonosphere, FormationSettings
from vtff_iono.spacecraft.bias_sample_window import BiasSampleWindow
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftSettings


def drawn():
    return DrawnFormation(lambda t: 600e3 + 5.0 * t, layer(), slips={(0, 9): 100.0})


def collected(length, duration=400.0):
    """Return the window after a flight with an epoch each 10 s, and the links."""
    window, processor = BiasSampleWindow(length), SlantTecProcessor()
    for second in drawn().seconds(duration, 1.0, every=10.0):
        block = second.observations[0]
        count = len(block.time)
        rows = processor.update(block.time, block.columns, np.full(count, 0.7))
        direction = np.tile([0.0, 0.0, 1.0], (count, 1))
        position = np.tile(second.states_itrf[0][:3], (count, 1))
        wind_up = 1e-3 * np.arange(len(rows))
        first, last = np.array([0]), np.array([len(rows) - 1])
        window.add_epochs(rows, first, last, direction, position, wind_up)
    return window, processor


def test_samples_are_taken_each_20_s_and_kept_for_the_window():
    window, processor = collected(120.0)
    groups, samples = window.collect(processor.links)
    assert groups == [(0, "C1C", "C2W")]
    start = 1e-9 * START.nanoseconds
    times = np.unique(samples.time) - start
    assert times == pytest.approx(np.arange(280.0, 401.0, 20.0), abs=1e-5)
    assert len(window) == len(samples.time) and (samples.group == 0).all()
    assert samples.wind_up_tecu[:3] == pytest.approx([0.0, 1e-3, 2e-3])
    # The arc that the slip has ended has no sample left, nor has it a level.
    assert window.arcs == len(np.unique(samples.arc))
    whole, _ = collected(1e4)
    assert whole.arcs == window.arcs + 1


def test_all_samples_of_an_arc_have_its_latest_level():
    window, processor = collected(1e4)
    _, samples = window.collect(processor.links)
    for arc in np.unique(samples.arc):
        own = samples.arc == arc
        assert np.ptp(samples.stec_sigma_tecu[own]) == 0.0
        # With the levels of their own times, which begin with a noise of TECU, they would scatter.
        assert np.abs(np.diff(samples.stec_tecu[own], n=2)).max(initial=0.0) < 0.5


def test_without_samples_the_reason_is_told():
    with pytest.raises(ReceiverBiasError, match="receiver bias: no samples; contents at known"):
        BiasSampleWindow(100.0).collect([])


def test_a_formation_without_positions_tells_why_it_has_no_bias():
    formation = FormationIonosphere(
        FormationSettings(spacecraft=SpacecraftSettings(bias_delay=10.0))
    )
    for second in drawn().seconds(40.0, 1.0):
        formation.process(second)  # without ephemerides there is no geometry
    assert formation.spacecraft[0].receiver_biases == {}
    assert "no samples" in formation.spacecraft[0].bias_error

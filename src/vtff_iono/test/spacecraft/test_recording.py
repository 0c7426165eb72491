"""A recording that is processed many seconds at a time has the results of each second alone."""

from __future__ import annotations

import dataclasses

import numpy as np
from formation_drawing import DrawnFormation, layer

from vtff_iono.bias.receiver_bias import BiasEstimate, ReceiverBias
from vtff_iono.formation_ionosphere import SECONDS_TOGETHER, FormationIonosphere, FormationSettings
from vtff_iono.spacecraft import spacecraft_ionosphere
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock, SpacecraftSettings

DURATION = 140.0


def assert_equal(left, right):
    """Raise AssertionError unless two results are equal to rounding."""
    if dataclasses.is_dataclass(left):
        for field in dataclasses.fields(left):
            assert_equal(getattr(left, field.name), getattr(right, field.name))
    elif isinstance(left, list | tuple):
        assert len(left) == len(right)
        for of_left, of_right in zip(left, right, strict=True):
            assert_equal(of_left, of_right)
    elif isinstance(left, np.ndarray | float):
        np.testing.assert_allclose(right, left, rtol=1e-9, atol=0.0)
    else:
        assert left == right


def biases_of(samples, before=None):
    """Return receiver biases that tell how many samples they were estimated from."""
    bias = 0.01 * len(samples.time)
    count = int(samples.group.max()) + 1
    return BiasEstimate([ReceiverBias(bias, 0.5, 0.5, 0.0, (bias,), False, 1)] * count, None)


def test_seconds_together_and_alone_have_the_same_results(monkeypatch):
    """With gaps, a slip, fades, and ephemerides and receiver biases that come on the way."""
    monkeypatch.setattr(spacecraft_ionosphere, "estimate_receiver_biases", biases_of)
    drawn = DrawnFormation(
        lambda t: 330e3 + 200.0 * t,
        layer(),
        slips={(1, 9): 25.0},
        fades={5: (10.0, 30.0, 0.4), 20: (40.0, 60.0, 0.6)},
    )
    settings = FormationSettings(spacecraft=SpacecraftSettings(bias_delay=30.0))
    ephemerides = list(drawn.ephemerides(DURATION))
    seconds = list(drawn.seconds(DURATION, 0.5))
    empty = ObservationBlock(
        seconds[0].observations[0].time[:0],
        {name: column[:0] for name, column in seconds[0].observations[0].columns.items()},
    )
    gaps = {7: (empty, seconds[7].observations[1]), 33: (empty, empty)}
    seconds = [
        dataclasses.replace(second, observations=gaps.get(number, second.observations))
        for number, second in enumerate(seconds)
        if number != 50
    ]
    late = len(ephemerides) // 2
    recording = [
        ({0: ephemerides[:late], 26: ephemerides[late:]}.get(number, []), second)
        for number, second in enumerate(seconds)
    ]
    alone, together = FormationIonosphere(settings), FormationIonosphere(settings)
    expected = []
    for new, second in recording:
        for ephemeris in new:
            alone.add_ephemeris(ephemeris)
        expected.append(alone.process(second))
    assert len(expected) > 2 * SECONDS_TOGETHER
    assert_equal(expected, list(together.process_recording(recording)))
    assert any(result.spacecraft[0].scintillation for result in expected)
    assert any(result.density[0] for result in expected)
    biases = [formation.spacecraft[0].receiver_biases for formation in (alone, together)]
    assert biases[0] and biases[0] == biases[1]
    removed = [result.spacecraft[0].epoch for result in expected if result.spacecraft[0].epoch]
    assert 0 < np.count_nonzero([epoch.rejected[0] == 0 for epoch in removed]) < len(removed)

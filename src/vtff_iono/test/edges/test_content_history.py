"""Contents and positions of the last minutes: crossings of altitudes, series of links."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from formation_drawing import START, DrawnFormation, layer

from vtff_iono.edges.content_history import ContentHistory
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftIonosphere

SECOND = 10**9
SPEED = 200.0


def history(speed=SPEED, length=60.0, duration=100.0, missing=()):
    """Return a history of the chief, 2 Hz, without the seconds `missing`."""
    drawn = DrawnFormation(lambda t: 300e3 + speed * t, layer(), phase_sigma=0.0)
    spacecraft, kept = SpacecraftIonosphere(), ContentHistory(length)
    for ephemeris in drawn.ephemerides(duration):
        spacecraft.add_ephemeris(ephemeris)
    for number, second in enumerate(drawn.seconds(duration, 0.5), start=1):
        if number not in missing:
            block = second.observations[0]
            position = drawn.position(0, (block.time - START.nanoseconds) * 1e-9)
            (result,) = spacecraft.process((block,), position).results
            kept.add(position, result, spacecraft.links)
    return drawn, kept


def at(seconds):
    return START.nanoseconds + round(seconds * SECOND)


@pytest.mark.parametrize("speed", [SPEED, -SPEED])
def test_crossing_of_an_altitude(speed):
    _, kept = history(speed)
    assert kept.time_at_altitude(300e3 + speed * 70.25) == pytest.approx(at(70.25), abs=1e7)
    # Altitudes that were not crossed: the nearer end of the history.
    assert kept.time_at_altitude(300e3 + speed * 500.0) == at(100.0)
    assert kept.time_at_altitude(300e3) == pytest.approx(at(40.0), abs=SECOND)


def test_only_the_last_minute_is_kept():
    drawn, kept = history()
    times, positions = kept.trajectory()
    assert times[0] >= at(40.0) and times[-1] == at(100.0)
    assert positions[-1] == pytest.approx(drawn.position(0, np.array([100.0]))[0], abs=1e-6)
    middle = drawn.position(0, np.array([80.5]))[0]
    assert kept.position_at(at(80.5)) == pytest.approx(middle, abs=3.0)
    assert ContentHistory(10.0).time_at_altitude(300e3) is None


def test_series_of_even_epochs():
    drawn, kept = history(missing=(90,))
    epochs = kept.epochs(at(80.0), at(95.0))
    assert epochs[0] == at(80.0) and epochs[-1] == at(95.0)
    assert at(89.5) not in epochs and at(90.0) not in epochs
    even = np.arange(at(80.0), at(95.0) + 1, SECOND // 2)
    is_whole = np.isfinite(kept.series(epochs, kept.links).stec).all(axis=1)
    first, second = np.flatnonzero(is_whole)[:2]
    other = dataclasses.replace(kept.links[0], prn=60)
    series = kept.series(even, [kept.links[second], other, kept.links[first]])
    is_there = np.isin(even, epochs)
    assert np.isnan(series.altitude[~is_there]).all()
    assert series.altitude[is_there] == pytest.approx(
        drawn.altitudes((even[is_there] - START.nanoseconds) * 1e-9)[0], abs=1e-3
    )
    assert np.isnan(series.stec[1]).all() and (series.arc[1] == 0).all()
    for row in (0, 2):
        assert np.isfinite(series.stec[row, is_there]).all()
        assert np.isnan(series.stec[row, ~is_there]).all()
        assert (series.arc[row, is_there] > 0).all()
    assert not np.allclose(series.elevation[0, 0], series.elevation[2, 0])

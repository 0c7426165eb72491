"""A day of the whole chain: its memory does not grow, and the receiver bias stays right."""

from __future__ import annotations

import collections

import numpy as np
import pytest
from formation_drawing import START, DrawnFormation, layer

from vtff_gnss.constants import FREQUENCY_L1, FREQUENCY_L2, SYSTEM_GPS
from vtff_gnss.signals import SignalKey
from vtff_iono.density.integer_resolution import FloatingContent, IntegerResolver
from vtff_iono.density.phase_stretches import LinkSignals, PhaseStretches
from vtff_iono.formation_ionosphere import FormationIonosphere, FormationSettings
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftSettings

HOUR = 3600.0
KEY = (SYSTEM_GPS, "C1C", "C2W")


def items(root):
    """Return the numbers of items in all arrays and in all other containers of an object."""
    in_arrays, total, seen, waiting = 0, 0, set(), [root]
    while waiting:
        value = waiting.pop()
        if id(value) in seen:
            continue
        seen.add(id(value))
        if isinstance(value, np.ndarray):
            in_arrays += value.size
        elif isinstance(value, dict):
            total += len(value)
            waiting += [*value.keys(), *value.values()]
        elif isinstance(value, (list, tuple, set, frozenset, collections.deque)):
            total += len(value)
            waiting += value
        elif hasattr(value, "__dict__") and not isinstance(value, type):
            waiting += vars(value).values()
    return in_arrays, total


def test_a_day_has_a_flat_memory():
    """An epoch every 400 s of an eccentric orbit; new ephemerides every two hours."""
    drawn = DrawnFormation(lambda t: 502e3 + 266e3 * np.cos(2.0 * np.pi / 5500.0 * t), layer())
    settings = SpacecraftSettings(bias_delay=7.9 * HOUR, bias_interval=6.0 * HOUR)
    formation = FormationIonosphere(FormationSettings(spacecraft=settings))
    ephemerides = collections.deque(drawn.ephemerides(24.0 * HOUR))
    sizes = {}
    for second in drawn.seconds(24.0 * HOUR, 1.0, every=400.0):
        hour = (second.time - START.nanoseconds) / (HOUR * 1e9)
        while ephemerides and START + (hour + 2.0) * HOUR >= ephemerides[0].time_of_ephemeris:
            formation.add_ephemeris(ephemerides.popleft())
        formation.process(second)
        if hour in (8.0, 16.0, 24.0):
            sizes[hour] = items(formation)
    # The first hours fill the windows; from then on satellites come and go.
    assert sizes[16.0] == pytest.approx(sizes[8.0], rel=0.1)
    assert sizes[24.0] == pytest.approx(sizes[8.0], rel=0.1)
    scale = tecu_per_metre(FREQUENCY_L1, FREQUENCY_L2)
    for spacecraft, truth in zip(formation.spacecraft, drawn.receiver_bias, strict=True):
        assert spacecraft.bias_error is None
        value, sigma = spacecraft.receiver_biases[KEY].code_bias(scale)
        assert abs(value - truth) <= min(0.15e-9, 3.0 * sigma)


def test_arcs_that_break_every_minute_for_hours_are_forgotten():
    """Four hours at 1 Hz of eight links in scintillation, half of them without integers."""
    minutes = 240
    stretches, resolver = PhaseStretches(), IntegerResolver(FREQUENCY_L1, FREQUENCY_L2)
    links = [
        LinkSignals(SignalKey(SYSTEM_GPS, prn, 1, 67), SignalKey(SYSTEM_GPS, prn, 2, 87))
        for prn in range(1, 9)
    ]
    integers = {signal: float(link.prn) for link in links[:4] for signal in link}
    most, most_unresolved, number = 0, 0, -1
    for second in range(60 * minutes):
        arcs = {link: (1 + (second + 7 * link.prn) // 60, 1) for link in links}
        current = stretches.continue_or_begin(arcs, integers, {})
        for link in links[4:]:
            # No common bias is known, so that nothing is ever resolved.
            content = FloatingContent(current[link].number, 0.0, 20, 0.0, 0.01)
            assert resolver.resolve([content], np.array([[0.02**2]])) == {}
        stretches.forget_ended(stretch.number for stretch in current.values())
        resolver.keep_only(stretches.numbers())
        most = max(most, len(stretches))
        most_unresolved = max(most_unresolved, len(resolver))
        if second % 60 == 0:
            newest = max(stretch.number for stretch in current.values())
            assert newest > number
            number = newest
    assert most == len(links)
    assert most_unresolved == 4
    assert number > 8 * (minutes - 10)


def test_a_stretch_continues_after_an_interruption_and_lasts_while_it_is_in_use():
    stretches = PhaseStretches()
    link = LinkSignals(SignalKey(SYSTEM_GPS, 5, 1, 67), SignalKey(SYSTEM_GPS, 5, 2, 87))
    fixed = {link.first: 3.0, link.second: 4.0}
    first = stretches.continue_or_begin({link: (1, 1)}, fixed, {})[link]
    assert (first.number, first.integers, first.signals.prn) == (0, (3.0, 4.0), 5)
    floating = stretches.continue_or_begin({link: (1, 1)}, {link.first: 3.0}, {})[link]
    assert (floating.number, floating.integers) == (1, (3.0, None))
    assert first.has_integers and not floating.has_integers
    stretches.forget_ended([])
    # Neither other integers nor a second without the link end it; other arcs do.
    stretches.continue_or_begin({}, {}, {})
    stretches.forget_ended([])
    assert stretches.continue_or_begin({link: (1, 1)}, fixed, {})[link] is first
    assert stretches[0] is first
    second = stretches.continue_or_begin({link: (1, 2)}, fixed, {})[link]
    assert second.number == 2
    stretches.forget_ended([0])
    assert list(stretches.numbers()) == [0, 2]
    stretches.forget_ended([])
    assert list(stretches.numbers()) == [2]

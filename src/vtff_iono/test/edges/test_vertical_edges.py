"""Densities that belong together, and the window in which the crossing of an edge is fitted."""

import types

import numpy as np
import pytest

from vtff_iono.edges import vertical_edges
from vtff_iono.edges.edge_detectors import Edge
from vtff_iono.edges.vertical_edges import VerticalEdgeFinder, choose_half_window
from vtff_iono.edges.wall_width import WidthsByShape

EARTH_RADIUS = 6_378_137.0


@pytest.mark.parametrize("distance", [15.0, 20.0, 35.0, 41.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_other_edge_lies_in_the_window(distance, sign):
    half_window = choose_half_window(100.0, [100.0, 100.0 + sign * distance, 400.0])
    assert 10.0 <= half_window < distance
    # Most of what is free is used: without samples a crossing in scintillation is uncertain.
    assert half_window > 0.6 * distance


@pytest.mark.parametrize(("edge_times", "half_window"), [([100.0], 40.0), ([100.0, 104.0], 10.0)])
def test_longest_and_shortest_window(edge_times, half_window):
    assert choose_half_window(100.0, edge_times) == half_window


def history_of_a_flight(radial_velocity):
    """Return a stand-in for the history of a spacecraft above the equator."""
    return types.SimpleNamespace(
        links=["link"],
        epochs=lambda begin, end: np.arange(begin, end, 10**9),
        series=lambda epochs, links: None,
        trajectory=lambda: (np.zeros(0, dtype=np.int64), np.zeros((0, 3))),
        position_at=lambda time: np.array(
            [EARTH_RADIUS + 5e5 + radial_velocity * time / 1e9, 0, 0]
        ),
    )


def widths(width, sigma, is_of_square=False):
    """Widths that are the same for each shape."""
    return WidthsByShape(np.full(2, width), np.full(2, sigma), np.zeros(2), is_of_square)


@pytest.mark.parametrize("radial_velocity", [-300.0, 300.0])
@pytest.mark.parametrize("is_entry", [False, True])
def test_side_of_the_denser_plasma_follows_from_rising_and_entry(
    radial_velocity, is_entry, monkeypatch
):
    """An entry is into lower density: who rises into it leaves the denser plasma below."""
    sides, spans = [], []

    def fit(time, *_, is_dense_above, **__):
        sides.append(is_dense_above)
        spans.append((time[0], time[-1]))

    monkeypatch.setattr(vertical_edges, "fit_edge_crossings", fit)
    finder = VerticalEdgeFinder()
    finder._histories = (history_of_a_flight(radial_velocity),) * 2
    edge = Edge(0.0, 1.0, is_entry, 5e5, 1.0, 0.5, 1.0)
    assert finder._fit_crossing(edge, 0) is None
    rises = radial_velocity > 0.0
    assert sides == [(rises and not is_entry) or (not rises and is_entry)]
    # All epochs on both sides of the edge are fitted.
    ((first, last),) = spans
    assert first == pytest.approx(-last, abs=1.0)
    assert last > vertical_edges._CROSSING_WINDOW


@pytest.mark.parametrize(
    ("is_doubtful", "of_density", "of_contents", "altitudes", "is_told"),
    [
        (False, 1.4e3, None, None, True),
        (False, 3e3, None, None, False),
        (False, 3e3, [100.0, 1.6e3], [500e3, 500e3], False),
        (False, 3e3, [100.0, 400.0], [498e3, 498e3], True),
        (False, 1.4e3, [100.0, 1.6e3], [500e3, 500e3], True),
        (True, 0.4e3, None, None, False),
        (True, 0.4e3, [200.0, 200.0], [501e3, 500.5e3], True),
        (True, 0.4e3, [200.0, 200.0], [501e3, 502e3], False),
        (True, 3e3, [200.0, 1.6e3], [500e3, 500e3], False),
    ],
)
def test_what_densities_do_not_tell_alone_must_be_told_by_contents(
    is_doubtful, of_density, of_contents, altitudes, is_told, monkeypatch
):
    """In fades the densities beside a wall may be too unsure to tell it, or where it is."""
    fit = None
    if of_contents is not None:
        sigma = np.array(of_contents)
        fit = types.SimpleNamespace(
            time=np.array([1.0, 3.0]),
            time_sigma=sigma / 300.0,
            time_covariance=0.0,
            altitude=np.array(altitudes),
            altitude_sigma=sigma,
            width=500.0,
            width_sigma=300.0,
            widths=widths(500.0, 3e5, is_of_square=True),
        )
    finder = VerticalEdgeFinder()
    finder._histories = (history_of_a_flight(300.0),) * 2
    monkeypatch.setattr(finder, "_vertical_speed", lambda: 300.0)
    monkeypatch.setattr(
        finder, "_fit_crossing", lambda edge, origin: None if fit is None else (origin, fit)
    )
    edge = Edge(
        *(0.0, of_density / 300.0, False, 5e5, 0.5, 1.0, 1.0, 2e3, 1e3),
        altitude_sigma=of_density,
        is_doubtful=is_doubtful,
        widths=widths(2e3, 1e3),
    )
    told = finder._boundaries_of(edge, [10**9, 3 * 10**9])
    assert [boundary.spacecraft for boundary in told] == ([0, 1] if is_told else [])
    if is_told and of_density > 1.5e3:
        assert [b.time_sigma for b in told] == pytest.approx([1.0 / 3.0, 4.0 / 3.0])
    if is_told and fit is not None:
        # Densities told 2 +- 1 km: both count.
        assert all(fit.width < b.width < 2e3 and b.width_sigma < fit.width_sigma for b in told)


def test_densities_of_two_datums_are_not_compared(monkeypatch):
    """With another datum of the integers all densities may be another by the same amount."""
    calls = []
    finder = VerticalEdgeFinder()
    finder._detector = types.SimpleNamespace(
        update=lambda time, *_: calls.append(time) or [],
        flush=lambda: calls.append("flush") or [],
        flush_after_gap=lambda time: [],
    )
    finder._histories = (types.SimpleNamespace(add=lambda *_: None, last_time=9.0),) * 2
    epoch = types.SimpleNamespace(
        **dict.fromkeys(
            ("altitude", "separation", "density", "fast_sigma", "slow_time", "common_sigma"), 1.0
        ),
        slow_parts=np.zeros(0),
    )
    for time, datum in ((1, 1), (2, 1), (3, 2), (4, 2)):
        density = types.SimpleNamespace(
            time=time * 10**9, datum=datum, prn=np.zeros(0, dtype=np.int64), epoch=epoch
        )
        nothing = (None, None)
        assert finder.update(nothing, nothing, nothing, [density]) == []
    assert calls == ["flush", 1.0, 2.0, "flush", 3.0, 4.0]

"""Loops that slip without notice: only those that slip are reported, half cycles by their name."""

from __future__ import annotations

import types

import numpy as np

from vtff_sim_bridge.receiver.tracking import Tracker


def test_only_loops_that_slip_are_reported():
    reported = []
    loops = types.SimpleNamespace(
        _is_tracked=np.array([True, True, True, False]),
        _cycles=np.zeros(4),
        _is_half_added=np.zeros(4, dtype=bool),
        _links=["quiet", "slips", "half", "lost"],
        _report=reported.append,
    )
    Tracker._slip(loops, 7, np.array([0, 1, 2, 3]), np.array([0.0, -3.0, 0.5, 2.0]))
    assert [(arc.link, arc.event) for arc in reported] == [
        ("slips", "slip"),
        ("half", "half_cycle"),
    ]
    assert loops._cycles.tolist() == [0.0, -3.0, 0.5, 0.0]
    assert loops._is_half_added.tolist() == [False, False, True, False]

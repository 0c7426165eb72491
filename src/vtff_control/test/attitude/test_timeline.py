"""Timelines of attitude control."""

from __future__ import annotations

import pytest

from vtff_control.attitude.timeline import Firing, parse_timeline


def test_the_newest_request_holds_and_firings_belong_to_one_period():
    timeline = parse_timeline(["300 point", "0 detumble", "107.5 fire 3"])
    assert [timeline.mode_at(t) for t in (0.0, 299.9, 300.0, 1e6)] == [
        "detumble", "detumble", "point", "point",
    ]  # fmt: skip
    found = [timeline.firing_in(start, 5.0) for start in (100.0, 105.0, 110.0)]
    assert found == [None, Firing(107.5, 3.0), None]


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ([], "a mode at 0 s expected"),
        (["5 point"], "a mode at 0 s expected"),
        (["0 spin"], "entry '0 spin': "),
        (["0 point", "-1 off"], "entry '-1 off': a time"),
        (["0 point", "soon off"], "entry 'soon off': a time"),
        (["0 point", ""], "entry '': a time"),
        (["0 point", "9 fire"], "entry '9 fire': "),
        (["0 point", "9 fire nan"], "a duration of more than 0 s"),
    ],
)
def test_other_entries_are_refused_by_name(entries, text):
    with pytest.raises(ValueError, match=text) as caught:
        parse_timeline(entries)
    assert "\n" not in str(caught.value)

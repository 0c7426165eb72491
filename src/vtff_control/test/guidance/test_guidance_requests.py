"""Requests of a guidance: what a timeline holds, and what is refused with its reason."""

import pytest

from vtff_control.guidance.formations import read_formations
from vtff_control.guidance.requests import (
    ModeRequest,
    ReconfigurationRequest,
    RequestError,
    read_timeline,
)


def test_timeline_is_sorted_and_has_all_fields():
    entries = read_timeline(
        [
            "9000 phase angle_deg=-10 orbits=54.5",
            "120 reconfigure pco duration=4500 axes=TN objective=axes preempt=true",
            "60 keep triangle",
            "1e4 abort",
        ]
    )
    assert [entry.time for entry in entries] == [60.0, 120.0, 9000.0, 10000.0]
    assert entries[0].request == ModeRequest("keep", "triangle")
    assert entries[1].request == ReconfigurationRequest(
        "pco", 4500.0, axes="TN", objective="axes", preempt=True
    )
    assert entries[2].request == ModeRequest("phase", angle_deg=-10.0, orbits=54.5)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("120", "time and mode expected"),
        ("soon keep pco", "time: a number expected, got 'soon'"),
        ("-1 hold", "time: 0 s or more"),
        ("0 dance", "mode: one of hold, keep, reconfigure"),
        ("0 keep", "formation: a name expected"),
        ("0 hold pco", "mode 'hold' takes none, got 'pco'"),
        ("0 phase angle_deg=10", "orbits: more than 0, at most 100000 expected, got 0"),
        ("0 free_drift orbits=2", "angle_deg, orbits: mode 'free_drift' takes none"),
        ("0 reconfigure pco", "formation and duration expected"),
        ("0 reconfigure pco duration=nan", "duration: a number expected"),
        ("0 reconfigure pco duration=100 axes=RX", "axes: some of R, T and N"),
        ("0 reconfigure pco duration=100 objective=time", "objective: one of norms, axes, energy"),
        ("0 reconfigure pco duration=100 preempt=1", "preempt: true or false"),
        ("0 reconfigure pco duration=100 speed=3", "'speed=3': name=value expected, of formation"),
        ("0 reconfigure pco duration=100 closest_approach=-1", "closest_approach: 0 or more"),
    ],
)
def test_wrong_line_is_named(line, reason):
    with pytest.raises(RequestError, match="timeline, '") as caught:
        read_timeline(["0 hold", line])
    assert f"'{line}'" in str(caught.value)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        (None, "formations expected"),
        ({"pco": [1, 2]}, "pco: the spacecraft a, b expected"),
        ({"pco": {"a": [0] * 6}}, "pco: the spacecraft a, b expected"),
        ({"pco": {"a": [0] * 6, "b": [0] * 5}}, "pco.b: six numbers"),
        ({"pco": {"a": [0] * 6, "b": "123456"}}, "pco.b: six numbers"),
        ({"pco": {"a": [0] * 6, "b": [0, 0, 0, 0, 0, float("inf")]}}, "pco.b: six numbers"),
    ],
)
def test_wrong_formation_file_is_named(fields, reason):
    with pytest.raises(ValueError, match="lab.yaml") as caught:
        read_formations(fields, "lab.yaml", ("a", "b"))
    assert reason in str(caught.value)

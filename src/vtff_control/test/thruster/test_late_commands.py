"""Commands whose time is over when they come."""

from __future__ import annotations

from vtff_control.thruster.late_commands import LateCommands

EPOCH = 1_458_522_000  # s since 1970; the wall clock below starts anywhere else


def commands(arrivals, longest_age=2.0):
    """Return which of the commands with these stamps and arrival times, s, are too late."""
    now = [0.0]
    late = LateCommands(longest_age, lambda: now[0])
    refused = []
    for stamp, arrival in arrivals:
        now[0] = arrival
        refused.append(late.is_too_late((EPOCH + stamp) * 10**9))
    assert late.refused == sum(refused)
    return refused


def test_what_a_link_held_back_is_refused_and_the_newest_acts():
    before = [(second, 50.0 + second + 0.1 * (second % 3)) for second in range(10)]
    held_back = [(second, 50.0 + 20.3) for second in range(10, 21)]
    after = [(second, 50.0 + second + 0.2) for second in range(21, 25)]
    refused = commands(before + held_back + after)
    assert refused == [False] * 10 + [True] * 9 + [False] * 2 + [False] * 4


def test_a_clock_that_runs_away_refuses_nothing():
    """Quartz clocks of 50 ppm, for three days."""
    for rate in (1.0 + 5e-5, 1.0 - 5e-5):
        arrivals = [(second, 7.0 + rate * second) for second in range(0, 3 * 86400, 600)]
        assert not any(commands(arrivals))


def test_jitter_below_the_limit_refuses_nothing():
    arrivals = [(second, second + (1.9 if second % 7 == 0 else 0.0)) for second in range(1, 60)]
    assert not any(commands(arrivals))

"""The limit of the time of a call."""

import math
import signal
import time

import pytest

from vtff_node.plugins.time_limit import LOOK_INTERVAL, TimeLimitReachedError, time_limit

LIMIT, PATIENCE = 0.05, 30.0  # s


@pytest.fixture
def handler_before():
    before = signal.getsignal(signal.SIGALRM)
    yield
    signal.signal(signal.SIGALRM, before)
    time_limit.next_look = -math.inf  # other tests limit calls too


def test_a_long_call_is_interrupted_whoever_has_taken_the_alarm_since_the_last_one(handler_before):
    with time_limit(PATIENCE):
        pass
    signal.signal(signal.SIGALRM, signal.SIG_IGN)
    time.sleep(LOOK_INTERVAL)
    with pytest.raises(TimeLimitReachedError), time_limit(LIMIT):
        time.sleep(PATIENCE)


def test_a_late_alarm_interrupts_nothing(handler_before):
    with time_limit(PATIENCE):
        pass
    signal.raise_signal(signal.SIGALRM)

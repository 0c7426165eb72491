"""The limit of the time of a call."""

import math
import signal
import subprocess
import sys
import time

import pytest

from vtff_node.plugins.time_limit import LOOK_INTERVAL, TimeLimitReachedError, time_limit

LIMIT, PATIENCE = 0.05, 30.0  # s


@pytest.fixture
def handler_before():
    before = signal.getsignal(signal.SIGALRM)
    time_limit.next_look = -math.inf  # other tests limit calls too
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)
    time_limit.next_look = -math.inf


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


def test_the_alarm_of_an_earlier_call_interrupts_no_later_one_before_its_limit(handler_before):
    with time_limit(LIMIT):
        pass
    started = time.monotonic()
    with pytest.raises(TimeLimitReachedError), time_limit(4.0 * LIMIT):
        time.sleep(PATIENCE)
    assert time.monotonic() - started >= 4.0 * LIMIT


def test_an_alarm_that_comes_between_calls_is_set_again(handler_before):
    with time_limit(LIMIT):
        pass
    time.sleep(2.0 * LIMIT)
    with pytest.raises(TimeLimitReachedError), time_limit(LIMIT):
        time.sleep(PATIENCE)


def test_an_alarm_that_a_body_has_taken_away_is_set_again_by_the_next_call(handler_before):
    with time_limit(LIMIT):
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    with pytest.raises(TimeLimitReachedError), time_limit(LIMIT):
        time.sleep(PATIENCE)


def test_the_alarm_has_no_meaning_left_when_python_ends():
    code = (
        "import time\n"
        "from vtff_node.plugins.time_limit import time_limit\n"
        "class Late:\n"
        "    def __del__(self, sleep=time.sleep): sleep(0.2)\n"
        "late = Late()\n"
        "with time_limit(0.1): pass\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

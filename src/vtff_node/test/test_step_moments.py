"""Wall times of steps in diagnostics: what is written is read, anything else is left out."""

import time

from hypothesis import given
from hypothesis import strategies as st

from vtff_node.step_moments import StepMoments, read_moments


def test_the_newest_moments_are_told():
    moments = StepMoments()
    assert moments.values("sent") == {}
    for number in range(8):
        moments.note(number * 10**9, 100.0 + number)
    (text,) = moments.values("sent").values()
    read = read_moments(text)
    assert {stamp: moment for (_, stamp), moment in read.items()} == {
        number * 10**9: 100.0 + number for number in range(3, 8)
    }
    other = StepMoments()
    before = time.monotonic()
    other.note(3 * 10**9)
    (same_clock,) = read_moments(other.values("x")["x"]).items()
    assert same_clock[0] in read and before <= same_clock[1] + 1e-6 <= time.monotonic() + 1e-5


@given(st.text())
def test_any_text_can_be_read(text):
    read_moments(text)
    assert read_moments(f"clock 5:1.5 {text.split(':')[0]}").get(("clock", 5)) is not None

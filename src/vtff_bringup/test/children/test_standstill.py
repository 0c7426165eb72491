"""The watch for processes that are stopped and for a run that goes on no more."""

from __future__ import annotations

import dataclasses

from vtff_bringup.children.standstill import (
    LARGEST_LIFELESSNESS,
    LARGEST_SILENCE,
    LARGEST_STOP,
    StandstillWatch,
)


@dataclasses.dataclass
class Process:
    process_id: int
    is_stopped: bool = False
    name: str = ""


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def watch_for(seconds, watch, clock, processes, ending=None, report=False):
    """Return what the watch finds within some seconds, and after how many; looks each 0.5 s."""
    for step in range(int(seconds * 2)):
        clock.now += 0.5
        if report:
            watch.take_progress()
        found = watch.find(processes, ending)
        if found is not None:
            return found, (step + 1) / 2
    return None, seconds


def test_a_process_that_stays_stopped_is_named():
    clock = Clock()
    watch, processes = StandstillWatch(clock), [Process(1), Process(2)]
    processes[1].is_stopped = True
    found, after = watch_for(60.0, watch, clock, processes)
    assert found == (processes[1], f"has been stopped for {LARGEST_STOP:g} s")
    assert LARGEST_STOP < after < LARGEST_STOP + 3.0


def test_a_process_that_goes_on_in_time_is_not():
    clock = Clock()
    watch, processes = StandstillWatch(clock), [Process(1)]
    for _ in range(5):
        processes[0].is_stopped = True
        assert watch_for(LARGEST_STOP - 2.0, watch, clock, processes)[0] is None
        processes[0].is_stopped = False
        assert watch_for(2.0, watch, clock, processes)[0] is None


def test_a_run_without_progress_names_the_node_that_ends_it():
    clock = Clock()
    watch, ending = StandstillWatch(clock), Process(1)
    # Before the first report the nodes' own time-outs hold.
    assert watch_for(10 * LARGEST_SILENCE, watch, clock, [ending], ending)[0] is None
    assert watch_for(100.0, watch, clock, [ending], ending, report=True)[0] is None
    found, after = watch_for(100.0, watch, clock, [ending], ending)
    assert found == (ending, f"has reported no progress for {LARGEST_SILENCE:g} s")
    assert LARGEST_SILENCE < after < LARGEST_SILENCE + 3.0


def test_a_process_that_gave_signs_of_life_and_stops_is_named():
    clock = Clock()
    watch, processes = StandstillWatch(clock), [Process(1, name="a"), Process(2, name="b")]
    assert watch_for(60.0, watch, clock, processes)[0] is None  # it never gave one
    watch.take_sign_of_life("b", False)
    assert not watch.was_ready("b")
    watch.take_sign_of_life("b", True)
    assert watch.was_ready("b") and watch.silence("b") == 0.0 == watch.silence("a")
    found, after = watch_for(60.0, watch, clock, processes)
    assert found == (processes[1], f"has shown no sign of life for {LARGEST_LIFELESSNESS:g} s")
    assert LARGEST_LIFELESSNESS < after < LARGEST_LIFELESSNESS + 2.0


def test_a_stopped_process_is_not_lifeless():
    """What is stopped goes on later and takes what the nodes hold for it."""
    clock = Clock()
    watch, process = StandstillWatch(clock), Process(1, name="a")
    watch.take_sign_of_life("a", True)
    process.is_stopped = True
    assert watch_for(LARGEST_STOP - 2.0, watch, clock, [process])[0] is None
    assert watch.silence("a") <= 1.0
    found, _ = watch_for(30.0, watch, clock, [process])
    assert found == (process, f"has been stopped for {LARGEST_STOP:g} s")


def test_a_machine_that_stood_still_is_no_lifeless_process():
    clock = Clock()
    watch, process = StandstillWatch(clock), Process(1, name="a")
    watch.take_sign_of_life("a", True)
    assert watch_for(5.0, watch, clock, [process])[0] is None
    clock.now += 1000.0
    assert watch.find([process], None) is None

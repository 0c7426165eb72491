"""Second recorders: when they start, when they are ended again, and what is asked of them."""

from __future__ import annotations

import signal

import pytest

from vtff_bringup.children.second_recorder import SUSPICIOUS_SILENCE, RecorderGroup
from vtff_bringup.children.standstill import StandstillWatch
from vtff_bringup.system.description import NodeDescription


class Process:
    def __init__(self, name):
        self.name, self.exit_code, self.signals = name, None, []

    def signal_group(self, number):
        self.signals.append(number)
        self.exit_code = -number


class Recorders:
    """A recorder that a test lets live or hang, and those that were started after it."""

    def __init__(self, folder):
        self.now = 0.0
        self.watch = StandstillWatch(lambda: self.now)
        self.started: list[tuple[NodeDescription, Process]] = []
        self.group = RecorderGroup(self.watch, self.start)
        parameters = {
            "output": str(folder / "bag"),
            "wait_for_nodes": ["/bridge", "/recorder"],
            "acknowledge_steps": True,
        }
        self.group.add(
            NodeDescription(
                "vtff_bag", "bag_recorder", "recorder", "/", parameters, (), {}, "side_branch",
                prepares=False, ends_run=False, own_process=True,
            )
        )  # fmt: skip

    def start(self, node):
        process = Process(node.name)
        self.started.append((node, process))
        return process

    def wait(self, seconds, *alive):
        for _ in range(int(seconds)):
            self.now += 1.0
            for name in alive:
                self.watch.take_sign_of_life(name, True)
            self.group.look()

    def read_reports(self, patience, is_enough):
        while not is_enough() and patience > 0:
            self.now, patience = self.now + 1.0, patience - 1.0
            for _, process in self.started[1:]:
                self.watch.take_sign_of_life(process.name, True)


@pytest.fixture
def recorders(tmp_path):
    return Recorders(tmp_path)


def test_a_recorder_that_lives_stays_alone(recorders):
    recorders.wait(60, "recorder")
    recorders.group.replace_lost(recorders.read_reports)
    assert len(recorders.started) == 1 and recorders.group.complete_bags() == []


def test_one_that_was_never_ready_is_not_replaced(recorders):
    recorders.started[0][1].exit_code = 2
    recorders.wait(60)
    recorders.group.replace_lost(recorders.read_reports)
    assert len(recorders.started) == 1 and recorders.group.complete_bags() == []


def test_a_silent_one_gets_a_second_that_acknowledges_nothing(recorders, tmp_path):
    recorders.wait(2, "recorder")
    recorders.wait(SUSPICIOUS_SILENCE + 1)
    (_, first), (node, second) = recorders.started
    assert node.qualified_name == "/recorder_2" and first.signals == []
    assert node.parameters["output"] == str(tmp_path / "bag_2")
    assert node.parameters["wait_for_nodes"] == ["/bridge"]
    assert node.parameters["acknowledge_steps"] is False
    recorders.wait(3, "recorder_2")
    recorders.group.replace_lost(recorders.read_reports)
    assert first.signals == [signal.SIGKILL] and second.signals == []
    assert recorders.group.processes == [first, second] and recorders.group.first == [first]
    (line,) = recorders.group.complete_bags()
    assert line.startswith("what the nodes still held is in") and "bag_2: no such bag" in line


def test_a_second_one_is_ended_when_the_first_goes_on(recorders, tmp_path):
    for number in (2, 3):
        recorders.wait(2, "recorder")
        recorders.wait(SUSPICIOUS_SILENCE + 1)
        node, _ = recorders.started[-1]
        assert node.name == f"recorder_{number}"
        (tmp_path / f"bag_{number}").mkdir()
        recorders.wait(1, "recorder")
    assert [process.signals for _, process in recorders.started] == [
        [], [signal.SIGINT], [signal.SIGINT],
    ]  # fmt: skip
    recorders.group.replace_lost(recorders.read_reports)
    assert recorders.group.processes == [process for _, process in recorders.started]
    assert recorders.group.complete_bags() == [] and list(tmp_path.iterdir()) == []


def test_one_that_was_killed_is_replaced_at_the_end(recorders):
    recorders.wait(2, "recorder")
    recorders.started[0][1].exit_code = -9
    recorders.group.replace_lost(recorders.read_reports)
    assert [node.name for node, _ in recorders.started] == ["recorder", "recorder_2"]
    assert recorders.watch.was_ready("recorder_2")

"""A second recorder for one that was lost: it records what the nodes still hold.

Publishers hold their newest messages for readers that come late (`vtff_node.qos`), more than a
recorder may lag in lockstep, and almost a minute of real time. So nothing is lost with a recorder
that hangs or was killed, if another one listens before the nodes end.
"""

from __future__ import annotations

import dataclasses
import pathlib
import shutil
import signal
from collections.abc import Callable

from vtff_bag.file.completion import complete_bag
from vtff_bag.file.errors import BagError
from vtff_bringup.children.processes import ManagedProcess
from vtff_bringup.children.standstill import StandstillWatch
from vtff_bringup.system.description import NodeDescription

__all__ = ["RecorderGroup"]

#: Silence after which a second recorder is started, s. Most of the time until the first one is
#: given up, and until lockstep gives up the step that waits for it, is left for its start.
SUSPICIOUS_SILENCE = 4.0
SIGN_PATIENCE = 5.0  # s for a sign of life of a recorder that has given none for a while
#: s for a second recorder to hear all nodes, when the run ends: on a busy machine its start alone
#: takes 10 s, and what it has not heard until the nodes end is lost.
READY_PATIENCE = 60.0

#: Starts a node in a process of the stage of the recorders.
Start = Callable[[NodeDescription], ManagedProcess]
#: Reads what the nodes report until a condition holds, at most for some seconds.
ReadReports = Callable[[float, Callable[[], bool]], None]


@dataclasses.dataclass
class _Recorder:
    """A recorder of a run, and the second one that was started for it."""

    node: NodeDescription
    process: ManagedProcess
    second: ManagedProcess | None = None
    dropped: list[ManagedProcess] = dataclasses.field(default_factory=list)
    is_lost: bool = False

    @property
    def bag(self) -> pathlib.Path:
        return pathlib.Path(str(self.node.all_parameters()["output"]))

    @property
    def suffix(self) -> str:
        """What the name and the folder of the next second recorder end with."""
        return f"_{2 + len(self.dropped)}"

    @property
    def second_bag(self) -> pathlib.Path:
        return self.bag.with_name(self.bag.name + self.suffix)

    def second_node(self) -> NodeDescription:
        """Return the second recorder.

        It has a name of its own, so that the nodes state anew who hears them, and acknowledges no
        step: the flight does not go on without the first one.
        """
        given = self.node.all_parameters()
        others = [
            name for name in given.get("wait_for_nodes", []) if name != self.node.qualified_name
        ]
        own = {"output": str(self.second_bag), "acknowledge_steps": False, "wait_for_nodes": others}
        return dataclasses.replace(
            self.node,
            name=self.node.name + self.suffix,
            parameters={**given, **own},
            parameter_files=(),
        )


class RecorderGroup:
    """The recorders of a run, each with a second one while it gives no sign of life.

    Parameters
    ----------
    watch
        Has the signs of life of the processes.
    start
        Function that starts a node in a process.
    """

    def __init__(self, watch: StandstillWatch, start: Start) -> None:
        self._watch = watch
        self._start = start
        self._recorders: list[_Recorder] = []

    def add(self, node: NodeDescription) -> None:
        """Start a recorder."""
        self._recorders.append(_Recorder(node, self._start(node)))

    @property
    def first(self) -> list[ManagedProcess]:
        """The processes that have to live as long as the run."""
        return [recorder.process for recorder in self._recorders]

    @property
    def processes(self) -> list[ManagedProcess]:
        """All processes."""
        further = []
        for recorder in self._recorders:
            further += recorder.dropped
            further += [recorder.second] if recorder.second is not None else []
        return [*self.first, *further]

    def look(self) -> None:
        """Start a second recorder for one that gives no sign of life; end it if the first does."""
        for recorder in self._recorders:
            name = recorder.process.name
            if recorder.second is None:
                if self._watch.was_ready(name) and self._watch.silence(name) > SUSPICIOUS_SILENCE:
                    recorder.second = self._start(recorder.second_node())
            elif self._watch.silence(name) < SUSPICIOUS_SILENCE:
                _drop_second(recorder)

    def replace_lost(self, read_reports: ReadReports) -> None:
        """Have second recorders listen for those that were lost; to be called before nodes end."""
        for recorder in self._recorders:
            if not self._watch.was_ready(recorder.process.name):
                continue  # there is nothing yet that it could have lost
            if self._goes_on(recorder, read_reports):
                _drop_second(recorder)
            else:
                self._replace(recorder, read_reports)

    def _goes_on(self, recorder: _Recorder, read_reports: ReadReports) -> bool:
        process = recorder.process

        def shows_life() -> bool:
            return self._watch.silence(process.name) < SUSPICIOUS_SILENCE

        read_reports(SIGN_PATIENCE, lambda: process.exit_code is not None or shows_life())
        return process.exit_code is None and shows_life()

    def _replace(self, recorder: _Recorder, read_reports: ReadReports) -> None:
        recorder.is_lost = True
        recorder.process.signal_group(signal.SIGKILL)
        second = recorder.second or self._start(recorder.second_node())
        recorder.second = second
        read_reports(
            READY_PATIENCE,
            lambda: self._watch.was_ready(second.name) or second.exit_code is not None,
        )

    def complete_bags(self) -> list[str]:
        """Put into the bags what second recorders got, when all have ended; return lines on it."""
        for recorder in self._recorders:
            for suffix in range(2, 2 + len(recorder.dropped)):
                unused = recorder.bag.with_name(f"{recorder.bag.name}_{suffix}")
                shutil.rmtree(unused, ignore_errors=True)
        return [_complete(recorder) for recorder in self._recorders if recorder.is_lost]


def _drop_second(recorder: _Recorder) -> None:
    """End the second recorder; it is waited for at the end of the run."""
    if recorder.second is not None:
        recorder.second.signal_group(signal.SIGINT)
        recorder.dropped.append(recorder.second)
        recorder.second = None


def _complete(recorder: _Recorder) -> str:
    try:
        count = complete_bag(recorder.bag, recorder.second_bag)
    except BagError as error:
        return f"what the nodes still held is in {recorder.second_bag}, not in the bag: {error}"
    return f"a second recorder has taken the {count} messages that it missed from the nodes"

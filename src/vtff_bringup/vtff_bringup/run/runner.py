"""Run a system: start its processes, follow and end them, and check the recorded messages."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import os
import pathlib
import re
import selectors
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import FrameType
from typing import Any

from vtff_bringup.children.processes import FULL_DISK, ManagedProcess, end_together
from vtff_bringup.children.second_recorder import RecorderGroup
from vtff_bringup.children.standstill import StandstillWatch
from vtff_bringup.run.domain import DOMAIN_VARIABLE, add_dds_settings, reserve_domain
from vtff_bringup.run.errors import discard_output
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE
from vtff_bringup.run.host_session import HostSession, RunEnd
from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD
from vtff_bringup.system.description import NodeDescription, SystemDescription
from vtff_bringup.system.errors import SystemFileError
from vtff_node.executables import executable_path
from vtff_node.plain_yaml import format_yaml
from vtff_node.process.lifeline import LOG_FILE_VARIABLE, Lifelines, Stage
from vtff_node.process.run_environment import PROGRESS_VARIABLE, RUN_DIRECTORY_VARIABLE

POLL_INTERVAL = 0.05  # s
LOG_STAMP = re.compile(r"^\[\w+\] \[[\d.]+\] \[[^]]*\]: ")  # of a line that a node logs
NODE_RECORDS = "nodes"  # folder in which each node writes its message counts
ANOTHER_PUBLISHER = "(another run or program publishes on the same ROS_DOMAIN_ID)"


@dataclasses.dataclass(frozen=True)
class RunResult:
    """End of a run.

    Attributes
    ----------
    exit_code
        0 complete, 1 a process failed, 2 a process had wrong parameters or arguments, 130
        interrupted by the user.
    reason
        One line for the user; empty when complete.
    last_output
        Last lines of the process that failed, without those that `on_line` marked noteworthy.
    wall_time
        s from the start of the first process to the end of the last.
    progress
        Last progress report of the node that ends the run.
    full_disk
        First line of a process that tells of a full disk; empty if there was none.
    """

    exit_code: int
    reason: str
    last_output: tuple[str, ...]
    wall_time: float
    progress: dict[str, Any]
    full_disk: str = ""


@dataclasses.dataclass(frozen=True)
class _Failure:
    """A process that ended too early or with an error."""

    process: ManagedProcess
    what: str
    still_runs: bool = False  # it has not ended by itself

    @property
    def last_output(self) -> tuple[str, ...]:
        return tuple(self.process.tail())

    @property
    def exit_code(self) -> int:
        if self.still_runs:
            return EXIT_FAILURE
        return EXIT_USAGE if self.process.exit_code == EXIT_USAGE else EXIT_FAILURE

    @property
    def reason(self) -> str:
        if self.still_runs:
            return f"{self.process.name} {self.what}; log: {self.process.log_path}"
        code = self.process.exit_code
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        return f"{self.process.name} {self.what} ({how}); log: {self.process.log_path}"


class Runner:
    """Runs one system once.

    Parameters
    ----------
    system
        The resolved system file.
    run_directory
        Folder for bag, logs, counts and parameters; created.
    composed
        Whether all nodes that allow it run in one process and one executor.
    on_domain
        Function that is called with the ROS domain of the run before the first process starts.
    on_progress
        Function that is called with each progress report.
    on_line
        Function that is called with ``(process name, line, noteworthy)`` for each line that the
        processes print. After an interrupt by the user lines go to the logs only.
    session
        The run on the other hosts, if the system has several: only the entries of this host are
        started, and start and end are those of all.

    Raises
    ------
    SystemFileError
        If the system has several hosts and there is no session.
    """

    def __init__(
        self,
        system: SystemDescription,
        run_directory: pathlib.Path,
        *,
        composed: bool = False,
        on_domain: Callable[[int], None] | None = None,
        on_progress: Callable[[dict[str, Any]], None] | None = None,
        on_line: Callable[[str, str, bool], None] | None = None,
        session: HostSession | None = None,
    ) -> None:
        if system.hosts and session is None:
            raise SystemFileError(
                f"{system.path.name} runs on several hosts, "
                f"{', '.join(host.name for host in system.hosts)}: only `vtff run --host` can do so"
            )
        self._system = system
        self._session = session
        self._directory = run_directory
        self._composed = composed
        self._on_domain = on_domain
        self._on_progress = on_progress
        self._on_line = on_line
        self._interrupted = False
        self._full_disks: dict[str, str] = {}  # first line of each process that tells of it
        self._progress: dict[str, Any] = {}
        # The groups stand in the order in which they are ended.
        self._nodes: list[tuple[ManagedProcess, bool]] = []
        self._helpers: list[ManagedProcess] = []
        self._standstill = StandstillWatch()
        self._recorders = RecorderGroup(self._standstill, self._start_recorder)
        self._start_process: Callable[[str, Sequence[str], Stage], ManagedProcess] | None = None

    def run(self) -> RunResult:
        """Run to the end, to a failure or to Ctrl-C; every process is ended in any case.

        Raises
        ------
        DomainOccupiedError
            If another run is in the ROS domain; nothing has been started then.
        ExecutableNotFoundError
            If an executable of the system is not installed.
        OSError
            If the run folder cannot be written.
        """
        started = time.monotonic()
        failure: _Failure | RunEnd | None = None
        end = RunEnd(EXIT_FAILURE, "its part of the run could not start")
        stopped: list[str] = []
        completions: list[str] = []
        environment = _child_environment()
        with (
            self._handle_signals(),
            self._reserve_domain(environment) as domain,
            _open_pipe() as (progress_read, progress_write),
            contextlib.closing(Lifelines()) as lifelines,
        ):
            self._directory.mkdir(parents=True, exist_ok=True)
            if self._on_domain is not None:
                self._on_domain(domain)
            environment[DOMAIN_VARIABLE] = str(domain)
            environment[RUN_DIRECTORY_VARIABLE] = str(self._directory)
            environment[PROGRESS_VARIABLE] = str(progress_write)
            if self._session is not None:
                self._session.add_dds_settings(environment, self._directory)
            try:
                self._start(environment, progress_write, lifelines)
                failure = self._follow(progress_read)
                stopped = self._stopped_names(failure)
                end = self._describe_end(failure)
            finally:
                self._let_stopped_go_on()
                self._recorders.replace_lost(functools.partial(self._read_reports, progress_read))
                failures = self._end_all(end)
                completions = self._recorders.complete_bags()
                self._drain_progress(progress_read)
        wall_time = time.monotonic() - started
        failure = failure or (failures[0] if failures else None)
        full_disk = next(iter(self._full_disks.values()), "")
        exit_code, reason = 0, ""
        output: tuple[str, ...] = ()
        if self._interrupted:
            exit_code, reason = EXIT_INTERRUPTED, "interrupted"
        elif failure is not None:
            exit_code, reason = failure.exit_code, failure.reason
            if stopped:
                reason += f"; stopped: {', '.join(stopped)}"
            output = failure.last_output
        reason = "; ".join(filter(None, [reason, *completions]))
        return RunResult(exit_code, reason, output, wall_time, self._progress, full_disk)

    def _reserve_domain(
        self, environment: Mapping[str, str]
    ) -> contextlib.AbstractContextManager[int]:
        if self._session is not None:  # the hosts have agreed on one and hold it
            return contextlib.nullcontext(self._session.domain)
        return reserve_domain(environment, [node.qualified_name for node in self._system.nodes])

    def _runs_here(self, host: str) -> bool:
        return self._session is None or host == self._session.host

    def _describe_end(self, failure: _Failure | RunEnd | None) -> RunEnd:
        if self._interrupted:
            return RunEnd(EXIT_INTERRUPTED, "interrupted")
        if failure is None:
            return RunEnd(0, "")
        return RunEnd(failure.exit_code, failure.reason, failure.last_output)

    def _start(
        self, environment: dict[str, str], progress_descriptor: int, lifelines: Lifelines
    ) -> None:
        def start(
            name: str, command: Sequence[str], stage: Stage, shown_name: str = ""
        ) -> ManagedProcess:
            log_path = self._directory / "logs" / f"{name}.log"
            own = {**lifelines.environment(stage), LOG_FILE_VARIABLE: str(log_path)}
            return ManagedProcess(
                shown_name or name,
                command,
                log_path,
                {**environment, **own},
                (progress_descriptor,),
                self._pass_on,
            )

        self._start_process = start
        for process in self._system.processes:
            if not self._runs_here(process.host):
                continue
            path = executable_path(process.package, process.executable)
            command = [str(path), *process.arguments]
            self._helpers.append(start(process.name, command, Stage.HELPERS))
        composed = []
        composed_ends_run = False
        for node in self._system.nodes:
            if self._interrupted:
                return
            if node.own_process and self._runs_here(node.host):
                self._recorders.add(node)
                continue
            arguments = node.ros_arguments(self._write_parameters(node))
            if not self._runs_here(node.host):
                continue  # only its parameters belong to the description of the run
            if self._composed:
                composed_ends_run |= node.ends_run
                entry = {"package": node.package, "executable": node.executable}
                composed.append({**entry, "ros_arguments": arguments})
                continue
            command = [str(executable_path(node.package, node.executable)), *arguments]
            name = _process_name(node.qualified_name)
            self._nodes.append((start(name, command, Stage.NODES), node.ends_run))
        if composed:
            file = self._directory / "composed.json"
            file.write_text(json.dumps(composed, indent=1), encoding="utf-8")
            command = [sys.executable, "-m", "vtff_bringup.system.composed", str(file)]
            shown_name = f"composed ({len(composed)} nodes)"
            shared = start("composed", command, Stage.NODES, shown_name)
            self._nodes.append((shared, composed_ends_run))

    def _write_parameters(self, node: NodeDescription) -> pathlib.Path:
        path = self._directory / "parameters" / f"{_process_name(node.qualified_name)}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        # ROS cannot read the type of an empty list: it is left out, which means the default.
        values = {key: value for key, value in node.all_parameters().items() if value != []}
        content = {node.qualified_name: {"ros__parameters": values}}
        path.write_text(format_yaml(content), encoding="utf-8")
        return path

    def _pass_on(self, name: str, line: str, noteworthy: bool) -> None:
        if any(words in line for words in FULL_DISK):
            self._full_disks.setdefault(name, f"{name}: {LOG_STAMP.sub('', line)}")
        if self._on_line is not None and not self._interrupted:
            self._show(self._on_line, name, line, noteworthy)

    def _show(self, show: Callable[..., None], *shown: Any) -> None:
        """Call a function that prints; end the run when nothing takes its output any more."""
        try:
            show(*shown)
        except (OSError, SystemExit):  # rich turns a broken pipe into SystemExit
            self._interrupted = True
            discard_output((1, 2))

    def _follow(self, progress_read: int) -> _Failure | RunEnd | None:
        """Wait for the end of the run; return the failure that ended it, if there was one."""
        ending = next((process for process, ends_run in self._nodes if ends_run), None)
        with selectors.DefaultSelector() as selector:
            selector.register(progress_read, selectors.EVENT_READ)
            while not self._interrupted:
                if selector.select(POLL_INTERVAL):
                    self._read_progress(progress_read)
                if self._session is not None:
                    self._share_progress(self._session)
                    ended = self._session.poll()
                    if ended is not None:
                        return ended if ended.exit_code else None
                for process in [*self._helpers, *self._recorders.first]:
                    if process.exit_code is not None:
                        return _Failure(process, "ended before the run did")
                for process in self._recorders.first:
                    if process.name in self._full_disks:
                        return _Failure(process, "has no room on the disk", still_runs=True)
                for process, ends_run in self._nodes:
                    if process.exit_code is None:
                        continue
                    if process.exit_code != 0:
                        return _Failure(process, "failed")
                    if ends_run:
                        return None
                self._recorders.look()
                standing = self._standstill.find(self._all_processes(), ending)
                if standing is not None:
                    return _Failure(*standing, still_runs=True)
        return None

    def _all_processes(self) -> list[ManagedProcess]:
        nodes = [process for process, _ in self._nodes]
        return [*nodes, *self._recorders.processes, *self._helpers]

    def _share_progress(self, session: HostSession) -> None:
        """Give the progress of the run to the other hosts, or show what the main one reports."""
        if any(ends_run for _, ends_run in self._nodes):
            session.progress = self._progress
        elif session.progress != self._progress:
            self._progress = session.progress
            if self._on_progress is not None and not self._interrupted:
                self._show(self._on_progress, self._progress)

    def _stopped_names(self, failure: _Failure | RunEnd | None) -> list[str]:
        """Return the other processes that are stopped: what has failed may have waited for them."""
        return [
            process.name
            for process in self._all_processes()
            if isinstance(failure, _Failure)
            and process is not failure.process
            and process.is_stopped
        ]

    def _start_recorder(self, node: NodeDescription) -> ManagedProcess:
        assert self._start_process is not None  # `_start` sets it before it starts anything
        command = [
            str(executable_path(node.package, node.executable)),
            *node.ros_arguments(self._write_parameters(node)),
        ]
        return self._start_process(_process_name(node.qualified_name), command, Stage.RECORDERS)

    def _let_stopped_go_on(self) -> None:
        """Continue stopped processes: a recorder takes what nodes hold for it, before they end."""
        for process in self._all_processes():
            process.signal_group(signal.SIGCONT)

    def _read_reports(
        self, descriptor: int, patience: float, is_enough: Callable[[], bool]
    ) -> None:
        """Read what the nodes report until a condition holds, at most for some seconds."""
        deadline = time.monotonic() + patience
        with selectors.DefaultSelector() as selector:
            selector.register(descriptor, selectors.EVENT_READ)
            while not is_enough() and time.monotonic() < deadline:
                if selector.select(POLL_INTERVAL):
                    self._read_progress(descriptor)

    def _end_all(self, end: RunEnd) -> list[_Failure]:
        """End the nodes, then the recorders, which record their last messages, then the helpers.

        A stage ends on all hosts before the next one begins.
        """
        failures = []
        session = self._session
        nodes = [process for process, _ in self._nodes]
        groups = ((Stage.NODES, nodes), (Stage.RECORDERS, self._recorders.processes))
        for stage, processes in (*groups, (Stage.HELPERS, self._helpers)):
            if session is not None:
                session.begin_stage(stage, end)
                self._write_counts(session.counts)
            for process, code in zip(processes, end_together(processes), strict=True):
                if code not in (0, -signal.SIGINT):
                    failures.append(_Failure(process, "did not end in order"))
            if session is not None:
                session.complete_stage(stage, self._read_counts())
        if session is not None:
            self._share_progress(session)
        return failures

    def _read_counts(self) -> dict[str, str]:
        """Return the texts of the files in which the nodes have counted, by name."""
        texts = {}
        for path in sorted((self._directory / NODE_RECORDS).glob("*.json")):
            with contextlib.suppress(OSError):
                texts[path.name] = path.read_text(encoding="utf-8")
        return texts

    def _write_counts(self, counts: Mapping[str, str]) -> None:
        """Write what the nodes of other hosts have counted beside the files of this host."""
        folder = self._directory / NODE_RECORDS
        for name, text in counts.items():
            with contextlib.suppress(OSError):  # on a full disk the run has failed already
                folder.mkdir(exist_ok=True)
                if not (folder / name).exists():
                    (folder / name).write_text(text, encoding="utf-8")

    def _read_progress(self, descriptor: int) -> None:
        for line in os.read(descriptor, 65536).decode().splitlines():
            # A line may be cut at the end of the pipe's buffer; the next line replaces it.
            with contextlib.suppress(json.JSONDecodeError):
                report = json.loads(line)
                if "alive" in report:
                    name = _process_name(report["alive"])
                    self._standstill.take_sign_of_life(name, report["ready"])
                    continue
                self._standstill.take_progress()
                self._progress = report
                if self._on_progress is not None and not self._interrupted:
                    self._show(self._on_progress, self._progress)

    def _drain_progress(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        with contextlib.suppress(BlockingIOError):
            self._read_progress(descriptor)

    @contextlib.contextmanager
    def _handle_signals(self) -> Iterator[None]:
        terminals = [descriptor for descriptor in (1, 2) if os.isatty(descriptor)]

        def interrupt(number: int, frame: FrameType | None) -> None:
            self._interrupted = True
            if number == signal.SIGHUP:
                discard_output(terminals)

        numbers = [signal.SIGINT, signal.SIGTERM]
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # as under nohup
            numbers.append(signal.SIGHUP)
        previous = {number: signal.signal(number, interrupt) for number in numbers}
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)


def check_counts(run_directory: pathlib.Path, recorded: dict[str, int]) -> list[str]:
    """Compare the counts of messages that the nodes published with those in the bag.

    Parameters
    ----------
    run_directory
        Folder of the run with ``nodes/*.json``.
    recorded
        Number of messages in the bag by topic.

    Returns
    -------
    list of str
        One line for each topic whose counts differ, and for each file that a full disk has cut;
        empty when exactly the published messages were recorded.
    """
    published: dict[str, int] = {}
    lines = []
    for path in sorted((run_directory / NODE_RECORDS).glob("*.json")):
        try:
            counts = json.loads(path.read_text(encoding="utf-8"))["published"]
        except json.JSONDecodeError:
            lines.append(f"{NODE_RECORDS}/{path.name} was not written to its end")
            continue
        for topic, count in counts.items():
            published[topic] = published.get(topic, 0) + count
    for topic, count in sorted(published.items()):
        recorded_count = recorded.get(topic, 0)
        if count != recorded_count:
            line = f"{topic}: published {count}, recorded {recorded_count}"
            lines.append(f"{line} {ANOTHER_PUBLISHER}" if recorded_count > count else line)
    return lines


def _process_name(qualified_name: str) -> str:
    """Return the name of the process of a node: that of its log and of its parameter file."""
    return qualified_name.strip("/").replace("/", "__")


def _child_environment() -> dict[str, str]:
    """Return the environment of the children, without what is particular to one of them."""
    environment = {**ONE_BLAS_THREAD, **os.environ}
    environment.setdefault("PYTHONUNBUFFERED", "1")
    add_dds_settings(environment)
    return environment


@contextlib.contextmanager
def _open_pipe() -> Iterator[tuple[int, int]]:
    read, write = os.pipe()
    os.set_blocking(write, False)
    try:
        yield read, write
    finally:
        os.close(read)
        os.close(write)

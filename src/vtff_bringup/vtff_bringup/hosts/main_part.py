"""The main part of a run: it admits the others, leads start and end, and notices who is lost."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from vtff_bringup.hosts.channel import Channel
from vtff_bringup.hosts.clock_comparison import EXCHANGES, ClockComparison, compare_clocks
from vtff_bringup.hosts.identity import describe_difference
from vtff_bringup.hosts.part import (
    CONCLUSION_LIMIT,
    STAGE_LIMIT,
    WAITING_INTERVAL,
    HostPart,
    checked_counts,
    quote_host,
    recording_host,
)
from vtff_bringup.hosts.run_order import RunOrder
from vtff_bringup.hosts.silence import LARGEST_SILENCE, LOOK_INTERVAL, SilenceWatch
from vtff_bringup.run.domain import DOMAIN_VARIABLE, DomainOccupiedError, reserve_domain
from vtff_bringup.run.exit_codes import EXIT_FAILURE
from vtff_bringup.run.host_session import Conclusion, HostError, RunEnd
from vtff_bringup.system.description import HostDescription, SystemDescription
from vtff_node.process.lifeline import Stage

__all__ = ["PROTOCOL", "MainPart"]

PROTOCOL = "vtff hosts 1"
ANSWER_LIMIT = 30.0  # s that another part may take for an answer; it loads the system meanwhile
LARGEST_DATAGRAM = 4096
MOST_CONNECTIONS = 32
MOST_PROPOSALS = 50


@dataclasses.dataclass
class _Member:
    """Another part that was admitted."""

    host: HostDescription
    channel: Channel
    token: str
    watch: SilenceWatch
    clock: ClockComparison | None = None
    answer: dict[str, Any] | None = None
    failure: RunEnd | None = None
    gone: bool = False
    lost: bool = False
    ended: set[str] = dataclasses.field(default_factory=set)

    @property
    def is_there(self) -> bool:
        return not (self.gone or self.lost)


class MainPart(HostPart):
    """The part on the main host; its control port is open from the beginning to `close`.

    Parameters
    ----------
    description
        The system, with `hosts`.
    order
        What the run was told; the other parts get it.
    version, digests
        What the other parts must have in common with this one.
    load
        Returns the system with other free ports.
    say
        Takes lines for the user, from any thread.

    Raises
    ------
    HostError
        If the control port cannot be opened.
    """

    def __init__(
        self,
        description: SystemDescription,
        order: RunOrder,
        version: str,
        digests: Mapping[str, str],
        load: Callable[[dict[str, int]], SystemDescription],
        say: Callable[[str], None],
    ) -> None:
        super().__init__()
        self.description = description
        self.host = description.hosts[0].name
        self.say = say
        self._order = order
        self._version = version
        self._digests = dict(digests)
        self._load = load
        self._hosts = {host.name: host for host in description.hosts[1:]}
        self._members: dict[str, _Member] = {}
        self._changed = threading.Condition()
        self._counts: dict[str, str] = {}
        self._conclusion: Conclusion | None = None
        self._started = False
        self._closed = False
        self._domain_reserved = contextlib.ExitStack()
        own = description.hosts[0]
        address = (own.address, description.control_port)
        try:
            self._listener = socket.create_server(address, backlog=8)
        except OSError as error:
            raise HostError(
                f"host {quote_host(own)} cannot listen on TCP port {address[1]}: "
                f"{error.strerror}; does its part run already?"
            ) from error
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._datagrams.bind(address)
        except OSError as error:
            self._listener.close()
            self._datagrams.close()
            raise HostError(
                f"host {quote_host(own)} cannot listen on UDP port {address[1]}: {error.strerror}"
            ) from error
        self._datagrams.settimeout(LOOK_INTERVAL)
        self._connections = threading.Semaphore(MOST_CONNECTIONS)
        for work in (self._accept, self._serve_datagrams):
            threading.Thread(target=work, daemon=True).start()

    # ---- before the run ----------------------------------------------------------------------

    def gather(self) -> None:
        """Wait for all other parts, agree with them on domain and ports, and start the run.

        Raises
        ------
        HostError
            If no domain or no ports are free on all hosts.
        DomainOccupiedError
            If every domain, or the one of ``ROS_DOMAIN_ID``, is occupied on this host.
        """
        while True:
            self._wait_for_all()
            if self._agree():
                break
        for member in self._members.values():
            if member.clock is not None:
                self.clock_offsets[member.host.name] = member.clock.offset
        self._started = True
        self._tell_all({"start": True})

    def _wait_for_all(self) -> None:
        said = -float("inf")
        while True:
            with self._changed:
                for name, member in list(self._members.items()):
                    if not member.is_there:
                        del self._members[name]
                        member.channel.close()
                        self.say(f"host {quote_host(member.host)} has left")
                missing = [host for name, host in self._hosts.items() if name not in self._members]
                if not missing:
                    return
                if time.monotonic() - said >= WAITING_INTERVAL:
                    said = time.monotonic()
                    for host in missing:
                        self.say(
                            f"waiting for host {quote_host(host)}; start there: "
                            f"vtff run {self.description.name} --host {host.name}"
                        )
                self._changed.wait(0.5)

    def _agree(self) -> bool:
        """Propose domains and ports until all hosts accept; return whether all are still there."""
        chosen = {name: os.environ.get(name, "") for name in (DOMAIN_VARIABLE,)}
        nodes = [node.qualified_name for node in self.description.nodes]
        with contextlib.ExitStack() as refused:
            for _ in range(MOST_PROPOSALS):
                reserved = refused.enter_context(contextlib.ExitStack())
                self.domain = reserved.enter_context(reserve_domain(chosen, nodes))
                answers = self._propose()
                if answers is None:
                    return False
                occupied = [
                    f"host {quote_host(member.host)}: {problem}"
                    for member, answer in answers
                    if (problem := answer.get("occupied"))
                ]
                if not occupied:
                    self._domain_reserved.push(reserved.pop_all())
                    return True
                if chosen[DOMAIN_VARIABLE]:
                    raise DomainOccupiedError(occupied[0])
                self.description = self._load({})
        raise HostError(f"no domain and ports that are free on all hosts: {occupied[0]}")

    def _propose(self) -> list[tuple[_Member, dict[str, Any]]] | None:
        """Return the answer of each other part; None if one is gone."""
        with self._changed:
            members = list(self._members.values())
            for member in members:
                member.answer = None
        proposal = {"domain": self.domain, "free_ports": self.description.free_ports}
        self._tell_all({"propose": proposal})
        deadline = time.monotonic() + ANSWER_LIMIT
        with self._changed:
            while any(member.answer is None for member in members):
                if not all(member.is_there for member in members):
                    return None
                if time.monotonic() > deadline:
                    silent = [quote_host(m.host) for m in members if m.answer is None]
                    raise HostError(f"host {', '.join(silent)} does not answer")
                self._changed.wait(0.25)
            return [(member, member.answer or {}) for member in members]

    # ---- connections -------------------------------------------------------------------------

    def _accept(self) -> None:
        while not self._closed:
            try:
                connection, address = self._listener.accept()
            except OSError:
                return
            if not self._connections.acquire(blocking=False):
                connection.close()
                continue
            arguments = (Channel(connection), str(address[0]))
            threading.Thread(target=self._serve, args=arguments, daemon=True).start()

    def _serve(self, channel: Channel, address: str) -> None:
        try:
            member = self._admit(channel, address)
            if member is not None:
                self._receive_from(member)
        except HostError:
            pass  # what connected said nothing that a part of vtff says
        finally:
            channel.close()
            self._connections.release()

    def _admit(self, channel: Channel, address: str) -> _Member | None:
        """Take a part in, or refuse it with one line on both sides."""
        hello = channel.receive(ANSWER_LIMIT)
        name = str(hello.get("host", ""))[:80]
        problem = self._find_problem(hello, name, address)
        if not problem:
            channel.send(
                {"order": self._order.as_message(), "free_ports": self.description.free_ports}
            )
            problem = self._find_difference(channel.receive(ANSWER_LIMIT))
        if problem:
            self._refuse(channel, name, address, problem)
            return None
        clock = self._compare_clock(channel)
        member = self._make_member(self._hosts[name], channel, clock)
        with self._changed:
            if name in self._members or self._started:
                problem = self._why_taken(name)
            else:
                self._members[name] = member
        if problem:
            self._refuse(channel, name, address, problem)
            return None
        channel.send({"welcome": member.token, "clock_offset": -clock.offset,
                      "clock_uncertainty": clock.uncertainty})  # fmt: skip
        self.say(f"host {quote_host(member.host)} takes part; {clock.describe(name)}")
        if self._order.pacing == "realtime" and not clock.is_tolerated:
            self.say(f"[WARN] the clocks differ: {clock.describe(name)}; see docs/hosts.md")
        with self._changed:
            self._changed.notify_all()
        return member

    def _make_member(
        self, host: HostDescription, channel: Channel, clock: ClockComparison
    ) -> _Member:
        watch = SilenceWatch(quote_host(host), lambda line: self.say(line))
        return _Member(host, channel, secrets.token_hex(8), watch, clock)

    def _find_problem(self, hello: Mapping[str, Any], name: str, address: str) -> str:
        if hello.get("protocol") != PROTOCOL:
            return f"it speaks '{str(hello.get('protocol'))[:40]}', this host '{PROTOCOL}'"
        if hello.get("version") != self._version:
            return (
                f"it has vtff {str(hello.get('version'))[:80]}, the main host {self._version}: "
                "install the same on all hosts"
            )
        if hello.get("system") != self.description.name:
            return (
                f"it runs the system '{str(hello.get('system'))[:80]}', the main host "
                f"'{self.description.name}'"
            )
        if name not in self._hosts:
            return f"'{name}' is no other host of this run; there are: {', '.join(self._hosts)}"
        if address != self._hosts[name].address:
            return f"the system file gives it the address {self._hosts[name].address}"
        with self._changed:
            if name in self._members or self._started:
                return self._why_taken(name)
        return self._order.find_conflict(RunOrder.from_message(hello.get("given")))

    def _why_taken(self, name: str) -> str:
        if name in self._members and self._members[name].is_there:
            return f"host '{name}' takes part already"
        return "the run is under way"

    def _find_difference(self, answer: Mapping[str, Any]) -> str:
        if "failed" in answer:
            return str(answer["failed"])
        digests = answer.get("digests")
        if not isinstance(digests, dict):
            return "it does not tell its system file"
        difference = describe_difference(self._digests, digests)
        return f"its system file differs: {difference}" if difference else ""

    def _refuse(self, channel: Channel, name: str, address: str, problem: str) -> None:
        self.say(f"refused host '{name}' ({address}): {problem}")
        channel.send({"refused": problem})

    def _compare_clock(self, channel: Channel) -> ClockComparison:
        exchanges = []
        for _ in range(EXCHANGES):
            left = time.time()
            channel.send({"time": left})
            answer = channel.receive(ANSWER_LIMIT)
            back = time.time()
            there = answer.get("time")
            if not isinstance(there, (int, float)):
                raise HostError("no time in the answer")
            exchanges.append((left, float(there), back))
        return compare_clocks(exchanges)

    def _receive_from(self, member: _Member) -> None:
        try:
            while not self._closed:
                self._take(member, member.channel.receive())
        except HostError:
            with self._changed:
                member.gone = True
                self._changed.notify_all()

    def _take(self, member: _Member, message: Mapping[str, Any]) -> None:
        with self._changed:
            if "answer" in message and isinstance(message["answer"], dict):
                member.answer = message["answer"]
            if "failed" in message:
                member.failure = RunEnd.from_message(message["failed"])
            if "ended" in message:
                member.ended.add(str(message["ended"]))
                counts = message.get("counts")
                if isinstance(counts, dict):
                    self._counts.update(checked_counts(counts))
            if "concluded" in message:
                self._conclusion = Conclusion.from_message(message["concluded"])
            self._changed.notify_all()

    def _serve_datagrams(self) -> None:
        """Answer signs of life with one, and look who is silent."""
        while not self._closed:
            for member in list(self._members.values()):
                if not member.gone and not member.lost and member.watch.is_lost():
                    with self._changed:
                        member.lost = True
                        self._changed.notify_all()
            try:
                content, address = self._datagrams.recvfrom(LARGEST_DATAGRAM)
            except (TimeoutError, ConnectionError):
                continue
            except OSError:
                return
            token = content.decode("ascii", "replace")
            for member in list(self._members.values()):
                if member.token == token and address[0] == member.host.address:
                    member.watch.note_heard()
                    reply = json.dumps({"progress": self.progress}).encode()
                    with contextlib.suppress(OSError):
                        self._datagrams.sendto(reply[:LARGEST_DATAGRAM], address)

    def _tell_all(self, message: dict[str, Any]) -> None:
        for member in list(self._members.values()):
            if member.is_there:
                with contextlib.suppress(HostError):
                    member.channel.send(message)

    # ---- the run and its end -----------------------------------------------------------------

    def poll(self) -> RunEnd | None:
        """Return why the run ends, if a host has ended it, is gone, or is silent for too long."""
        with self._changed:
            for member in self._members.values():
                name = quote_host(member.host)
                if member.failure is not None:
                    failure = member.failure
                    return dataclasses.replace(failure, reason=f"host {name}: {failure.reason}")
                if member.gone:
                    return RunEnd(EXIT_FAILURE, f"host {name} is lost: its part of the run is gone")
                if member.lost:
                    return RunEnd(
                        EXIT_FAILURE,
                        f"host {name} is lost: not heard for {LARGEST_SILENCE:g} s",
                    )
        return None

    def begin_stage(self, stage: Stage, end: RunEnd) -> None:
        """Let all hosts end the processes of a stage."""
        message: dict[str, Any] = {"begin": stage.name, "progress": self.progress}
        if stage is Stage.NODES:
            message["end"] = dataclasses.asdict(end)
        elif stage is Stage.RECORDERS:
            message["counts"] = self._counts
        self._tell_all(message)

    def complete_stage(self, stage: Stage, counts: dict[str, str]) -> None:
        """Wait until the stage has ended on all hosts that are there."""
        deadline = time.monotonic() + STAGE_LIMIT
        with self._changed:
            while time.monotonic() < deadline and any(
                member.is_there and stage.name not in member.ended
                for member in self._members.values()
            ):
                self._changed.wait(0.25)
            self._counts.update(counts)

    @property
    def counts(self) -> dict[str, str]:
        """Message counts of the nodes of the other hosts, by file name."""
        return dict(self._counts)

    def conclude(self, own: Conclusion | None) -> Conclusion | None:
        """Share the conclusion of this host, or wait for that of the host that records."""
        recorder = self._members.get(recording_host(self.description))
        if own is None and recorder is not None:
            deadline = time.monotonic() + CONCLUSION_LIMIT
            with self._changed:
                while self._conclusion is None and recorder.is_there:
                    if time.monotonic() > deadline:
                        break
                    self._changed.wait(0.25)
        conclusion = own or self._conclusion
        if conclusion is not None:
            self._tell_all({"concluded": dataclasses.asdict(conclusion)})
        return conclusion

    def close(self) -> None:
        """Close the control port and all connections."""
        self._closed = True
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._datagrams.close()
        for member in list(self._members.values()):
            member.channel.close()
        self._domain_reserved.close()

"""Any other part of a run: it finds the main part, takes its order, and follows it."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from vtff_bringup.hosts.channel import Channel
from vtff_bringup.hosts.clock_comparison import ClockComparison
from vtff_bringup.hosts.main_part import ANSWER_LIMIT, LARGEST_DATAGRAM, PROTOCOL
from vtff_bringup.hosts.part import (
    CONCLUSION_LIMIT,
    STAGE_LIMIT,
    WAITING_INTERVAL,
    HostPart,
    checked_counts,
    quote_host,
)
from vtff_bringup.hosts.run_order import RunOrder
from vtff_bringup.hosts.silence import (
    HEARTBEAT_INTERVAL,
    LARGEST_SILENCE,
    LOOK_INTERVAL,
    SilenceWatch,
)
from vtff_bringup.run.domain import DOMAIN_VARIABLE, DomainOccupiedError, reserve_domain
from vtff_bringup.run.exit_codes import EXIT_FAILURE
from vtff_bringup.run.host_session import Conclusion, HostError, RunEnd
from vtff_bringup.system.description import SystemDescription
from vtff_bringup.system.errors import SystemFileError
from vtff_node.process.lifeline import Stage

__all__ = ["JoiningPart"]

CONNECT_LIMIT = 2.0  # s for one attempt to reach the main host
ATTEMPT_INTERVAL = 0.5  # s between attempts

Load = Callable[[RunOrder, dict[str, int]], tuple[SystemDescription, dict[str, str]]]


class _LeftError(Exception):
    """The main part has gone before the run has begun."""


class JoiningPart(HostPart):
    """The part on a host that is not the main one.

    Parameters
    ----------
    description
        The system as this host has loaded it by itself, for the addresses.
    host
        Name of this host.
    given
        What this part was told; it must not differ from what the main part was told.
    version
        Version of vtff on this host.
    load
        Returns the system for an order and free ports, and its digests.
    say
        Takes lines for the user, from any thread.
    """

    def __init__(
        self,
        description: SystemDescription,
        host: str,
        given: RunOrder,
        version: str,
        load: Load,
        say: Callable[[str], None],
    ) -> None:
        super().__init__()
        self.description = description
        self.host = host
        self.order = given
        self.say = say
        self._given = given
        self._version = version
        self._load = load
        self._main = description.hosts[0]
        self._own = next(entry for entry in description.hosts if entry.name == host)
        self._control = (self._main.address, description.control_port)
        self._channel: Channel | None = None
        self._token = ""
        self._watch = SilenceWatch(quote_host(self._main), lambda line: self.say(line))
        self._changed = threading.Condition()
        self._end: RunEnd | None = None
        self._gone = False
        self._lost = False
        self._closed = False
        self._begun: set[str] = set()
        self._counts: dict[str, str] = {}
        self._conclusion: Conclusion | None = None
        self._domain_reserved = contextlib.ExitStack()
        # In the namespace of this host's address: a part on another machine is told so at once.
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._datagrams.bind((self._own.address, 0))
        except OSError as error:
            self._datagrams.close()
            raise HostError(
                f"host {quote_host(self._own)}: {error.strerror}; no interface of this machine "
                "has that address"
            ) from error
        self._datagrams.settimeout(HEARTBEAT_INTERVAL)

    # ---- before the run ----------------------------------------------------------------------

    def join(self) -> None:
        """Wait for the main part, take its order, and return when the run starts.

        Raises
        ------
        HostError
            If the main part refuses this one.
        """
        while True:
            channel = self._connect()
            try:
                self._introduce(channel)
                self._await_start(channel)
            except _LeftError:
                self._domain_reserved.close()
                channel.close()
                if self._closed:
                    raise HostError("this part has left") from None
                self.say(f"host {quote_host(self._main)} has left")
                continue
            except BaseException:
                channel.close()
                raise
            threading.Thread(target=self._receive, args=(channel,), daemon=True).start()
            return

    def _connect(self) -> Channel:
        said = -float("inf")
        while True:
            try:
                return Channel(
                    socket.create_connection(
                        self._control, CONNECT_LIMIT, source_address=(self._own.address, 0)
                    )
                )
            except OSError as error:
                if time.monotonic() - said >= WAITING_INTERVAL:
                    said = time.monotonic()
                    self.say(
                        f"waiting for host {quote_host(self._main)}, port {self._control[1]} "
                        f"({error.strerror or error}); start there: vtff run "
                        f"{self.description.name} --host {self._main.name}"
                    )
            time.sleep(ATTEMPT_INTERVAL)

    def _introduce(self, channel: Channel) -> None:
        """Tell who this is, load the system as ordered, and let the clocks be compared."""
        self._send_to(
            channel,
            {
                "protocol": PROTOCOL,
                "host": self.host,
                "system": self.description.name,
                "version": self._version,
                "given": self._given.as_message(),
            },
        )
        message = self._receive_from(channel, ANSWER_LIMIT)
        self.order = RunOrder.from_message(message.get("order"))
        try:
            ports = _checked_ports(message.get("free_ports"))
            self.description, digests = self._load(self.order, ports)
        except SystemFileError as error:
            self._send_to(channel, {"failed": str(error)})
        else:
            self._send_to(channel, {"digests": digests})
        while "welcome" not in (message := self._receive_from(channel, ANSWER_LIMIT)):
            if "time" in message:
                self._send_to(channel, {"time": time.time()})
        self._token = str(message["welcome"])
        clock = ClockComparison(
            float(message.get("clock_offset", 0.0)), float(message.get("clock_uncertainty", 0.0))
        )
        self.clock_offsets[self._main.name] = clock.offset
        self.say(f"takes part with host {quote_host(self._main)}; {clock.describe('main host')}")
        if self.order.pacing == "realtime" and not clock.is_tolerated:
            self.say("[WARN] the clocks differ; see docs/hosts.md")

    def _await_start(self, channel: Channel) -> None:
        """Answer proposals until the run starts."""
        self._channel = channel
        self._watch = SilenceWatch(quote_host(self._main), lambda line: self.say(line))
        beating = threading.Event()
        threading.Thread(target=self._beat, args=(self._token, beating), daemon=True).start()
        said = time.monotonic()
        try:
            while True:
                if time.monotonic() - said >= WAITING_INTERVAL:
                    said = time.monotonic()
                    self.say("waiting for the other hosts")
                if self._lost:
                    raise _LeftError
                message = self._receive_from(channel, 1.0, waits=True)
                if "propose" in message:
                    self._send_to(channel, {"answer": self._consider(message["propose"])})
                if "start" in message:
                    return
        except BaseException:
            beating.set()
            raise

    def _consider(self, proposal: Any) -> dict[str, Any]:
        """Return whether the proposed domain and ports are free on this host."""
        self._domain_reserved.close()
        try:
            domain = int(proposal["domain"])
            ports = _checked_ports(proposal["free_ports"])
            for port in ports.values():
                with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
                    probe.bind((self._own.address, port))
            nodes = [node.qualified_name for node in self.description.nodes]
            reserved = reserve_domain({DOMAIN_VARIABLE: str(domain)}, nodes)
            self.domain = self._domain_reserved.enter_context(reserved)
            self.description, _ = self._load(self.order, ports)
        except DomainOccupiedError as error:
            return {"occupied": str(error)}
        except OSError as error:
            return {"occupied": f"TCP port {port}: {error.strerror}"}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise HostError(f"what came is no proposal: {error}") from error
        return {"accepted": True}

    def _send_to(self, channel: Channel, message: dict[str, Any]) -> None:
        try:
            channel.send(message)
        except HostError as error:
            raise _LeftError from error

    def _receive_from(
        self, channel: Channel, timeout: float, *, waits: bool = False
    ) -> dict[str, Any]:
        """Return the next message; with `waits` an empty one if none comes in time.

        Raises
        ------
        HostError
            If the message refuses this part.
        """
        if waits and not channel.wait(timeout):
            return {}
        try:
            message = channel.receive(timeout)
        except HostError as error:
            raise _LeftError from error
        if "refused" in message:
            raise HostError(
                f"host {quote_host(self._main)} refuses this part: {message['refused']}"
            )
        return message

    # ---- signs of life and messages ----------------------------------------------------------

    def _beat(self, token: str, ended: threading.Event) -> None:
        """Send a sign of life each second and take the answers."""
        next_beat = 0.0
        while not (self._closed or ended.is_set()):
            now = time.monotonic()
            if now >= next_beat:
                next_beat = now + HEARTBEAT_INTERVAL
                with contextlib.suppress(OSError):
                    self._datagrams.sendto(token.encode(), self._control)
            if not self._gone and self._watch.is_lost():
                with self._changed:
                    self._lost = True
                    self._changed.notify_all()
            try:
                remaining = next_beat - time.monotonic()
                self._datagrams.settimeout(min(max(0.01, remaining), LOOK_INTERVAL))
                content, address = self._datagrams.recvfrom(LARGEST_DATAGRAM)
            except TimeoutError:
                continue
            except OSError:
                if self._closed:
                    return
                time.sleep(0.1)  # the network is not reachable
                continue
            if address != self._control:
                continue
            self._watch.note_heard()
            with contextlib.suppress(ValueError, AttributeError):
                self._note_progress(json.loads(content).get("progress"))

    def _note_progress(self, progress: Any) -> None:
        if isinstance(progress, dict) and progress:
            self.progress = progress

    def _receive(self, channel: Channel) -> None:
        try:
            while not self._closed:
                self._take(channel.receive())
        except HostError:
            with self._changed:
                self._gone = True
                self._changed.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        with self._changed:
            self._note_progress(message.get("progress"))
            if "begin" in message:
                if "end" in message:
                    self._end = RunEnd.from_message(message["end"])
                counts = message.get("counts")
                if isinstance(counts, dict):
                    self._counts.update(checked_counts(counts))
                self._begun.add(str(message["begin"]))
            if "concluded" in message:
                self._conclusion = Conclusion.from_message(message["concluded"])
            self._changed.notify_all()

    def _tell(self, message: dict[str, Any]) -> None:
        if self._channel is not None:
            with contextlib.suppress(HostError):
                self._channel.send(message)

    # ---- the run and its end -----------------------------------------------------------------

    def poll(self) -> RunEnd | None:
        """Return why the run ends, if the main host has ended it, is gone or silent too long."""
        with self._changed:
            name = quote_host(self._main)
            if self._end is not None:
                reason = self._end.reason
                return dataclasses.replace(
                    self._end, reason=f"host {name}: {reason}" if reason else "", last_output=()
                )
            if self._gone:
                return RunEnd(EXIT_FAILURE, f"host {name} is lost: its part of the run is gone")
            if self._lost:
                return RunEnd(
                    EXIT_FAILURE, f"host {name} is lost: not heard for {LARGEST_SILENCE:g} s"
                )
        return None

    def begin_stage(self, stage: Stage, end: RunEnd) -> None:
        """Tell the main host why the run ends, or wait until it lets the next stage begin."""
        if stage is Stage.NODES:
            if self._end is None:
                self._tell({"failed": dataclasses.asdict(end)})
            return
        self._wait(lambda: stage.name in self._begun, STAGE_LIMIT)

    def complete_stage(self, stage: Stage, counts: dict[str, str]) -> None:
        """Tell the main host that a stage has ended here."""
        self._tell({"ended": stage.name, "counts": counts})

    @property
    def counts(self) -> dict[str, str]:
        """Message counts of the nodes of the other hosts, by file name."""
        return dict(self._counts)

    def conclude(self, own: Conclusion | None) -> Conclusion | None:
        """Tell the conclusion of this host, or wait for that of the host that records."""
        if own is not None:
            self._tell({"concluded": dataclasses.asdict(own)})
            return own
        self._wait(lambda: self._conclusion is not None, CONCLUSION_LIMIT)
        return self._conclusion

    def _wait(self, is_done: Callable[[], bool], limit: float) -> None:
        deadline = time.monotonic() + limit
        with self._changed:
            while not (is_done() or self._gone or self._lost) and time.monotonic() < deadline:
                self._changed.wait(0.25)

    def close(self) -> None:
        """Leave the run."""
        self._closed = True
        if self._channel is not None:
            self._channel.close()
        self._datagrams.close()
        self._domain_reserved.close()


def _checked_ports(content: Any) -> dict[str, int]:
    """Return free ports of a message.

    Raises
    ------
    HostError
        If the message has not the form of ports.
    """
    try:
        return {str(name): int(port) for name, port in content.items()}
    except (AttributeError, TypeError, ValueError) as error:
        raise HostError("what came are no ports") from error

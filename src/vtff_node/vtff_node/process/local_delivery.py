"""Messages between the nodes of one process, without the middleware.

A message within a process takes the middleware longer than what most nodes do with it. Here its
bytes are handed on: each node makes a message of its own of them, as of those that come from other
processes. What other processes publish and hear goes the usual way. The middleware must not bring
the messages of its own process as well (`vtff_bringup.system.composed` tells it so).

Messages are delivered after the callback that published them, in their order, so that no callback
runs within another. In lockstep the middleware gets them at the end of a turn, one after the other:
each message alone would wake its readers in other processes. No ROS.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any

__all__ = ["LocalDelivery"]

#: Takes the bytes of a message.
Receiver = Callable[[bytes], object]

#: Wall time after which other callbacks have their turn, s; timers and signals among them. Only
#: messages that bring about each other without end last as long, as in a software loop in lockstep,
#: where a turn of the executor takes as long as a sixth of a step.
LONGEST_TURN = 5e-3


class LocalDelivery:
    """Hands the bytes of messages to the receivers within a process.

    Attributes
    ----------
    call_soon : callable or None
        Has a function called by the thread that runs callbacks; may be called by any thread. As
        long as it is None messages wait.
    gathers : bool
        Whether what callbacks publish goes to the middleware at the end of a turn: for lockstep, in
        which other processes either lag behind or are waited for, and then the turn ends.
    """

    def __init__(self) -> None:
        self._receivers: dict[Hashable, list[Receiver]] = {}
        self._waiting: deque[tuple[list[Receiver], bytes]] = deque()
        self._outgoing: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._is_delivering = False
        self._is_called = False
        self._is_closed = False
        self.call_soon: Callable[[Callable[[], None]], object] | None = None
        self.gathers = False
        self._deliver_called = self.delivering_after(self._note_call)

    def receivers_of(self, topic: Hashable) -> list[Receiver]:
        """Return the receivers of a topic: a list that changes with them.

        Parameters
        ----------
        topic
            Its name and the type of its messages.
        """
        return self._receivers.setdefault(topic, [])

    def add_receiver(
        self, topic: Hashable, receiver: Receiver, *, with_history: bool
    ) -> Callable[[], None]:
        """Have the messages of a topic delivered to a receiver; return what ends that.

        Parameters
        ----------
        topic, receiver
            Topic as for `receivers_of`.
        with_history
            Also those that wait already: before the first callback these are all.
        """
        receivers = self.receivers_of(topic)
        if not with_history:
            sent_before = sum(each is receivers for each, _ in tuple(self._waiting))
            receiver = _skipping(sent_before, receiver) if sent_before else receiver
        receivers.append(receiver)
        return lambda: receivers.remove(receiver)

    def has_use_for(self, receivers: list[Receiver]) -> bool:
        """Return whether a message to these receivers would be delivered, now or later."""
        return not self._is_closed and bool(receivers or self.call_soon is None)

    def send(self, receivers: list[Receiver], content: bytes) -> None:
        """Deliver a message to the receivers that there are then.

        Parameters
        ----------
        receivers
            As from `receivers_of`.
        content
            The message.
        """
        if not self.has_use_for(receivers):
            return
        self._waiting.append((receivers, content))
        # After it was added: a delivery that ends just now looks once more.
        if not self._is_delivering:
            self.deliver_soon()

    def publish(self, publish_now: Callable[[bytes], None], content: bytes) -> None:
        """Have a message published by the middleware, now or at the end of this turn.

        Parameters
        ----------
        publish_now
            Publishes it.
        content
            The message.
        """
        if not (self.gathers and self._is_delivering):
            publish_now(content)
            return
        self._outgoing.append((publish_now, content))
        # After it was added: a turn that ends just now looks once more.
        if not self._is_delivering:
            self.publish_gathered()

    def publish_gathered(self) -> None:
        """Have the middleware publish what waits for the end of this turn."""
        outgoing = self._outgoing
        while outgoing:
            publish_now, content = outgoing.popleft()
            publish_now(content)

    def close(self) -> None:
        """Deliver nothing more: a node has ended the process."""
        self._is_closed = True
        self._waiting.clear()

    def deliver_soon(self) -> None:
        """Have what waits delivered by the thread that runs callbacks."""
        if self._waiting and not self._is_called and self.call_soon is not None:
            self._is_called = True
            self.call_soon(self._deliver_called)

    def delivering_after(self, callback: Callable[..., Any]) -> Callable[..., None]:
        """Return a callback after which its messages are delivered, sooner than by `call_soon`."""

        def call(*arguments: Any) -> None:
            if self._is_delivering:  # called by another callback
                callback(*arguments)
                return
            self._is_delivering = True
            try:
                callback(*arguments)
                self._deliver()
            finally:
                self._is_delivering = False
                try:
                    self.publish_gathered()
                finally:
                    self.deliver_soon()

        return call

    def _note_call(self) -> None:
        self._is_called = False

    def _deliver(self) -> None:
        """Deliver what waits, and what comes of it, for a time."""
        waiting = self._waiting
        if not waiting:
            return
        until = time.perf_counter() + LONGEST_TURN
        while waiting:
            receivers, content = waiting.popleft()
            for receiver in tuple(receivers):
                receiver(content)
            if time.perf_counter() > until:
                return


def _skipping(count: int, receiver: Receiver) -> Receiver:
    """Return a receiver that leaves out the first messages."""

    def take(content: bytes) -> None:
        nonlocal count
        if count:
            count -= 1
        else:
            receiver(content)

    return take

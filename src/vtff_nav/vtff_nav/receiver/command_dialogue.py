"""Commands to a receiver and their answers, one at a time, without waiting.

What takes several exchanges is a procedure: a generator that yields from `CommandDialogue.ask` and
`CommandDialogue.pause`. `CommandDialogue.pass_time` and `answered` resume it.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

from vtff_gnss.novatel import CommandResponse

__all__ = ["CommandDialogue", "Procedure", "Wait"]

#: Time for an answer that comes after it was given up, s.
LATE_ANSWER_TIME = 0.3

ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class Wait:
    """What a procedure waits for: an answer or, without one, a wall time in s."""

    deadline: float
    wants_answer: bool = True


Procedure = Generator[Wait, CommandResponse | None, ResultT]
"""Yields what it waits for; is sent the answer, or None when the time is over."""


class CommandDialogue:
    """Runs one procedure at a time and matches answers to commands.

    Answers do not tell their command, and come between logs: so only one command is under way, and
    after one without an answer the line is left alone until a late answer would have come.

    Attributes
    ----------
    now : float
        Wall time, s.
    outgoing : bytearray
        What is to be sent; the caller takes it from the front.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self.outgoing = bytearray()
        self._procedure: Procedure[None] | None = None
        self._wait: Wait | None = None
        self._has_unanswered = False

    @property
    def is_idle(self) -> bool:
        """Whether no procedure is under way."""
        return self._procedure is None

    def begin(self, procedure: Procedure[None]) -> None:
        """Run a procedure in place of the one under way, as far as it comes without waiting."""
        self._procedure = procedure
        self._resume(None)

    def stop(self) -> None:
        """Give up the procedure under way and what was not sent."""
        self._procedure = self._wait = None
        self.outgoing.clear()

    def answered(self, answer: CommandResponse) -> None:
        """Take an answer of the receiver; one that nobody waits for is passed over."""
        if self._wait is not None and self._wait.wants_answer:
            self._has_unanswered = False
            self._resume(answer)

    def pass_time(self) -> None:
        """Resume a procedure whose time is over."""
        if self._wait is not None and self.now >= self._wait.deadline:
            self._has_unanswered |= self._wait.wants_answer
            self._resume(None)

    def ask(self, command: str, timeout: float) -> Procedure[CommandResponse | None]:
        """Send a command and return its answer, None if none comes in time (s)."""
        if self._has_unanswered:
            yield from self.pause(LATE_ANSWER_TIME)
            self._has_unanswered = False
        self.outgoing += command.encode("ascii", errors="replace") + b"\r\n"
        return (yield Wait(self.now + timeout))

    def pause(self, duration: float) -> Procedure[None]:
        """Wait, in s."""
        yield Wait(self.now + duration, wants_answer=False)

    def _resume(self, answer: CommandResponse | None) -> None:
        procedure, self._wait = self._procedure, None
        if procedure is None:
            return
        try:
            wait = procedure.send(answer)
        except StopIteration:
            if self._procedure is procedure:
                self._procedure = None
        else:
            self._wait = wait

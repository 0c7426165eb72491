"""Commands to a receiver and their answers, one at a time, without waiting.

Work that takes several exchanges is a procedure: a generator that yields from `CommandDialogue.ask`
and `CommandDialogue.pause`. `CommandDialogue.pass_time` and `take_answer` resume it.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

from vtff_gnss.novatel import CommandResponse

__all__ = ["CommandDialogue", "Procedure", "Wait"]

#: Wall time, s, in which an answer may still arrive after its command has timed out.
LATE_ANSWER_TIME = 0.3

ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class Wait:
    """The end of a wait of a procedure: its deadline (wall time, s) or an answer before it."""

    deadline: float
    wants_answer: bool = True


Procedure = Generator[Wait, CommandResponse | None, ResultT]
"""Generator that yields what it waits for; it is sent the answer, or None at the deadline."""


class CommandDialogue:
    """Runs one procedure at a time and matches answers to commands.

    An answer does not name its command and comes between logs. So only one command is under way
    at a time, and after a command without an answer the next one waits until a late answer would
    have come.

    Attributes
    ----------
    now : float
        Wall time, s.
    outgoing : bytearray
        Bytes to send; the caller removes the bytes that it has sent from the front.
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
        """Run a procedure in place of the current one, up to its first wait."""
        self._procedure = procedure
        self._resume(None)

    def stop(self) -> None:
        """Drop the current procedure and the bytes that were not sent."""
        self._procedure = self._wait = None
        self.outgoing.clear()

    def take_answer(self, answer: CommandResponse) -> None:
        """Give an answer to the procedure; ignore an answer that the procedure does not await."""
        if self._wait is not None and self._wait.wants_answer:
            self._has_unanswered = False
            self._resume(answer)

    def pass_time(self) -> None:
        """Resume the procedure if its deadline has passed."""
        if self._wait is not None and self.now >= self._wait.deadline:
            self._has_unanswered |= self._wait.wants_answer
            self._resume(None)

    def ask(self, command: str, timeout: float) -> Procedure[CommandResponse | None]:
        """Send a command and return its answer; None if no answer comes within the time-out, s."""
        if self._has_unanswered:
            yield from self.pause(LATE_ANSWER_TIME)
            self._has_unanswered = False
        self.outgoing += command.encode("ascii", errors="replace") + b"\r\n"
        return (yield Wait(self.now + timeout))

    def pause(self, duration: float) -> Procedure[None]:
        """Wait for a duration, s."""
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

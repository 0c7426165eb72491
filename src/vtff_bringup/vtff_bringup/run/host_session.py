"""What a run needs of the other hosts, whichever part of it this host runs."""

from __future__ import annotations

import abc
import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any

from vtff_bringup.run.exit_codes import EXIT_FAILURE
from vtff_bringup.system.description import SystemDescription
from vtff_node.process.lifeline import Stage

__all__ = ["Conclusion", "HostError", "HostSession", "RunEnd"]


class HostError(RuntimeError):
    """A host cannot take part in a run; the text names the host and the reason."""


@dataclasses.dataclass(frozen=True)
class RunEnd:
    """Why a run ends: as in `vtff_bringup.run.runner.RunResult`."""

    exit_code: int
    reason: str
    last_output: tuple[str, ...] = ()

    @classmethod
    def from_message(cls, content: Any) -> RunEnd:
        """Return the end in a message of another host; what is damaged counts as a failure."""
        if not isinstance(content, dict):
            return cls(EXIT_FAILURE, "an end without a reason")
        code, output = content.get("exit_code"), content.get("last_output")
        return cls(
            code if isinstance(code, int) else EXIT_FAILURE,
            str(content.get("reason", "")),
            tuple(str(line) for line in output) if isinstance(output, list) else (),
        )


@dataclasses.dataclass(frozen=True)
class Conclusion:
    """What the host that records says about the run.

    Attributes
    ----------
    host, bag
        Name of the host, and the run folder on it.
    exit_code
        Exit code of the host's part.
    message_count
        Messages in the bag.
    """

    host: str
    bag: str
    exit_code: int
    message_count: int

    @classmethod
    def from_message(cls, content: Any) -> Conclusion | None:
        """Return the conclusion in a message of another host; None if it is damaged."""
        try:
            return cls(
                str(content["host"]),
                str(content["bag"]),
                int(content["exit_code"]),
                int(content["message_count"]),
            )
        except (KeyError, TypeError, ValueError):
            return None


class HostSession(abc.ABC):
    """One part of a run while it lasts.

    Attributes
    ----------
    host
        Name of this host.
    description
        The system, as all parts have loaded it.
    domain
        The ROS domain on which all hosts agree.
    clock_offsets
        By how much the clock of each other host that was compared is ahead, s.
    progress
        Last progress report of the node that ends the run.
    say
        Takes lines for the user, from any thread.
    """

    host: str
    description: SystemDescription
    domain: int
    say: Callable[[str], None]

    def __init__(self) -> None:
        self.clock_offsets: dict[str, float] = {}
        self.progress: dict[str, Any] = {}

    @property
    @abc.abstractmethod
    def records(self) -> bool:
        """Whether this host records the bag."""

    @abc.abstractmethod
    def add_dds_settings(self, environment: dict[str, str], run_directory: pathlib.Path) -> None:
        """Let the nodes of this host find those of the others, and nobody else.

        Raises
        ------
        OSError
            If the settings cannot be written into the run folder.
        """

    @abc.abstractmethod
    def poll(self) -> RunEnd | None:
        """Return why the run ends, if another host has ended it or is lost."""

    @abc.abstractmethod
    def begin_stage(self, stage: Stage, end: RunEnd) -> None:
        """Tell that a stage of the end begins here, or wait until it may.

        The stages are that of the nodes on all hosts, then of the recorders, then of the helpers.

        Parameters
        ----------
        stage
            Whose processes are ended.
        end
            Why the run ends, as far as this host knows.
        """

    @abc.abstractmethod
    def complete_stage(self, stage: Stage, counts: dict[str, str]) -> None:
        """Tell that a stage has ended here; the main host waits for all others.

        Parameters
        ----------
        stage
            Whose processes have ended.
        counts
            After the nodes, the texts of the files with their message counts, by file name.
        """

    @property
    @abc.abstractmethod
    def counts(self) -> dict[str, str]:
        """Message counts of nodes of the other hosts, by file name; complete after the nodes."""

    @abc.abstractmethod
    def conclude(self, own: Conclusion | None) -> Conclusion | None:
        """Share the conclusion of the host that records, or return the one of another host.

        Parameters
        ----------
        own
            The conclusion if this host records, else None.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Leave the run."""

"""Rules of the recorder without ROS: which topics, at which time, and when to acknowledge."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable

__all__ = ["Acknowledger", "GatherPace", "ScenarioTime", "TopicSelection"]

GATHER_STEPS = 10  # steps of lockstep between looks of a recorder, as far as the limits permit
SHORTEST_GATHER_TIME = 0.005  # s of wall time between them at least


class ScenarioTime:
    """Scenario time: that of the newest /clock, without any /clock the newest stamp of a message.

    Parameters
    ----------
    only_clock
        Ignore the stamps of messages. In lockstep a thrust is stamped with the later time at which
        it begins to act, and the order in which messages arrive differs between runs.

    Attributes
    ----------
    nanoseconds
        The scenario time, ns since 1970; 0 before the first message.
    """

    def __init__(self, only_clock: bool = False) -> None:
        self.nanoseconds = 0
        self._only_clock = only_clock
        self._has_clock = False

    def take_clock(self, nanoseconds: int) -> None:
        """Take the time of a /clock message."""
        self._has_clock = True
        self.nanoseconds = nanoseconds

    def take_stamp(self, nanoseconds: int) -> None:
        """Take the stamp of a message; it has no effect once a /clock has come."""
        if not (self._only_clock or self._has_clock) and nanoseconds > self.nanoseconds:
            self.nanoseconds = nanoseconds


@dataclasses.dataclass(frozen=True)
class TopicSelection:
    """The topics that are recorded.

    Parameters
    ----------
    include
        Regular expression; a topic is recorded if the expression is found in its name.
    exclude
        Full names of topics that are not recorded.
    include_hidden
        Record hidden topics (a part of the name begins with an underscore) and /parameter_events.

    Raises
    ------
    ValueError
        If `include` is not a regular expression.
    """

    include: str = ""
    exclude: tuple[str, ...] = ()
    include_hidden: bool = False

    def __post_init__(self) -> None:
        try:
            re.compile(self.include)
        except re.error as error:
            raise ValueError(
                f"include '{self.include}' is not a regular expression: {error}"
            ) from None

    def wants(self, topic: str) -> bool:
        """Return whether a topic is recorded."""
        if topic in self.exclude:
            return False
        hidden = topic == "/parameter_events" or "/_" in topic
        if hidden and not self.include_hidden:
            return False
        return not self.include or re.search(self.include, topic) is not None


class Acknowledger:
    """Decides when the recorder, a side branch of lockstep, acknowledges a step.

    The first step is acknowledged once the set of topics is stable, then every
    ``acknowledge_every``-th /clock. Each acknowledgement carries the stamp of its /clock, so that
    equal runs give equal acknowledgements, however long a machine pauses.

    Parameters
    ----------
    acknowledge
        Function that publishes the acknowledgement of a stamp (ns since 1970).
    acknowledge_every
        Number of steps between acknowledgements.

    Attributes
    ----------
    stopped
        Set to True to end the acknowledgements.
    is_allowed
        Whether `allow_first` has been called.
    steps
        Number of steps so far.
    """

    def __init__(self, acknowledge: Callable[[int], None], acknowledge_every: int = 10) -> None:
        self._acknowledge = acknowledge
        self._every = acknowledge_every
        self.steps = 0
        self._newest = 0
        self._last_acknowledged_step = 0
        self.is_allowed = False
        self.stopped = False

    def take_clock(self, nanoseconds: int) -> None:
        """Take the time of a /clock message, ns since 1970."""
        self.steps += 1
        self._newest = nanoseconds
        if self._last_acknowledged_step == 0:
            self._send_first()
        elif self.steps - self._last_acknowledged_step >= self._every:
            self._send()

    def allow_first(self) -> None:
        """Allow the first acknowledgement: the set of topics is stable, so no message is missed."""
        self.is_allowed = True
        self._send_first()

    def _send_first(self) -> None:
        if self.is_allowed and self.steps and self._last_acknowledged_step == 0:
            self._send()

    def _send(self) -> None:
        if not self.stopped:
            self._last_acknowledged_step = self.steps
            self._acknowledge(self._newest)


class GatherPace:
    """Chooses for how long messages gather in lockstep: the time of some steps.

    Each wake-up of the recorder costs as much as the work of a step. Steps wait for it after many,
    so that it may sleep for some.

    Parameters
    ----------
    longest
        Longest time, s of wall time.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._looked_at = 0.0
        self._steps = 0

    def choose(self, now: float, steps: int) -> float:
        """Return the time until the next look, s.

        Parameters
        ----------
        now
            Wall time, s.
        steps
            Number of steps that the recorder has heard of so far.
        """
        elapsed, new_steps = now - self._looked_at, steps - self._steps
        self._looked_at, self._steps = now, steps
        if not new_steps:
            return self._longest
        return min(max(GATHER_STEPS * elapsed / new_steps, SHORTEST_GATHER_TIME), self._longest)

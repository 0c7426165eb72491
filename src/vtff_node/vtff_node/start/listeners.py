"""Which nodes hear each topic of a node: stated at the start, so that a recorder misses nothing.

DDS may lose the announcement of a single publisher or subscription and repairs that only after a
second or more. Only the process of a publisher knows that it has discovered a subscription, and
only a node knows which topics it publishes. So each node states both on /diagnostics, and a
recorder holds the first step of a lockstep run back until every topic is heard.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

__all__ = [
    "DIAGNOSTICS_TOPIC",
    "TOPICS_SUBJECT",
    "UNNAMED_NODE",
    "ListenerWatch",
    "listener_values",
    "read_listeners",
    "status_name",
]

DIAGNOSTICS_TOPIC = "/diagnostics"

#: Topics that rclpy makes for each node.
TOPICS_OF_ALL_NODES = frozenset(("/rosout", "/parameter_events"))

#: Name that ROS gives to a node whose endpoint was discovered before its name.
UNNAMED_NODE = "_NODE_NAME_UNKNOWN_"

#: Wall time for which a node looks often at its listeners, s; later it looks once a second.
WATCH_TIME = 60.0

TOPICS_SUBJECT = ": topics"
"""End of the name of a report with the topics of a node."""


class ListenerWatch:
    """Publishes which nodes hear each topic of a node whenever that has changed.

    Parameters
    ----------
    count_listeners
        Returns how many subscriptions each publisher has discovered; called often.
    find_listeners
        Returns the full name of the node of each subscription, by topic; called when a count has
        changed.
    publish
        Publishes these names.
    steady_clock
        Wall time in s.
    """

    def __init__(
        self,
        count_listeners: Callable[[], list[int]],
        find_listeners: Callable[[], Mapping[str, Collection[str]]],
        publish: Callable[[Mapping[str, Collection[str]]], object],
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._count_listeners = count_listeners
        self._find_listeners = find_listeners
        self._publish = publish
        self._steady_clock = steady_clock
        self._made = steady_clock()
        self._counts: list[int] | None = None
        self._published: dict[str, list[str]] = {}

    @property
    def is_over(self) -> bool:
        """Whether the start is so long ago that a look once a second is enough."""
        return self._steady_clock() - self._made > WATCH_TIME

    def look(self) -> None:
        """Look at the listeners, and publish their names if these have changed."""
        counts = self._count_listeners()
        if counts == self._counts:
            return
        found = self._find_listeners()
        listeners = {topic: sorted(set(names)) for topic, names in found.items()}
        # The graph, and in it the names, may come later than the match: then the look is repeated.
        is_named = not any(UNNAMED_NODE in name for names in listeners.values() for name in names)
        is_complete = sum(map(len, found.values())) >= sum(counts)
        self._counts = counts if is_named and is_complete else None
        if listeners != self._published:
            self._published = listeners
            self._publish(listeners)


def status_name(node: str) -> str:
    """Return the name of the status in which a node states its topics.

    Parameters
    ----------
    node
        Fully qualified name.
    """
    return node + TOPICS_SUBJECT


def listener_values(listeners: Mapping[str, Collection[str]]) -> dict[str, str]:
    """Return the values of the status: the names of the nodes that listen, by topic."""
    return {topic: " ".join(sorted(names)) for topic, names in sorted(listeners.items())}


def read_listeners(status: Any) -> tuple[str, dict[str, set[str]]] | None:
    """Read the statement of a node about its topics.

    Parameters
    ----------
    status : diagnostic_msgs.msg.DiagnosticStatus
        Any status.

    Returns
    -------
    tuple or None
        Fully qualified name of the node, and the names of the nodes that listen by topic; None for
        a status about something else.
    """
    if not status.name.startswith("/") or not status.name.endswith(TOPICS_SUBJECT):
        return None
    node = status.name.removesuffix(TOPICS_SUBJECT)
    return node, {item.key: set(item.value.split()) for item in status.values}

"""Whether a recorder hears every topic of the nodes that it waits for, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

from vtff_node.start.listeners import DIAGNOSTICS_TOPIC, TOPICS_OF_ALL_NODES

__all__ = ["ExpectedNodes"]

#: Wall time from the discovery of a node after which it is taken for one that states nothing, s.
STATEMENT_PATIENCE = 10.0
#: The same for a node that reports on /diagnostics, as every vtff node does: it states nothing as
#: long as other nodes of its process compile, for which they have their `start_timeout`.
COMPILE_PATIENCE = 600.0


class ExpectedNodes:
    """The nodes of a run, and what a recorder does not hear of them yet.

    A topic of a node is heard when the recorder has discovered its publisher and the node states
    that it has discovered the subscription of the recorder (`vtff_node.start.listeners`): what the
    node then publishes waits for the recorder, also where a packet is lost.

    Parameters
    ----------
    names
        Fully qualified names of the nodes.
    recorder
        Fully qualified name of the recorder.
    wants
        Returns whether a topic is recorded.
    warn
        Prints a line about a node that states nothing.

    Attributes
    ----------
    names : list of str
        The nodes, in alphabetical order.
    """

    def __init__(
        self,
        names: Iterable[str],
        recorder: str,
        wants: Callable[[str], bool],
        warn: Callable[[str], object],
    ) -> None:
        self.names = sorted(set(names))
        self._recorder = recorder
        self._wants = wants
        self._warn = warn
        self._ignored: set[str] = set()
        self._discovered: dict[str, set[str]] = {name: set() for name in self.names}
        self._discovered_since: dict[str, float] = {}
        self._stated: dict[str, Mapping[str, Collection[str]]] = {}
        self._silent: set[str] = set()

    def discover(self, topic: str, nodes: Iterable[str], now: float) -> None:
        """Note that publishers of these nodes have been discovered; `now` is wall time in s."""
        for node in nodes:
            if node in self._discovered:
                self._discovered[node].add(topic)
                if topic not in TOPICS_OF_ALL_NODES:  # else it is still warming up
                    self._discovered_since.setdefault(node, now)

    def state(self, node: str, listeners: Mapping[str, Collection[str]]) -> None:
        """Take the statement of a node: full names of the nodes that listen, by topic."""
        self._stated[node] = listeners

    def ignore(self, topic: str) -> None:
        """Note that a topic cannot be recorded."""
        self._ignored.add(topic)

    def are_heard(self, now: float) -> bool:
        """Return whether all topics of all nodes are heard; `now` is wall time in s.

        A node that has been discovered and states nothing is no vtff node. After a while it is
        named in a warning and no longer waited for.
        """
        for node, since in self._discovered_since.items():
            reports = DIAGNOSTICS_TOPIC in self._discovered[node]
            patience = COMPILE_PATIENCE if reports else STATEMENT_PATIENCE
            is_silent = node not in self._stated and now - since > patience
            if is_silent and node not in self._silent:
                self._silent.add(node)
                self._warn(
                    f"node {node} does not state its topics: recorded is what has been discovered"
                )
        return not self.missing()

    def missing(self) -> list[str]:
        """Return one text for each node of which something is not heard yet."""
        return [text for text in map(self._describe_missing, self.names) if text]

    def _describe_missing(self, node: str) -> str:
        if node in self._silent:
            return ""
        if node not in self._stated:
            return f"node {node}"
        unheard = [
            topic
            for topic, listeners in sorted(self._stated[node].items())
            if self._wants(topic)
            and topic not in self._ignored
            and not (topic in self._discovered[node] and self._recorder in listeners)
        ]
        return f"{', '.join(unheard)} of node {node}" if unheard else ""

"""Whether a bag holds a flight: a run that failed before its first step left only diagnostics."""

from __future__ import annotations

import pathlib

from vtff_bag.file.errors import BagReadError
from vtff_bag.file.reader import BagReader

__all__ = ["require_flight"]

#: Topics on which nodes tell about themselves, also when nothing flies.
SELF_REPORTS = frozenset(
    ("/diagnostics", "/parameter_events", "/rosout", "/sim/status", "/sim/step_done")
)


def require_flight(path: pathlib.Path) -> None:
    """Raise BagReadError if there is no bag, or only messages of nodes about themselves in it."""
    topics = BagReader(path).topics
    if not any(topic.message_count for name, topic in topics.items() if name not in SELF_REPORTS):
        raise BagReadError(f"{path}: nothing flew in this run, its bag holds no data")

"""Whether a bag holds a flight: a run that failed before its first step left only diagnostics."""

from __future__ import annotations

import pathlib

from vtff_bag.file.errors import BagReadError
from vtff_bag.file.reader import BagReader

__all__ = ["has_flown", "require_flight"]

#: Topics on which nodes tell about themselves, also when nothing flies.
SELF_REPORTS = frozenset(
    ("/diagnostics", "/parameter_events", "/rosout", "/sim/status", "/sim/step_done")
)


def has_flown(path: pathlib.Path) -> bool:
    """Return whether a bag holds more than messages of nodes about themselves.

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag.
    """
    topics = BagReader(path).topics
    return any(topic.message_count for name, topic in topics.items() if name not in SELF_REPORTS)


def require_flight(path: pathlib.Path) -> None:
    """Raise BagReadError if there is no bag, or only messages of nodes about themselves in it."""
    if not has_flown(path):
        raise BagReadError(f"{path}: nothing flew in this run, its bag holds no data")

"""Quality of service that publishers offer: what a subscription may ask for, and metadata of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from vtff_bag.file.metadata import QosEntry, offered_qos
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

__all__ = ["qos_entries", "strongest_common"]


def strongest_common(profiles: Iterable[Any]) -> tuple[bool, bool]:
    """Return whether all publishers offer RELIABLE, and whether all offer TRANSIENT_LOCAL.

    A subscription that asks for more than a publisher offers receives nothing from it. So the
    recorder asks for the strongest policies that every publisher offers, as ``ros2 bag record``
    does.
    """
    offered = list(profiles)
    return (
        all(profile.reliability.name == "RELIABLE" for profile in offered),
        all(profile.durability.name == "TRANSIENT_LOCAL" for profile in offered),
    )


def qos_entries(profiles: Iterable[Any]) -> list[QosEntry]:
    """Return the distinct profiles as ``offered_qos_profiles`` entries, in a fixed order."""
    entries: list[QosEntry] = []
    for profile in profiles:
        entry = offered_qos(
            history=profile.history.name.lower(),
            depth=profile.depth,
            reliability=profile.reliability.name.lower(),
            durability=profile.durability.name.lower(),
            deadline=_split_duration(profile.deadline),
            lifespan=_split_duration(profile.lifespan),
            liveliness=profile.liveliness.name.lower(),
            liveliness_lease_duration=_split_duration(profile.liveliness_lease_duration),
            avoid_ros_namespace_conventions=bool(profile.avoid_ros_namespace_conventions),
        )
        if entry not in entries:
            entries.append(entry)
    return sorted(entries, key=repr)


def _split_duration(duration: Any) -> dict[str, int]:
    seconds, remainder = divmod(duration.nanoseconds, NANOSECONDS_PER_SECOND)
    return {"sec": seconds, "nsec": remainder}

"""Quality of service of a replay: the profile of a publisher from the recorded offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.duration import Duration, Infinite
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from vtff_bag.file.metadata import INFINITE_DURATION, QosEntry
from vtff_node.qos import HISTORY_DEPTH

# Up to metadata version 8 rosbag2 writes the numbers of rmw's enumerations.
_POLICIES: dict[str, tuple[Any, dict[str, Any]]] = {
    "history": (
        HistoryPolicy,
        {"keep_last": HistoryPolicy.KEEP_LAST, "keep_all": HistoryPolicy.KEEP_ALL},
    ),
    "reliability": (
        ReliabilityPolicy,
        {"reliable": ReliabilityPolicy.RELIABLE, "best_effort": ReliabilityPolicy.BEST_EFFORT},
    ),
    "durability": (
        DurabilityPolicy,
        {
            "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
            "volatile": DurabilityPolicy.VOLATILE,
        },
    ),
    "liveliness": (
        LivelinessPolicy,
        {
            "automatic": LivelinessPolicy.AUTOMATIC,
            "manual_by_topic": LivelinessPolicy.MANUAL_BY_TOPIC,
        },
    ),
}


def publisher_profile(offers: Sequence[QosEntry]) -> QoSProfile:
    """Return a profile that matches every subscription that the recorded publishers matched.

    Parameters
    ----------
    offers
        ``offered_qos_profiles`` of a topic. Where its publishers differed, the strongest value of
        each policy is offered; where no offer was recorded, reliable and volatile.

    Returns
    -------
    QoSProfile
        Its depth is at least `vtff_node.qos.HISTORY_DEPTH` messages, because a recorder cannot
        discover the depth of a publisher.
    """
    reliable = [
        _read_policy(offer, "reliability") is ReliabilityPolicy.RELIABLE for offer in offers
    ]
    latched = [
        _read_policy(offer, "durability") is DurabilityPolicy.TRANSIENT_LOCAL for offer in offers
    ]
    manual = [
        _read_policy(offer, "liveliness") is LivelinessPolicy.MANUAL_BY_TOPIC for offer in offers
    ]
    keep_all = [_read_policy(offer, "history") is HistoryPolicy.KEEP_ALL for offer in offers]
    depths = [int(offer.get("depth") or 0) for offer in offers if _is_count(offer.get("depth"))]
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL if any(keep_all) else HistoryPolicy.KEEP_LAST,
        depth=max([HISTORY_DEPTH, *depths]),
        reliability=(
            ReliabilityPolicy.RELIABLE
            if any(reliable) or not offers
            else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if any(latched) else DurabilityPolicy.VOLATILE
        ),
        deadline=_find_shortest_duration(offers, "deadline"),
        lifespan=_find_longest_duration(offers, "lifespan"),
        liveliness=(
            LivelinessPolicy.MANUAL_BY_TOPIC if any(manual) else LivelinessPolicy.AUTOMATIC
        ),
        liveliness_lease_duration=_find_shortest_duration(offers, "liveliness_lease_duration"),
    )


def _read_policy(offer: QosEntry, name: str) -> Any:
    """Return a policy from its recorded word or number; None for an unknown value."""
    enumeration, words = _POLICIES[name]
    value = offer.get(name)
    if isinstance(value, str):
        return words.get(value)
    try:
        return enumeration(value)
    except (TypeError, ValueError):
        return None


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and 0 <= value < 1_000_000


def _find_shortest_duration(offers: Sequence[QosEntry], name: str) -> Any:
    return min(
        (_read_duration(offer.get(name)) for offer in offers),
        key=_to_nanoseconds,
        default=Infinite,
    )


def _find_longest_duration(offers: Sequence[QosEntry], name: str) -> Any:
    return max(
        (_read_duration(offer.get(name)) for offer in offers),
        key=_to_nanoseconds,
        default=Infinite,
    )


def _read_duration(value: Any) -> Any:
    """Return a recorded duration; infinite where it is unset, infinite or damaged."""
    if not isinstance(value, Mapping):
        return Infinite
    seconds, nanoseconds = value.get("sec"), value.get("nsec")
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        return Infinite
    if seconds >= INFINITE_DURATION["sec"] or (seconds, nanoseconds) <= (0, 0):
        return Infinite
    return Duration(seconds=seconds, nanoseconds=nanoseconds)


def _to_nanoseconds(duration: Any) -> int:
    return int(duration.nanoseconds)

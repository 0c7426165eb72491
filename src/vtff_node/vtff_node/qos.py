"""Quality-of-service profiles of the vtff graph, defined once.

Publishers offer RELIABLE and TRANSIENT_LOCAL with a deep history: in lockstep a
participant or the recorder that is discovered late still receives every message from
the first step on, whatever order the processes start in. Against hardware a late
subscriber must not act on old messages, so there it asks for VOLATILE.
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

#: Messages a publisher keeps. Lockstep lets a side branch lag by at most 50 steps of up to 20
#: messages a topic, or 200 of up to 5, so nothing is overwritten unread: a second recorder gets
#: what a lost one has not read. In real time these are 55 s of 20 Hz data.
HISTORY_DEPTH = 1100

#: Publishers of data, commands, events and /clock.
PUBLISH = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=HISTORY_DEPTH,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def subscribe(with_history: bool) -> QoSProfile:
    """Profile of a data subscription.

    Parameters
    ----------
    with_history
        True (lockstep, or values that hold until replaced such as ephemerides): also
        receive what was published before this node was discovered.
        False (hardware, realtime): only what comes from now on.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=HISTORY_DEPTH if with_history else 200,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if with_history else DurabilityPolicy.VOLATILE,
    )

"""Messages that the middleware holds and never announces to an EventsExecutor.

An EventsExecutor sets a callback on each subscription. rmw_fastrtps (8.4) first counts what is
there and then begins to listen (``RMWSubscriptionEvent::set_on_new_message_callback``): what comes
in between is announced only with the next message of the topic. The first step of a lockstep run
has no next message until it is acknowledged, and the run would stand.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.exceptions import InvalidHandle

__all__ = ["take_unannounced"]


def take_unannounced(subscriptions: Iterable[Any]) -> int:
    """Take what lies in the queues of subscriptions, and call their callbacks.

    Parameters
    ----------
    subscriptions : iterable of rclpy.subscription.Subscription
        Subscriptions whose callbacks take the message alone. A callback may make or destroy
        subscriptions.

    Returns
    -------
    int
        Number of messages taken.
    """
    taken = 0
    for subscription in list(subscriptions):
        messages = _take_all(subscription)
        taken += len(messages)
        callback = subscription.callback
        for message in messages:
            callback(message)
    return taken


def _take_all(subscription: Any) -> list[Any]:
    """Return the waiting messages of a subscription, the oldest first."""
    handle, kind, is_raw = subscription.handle, subscription.msg_type, subscription.raw
    messages = []
    try:
        with handle:
            while (found := handle.take_message(kind, is_raw)) is not None:
                messages.append(found[0])
    except InvalidHandle:  # a callback before has destroyed it
        pass
    return messages

"""Messages that the middleware holds and never announces to an EventsExecutor.

An EventsExecutor sets a callback on each subscription. rmw_fastrtps (8.4) first counts what is
there and then begins to listen (``RMWSubscriptionEvent::set_on_new_message_callback``): what comes
in between is announced only with the next message of the topic. The first step of a lockstep run
has no next message until it is acknowledged, and the run would stand.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

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
        while (message := _take(subscription)) is not None:
            taken += 1
            subscription.callback(message)
    return taken


def _take(subscription: Any) -> Any:
    """Return the oldest waiting message of a subscription; None without any."""
    from rclpy.exceptions import InvalidHandle

    try:
        with subscription.handle:
            found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:  # a callback before has destroyed it
        return None
    return None if found is None else found[0]

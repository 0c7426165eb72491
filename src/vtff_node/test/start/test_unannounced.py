"""Messages that no executor is told of are taken, once and in order."""

import time

import pytest

from vtff_node.start.unannounced import take_unannounced


def test_what_waits_is_taken_in_order_though_no_executor_spins(ros_context):
    from std_msgs.msg import String

    from vtff_node import qos
    from vtff_node.node import VtffNode

    node = VtffNode("listener", context=ros_context)
    try:
        publisher = node.publisher(String, "/words")
        for word in ("first", "second"):
            publisher.publish(String(data=word))
        heard = []
        raw = []
        node.create_subscription(String, "/words", lambda m: heard.append(m.data), qos.PUBLISH)
        node.create_subscription(String, "/words", raw.append, qos.PUBLISH, raw=True)
        deadline = time.monotonic() + 10.0
        taken = 0
        while taken < 4 and time.monotonic() < deadline:
            taken += take_unannounced(node.subscriptions)
            time.sleep(0.01)
        assert heard == ["first", "second"]
        assert len(raw) == 2 and b"first" in raw[0] and b"second" in raw[1]
        assert take_unannounced(node.subscriptions) == 0
    finally:
        node.destroy_node()


@pytest.mark.parametrize("is_raw", [False, True])
def test_a_callback_may_destroy_a_subscription(ros_context, is_raw):
    from std_msgs.msg import String

    from vtff_node import qos
    from vtff_node.node import VtffNode

    node = VtffNode("listener", context=ros_context)
    try:
        node.publisher(String, "/words").publish(String(data="only"))
        calls = []

        def destroy_all(message):
            calls.append(message)
            for subscription in subscriptions:
                node.destroy_subscription(subscription)

        subscriptions = [
            node.create_subscription(String, "/words", destroy_all, qos.PUBLISH, raw=is_raw)
            for _ in range(2)
        ]
        deadline = time.monotonic() + 10.0
        while not calls and time.monotonic() < deadline:
            take_unannounced(subscriptions)
            time.sleep(0.01)
        assert len(calls) == 1
    finally:
        node.destroy_node()

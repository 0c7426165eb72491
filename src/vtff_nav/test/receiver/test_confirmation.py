"""For which subscribers a driver in lockstep waits until they have an ephemeris."""

from __future__ import annotations

import types

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from vtff_nav.receiver.event_publisher import EventPublisher

LOCAL = object()


@pytest.mark.parametrize(
    ("delivery", "of_middleware", "nodes", "expected"),
    [
        (None, 2, ["relative_ekf", "bag_recorder"], True),
        (LOCAL, 1, ["relative_ekf", "bag_recorder"], False),
        (LOCAL, 0, ["relative_ekf"], False),
        (LOCAL, 2, ["relative_ekf", "bag_recorder", "bag_recorder"], False),
        (LOCAL, 2, ["relative_ekf", "bag_recorder", "ionosphere_processor"], True),
        (LOCAL, 1, ["relative_ekf", "viewer"], True),
    ],
)
def test_nodes_of_other_processes_but_recorders_are_waited_for(
    delivery, of_middleware, nodes, expected
):
    waits = []
    node = types.SimpleNamespace(
        lockstep=True,
        local_delivery=delivery,
        get_subscriptions_info_by_topic=lambda topic: [
            types.SimpleNamespace(node_name=name) for name in nodes
        ],
    )
    publisher = types.SimpleNamespace(
        topic_name="/chief/gnss/ephemeris",
        count_subscriptions_of_middleware=lambda: of_middleware,
        wait_for_all_acked=waits.append,
    )
    driver = EventPublisher.__new__(EventPublisher)
    driver._node, driver._unconfirmed = node, [publisher]
    driver._confirm_ephemerides()
    assert bool(waits) is expected
    assert not driver._unconfirmed

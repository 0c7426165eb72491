"""Messages within a process: order, turns, threads, receivers that come and go."""

from __future__ import annotations

import threading
import time
from collections import deque

import pytest

from vtff_node.process import local_delivery
from vtff_node.process.local_delivery import LocalDelivery


class Process:
    """A delivery whose calls are made by `run`, as by an executor."""

    def __init__(self) -> None:
        self.delivery = LocalDelivery()
        self.calls = deque()
        self.delivery.call_soon = self.calls.append

    def run(self) -> int:
        """Make the calls that wait, and those that come of them; return their number."""
        count = 0
        while self.calls:
            self.calls.popleft()()
            count += 1
        return count

    def publish(self, topic: str, content: bytes) -> None:
        self.delivery.send(self.delivery.receivers_of(topic), content)

    def hear(self, topic, receiver, with_history=False):
        return self.delivery.add_receiver(topic, receiver, with_history=with_history)


@pytest.fixture
def process() -> Process:
    return Process()


def test_messages_come_in_order_after_the_callback_that_published_them(process):
    heard = []
    process.hear("a", lambda content: heard.append(("first", content)))
    process.hear("a", lambda content: heard.append(("second", content)))
    process.hear("b", lambda content: heard.append(("b", content)))

    def callback() -> None:
        process.publish("a", b"1")
        process.publish("b", b"2")
        process.publish("a", b"3")
        heard.append("end of callback")

    process.delivery.delivering_after(callback)()
    assert heard == [
        "end of callback", ("first", b"1"), ("second", b"1"), ("b", b"2"),
        ("first", b"3"), ("second", b"3"),
    ]  # fmt: skip
    assert not process.calls


def test_what_receivers_publish_follows_and_none_is_called_within_another(process):
    depth, heard = 0, []

    def receive(content: bytes) -> None:
        nonlocal depth
        depth += 1
        assert depth == 1
        heard.append(content)
        if len(content) < 5:
            process.publish("a", content + b"x")
            process.publish("b", content + b"y")
        depth -= 1

    process.hear("a", receive)
    process.hear("b", heard.append)
    process.publish("a", b"0")
    assert not heard
    assert process.run() == 1
    assert heard[:4] == [b"0", b"0x", b"0y", b"0xx"]
    assert len(heard) == 9


def test_a_callback_that_another_one_calls_delivers_with_that(process):
    heard = []
    process.hear("a", heard.append)
    inner = process.delivery.delivering_after(lambda: process.publish("a", b"1"))

    def outer() -> None:
        inner()
        assert not heard

    process.delivery.delivering_after(outer)()
    assert heard == [b"1"]


def test_the_middleware_gets_messages_of_lockstep_in_order_at_the_end_of_a_turn(process):
    published, delivery = [], process.delivery

    def publish(content: bytes) -> None:
        delivery.publish(published.append, content)
        process.publish("a", content)

    def receive(content: bytes) -> None:
        assert bool(published) is not delivery.gathers
        if len(content) < 3:
            publish(content + b"x")

    process.hear("a", receive)
    for gathers in (False, True):
        delivery.gathers = gathers
        delivery.delivering_after(publish)(b"0")
        assert published == [b"0", b"0x", b"0xx"]
        published.clear()
    publish(b"0xx")  # outside of a callback nothing is at the end of a turn
    assert published == [b"0xx"]


def test_the_middleware_gets_what_a_callback_published_before_it_failed(process):
    published, process.delivery.gathers = [], True

    def callback() -> None:
        process.delivery.publish(published.append, b"1")
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        process.delivery.delivering_after(callback)()
    assert published == [b"1"]


def test_who_waits_for_acknowledgements_has_everything_published_before(process, monkeypatch):
    publisher_module = pytest.importorskip("rclpy.publisher")
    node = pytest.importorskip("vtff_node.node")
    published, process.delivery.gathers = [], True
    publisher = node.CountingPublisher.__new__(node.CountingPublisher)
    publisher._delivery = process.delivery
    monkeypatch.setattr(
        publisher_module.Publisher, "wait_for_all_acked", lambda *_: bool(published)
    )

    def callback() -> None:
        process.delivery.publish(published.append, b"1")
        assert not published and publisher.wait_for_all_acked() and published

    process.delivery.delivering_after(callback)()
    assert published == [b"1"]


def test_others_have_their_turn_while_messages_go_round(process, monkeypatch):
    monkeypatch.setattr(local_delivery, "LONGEST_TURN", 0.0)
    heard = []

    def receive(content: bytes) -> None:
        heard.append(content)
        if len(heard) < 100:
            process.publish("a", content)

    process.hear("a", receive)
    process.publish("a", b"1")
    assert process.run() == 100 == len(heard)


def test_a_receiver_that_fails_keeps_nothing_from_the_others(process):
    heard = []

    def fail(content: bytes) -> None:
        raise KeyError(content)

    process.hear("a", fail)
    process.hear("b", heard.append)

    def callback() -> None:
        process.publish("a", b"1")
        process.publish("b", b"2")

    with pytest.raises(KeyError):
        process.delivery.delivering_after(callback)()
    assert process.run() == 1
    assert heard == [b"2"]


def test_messages_of_other_threads_are_not_lost(process):
    """However a thread that publishes and one that delivers meet."""
    heard, count = [], 20_000
    process.hear("a", heard.append)

    def publish() -> None:
        for number in range(count):
            process.publish("a", str(number).encode())

    thread = threading.Thread(target=publish)
    thread.start()
    callback = process.delivery.delivering_after(lambda: None)
    deadline = time.monotonic() + 60.0
    while len(heard) < count and time.monotonic() < deadline:
        callback()
        process.run()
    thread.join()
    assert heard == [str(number).encode() for number in range(count)]


def test_messages_before_the_first_callback_wait_for_their_receivers():
    delivery, calls = LocalDelivery(), deque()
    heard = {"early": [], "late": [], "late with history": []}
    receivers = delivery.receivers_of("a")
    delivery.add_receiver("a", heard["early"].append, with_history=False)
    delivery.send(receivers, b"1")
    delivery.send(delivery.receivers_of("b"), b"nobody")
    delivery.add_receiver("a", heard["late"].append, with_history=False)
    delivery.add_receiver("a", heard["late with history"].append, with_history=True)
    delivery.send(receivers, b"2")
    delivery.call_soon = calls.append
    delivery.deliver_soon()
    calls.popleft()()
    assert heard == {"early": [b"1", b"2"], "late": [b"2"], "late with history": [b"1", b"2"]}


def test_a_receiver_that_has_ended_hears_nothing(process):
    heard, kept = [], []
    end = process.hear("a", heard.append)
    process.hear("a", kept.append)
    process.publish("a", b"1")
    process.run()
    process.publish("a", b"2")
    end()
    process.run()
    assert (heard, kept) == ([b"1"], [b"1", b"2"])


def test_a_message_that_nobody_hears_costs_no_call(process):
    process.publish("a", b"1")
    assert not process.calls


def test_nothing_is_delivered_once_it_is_closed(process):
    heard = []

    def receive(content: bytes) -> None:
        heard.append(content)
        process.delivery.close()

    process.hear("a", receive)
    process.publish("a", b"1")
    process.publish("a", b"2")
    process.run()
    process.publish("a", b"3")
    assert process.run() == 0
    assert heard == [b"1"]

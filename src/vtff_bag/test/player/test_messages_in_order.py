"""Replay without ROS: every message once and in order, whatever is done to its clock."""

import bag_samples
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vtff_bag.file.errors import BagReadError
from vtff_bag.file.reader import BagReader
from vtff_bag.player.messages_in_order import Replay, ReplaySelection, replay_steps, select_topics
from vtff_bag.player.replay_clock import ReplayClock

TOPICS = 3
COUNT = 300
DURATION = float(COUNT // TOPICS - 1)


class WallClock:
    """Wall time that a test moves."""

    def __init__(self):
        self.seconds = 1000.0

    def __call__(self):
        return self.seconds


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    directory = tmp_path_factory.mktemp("replay") / "bag"
    bag_samples.write_bag(directory, bag_samples.sample_messages(COUNT, TOPICS))
    return BagReader(directory)


def make(reader, **arguments):
    wall = WallClock()
    published = []
    replay = Replay(reader, reader.topics, published.append, steady_clock=wall, **arguments)
    return replay, wall, published


def play_to_end(replay, wall, step=0.5):
    for _ in range(100_000):
        if replay.finished:
            return
        wall.seconds += step
        replay.advance()
    raise AssertionError("the replay does not end")


@pytest.mark.parametrize("rate", [0.01, 0.3, 1.0, 7.0, 1e6])
def test_every_message_once_and_in_order_at_any_rate(reader, rate):
    replay, wall, published = make(reader, rate=rate)
    play_to_end(replay, wall)
    assert published == list(reader.raw_messages())
    assert replay.position == DURATION


ACTIONS = st.one_of(
    st.tuples(st.just("wait"), st.floats(0.0, 5.0)),
    st.tuples(st.just("rate"), st.floats(0.1, 50.0)),
    st.sampled_from([("pause",), ("resume",), ("step",)]),
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(ACTIONS, max_size=60))
def test_every_message_once_and_in_order_whatever_is_pressed(reader, actions):
    replay, wall, published = make(reader)
    for action, *value in actions:
        if action == "wait":
            wall.seconds += value[0]
            before, still = len(published), replay.paused
            replay.advance()
            assert not still or len(published) == before
        elif action == "rate":
            replay.set_rate(value[0])
        else:
            getattr(replay, action)()
    replay.resume()
    play_to_end(replay, wall)
    assert published == list(reader.raw_messages())


def test_messages_are_due_when_the_recorded_time_has_come(reader):
    replay, wall, published = make(reader, rate=2.0)
    replay.advance()
    assert len(published) == TOPICS
    wall.seconds += 0.49
    replay.advance()
    assert len(published) == TOPICS
    wall.seconds += 0.01
    replay.advance()
    assert len(published) == 2 * TOPICS


def test_a_late_caller_gets_what_was_missed_in_portions(reader):
    replay, wall, published = make(reader)
    wall.seconds += 1000.0
    replay.advance(budget=-1.0)
    assert len(published) == 1
    replay.advance()
    assert published == list(reader.raw_messages())


def test_step_publishes_one_message_and_goes_to_its_time(reader):
    replay, wall, published = make(reader, paused=True)
    for _ in range(2 * TOPICS):
        assert replay.step() == published[-1]
    assert len(published) == 2 * TOPICS
    assert replay.position == 1.0
    wall.seconds += 100.0
    replay.advance()
    assert len(published) == 2 * TOPICS


def test_seek_goes_back_and_forward(reader):
    replay, wall, published = make(reader, paused=True)
    replay.seek(50.0)
    assert replay.step().log_time == bag_samples.START + 50 * bag_samples.STEP
    replay.seek(0.0)
    replay.resume()
    play_to_end(replay, wall)
    assert published[1:] == list(reader.raw_messages())
    replay.seek(DURATION)
    assert not replay.finished
    for offset in (-0.1, DURATION + 0.1, float("nan")):
        with pytest.raises(ValueError, match="outside the bag"):
            replay.seek(offset)


def test_start_offset_and_loop(reader):
    replay, wall, published = make(reader, start_offset=97.5, loop=True)
    for _ in range(7):
        wall.seconds += 1.0
        replay.advance()
    expected = list(reader.raw_messages())[98 * TOPICS :]
    assert published[: 2 * len(expected)] == expected * 2
    assert not replay.finished


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e7, float("nan")])
def test_impossible_rates_are_refused(reader, rate):
    with pytest.raises(ValueError, match="rate"):
        make(reader, rate=rate)
    clock = ReplayClock(0)
    with pytest.raises(ValueError, match="rate"):
        clock.set_rate(rate)
    assert clock.rate == 1.0


def test_topics_are_chosen_by_name(reader):
    assert set(select_topics(reader, ["/topic_1"]).topics) == {"/topic_1"}
    assert set(select_topics(reader, [], ["/topic_1"]).topics) == {"/topic_0", "/topic_2"}
    with pytest.raises(BagReadError, match="'/nothing'.*/topic_0"):
        select_topics(reader, ["/nothing"])


def test_unknown_types_and_other_definitions_are_skipped_with_one_line(tmp_path):
    writer = bag_samples.write_bag(tmp_path / "bag", bag_samples.sample_messages(3), close=False)
    foreign = writer.add_topic("/radar", "radar_msgs/msg/Scan", definition="float32 range\n")
    writer.write(foreign, b"\0\1\0\0\0\0\0\0", bag_samples.START)
    writer.add_topic("/older", "std_msgs/msg/String", (), "RIHS01_00", "string old\n")
    writer.close()
    selection = select_topics(BagReader(tmp_path / "bag"))
    assert isinstance(selection, ReplaySelection) and not selection.has_clock
    assert set(selection.topics) == {"/topic_0", "/topic_1", "/topic_2"}
    older, radar = selection.skipped
    assert "/older" in older and "another definition" in older
    assert "/radar is skipped (1 messages)" in radar and "radar_msgs/msg/Scan" in radar


def test_steps_hold_what_was_logged_up_to_their_stamp(tmp_path):
    pytest.importorskip("rclpy")
    from rclpy.serialization import serialize_message
    from rosgraph_msgs.msg import Clock

    from vtff_node.stamps import to_stamp

    writer = bag_samples.write_bag(tmp_path / "bag", [], close=False)
    clock = writer.add_topic("/clock", "rosgraph_msgs/msg/Clock")
    for tenth in range(41):
        time = bag_samples.START + tenth * bag_samples.STEP // 10
        if tenth % 10 == 0 and tenth < 40:
            writer.write(clock, serialize_message(Clock(clock=to_stamp(time))), time)
        writer.write(1, bag_samples.string_message(str(tenth)), time)
    writer.close()
    reader = BagReader(tmp_path / "bag")
    steps = list(replay_steps(reader, reader.topics, "/clock"))
    assert [step.stamp for step in steps] == [
        bag_samples.START + number * bag_samples.STEP for number in range(4)
    ]
    texts = [[int(m.serialized[8:-1]) for m in step.messages] for step in steps]
    assert texts == [[0], [*range(1, 11)], [*range(11, 21)], [*range(21, 31)]]
    with pytest.raises(BagReadError, match="no messages on '/nothing'"):
        next(replay_steps(reader, reader.topics, "/nothing"))
    with pytest.raises(BagReadError, match="cannot pace"):
        next(replay_steps(reader, reader.topics, "/topic_0"))

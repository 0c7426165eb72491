"""Bags for the tests: small CDR messages with known content, no ROS needed."""

import random
import struct

from vtff_bag.file.metadata import offered_qos
from vtff_bag.file.writer import BagWriter

START = 1_458_521_983 * 10**9
STEP = 10**9
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING_DEFINITION = "string data\n"


def string_message(text):
    """CDR of std_msgs/msg/String."""
    encoded = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(encoded)) + encoded


def sample_messages(count, topics=3, seed=1):
    """(topic number, CDR, log time) of messages whose text names their place."""
    generator = random.Random(seed)
    return [
        (
            index % topics,
            string_message(f"{index} " + "x" * generator.randrange(200)),
            START + (index // topics) * STEP,
        )
        for index in range(count)
    ]


def write_bag(directory, messages, topics=3, close=True, **settings):
    """Write messages into a bag and return its writer."""
    settings.setdefault("steady_clock", lambda: 0.0)
    writer = BagWriter(directory, {"configuration": "abc"}, **settings)
    numbers = [
        writer.add_topic(
            f"/topic_{index}",
            "std_msgs/msg/String",
            [offered_qos()],
            STRING_HASH,
            STRING_DEFINITION,
        )
        for index in range(topics)
    ]
    for topic, serialized, log_time in messages:
        writer.write(numbers[topic], serialized, log_time)
    if close:
        writer.close()
    return writer

"""Messages a second that bag_recorder takes in: 20 topics of 1 kB, lockstep flow control.

Run in the environment of the workspace::

    python benchmarks/bench_recorder.py [steps]

One process publishes /clock and 19 topics per step and waits where the recorder's
acknowledgements fall 50 steps behind; the recorder runs in a second process. Beside the
rate through DDS it prints the rate of the bag writer alone and of reading the bag back.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tables import add_write_option, write_rows

START = 1_458_521_983
TOPICS = 20
PAYLOAD = 1000  # B
MAXIMUM_LAG = 50  # steps

COLUMNS = (
    "compression",
    "messages a second",
    "lost",
    "peak memory of the recorder",
    "writer alone",
    "reader",
)
"""Columns of the rows that are kept."""


def publish(steps: int) -> float:
    """Publish all steps and return the messages a second."""
    import rclpy
    from rclpy.duration import Duration
    from rclpy.serialization import serialize_message
    from rosgraph_msgs.msg import Clock

    from vtff_msgs.msg import ReceiverLog, StepDone
    from vtff_node.main import make_executor
    from vtff_node.node import VtffNode

    rclpy.init(args=["--ros-args", "-p", "lockstep:=true"])
    node = VtffNode("bench_source")
    clock = node.publisher(Clock, "/clock")
    publishers = [
        node.publisher(ReceiverLog, f"/bench/topic_{number}") for number in range(TOPICS - 1)
    ]
    newest = [-1]
    node.subscribe(
        StepDone,
        "/sim/step_done",
        lambda message: newest.__setitem__(0, message.header.stamp.sec - START),
    )
    executor = make_executor()
    executor.add_node(node)
    node.begin()
    log = ReceiverLog()
    random_bytes = os.urandom(PAYLOAD // 2)  # half of a real log does not compress

    def step(number: int) -> None:
        message = Clock()
        message.clock.sec = START + number
        clock.publish(message)
        log.header.stamp = message.clock
        log.data = random_bytes + bytes(PAYLOAD - len(random_bytes))
        serialized = serialize_message(log)
        for publisher in publishers:
            publisher.publish(serialized)

    step(0)
    while newest[0] < 0:
        executor.spin_once(timeout_sec=1.0)
    begun = time.perf_counter()
    for number in range(1, steps):
        step(number)
        executor.spin_once(timeout_sec=0.0)
        while newest[0] < number - MAXIMUM_LAG:
            executor.spin_once(timeout_sec=1.0)
    last = 10 * ((steps - 1) // 10)
    while newest[0] < last:
        executor.spin_once(timeout_sec=1.0)
    elapsed = time.perf_counter() - begun
    for publisher in (clock, *publishers):
        publisher.wait_for_all_acked(Duration(seconds=10.0))
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    return steps * TOPICS / elapsed


def through_dds(bag: Path, steps: int, compression: str) -> tuple[float, int, float]:
    """Record a publishing process.

    Returns messages a second, messages in the bag, and peak memory of the recorder in MB.
    """
    from domain_coordinator import domain_id

    from vtff_bag.file.reader import BagReader

    with domain_id() as domain:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        command = [sys.executable, "-m", "vtff_bag.bag_recorder_node", "--ros-args"]
        for setting in (
            f"output:={bag}",
            "lockstep:=true",
            "acknowledge_steps:=true",
            f"compression:={compression}",
        ):
            command += ["-p", setting]
        command += ["-p", "wait_for_nodes:=['/bench_source']"]
        recorder = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
        try:
            output = subprocess.run(
                [sys.executable, __file__, "--publish", str(steps)],
                env=environment,
                check=True,
                capture_output=True,
                text=True,
            ).stdout
            memory = peak_memory(recorder.pid)
            recorder.send_signal(signal.SIGINT)
            recorder.wait(timeout=30)
        finally:
            recorder.kill()
    counts = BagReader(bag).topics
    recorded = sum(
        topic.message_count
        for name, topic in counts.items()
        if name == "/clock" or name.startswith("/bench/")
    )
    return float(output), recorded, memory


def peak_memory(process_id: int) -> float:
    """Return the largest resident memory of a running process so far, MB; NaN where unknown."""
    try:
        status = Path(f"/proc/{process_id}/status").read_text(encoding="ascii")
    except OSError:
        return float("nan")
    lines = (line.split() for line in status.splitlines() if line.startswith("VmHWM"))
    return next((int(words[1]) / 1e3 for words in lines), float("nan"))


def writer_alone(bag: Path, count: int, compression: str) -> float:
    """Return messages a second of `BagWriter` without ROS."""
    from vtff_bag.file.writer import BagWriter

    payload = b"\x00\x01\x00\x00" + os.urandom(PAYLOAD // 2) + bytes(PAYLOAD // 2 - 4)
    begun = time.perf_counter()
    with BagWriter(bag, compression=compression) as writer:
        numbers = [
            writer.add_topic(f"/topic_{number}", "std_msgs/msg/String", definition="string data\n")
            for number in range(TOPICS)
        ]
        for index in range(count):
            writer.write(numbers[index % TOPICS], payload, START * 10**9 + index)
    return count / (time.perf_counter() - begun)


def reading(bag: Path) -> float:
    """Return messages a second of `BagReader.raw_messages`."""
    from vtff_bag.file.reader import BagReader

    begun = time.perf_counter()
    count = sum(1 for _ in BagReader(bag).raw_messages())
    return count / (time.perf_counter() - begun)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("steps", type=int, nargs="?", default=2000, help="of /clock (%(default)s)")
    add_write_option(parser, "recorder")
    parser.add_argument("--publish", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    steps = arguments.steps
    if arguments.publish:
        print(publish(steps))
        return
    print(f"{TOPICS} topics, {PAYLOAD} B payload, {steps} steps, {os.cpu_count()} CPUs")
    print(
        f"{'compression':12} {'recorder':>12} {'lost':>6} {'memory':>9} {'writer alone':>14} "
        f"{'reader':>12}"
    )
    rows = []
    for compression in ("zstd", "lz4", "none"):
        with tempfile.TemporaryDirectory() as folder:
            rate, recorded, memory = through_dds(Path(folder) / "bag", steps, compression)
            alone = writer_alone(Path(folder) / "alone", steps * TOPICS, compression)
            read = reading(Path(folder) / "bag")
        lost = steps * TOPICS - recorded
        print(
            f"{compression:12} {rate:10.0f}/s {lost:6d} {memory:6.0f} MB {alone:12.0f}/s "
            f"{read:10.0f}/s",
            flush=True,
        )
        figures = f"{rate:.0f}", str(lost), f"{memory:.0f} MB", f"{alone:.0f}", f"{read:.0f}"
        rows.append([compression, *figures])
    if arguments.write:
        write_rows("recorder", COLUMNS, rows)


if __name__ == "__main__":
    main()

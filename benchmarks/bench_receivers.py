"""Speed of the simulated receivers and of decoding what they send: 36 observations at 20 Hz.

Run in the environment of the workspace::

    python benchmarks/bench_receivers.py [seconds]

One process, one thread: two receivers of ``config/gnss/benchmark.yaml`` on the reference orbit are
simulated and their logs encoded second by second; then the bytes of one are decoded to messages.
CPU time is measured, so that other processes disturb little; the yardstick is a fixed piece of
Python and numpy work, by which machines can be compared.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})

REPOSITORY = Path(__file__).resolve().parents[1]
LOGS = (
    b"LOG RANGEB ONTIME 0.05\r\nLOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n"
    b"LOG GPSEPHEMB ONCHANGED\r\nLOG GALINAVEPHEMERISB ONCHANGED\r\n"
)
CHUNK = 4096  # bytes that a driver reads at a time
REPEATS = 3


def yardstick() -> float:
    """Return the CPU time, ms, of a fixed mix of small numpy calls and Python."""
    import numpy as np

    best = float("inf")
    for _ in range(5):
        begun = time.process_time()
        values, total = np.linspace(0.0, 1.0, 700), 0
        for number in range(3000):
            values = np.sqrt(values * values + 1e-3)
            total += len(str(number))
        best = min(best, time.process_time() - begun)
    return 1e3 * best


def simulated(configuration_name: str, seconds: int) -> tuple[float, float, bytes]:
    """Simulate both receivers; return ms per receiver-second, best and median, and bytes.

    The best is the 5th percentile of all seconds, the bytes are those of the chief.
    """
    sys.path.insert(0, str(REPOSITORY / "src" / "vtff_sim_bridge" / "test"))
    import gnss_emulator_support as support
    import numpy as np

    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], seconds)
    run = support.Run(support.configuration(configuration_name), motions, LOGS)
    times: list[float] = []
    run.all(lambda _second: times.append(time.process_time()))
    # The first second sets the receivers up.
    best, median = np.percentile(np.diff(times[1:]), (5.0, 50.0)) * 1e3 / len(run.content)
    return float(best), float(median), bytes(run.content["chief"])


def decoded(content: bytes, to_messages: bool) -> tuple[float, int]:
    """Return epochs a second and observations of an epoch."""
    from rclpy.serialization import serialize_message

    from vtff_gnss.novatel import ReceiverLogStream
    from vtff_gnss.observations import ObservationEpoch
    from vtff_node.conversions.gnss import observations_to_message

    best, epochs = float("inf"), []
    for _ in range(REPEATS):
        epochs.clear()
        begun = time.process_time()
        stream = ReceiverLogStream()
        for start in range(0, len(content), CHUNK):
            for event in stream.feed(content[start : start + CHUNK]):
                if isinstance(event, ObservationEpoch):
                    epochs.append(len(event))
                    if to_messages:
                        serialize_message(observations_to_message(event, "antenna"))
        best = min(best, time.process_time() - begun)
    return len(epochs) / best, min(epochs)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seconds", type=int, nargs="?", default=120, help="simulated (%(default)s)")
    seconds = parser.parse_args().seconds
    print(f"yardstick {yardstick():.2f} ms; {seconds} s, {os.cpu_count()} CPUs, one thread")
    print(f"{'configuration':14} {'ms per receiver-second':>23} {'median':>8} {'bytes/s':>9}")
    for name in ("benchmark", "reference"):
        best, median, content = simulated(name, seconds)
        rate = len(content) / seconds
        print(f"{name:14} {best:23.2f} {median:8.2f} {rate:9.0f}", flush=True)
        if name == "benchmark":
            benchmark = content
    for label, to_messages in (("to messages", True), ("to columns", False)):
        rate, count = decoded(benchmark, to_messages)
        print(f"decoding {label}, {count} observations: {rate:.0f} epochs/s")


if __name__ == "__main__":
    main()

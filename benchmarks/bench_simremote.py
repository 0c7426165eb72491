"""Round-trip time of a lockstep step over SimREMOTE: two MOT commands out, two replies back.

Run with the workspace environment: ``python benchmarks/bench_simremote.py [steps]``. The emulator
runs as a process of its own; the figure contains writing and reading the numbers on both sides.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from vtff_sim_bridge.simremote.client import SimRemoteClient
from vtff_sim_bridge.simremote.motion import MotionState

WARM_UP_STEPS = 200


def motion(step: int, offset: float, vectors: int = 8) -> MotionState:
    """Return a motion whose first vectors have numbers of full precision; the others are zero."""
    phase = step / 3.0 + offset
    scales = (6.8e6, 7.5e3, 8.1, 9.3e-3, 1.0, 1.1e-3, 1e-6, 1e-9)
    return MotionState(
        *(
            (scale * (1.1 + phase % 0.7), -scale / (1.3 + phase), scale / 7.0)
            for scale in scales[:vectors]
        )
    )


def wait_for_port(port_file: Path, emulator: subprocess.Popen[bytes]) -> int:
    """Return the port that the emulator has written."""
    while not port_file.exists():
        if emulator.poll() is not None:
            raise SystemExit("the emulator did not start")
        time.sleep(0.01)
    return int(port_file.read_text(encoding="ascii"))


def measure(client: SimRemoteClient, steps: int, vectors: int) -> list[float]:
    """Return the round-trip times of the steps, s, in order of size."""
    vehicles = ("v1_m1", "v2_m1")
    client.command("SC,benchmark.scn")
    client.command(f"START_TIME,01-JAN-2016 00:00:00,{(steps // 3600) + 1:02d}:00:00")
    start = [(vehicle, motion(0, 0.0)) for vehicle in vehicles]
    client.receive_replies(client.send_motion(0.0, start))
    client.run()
    times = []
    for step in range(1, steps):
        motions = [
            (vehicle, motion(step, index, vectors)) for index, vehicle in enumerate(vehicles)
        ]
        begin = time.perf_counter()
        client.receive_replies(client.send_motion(float(step), motions))
        times.append(time.perf_counter() - begin)
    client.end()
    return sorted(times[WARM_UP_STEPS:])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "steps", type=int, nargs="?", default=5000, help="in lockstep (%(default)s)"
    )
    steps = parser.parse_args().steps
    if not 2 * WARM_UP_STEPS <= steps <= 80_000:
        parser.error(f"steps: {2 * WARM_UP_STEPS} to 80000 expected, got {steps}")
    print("round trip of two MOT commands in us   median  99th percentile  longest")
    with tempfile.TemporaryDirectory() as folder:
        port_file = Path(folder) / "port"
        emulator = subprocess.Popen(
            [sys.executable, "-m", "vtff_sim_bridge.simgen.simgen_emulator"]
            + ["--port", "0", "--port-file", str(port_file), "--log-level", "error"]
        )
        try:
            with SimRemoteClient("127.0.0.1", wait_for_port(port_file, emulator)) as client:
                for label, vectors in (("position to jerk", 4), ("all 24 numbers", 8)):
                    times = measure(client, steps, vectors)
                    shown = (times[len(times) // 2], times[len(times) * 99 // 100], times[-1])
                    columns = zip(shown, (8, 17, 9), strict=True)
                    print(
                        f"  {label:<35}", *(f"{1e6 * t:{width}.1f}" for t, width in columns), sep=""
                    )
        finally:
            emulator.terminate()
            emulator.wait()


if __name__ == "__main__":
    main()

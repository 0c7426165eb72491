"""A day of a receiver in orbit, written with known biases and processed by `vtff tec`.

The files are those of an archive: RINEX 2.20 of 8640 epochs with C1, P1 and P2, SP3 of the
satellites and of the spacecraft, DCB files in the form of CODE. Printed are the receiver bias
with its sigma and truth, and the processor time of the command.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it; as the vtff command does.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})
ROOT = pathlib.Path(__file__).resolve().parents[1]
# The day is written by a module of the tests.
sys.path.insert(0, str(ROOT / "test"))

from emulated_day import EPOCHS, EmulatedDay, write_day  # noqa: E402

VTFF = (sys.executable, "-m", "vtff_bringup.cli")
LARGEST_PROCESSOR_TIME = 15.0  # s
LARGEST_SIGMAS = 2.0


def process(day: EmulatedDay, folder: pathlib.Path, *options: pathlib.Path | str) -> float:
    """Run the command; return its processor time, s."""
    command = [
        *VTFF, "tec", day.observations, "--nav", day.orbits, *options, "--out", folder,
    ]  # fmt: skip
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Run the benchmark; return 1 if an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--epochs", type=int, default=EPOCHS, help="of 10 s; default: a day")
    given = parser.parse_args()
    is_good = True
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        day = write_day(folder, given.epochs)
        p1p2, p1c1 = ("--biases", day.biases_p1p2), ("--biases", day.biases_p1c1)
        orbit = ("--orbit", day.own_orbit)
        cases = (
            ("P1-P2, own orbit", (*p1p2, *orbit), day.receiver_p1p2_ns),
            ("P1-P2 and P1-C1, own orbit", (*p1p2, *p1c1, *orbit), day.receiver_c1p2_ns),
            ("P1-P2 and P1-C1, located by codes", (*p1p2, *p1c1), day.receiver_c1p2_ns),
        )
        for number, (title, options, truth) in enumerate(cases):
            out = folder / f"out_{number}"
            seconds = process(day, out, *options)
            (summary,) = json.loads((out / "tec.json").read_text())
            (bias,) = summary["receiver_biases"]
            error = (bias["bias_ns"] - truth) / bias["sigma_ns"]
            is_good &= abs(error) <= LARGEST_SIGMAS and seconds <= LARGEST_PROCESSOR_TIME
            print(
                f"{title}: {bias['pair']} {bias['bias_ns']:.2f} +- {bias['sigma_ns']:.2f} ns, "
                f"truth {truth:.2f} ({error:+.1f} sigma); {summary['good_samples']} samples; "
                f"processor time {seconds:.1f} s"
            )
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())

"""Compile what the nodes of formations calculate with, so that no first run has to.

Each node does this before its first step, which takes half a minute of an idle machine, and minutes
of a busy one, if nothing is there yet. Two processes share the work. Called by tools/setup.sh.
"""

from __future__ import annotations

import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Callable

import numpy as np

CONFIG = pathlib.Path(__file__).resolve().parents[1] / "config"


def compile_estimator() -> None:
    """Compile the relative filter, in orbit and on the ground."""
    from vtff_nav.relative.common.estimator_setting import EstimatorSetting
    from vtff_nav.relative.shipped_estimators import make_cdgps

    for dynamics in ("orbital", "static"):
        make_cdgps(EstimatorSetting(dynamics=dynamics))


def compile_receivers() -> None:
    """Compile the emulated receivers."""
    from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
    from vtff_sim_bridge.simgen.gnss_emulation import compile_kernels

    for name in ("reference", "realistic"):
        compile_kernels(load_gnss_configuration(CONFIG / "gnss" / f"{name}.yaml"))


def compile_truth() -> None:
    """Compile what the true motion needs."""
    from vtff_dynamics.orbit.gravity import gravity_jerks

    gravity_jerks(np.array([[7e6, 0.0, 0.0, 0.0, 7.5e3, 0.0]]), np.zeros(1))


def compile_safety() -> None:
    """Compile the safety monitor."""
    from vtff_control.safety.formation_safety import SafetySetting, compile_kernels

    compile_kernels(SafetySetting())


def compile_controllers() -> None:
    """Compile the controllers."""
    from vtff_control.tracking.feedforward import compile_kernels

    compile_kernels()


def compile_ionosphere() -> None:
    """Compile the ionosphere processor."""
    from vtff_iono.formation_ionosphere import compile_kernels

    compile_kernels()


def compile_recordings() -> None:
    """Compile the reading of recorded observations."""
    from rclpy.serialization import serialize_message

    from vtff_analysis.recordings.observation_recording import recorded_observations
    from vtff_bag.file.metadata import offered_qos
    from vtff_bag.file.reader import BagReader
    from vtff_bag.file.writer import BagWriter
    from vtff_msgs.msg import GnssObservations

    topic, type_name = "/gnss/high_rate", "vtff_msgs/msg/GnssObservations"
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(pathlib.Path(folder) / "bag", {}) as writer:
            number = writer.add_topic(topic, type_name, [offered_qos()], "", "")
            writer.write(number, serialize_message(GnssObservations()), 0)
        recorded_observations(BagReader(f"{folder}/bag"), topic)


SHARES: tuple[tuple[Callable[[], None], ...], ...] = (
    (compile_estimator, compile_safety, compile_controllers, compile_truth),
    (compile_receivers, compile_ionosphere, compile_recordings),
)


def main() -> int:
    """Compile one share, or all of them in a process each; return the exit code."""
    if len(sys.argv) > 1:
        for compile_part in SHARES[int(sys.argv[1])]:
            compile_part()
        return 0
    running = [
        subprocess.Popen([sys.executable, __file__, str(number)]) for number in range(len(SHARES))
    ]
    # A process that a signal has ended has a negative code.
    return int(any([process.wait() for process in running]))


if __name__ == "__main__":
    sys.exit(main())

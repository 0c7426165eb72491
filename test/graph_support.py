"""Running the vtff command in tests, and runs that several tests share."""

from __future__ import annotations

import fcntl
import itertools
import json
import os
import pathlib
import struct
import subprocess
import sys

from rclpy.serialization import deserialize_message

from vtff_bag.file.message_content import have_equal_content
from vtff_bag.file.reader import BagReader
from vtff_msgs.msg import SimulatorStatus, StepDone

ROOT = pathlib.Path(__file__).resolve().parents[1]
SYSTEMS = ROOT / "config" / "system"


def run_vtff(*arguments: object, timeout: float = 240.0) -> subprocess.CompletedProcess[str]:
    """Run the vtff command as a user would and return what it printed."""
    return subprocess.run(
        [sys.executable, "-m", "vtff_bringup.cli", *map(str, arguments)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout,
        env={**os.environ, "COLUMNS": "200"},
    )


#: Scenario time, s, and command line of the flights that compare bytes of receivers. The referee
#: decoder reads ephemerides from RAWEPHEM only.
RECEIVER_FLIGHT_DURATION = 20
RECEIVER_COMMANDS = [
    "UNLOGALL THISPORT TRUE",
    "LOG THISPORT RANGEB ONTIME 0.05",
    "LOG THISPORT RAWEPHEMB ONCHANGED",
    "LOG THISPORT BESTXYZB ONTIME 1",
    "LOG THISPORT TIMEB ONTIME 1",
]
RECEIVER_FLIGHT = (
    "--duration",
    RECEIVER_FLIGHT_DURATION,
    "receiver_driver.publish_raw:=true",
    f"receiver_driver.commands:={RECEIVER_COMMANDS}",
)


class Runs:
    """Makes runs on demand and remembers them, for all processes of one test session.

    Parameters
    ----------
    folder
        Folder that the processes of this session share; each run gets a folder in it.

    """

    def __init__(self, folder: pathlib.Path) -> None:
        self._folder = folder
        folder.mkdir(exist_ok=True)

    def make(
        self, name: str, system: str, *arguments: object
    ) -> tuple[pathlib.Path, subprocess.CompletedProcess[str]]:
        """Return folder and result of a run; the same name gives the same run."""
        folder, made = self._folder / name, self._folder / f"{name}.made"
        command = ["run", str(SYSTEMS / system), *map(str, arguments)]
        # Another process that wants the same run waits here until it is made.
        with (self._folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not made.exists():
                result = run_vtff(*command, "--out", folder)
                assert result.returncode == 0, result.stdout + result.stderr
                made.write_text(json.dumps([command, result.stdout, result.stderr]))
        first_command, output, errors = json.loads(made.read_text())
        assert command == first_command, f"two different runs have the name {name}"
        return folder, subprocess.CompletedProcess(command, 0, output, errors)


#: Topics that tell of wall time or of the machine.
EXCEPTED = {"/diagnostics", "/rosout"}

#: Bytes of wall time in otherwise compared messages: StepDone.compute_time, and
#: SimulatorStatus.real_time_factor and wall_lag, which stand side by side.
WALL_TIME_FIELDS = {"/sim/step_done": (StepDone, 4), "/sim/status": (SimulatorStatus, 8)}


def topics(run):
    """Return the names of the topics that two equal runs must have in common."""
    return {name for name in BagReader(run).topics if name not in EXCEPTED}


def without_wall_time(topic, content):
    """Return the bytes of a message with its wall-time fields set to zero."""
    if topic not in WALL_TIME_FIELDS:
        return content
    kind, length = WALL_TIME_FIELDS[topic]
    message = deserialize_message(content, kind)
    if kind is StepDone:
        start = content.rindex(struct.pack("<f", message.compute_time))
    else:
        values = struct.pack("<ff", message.real_time_factor, message.wall_lag)
        start = content.rindex(values)
    return content[:start] + bytes(length) + content[start + length :]


def serialized_topics(run, names, end=None):
    """Return log time and bytes of every message by topic, without wall time.

    Parameters
    ----------
    run
        Run folder.
    names
        Topics.
    end
        Log time from which messages are left out, ns since 1970; None for none.
    """
    by_topic = {name: [] for name in names}
    for raw in BagReader(run).raw_messages(names, end=end):
        if raw.topic == "/sim/step_done" and not _names_step(raw.serialized):
            continue
        content = without_wall_time(raw.topic, bytes(raw.serialized))
        by_topic[raw.topic].append((raw.log_time, content))
    # Several nodes may publish here; only the order of each of them is defined. Their
    # names are compared, because the bytes that align the fields before are what the memory held.
    by_topic.get("/sim/step_done", []).sort(
        key=lambda item: (item[0], deserialize_message(item[1], StepDone).node)
    )
    return by_topic


def _names_step(serialized):
    """Return whether a node has finished a step.

    Before the first one nodes say that they are ready; how often depends on who else is there.
    """
    stamp = deserialize_message(bytes(serialized), StepDone).header.stamp
    return bool(stamp.sec or stamp.nanosec)


def assert_equal_messages(first_run, second_run, names, end=None):
    """Compare two runs topic by topic, byte for byte; return the number of messages.

    Only bytes between fields, which align them, may differ: they are what the memory held.
    """
    first, second = (serialized_topics(run, names, end) for run in (first_run, second_run))
    types = {name: topic.type for name, topic in BagReader(first_run).topics.items()}
    for topic in sorted(names):
        pairs = itertools.zip_longest(first[topic], second[topic], fillvalue=(None, b""))
        for number, ((time, left), (other_time, right)) in enumerate(pairs):
            text = f"{topic}: message {number} differs"
            assert time == other_time, text
            assert have_equal_content(left, right, types[topic]), text
    return sum(map(len, first.values()))

"""Faults for a run that flies: of its processes, its disk, its memory and its clock."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import mmap
import os
import pathlib
import random
import re
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator

import can
from graph_support import ROOT, SYSTEMS

from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import BagReader
from vtff_node.can_bus.connection import open_bus
from vtff_node.executables import executable_path

#: Processes of config/system/reference.yaml: name of the log file -> words of its command line.
PROCESSES = {
    "simgen_emulator": "simgen_emulator",
    "deputy__can_thruster_emulator": "can_thruster_emulator",
    "simgen_bridge": "parameters/simgen_bridge.yaml",
    "chief__receiver_driver": "parameters/chief__receiver_driver.yaml",
    "deputy__receiver_driver": "parameters/deputy__receiver_driver.yaml",
    "deputy__relative_ekf": "parameters/deputy__relative_ekf.yaml",
    "deputy__sdre_controller": "parameters/deputy__sdre_controller.yaml",
    "deputy__thruster": "parameters/deputy__thruster.yaml",
    "formation_safety": "parameters/formation_safety.yaml",
    "bag_recorder": "parameters/bag_recorder.yaml",
}

#: Processes of the same system when its nodes share one, as they do in lockstep by default.
SHARED_PROCESSES = {
    "simgen_emulator": "simgen_emulator",
    "deputy__can_thruster_emulator": "can_thruster_emulator",
    "composed": "composed.json",
    "bag_recorder": "parameters/bag_recorder.yaml",
}

#: Multicast group of the emulated CAN bus: the default of config/system/reference.yaml.
CAN_GROUP = "239.74.163.2"

#: Runs of this test session; a test that fails may leave one flying.
FLIGHTS: list[Flight] = []

#: Makes the main thread of any Python process of the run hang at SIGUSR1; its other threads live.
_HANG_HOOK = """
import signal, time
def _hang(number, frame):
    while True:
        time.sleep(3600)
signal.signal(signal.SIGUSR1, _hang)
"""

_CLOCK_SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* Adds the seconds in a shared file to the clock of the day; the monotonic clock stays. */
static const volatile double *offset;
static int (*real_clock_gettime)(clockid_t, struct timespec *);

__attribute__((constructor)) static void open_offset(void) {
  const char *path = getenv("CLOCK_OFFSET_FILE");
  real_clock_gettime = dlsym(RTLD_NEXT, "clock_gettime");
  int file = path ? open(path, O_RDONLY) : -1;
  if (file < 0) return;
  void *mapped = mmap(0, sizeof(double), PROT_READ, MAP_SHARED, file, 0);
  close(file);
  if (mapped != MAP_FAILED) offset = mapped;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
  if (!real_clock_gettime) real_clock_gettime = dlsym(RTLD_NEXT, "clock_gettime");
  int result = real_clock_gettime(clock, now);
  if (!result && offset && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    now->tv_sec += (time_t)*offset;
  return result;
}

int gettimeofday(struct timeval *now, void *zone) {
  struct timespec precise;
  (void)zone;
  clock_gettime(CLOCK_REALTIME, &precise);
  now->tv_sec = precise.tv_sec;
  now->tv_usec = precise.tv_nsec / 1000;
  return 0;
}

time_t time(time_t *where) {
  struct timespec precise;
  clock_gettime(CLOCK_REALTIME, &precise);
  if (where) *where = precise.tv_sec;
  return precise.tv_sec;
}

/* Waits end at a time of this clock; the kernel knows its own. Otherwise each wait after a jump
   back would return at once, and the program would spin as with no real clock. A time since the
   start of the machine is one of the monotonic clock. */
static const struct timespec *of_kernel(const struct timespec *end, struct timespec *changed) {
  *changed = *end;
  if (offset && end->tv_sec > 1000000000) changed->tv_sec -= (time_t)*offset;
  return changed;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex,
                           const struct timespec *end) {
  static int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
  struct timespec changed;
  /* Without its version this would be the function for condition variables of before 2003. */
  if (!real) real = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
  if (!real) real = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
  return real(condition, mutex, of_kernel(end, &changed));
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const struct timespec *end) {
  static int (*real)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const struct timespec *);
  struct timespec changed;
  if (!real) real = dlsym(RTLD_NEXT, "pthread_cond_clockwait");
  return real(condition, mutex, clock, of_kernel(end, &changed));
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *end) {
  static int (*real)(pthread_mutex_t *, const struct timespec *);
  struct timespec changed;
  if (!real) real = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
  return real(mutex, of_kernel(end, &changed));
}

int sem_timedwait(sem_t *semaphore, const struct timespec *end) {
  static int (*real)(sem_t *, const struct timespec *);
  struct timespec changed;
  if (!real) real = dlsym(RTLD_NEXT, "sem_timedwait");
  return real(semaphore, of_kernel(end, &changed));
}
"""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Outcome of a run: the lines that the user sees, and the files and processes left.

    ``wall_time`` is from the fault to the end of the command in s, ``lost`` the seconds that
    were flown and are not in the bag, ``left`` the processes that outlived the run,
    ``output_after_fault`` the later part of ``output``.
    """

    exit_code: int
    output: str
    wall_time: float
    steps: int
    lost: int
    closed: bool
    left: list[int]
    output_after_fault: str

    @property
    def reason(self) -> str:
        """The line that says why the run ended, without the place of its log."""
        lines = [line for line in self.output.splitlines() if "; log: " in line]
        return lines[-1].partition("; log: ")[0] if lines else ""

    @property
    def details(self) -> str:
        """The first error that a process reported, without name and time of the logger."""
        lines = [line for line in self.output.splitlines() if "[ERROR]" in line]
        return lines[0].partition("[ERROR]")[2].partition("]: ")[2] if lines else ""

    @property
    def remark(self) -> str:
        """How a run that nothing ended went on: completes, or flies until it is interrupted."""
        flies = "the run completes" if self.exit_code == 0 else "the run goes on"
        lines = [line for line in self.output_after_fault.splitlines() if "[WARN]" in line]
        warning = lines[0].partition("[WARN]")[2].partition("]: ")[2] if lines else ""
        return "; ".join(filter(None, (warning, flies)))


class SmallDisk:
    """A file system of a few MB in a mount namespace of its own, which vanishes with `close`.

    Attributes
    ----------
    folder, own_folder
        Its folder for this process, and for processes that are started with `entry`.
    entry
        Words before a command that starts in the namespace.

    Raises
    ------
    OSError
        If this machine does not allow a file system of its own to a process.
    """

    def __init__(self, megabytes: int) -> None:
        mount = f"mount -t tmpfs -o size={megabytes}m tmpfs /mnt"
        self._keeper = subprocess.Popen(
            ["unshare", "-rm", "sh", "-c", f"{mount} && echo mounted && exec cat"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert self._keeper.stdout is not None
        if self._keeper.stdout.readline() != b"mounted\n":
            self.close()
            raise OSError("this machine does not allow a file system of its own to a process")
        self.folder = pathlib.Path(f"/proc/{self._keeper.pid}/root/mnt")
        self.own_folder = pathlib.Path("/mnt")
        target = ["-t", str(self._keeper.pid), "-U", "-m", "--preserve-credentials"]
        self.entry = ["nsenter", *target, f"--wd={ROOT}"]

    def fill(self) -> None:
        """Write a file until the file system is full."""
        with (self.folder / "filler").open("wb", buffering=0) as file:
            with contextlib.suppress(OSError):
                while file.write(bytes(65536)):
                    pass

    def close(self) -> None:
        """End the namespace."""
        self._keeper.communicate()


class Flight:
    """A run in the background whose processes can be disturbed.

    Parameters
    ----------
    folder
        Folder of the test; the run gets a folder in it.
    arguments
        Further arguments of `vtff run`.
    environment
        Further variables of the environment.
    disk
        File system for the folder of the run; None for that of the test.
    distributed
        Whether each node has a process of its own.
    """

    def __init__(
        self,
        folder: pathlib.Path,
        *arguments: object,
        system: str = "reference.yaml",
        environment: dict[str, str] | None = None,
        disk: SmallDisk | None = None,
        distributed: bool = True,
    ) -> None:
        self.run = (folder if disk is None else disk.folder) / "run"
        #: Folder of the run as its processes see it.
        self._own_run = self.run if disk is None else disk.own_folder / "run"
        hook = folder / "hook"
        hook.mkdir(parents=True)
        (hook / "sitecustomize.py").write_text(_HANG_HOOK)
        own = {"COLUMNS": "400", "PYTHONPATH": f"{hook}:{os.environ.get('PYTHONPATH', '')}"}
        self._output = (folder / "output").open("w+")
        self._process = subprocess.Popen(
            [*([] if disk is None else disk.entry), sys.executable, "-m", "vtff_bringup.cli"]
            + ["run", str(SYSTEMS / system), "--distributed" if distributed else "--composed"]
            + [str(argument) for argument in arguments]
            + ["--out", str(self._own_run), "--no-report"],
            cwd=ROOT,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **own, **(environment or {})},
            start_new_session=True,
        )
        self._fault_at = time.monotonic()
        self._output_before_fault = 0
        FLIGHTS.append(self)

    def stop(self) -> None:
        """End a run that the test has left flying, in order if it can be."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(60.0)
        if self._process.poll() is None:
            self._kill(self._children())

    def _kill(self, children: list[int]) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        for number in children:
            with contextlib.suppress(OSError):
                os.killpg(number, signal.SIGKILL)

    def process_id(self, name: str) -> int:
        """Return the process of a name of `PROCESSES`, or of a node of another system."""
        words = {**PROCESSES, **SHARED_PROCESSES}.get(name, f"parameters/{name}.yaml")
        for number in self._children():
            if words in _command_line(number):
                return number
        raise AssertionError(f"{name} does not run: {self.output()}")

    def _children(self) -> list[int]:
        children = []
        for path in pathlib.Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                fields = path.read_text().rpartition(")")[2].split()
                if int(fields[1]) == self._process.pid and fields[0] != "Z":
                    children.append(int(path.parent.name))
        return children

    def output(self) -> str:
        """Return what the command has printed so far."""
        return pathlib.Path(self._output.name).read_text()

    def wait_for_steps(self, size: int = 250_000, timeout: float = 180.0) -> None:
        """Wait until the bag has grown by a number of bytes: the loop turns."""
        first = self._recorded_bytes()
        deadline = time.monotonic() + timeout
        while self._recorded_bytes() < first + size:
            assert self._process.poll() is None, self.output()
            assert time.monotonic() < deadline, f"nothing is recorded: {self.output()}"
            time.sleep(0.05)

    def wait_for_output(self, text: str, timeout: float = 120.0) -> None:
        """Wait until the command has printed a text."""
        deadline = time.monotonic() + timeout
        while text not in self.output():
            assert self._process.poll() is None and time.monotonic() < deadline, self.output()
            time.sleep(0.05)

    def _recorded_bytes(self) -> int:
        with contextlib.suppress(OSError):
            return sum(path.stat().st_size for path in (self.run / "bag").glob("*.mcap"))
        return 0

    @contextlib.contextmanager
    def fault(self) -> Iterator[Flight]:
        """Note when the fault begins."""
        self._output_before_fault = len(self.output())
        self._fault_at = time.monotonic()
        yield self

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a process."""
        os.kill(self.process_id(name), number)

    def limit(self, name: str, kind: int, value: int) -> None:
        """Set a resource limit of a process."""
        resource.prlimit(self.process_id(name), kind, (value, value))

    def memory(self, name: str) -> int:
        """Return the size of the address space of a process in bytes."""
        statm = pathlib.Path(f"/proc/{self.process_id(name)}/statm").read_text()
        return int(statm.split()[0]) * mmap.PAGESIZE

    def end(self, timeout: float = 180.0, interrupts: bool = False) -> Outcome:
        """Wait for the end of the run and return what became of it."""
        started = self._children()
        if interrupts:
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(timeout)
            wall_time = time.monotonic() - self._fault_at
        finally:
            if self._process.poll() is None:
                self._kill(started)
        left = [n for n in started if _is_alive(n) and str(self._own_run) in _command_line(n)]
        steps, lost, closed = self._recorded()
        output = self.output()
        return Outcome(
            exit_code=self._process.returncode,
            output=output,
            wall_time=wall_time,
            steps=steps,
            lost=lost,
            closed=closed,
            left=left,
            output_after_fault=output[self._output_before_fault :],
        )

    def _recorded(self) -> tuple[int, int, bool]:
        """Return the steps in the bag, the seconds missing in it, and whether it was closed."""
        try:
            reader = BagReader(self.run)
            times = [message.log_time for message in reader.raw_messages(["/clock"])]
        except BagError as error:
            raise AssertionError(f"the bag is not readable: {error}; {self.output()}") from error
        steps = flown = len(times)
        step = (times[-1] - times[0]) / (steps - 1) / 1e9 if steps > 1 else 1.0  # s
        for path in (self.run / "nodes").glob("*.json"):
            with contextlib.suppress(json.JSONDecodeError):  # it was cut by a full disk
                flown = max(flown, json.loads(path.read_text())["published"].get("/clock", 0))
        # The last report of progress counts where that file is missing.
        printed = re.findall(r"^(\d+) s of scenario in", self.output(), re.MULTILINE)
        flown = max([flown, *(int(int(seconds) / step) for seconds in printed)])
        return steps, math.ceil((flown - steps) * step), reader.complete


def _command_line(number: int) -> str:
    with contextlib.suppress(OSError):
        content = pathlib.Path(f"/proc/{number}/cmdline").read_bytes()
        return content.replace(b"\0", b" ").decode(errors="replace")
    return ""


def _is_alive(number: int) -> bool:
    with contextlib.suppress(OSError):
        return " Z " not in pathlib.Path(f"/proc/{number}/stat").read_text()
    return False


class ClockShim:
    """A clock of the day that can jump, for the processes of one run only.

    Parameters
    ----------
    folder
        Folder for the library, which the C compiler of the machine makes, and for the offset.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        compiler = shutil.which("cc")
        assert compiler is not None
        (folder / "clock.c").write_text(_CLOCK_SHIM)
        library, self._offset = folder / "clock.so", folder / "offset"
        subprocess.run(
            [compiler, "-shared", "-fPIC", "-O1", "-o", library, folder / "clock.c", "-ldl"],
            check=True,
        )
        self._offset.write_bytes(struct.pack("d", 0.0))
        self.environment = {"LD_PRELOAD": str(library), "CLOCK_OFFSET_FILE": str(self._offset)}

    def jump(self, seconds: float) -> None:
        """Set the clock of the day forward or back."""
        with self._offset.open("r+b") as file:
            file.write(struct.pack("d", seconds))


class Link:
    """A link between two programs that can be cut, disturbed and delayed.

    Parameters
    ----------
    target
        TCP port of this machine, or the path of a serial port.
    """

    def __init__(self, target: int | pathlib.Path) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._noise = 0.0
        self._delay = 0.0
        self._ends: list[int] = []
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near = self._listener.accept()[0].detach()
                far = self._open_target()
                self._ends += [near, far]
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=pair, daemon=True).start()

    def _open_target(self) -> int:
        if isinstance(self._target, int):
            return socket.create_connection(("127.0.0.1", self._target)).detach()
        descriptor = os.open(self._target, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(descriptor)
        return descriptor

    def _carry(self, source: int, sink: int) -> None:
        generator = random.Random(0)
        with contextlib.suppress(OSError):
            while content := os.read(source, 65536):
                time.sleep(self._delay)
                if self._noise:
                    changed = bytearray(content)
                    for _ in range(max(1, int(len(changed) * self._noise))):
                        changed[generator.randrange(len(changed))] = generator.randrange(256)
                    content = bytes(changed)
                while content:
                    content = content[os.write(sink, content) :]

    def cut(self) -> None:
        """End the connection and refuse further ones."""
        self._listener.close()
        for descriptor in self._ends:
            with contextlib.suppress(OSError):
                socket.socket(fileno=os.dup(descriptor)).shutdown(socket.SHUT_RDWR)
        self._noise, self._delay = 0.0, 3600.0

    def noise(self) -> None:
        """Change one byte of fifty from now on."""
        self._noise = 0.02

    def delay(self) -> None:
        """Hold back what is carried by a fifth of a second."""
        self._delay = 0.2


class CanLink:
    """Two CAN buses of this machine whose frames are carried over until they are disturbed.

    Attributes
    ----------
    ports
        UDP ports of the two buses, in the default group.
    """

    def __init__(self) -> None:
        self.ports = (_free_udp_port(), _free_udp_port())
        self._noise = self._is_cut = False
        self._delay = 0.0
        self._buses = [open_bus("udp_multicast", CAN_GROUP, port) for port in self.ports]
        # A bus of udp_multicast hears what it has sent itself: that is not carried back.
        self._sent: dict[can.BusABC, list[bytes]] = {bus: [] for bus in self._buses}
        self._stop = threading.Event()
        near, far = self._buses
        self._threads = [
            threading.Thread(target=self._carry, args=pair, daemon=True)
            for pair in ((near, far), (far, near))
        ]
        for thread in self._threads:
            thread.start()

    def _carry(self, source: can.BusABC, sink: can.BusABC) -> None:
        generator = random.Random(0)
        while not self._stop.is_set():
            frame = source.recv(0.1)
            if frame is None or self._is_cut:
                continue
            if bytes(frame.data) in self._sent[source]:
                self._sent[source].remove(bytes(frame.data))
                continue
            time.sleep(self._delay)
            if self._noise and generator.random() < 0.5:
                frame.data[generator.randrange(len(frame.data))] = generator.randrange(256)
            self._sent[sink].append(bytes(frame.data))
            sink.send(frame)

    def cut(self) -> None:
        """Carry nothing from now on."""
        self._is_cut = True

    def noise(self) -> None:
        """Change one byte in half of the frames from now on."""
        self._noise = True

    def delay(self) -> None:
        """Hold back each frame by a fifth of a second."""
        self._delay = 0.2

    def close(self) -> None:
        """End both buses."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for bus in self._buses:
            bus.shutdown()


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class EmulatedThruster:
    """The thruster as a program of the test, on a CAN bus that can be disturbed."""

    def __init__(self) -> None:
        self.link = CanLink()
        near, far = self.link.ports
        self.arguments = ("thruster:=hardware", f"deputy_can_port:={near}")
        self._process = subprocess.Popen(
            [str(executable_path("vtff_sim_bridge", "can_thruster_emulator"))]
            + ["--dbc", str(ROOT / "config/can/vtff_thruster.dbc"), "--port", str(far)]
            + ["--channel", CAN_GROUP, "--clock", "lockstep", "--log-level", "warning"]
        )

    def __enter__(self) -> EmulatedThruster:
        return self

    def __exit__(self, *_: object) -> None:
        _end(self._process)
        self.link.close()


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class EmulatedUnit:
    """SimGEN and the receivers as programs of the test, with links that can be disturbed.

    Parameters
    ----------
    folder
        Folder of the test.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        ports = folder / "ports"
        ports.mkdir()
        with socket.create_server(("127.0.0.1", 0)) as free:
            port: int = free.getsockname()[1]
        self._process = subprocess.Popen(
            [str(executable_path("vtff_sim_bridge", "simgen_emulator")), "--port", str(port)]
            + ["--vehicles", "v1_m1", "v2_m1", "--clock", "lockstep", "--log-level", "warning"]
            + ["--gnss", str(ROOT / "config/gnss/reference.yaml"), "--seed", "1"]
            + ["--port-link-directory", str(ports)]
        )
        deadline = time.monotonic() + 60.0
        while not (ports / "deputy").exists():
            assert time.monotonic() < deadline and self._process.poll() is None
            time.sleep(0.05)
        self.links = {"simremote": Link(port), "chief": Link(ports / "chief")}
        self.arguments = (
            "simgen_host:=127.0.0.1",
            f"simgen_port:={self.links['simremote'].port}",
            f"chief_port:=tcp://127.0.0.1:{self.links['chief'].port}",
            f"deputy_port:=serial://{ports / 'deputy'}",
        )

    def __enter__(self) -> EmulatedUnit:
        return self

    def __exit__(self, *_: object) -> None:
        _end(self._process)

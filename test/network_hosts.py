"""Hosts of a network made of Linux namespaces, with a relay that loses, delays and cuts.

Each host has its own network namespace with one interface, its own /dev/shm and its own
/etc/machine-id, so that neither shared memory nor the name of the machine can stand for the
network. All interfaces lead into one namespace, the hub: joined by a bridge, or by a relay process
(`network_relay.py`) that forwards frames with loss and delay and cuts links on request.
"""

from __future__ import annotations

import functools
import pathlib
import shutil
import subprocess
import sys
import uuid
from collections.abc import Sequence

RELAY = pathlib.Path(__file__).with_name("network_relay.py")
OFFLOAD = pathlib.Path(__file__).with_name("network_offload.py")
PREFIX = "10.24.0"
PATIENCE = 20.0  # s for a namespace to be made

#: What the first process of a host does: hide what namespaces share, then wait for its end.
_HOST = """
set -e
mount -t tmpfs tmpfs /dev/shm
mount --bind {machine_id} /etc/machine-id
ip link set lo up
echo ready
exec cat
"""


@functools.cache
def why_no_hosts() -> str:
    """Return why this machine cannot make hosts; empty if it can."""
    for program in ("unshare", "nsenter", "ip"):
        if shutil.which(program) is None:
            return f"hosts need the program {program}"
    try:
        with NetworkHosts(2) as hosts:
            ping = hosts.popen(0, [sys.executable, "-c", _REACH, hosts.address(1)])
            output = ping.communicate(timeout=PATIENCE)[0]
    except (OSError, subprocess.SubprocessError) as error:
        return f"no namespaces can be made: {' '.join(str(error).split())}"
    return "" if ping.returncode == 0 else f"namespaces do not reach each other: {output.strip()}"


# A port on which nobody listens refuses: the other host has answered.
_REACH = """
import socket, sys
try:
    socket.create_connection((sys.argv[1], 9), timeout=5.0)
except ConnectionRefusedError:
    pass
"""


class NetworkHosts:
    """A network of hosts with the addresses 10.24.0.1, .2, ...; a context manager.

    Parameters
    ----------
    count
        Number of hosts.
    loss, delay, jitter
        Fate of the frames that the relay forwards: share that is lost, mean delay and its largest
        deviation, s. With all zero and `cuts` unset, a bridge joins the hosts.
    cuts
        Whether links can be cut.
    seed
        Seed of loss and delay.
    """

    def __init__(
        self,
        count: int,
        *,
        loss: float = 0.0,
        delay: float = 0.0,
        jitter: float = 0.0,
        cuts: bool = False,
        seed: int = 1,
    ) -> None:
        self.count = count
        self._relay_settings = (loss, delay, jitter, seed) if loss or delay or cuts else None
        self._processes: list[subprocess.Popen[str]] = []
        self._hub: subprocess.Popen[str] | None = None
        self._relay: subprocess.Popen[str] | None = None
        self._holders: list[subprocess.Popen[str]] = []

    def __enter__(self) -> NetworkHosts:
        """Make the namespaces and join them."""
        try:
            self._make()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End everything that runs in the hosts."""
        self.close()

    def address(self, number: int) -> str:
        """Return the address of a host, counted from 0."""
        return f"{PREFIX}.{number + 1}"

    def popen(
        self, number: int, command: Sequence[object], **arguments: object
    ) -> subprocess.Popen[str]:
        """Start a program in a host; arguments as for `subprocess.Popen`."""
        return self._start(self._holders[number], command, **arguments)

    def cut(self, number: int) -> None:
        """Cut the link of a host: nothing passes in either direction."""
        self._command_relay(f"cut {number}")

    def join(self, number: int) -> None:
        """Put the link of a host together again."""
        self._command_relay(f"join {number}")

    def close(self) -> None:
        """Kill what still runs in the hosts, and the hosts."""
        for process in reversed(self._processes):
            process.kill()
        for process in self._processes:
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    stream.close()
        self._processes.clear()

    def _make(self) -> None:
        self._hub = self._hold(["unshare", "--user", "--map-root-user", "--net", "--mount"], "")
        self._run_in_hub("ip link set lo up")
        for number in range(self.count):
            machine_id = f"/tmp/vtff_host_{uuid.uuid4().hex}"
            pathlib.Path(machine_id).write_text(uuid.uuid4().hex + "\n", encoding="ascii")
            inner = ["unshare", "--net", "--mount", "--propagation", "private"]
            try:
                holder = self._hold(
                    [*self._enter(self._hub), *inner], _HOST.format(machine_id=machine_id)
                )
            finally:
                pathlib.Path(machine_id).unlink()
            self._holders.append(holder)
            name = f"host{number}"
            self._run_in_hub(
                f"ip link add {name} type veth peer name eth0 netns {holder.pid}\n"
                f"ip link set {name} up\n"
            )
            self._run(
                holder,
                f"ip address add {self.address(number)}/24 dev eth0\nip link set eth0 up\n"
                f"{sys.executable} {OFFLOAD} eth0",
            )
        names = [f"host{number}" for number in range(self.count)]
        if self._relay_settings is None:
            joins = "\n".join(f"ip link set {name} master joint" for name in names)
            self._run_in_hub(f"ip link add joint type bridge\nip link set joint up\n{joins}")
            return
        settings = [str(value) for value in self._relay_settings]
        self._relay = self._start(
            self._hub,
            [sys.executable, RELAY, *settings, *names],
            stdin=subprocess.PIPE,
        )
        assert self._relay.stdout is not None
        if self._relay.stdout.readline() != "ready\n":
            raise OSError(f"the relay did not start: {self._relay.stdout.read()}")

    def _hold(self, command: Sequence[str], script: str) -> subprocess.Popen[str]:
        """Start a process that keeps namespaces; return it when it has made them."""
        holder = subprocess.Popen(
            [*command, "sh", "-c", script or "echo ready; exec cat"],
            stdin=subprocess.PIPE,  # it ends when this process is gone
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._processes.append(holder)
        assert holder.stdout is not None
        line = holder.stdout.readline()
        if line != "ready\n":
            raise OSError(f"{' '.join(command)}: {line.strip()}")
        return holder

    def _enter(self, holder: subprocess.Popen[str]) -> list[str]:
        return [
            "nsenter", "--target", str(holder.pid), "--user", "--net", "--mount",
            "--preserve-credentials",
        ]  # fmt: skip

    def _start(
        self, holder: subprocess.Popen[str], command: Sequence[object], **arguments: object
    ) -> subprocess.Popen[str]:
        settings: dict[str, object] = {
            "stdin": subprocess.DEVNULL,
            "stdout": subprocess.PIPE,
            "stderr": subprocess.STDOUT,
            "text": True,
            **arguments,
        }
        process: subprocess.Popen[str] = subprocess.Popen(  # type: ignore[call-overload]
            [*self._enter(holder), *map(str, command)], **settings
        )
        self._processes.append(process)
        return process

    def _run(self, holder: subprocess.Popen[str], script: str) -> None:
        process = self._start(holder, ["sh", "-e", "-c", script])
        output = process.communicate(timeout=PATIENCE)[0]
        if process.returncode:
            raise OSError(f"{script.strip()}: {output.strip()}")

    def _run_in_hub(self, script: str) -> None:
        assert self._hub is not None
        self._run(self._hub, script)

    def _command_relay(self, command: str) -> None:
        assert self._relay is not None and self._relay.stdin is not None
        self._relay.stdin.write(f"{command}\n")
        self._relay.stdin.flush()
        assert self._relay.stdout is not None
        assert self._relay.stdout.readline() == f"{command}\n"

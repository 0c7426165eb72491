"""Receivers as observers of the scenario machine: several runs, real time, and what is refused."""

from __future__ import annotations

import os
import socket
import tty
from pathlib import Path

import gnss_emulator_support as support
import pytest

from vtff_sim_bridge.simgen.emulator_state import ScenarioMachine
from vtff_sim_bridge.simgen.gnss_emulation import GnssEmulation
from vtff_sim_bridge.simgen.simgen_emulator import _gnss_emulation, _parser, main

LOG = b"LOG RANGEB ONTIME 0.05\r\n"


def started(machine: ScenarioMachine, motions) -> None:
    for line in ("SC,a.scn", "START_TIME,21-MAR-2016 01:00:00,00:01:00"):
        reply = machine.execute(line)
        assert reply is not None and reply.error_text is None
    for vehicle, state in zip(support.VEHICLES, motions[0], strict=True):
        machine.command_motion(vehicle, 0, state)
    reply = machine.execute("RU")
    assert reply is not None and reply.error_text is None


def opened(path: Path, emulation: GnssEmulation) -> int:
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(descriptor)
    os.write(descriptor, LOG)
    emulation.process()
    return descriptor


def read_all(descriptor: int, emulation: GnssEmulation) -> bytes:
    content = b""
    while True:
        emulation.process()
        try:
            part = os.read(descriptor, 65536)
        except BlockingIOError:
            return content
        content += part


def test_two_runs_give_the_same_bytes(tmp_path):
    """The receivers are switched off and on between runs: the driver opens the port again."""
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 3)
    machine = ScenarioMachine(support.VEHICLES)
    emulation = GnssEmulation(machine, support.configuration(), tmp_path)
    runs = []
    for _ in range(2):
        started(machine, motions)
        descriptor = opened(tmp_path / "deputy", emulation)
        content = b""
        for second in (1, 2, 3):
            for vehicle, state in zip(support.VEHICLES, motions[second], strict=True):
                machine.command_motion(vehicle, second * 10**9, state)
            content += read_all(descriptor, emulation)
        os.close(descriptor)
        machine.execute("-,EN,1")
        runs.append(content[content.index(b"\xaa\x44\x12") :])
    emulation.close()
    assert runs[0] == runs[1]
    assert runs[0].count(b"\xaa\x44\x12\x1c") == 60
    assert not (tmp_path / "deputy").is_symlink()


def test_real_time_gives_the_bytes_of_lockstep(tmp_path, manual_clock):
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 2)
    machine = ScenarioMachine(support.VEHICLES, clock_mode="realtime", monotonic=manual_clock)
    emulation = GnssEmulation(machine, support.configuration(), tmp_path)
    descriptor = opened(tmp_path / "chief", emulation)
    started(machine, motions)
    for vehicle, state in zip(support.VEHICLES, motions[1], strict=True):
        machine.command_motion(vehicle, 10**9, state)
    content = b""
    for _ in range(65):
        manual_clock.sleep(0.03)
        machine.poll()
        content += read_all(descriptor, emulation)
    os.close(descriptor)
    emulation.close()
    inside = support.Run(support.configuration(), motions, LOG).all()
    wanted = bytes(inside.content["chief"])
    received = content[content.index(b"\xaa\x44\x12") :]
    assert len(received) > 0.9 * len(wanted) and wanted.startswith(received)


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_client_that_does_not_read_holds_time_back_in_lockstep_only(
    tmp_path, manual_clock, clock
):
    """As a driver behind a link that is cut: a receiver goes on and loses what is not taken."""
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 20)
    machine = ScenarioMachine(support.VEHICLES, clock_mode=clock, monotonic=manual_clock)
    emulation = GnssEmulation(machine, support.configuration(), tmp_path)
    descriptor = opened(tmp_path / "chief", emulation)
    started(machine, motions)
    for second in range(1, 21):
        for vehicle, state in zip(support.VEHICLES, motions[second], strict=True):
            machine.command_motion(vehicle, second * 10**9, state)
        manual_clock.sleep(1.0)
        machine.poll()
    assert emulation.ports["chief"].is_congested
    assert emulation.is_congested == (clock == "lockstep")
    os.close(descriptor)
    emulation.close()


def test_receivers_listen_on_the_named_ports_of_the_address(tmp_path):
    """On 127.0.0.2 only: the address of a host is not that of the machine's other interfaces."""
    file = support.REPOSITORY / "config" / "gnss" / "noise_free.yaml"
    options = _parser().parse_args(
        ["--host", "127.0.0.2", "--gnss", str(file), "--receiver-ports", "deputy=0", "chief=0"]
    )
    emulation = _gnss_emulation(ScenarioMachine(support.VEHICLES), options)
    try:
        for port in emulation.ports.values():
            assert port.tcp_port
            socket.create_connection(("127.0.0.2", port.tcp_port), timeout=10.0).close()
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", port.tcp_port), timeout=10.0)
    finally:
        emulation.close()


@pytest.mark.parametrize("ports", [["chief=1"], ["chief=1", "deputy=2", "mars=3"]])
def test_ports_for_other_receivers_are_refused(caplog, ports):
    file = support.REPOSITORY / "config" / "gnss" / "noise_free.yaml"
    assert main(["--port", "0", "--gnss", str(file), "--receiver-ports", *ports]) == 2
    assert "--receiver-ports: one for each of chief, deputy" in caplog.text


@pytest.mark.parametrize("text", ["chief", "=7", "chief=x", "chief=70000"])
def test_ports_without_a_name_or_number_are_refused(capsys, text):
    with pytest.raises(SystemExit):
        main(["--receiver-ports", text])
    assert "--receiver-ports" in capsys.readouterr().err


def test_receiver_on_an_unknown_vehicle_is_refused(tmp_path):
    machine = ScenarioMachine(("v1_m1",))
    with pytest.raises(ValueError, match="deputy.*v2_m1"):
        GnssEmulation(machine, support.configuration(), tmp_path)
    assert machine.observers == []


def test_program_refuses_a_missing_file_and_missing_ports(tmp_path, caplog):
    assert main(["--port", "0", "--gnss", str(tmp_path / "no.yaml")]) == 2
    file = support.REPOSITORY / "config" / "gnss" / "noise_free.yaml"
    assert main(["--port", "0", "--gnss", str(file)]) == 2
    assert "no.yaml" in caplog.text and "tcp_port" in caplog.text


def test_program_refuses_values_with_file_and_field(tmp_path, caplog):
    text = (support.REPOSITORY / "config" / "gnss" / "realistic.yaml").read_text()
    file = tmp_path / "wrong.yaml"
    file.write_text(text.replace("stated_sigma_factor: 0.7", "stated_sigma_factor: -0.7"))
    assert main(["--port", "0", "--gnss", str(file)]) == 2
    assert f"{file}: receivers[0].noise: stated_sigma_factor: more than 0" in caplog.text

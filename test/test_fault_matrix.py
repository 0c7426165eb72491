"""Fault matrix: each process, link and resource of a run, and what a user sees when it fails.

The whole matrix is slow; the short form disturbs one flight in several ways. The table in
docs/reliability.md is written by:

    VTFF_FAULT_TABLE=docs/reliability.md python -m pytest test/test_fault_matrix.py -m slow
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import re
import resource
import shutil
import signal
import time

import can
import pytest
from domain_coordinator import domain_id
from fault_injection import (
    CAN_GROUP,
    FLIGHTS,
    PROCESSES,
    SHARED_PROCESSES,
    CanLink,
    ClockShim,
    EmulatedThruster,
    EmulatedUnit,
    Flight,
    Outcome,
    SmallDisk,
)

from vtff_node.can_bus.connection import open_bus

LARGEST_LOSS = 2  # s of scenario that a fault may cost
LARGEST_WALL_TIME = 120.0  # s from a fault to the end of the command: time-out and teardown
PAUSE = 2.0  # s of wall time, less than the time-out of a step
ENDLESS = ("--duration", 100_000)

#: A process that stands still in lockstep is missed by the node that waits for it; one that is
#: stopped is named by the runner, too.
MISSED = {
    "simgen_emulator": ("simgen_bridge", "simgen_emulator"),
    "deputy__relative_ekf": ("/deputy/relative_ekf",),
    "formation_safety": ("thrust on /deputy/propulsion/thrust_applied",),
    "deputy__sdre_controller": ("thruster", "sdre_controller"),
    "deputy__thruster": ("thruster",),
    "chief__receiver_driver": ("/chief/receiver_driver", "/deputy/relative_ekf"),
    "deputy__receiver_driver": ("/deputy/receiver_driver", "/deputy/relative_ekf"),
}

#: The thruster is hardware: when it hangs, its bus is silent.
SILENT = ("deputy__can_thruster_emulator", "hang")

#: A recorder that hangs, which is a case of its own.
HANGING_RECORDER = ("bag_recorder", signal.SIGUSR1)


#: Processes of `reference`, and whether each node has one of its own or all but the recorder share
#: one, as they do in lockstep by default.
SUBJECTS = [(name, True) for name in PROCESSES] + [(name, False) for name in SHARED_PROCESSES]


def name_subject(name: str, distributed: bool) -> str:
    """Return the name of a process in the table."""
    return name if distributed else f"nodes in one process: {name}"


def check(outcome: Outcome, *named: str) -> None:
    """Check what holds for each fault that ends a run."""
    assert outcome.exit_code == 1, outcome.output
    assert any(name in outcome.output for name in named), outcome.output
    assert "Traceback" not in outcome.output
    assert outcome.left == []
    assert outcome.lost <= LARGEST_LOSS
    assert outcome.wall_time < LARGEST_WALL_TIME


def check_interrupted(outcome: Outcome) -> None:
    """Check a run that a fault does not end and that a user then ends."""
    assert outcome.exit_code == 130 and "Traceback" not in outcome.output
    assert outcome.left == [] and outcome.lost <= LARGEST_LOSS and outcome.closed


def check_replaced(outcome: Outcome) -> None:
    """Check a run whose recorder hung: named, and its bag whole by a second one."""
    check(outcome, "bag_recorder has shown no sign of life for 10 s")
    assert "a second recorder has taken the" in outcome.output
    assert outcome.closed and outcome.lost == 0


def check_complete(outcome: Outcome) -> None:
    """Check a run that a fault must not end."""
    assert outcome.exit_code == 0, outcome.output
    assert "Traceback" not in outcome.output
    assert outcome.left == []
    assert outcome.lost == 0 and outcome.closed


@pytest.mark.slow
@pytest.mark.parametrize(("name", "distributed"), SUBJECTS)
def test_kill(name, distributed, tmp_path, fault_table):
    flight = Flight(tmp_path, *ENDLESS, distributed=distributed)
    flight.wait_for_steps()
    with flight.fault():
        flight.send(name, signal.SIGKILL)
    outcome = flight.end()
    fault_table(name_subject(name, distributed), "kill", outcome)
    check(outcome, name.replace("__", "/"), name)
    assert outcome.closed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "distributed", "how"),
    [
        (name, distributed, how)
        for how in ("stop", "hang")
        for name, distributed in SUBJECTS
        if (name, how) not in (SILENT, ("bag_recorder", "hang"))
    ],
)
def test_stand_still(name, distributed, how, tmp_path, fault_table):
    flight = Flight(tmp_path, *ENDLESS, distributed=distributed)
    flight.wait_for_steps()
    with flight.fault():
        flight.send(name, signal.SIGSTOP if how == "stop" else signal.SIGUSR1)
    outcome = flight.end()
    fault_table(name_subject(name, distributed), how, outcome)
    # The pacing node is missed by the runner, when a minute has brought no progress.
    if (name, how) == ("composed", "hang"):
        # The node is named too, unless the signal came between two callbacks.
        assert re.search(r", in _hang\) has not returned for 2\d s", outcome.output)
    check(outcome, *((name,) if how == "stop" else MISSED.get(name, (name,))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pacing", "distributed"), [("lockstep", True), ("lockstep", False), ("realtime", True)]
)
def test_a_recorder_that_hangs_is_replaced(pacing, distributed, tmp_path, fault_table):
    """A second one takes what the nodes hold; in real time nobody but the runner misses it."""
    further = ("--realtime",) if pacing == "realtime" else ()
    flight = Flight(tmp_path, *ENDLESS, *further, distributed=distributed)
    flight.wait_for_steps(size=50_000 if further else 250_000)
    with flight.fault():
        flight.send(*HANGING_RECORDER)
    outcome = flight.end()
    subject = name_subject(HANGING_RECORDER[0], distributed)
    fault_table(subject, f"hang, {pacing}", outcome)
    check_replaced(outcome)


@pytest.mark.slow
@pytest.mark.parametrize("distributed", [True, False])
def test_a_thruster_that_hangs_is_a_silent_one(distributed, tmp_path, fault_table):
    """It costs the thrust, as a cut bus does; the run goes on and says so."""
    flight = Flight(tmp_path, *ENDLESS, distributed=distributed)
    flight.wait_for_steps()
    with flight.fault():
        flight.send(SILENT[0], signal.SIGUSR1)
    flight.wait_for_output("no report from the thruster: zero thrust till then")
    flight.wait_for_steps(size=30_000)
    outcome = flight.end(interrupts=True)
    fault_table(name_subject(SILENT[0], distributed), SILENT[1], outcome)
    check_interrupted(outcome)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "distributed"), SUBJECTS)
def test_pause(name, distributed, tmp_path, fault_table):
    """A process that stands still for less than the time-out goes on; nothing is lost."""
    flight = Flight(tmp_path, "--duration", 60, distributed=distributed)
    flight.wait_for_steps()
    with flight.fault():
        flight.send(name, signal.SIGSTOP)
        time.sleep(PAUSE)
        flight.send(name, signal.SIGCONT)
    outcome = flight.end()
    fault_table(name_subject(name, distributed), f"pause of {PAUSE:g} s", outcome)
    check_complete(outcome)
    assert outcome.steps == 61


@pytest.mark.slow
@pytest.mark.parametrize("link", ["simremote", "chief"])
@pytest.mark.parametrize("how", ["cut", "noise", "delay"])
def test_link(link, how, tmp_path, fault_table):
    with EmulatedUnit(tmp_path) as unit:
        flight = Flight(tmp_path, *ENDLESS, *unit.arguments)
        flight.wait_for_steps()
        with flight.fault():
            getattr(unit.links[link], how)()
        goes_on = how == "delay" or (link, how) == ("chief", "noise")
        if how == "noise" and goes_on:
            # A receiver that is not understood is one without satellites: no thrust, no end.
            flight.wait_for_output("chief.receiver_driver]: tcp://")
        if goes_on:
            flight.wait_for_steps(size=30_000)
            outcome = flight.end(interrupts=True)
        else:
            outcome = flight.end()
    fault_table(f"link {link}", how, outcome)
    if goes_on:
        check_interrupted(outcome)
    else:
        check(outcome, "simgen_bridge", "receiver_driver")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["cut", "noise", "delay"])
def test_can_link(how, tmp_path, fault_table):
    """The thruster's bus costs commands or time, never the run; a silent thruster is named."""
    with EmulatedThruster() as thruster:
        flight = Flight(tmp_path, *ENDLESS, *thruster.arguments)
        flight.wait_for_steps()
        with flight.fault():
            getattr(thruster.link, how)()
        if how == "cut":
            flight.wait_for_output("no report from the thruster: zero thrust till then")
        flight.wait_for_steps(size=30_000)
        outcome = flight.end(interrupts=True)
    fault_table("link can", how, outcome)
    check_interrupted(outcome)


_SILENT_MODULE = "nothing from the ADCS module: rods off, wheel held"

#: Nodes of other systems, with what is said of each when it stands still.
FURTHER_NODES = {
    ("snap1", "snap1__adcs_emulator"): _SILENT_MODULE,
    ("snap1", "snap1__adcs_can"): "adcs_can",
    ("snap1", "snap1__attitude_estimator"): "/snap1/adcs_can",
    ("snap1", "snap1__attitude_controller"): "/snap1/adcs_can",
    ("reference_attitude", "deputy__adcs_emulator"): _SILENT_MODULE,
    ("reference_attitude", "deputy__adcs_can"): "adcs_can",
    ("reference_attitude", "deputy__attitude_estimator"): "/deputy/adcs_can",
    ("reference_attitude", "deputy__attitude_controller"): "/deputy/adcs_can",
    ("reference_attitude", "deputy__thrust_allocation"): "thrust_allocation",
    ("fflas_software", "formation_guidance"): "formation_guidance",
}


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "stop", "hang"])
@pytest.mark.parametrize(("system", "name"), FURTHER_NODES)
def test_a_node_of_another_system(system, name, how, tmp_path, fault_table):
    settings = ("simgen_bridge.step_timeout:=15",) if system == "fflas_software" else ()
    flight = Flight(tmp_path, *settings, *ENDLESS, system=f"{system}.yaml")
    flight.wait_for_steps(size=50_000)
    signals = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "hang": signal.SIGUSR1}
    with flight.fault():
        flight.send(name, signals[how])
    said = FURTHER_NODES[system, name] if how == "hang" else name
    goes_on = how == "hang" and name.endswith("adcs_emulator")  # the module is hardware
    if goes_on:
        flight.wait_for_output(said)
    outcome = flight.end(interrupts=goes_on)
    fault_table(f"{system}: {name}", how, outcome)
    if goes_on:
        check_interrupted(outcome)
    else:
        check(outcome, said)
        assert outcome.closed


@pytest.mark.slow
@pytest.mark.parametrize("how", ["cut", "noise", "delay"])
def test_the_link_to_an_adcs_module(how, tmp_path, fault_table):
    """It costs reports and commands, which is said, or time; never the run."""
    with contextlib.closing(CanLink()) as link:
        near, far = link.ports
        ports = (f"can_port:={near}", f"adcs_emulator.port:={far}", f"can_channel:={CAN_GROUP}")
        flight = Flight(tmp_path, *ports, *ENDLESS, system="snap1.yaml")
        flight.wait_for_steps(size=50_000)
        with flight.fault():
            getattr(link, how)()
        if how != "delay":
            flight.wait_for_output(_SILENT_MODULE)
        flight.wait_for_steps(size=10_000)
        outcome = flight.end(interrupts=True)
    fault_table("snap1: link can", how, outcome)
    check_interrupted(outcome)


def test_the_can_link_of_the_matrix_carries_cuts_and_disturbs():
    with contextlib.closing(CanLink()) as link, contextlib.ExitStack() as stack:
        near, far = (
            stack.enter_context(open_bus("udp_multicast", CAN_GROUP, port)) for port in link.ports
        )

        def is_carried(number, source, sink):
            """Send a frame; return whether it arrives at the other bus, or its changed form."""
            data = bytes([number] * 8)
            source.send(can.Message(arbitration_id=0x123, data=data, is_extended_id=False))
            assert bytes(source.recv(10.0).data) == data  # a bus hears what it sends
            frame = sink.recv(0.3)
            return None if frame is None else bytes(frame.data) == data

        assert is_carried(1, near, far) and is_carried(2, far, near)
        assert near.recv(0.2) is None and far.recv(0.2) is None  # nothing comes back or twice
        link.noise()
        unchanged = [is_carried(number, far, near) for number in range(10, 30)]
        assert None not in unchanged and 3 <= sum(unchanged) <= 17
        link.cut()
        assert is_carried(3, near, far) is None
        assert is_carried(4, far, near) is None


@pytest.mark.slow
def test_full_disk(tmp_path, fault_table):
    try:
        disk = SmallDisk(40)
    except OSError as error:
        pytest.skip(str(error))
    with contextlib.closing(disk):
        flight = Flight(tmp_path, *ENDLESS, disk=disk)
        flight.wait_for_steps()
        with flight.fault():
            disk.fill()
        outcome = flight.end()
    fault_table("disk of the run", "full", outcome)
    check(outcome, "bag_recorder", "simgen_emulator")
    assert outcome.closed
    assert outcome.output.splitlines()[-1].startswith("the disk is full: ")


@pytest.mark.slow
def test_no_memory(tmp_path, fault_table):
    flight = Flight(tmp_path, *ENDLESS)
    flight.wait_for_steps()
    with flight.fault():
        flight.limit(
            "deputy__relative_ekf", resource.RLIMIT_AS, flight.memory("deputy__relative_ekf")
        )
        # What is left to the process may last for ever: an allocation that fails ends it.
        time.sleep(PAUSE)
        flight.send("deputy__relative_ekf", signal.SIGKILL)
    outcome = flight.end()
    fault_table("memory of relative_ekf", "none left, then killed", outcome)
    check(outcome, "deputy__relative_ekf")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("pacing", ["lockstep", "realtime"])
@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_clock_of_the_day_jumps(jump, pacing, tmp_path, fault_table):
    """Neither the scenario nor its pacing depends on the clock of the day."""
    shim = ClockShim(tmp_path)
    further = ("--realtime",) if pacing == "realtime" else ()
    duration = 20 if pacing == "realtime" else 60
    flight = Flight(tmp_path, "--duration", duration, *further, environment=shim.environment)
    flight.wait_for_steps()
    with flight.fault():
        shim.jump(jump)
    outcome = flight.end()
    fault_table("clock", f"{jump:+.0f} s, {pacing}", outcome)
    check_complete(outcome)


@pytest.mark.slow
def test_restart(tmp_path, fault_table):
    """A run begins at once after one whose node was killed, on the same domain."""
    with domain_id() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain)}
        first = Flight(tmp_path / "first", *ENDLESS, environment=environment)
        first.wait_for_steps()
        with first.fault():
            first.send("deputy__relative_ekf", signal.SIGKILL)
        check(first.end(), "deputy__relative_ekf")
        second = Flight(tmp_path / "second", "--duration", 5, environment=environment)
        outcome = second.end()
    fault_table("run after a killed node", "restart", outcome)
    check_complete(outcome)


def test_one_flight_is_disturbed_in_several_ways(tmp_path):
    """The short form: pauses that a run survives, then a node that is killed.

    A killed recorder is in test_graph_failures, one that hangs in the slow tests above.
    """
    flight = Flight(tmp_path, *ENDLESS, system="reference_software.yaml")
    flight.wait_for_steps()
    for name in ("deputy__sdre_controller", "simgen_emulator", "bag_recorder"):
        flight.send(name, signal.SIGSTOP)
        time.sleep(0.5)
        flight.send(name, signal.SIGCONT)
        flight.wait_for_steps(size=20_000)
    with flight.fault():
        flight.send("deputy__sdre_controller", signal.SIGKILL)
    outcome = flight.end()
    check(outcome, "deputy__sdre_controller")
    assert outcome.steps > 20


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_jump_of_the_clock_of_the_day_does_not_touch_real_time_pacing(tmp_path):
    shim = ClockShim(tmp_path)
    flight = Flight(
        tmp_path,
        *("--realtime", "--duration", 6),
        system="reference_software.yaml",
        environment=shim.environment,
    )
    # Before the first step the processes discover each other; a jump back then can keep messages
    # or nodes from being discovered, see docs/reliability.md.
    flight.wait_for_output("1 / 6 s")
    with flight.fault():
        shim.jump(-3600.0)
    outcome = flight.end()
    check_complete(outcome)


@pytest.fixture(autouse=True)
def no_flight_is_left():
    """End the runs that a failed test has left flying."""
    yield
    while FLIGHTS:
        FLIGHTS.pop().stop()


@pytest.fixture
def fault_table():
    """Return a function that adds a row to the table of the page that VTFF_FAULT_TABLE names."""
    page = os.environ.get("VTFF_FAULT_TABLE")

    def add(subject: str, fault: str, outcome: Outcome) -> None:
        if page is None:
            return
        cells = [
            subject.replace("__", "/"),
            fault,
            "; ".join(filter(None, (outcome.reason, outcome.details))) or outcome.remark,
            f"{outcome.wall_time:.0f} s",
            f"{outcome.lost} s",
            "closed" if outcome.closed else "readable, not closed",
            str(outcome.exit_code),
        ]
        add_row(pathlib.Path(page), cells)

    return add


START, END = "<!-- fault matrix: begin -->", "<!-- fault matrix: end -->"


def add_row(page: pathlib.Path, cells: list[str]) -> None:
    """Put a row into the table of the page, in place of the one of the same fault."""
    before, _, rest = page.read_text(encoding="utf-8").partition(START)
    table, _, after = rest.partition(END)
    key = f"| {cells[0]} | {cells[1]} |"
    rows = [line for line in table.strip().splitlines() if not line.startswith(key)]
    rows.append(f"| {' | '.join(cells)} |")
    text = "\n".join([*rows[:2], *sorted(rows[2:])])
    page.write_text(f"{before}{START}\n{text}\n{END}{after}", encoding="utf-8")


def test_a_row_of_the_table_replaces_the_one_of_its_fault(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        f"# Title\n{START}\n| a | b | c |\n|---|---|---|\n| x | y | old |\n{END}\nrest\n"
    )
    add_row(page, ["x", "y", "new"])
    add_row(page, ["w", "y", "other"])
    assert page.read_text() == (
        f"# Title\n{START}\n| a | b | c |\n|---|---|---|\n| w | y | other |\n| x | y | new |\n"
        f"{END}\nrest\n"
    )

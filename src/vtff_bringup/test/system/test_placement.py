"""Hosts of a system file, and what runs on which."""

from __future__ import annotations

import pytest

from vtff_bringup.hosts.take_part import check_host
from vtff_bringup.run.runner import Runner
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.placement import DEFAULT_CONTROL_PORT
from vtff_bringup.system.system_file import find_system_file, load_system

SYSTEM = """
arguments:
  other: {default: 192.0.2.2, description: address of the other host}
  placed: {default: other, description: where the helper runs}
hosts: {main: 192.0.2.1, other: "${other}", third: ""}
processes:
  - name: helper
    package: vtff_test
    executable: helper
    host: ${placed}
    arguments: [--host, "${hosts.${placed}}", --port, "${free_port}"]
nodes:
  - {package: vtff_test, executable: source, ends_run: true, host: main}
  - {package: vtff_test, executable: sink, host: other}
  - {package: vtff_test, executable: filter}
"""


def load(tmp_path, text=SYSTEM, *overrides):
    path = tmp_path / "two.yaml"
    path.write_text(text)
    return load_system(path, overrides)


def test_the_host_of_the_node_that_ends_the_run_is_the_main_one(tmp_path):
    system = load(tmp_path)
    assert [(host.name, host.address) for host in system.hosts] == [
        ("main", "192.0.2.1"),
        ("other", "192.0.2.2"),
    ]
    assert {node.name: node.host for node in system.nodes} == {
        "source": "main",
        "sink": "other",
        "filter": "main",
    }
    assert system.processes[0].host == "other"
    assert system.processes[0].arguments[1] == "192.0.2.2"
    assert system.control_port == DEFAULT_CONTROL_PORT
    assert system.free_ports == {"free_port": int(system.processes[0].arguments[3])}


def test_a_step_waits_longer_than_a_host_may_be_silent(tmp_path):
    source, *others = load(tmp_path).nodes
    assert source.parameters["step_timeout"] >= 30.0
    assert all("step_timeout" not in node.parameters for node in others)
    given = load(tmp_path, SYSTEM, "source.step_timeout:=7.0").nodes[0]
    assert given.parameters["step_timeout"] == 7.0


def test_everything_on_one_host_is_a_run_of_this_machine(tmp_path):
    text = SYSTEM.replace("host: other", "host: main")
    system = load(tmp_path, text, "placed:=main")
    assert system.hosts == ()
    assert {node.host for node in system.nodes} == {""}
    assert "step_timeout" not in system.nodes[0].parameters


def test_a_file_that_extends_another_gives_it_addresses(tmp_path):
    load(tmp_path)
    lab = tmp_path / "lab.yaml"
    lab.write_text("extends: two.yaml\nhosts: {other: 198.51.100.7}\n")
    assert [host.address for host in load_system(lab).hosts] == ["192.0.2.1", "198.51.100.7"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("host: other}", "host: mars}", "node '/sink': host 'mars' is not one of 'hosts'"),
        ("host: other}", "host: third}", "node '/sink': host 'third' has no address"),
        ("host: other}", "host: [x]}", "'host' must be a text"),
        ("main: 192.0.2.1", "main: localhost", "host 'main': the IPv4 address of one of its"),
        ("main: 192.0.2.1", "main: 224.0.0.1", "host 'main': the IPv4 address of one of its"),
        ("main: 192.0.2.1", "main: 0.0.0.0", "host 'main': the IPv4 address of one of its"),
        ("main: 192.0.2.1", "main: 192.0.2.2", "hosts 'main' and 'other' have the same address"),
        ("main: 192.0.2.1", "ma-in: 192.0.2.1", "a name of a host is letters, digits"),
        ("ends_run: true, host: main", "ends_run: true", "the node with 'ends_run' needs a 'host'"),
        ("hosts: {", "control_port: 0\nhosts: {", "control_port must be 1 to 65535, not 0"),
        ("hosts: {", "hosts: [", "two.yaml"),
    ],
)
def test_a_wrong_placement_is_one_line(tmp_path, old, new, message):
    assert old in SYSTEM
    with pytest.raises(SystemFileError) as raised:
        load(tmp_path, SYSTEM.replace(old, new))
    assert message in str(raised.value)


def test_a_system_of_several_hosts_does_not_run_on_one(tmp_path):
    """Campaigns, reprocessing and launch files start everything on this machine."""
    with pytest.raises(SystemFileError, match="two.yaml runs on several hosts, main, other"):
        Runner(load(tmp_path), tmp_path / "run")


def test_the_shipped_system_needs_its_addresses():
    path = find_system_file("reference_hosts")
    with pytest.raises(SystemFileError, match="needs 'chief_address'"):
        load_system(path)
    two = ("chief_address:=192.0.2.1", "deputy_address:=192.0.2.2")
    assert [host.name for host in load_system(path, two).hosts] == ["chief", "deputy"]
    three = (*two, "simulator_address:=192.0.2.3", "simulator_host:=simulator")
    system = load_system(path, three)
    assert [host.name for host in system.hosts] == ["chief", "deputy", "simulator"]
    with pytest.raises(SystemFileError, match="host 'simulator' has no address"):
        load_system(path, (*two, "recorder_host:=simulator"))


@pytest.mark.parametrize(("host", "words"), [(None, "two.yaml"), ("mars", "--host mars ")])
def test_a_part_that_is_not_chosen_is_one_line_with_all_parts(tmp_path, host, words):
    with pytest.raises(SystemFileError) as raised:
        check_host(load(tmp_path), host)
    text = str(raised.value)
    assert text.startswith(words) and "\n" not in text
    assert "two.yaml runs on 2 hosts" in text
    assert "--host main (192.0.2.1)" in text and "--host other (192.0.2.2)" in text
    check_host(load(tmp_path), "other")


def test_a_system_of_one_machine_has_no_parts():
    system = load_system(find_system_file("reference_software"))
    check_host(system, None)
    with pytest.raises(SystemFileError, match="reference_software.yaml runs on this machine alone"):
        check_host(system, "chief")

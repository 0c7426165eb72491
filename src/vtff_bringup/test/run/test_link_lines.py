"""Links of a run to hardware on the console, from its first second on."""

import pathlib

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")

from vtff_bringup.run.progress import LinkLines  # noqa: E402
from vtff_bringup.system.description import RunSettings  # noqa: E402
from vtff_bringup.system.system_file import load_system  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[4]
WAITING = "[INFO] [1795401319.99] [chief.receiver_driver]: waiting for /dev/ttyUSB9 (no device)"


def links(tmp_path, name="reference", **arguments):
    overrides = [f"{key}:={value}" for key, value in arguments.items()]
    path = ROOT / f"config/system/{name}.yaml"
    return LinkLines(load_system(path, overrides, RunSettings(tmp_path)))


def test_a_run_with_emulators_tells_nothing(tmp_path):
    for name in ("reference", "reference_software"):
        told = links(tmp_path, name)
        assert told.first == [] and not told.is_new("chief__receiver_driver", WAITING)


def test_hardware_tells_each_link_at_once_and_each_change_once(tmp_path):
    told = links(
        tmp_path,
        simgen_host="192.0.2.7",
        chief_port=str(tmp_path / "absent"),
        deputy_port="tcp://192.0.2.9:3001",
        thruster="hardware",
    )
    assert len(told.first) == 4
    assert f"receiver of chief: {tmp_path / 'absent'} (no such device yet)" in told.first
    assert any("tcp://192.0.2.9:3001" in line for line in told.first)
    assert any("SimGEN: 192.0.2.7:15650" in line for line in told.first)
    assert any("CAN bus udp_multicast" in line for line in told.first)
    assert told.is_new("chief__receiver_driver", WAITING)
    assert not told.is_new("chief__receiver_driver", WAITING.replace("319.99", "325.99"))
    assert told.is_new("deputy__receiver_driver", WAITING)
    assert not told.is_new("chief__receiver_driver", "[INFO] [1.0] [chief.receiver_driver]: begins")
    there = "[INFO] [1.0] [{}]: whole: all inputs are there"
    assert told.is_new("chief__receiver_driver", there.format("chief.receiver_driver"))
    assert not told.is_new("composed", there.format("deputy.relative_ekf"))  # waited for no link

"""The vtff command itself: interrupts, help, and folders that cannot be used."""

from __future__ import annotations

import io
import pathlib
import subprocess
import sys

import pytest
from rich.console import Console
from typer.testing import CliRunner

from vtff_bag.file.metadata import offered_qos
from vtff_bag.file.writer import BagWriter
from vtff_bringup import cli
from vtff_bringup.run import on_console, reporting
from vtff_bringup.run.flown import require_flight
from vtff_bringup.run.runner import RunResult


def shown_by(function, *arguments):
    console = Console(file=io.StringIO(), width=80)
    returned = function(console, *arguments)
    return returned, console.file.getvalue()


def test_an_interrupt_while_importing_ends_without_a_traceback(monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "make_app", interrupted)
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code == 130


def test_the_command_line_imports_little():
    code = (
        "import sys, vtff_bringup.cli\n"
        "assert 'typer' not in sys.modules\n"
        "vtff_bringup.cli.make_app()\n"
        "print(sorted({'rclpy', 'numpy', 'matplotlib'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout == "[]\n", result.stderr


def test_an_interrupt_while_the_report_is_written(tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(reporting, "write_report", interrupted)
    exit_code, shown = shown_by(reporting.report_run, tmp_path)
    assert exit_code == 130
    assert "report interrupted" in shown


def test_a_run_that_never_started_shows_no_speed(tmp_path):
    result = RunResult(2, "a failed (exit code 2); log: a.log", ("last words",), 0.3, {})
    returned, shown = shown_by(on_console.conclude_run, tmp_path, result)
    assert returned == (2, 0)
    assert "a failed" in shown and "last words" in shown and f"run: {tmp_path}" in shown
    assert "real time" not in shown and "messages" not in shown


@pytest.mark.parametrize("command", [["run", "reference_software"], ["study", "thrust_cap"]])
@pytest.mark.parametrize("folder", ["/proc/x", "file"])
def test_an_odd_folder_is_one_line(tmp_path, monkeypatch, command, folder):
    monkeypatch.chdir(pathlib.Path(__file__).resolve().parents[4])
    (tmp_path / "file").write_text("")
    path = str(tmp_path / folder)  # of an absolute folder, it is that folder
    result = CliRunner().invoke(cli.make_app(), [*command, "--out", path])
    assert result.exit_code == 2
    assert result.output.startswith("error: ") and path in result.output.replace("\n", "")


@pytest.mark.parametrize(
    "command",
    [
        "run reference --out",
        "campaign example --out",
        "report bag --out",
        "study radial_offset --runs",
    ],
)
def test_an_empty_folder_is_not_this_folder(tmp_path, monkeypatch, command):
    """An unset variable of a shell is an empty text."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli.make_app(), [*command.split(), ""])
    assert result.exit_code == 2
    assert "a folder expected, got an empty text" in result.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["run", "bag recover", "study thrust_cap"])
def test_help_loses_no_words(command):
    words = " ".join(
        CliRunner().invoke(cli.make_app(), [*command.split(), "--help"]).output.split()
    )
    assert {
        "run": "bags/SYSTEM_DATE_TIME",
        "bag recover": "BAG_recovered beside it",
        "study thrust_cap": "studies/thrust_cap_DATE_TIME",
    }[command] in words


def test_the_command_has_its_name_however_it_is_started():
    command = [sys.executable, "-m", "vtff_bringup.cli", "run", "--help"]
    assert "Usage: vtff run" in subprocess.run(command, capture_output=True, text=True).stdout


def write_bag(folder, topic):
    """Write a bag with one message on a topic."""
    qos = offered_qos()
    with BagWriter(folder) as writer:
        number = writer.add_topic(topic, "std_msgs/msg/Empty", [qos], "RIHS01_" + "0" * 64, "")
        writer.write(number, b"\0\1\0\0\0", 1)
    return str(folder)


def test_a_run_that_never_flew_is_refused(tmp_path):
    grounded = write_bag(tmp_path / "grounded", "/diagnostics")
    flown = write_bag(tmp_path / "flown", "/deputy/relative_state")
    require_flight(pathlib.Path(flown))
    for command in (["report", grounded], ["compare", flown, grounded]):
        result = CliRunner().invoke(cli.make_app(), command)
        assert result.exit_code == 2
        text = result.output.replace("\n", "")
        assert text == f"error: {grounded}: nothing flew in this run, its bag holds no data"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flown", "grounded"]


def test_max_lag_is_for_real_time():
    result = CliRunner().invoke(cli.make_app(), ["run", "reference_software", "--max-lag", "3"])
    assert result.exit_code == 2
    assert result.output == "error: --max-lag needs --realtime\n"


def test_lateness_and_a_full_disk_are_in_the_last_lines(tmp_path):
    progress = {"done": 20.0, "total": 20.0, "late_steps": 3, "largest_lag": 1.26}
    full = "bag_recorder: cannot write: No space left on device"
    result = RunResult(1, "a failed", (), 25.0, progress, full)
    _, shown = shown_by(on_console.conclude_run, tmp_path, result)
    assert "3 steps began late, the worst by 1.3 s" in shown.replace("\n", " ")
    assert shown.splitlines()[-1] == f"the disk is full: {full}"

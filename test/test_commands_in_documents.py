"""README fits on a screen, and the commands of README, tour and results are accepted by vtff."""

from __future__ import annotations

import json
import pathlib
import re
import shlex

import pytest
import typer.main
from typer.core import TyperGroup

from vtff_bringup.campaign.campaign_file import CampaignError, find_campaign_file
from vtff_bringup.cli import make_app
from vtff_bringup.discover.installed import nodes
from vtff_bringup.hosts.run_order import RunOrder
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.parameter_check import check_parameters
from vtff_bringup.system.system_file import find_system_file, load_system
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.novatel.encode.solution import ComponentVersion, encode_version
from vtff_node.executables import node_class
from vtff_node.main import help_text

ROOT = pathlib.Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
FENCE = re.compile(r"^```\w*\n(.*?)^```", re.S | re.M)
UsageError = typer.BadParameter.__base__
MOST_LINES, MOST_NUMBERS, WIDEST_CELL = 130, 60, 80
#: Files of the reader, and runs, that commands in the documents name.
STAND_INS = ("rover.obs", "base.obs", "brdc.nav", "station.crx.gz", "brdc.rnx.gz", "receiver.dat")
STAND_INS += ("rover.dat", "base.dat", "bags/run_a", "bags/run_b", "bags/sample")


def commands(text: str) -> list[str]:
    """Return the commands of the fenced blocks, without comments and the path of vtff."""
    lines = [line for block in FENCE.findall(text) for line in block.splitlines()]
    shown = [re.sub(r"\s+#.*", "", line).strip() for line in lines]
    return [line.removeprefix(".venv/bin/") for line in shown if line]


def commands_of_results() -> list[str]:
    """Return the vtff commands of the rows of results."""
    rows = [
        row["command"]
        for path in (ROOT / "benchmarks/results").glob("*.json")
        for row in json.loads(path.read_text(encoding="utf-8"))["rows"]
    ]
    return sorted({row for row in rows if row.startswith("vtff ")})


def check_vtff(words: list[str]) -> None:
    """Parse the words of a vtff command as the command line does; look up what they name.

    Raises
    ------
    UsageError
        If there is no such command, argument or option.
    SystemFileError, CampaignError
        If a system, an argument or a parameter of it, or a campaign does not exist.
    """
    group = typer.main.get_command(make_app())
    if words[0].startswith("--"):
        names = {name for option in group.params for name in option.opts}
        assert words[0] in {"--help", *names}
        return
    command, arguments = group, list(words)
    context = command.make_context("vtff", arguments)
    while isinstance(command, TyperGroup):
        name, command, arguments = command.resolve_command(context, arguments)
        context = command.make_context(name, list(arguments), parent=context)
    given = context.params
    if words[0] == "run":
        overrides = tuple(given["overrides"] or ())
        settings = RunOrder(overrides=overrides).settings(ROOT / "bags/none", {})
        description = load_system(find_system_file(given["system"]), overrides, settings)
        check_parameters(description, overrides)
    elif words[0] == "campaign":
        find_campaign_file(given["file"])
    elif words[0] == "node":
        assert given["name"] in {name for name, *_ in nodes()}, given["name"]


def check_make(words: list[str]) -> None:
    """Find the targets in the Makefile."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in words:
        assert re.search(rf"^{target}:", text, re.M), target


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """Return a folder with the files that the commands name."""
    folder = tmp_path_factory.mktemp("place")
    for name in STAND_INS:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("content")
    for name in ("receiver.dat", "rover.dat", "base.dat"):
        version = ComponentVersion(1)
        (folder / name).write_bytes(encode_version([version], None, HeaderSettings()))
    (folder / "config").symlink_to(ROOT / "config")
    return folder


ALL = {
    "README": commands(README.read_text(encoding="utf-8")),
    "tour": commands((ROOT / "docs/tour.md").read_text(encoding="utf-8")),
    "results": commands_of_results(),
}
CASES = [pytest.param(text, id=f"{name}-{text}") for name, found in ALL.items() for text in found]


@pytest.mark.parametrize("command", CASES)
def test_commands_are_accepted(command, place, monkeypatch):
    monkeypatch.chdir(place)
    program, *words = shlex.split(command)
    assert program in {"make", "vtff"}, command
    (check_make if program == "make" else check_vtff)(words)


@pytest.mark.parametrize(
    "command",
    [
        "run no_such_system",
        "run reference no_such_node.design:=paper",
        "run reference --no-such-option",
        "no_such_command",
        "campaign no_such_campaign",
        "study no_such_study",
        "guidance no_such_command",
    ],
)
def test_wrong_commands_are_noticed(command):
    with pytest.raises((UsageError, SystemFileError, CampaignError)):
        check_vtff(command.split())


def test_readme_is_one_screen():
    text = README.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    assert len(re.findall(r"\d+(?:\.\d+)*", text)) <= MOST_NUMBERS
    rows = [line for line in text.splitlines() if line.startswith("|")]
    cells = [cell.strip() for row in rows for cell in row.strip("|").split("|")]
    assert max(map(len, cells)) <= WIDEST_CELL
    assert text.count("![") == 1
    assert len(commands(text)) >= 10


def test_benchmarks_of_results_accept_their_options():
    """A command of a row that is a script names it; its options are those of its help."""
    rows = [
        row["command"]
        for path in (ROOT / "benchmarks/results").glob("*.json")
        for row in json.loads(path.read_text(encoding="utf-8"))["rows"]
    ]
    options: dict[str, set[str]] = {}
    for row in sorted({row for row in rows if row.startswith("python ")}):
        _, script, *words = row.split()
        options.setdefault(script, set()).update(w for w in words if w.startswith("--"))
    for script, named in options.items():
        text = (ROOT / script).read_text(encoding="utf-8")
        missing = [option for option in named if f'"{option}"' not in text]
        assert not missing, f"{script} has no {missing}"


def test_parameters_worth_touching_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text.partition("## Parameters worth touching")[2].partition("\n## ")[0]
    named = re.findall(r"`(\w+)\.(\w+)`", section)
    assert 25 <= len(named) <= 45
    packages = {name: package for name, package, _ in nodes()}
    helps = {node: help_text(node_class(packages[node], node)) for node, _ in named}
    missing = [
        f"{node}.{parameter}"
        for node, parameter in named
        if not re.search(rf"^  {parameter} ", helps[node], re.M)
    ]
    assert not missing

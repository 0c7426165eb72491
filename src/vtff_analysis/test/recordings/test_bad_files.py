"""Bad files of thirty kinds: each gives one line and exit code 2, and leaves nothing behind."""

from __future__ import annotations

import dataclasses
import gzip
import pathlib
import warnings
from collections.abc import Callable

import bag_samples
import pytest
from emulated_day import EmulatedDay, write_day
from encoder_test_support import receiver_log
from typer.testing import CliRunner

from vtff_bringup.cli import make_app

LEO = "leo12030.10o"


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    return write_day(tmp_path_factory.mktemp("day"), epochs=20)


@dataclasses.dataclass
class Case:
    """One bad file: a name, who is asked to read it, and what the one line must hold.

    `change` makes the bytes of the bad file from the file `source` of the emulated day.
    """

    name: str
    role: str
    change: Callable[[bytes], bytes]
    message: str


def cut_header(content: bytes) -> bytes:
    return content[: content.index(b"END OF HEADER") - 40]


def line_with(content: bytes, mark: bytes, old: bytes, new: bytes) -> bytes:
    lines = content.splitlines(keepends=True)
    row = next(i for i, line in enumerate(lines) if mark in line)
    assert old in lines[row]
    lines[row] = lines[row].replace(old, new, 1)
    return b"".join(lines)


def first_line(text: str, label: str, version: str) -> bytes:
    return f"{version:<20}{text:<40}{label}\n".encode("ascii")


def bad_field(content: bytes) -> bytes:
    """Spoil a number in the first satellite of the first epoch."""
    start = content.index(b"\n", content.index(b" 10  7 22"))
    return content[:start] + content[start:].replace(b".", b"x", 1)


OBSERVATIONS = [
    Case("empty", "observations", lambda c: b"", "the file is empty"),
    Case("blank", "observations", lambda c: b"\n \n\n", "the file is empty"),
    Case("text", "observations", lambda c: b"GPS data\n" * 9, "neither RINEX nor a NovAtel log"),
    Case("picture", "observations", lambda c: b"\x89PNG\r\n" + bytes(999), "neither RINEX nor"),
    Case("cut header", "observations", cut_header, "END OF HEADER is missing"),
    Case("version", "observations", lambda c: c.replace(b"2.20", b"7.20", 1), "version 7.2"),
    Case("type", "observations", lambda c: c.replace(b"OBSERVATION", b"METEOROLOGY", 1), "'M'"),
    Case(
        "no types",
        "observations",
        lambda c: c.replace(b"# / TYPES OF OBSERV", b"COMMENT            "),
        "no observation types",
    ),
    Case(
        "number of types",
        "observations",
        lambda c: c.replace(b"     7    L1", b"     x    L1"),
        "TYPES OF OBSERV",
    ),
    Case(
        "time system",
        "observations",
        lambda c: line_with(c, b"TIME OF FIRST OBS", b"0.0000000       ", b"0.0000000    XYZ"),
        "'XYZ' is unknown",
    ),
    Case("field", "observations", bad_field, "is not F14.3"),
    Case("cut record", "observations", lambda c: c[:-60], "ends inside"),
    Case(
        "time goes back",
        "observations",
        lambda c: c.replace(b" 10  7 22  0  1 40", b" 10  7 22  0  0 40"),
        "is not after",
    ),
    Case(
        "header only",
        "observations",
        lambda c: c[: c.index(b"END OF HEADER") + 14],
        "no observations",
    ),
    Case(
        "other lines per satellite",
        "observations",
        lambda c: c.replace(b"     7    L1", b"     5    L1"),
        "",
    ),
    Case(
        "cut gzip", "observations", lambda c: gzip.compress(c)[:-20], "compressed file is damaged"
    ),
    Case(
        "no gzip", "observations", lambda c: b"\x1f\x8b\x08" + c[:200], "compressed file is damaged"
    ),
    Case(
        "cut zip", "observations", lambda c: b"PK\x03\x04" + c[:200], "compressed file is damaged"
    ),
    Case(
        "cut Hatanaka",
        "observations",
        lambda c: first_line("COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE", "1.0"),
        "",
    ),
    Case(
        "log without observations",
        "observations",
        lambda c: receiver_log(1)[:60],
        "none with observations",
    ),
    Case(
        "navigation file",
        "observations",
        lambda c: first_line("N: GNSS NAV DATA    M: MIXED", "RINEX VERSION / TYPE", "     3.05"),
        "a navigation file",
    ),
]
ORBITS = [
    Case("empty", "orbits", lambda c: b"", "the file is empty"),
    Case("text", "orbits", lambda c: b"orbits\n", "neither RINEX nor a NovAtel log"),
    Case("cut", "orbits", lambda c: c[:-40], "is not a number"),
    Case("number", "orbits", lambda c: line_with(c, b"PG05", b".", b"x"), "is not a number"),
    Case(
        "date",
        "orbits",
        lambda c: c.replace(b"*  2010  7 22  0 15", b"*  2010  7 42  0 15"),
        "date and time",
    ),
    Case("no satellite", "orbits", lambda c: c[: c.index(b"*  2010")] + b"EOF\n", "no position"),
    Case(
        "another day",
        "orbits",
        lambda c: c.replace(b"*  2010  7 22", b"*  2010  7 25"),
        "valid from 2010-07-25",
    ),
    Case(
        "observation file",
        "orbits",
        lambda c: first_line("OBSERVATION DATA    M: MIXED", "RINEX VERSION / TYPE", "     3.05"),
        "file type 'O'",
    ),
]
BIASES = [
    Case("empty", "biases_p1p2", lambda c: b"", "neither a Bias-SINEX"),
    Case(
        "no title",
        "biases_p1p2",
        lambda c: c.replace(b"DIFFERENTIAL", b"DIFFERENCES "),
        "neither a Bias-SINEX",
    ),
    Case(
        "no date",
        "biases_p1p2",
        lambda c: c.replace(b"ENDING", b"UP TO "),
        "neither YEAR-MONTH nor ENDING DAY",
    ),
    Case("number", "biases_p1p2", lambda c: line_with(c, b"G05", b".", b"x"), "not a number"),
    Case("no bias", "biases_p1p2", lambda c: c[: c.index(b"G01")], "holds no bias"),
    Case(
        "another year",
        "biases_p1p2",
        lambda c: c.replace(b"2010", b"2004"),
        "days away; --allow-old-biases",
    ),
]
OWN_ORBIT = [
    Case("text", "own_orbit", lambda c: b"my orbit\n", "neither an SP3 nor an OEM file"),
    Case("cut OEM", "own_orbit", lambda c: b"CCSDS_OEM_VERS = 2.0\nMETA_START\n", "OEM"),
    Case(
        "another day",
        "own_orbit",
        lambda c: c.replace(b"*  2010  7 22", b"*  2010  7 25"),
        "orbit from 2010-07-25",
    ),
]
CASES = [*OBSERVATIONS, *ORBITS, *BIASES, *OWN_ORBIT]
ROLES = ("observations", "orbits", "biases_p1p2", "own_orbit")


def files_with(day: EmulatedDay, case: Case, folder: pathlib.Path) -> dict[str, pathlib.Path]:
    files = {role: getattr(day, role) for role in ROLES}
    bad = folder / files[case.role].name
    content = files[case.role].read_bytes()
    changed = case.change(content)
    assert changed != content
    bad.write_bytes(changed)
    return {**files, case.role: bad}


def test_there_are_thirty_kinds():
    assert len({(case.role, case.name) for case in CASES}) >= 30


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.role}: {case.name}")
def test_a_bad_file_is_one_line(day, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = files_with(day, case, tmp_path)
    before = set(tmp_path.rglob("*"))
    with warnings.catch_warnings():
        # Warnings of numpy are errors: none reaches a user.
        warnings.simplefilter("error", RuntimeWarning)
        result = CliRunner().invoke(
            make_app(),
            [
                "tec", str(files["observations"]), "--nav", str(files["orbits"]),
                "--biases", str(files["biases_p1p2"]), "--orbit", str(files["own_orbit"]),
            ],
        )  # fmt: skip
    assert result.exit_code == 2, result.output
    errors = [line for line in result.output.splitlines() if line.startswith("error:")]
    rest = [line for line in result.output.splitlines() if line.startswith(("Traceback", "  "))]
    assert len(errors) == 1 and not rest, result.output
    assert files[case.role].name in errors[0] and case.message in errors[0]
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("case", OBSERVATIONS, ids=lambda case: case.name)
@pytest.mark.parametrize("is_rover", [True, False])
def test_a_bad_file_of_a_baseline_is_one_line(day, case, is_rover, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = files_with(day, case, tmp_path)
    before = set(tmp_path.rglob("*"))
    pair = [str(files["observations"]), str(day.observations)]
    arguments = pair if is_rover else pair[::-1]
    result = CliRunner().invoke(make_app(), ["baseline", *arguments, str(files["orbits"])])
    assert result.exit_code == 2, result.output
    (line,) = result.output.splitlines()
    assert line.startswith("error:") and LEO in line and case.message in line
    assert set(tmp_path.rglob("*")) == before


def test_two_bags_and_a_folder_that_is_none(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    result = CliRunner().invoke(make_app(), ["baseline", str(folder)])
    assert result.exit_code == 2 and f"{folder}: not a bag" in result.output
    result = CliRunner().invoke(make_app(), ["baseline", str(folder), str(folder)])
    assert result.exit_code == 2 and f"{folder}: not a bag" in result.output
    bag = tmp_path / "bag"
    bag_samples.write_bag(bag, bag_samples.sample_messages(3))
    result = CliRunner().invoke(make_app(), ["baseline", str(bag), str(folder)])
    assert result.exit_code == 2 and f"{bag} is a bag" in result.output
    assert "leave" in result.output and len(result.output.splitlines()) == 1

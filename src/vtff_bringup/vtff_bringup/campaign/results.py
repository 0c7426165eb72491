"""Results of a campaign: a journal with one line a case, and the Parquet table made of it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pathlib
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from vtff_bringup.campaign.campaign_file import Campaign, CampaignError
from vtff_bringup.campaign.cases import Case, case_identity
from vtff_node.plain_yaml import format_yaml

__all__ = ["FINGERPRINT_FILE", "JOURNAL_FILE", "TABLE_FILE", "Journal", "make_table", "write_table"]

JOURNAL_FILE = "cases.jsonl"
TABLE_FILE = "cases.parquet"
FINGERPRINT_FILE = "campaign.json"

_SYNCHRONISE_INTERVAL = 1.0  # s between waits until the disk has the journal


class Journal:
    """The records of a campaign's finished cases, one line of JSON each, only ever appended to.

    A line that a crash or a full disk cut short does not count and is taken away.

    Parameters
    ----------
    folder
        Folder of the campaign.

    Raises
    ------
    CampaignError
        If another command writes this campaign, or a line is not a record.
    OSError
        If the file cannot be read or written.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self.path = folder / JOURNAL_FILE
        self._records: dict[str, dict[str, Any]] = {}
        self._stream = self.path.open("a+b", buffering=0)
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._stream.close()
            raise CampaignError(f"{folder}: another command writes this campaign") from error
        self._end = self._read()
        self._stream.truncate(self._end)
        self._synchronised = time.monotonic()

    def __enter__(self) -> Journal:
        """Return the journal."""
        return self

    def __exit__(self, *unused: object) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._stream.close()

    def append(self, record: Mapping[str, Any]) -> None:
        """Add the record of a case; after a failure the file is as it was before.

        Raises
        ------
        OSError
            If the record cannot be written.
        """
        line = json.dumps(record, allow_nan=False).encode() + b"\n"
        try:
            rest = line
            while rest:
                rest = rest[self._stream.write(rest) :]
            if time.monotonic() - self._synchronised > _SYNCHRONISE_INTERVAL:
                os.fsync(self._stream.fileno())
                self._synchronised = time.monotonic()
        except OSError:
            with contextlib.suppress(OSError):
                self._stream.truncate(self._end)
            raise
        self._end += len(line)
        self._records[case_identity(record["seed"], record["inputs"])] = dict(record)

    def read_again(self) -> None:
        """Take the records from the file, after an interrupt in the middle of `append`.

        Raises
        ------
        CampaignError
            If a line of the file is not a record.
        """
        self._end = self._read()

    def record_of(self, case: Case) -> dict[str, Any] | None:
        """Return the newest record of a case under its number; None without one."""
        record = self._records.get(case.identity)
        return None if record is None else {**record, "case": case.number}

    def run_folders(self) -> set[str]:
        """Return the names of the run folders that are kept, also of cases of earlier files."""
        return {record["run_folder"] for record in self._records.values()} - {None}

    def _read(self) -> int:
        """Read the records; return where the last whole line ends."""
        end = 0
        for number, line in enumerate(self.path.read_bytes().splitlines(keepends=True), 1):
            if not line.endswith(b"\n"):
                break
            try:
                record = json.loads(line)
                self._records[case_identity(record["seed"], record["inputs"])] = record
            except (ValueError, KeyError, TypeError) as error:
                raise CampaignError(f"{self.path}: line {number} is not a record") from error
            end += len(line)
        return end


def check_fingerprint(folder: pathlib.Path, campaign: Campaign) -> None:
    """Write what a folder's campaign is, or check that it is this one.

    Raises
    ------
    CampaignError
        If the folder holds another campaign; the text names a field that differs.
    OSError
        If the file cannot be written.
    """
    path = folder / FINGERPRINT_FILE
    wanted = _fingerprint(campaign)
    if not path.exists():
        replace_file(path, (json.dumps(wanted, indent=1) + "\n").encode())
        return
    held = json.loads(path.read_text(encoding="utf-8"))
    for name, value in wanted.items():
        if held.get(name) != value:
            raise CampaignError(
                f"{folder}: holds another campaign, '{name}' differs; choose another --out"
            )


def make_table(campaign: Campaign, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Return the table of a campaign: a row a case.

    Parameters
    ----------
    campaign
        Gives the columns of inputs and figures.
    rows
        Records of the cases in the order of their numbers.
    """
    columns: dict[str, Any] = {
        "case": pa.array([row["case"] for row in rows], pa.int64()),
        "status": pa.array([row["status"] for row in rows], pa.string()),
        "seed": pa.array([row["seed"] for row in rows], pa.int64()),
    }
    for variable in campaign.variables:
        columns[variable.name] = _input_column([row["inputs"][variable.name] for row in rows])
    for figure in campaign.figures:
        values = [row["figures"].get(figure) for row in rows]
        columns[figure] = pa.array(
            [None if value is None else float(value) for value in values], pa.float64()
        )
    for name, kind in (
        ("wall_time_s", pa.float64()),
        ("processor_time_s", pa.float64()),
        ("vtff_version", pa.string()),
        ("git_commit", pa.string()),
        ("machine", pa.string()),
        ("run_folder", pa.string()),
        ("reason", pa.string()),
    ):
        columns[name] = pa.array([row[name] for row in rows], kind)
    return pa.table(columns)


def write_table(table: pa.Table, folder: pathlib.Path) -> pathlib.Path:
    """Write a table as Parquet; the file is whole or as it was before.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    path = folder / TABLE_FILE
    with _replaced(path) as temporary:
        pq.write_table(table, temporary)
    return path


def replace_file(path: pathlib.Path, content: bytes) -> None:
    """Write a file that is whole or as it was before.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    with _replaced(path) as temporary:
        temporary.write_bytes(content)


@contextlib.contextmanager
def _replaced(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield a file beside another, which takes its place when it is written."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _input_column(values: Sequence[Any]) -> pa.Array:
    """Return inputs as a column; what is no number, truth value or text as YAML text."""
    numbers = [value for value in values if type(value) in (int, float)]
    if len(numbers) == len(values) and any(isinstance(value, float) for value in values):
        return pa.array([float(value) for value in values], pa.float64())
    if len({type(value) for value in values}) <= 1 and type(values[0]) in (int, bool, str):
        return pa.array(values)
    texts = [format_yaml(value, on_one_line=True) for value in values]
    return pa.array(texts, pa.string())


def _fingerprint(campaign: Campaign) -> dict[str, Any]:
    """Return what decides on the numbers of a case beside its inputs, as JSON gives it back."""
    content = {
        "name": campaign.name,
        "system": campaign.system,
        "loop": campaign.loop,
        "duration": campaign.duration,
        "fixed": dict(campaign.fixed),
        "sets": {variable.name: variable.keys for variable in campaign.variables},
        "figures": list(campaign.figures),
    }
    restored: dict[str, Any] = json.loads(json.dumps(content, default=str))
    return restored

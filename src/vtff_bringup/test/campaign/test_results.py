"""Journal and table of a campaign: never half written, exact after any end."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import textwrap

import pytest
from campaign_samples import SMALL, changed, write_campaign

from vtff_bringup.campaign import results
from vtff_bringup.campaign.campaign_file import CampaignError, load_campaign
from vtff_bringup.campaign.cases import make_cases
from vtff_bringup.campaign.results import (
    JOURNAL_FILE,
    Journal,
    check_fingerprint,
    make_table,
    replace_file,
    write_table,
)
from vtff_bringup.campaign.worker import COMPLETE, LOST, make_record


def campaign_of(folder, content=None):
    return load_campaign(write_campaign(folder, content))


def record_of(case, status=COMPLETE):
    figures = {} if status != COMPLETE else {"minimum_in_track_m": 0.1 * case.number}
    return make_record(case, status, "" if status == COMPLETE else "why", figures=figures)


def test_a_journal_gives_back_what_was_appended(tmp_path):
    cases = make_cases(campaign_of(tmp_path))
    with Journal(tmp_path) as journal:
        journal.append(record_of(cases[0], LOST))
        journal.append(record_of(cases[2]))
        journal.append(record_of(cases[0]))
    with Journal(tmp_path) as journal:
        assert journal.record_of(cases[0]) == record_of(cases[0])  # the newest
        assert journal.record_of(cases[1]) is None
        assert journal.record_of(cases[2]) == record_of(cases[2])


def test_an_interrupt_in_the_middle_of_a_record_loses_no_case(tmp_path, monkeypatch):
    case = make_cases(campaign_of(tmp_path))[0]

    def interrupt(seed, inputs):
        monkeypatch.undo()
        raise KeyboardInterrupt

    with Journal(tmp_path) as journal:
        monkeypatch.setattr(results, "case_identity", interrupt)
        with pytest.raises(KeyboardInterrupt):
            journal.append(record_of(case))
        assert journal.record_of(case) is None  # the line is in the file
        journal.read_again()
        assert journal.record_of(case) == record_of(case)


@pytest.mark.parametrize("kept", [1, 40, -1])
def test_a_line_that_was_cut_short_does_not_count(kept, tmp_path):
    cases = make_cases(campaign_of(tmp_path))
    with Journal(tmp_path) as journal:
        journal.append(record_of(cases[0]))
    whole = (tmp_path / JOURNAL_FILE).read_bytes()
    (tmp_path / JOURNAL_FILE).write_bytes(whole + whole[:kept])
    with Journal(tmp_path) as journal:
        assert journal.record_of(cases[0]) == record_of(cases[0])
        journal.append(record_of(cases[1]))
    assert (tmp_path / JOURNAL_FILE).read_bytes().startswith(whole + b'{"case": 2')
    with Journal(tmp_path) as journal:
        assert journal.record_of(cases[1]) == record_of(cases[1])


def test_a_line_that_is_no_record_is_named(tmp_path):
    (tmp_path / JOURNAL_FILE).write_text('{"case": 1}\n')
    with pytest.raises(CampaignError, match="line 1 is not a record"):
        Journal(tmp_path)


def test_two_commands_cannot_write_one_campaign(tmp_path):
    with Journal(tmp_path), pytest.raises(CampaignError, match="another command writes"):
        Journal(tmp_path)


def test_a_full_disk_leaves_whole_lines(tmp_path):
    """The size limit of a file stands for the disk: a write beyond it is cut short, then fails."""
    campaign_of(tmp_path)
    program = f"""
        import pathlib, resource, signal
        from test_results import campaign_of, make_cases, record_of
        from vtff_bringup.campaign.results import Journal
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        folder = pathlib.Path({str(tmp_path)!r})
        cases = make_cases(campaign_of(folder))
        size = len(str(record_of(cases[0])))
        resource.setrlimit(resource.RLIMIT_FSIZE, (2 * size + size // 2, -1))
        with Journal(folder) as journal:
            for case in cases:
                journal.append(record_of(case))
    """
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        cwd=__file__.rpartition("/")[0],
        env={**os.environ, "PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert "File too large" in result.stderr
    lines = (tmp_path / JOURNAL_FILE).read_bytes().splitlines(keepends=True)
    assert 1 <= len(lines) < 8 and all(line.endswith(b"\n") for line in lines)
    assert [json.loads(line)["case"] for line in lines] == list(range(1, len(lines) + 1))


def test_the_table_opens_in_pandas_and_polars(tmp_path):
    polars = pytest.importorskip("polars")
    pandas = pytest.importorskip("pandas")
    content = changed("vary/design", {"values": ["a", "b"], "with": "cap", "sets": ["x.y"]})
    content = changed("vary/place", [[1.0, 2.0]], content)
    campaign = campaign_of(tmp_path, content)
    cases = make_cases(campaign)
    rows = [record_of(case, LOST if case.number == 3 else COMPLETE) for case in cases]
    path = write_table(make_table(campaign, rows), tmp_path)
    for frame in (pandas.read_parquet(path), polars.read_parquet(path).to_pandas()):
        assert frame["case"].tolist() == list(range(1, 9))
        assert frame["cap"].tolist() == [1.2] * 4 + [1.4] * 4
        assert frame["design"].tolist() == ["a"] * 4 + ["b"] * 4
        assert frame["place"].tolist() == ["[1.0, 2.0]"] * 8
        assert frame["start"].tolist() == [case.inputs["start"] for case in cases]
        assert frame["status"].tolist().count("lost") == 1
        assert frame["minimum_in_track_m"].isna().tolist() == [n == 3 for n in range(1, 9)]
        assert frame["seed"].tolist() == [case.seed for case in cases]


def test_a_file_is_replaced_as_a_whole(tmp_path):
    path = tmp_path / "file"
    replace_file(path, b"old")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limit[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            replace_file(path, 100 * b"new")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("field", "value"),
    [("duration", 61.0), ("figures", ["final_radial_m"]), ("fixed/x", 1), ("system", "esf")],
)
def test_a_folder_holds_one_campaign(field, value, tmp_path):
    check_fingerprint(tmp_path, campaign_of(tmp_path))
    check_fingerprint(tmp_path, campaign_of(tmp_path, changed("samples", 9, SMALL)))
    name = field.partition("/")[0]
    with pytest.raises(CampaignError, match=f"another campaign, '{name}' differs"):
        check_fingerprint(tmp_path, campaign_of(tmp_path, changed(field, value)))

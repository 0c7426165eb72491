"""Folders of runs: never shared, never overwritten, and one line for what cannot be used."""

from __future__ import annotations

import json
import os
import pathlib

import pytest

from vtff_bag.run.description import RUN_FILE, add_measured, describe_run_folder, write_arguments
from vtff_bag.run.folder import (
    RunFolderError,
    chosen_file,
    chosen_folder,
    new_folder,
    remove_if_empty,
)


def test_runs_of_the_same_second_get_folders_of_their_own(tmp_path):
    made = [new_folder(tmp_path / "bags" / "run") for _ in range(3)]
    assert [folder.name for folder in made] == ["run", "run_2", "run_3"]
    assert all(folder.is_dir() for folder in made)


def test_a_chosen_folder_is_made_or_must_be_empty(tmp_path):
    folder = tmp_path / "a" / "b"
    assert chosen_folder(folder, empty=True) == folder
    assert chosen_folder(folder, empty=True) == folder
    (folder / "notes.txt").write_text("")
    with pytest.raises(RunFolderError, match="is not empty; choose another --out"):
        chosen_folder(folder, empty=True)
    assert chosen_folder(folder, empty=False) == folder
    (folder / "bag").mkdir()
    with pytest.raises(RunFolderError, match="already holds a run"):
        chosen_folder(folder, empty=True)


def test_what_is_no_folder_is_named(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    (tmp_path / "circle").symlink_to("circle")
    for path in (file, file / "below", pathlib.Path("/proc/x"), tmp_path / "circle"):
        with pytest.raises(RunFolderError) as caught:
            chosen_folder(path, empty=True)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    for path in (file / "below", pathlib.Path("/proc/x")):
        with pytest.raises(RunFolderError, match="cannot make|is not a folder"):
            new_folder(path)


@pytest.mark.parametrize(
    "name", ["folder", "pipe", "notes.txt", "circle", "no/run.html", "x" * 300]
)
def test_what_cannot_be_written_as_a_page_is_named(name, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "circle").symlink_to("circle")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RunFolderError, match=name) as caught:
        chosen_file(tmp_path / name, ".html")
    assert "\n" not in str(caught.value)


def test_a_page_is_written_anew(tmp_path):
    page = tmp_path / "run.HTML"
    assert chosen_file(page, ".html") == page
    page.write_text("of yesterday")
    assert chosen_file(page, ".html") == page


def test_a_name_that_is_no_text_is_refused(tmp_path):
    name = tmp_path / os.fsdecode(b"\xff.html")
    for choose in (lambda: chosen_file(name, ".html"), lambda: chosen_folder(name, empty=False)):
        with pytest.raises(RunFolderError, match="a name in UTF-8 expected"):
            choose()
    assert list(tmp_path.iterdir()) == []


def test_only_an_empty_folder_is_taken_away(tmp_path):
    folder = new_folder(tmp_path / "run")
    (folder / "log").write_text("")
    remove_if_empty(folder)
    assert folder.is_dir()
    (folder / "log").unlink()
    remove_if_empty(folder)
    assert not folder.exists()


def test_what_was_measured_on_this_machine_stays_out_of_the_bag(tmp_path):
    write_arguments(tmp_path, {"system": "reference", "seed": 1}, {"ros_domain_id": 7})
    add_measured(tmp_path, {"late_steps": 2, "largest_lag_s": 1.5})
    content = json.loads((tmp_path / RUN_FILE).read_text())
    assert content == {
        "system": "reference",
        "seed": 1,
        "ros_domain_id": 7,
        "late_steps": 2,
        "largest_lag_s": 1.5,
    }
    described = describe_run_folder(tmp_path)
    assert described.arguments == {"system": "reference", "seed": 1}
    assert "domain" not in str(described.as_custom_data())

"""Version and system file that the parts of a run must have in common."""

from __future__ import annotations

import re

from vtff_bringup.hosts.identity import describe_difference, digest_system, version_text
from vtff_bringup.system.description import RunSettings
from vtff_bringup.system.system_file import load_system

SYSTEM = """
description: two hosts
arguments:
  gnss: {default: gnss.yaml, description: what receivers see, file: true}
  rate: {default: 3, description: a number}
hosts: {first: 127.0.0.1, second: 127.0.0.2}
nodes:
  - {package: vtff_test, executable: source, ends_run: true, host: first}
  - package: vtff_test
    executable: sink
    host: second
    parameters: {gnss: "${gnss}", output: "${run_directory}/bag", rate: "${rate}"}
"""


def digests(folder, overrides=(), **texts):
    """Return the digests of the system in a folder that is made."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "two.yaml").write_text(texts.get("system", SYSTEM))
    (folder / "gnss.yaml").write_text(texts.get("gnss", "antenna: pattern.atx\n"))
    (folder / "pattern.atx").write_text(texts.get("pattern", "1 2 3"))
    settings = RunSettings(folder / "run", free_ports={"free_port": 4000})
    return digest_system(load_system(folder / "two.yaml", overrides, settings), folder / "run")


def test_the_same_system_in_another_folder_has_the_same_digests(tmp_path):
    assert digests(tmp_path / "a") == digests(tmp_path / "somewhere" / "else")


def test_each_difference_is_named(tmp_path):
    same = digests(tmp_path / "a")
    for name, difference, changed in (
        ("b", "argument rate", {"overrides": ["rate:=4"]}),
        ("c", "argument gnss", {"gnss": "antenna: other.atx\n"}),
        ("d", "argument gnss", {"pattern": "1 2 4"}),
        ("e", "host second", {"system": SYSTEM.replace("127.0.0.2", "127.0.0.3")}),
        ("f", "node /sink", {"system": SYSTEM.replace('"${rate}"', "3.0")}),
    ):
        assert describe_difference(same, digests(tmp_path / name, **changed)) == difference


def test_a_version_has_a_number_and_the_digest_of_its_sources():
    assert re.fullmatch(r"\d+\.\d+\.\d+ \(sources [0-9a-f]{12}\)", version_text())
    assert version_text() == version_text()

"""Names of ports, and what is said about those that cannot be read."""

from __future__ import annotations

import bz2
import gzip
import os
import pathlib

import pytest

from vtff_nav.receiver.log_source import CHUNK_LENGTH, SourceError, open_source


def content_of(port):
    source = open_source(port)
    chunks = []
    while chunk := source.read():
        chunks.append(chunk)
        assert source.position == sum(map(len, chunks))
    source.close()
    source.close()
    assert source.size == source.position
    return b"".join(chunks)


@pytest.fixture()
def log(tmp_path):
    path = tmp_path / "receiver.gps"
    path.write_bytes(os.urandom(2 * CHUNK_LENGTH + 17))
    return path


@pytest.mark.parametrize("form", ["{}", "file://{}", "FILE://{}"])
def test_absolute_names(log, form):
    assert content_of(form.format(log)) == log.read_bytes()


@pytest.mark.parametrize("form", ["{}", "file://{}", "./{}", "file://./{}"])
def test_relative_names(log, form, monkeypatch):
    monkeypatch.chdir(log.parent)
    assert content_of(form.format(log.name)) == log.read_bytes()


@pytest.mark.parametrize(
    "name", ["two words.gps", "100%.gps", "a%20b.gps", "what?#.gps", "größe.gps", "a:b.gps"]
)
@pytest.mark.parametrize("prefix", ["", "file://"])
def test_unusual_characters_are_taken_as_they_stand(tmp_path, name, prefix):
    (tmp_path / name).write_bytes(b"bytes")
    assert content_of(f"{prefix}{tmp_path / name}") == b"bytes"


def test_percent_encoding_is_understood_after_file(tmp_path):
    path = tmp_path / "two words.gps"
    path.write_bytes(b"bytes")
    assert content_of(path.as_uri()) == b"bytes"
    with pytest.raises(SourceError, match="two%20words"):
        open_source(str(tmp_path / "two%20words.gps"))


def test_the_literal_name_goes_before_the_decoded_one(tmp_path):
    (tmp_path / "a%20b").write_bytes(b"literal")
    (tmp_path / "a b").write_bytes(b"decoded")
    assert content_of(f"file://{tmp_path}/a%20b") == b"literal"


def test_an_empty_file_is_empty(tmp_path):
    (tmp_path / "empty").touch()
    assert content_of(str(tmp_path / "empty")) == b""


@pytest.mark.parametrize(
    ("port", "expected"),
    [
        ("file:///nowhere/receiver.gps", "receiver log /nowhere/receiver.gps: No such file"),
        ("nowhere.gps", "receiver log nowhere.gps: No such file"),
        ("file:///dev/null", "receiver log /dev/null: it is not a regular file"),
        ("udp://192.0.2.1:3001", "port 'udp://192.0.2.1:3001': 'udp' is not known"),
        ("", "port '' names no file"),
        ("file://", "port 'file://' names no file"),
        ("file:///a\0b", "embedded null byte"),
        ("x" * 5000, "File name too long"),
    ],
)
def test_other_names_are_refused_in_one_line(port, expected):
    with pytest.raises(SourceError) as caught:
        open_source(port)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_directory_is_refused(tmp_path):
    with pytest.raises(SourceError, match=f"receiver log {tmp_path}: Is a directory"):
        open_source(f"file://{tmp_path}")


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(SourceError, match="not a regular file"):
        open_source(str(tmp_path / "pipe"))


def test_a_file_without_permission_is_refused(tmp_path):
    path = pathlib.Path(tmp_path / "secret")
    path.touch(mode=0o000)
    if os.access(path, os.R_OK):
        pytest.skip("this user may read everything")
    with pytest.raises(SourceError, match="Permission denied"):
        open_source(str(path))


@pytest.mark.parametrize("compress", [gzip.compress, bz2.compress])
def test_a_compressed_log_is_read(tmp_path, compress):
    content = os.urandom(2 * CHUNK_LENGTH + 17)
    path = tmp_path / "receiver.gps.gz"
    path.write_bytes(compress(content))
    assert content_of(str(path)) == content


def test_a_cut_compressed_log_is_refused(tmp_path):
    path = tmp_path / "receiver.gps.gz"
    path.write_bytes(gzip.compress(os.urandom(1000))[:-20])
    with pytest.raises(SourceError, match=r"receiver\.gps\.gz: compressed file is damaged"):
        open_source(str(path))

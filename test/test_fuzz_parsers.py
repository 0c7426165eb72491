"""Fuzzing in a short form: only documented exceptions leave a parser, nothing hangs or swells."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import types

import fuzz_parsers
from graph_support import ROOT

from vtff_gnss.novatel.stream import ReceiverLogStream

SECONDS = 0.3  # of processor for each parser


def test_no_input_gets_through_a_parser(tmp_path):
    result = subprocess.run(
        [sys.executable, "test/fuzz_parsers.py", "--seconds", str(SECONDS), "--findings", tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    tried = re.findall(r"^(\w+): (\d+) inputs, \d+ bytes, (\d+) lines", result.stdout, re.MULTILINE)
    assert [name for name, *_ in tried] == list(fuzz_parsers.parsers())
    for name, inputs, lines in tried:
        assert int(inputs) >= 5 and int(lines) >= 10, (name, inputs, lines)


def fuzz_function(parse, tmp_path, **fields):
    """Return the number of findings of half a second of fuzzing."""
    parser = fuzz_parsers.Parser(lambda: [b"a: 1\n"], lambda folder: parse, **fields)
    return fuzz_parsers.fuzz("toy", parser, 0.5, 0, tmp_path)[3]


def test_an_undocumented_exception_is_found(tmp_path, capsys):
    def parse(content):
        if b"{" in content:
            raise KeyError("brace")
        if b"[" in content:
            raise ValueError("documented")

    assert fuzz_function(parse, tmp_path, expected=(ValueError,), tokens=(b"{", b"[")) == 1
    assert "toy: KeyError: 'brace'" in capsys.readouterr().out
    assert b"{" in (tmp_path / "toy_0").read_bytes()


def test_a_hang_is_found(tmp_path, capsys, monkeypatch):
    def end_input(number, frame):
        raise fuzz_parsers.InputTakesTooLong

    def parse(content):
        while content == b"a: 1\n":
            pass

    monkeypatch.setattr(fuzz_parsers, "LARGEST_TIME", 0.2)
    previous = signal.signal(signal.SIGPROF, end_input)
    try:
        assert fuzz_function(parse, tmp_path) == 1
    finally:
        signal.signal(signal.SIGPROF, previous)
    assert "toy: hang" in capsys.readouterr().out


def test_repaired_frames_reach_the_decoders():
    """With right checksums a changed log is not refused as a whole."""
    parser = fuzz_parsers.parsers()["receiver"]
    content = bytearray(parser.corpus()[0])
    payload = content.index(b"\xaa\x44\x12") + 40
    content[payload] ^= 0xFF
    keep_numbers = types.SimpleNamespace(random=lambda: 1.0)  # no message number is replaced
    for repair, damaged in ((bytes, 1), (lambda c: parser.repair(c, keep_numbers), 0)):
        stream = ReceiverLogStream()
        stream.feed(repair(content))
        assert stream.counters.frames_crc_bad == damaged

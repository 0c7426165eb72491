"""Compiled functions: machine code that later processes load without numba."""

import json
import os
import pathlib
import subprocess
import sys
import types

import numpy as np
import pytest

from vtff_dynamics import machine_code
from vtff_dynamics.machine_code import source_fingerprint

KERNELS = """
import collections
import enum
import math

import numpy as np

from vtff_dynamics.compiled import compiled

GAIN = 3.0
Settings = collections.namedtuple("Settings", "power offset")


class Kind(enum.IntEnum):
    EVEN = 0
    ODD = 1


@compiled
def _raised(value, power):
    \"\"\"Return a power, times the gain.\"\"\"
    return GAIN * math.sin(value) ** power


@compiled
def total(values, settings, kinds):
    result = np.zeros(2)
    for row in range(len(values)):
        for column in range(values.shape[1]):
            term = _raised(values[row, column], settings.power) + settings.offset
            kinds[row, column] = Kind.ODD if column % 2 else Kind.EVEN
            result[kinds[row, column]] += term
    return result, len(values) > 2
"""
CALL = """
import json, pickle, sys
import numpy as np
unpickled, loads = [], pickle.loads
pickle.loads = lambda *arguments: unpickled.append(arguments) or loads(*arguments)
from kernels import Settings, total
from vtff_dynamics.compiled import count_compiled_forms
values, kinds = np.linspace(0.1, 2.0, 12).reshape(4, 3), np.zeros((4, 3), dtype=np.int64)
for call in range(20):
    if call == 2:
        count = len(unpickled)
    sums, is_long = total(values, Settings(2.0, 0.5), kinds)
assert len(unpickled) == count, "calls unpickle"
assert type(sums) is np.ndarray and sys.getrefcount(sums) == 2
print(json.dumps([sums.tolist(), is_long, kinds.tolist(), "numba" in sys.modules]))
print(json.dumps(count_compiled_forms()))
"""


def call_in_new_process(folder: pathlib.Path, source: str = KERNELS, **environment: str) -> list:
    (folder / "kernels.py").write_text(source, encoding="utf-8")
    search_path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", CALL],
        # Bytecode is told from that of an older source by seconds.
        env={
            **os.environ,
            "PYTHONPATH": search_path,
            "PYTHONDONTWRITEBYTECODE": "1",
            **environment,
        },
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    values, forms = map(json.loads, done.stdout.splitlines())
    assert forms["kernels.total"] == 1
    return values


def interpreted() -> list:
    """Return what the interpreter makes of the same function."""
    values, kinds = np.linspace(0.1, 2.0, 12).reshape(4, 3), np.zeros((4, 3), dtype=np.int64)
    result = np.zeros(2)
    for row in range(4):
        for column in range(3):
            kinds[row, column] = column % 2
            result[column % 2] += 3.0 * np.sin(values[row, column]) ** 2.0 + 0.5
    return [result.tolist(), True, kinds.tolist()]


def files(folder: pathlib.Path) -> list[str]:
    return sorted(path.name for path in folder.glob("__pycache__/*.so"))


def test_later_processes_load_what_the_first_has_compiled(tmp_path):
    first = call_in_new_process(tmp_path)
    made = files(tmp_path)
    assert first[3] and len(made) == 1, "numba has compiled one file"
    second = call_in_new_process(tmp_path)
    assert not second[3], "numba was imported"
    assert files(tmp_path) == made
    assert first[:3] == second[:3]
    np.testing.assert_allclose(first[0], interpreted()[0], rtol=1e-15)
    assert first[1:3] == interpreted()[1:]

    # A constant that a called function reads; what is kept for the old one goes.
    changed = call_in_new_process(tmp_path, KERNELS.replace("GAIN = 3.0", "GAIN = 6.0"))
    assert changed[3]
    np.testing.assert_allclose(changed[0], 2.0 * np.array(first[0]) - [4.0, 2.0], rtol=1e-12)
    assert len(files(tmp_path)) == 1 and files(tmp_path) != made

    # A damaged file is made anew.
    (damaged,) = tmp_path.glob("__pycache__/*.so")
    damaged.unlink()
    damaged.write_bytes(b"\x7fELF")
    assert call_in_new_process(tmp_path, KERNELS.replace("GAIN = 3.0", "GAIN = 6.0")) == changed


def test_without_a_compiler_numba_compiles(tmp_path):
    found = call_in_new_process(tmp_path, PATH=str(tmp_path))
    assert found[3] and not files(tmp_path)
    np.testing.assert_allclose(found[0], interpreted()[0], rtol=1e-15)
    assert found[1:3] == interpreted()[1:]


def test_a_compiler_that_fails_is_none(tmp_path):
    """A cache folder of its own: the parts that all share are not there yet."""
    for name in ("cc", "c++", "gcc", "g++"):
        path = tmp_path / name
        path.write_text("#!/bin/sh\nexit 1\n")
        path.chmod(0o755)
    cache = tmp_path / "cache"
    found = call_in_new_process(
        tmp_path, PATH=str(tmp_path), CC="cc", CXX="c++", NUMBA_CACHE_DIR=str(cache)
    )
    assert found[3] and not list(cache.glob("*.so"))
    np.testing.assert_allclose(found[0], interpreted()[0], rtol=1e-15)


def test_works_where_nothing_can_be_kept(tmp_path):
    """Neither in the chosen folder nor in that of numba: its name is that of a file."""
    taken = tmp_path / "taken"
    taken.write_bytes(b"")
    found = call_in_new_process(tmp_path, NUMBA_CACHE_DIR=str(taken), HOME=str(taken))
    np.testing.assert_allclose(found[0], interpreted()[0], rtol=1e-15)


def kernels(source: str) -> types.ModuleType:
    module = types.ModuleType("kernels")
    exec(source, module.__dict__)
    return module


def fingerprint(source: str) -> str | None:
    function = kernels(source).total.__wrapped__
    return source_fingerprint(function, lambda value: getattr(value, "__wrapped__", None))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("GAIN = 3.0", "GAIN = 3.0000000000000004"),
        ("** power", "** (power + 1)"),
        ("math.sin", "math.cos"),
        ("len(values) > 2", "len(values) > 3"),
        ("ODD = 1", "ODD = 2"),
    ],
)
def test_the_fingerprint_changes_with_what_the_code_depends_on(old, new):
    changed = KERNELS.replace(old, new)
    assert changed != KERNELS
    assert fingerprint(changed) != fingerprint(KERNELS)


def test_the_fingerprint_does_not_change_with_words():
    worded = KERNELS.replace("Return a power", "Return some power").replace(
        "GAIN = 3.0", "# Of the loop.\nGAIN = 3.0"
    )
    assert fingerprint(worded) == fingerprint(KERNELS)


def test_processors_without_the_instructions_get_other_code(monkeypatch):
    def path():
        machine_code._environment.cache_clear()
        return machine_code.machine_code_path(path, "source", ("float",))

    levels = []
    for level in ("", "x86-64-v3"):
        monkeypatch.setattr(machine_code, "_processor_level", lambda level=level: level)
        levels.append(path())
    machine_code._environment.cache_clear()
    assert levels[0] != levels[1]

"""Compiled functions: files of machine code, which are never old, damaged or another's."""

import importlib
import inspect
import json
import os
import pathlib
import pkgutil
import subprocess
import sys
import types

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

CONSTANTS = """
import enum

GAIN = 3.0
TABLE = (1.0, 2.0)


class Kind(enum.IntEnum):
    EVEN = 0
    ODD = 1
"""
CALLED = """
import math

from constants import GAIN
from vtff_dynamics.compiled import compiled


@compiled
def raised(value, power):
    \"\"\"Return a power, times the gain.\"\"\"
    return GAIN * math.sin(value) ** power
"""
KERNELS = """
import collections

import numpy as np
from called import raised
from constants import TABLE, Kind
from vtff_dynamics.compiled import compiled


@compiled
def total(values, settings, kinds):
    result = np.zeros(2)
    for row in range(len(values)):
        for column in range(values.shape[1]):
            term = raised(values[row, column], settings.power) + settings.offset
            kinds[row, column] = Kind.ODD if column % 2 else Kind.EVEN
            result[kinds[row, column]] += term * TABLE[0]
    return result, len(values) > 2
"""
CALL = """
import collections, json
import numpy as np
from kernels import total
Settings = collections.namedtuple("Settings", "power offset")
values, kinds = np.linspace(0.1, 2.0, 12).reshape(4, 3), np.zeros((4, 3), dtype=np.int64)
sums, is_long = total(values, Settings(2.0, 0.5), kinds)
counts = getattr(total, "_cache_hits", {})
print(json.dumps([sums.tolist(), is_long, kinds.tolist(), sum(counts.values())]))
"""
SOURCES = {"constants": CONSTANTS, "called": CALLED, "kernels": KERNELS}


class Package:
    """Three modules and a folder for machine code, in a folder."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.cache = folder / "cache"
        self.sources = dict(SOURCES)
        self.call_program = CALL

    def start(self, **environment: str) -> subprocess.Popen:
        for name, text in self.sources.items():
            (self.folder / f"{name}.py").write_text(text, encoding="utf-8")
        known = {**os.environ, "NUMBA_CACHE_DIR": str(self.cache), **environment}
        known["PYTHONPATH"] = os.pathsep.join([str(self.folder), os.environ.get("PYTHONPATH", "")])
        # Bytecode is told from that of an older source by seconds.
        known["PYTHONDONTWRITEBYTECODE"] = "1"
        return subprocess.Popen(
            [sys.executable, "-c", self.call_program],
            cwd=self.folder,
            env={name: value for name, value in known.items() if value},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def call(self, **environment: str) -> list:
        """Return sums, whether there are many rows, kinds, and how many forms were loaded."""
        return answer(self.start(**environment))

    def files(self) -> list[pathlib.Path]:
        return sorted(path for path in self.cache.rglob("*") if path.is_file())


def answer(process: subprocess.Popen) -> list:
    printed, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    assert not errors
    return json.loads(printed)


@pytest.fixture
def package(tmp_path) -> Package:
    return Package(tmp_path)


def assert_sums(found: list, gain: float = 3.0) -> None:
    """Raise AssertionError unless the results are those of the interpreter."""
    values, kinds = np.linspace(0.1, 2.0, 12).reshape(4, 3), np.zeros((4, 3), dtype=np.int64)
    result = np.zeros(2)
    for row in range(4):
        for column in range(3):
            kinds[row, column] = column % 2
            result[column % 2] += gain * np.sin(values[row, column]) ** 2.0 + 0.5
    np.testing.assert_allclose(found[0], result, rtol=1e-14)
    assert found[1:3] == [True, kinds.tolist()]


def test_later_processes_load_what_the_first_has_compiled(package):
    first = package.call()
    assert first[3] == 0
    assert_sums(first)
    made = package.files()
    names = [path.name.split("-")[0] for path in made if path.suffix == ".nbc"]
    assert names == ["called.raised", "kernels.total"]
    second = package.call()
    assert second == [*first[:3], 1]
    assert package.files() == made


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("constants", "GAIN = 3.0", "GAIN = 3.000001"),
        ("constants", "(1.0, 2.0)", "(1.5, 2.0)"),
        ("constants", "EVEN = 0\n    ODD = 1", "ODD = 0\n    EVEN = 1"),
        ("called", "math.sin", "math.cos"),
        ("kernels", "len(values) > 2", "len(values) > 4"),
    ],
)
def test_what_a_kernel_depends_on_compiles_it_anew(package, module, old, new):
    first = package.call()
    package.sources[module] = SOURCES[module].replace(old, new)
    assert package.sources[module] != SOURCES[module]
    changed = package.call()
    assert changed[3] == 0
    assert changed[:3] != first[:3]
    assert len(package.files()) == 4, "the new files replace the old ones"
    assert package.call()[3] == 1


def test_the_order_of_fields_of_an_argument_is_one_of_its_types(package):
    first = package.call()
    package.call_program = CALL.replace("power offset", "offset power").replace(
        "2.0, 0.5", "0.5, 2.0"
    )
    assert package.call() == first


SMALL = """
from vtff_dynamics.compiled import compiled


@compiled
def triple(value):
    return 3.0 * value
"""


def new_kernel(folder: pathlib.Path, source: str = SMALL) -> Dispatcher:
    """Return a function that has nothing compiled, as in a new process."""
    path = folder / "small.py"
    path.write_text(source, encoding="utf-8")
    module = types.ModuleType("small")
    exec(compile(source, str(path), "exec"), module.__dict__)
    return module.triple


def hits(kernel: Dispatcher) -> int:
    """Return how many forms of a function were loaded, not compiled."""
    return sum(kernel._cache_hits.values())


def damages(content: bytes) -> list[bytes]:
    """Return contents that are cut, or differ from one in a byte."""
    places = [0, 31, 32, 33, *range(100, len(content), len(content) // 12), len(content) - 1]
    flipped = [
        content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :] for place in places
    ]
    return [*flipped, *(content[:place] for place in places)]


def test_a_damaged_file_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    assert new_kernel(tmp_path)(2.0) == 6.0
    paths = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert sorted(path.suffix for path in paths) == [".nbc", ".nbi"]
    for path in paths:
        for damage in damages(path.read_bytes()):
            path.write_bytes(damage)
            kernel = new_kernel(tmp_path)
            assert (kernel(2.0), hits(kernel)) == (6.0, 0)
            kernel = new_kernel(tmp_path)
            assert (kernel(2.0), hits(kernel)) == (6.0, 1)


def refuse(*arguments: object, **options: object) -> None:
    raise PermissionError("read-only file system")


def test_without_a_place_for_files_code_is_kept_in_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("os.makedirs", refuse)  # neither beside the source nor at home
    for _ in range(2):
        kernel = new_kernel(tmp_path)
        assert (kernel(2.0), hits(kernel)) == (6.0, 0)
        assert kernel(3.0) == 9.0
    assert [path.name for path in tmp_path.rglob("*")] == ["small.py"]


@pytest.mark.parametrize("home", ["", "/proc/nowhere"])
def test_a_process_without_a_home_compiles(package, home):
    found = package.call(HOME=home, XDG_CACHE_HOME="", NUMBA_CACHE_DIR="")
    assert_sums(found)


def test_a_full_disk_costs_the_file_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    kernel = new_kernel(tmp_path)
    monkeypatch.setattr("os.replace", refuse)
    assert kernel(2.0) == 6.0


def test_files_are_beside_the_source_without_a_folder_for_them(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    assert new_kernel(tmp_path)(2.0) == 6.0
    assert len(list((tmp_path / "__pycache__").glob("small.triple-*"))) == 2


def test_code_without_a_file_is_compiled_in_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    scope: dict = {"__name__": "typed"}
    exec(SMALL, scope)
    for _ in range(2):
        assert scope["triple"](2.0) == 6.0
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_types_that_two_processes_save_at_once_are_told_apart(tmp_path, monkeypatch):
    """Both find an empty index and give their files the same number."""
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    first, second = new_kernel(tmp_path), new_kernel(tmp_path)
    first._cache._cache_file._load_index = dict
    files = second._cache._cache_file
    save_data = files._save_data

    def save_after_the_first(name: str, content: object) -> None:
        assert first(1.0) == 3.0
        save_data(name, content)

    files._save_data = save_after_the_first
    assert second(2) == 6
    assert new_kernel(tmp_path)(2.5) == 7.5
    assert new_kernel(tmp_path)(2) == 6


def test_processes_that_start_at_once_share_an_empty_folder(package):
    processes = [package.start() for _ in range(4)]
    found = [answer(process) for process in processes]
    assert all(each[:3] == found[0][:3] for each in found)
    assert len(package.files()) == 4
    assert package.call()[3] == 1


def test_without_compilation_the_interpreter_calculates(package):
    found = package.call(NUMBA_DISABLE_JIT="1")
    assert_sums(found)
    assert not package.files()


ROOMS = ("vtff_dynamics", "vtff_gnss", "vtff_bag", "vtff_control", "vtff_iono", "vtff_nav")


@pytest.mark.parametrize("package_name", [*ROOMS, "vtff_sim_bridge"])
def test_the_digest_sees_all_that_kernels_use(package_name):
    """A kernel uses globals that it names itself, and no members of modules of ours."""
    root = importlib.import_module(package_name)
    kernels = [
        value
        for found in pkgutil.walk_packages(root.__path__, f"{package_name}.")
        for value in vars(importlib.import_module(found.name)).values()
        if isinstance(value, Dispatcher) and value.__module__ == found.name
    ]
    assert kernels
    for kernel in kernels:
        code, scope = kernel.py_func.__code__, kernel.py_func.__globals__
        assert not any(inspect.iscode(constant) for constant in code.co_consts), kernel
        assert not kernel.py_func.__closure__, kernel
        modules = [scope[name] for name in code.co_names if inspect.ismodule(scope.get(name))]
        assert {module.__name__ for module in modules} <= {"math", "numpy"}, kernel

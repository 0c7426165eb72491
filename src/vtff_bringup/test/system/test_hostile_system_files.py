"""System files that try to leave the run folder, and random ones: one line, nothing outside."""

from __future__ import annotations

import pathlib
import tempfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_bringup.system.description import RunSettings
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.system_file import load_system
from vtff_node.executables import ExecutableNotFoundError, executable_path
from vtff_node.plain_yaml import format_yaml

NODE = {"package": "vtff_node", "executable": "run_me"}


def load(folder, content):
    path = pathlib.Path(folder) / "system.yaml"
    path.write_text(content if isinstance(content, str) else format_yaml(content), "utf-8")
    return load_system(path, (), RunSettings(run_directory=pathlib.Path(folder)))


@pytest.mark.parametrize("key", ["name", "package", "executable"])
@pytest.mark.parametrize(
    "value", ["../x", "/x", "a/b", "..", ".", "a b", "a;b", "~x", "a\n", "é", "-x", "$x"]
)
@pytest.mark.parametrize("kind", ["nodes", "processes"])
def test_names_are_plain(tmp_path, kind, key, value):
    content = {"nodes": [NODE]}
    content[kind] = [{"name": "plain", **NODE, key: value}]
    with pytest.raises(SystemFileError, match=f"'{key}' must be ") as caught:
        load(tmp_path, content)
    assert "system.yaml" in str(caught.value)


@pytest.mark.parametrize("namespace", ["..", "../x", "a//b", "a/../b", "a b", "a/1"])
def test_namespaces_are_plain(tmp_path, namespace):
    with pytest.raises(SystemFileError, match="'namespace' must be "):
        load(tmp_path, {"nodes": [{**NODE, "namespace": namespace}]})
    argument = {"arguments": {"craft": {"default": namespace}}}
    with pytest.raises(SystemFileError, match="'namespace' must be "):
        load(tmp_path, {**argument, "nodes": [{**NODE, "namespace": "${craft}"}]})


@pytest.mark.parametrize("namespace", ["", "/", "a", "/a/b_2", "a/"])
def test_plain_namespaces_stay(tmp_path, namespace):
    system = load(tmp_path, {"nodes": [{**NODE, "namespace": namespace}]})
    assert system.nodes[0].namespace == "/" + namespace.strip("/")


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000, "\ud800"])
@pytest.mark.parametrize("key", ["argument", "extends", "parameter_files", "scenario"])
def test_names_that_no_file_can_have_are_refused(tmp_path, key, name):
    content = {
        "argument": {"arguments": {"a": {"default": name, "file": True}}},
        "extends": {"extends": name},
        "parameter_files": {"nodes": [{**NODE, "parameter_files": [name]}]},
        "scenario": {
            "arguments": {"scenario": {"default": name}},
            "nodes": [{**NODE, "name": "${chief}"}],
        },
    }[key]
    content = {"nodes": [NODE], **content}
    path = tmp_path / "system.yaml"
    path.write_text(format_yaml(content))
    with pytest.raises(SystemFileError) as caught:
        load_system(path, (), RunSettings(run_directory=tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("number", ["${", [1], 1.5, True])
def test_a_number_of_deputies_that_is_none_is_refused(tmp_path, number):
    scenario = pathlib.Path(__file__).parents[4] / "config/scenario/train.yaml"
    content = {
        "arguments": {
            "scenario": {"default": str(scenario), "file": True},
            "number_of_deputies": {"default": number},
        },
        "nodes": [{**NODE, "for_each": "deputy", "namespace": "${deputy}"}],
    }
    with pytest.raises(SystemFileError, match="a whole number expected, got"):
        load(tmp_path, content)


@pytest.mark.parametrize("executable", ["../../../bin/sh", "/bin/sh", ".", "..", ""])
def test_only_programs_of_the_package_are_found(executable):
    with pytest.raises(ExecutableNotFoundError):
        executable_path("vtff_bringup", executable)
    with pytest.raises(ExecutableNotFoundError):
        executable_path("../../bin", "sh")


def test_a_node_called_like_a_program_with_a_dot_needs_a_name(tmp_path):
    with pytest.raises(SystemFileError, match="'executable' must be letters"):
        load(tmp_path, {"nodes": [{**NODE, "executable": "run.py"}]})
    system = load(tmp_path, {"nodes": [{**NODE, "executable": "run.py", "name": "runner"}]})
    assert system.nodes[0].executable == "run.py"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nodes: " + "[" * 5000 + "]" * 5000, "nested deeper than"),
        ("a: &a [*a]", r"line 1: .\*a"),
        ("description: !!timestamp 2001", "line 1: .*tags"),
        ("a: 1\nb: 2\na: 3", "line 3: .a. is given twice"),
    ],
)
def test_deep_and_endless_files_are_one_line(tmp_path, text, expected):
    with pytest.raises(SystemFileError, match=expected) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value)


SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-5, 5)
    | st.sampled_from(["", "a", "../a", "/a", "${x}", "${run_directory}", "${scenario.a}", "a/b"])
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["a", "x", "default", "file"]) | SCALARS, inner)
    ),
    max_leaves=6,
)
KEYS = st.sampled_from(
    ["name", "package", "executable", "namespace", "parameters", "parameter_files", "remaps"]
    + ["lockstep", "when", "sets", "arguments", "own_process", "ends_run"]
)
ENTRIES = st.dictionaries(KEYS, VALUES, max_size=4).map(lambda entry: {**NODE, **entry}) | VALUES
SYSTEMS = st.fixed_dictionaries(
    {"nodes": st.lists(ENTRIES, max_size=3) | VALUES},
    optional={
        "processes": st.lists(ENTRIES, max_size=2) | VALUES,
        "arguments": st.dictionaries(st.sampled_from(["x", "scenario"]), VALUES) | VALUES,
        "description": VALUES,
    },
)


@given(SYSTEMS, st.booleans())
@settings(max_examples=300, deadline=None)
def test_any_file_is_a_system_with_plain_names_or_one_line(content, extended):
    with tempfile.TemporaryDirectory() as folder:
        if extended:
            (pathlib.Path(folder) / "base.yaml").write_text(format_yaml(content))
            content = "extends: base.yaml"
        try:
            system = load(folder, content)
        except SystemFileError as error:
            assert len(str(error).splitlines()) == 1
            return
    names = [node.qualified_name.replace("/", "") for node in system.nodes]
    names += [process.name for process in system.processes]
    assert all(name.isidentifier() and name.isascii() for name in names)

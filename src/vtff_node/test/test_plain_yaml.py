"""YAML 1.2 of bounded depth and size: every text is a value or one line."""

from __future__ import annotations

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_node.plain_yaml import (
    MAXIMUM_BYTES,
    MAXIMUM_DEPTH,
    MAXIMUM_DIGITS,
    MAXIMUM_VALUES,
    PlainYamlError,
    format_yaml,
    parse_yaml,
)

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)
#: What readers of YAML take for something else than a text.
WORDS = st.sampled_from(
    ["yes", "No", "ON", "off", "y", "N", "null", "~", "", "true", "1e3", "1.5e3", "1_000", "0o17",
     "017", "0x1F", "0b1", ".inf", ".NaN", "12:30:45", "2016-03-21", "2016-03-21T01:00:00Z", "=",
     "<<", "!x", "&a", "*a", "- a", "a: b", "a #b", "%a", "@a", "`a", "a:", "#", "?", "|", "---"]
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5e3", 1500.0),
        ("1.5e-3", 1.5e-3),
        ("1.0E3", 1000.0),
        ("2e-4", 2e-4),
        ("-1E6", -1e6),
        (".5", 0.5),
        ("5.", 5.0),
        ("-.inf", -math.inf),
        ("017", 17),
        ("0o17", 15),
        ("0x1F", 31),
        ("+12", 12),
        ("TRUE", True),
        ("Null", None),
        ("~", None),
        ("", None),
        ("# nothing", None),
        ("2e", "2e"),
        ("1_000", "1_000"),
        ("12:30:45", "12:30:45"),
        ("2016-03-21", "2016-03-21"),
        ("yes", "yes"),
        ("off", "off"),
        ("'1'", "1"),
        ('"true"', "true"),
    ],
)
def test_types_are_those_of_yaml_1_2(text, value):
    read = parse_yaml(text)
    assert (read, type(read)) == (value, type(value))


@given(VALUES)
@settings(max_examples=100, deadline=None)
def test_written_values_come_back(value):
    assert parse_yaml(format_yaml(value)) == value
    assert parse_yaml(format_yaml(value, on_one_line=True)) == value


@given(st.lists(WORDS | st.floats(allow_nan=False) | st.booleans() | st.none(), max_size=6))
@settings(max_examples=200, deadline=None)
def test_readers_of_yaml_1_1_find_the_same_in_what_is_written(values):
    for on_one_line in (False, True):
        text = format_yaml({"values": values}, on_one_line=on_one_line)
        assert repr(yaml.safe_load(text)) == repr(parse_yaml(text)) == repr({"values": values})


def test_one_line_is_one_line():
    assert format_yaml({"a": [1, "x" * 300], "b": {}}, on_one_line=True).count("\n") == 0
    assert format_yaml("scenario.yaml", on_one_line=True) == "scenario.yaml"
    assert format_yaml(1e-5, on_one_line=True) == "1.0e-05"


@given(st.text(alphabet="[]{}&*<:-!,\"' \nab01?|>%@#.", max_size=60))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_value_or_one_line(text):
    try:
        parse_yaml(text)
    except PlainYamlError as error:
        assert len(str(error).splitlines()) == 1


@pytest.mark.parametrize("left, right", [("[", "]"), ("{a: ", "}"), ("- ", "")])
def test_depth_is_limited(left, right):
    assert parse_yaml(left * MAXIMUM_DEPTH + right * MAXIMUM_DEPTH) is not None
    with pytest.raises(PlainYamlError, match=f"^line 1: .*{MAXIMUM_DEPTH}"):
        parse_yaml(left * 100_000 + right * 100_000)


def test_size_is_limited():
    with pytest.raises(PlainYamlError, match=f"{MAXIMUM_BYTES}"):
        parse_yaml("#" * (MAXIMUM_BYTES + 1))
    with pytest.raises(PlainYamlError, match=f"^line 1: .*{MAXIMUM_DIGITS}"):
        parse_yaml("9" * (MAXIMUM_DIGITS + 1))


def test_aliases_count_each_time():
    assert parse_yaml("a: &x [1, 2]\nb: *x")["b"] == [1, 2]
    bomb = "a0: &a0 [x, x]\n" + "".join(
        f"a{level}: &a{level} [*a{level - 1}, *a{level - 1}]\n" for level in range(1, 40)
    )
    with pytest.raises(PlainYamlError, match=f"^line 1[0-9]: .*{MAXIMUM_VALUES}"):
        parse_yaml(bomb)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\nb: 2\na: 3", "^line 3: 'a' is given twice"),
        ("x: {a: 1,\n a: 1}", "^line 2: 'a' is given twice"),
        ("- 1\n- &a [*a]", r"^line 2: '\*a'"),
        ("\n*a", r"^line 2: '\*a'"),
        ("!!float x", "^line 1: 'tag:yaml.org,2002:float'"),
        ("a: !!python/object/apply:os.system [ls]", "^line 1: .*os.system"),
        ("a:\n  ! x", "^line 2: '!'"),
        ("[a]: 1", "^line 1: a key"),
        ("a: [", "line 1"),
        ("a: 1\n---\nb: 2", "^line 3"),
        ("a: \x01", "unacceptable character"),
    ],
)
def test_a_wrong_text_is_refused_with_its_line(text, expected):
    with pytest.raises(PlainYamlError, match=expected) as caught:
        parse_yaml(text)
    assert "\n" not in str(caught.value)

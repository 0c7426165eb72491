"""YAML of bounded depth and size: every text is a value or one line."""

from __future__ import annotations

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_node.plain_yaml import (
    FAST_LOADER,
    MAXIMUM_DEPTH,
    MAXIMUM_VALUES,
    PlainYamlError,
    parse_yaml,
)

LOADERS = pytest.mark.parametrize("loader", [yaml.SafeLoader, FAST_LOADER])

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@pytest.mark.parametrize(("text", "value"), [("2e-4", 2e-4), ("-1E6", -1e6), ("2e", "2e")])
def test_a_number_may_have_an_exponent_without_a_point(text, value):
    assert parse_yaml(text) == value


@given(VALUES)
@settings(max_examples=100, deadline=None)
def test_plain_values_come_back(value):
    assert parse_yaml(yaml.safe_dump(value)) == value
    assert parse_yaml(yaml.safe_dump(value), FAST_LOADER) == value


@given(st.text(alphabet="[]{}&*<:-!,\"' \nab01?|>%@#.", max_size=60))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_value_or_one_line(text):
    for loader in (yaml.SafeLoader, FAST_LOADER):
        try:
            parse_yaml(text, loader)
        except PlainYamlError as error:
            assert len(str(error).splitlines()) == 1


@LOADERS
@pytest.mark.parametrize("left, right", [("[", "]"), ("{a: ", "}"), ("- ", "")])
def test_depth_is_limited(left, right, loader):
    assert parse_yaml(left * MAXIMUM_DEPTH + right * MAXIMUM_DEPTH, loader) is not None
    with pytest.raises(PlainYamlError, match=f"^line 1: nested deeper than {MAXIMUM_DEPTH}"):
        parse_yaml(left * 100_000 + right * 100_000, loader)


@LOADERS
def test_aliases_count_each_time(loader):
    assert parse_yaml("a: &x [1, 2]\nb: *x", loader)["b"] == [1, 2]
    bomb = "a0: &a0 [x, x]\n" + "".join(
        f"a{level}: &a{level} [*a{level - 1}, *a{level - 1}]\n" for level in range(1, 40)
    )
    with pytest.raises(PlainYamlError, match=f"more than {MAXIMUM_VALUES} values"):
        parse_yaml(bomb, loader)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("&a [*a]", "line 1: '\\*a' stands within itself"),
        ("a: 2001-13-45", "wrong form"),
        ("!!float x", "wrong form"),
        ("!!bool x", "wrong form"),
        ("!!timestamp x", "wrong form"),
        ("9" * 5000, "wrong form"),
        ("!!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a: [", "expected the node content"),
    ],
)
def test_what_yaml_cannot_build_is_one_line(text, expected):
    with pytest.raises(PlainYamlError, match=expected) as caught:
        parse_yaml(text)
    assert "\n" not in str(caught.value)

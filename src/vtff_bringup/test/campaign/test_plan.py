"""Changes of a case in files and on the command line of its run."""

from __future__ import annotations

import copy

import pytest

from vtff_bringup.campaign.plan import override, set_entry
from vtff_bringup.system.overrides import parse_override
from vtff_node.plain_yaml import format_yaml

FIELDS = {
    "seed": 1,
    "spacecraft": [{"name": "chief"}, {"name": "deputy", "target": {"position": [1.0, 2.0]}}],
}


@pytest.mark.parametrize(
    "value",
    [1e-5, 0.1 + 0.2, 1.4, 3, True, "paper", "1.0", "", "a: b", [1.0, 1e22, -0.0], {"a": [1]}],
)
def test_an_override_keeps_its_value_to_the_last_digit(value):
    text = override("node.parameter", value)
    key, read = parse_override(text)
    assert key == "node.parameter"
    assert repr(read) == repr(value)
    assert "\n" not in text


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("seed", "{seed: 9"),
        ("new", "new: 9"),
        ("spacecraft.deputy.target.position.1", "position: [1.0, 9]"),
        ("spacecraft.1.target.position.0", "position: [9, 2.0]"),
        ("spacecraft.chief", "spacecraft: [9, "),
        ("spacecraft.chief.mass", "{name: chief, mass: 9}"),
    ],
)
def test_an_entry_is_named_by_names_and_indices(path, text):
    fields = copy.deepcopy(FIELDS)
    set_entry(fields, path, 9)
    assert text in format_yaml(fields, on_one_line=True)


@pytest.mark.parametrize(
    ("path", "named"),
    [
        ("spacecraft.third.mass", "spacecraft.third"),
        ("spacecraft.2", "spacecraft.2"),
        ("seed.x", "seed.x"),
        ("a.b.c", "a"),
        ("spacecraft.deputy.target.position.2", "spacecraft.deputy.target.position.2"),
    ],
)
def test_an_entry_that_is_not_there_is_named(path, named):
    with pytest.raises(LookupError, match=f"there is no entry '{named}'"):
        set_entry(copy.deepcopy(FIELDS), path, 9)

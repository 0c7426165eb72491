"""Schema texts: structure, order, search path and errors."""

import pytest

from vtff_bag.file.errors import UnknownTypeError
from vtff_bag.file.message_definitions import (
    SEPARATOR,
    first_field_type,
    message_class,
    message_definition,
)

FILES = {
    "alpha/msg/Root": (
        "# comment kept\n"
        "uint8 LIMIT=3\n"
        'string NAME="beta/Leaf x"\n'
        "Branch branch  # nested, unqualified\n"
        "beta/Leaf[<=3] leaves\n"
        'string<=10 label "a=b"\n'
        "float64[9] matrix\n"
    ),
    "alpha/msg/Branch": "beta/Leaf leaf\nbool[] switches\n",
    "beta/msg/Leaf": "int32 value 7\n",
    "beta/msg/Broken": "gamma/Absent absent\n",
}


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    for name, text in FILES.items():
        path = tmp_path / "share" / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return tmp_path


def test_dependencies_follow_depth_first_and_once(prefix):
    expected = (
        FILES["alpha/msg/Root"]
        + f"\n{'=' * 80}\nMSG: alpha/Branch\n"
        + FILES["alpha/msg/Branch"]
        + f"\n{'=' * 80}\nMSG: beta/Leaf\n"
        + FILES["beta/msg/Leaf"]
    )
    assert message_definition("alpha/msg/Root") == expected


def test_first_field_skips_constants(prefix):
    assert first_field_type("alpha/msg/Root") == "alpha/Branch"
    assert first_field_type("beta/msg/Leaf") == "int32"


def test_earlier_prefix_wins(prefix, tmp_path_factory, monkeypatch):
    overlay = tmp_path_factory.mktemp("overlay")
    path = overlay / "share/beta/msg/Leaf.msg"
    path.parent.mkdir(parents=True)
    path.write_text("int64 value\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{overlay}:{prefix}")
    assert message_definition("beta/msg/Leaf") == "int64 value\n"


@pytest.mark.parametrize(
    ("type_name", "named"),
    [
        ("alpha/msg/Missing", "alpha/msg/Missing"),
        ("beta/msg/Broken", "gamma/msg/Absent"),
        ("no type", "no type"),
        ("alpha/srv/Root", "alpha/srv/Root"),
    ],
)
def test_unknown_type_is_named(prefix, type_name, named):
    with pytest.raises(UnknownTypeError, match=named):
        message_definition(type_name)


def test_missing_dependency_names_who_needs_it(prefix):
    with pytest.raises(UnknownTypeError, match="needed by 'beta/msg/Broken'"):
        message_definition("beta/msg/Broken")


def test_class_of_unknown_type_is_named():
    with pytest.raises(UnknownTypeError, match="no_such_package/msg/Thing"):
        message_class("no_such_package/msg/Thing")


def test_real_message_matches_the_rosbags_parser():
    """An independent parser finds the same types in the text as in ROS's own definitions."""
    pytest.importorskip("nav_msgs")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    text = message_definition("nav_msgs/msg/Odometry")
    assert SEPARATOR + "\nMSG: std_msgs/Header\n" in text
    parsed = get_types_from_msg(text, "nav_msgs/msg/Odometry")
    store = get_typestore(Stores.ROS2_JAZZY)
    assert "geometry_msgs/msg/Quaternion" in parsed
    assert len(parsed) == text.count("\nMSG: ") + 1
    for name, (_, fields) in parsed.items():
        assert fields == store.get_msgdef(name).fields, name

"""Parameter tables: declaration on a real node, checks, and messages that help."""

from __future__ import annotations

import dataclasses

import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")
from domain_coordinator import domain_id  # noqa: E402
from rclpy.node import Node  # noqa: E402

from vtff_node import parameters  # noqa: E402
from vtff_node.parameters import REQUIRED, ParameterError, parameter  # noqa: E402


@dataclasses.dataclass(frozen=True)
class Table:
    port: str = parameter(REQUIRED, "where the receiver is")
    cap: float = parameter(1.4, "largest acceleration", unit="m/s^2", minimum=0.0, maximum=10.0)
    design: str = parameter("paper", "control design", choices=("paper", "delay_aware"))
    steps: int = parameter(1, "delay", minimum=0, maximum=100)
    target: list[float] = parameter([0.0, 100.0, 0.0], "target", unit="m")
    names: list[str] = parameter([], "names")
    active: bool = parameter(False, "switch")


@pytest.fixture(scope="module")
def context():
    context = rclpy.Context()
    with domain_id() as domain:
        rclpy.init(context=context, domain_id=domain)
        yield context
        rclpy.try_shutdown(context=context)


def declared(context, *given):
    arguments = ["--ros-args"]
    for text in given:
        arguments += ["-p", text]
    node = Node(
        "table",
        context=context,
        cli_args=arguments,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
    try:
        values = parameters.declare(node, Table)
        parameters.refuse_unknown(node)
        description = node.describe_parameter("cap").description
        return values, description
    finally:
        node.destroy_node()


def test_defaults_and_given_values(context):
    values, description = declared(context, "port:=file://a", "cap:=2", "names:=[a, b]")
    assert values == Table(port="file://a", cap=2.0, names=["a", "b"])
    assert isinstance(values.cap, float)
    assert description == "largest acceleration [m/s^2] (0.0 to 10.0)"


def test_whole_numbers_are_accepted_for_lists_of_reals(context):
    values, _ = declared(context, "port:=x", "target:=[0, 200, 0]")
    assert values.target == [0.0, 200.0, 0.0]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((), "parameter 'port' is required"),
        (("port:=x", "cap:=-1.0"), "'cap'"),
        (("port:=x", "cap:=.nan"), "'cap'"),
        (("port:=x", "cap:=fast"), "'cap'"),
        (("port:=x", "design:=best"), "choose one of: paper, delay_aware"),
        (("port:=x", "steps:=101"), "'steps'"),
        (("port:=x", "active:=3"), "'active'"),
        (("port:=x", "desing:=paper"), "no parameter 'desing'; did you mean: design"),
    ],
)
def test_wrong_values_are_named(context, given, expected):
    with pytest.raises(ParameterError, match=expected.replace("(", r"\(")):
        declared(context, *given)


@dataclasses.dataclass(frozen=True)
class WiderTable(Table):
    own: int = parameter(7, "a parameter of its own")
    steps: int = parameters.with_default(Table, "steps", 3)


def test_an_inherited_parameter_keeps_its_range_with_another_default():
    fields = {field.name: field for field in dataclasses.fields(WiderTable)}
    assert (WiderTable().steps, Table().steps) == (3, 1)
    assert parameters.describe(fields["steps"]) == "delay (0 to 100)"
    with pytest.raises(ParameterError, match="'steps' is 101"):
        parameters.check("steps", fields["steps"], 101)


def test_a_table_names_its_own_parameters_before_the_inherited_ones():
    names = [field.name for field in parameters.fields_in_order(WiderTable)]
    assert names == ["own", *(field.name for field in dataclasses.fields(Table))]

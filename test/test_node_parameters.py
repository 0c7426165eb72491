"""Numbers that users give to nodes: each arrives as it was given, or is refused by name."""

from __future__ import annotations

import ast
import dataclasses
import importlib.metadata
import inspect
import math
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from vtff_node.executables import ExecutableNotFoundError, node_class
from vtff_node.node import CommonParameters
from vtff_node.parameters import ParameterError, check, declare, metadata_of
from vtff_node.plugins.loading import load_plugin, plugin_names

PACKAGES = ("vtff_bag", "vtff_control", "vtff_iono", "vtff_nav", "vtff_sim_bridge")
#: A value that each table takes for a parameter without a default, by the parameter's type.
GIVEN = {"str": "x", "list[str]": ["x"], "float": 1.0, "int": 1}


def node_classes() -> Iterator[Any]:
    for package in PACKAGES:
        scripts = importlib.metadata.distribution(package).entry_points
        for script in scripts.select(group="console_scripts"):
            try:
                yield node_class(package, script.name)
            except ExecutableNotFoundError:
                continue  # a program without ROS


def tables_of(kind: Any) -> list[type]:
    """Return the tables of a node, with those of all plug-ins that it may have."""
    tables = [kind.Parameters, CommonParameters]
    if kind.Plugins is not None:
        plugins = [load_plugin(kind.Plugins, name) for name in plugin_names(kind.Plugins.name)]
        tables += [plugin.parameter_table for plugin in plugins]
    return [table for table in tables if table is not None]


NODES = list(node_classes())
TABLES = sorted({table for kind in NODES for table in tables_of(kind)}, key=lambda t: t.__name__)


def floats_of(table: type) -> list[dataclasses.Field[Any]]:
    return [field for field in dataclasses.fields(table) if str(field.type).startswith("float")]


@pytest.fixture(scope="module")
def context() -> Iterator[Context]:
    context = Context()
    with domain_id() as domain:
        rclpy.init(context=context, domain_id=domain)
        yield context
        context.shutdown()


def declared(context: Context, table: type, name: str, value: float) -> Any:
    """Return the table that a node has whose user gives one number, and what is required."""
    values = {
        field.name: GIVEN[str(field.type)]
        for field in dataclasses.fields(table)
        if metadata_of(field)["required"]
    }
    overrides = [Parameter(key, value=item) for key, item in {**values, name: value}.items()]
    options = {"enable_rosout": False, "start_parameter_services": False}
    node = Node("table", context=context, parameter_overrides=overrides, **options)
    try:
        return declare(node, table)
    finally:
        node.destroy_node()


def test_there_are_nodes() -> None:
    assert len(NODES) > 20 and sum(len(floats_of(table)) for table in TABLES) > 100


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_zero_and_the_smallest_value_arrive_or_are_refused_by_name(
    table: type, context: Context
) -> None:
    for field in floats_of(table):
        minimum = metadata_of(field)["minimum"]
        for value in {0.0, 0.0 if minimum is None else float(minimum)}:
            try:
                arrived = getattr(declared(context, table, field.name, value), field.name)
            except ParameterError as error:
                assert field.name in str(error)
                assert value == 0.0
                assert minimum is None or minimum > 0.0, "what the description allows is refused"
            else:
                assert (arrived, type(arrived)) == (value, float)


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_what_is_no_finite_number_is_refused_by_name(table: type) -> None:
    for field in floats_of(table):
        for value in (math.nan, math.inf, -math.inf):
            with pytest.raises(ParameterError, match=f"'{field.name}' is {value}; .*finite"):
                check(field.name, field, value)


@pytest.mark.parametrize("kind", NODES, ids=lambda kind: kind.__name__)
def test_no_node_takes_a_number_for_a_truth_value(kind: Any) -> None:
    """`given.weight or None` makes the default of 0, which the user wrote."""
    names = {field.name for table in tables_of(kind) for field in floats_of(table)}
    source = inspect.getsource(sys.modules[kind.__module__])
    wrong = [
        f"line {part.lineno}: {ast.unparse(part)}"
        for part in ast.walk(ast.parse(source))
        for tested in _tested(part)
        if isinstance(tested, ast.Attribute) and tested.attr in names
    ]
    assert not wrong


def _tested(part: ast.AST) -> list[ast.expr]:
    """Return the expressions whose truth decides."""
    if isinstance(part, ast.BoolOp):
        return part.values
    if isinstance(part, (ast.If, ast.IfExp, ast.While)):
        return [part.test]
    return [part.operand] if isinstance(part, ast.UnaryOp) and isinstance(part.op, ast.Not) else []

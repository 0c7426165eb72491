"""Node parameters as one table: a frozen dataclass whose fields carry their documentation.

A node lists its parameters once::

    @dataclass(frozen=True)
    class ThrusterModelParameters:
        cap: float = parameter(1.4, "largest acceleration on each axis", unit="m/s^2", minimum=0.0)

`declare` turns the table into ROS parameters with description, unit and range, and
returns the dataclass filled with the values in force.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.parameter import Parameter

from vtff_node.plain_yaml import truth_word_hint

TableT = TypeVar("TableT")

#: ROS wants both limits of a range; these stand for a side that is open.
LARGEST_FLOAT = sys.float_info.max
LARGEST_INTEGER = 2**63 - 1

#: Beginnings of the names of parameters that ROS itself declares.
_ROS_OWN = ("qos_overrides", "use_sim_time", "start_type_description_service")

_PYTHON_TYPES = {"bool": bool, "int": int, "str": str}
_KIND_NAMES = {
    "bool": "true or false",
    "int": "a whole number",
    "str": "a text",
    "list[int]": "a list of whole numbers",
    "list[str]": "a list of texts",
}

#: Stands for "no default": the parameter has to be given.
REQUIRED: Any = object()


class ParameterError(ValueError):
    """A parameter is missing or has an impossible value; the text names it."""


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[str] = (),
) -> Any:
    """Describe one parameter of a table.

    Parameters
    ----------
    default
        Value when the user gives none, or `REQUIRED`. A parameter that may be absent has the type
        ``float | None`` and the default None: no number stands for "not given".
    description
        One line for ``ros2 param describe`` and the documentation.
    unit
        Unit of the value, empty for none.
    minimum, maximum
        Closed range of a number; ``None`` leaves that side open.
    choices
        The allowed values of a string.
    """
    metadata = {
        "description": description,
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "choices": tuple(choices),
        "required": default is REQUIRED,
    }
    if default is REQUIRED:
        return dataclasses.field(default=None, metadata=metadata)
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def with_default(table: type, name: str, default: Any) -> Any:
    """Return a parameter of an inherited table with another default."""
    field = table.__dataclass_fields__[name]  # type: ignore[attr-defined]
    return dataclasses.field(default=default, metadata=field.metadata)


def fields_in_order(table: type) -> list[dataclasses.Field[Any]]:
    """Return the fields of a table, its own before the inherited ones."""
    inherited = {
        field.name
        for base in table.__mro__[1:]
        if dataclasses.is_dataclass(base)
        for field in dataclasses.fields(base)
    }
    return sorted(dataclasses.fields(table), key=lambda field: field.name in inherited)


def metadata_of(field: dataclasses.Field[Any]) -> Mapping[str, Any]:
    """Return what is known of a field; a table of a plug-in may be a plain dataclass."""
    has_no_default = (
        field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    )
    plain = {
        "description": "",
        "unit": "",
        "minimum": None,
        "maximum": None,
        "choices": (),
        "required": has_no_default,
    }
    return {**plain, **field.metadata}


def describe(field: dataclasses.Field[Any]) -> str:
    """Return one line of documentation of a table field, with unit, choices and range."""
    metadata = metadata_of(field)
    text = str(metadata["description"])
    if metadata["unit"]:
        text += f" [{metadata['unit']}]"
    if metadata["choices"]:
        text += " (" + " | ".join(metadata["choices"]) + ")"
    minimum, maximum = metadata["minimum"], metadata["maximum"]
    if minimum is not None and maximum is not None:
        text += f" ({minimum} to {maximum})"
    elif minimum is not None:
        text += f" (at least {minimum})"
    elif maximum is not None:
        text += f" (at most {maximum})"
    return text


def default_of(field: dataclasses.Field[Any]) -> Any:
    """Return the default of a table field; ``None`` where it is required."""
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return None if field.default is dataclasses.MISSING else field.default


def check(name: str, field: dataclasses.Field[Any], value: Any) -> None:
    """Check a value against the choices and the range of its field.

    Raises
    ------
    ParameterError
        If the value is not allowed; the text names the parameter, the value and what is allowed.
    """
    metadata = metadata_of(field)
    choices = metadata["choices"]
    if choices and value not in choices:
        raise ParameterError(
            f"parameter '{name}' is '{value}'; choose one of: {', '.join(choices)}"
        )
    minimum, maximum = metadata["minimum"], metadata["maximum"]
    for item in value if isinstance(value, (list, tuple)) else (value,):
        if isinstance(item, bool) or not isinstance(item, (int, float)):
            continue
        if not math.isfinite(item):
            raise ParameterError(f"parameter '{name}' is {item}; it must be a finite number")
        if minimum is not None and item < minimum:
            raise ParameterError(f"parameter '{name}' is {item}; it must be at least {minimum}")
        if maximum is not None and item > maximum:
            raise ParameterError(f"parameter '{name}' is {item}; it must be at most {maximum}")


def declare(node: Any, table: type[TableT]) -> TableT:
    """Declare every field of a table on a node and return the values in force.

    Parameters
    ----------
    node : rclpy.node.Node
        The node that owns the parameters; they are read-only after the start.
    table
        Frozen dataclass made with `parameter`.

    Raises
    ------
    ParameterError
        If a required parameter is missing, has the wrong type or lies outside its range.
    """
    values: dict[str, Any] = {}
    for field in dataclasses.fields(table):  # type: ignore[arg-type]
        try:
            value = _declare_field(node, field)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f"parameter '{field.name}': {error}") from error
        if value is None:
            if metadata_of(field)["required"]:
                raise ParameterError(
                    f"parameter '{field.name}' is required: {describe(field)}; "
                    f"give it with --ros-args -p {field.name}:=..."
                )
            value = default_of(field)
        check(field.name, field, value)
        values[field.name] = value
    try:
        return table(**values)
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(str(error)) from error


def check_values(node_name: str, values: Mapping[str, Any], tables: Sequence[type]) -> None:
    """Check values that a node would be given, without the node.

    Parameters
    ----------
    node_name
        Name for messages.
    values
        Value by parameter name, as read from YAML.
    tables
        All tables of the node.

    Raises
    ------
    ParameterError
        If the node has no such parameter, or a value has the wrong type or is not allowed.
    """
    fields = {field.name: field for table in tables for field in dataclasses.fields(table)}
    _refuse_unknown_names(node_name, values, fields)
    for name, value in values.items():
        if name.startswith(_ROS_OWN):
            continue
        field = fields[name]
        kind = _type_name(field)
        expected = _PYTHON_TYPES.get(kind.removeprefix("list[").removesuffix("]"))
        items = value if kind.startswith("list[") and isinstance(value, list) else [value]
        if kind in ("float", "list[float]"):
            value = _converted_numbers(name, value, kind == "list[float]")
        elif expected is not None and any(type(item) is not expected for item in items):
            hint = truth_word_hint(value) if kind == "bool" else ""
            raise ParameterError(
                f"parameter '{name}' is {value!r}; it must be {_KIND_NAMES[kind]}{hint}"
            )
        check(name, field, value)


def refuse_unknown(node: Any) -> None:
    """Refuse parameter values given for names that the node does not have.

    ROS ignores them silently, so that a misspelt parameter would go unnoticed.

    Raises
    ------
    ParameterError
        If there is such a value; the text names it and the parameters with the nearest names.
    """
    _refuse_unknown_names(node.get_name(), node._parameter_overrides, node._parameters)


def _refuse_unknown_names(node_name: str, given: Iterable[str], declared: Iterable[str]) -> None:
    names = {name for name in declared if not name.startswith(_ROS_OWN)}
    for name in sorted(set(given) - names):
        if name.startswith(_ROS_OWN):
            continue
        near = difflib.get_close_matches(name, names, n=3)
        hint = (
            f"did you mean: {', '.join(near)}?" if near else f"it has: {', '.join(sorted(names))}"
        )
        raise ParameterError(f"node '{node_name}' has no parameter '{name}'; {hint}")


def _declare_field(node: Any, field: dataclasses.Field[Any]) -> Any:
    types = {
        "bool": Parameter.Type.BOOL,
        "int": Parameter.Type.INTEGER,
        "float": Parameter.Type.DOUBLE,
        "str": Parameter.Type.STRING,
        "list[float]": Parameter.Type.DOUBLE_ARRAY,
        "list[int]": Parameter.Type.INTEGER_ARRAY,
        "list[str]": Parameter.Type.STRING_ARRAY,
    }
    type_name = _type_name(field)
    if type_name not in types:
        raise ParameterError(
            f"parameter '{field.name}' has the type {type_name}; possible are {', '.join(types)}"
        )
    kind = types[type_name]
    # Dynamic typing lets a user write 1 for 1.0; the value is converted below.
    numbers = kind in (Parameter.Type.DOUBLE, Parameter.Type.DOUBLE_ARRAY)
    descriptor = ParameterDescriptor(
        description=describe(field), read_only=True, dynamic_typing=numbers
    )
    metadata = metadata_of(field)
    minimum, maximum = metadata["minimum"], metadata["maximum"]
    if minimum is not None or maximum is not None:
        if kind is Parameter.Type.DOUBLE:
            low = -LARGEST_FLOAT if minimum is None else float(minimum)
            high = LARGEST_FLOAT if maximum is None else float(maximum)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif kind is Parameter.Type.INTEGER:
            first = -LARGEST_INTEGER if minimum is None else int(minimum)
            last = LARGEST_INTEGER if maximum is None else int(maximum)
            descriptor.integer_range = [IntegerRange(from_value=first, to_value=last, step=1)]
    default = default_of(field)
    if numbers and default in (None, []):
        declared = node.declare_parameter(field.name, None, descriptor)
    elif default is None or default == []:
        # rclpy cannot tell the type of an empty list; declaring by type leaves it unset.
        declared = node.declare_parameter(field.name, kind, descriptor)
    else:
        declared = node.declare_parameter(field.name, default, descriptor)
    value = declared.value
    if value is None or not numbers:
        return list(value) if kind.name.endswith("_ARRAY") and value is not None else value
    return _converted_numbers(field.name, value, kind is Parameter.Type.DOUBLE_ARRAY)


def _type_name(field: dataclasses.Field[Any]) -> str:
    """Return the type of a value that is given: ``float`` for ``float | None``."""
    # Postponed annotations are text; those of a plug-in's table may be types.
    name = field.type.__name__ if field.type in (bool, int, float, str) else str(field.type)  # type: ignore[union-attr]
    return name.removesuffix(" | None")


def _converted_numbers(name: str, value: Any, many: bool) -> Any:
    items = list(value) if hasattr(value, "__iter__") and not isinstance(value, str) else [value]
    usable = all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in items)
    if not usable or (not many and len(items) != 1):
        wanted = "a list of numbers" if many else "a number"
        raise ParameterError(f"parameter '{name}' is {value!r}; it must be {wanted}")
    return [float(item) for item in items] if many else float(items[0])

"""Strict reading of the fields of a scenario file; every problem names file and field."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_node.plain_yaml import PlainYamlError, parse_yaml, truth_word_hint

DEFAULT_HARD_RADIUS = 10.0
"""Distance (m) that no two spacecraft may come within, where the file gives none."""

_Value = TypeVar("_Value")
_Group = TypeVar("_Group")


class ScenarioError(ValueError):
    """A scenario file that cannot be used; the message names the file and the field."""


_YAML_NAMES = {
    types.NoneType: "null",
    bool: "true or false",
    float: "a number",
    int: "a whole number",
    str: "a text",
    tuple: "a list",
}
"""What a type is called to the writer of a file."""


def read_yaml(path: Path) -> Any:
    """Return what a YAML file holds.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not YAML, or gives a field twice.
    """
    try:
        return parse_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScenarioError(f"{path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, PlainYamlError) as error:
        raise ScenarioError(f"{path}: not readable as YAML: {error}") from None


class Section:
    """One mapping of a scenario file, with its place in the file for messages.

    Every field that is read is crossed off; `finish` refuses what is left.
    """

    def __init__(self, file: str, place: str, fields: Any) -> None:
        self._file = file
        self._place = place
        if not isinstance(fields, dict):
            raise self.error("", "a mapping of fields expected")
        self._fields: dict[Any, Any] = fields
        self._read: set[str] = set()

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields that the file gives."""
        return tuple(str(name) for name in self._fields)

    def error(self, name: str, problem: str) -> ScenarioError:
        """Return the error for a field of this section (the section itself if empty)."""
        place = ".".join(part for part in (self._place, name) if part)
        return ScenarioError(": ".join(part for part in (self._file, place, problem) if part))

    def value(self, name: str) -> Any:
        """Return a field as YAML gives it."""
        if name not in self._fields:
            raise self.error(name, "field is missing")
        self._read.add(name)
        return self._fields[name]

    def finish(self) -> None:
        """Refuse fields that nothing has read."""
        for name in self._fields:
            if name not in self._read:
                raise self.error(str(name), "unknown field")

    def convert(self, name: str, convert: Callable[[], _Value]) -> _Value:
        """Run a conversion and turn its ValueError into one that names the field."""
        try:
            return convert()
        except ScenarioError:
            raise
        except ValueError as error:
            raise self.error(name, str(error)) from None

    def text(self, name: str) -> str:
        """Return a field that is a non-empty text."""
        value = self.value(name)
        if not isinstance(value, str) or not value.strip():
            raise self.error(name, f"a text expected, got {value!r}")
        return value.strip()

    def choice(self, name: str, choices: tuple[str, ...]) -> str:
        """Return a field that is one of some texts."""
        value = self.value(name)
        if value not in choices:
            raise self.error(name, f"one of {', '.join(choices)} expected, got {value!r}")
        return str(value)

    def number(self, name: str, minimum: float = -math.inf) -> float:
        """Return a field that is a finite number of at least `minimum`."""
        value = self.value(name)
        if not _is_number(value):
            raise self.error(name, f"a number expected, got {value!r}")
        if value < minimum:
            raise self.error(name, f"at least {minimum:g} expected, got {value!r}")
        return float(value)

    def whole_number(self, name: str) -> int:
        """Return a field that is a whole number of 0 or more."""
        value = self.value(name)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise self.error(name, f"a whole number of 0 or more expected, got {value!r}")
        return value

    def vector(self, name: str) -> FloatArray:
        """Return a field that is a list of three finite numbers, shape (3,)."""
        value = self.value(name)
        if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
            raise self.error(name, f"three numbers expected, got {value!r}")
        return np.array(value, dtype=float)

    def section(self, name: str) -> Section:
        """Return a field that is a mapping."""
        return Section(self._file, ".".join(filter(None, (self._place, name))), self.value(name))

    def sections(self, name: str) -> list[Section]:
        """Return a field that is a non-empty list of mappings."""
        values = self.value(name)
        if not isinstance(values, list) or not values:
            raise self.error(name, "a list of at least one mapping expected")
        place = ".".join(filter(None, (self._place, name)))
        return [
            Section(self._file, f"{place}[{index}]", value) for index, value in enumerate(values)
        ]

    def only_one_of(self, *names: str) -> str:
        """Return the name of the one field that is given out of several."""
        given = [name for name in names if name in self._fields]
        if len(given) != 1:
            raise self.error("", f"exactly one of {', '.join(names)} expected, got {len(given)}")
        return given[0]

    def value_of_type(self, name: str, hint: Any) -> Any:
        """Return a field that has the type of a dataclass field."""
        value = self.value(name)
        if npt.ArrayLike in (hint, *typing.get_args(hint)) or hint == npt.ArrayLike | None:
            if not _is_array(value):
                raise self.error(name, f"a list of numbers expected, got {value!r}")
            return value
        accepted = _types_of(hint)
        if isinstance(value, list) and tuple in accepted:
            return tuple(value)
        if float in accepted and _is_number(value):
            return float(value)
        if type(value) in accepted and tuple not in accepted:
            return value
        names = " or ".join(_YAML_NAMES.get(kind, kind.__name__) for kind in accepted)
        hint = truth_word_hint(value) if bool in accepted else ""
        raise self.error(name, f"{names} expected, got {value!r}{hint}")

    def make_dataclass(self, kind: type[_Group], base: _Group | None = None) -> _Group:
        """Return a dataclass of plain fields from this section, which is then finished.

        Fields that the section does not give have the value of `base`, or else their default.
        """
        hints = typing.get_type_hints(kind)
        given: dict[str, Any] = {}
        for entry in dataclasses.fields(typing.cast(Any, kind)):
            is_required = entry.default is dataclasses.MISSING and base is None
            if entry.name in self or is_required:
                given[entry.name] = self.value_of_type(entry.name, hints[entry.name])
        self.finish()
        try:
            if base is not None:
                return typing.cast(_Group, dataclasses.replace(typing.cast(Any, base), **given))
            return kind(**given)
        except (TypeError, ValueError) as error:
            raise self.error("", str(error)) from None


def _types_of(hint: Any) -> tuple[type, ...]:
    """Return the plain types that an annotation accepts."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return tuple(kind for part in typing.get_args(hint) for kind in _types_of(part))
    return (typing.get_origin(hint) or hint,)


def _is_array(value: Any) -> bool:
    """Return whether a value is a list of numbers, or of such lists."""
    return isinstance(value, list) and all(_is_number(item) or _is_array(item) for item in value)


def _is_number(value: Any) -> bool:
    """Return whether a value is a number that a float can hold (NaN is in no interval)."""
    is_numeric = isinstance(value, (int, float)) and not isinstance(value, bool)
    return is_numeric and -1e300 < value < 1e300

"""YAML 1.2 of bounded depth and size: a hostile or damaged text is one line, not a traceback.

Everything that a user writes is read here: system files, scenarios, campaigns, formations,
parameter files, and ``name:=value`` on the command line. Plain values have the types of the core
schema (YAML 1.2.2, section 10.3.2), which are also those of rcl: 1.5e3 is a number, a date is a
text. Only ``yes``, ``no``, ``on`` and ``off`` differ: they are texts here and truth values in rcl.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    Event,
    NodeEvent,
    ScalarEvent,
    SequenceStartEvent,
)
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import SafeRepresenter

__all__ = ["PlainYamlError", "format_yaml", "parse_yaml", "truth_word_hint"]

#: Levels of lists and mappings within each other that a text may have.
MAXIMUM_DEPTH = 32
#: Values that a text may hold, those that an alias stands for counted each time.
MAXIMUM_VALUES = 100_000
#: Bytes of a text in UTF-8: forty for each value.
MAXIMUM_BYTES = 4_000_000
#: Digits of a whole number: those that Python converts (`sys.set_int_max_str_digits`).
MAXIMUM_DIGITS = 4300

_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
    **dict.fromkeys((f"{s}{w}" for s in ("", "+") for w in (".inf", ".Inf", ".INF")), math.inf),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -math.inf),
}
_DECIMAL_INTEGER = re.compile(r"[-+]?[0-9]+")
_BASED_INTEGER = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")

#: Texts that need no quotes, unless they are words of YAML.
_UNQUOTED_TEXT = re.compile(r"[A-Za-z_/]([A-Za-z0-9_./ -]*[A-Za-z0-9_./-])?")
#: Truth values of YAML 1.1, which are texts in YAML 1.2, with the word of YAML 1.2.
_OLD_TRUTH_WORDS = {
    **dict.fromkeys(("y", "yes", "on"), "true"),
    **dict.fromkeys(("n", "no", "off"), "false"),
}
_WORDS_OF_YAML = {"null", "true", "false", *_OLD_TRUTH_WORDS}


def truth_word_hint(value: Any) -> str:
    """Return the end of an error message for a truth value of YAML 1.1; empty for other values."""
    word = _OLD_TRUTH_WORDS.get(value.lower()) if isinstance(value, str) else None
    return f"; write {word}" if word else ""


class PlainYamlError(ValueError):
    """A text is not YAML or nested or repeated too much; the message is one line."""


def parse_yaml(text: str) -> Any:
    """Return the value of a YAML text: mappings, lists, texts, numbers, truth values and None.

    Parameters
    ----------
    text
        One YAML document, without tags; aliases share the value of their anchor.

    Raises
    ------
    PlainYamlError
        If the text is not YAML, has a tag, gives a key twice, or exceeds `MAXIMUM_BYTES`,
        `MAXIMUM_DEPTH` or `MAXIMUM_VALUES`; the message has the line.
    """
    if len(text.encode("utf-8", "replace")) > MAXIMUM_BYTES:
        raise PlainYamlError(f"more than {MAXIMUM_BYTES} bytes")
    try:
        return _Reader(YAML(typ="safe", pure=True).parse(text)).document()
    except YAMLError as error:
        raise PlainYamlError(" ".join(str(error).split())) from error


def format_yaml(content: Any, *, on_one_line: bool = False) -> str:
    """Return YAML text without anchors and tags, keys in the order given.

    Readers of YAML 1.1, of YAML 1.2 and rcl find the same types in it.

    Parameters
    ----------
    content
        Mappings, lists, texts, numbers, truth values and None.
    on_one_line
        Whether to write ``{a: [1, 2]}``, without a line end.
    """
    writer: Any = YAML(typ="safe", pure=True)
    writer.Representer = _Representer
    writer.default_flow_style = on_one_line
    writer.sort_base_mapping_type_on_output = False
    writer.width = 2**30
    stream = io.StringIO()
    writer.dump(content, stream)
    text = stream.getvalue()
    return text.removesuffix("...\n").strip() if on_one_line else text


class _Reader:
    """Builds the value of a document from the events of the library's parser, and counts it."""

    def __init__(self, events: Iterator[Event]) -> None:
        inner = (NodeEvent, CollectionEndEvent)
        self._events = (event for event in events if isinstance(event, inner))
        self._anchors: dict[str, tuple[Any, int]] = {}  # value, and number of values in it
        self._count = 0  # of values up to here

    def document(self) -> Any:
        first = next(self._events, None)
        value = None if first is None else self._value(first, 0)
        second = next(self._events, None)
        if second is not None:
            raise _error(second, "a second document begins")
        return value

    def _value(self, event: Any, depth: int) -> Any:
        if isinstance(event, AliasEvent):
            if event.anchor not in self._anchors:
                raise _error(event, f"'*{event.anchor}' stands for no value that ends before it")
            value, number = self._anchors[event.anchor]
            self._add(event, number)
            return value
        if event.tag is not None:
            raise _error(event, f"'{event.tag}': tags are not allowed")
        before = self._count
        self._add(event, 1)
        if isinstance(event, ScalarEvent):
            value = _plain_value(event) if event.style is None else event.value
        elif depth == MAXIMUM_DEPTH:
            raise _error(event, f"nested deeper than {MAXIMUM_DEPTH} levels")
        elif isinstance(event, SequenceStartEvent):
            value = [self._value(item, depth + 1) for item in self._items()]
        else:
            value = self._mapping(depth + 1)
        if event.anchor is not None:
            self._anchors[event.anchor] = value, self._count - before
        return value

    def _mapping(self, depth: int) -> dict[Any, Any]:
        mapping: dict[Any, Any] = {}
        for event in self._items():
            key = self._value(event, depth)
            if isinstance(key, (dict, list)):
                raise _error(event, "a key is a list or a mapping")
            if key in mapping:
                raise _error(event, f"'{key}' is given twice")
            mapping[key] = self._value(next(self._events), depth)
        return mapping

    def _items(self) -> Iterator[Event]:
        """Return the first event of each item of the collection that is open."""
        while not isinstance(event := next(self._events), CollectionEndEvent):
            yield event

    def _add(self, event: Event, number: int) -> None:
        self._count += number
        if self._count > MAXIMUM_VALUES:
            raise _error(event, f"more than {MAXIMUM_VALUES} values")


def _plain_value(event: ScalarEvent) -> Any:
    """Return the value of a text without quotes, by the core schema."""
    text: str = event.value
    if text in _WORDS:
        return _WORDS[text]
    if _DECIMAL_INTEGER.fullmatch(text):
        if len(text) > MAXIMUM_DIGITS:
            raise _error(event, f"a number has more than {MAXIMUM_DIGITS} digits")
        return int(text)
    if _BASED_INTEGER.fullmatch(text):
        return int(text, 0)
    return float(text) if _FLOAT.fullmatch(text) else text


def _error(event: Event, problem: str) -> PlainYamlError:
    return PlainYamlError(f"line {event.start_mark.line + 1}: {problem}")


class _Representer(SafeRepresenter):
    """Writes values so that readers of YAML 1.1, of YAML 1.2 and rcl agree on their types."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_text(self, data: str) -> ScalarNode:
        """Quote a text that one of the readers may take for something else."""
        is_plain = _UNQUOTED_TEXT.fullmatch(data) and data.lower() not in _WORDS_OF_YAML
        style = None if is_plain else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)

    def represent_number(self, data: float) -> ScalarNode:
        """Write a point before an exponent: 1e-05 is a text in YAML 1.1."""
        node: ScalarNode = self.represent_float(data)
        mantissa, exponent, power = node.value.partition("e")
        if exponent and "." not in mantissa:
            node.value = f"{mantissa}.0e{power}"
        return node


_Representer.add_representer(str, _Representer.represent_text)
_Representer.add_representer(float, _Representer.represent_number)

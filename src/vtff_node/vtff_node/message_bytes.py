"""Messages to bytes and back by `struct`, instead of by the conversions that ROS generates.

rclpy copies a message field by field into a structure of C, which the middleware then serialises;
a message that comes takes the same way back, and each of its parts is made by a constructor in
Python. That costs four times as much as what the middleware does with the bytes. Here all numbers
of a message are packed in one call. The bytes are those of ROS, those of alignment are zero; a
message that comes is an object of the same class as from rclpy.

References
----------
OMG, Common Object Request Broker Architecture 3.4, part 2, section 9.3 (CDR: alignment to the size
of a number, sequences and texts after a count of 4 bytes); OMG, DDSI-RTPS 2.5, section 10 (first
4 bytes).
"""

from __future__ import annotations

import array
import functools
import importlib
import operator
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

__all__ = ["MessageBytes", "message_bytes", "message_of_fields"]

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # encapsulation of plain CDR
_FORMATS = {
    "boolean": "?",
    "octet": "B",
    "uint8": "B",
    "int8": "b",
    "uint16": "H",
    "int16": "h",
    "uint32": "I",
    "int32": "i",
    "uint64": "Q",
    "int64": "q",
    "float": "f",
    "double": "d",
}
#: How rosidl declares a sequence and an array of numbers. Those of truth values and octets are
#: lists in Python, and not converted here.
_SEQUENCE = re.compile(r"^sequence<(?P<number>\w+)(?:, \d+)?>$")
_ARRAY = re.compile(r"^(?P<number>\w+)\[(?P<length>\d+)\]$")
_IN_LISTS = ("boolean", "octet")
_COUNT = struct.Struct("<I")
#: Whether the fields of a message are checked when they are set, in ROS versions that have it.
_CHECK = "_check_fields"
#: Layouts that are kept of a type, one for each combination of the lengths of its texts and
#: sequences.
_KEPT_LAYOUTS = 64


class _Field(NamedTuple):
    """A number, an array of fixed length, a sequence or a text of a message or of its parts."""

    path: str
    kind: str  # "number", "array", "sequence" or "text"
    format: str
    size: int  # of an element, bytes
    length: int = 1  # elements of an array


class MessageBytes:
    """Conversion of the messages of one type; see `message_bytes`.

    Parameters
    ----------
    message_type
        Class of the messages.

    Raises
    ------
    TypeError
        If the type has a field that is no number, no text, no array of numbers and no message of
        such fields.
    """

    def __init__(self, message_type: Any) -> None:
        self._type = message_type
        self._fields = tuple(_fields(message_type))
        # The length of a text or a sequence is a value of its own, before the content.
        lengths: list[int] = []
        index = 0
        for field in self._fields:
            if _count_values(field) > 1:
                lengths.append(index)
            index += _count_values(field)
        self._count_lengths = len(lengths)
        self._read_lengths = _reader(lengths)
        # A stored message begins with the encapsulation.
        self._read_stored_lengths = _reader([index + 1 for index in lengths])
        self._values = _make_function("values", *_source_of_values(self._fields))
        self._build = _make_function("build", *_source_of_build(message_type))
        self._structs: dict[tuple[int, ...], struct.Struct] = {}
        # By size of the message: DDS fills texts of several lengths up to one size.
        self._structs_by_size: dict[int, list[tuple[struct.Struct, tuple[int, ...]]]] = {}

    def serialize(self, message: Any) -> bytes:
        """Return a message as `rclpy.serialization.serialize_message` does.

        Raises
        ------
        Exception
            As `serialize_message`, if a value does not fit its field.
        """
        values = self._values(message)
        lengths = self._read_lengths(values)
        layout = self._structs.get(lengths)
        if layout is None:
            layout = self._make_struct(lengths)
            if len(self._structs) >= _KEPT_LAYOUTS:
                self._structs.clear()
            self._structs[lengths] = layout
        try:
            return layout.pack(_LITTLE_ENDIAN, *values)
        except (struct.error, OverflowError):  # a number beyond the range of its field
            return serialize_message(message)

    def deserialize(self, content: bytes) -> Any:
        """Return the message of some bytes.

        Raises
        ------
        Exception
            As `rclpy.serialization.deserialize_message`, if they are no message of the type.
        """
        for layout, lengths in self._structs_by_size.get(len(content), ()):
            values = layout.unpack_from(content)
            if values[0] == _LITTLE_ENDIAN and self._read_stored_lengths(values) == lengths:
                return self._build(values)
        # A new size, a text of a new length, or bytes of another machine.
        found = self._find_struct(content)
        if found is None:
            return deserialize_message(content, self._type)
        return self._build(found.unpack_from(content))

    def _make_struct(self, lengths: tuple[int, ...]) -> struct.Struct:
        """Return the layout for some lengths of texts and sequences, in the order of the fields.

        With fewer lengths than there are it ends with the first one that is not known.
        """
        text, position = "<4s", 0
        waiting = iter(lengths)

        def add(kind: str, size: int, alignment: int) -> None:
            # The first 4 bytes do not count for the alignment.
            nonlocal text, position
            padding = -position % alignment
            text += f"{padding}x{kind}" if padding else kind
            position += padding + size

        for field in self._fields:
            length = field.length
            if _count_values(field) > 1:
                add("I", _COUNT.size, _COUNT.size)
                length = next(waiting, -1)
                if length < 0:
                    break
            if field.kind == "number":
                add(field.format, field.size, field.size)
            else:
                # Fast CDR does not align where nothing follows.
                add(f"{length * field.size}s", length * field.size, field.size if length else 1)
        return struct.Struct(text)

    def _find_struct(self, content: bytes) -> struct.Struct | None:
        """Return the layout of some bytes; None if only ROS can read them.

        It is found length by length: where one stands depends on those before it.
        """
        if not content.startswith(_LITTLE_ENDIAN):
            return None
        lengths: tuple[int, ...] = ()
        layout = self._make_struct(lengths)
        while len(lengths) < self._count_lengths and layout.size <= len(content):
            lengths = (*lengths, layout.unpack_from(content)[-1])
            layout = self._make_struct(lengths)
        # What is there beyond the last field fills the message up.
        if len(lengths) < self._count_lengths or layout.size > len(content):
            return None
        if sum(map(len, self._structs_by_size.values())) >= _KEPT_LAYOUTS:
            self._structs_by_size.clear()
        self._structs_by_size.setdefault(len(content), []).append((layout, lengths))
        return layout


@functools.cache
def message_bytes(message_type: Any) -> MessageBytes | None:
    """Return the conversion of a type; None where only ROS can convert it."""
    try:
        return MessageBytes(message_type)
    except TypeError:
        return None


@functools.lru_cache(maxsize=256)
def _encode(text: str) -> bytes:
    return text.encode() + b"\0"


def _reader(indices: Sequence[int]) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """Return a function that reads the elements of these indices as a tuple."""
    if not indices:
        return lambda _: ()
    read: Callable[[Any], Any] = operator.itemgetter(*indices)
    return read if len(indices) > 1 else lambda values: (read(values),)


def message_of_fields(message_type: Any, **fields: Any) -> Any:
    """Return a message of all its fields, as the constructor does that checks nothing.

    Parameters
    ----------
    message_type
        Class of the message.
    **fields
        Value of each field: sequences of numbers as `array.array` of the type code of the field,
        arrays of fixed length as `numpy.ndarray`. They become parts of the message.
    """
    message = _maker(message_type)()
    for name, value in fields.items():
        setattr(message, f"_{name}", value)
    return message


@functools.cache
def _maker(message_type: Any) -> Callable[[], Any]:
    """Return a function that makes a message without fields, whose fields nobody checks.

    The constructor makes each part twice, as a default and as what is given, which takes five times
    as long.
    """
    make = functools.partial(message_type.__new__, message_type)
    if _CHECK not in message_type.__slots__:
        return make

    def make_unchecked() -> Any:
        message = make()
        message._check_fields = False
        return message

    return make_unchecked


def _fields(message_type: Any, prefix: str = "") -> Iterator[_Field]:
    """Yield the fields of a type in order; a nested message is replaced by its own fields."""
    for name, declared in message_type.get_fields_and_field_types().items():
        # Attributes of the class with this name check what they are given, these do not.
        path = f"{prefix}_{name}"
        if part := _class_of(declared):
            yield from _fields(part, f"{path}.")
        elif declared == "string":
            yield _Field(path, "text", "s", 1)
        elif declared in _FORMATS:
            yield _Field(path, "number", _FORMATS[declared], _size(declared))
        else:
            match = _SEQUENCE.match(declared) or _ARRAY.match(declared)
            number = match["number"] if match else ""
            if match is None or number not in _FORMATS or number in _IN_LISTS:
                raise TypeError(f"field '{path}' of {message_type.__name__} is {declared}")
            if match.re is _ARRAY:
                length = int(match["length"])
                yield _Field(path, "array", _FORMATS[number], _size(number), length)
            else:
                yield _Field(path, "sequence", _FORMATS[number], _size(number))


def _class_of(declared: str) -> Any:
    """Return the class of a nested message; None if something else is declared."""
    package, separator, name = declared.partition("/")
    if not separator or not name.isidentifier():
        return None
    return getattr(importlib.import_module(f"{package}.msg"), name)


def _size(number: str) -> int:
    return struct.calcsize(f"<{_FORMATS[number]}")


def _count_values(field: _Field) -> int:
    """Return how many values a field has in a layout."""
    return 2 if field.kind in ("sequence", "text") else 1


def _make_function(name: str, source: str, names: dict[str, Any]) -> Callable[[Any], Any]:
    """Return the function of this name in a source; it knows the given names.

    Functions are written for each type, as `dataclasses` writes its constructors: a loop over the
    fields takes more than twice as long as what it does.
    """
    exec(compile(source, f"<{__name__}: {name}>", "exec"), names)
    made: Callable[[Any], Any] = names[name]
    return made


def _source_of_values(fields: Sequence[_Field]) -> tuple[str, dict[str, Any]]:
    """Return the source of a function that returns the values of a layout, and names it knows.

    It takes a message and returns a tuple, in which texts, arrays and sequences are bytes.
    """
    values = []
    lines = []
    for number, field in enumerate(fields):
        value = f"message.{field.path}"
        if field.kind == "text":
            lines.append(f"text{number} = encode({value})")
            values += [f"len(text{number})", f"text{number}"]
        elif field.kind == "sequence":
            values += [f"len({value})", f"{value}.tobytes()"]
        else:
            values.append(f"{value}.tobytes()" if field.kind == "array" else value)
    lines.append(f"return ({''.join(f'{value}, ' for value in values)})")
    return _source("values(message)", lines), {"encode": _encode}


def _source_of_build(message_type: Any) -> tuple[str, dict[str, Any]]:
    """Return the source of a function that makes a message, and the names that it knows.

    It takes the values of a layout, after the encapsulation.
    """
    lines: list[str] = []
    names: dict[str, Any] = {"array": array.array, "frombuffer": np.frombuffer}

    def add(part: Any, index: int) -> tuple[str, int]:
        """Add the lines of a part; return its name and the index of the value that follows it."""
        number = len(names)
        own_name = f"message{number}"
        # As `_maker` does, without its calls.
        names[f"new{number}"] = functools.partial(part.__new__, part)
        lines.append(f"{own_name} = new{number}()")
        if _CHECK in part.__slots__:
            lines.append(f"{own_name}.{_CHECK} = False")
        for name, declared in part.get_fields_and_field_types().items():
            if nested := _class_of(declared):
                content, index = add(nested, index)
            else:
                (field,) = (field for field in _fields(part) if field.path == f"_{name}")
                index += _count_values(field)
                content = _source_of_content(field, f"values[{index - 1}]", names)
            # Attributes of the class with this name check what they are given, these do not.
            lines.append(f"{own_name}._{name} = {content}")
        return own_name, index

    whole, _ = add(message_type, 1)
    lines.append(f"return {whole}")
    return _source("build(values)", lines), names


def _source_of_content(field: _Field, value: str, names: dict[str, Any]) -> str:
    """Return the expression that makes a number, text, array or sequence of a value."""
    if field.kind == "text":
        return f"{value}[:-1].decode()"
    if field.kind == "array":
        names[f"dtype_{field.format}"] = np.dtype(field.format)
        # An array of a bytearray may be written to.
        return f"frombuffer(bytearray({value}), dtype_{field.format})"
    if field.kind == "sequence":
        return f"array({field.format!r}, {value})"
    return value


def _source(signature: str, lines: Sequence[str]) -> str:
    return f"def {signature}:\n" + "".join(f"    {line}\n" for line in lines)

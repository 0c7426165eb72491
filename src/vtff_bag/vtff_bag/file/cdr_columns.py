"""Many messages of one type as columns, without a Python object for each message.

Messages of observations come at 20 Hz and hold columns themselves. Messages whose sequences are
equally long have the same byte layout, so that a column of all these messages is one slice.

References
----------
OMG, Common Object Request Broker Architecture 3.4, part 2, section 9.3 (CDR: alignment to the size
of a number, sequences after a count of 4 bytes); OMG, DDSI-RTPS 2.5, section 10 (first 4 bytes).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_bag.file.errors import BagReadError
from vtff_bag.file.message_definitions import message_class

__all__ = ["ColumnCollector", "MessageColumns"]

_HEADER_SIZE = 4
_LITTLE_ENDIAN = 1  # second byte of the header
_COUNT = np.dtype("<u4")
_BATCH = 4096
_NUMBERS = {
    "boolean": "?",
    "octet": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "<u2",
    "int16": "<i2",
    "uint32": "<u4",
    "int32": "<i4",
    "uint64": "<u8",
    "int64": "<i8",
    "float": "<f4",
    "double": "<f8",
}
_DECLARED = re.compile(
    r"^(?:sequence<(?P<sequence>\w+)(?:, \d+)?>|(?P<fixed>\w+)\[(?P<size>\d+)\]|(?P<number>\w+))$"
)
_STRING = re.compile(r"^string(?:<\d+>)?$")


@dataclass(frozen=True, eq=False)
class MessageColumns:
    """Messages of one type, in the order in which they were added.

    Parameters
    ----------
    source : str
        File and topic, for errors.
    count : int
        Number of messages, m.
    numbers : dict of str to ndarray, shape (m,) or (m, k)
        Fields that hold one number or an array of fixed length. The name of a nested field is its
        path (``header.stamp.sec``). Texts are left out.
    sequences : dict of str to ndarray, shape (n,)
        By field, the elements of all messages, one message after the other.
    lengths : dict of str to ndarray of int, shape (m,)
        By field, the number of elements in each message.
    """

    source: str
    count: int
    numbers: dict[str, npt.NDArray[Any]]
    sequences: dict[str, npt.NDArray[Any]]
    lengths: dict[str, npt.NDArray[np.int64]]


class ColumnCollector:
    """Collects serialised messages of one type and returns them as columns.

    Parameters
    ----------
    type_name : str
        ``package/msg/Type``. Its fields may be numbers, texts, sequences of numbers, and messages
        of such fields.
    source : str
        File and topic, for errors.

    Raises
    ------
    UnknownTypeError
        If the type is not installed.
    TypeError
        If the type has another kind of field.
    """

    def __init__(self, type_name: str, source: str) -> None:
        self._type_name = type_name
        self._source = source
        self._fields = tuple(_list_fields(message_class(type_name)))
        self._waiting: list[bytes] = []
        self._decoded: list[MessageColumns] = []

    def add(self, serialized: bytes) -> None:
        """Add the next message.

        Raises
        ------
        BagReadError
            If this message, or one added before it, is not a message of the type.
        """
        self._waiting.append(serialized)
        if len(self._waiting) == _BATCH:
            self._decode()

    def columns(self) -> MessageColumns:
        """Return all messages added so far; raises as `add`."""
        self._decode()
        number_fields = [field for field in self._fields if field.kind == "number"]
        list_fields = [field for field in self._fields if field.kind == "list"]

        def join(attribute: str, field: _Field, shape: tuple[int, ...]) -> npt.NDArray[Any]:
            dtype = field.dtype if attribute != "lengths" else np.dtype(np.int64)
            columns = [getattr(batch, attribute)[field.name] for batch in self._decoded]
            return np.concatenate([np.empty(shape, dtype.newbyteorder("=")), *columns])

        result = MessageColumns(
            source=self._source,
            count=sum(batch.count for batch in self._decoded),
            numbers={f.name: join("numbers", f, (0, *f.shape)) for f in number_fields},
            sequences={f.name: join("sequences", f, (0,)) for f in list_fields},
            lengths={f.name: join("lengths", f, (0,)) for f in list_fields},
        )
        self._decoded = [result]
        return result

    def _decode(self) -> None:
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        count = len(waiting)
        groups = list(self._group_by_layout(waiting))
        numbers, sequences, lengths = {}, {}, {}
        for field_number, field in enumerate(self._fields):
            if field.kind == "number":
                numbers[field.name] = column = np.empty((count, *field.shape), field.dtype)
                for index, layout, stored in groups:
                    values = _read_values(stored, layout[field_number], field.dtype)
                    column[index] = values.reshape(len(index), *field.shape)
            elif field.kind == "list":
                length = np.empty(count, dtype=np.int64)
                for index, layout, _ in groups:
                    length[index] = layout[field_number].count
                end = np.cumsum(length)
                elements = np.empty(int(end[-1]), field.dtype)
                for index, layout, stored in groups:
                    element_count = layout[field_number].count
                    rows = (end - length)[index][:, np.newaxis] + np.arange(element_count)
                    elements[rows] = _read_values(stored, layout[field_number], field.dtype)
                sequences[field.name], lengths[field.name] = elements, length
        self._decoded.append(MessageColumns(self._source, count, numbers, sequences, lengths))

    def _group_by_layout(
        self, serialized: list[bytes]
    ) -> Iterator[tuple[npt.NDArray[np.intp], list[_FieldLayout], npt.NDArray[np.uint8]]]:
        """Yield the messages of each layout: their indices, the layout, and their bytes as rows."""
        sizes = np.array([len(message) for message in serialized])
        for size in np.unique(sizes).tolist():
            index = np.flatnonzero(sizes == size)
            joined = b"".join([serialized[i] for i in index.tolist()])
            stored = np.frombuffer(joined, dtype=np.uint8).reshape(-1, size)
            while len(index):
                layout, is_equal = self._find_first_layout(stored)
                yield index[is_equal], layout, stored[is_equal]
                index, stored = index[~is_equal], stored[~is_equal]

    def _find_first_layout(
        self, stored: npt.NDArray[np.uint8]
    ) -> tuple[list[_FieldLayout], npt.NDArray[np.bool_]]:
        """Return the layout of the first message, and which messages have the same layout."""
        first = stored[0].tobytes()
        if len(first) < _HEADER_SIZE or first[1] != _LITTLE_ENDIAN:
            raise BagReadError(
                f"{self._source}: a message is not a {self._type_name} in little-endian CDR"
            )
        is_equal = np.ones(len(stored), dtype=np.bool_)
        layout = []
        position = _HEADER_SIZE
        for field in self._fields:
            count = field.elements
            if field.kind != "number":
                position = _align(position, _COUNT.itemsize)
                end = position + _COUNT.itemsize
                count = int.from_bytes(first[position:end], "little")
                is_equal &= (stored[:, position:end] == stored[0, position:end]).all(axis=1)
                position = end
            if count:
                position = _align(position, field.dtype.itemsize)
            layout.append(_FieldLayout(position, count))
            position += count * field.dtype.itemsize
            if position > len(first):
                raise BagReadError(
                    f"{self._source}: a message is not a {self._type_name}: its {len(first)} bytes "
                    "are too few"
                )
        return layout, is_equal


@dataclass(frozen=True)
class _Field:
    name: str
    kind: str  # "number", "list" or "text"
    dtype: np.dtype[Any]
    shape: tuple[int, ...] = ()

    @property
    def elements(self) -> int:
        return int(np.prod(self.shape, dtype=int))


@dataclass(frozen=True)
class _FieldLayout:
    """Position of the first element of a field in a message, bytes, and the number of elements."""

    position: int
    count: int


def _list_fields(message_type: Any, prefix: str = "") -> Iterator[_Field]:
    """Yield the fields of a type in order; a nested message is replaced by its own fields."""
    for name, declared in message_type.get_fields_and_field_types().items():
        path = f"{prefix}{name}"
        match = _DECLARED.match(declared)
        number = (
            _NUMBERS.get(match["sequence"] or match["fixed"] or match["number"]) if match else None
        )
        if _STRING.match(declared):
            yield _Field(path, "text", np.dtype("u1"))
        elif match and number and match["sequence"]:
            yield _Field(path, "list", np.dtype(number))
        elif match and number:
            shape = (int(match["size"]),) if match["size"] else ()
            yield _Field(path, "number", np.dtype(number), shape)
        elif re.fullmatch(r"\w+/\w+", declared):
            yield from _list_fields(message_class(declared), f"{path}.")
        else:
            raise TypeError(f"field '{path}' is {declared}: it cannot become a column")


def _align(position: int, size: int) -> int:
    """Return the next position at which a number of this size may begin, bytes."""
    return position + (_HEADER_SIZE - position) % size


def _read_values(
    stored: npt.NDArray[np.uint8], layout: _FieldLayout, dtype: np.dtype[Any]
) -> npt.NDArray[Any]:
    """Return the elements of a field, one row for each message."""
    end = layout.position + layout.count * dtype.itemsize
    field_bytes = np.ascontiguousarray(stored[:, layout.position : end])
    return field_bytes.view(dtype).reshape(len(stored), layout.count)

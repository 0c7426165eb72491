"""Many messages of one type as columns, without a Python object for each message.

Messages of observations come at 20 Hz and hold columns themselves. Where their sequences are
equally long, their bytes have the same layout, and a column of all of them is one slice.

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
    r"^(?:sequence<(?P<sequence>\w+)(?:, \d+)?>|(?P<fixed>\w+)\[(?P<size>\d+)\]|(?P<one>\w+))$"
)
_STRING = re.compile(r"^string(?:<\d+>)?$")


@dataclass(frozen=True, eq=False)
class MessageColumns:
    """Messages of one type, in the order in which they were added.

    Parameters
    ----------
    source : str
        For errors.
    count : int
        Messages, m.
    numbers : dict of str to ndarray, shape (m,) or (m, k)
        Fields that hold one number or an array of fixed length; nested ones by their path
        (``header.stamp.sec``). Texts are left out.
    sequences : dict of str to ndarray, shape (n,)
        Elements of all messages, one message after the other.
    lengths : dict of str to ndarray of int, shape (m,)
        Elements of each message.
    """

    source: str
    count: int
    numbers: dict[str, npt.NDArray[Any]]
    sequences: dict[str, npt.NDArray[Any]]
    lengths: dict[str, npt.NDArray[np.int64]]


class ColumnCollector:
    """Collects serialized messages of one type.

    Parameters
    ----------
    type_name : str
        ``package/msg/Type``: numbers, texts, messages of such, and sequences of numbers.
    source : str
        For errors: file and topic.

    Raises
    ------
    UnknownTypeError
        If the type is not installed.
    TypeError
        If it has another kind of field.
    """

    def __init__(self, type_name: str, source: str) -> None:
        self._type_name = type_name
        self._source = source
        self._fields = tuple(_fields(message_class(type_name)))
        self._waiting: list[bytes] = []
        self._done: list[MessageColumns] = []

    def add(self, serialized: bytes) -> None:
        """Take the next message in.

        Raises
        ------
        BagReadError
            If it, or one before it, is no message of the type.
        """
        self._waiting.append(serialized)
        if len(self._waiting) == _BATCH:
            self._decode()

    def columns(self) -> MessageColumns:
        """Return all messages so far; raises as `add`."""
        self._decode()
        kinds = {kind: [f for f in self._fields if f.kind == kind] for kind in ("number", "list")}

        def joined(part: str, field: _Field, shape: tuple[int, ...]) -> npt.NDArray[Any]:
            dtype = field.dtype if part != "lengths" else np.dtype(np.int64)
            columns = [getattr(done, part)[field.name] for done in self._done]
            return np.concatenate([np.empty(shape, dtype.newbyteorder("=")), *columns])

        result = MessageColumns(
            source=self._source,
            count=sum(done.count for done in self._done),
            numbers={f.name: joined("numbers", f, (0, *f.shape)) for f in kinds["number"]},
            sequences={f.name: joined("sequences", f, (0,)) for f in kinds["list"]},
            lengths={f.name: joined("lengths", f, (0,)) for f in kinds["list"]},
        )
        self._done = [result]
        return result

    def _decode(self) -> None:
        if not self._waiting:
            return
        waiting, self._waiting = self._waiting, []
        count = len(waiting)
        groups = list(self._groups(waiting))
        numbers, sequences, lengths = {}, {}, {}
        for place, field in enumerate(self._fields):
            if field.kind == "number":
                numbers[field.name] = column = np.empty((count, *field.shape), field.dtype)
                for index, layout, stored in groups:
                    values = _values(stored, layout[place], field.dtype)
                    column[index] = values.reshape(len(index), *field.shape)
            elif field.kind == "list":
                length = np.empty(count, dtype=np.int64)
                for index, layout, _ in groups:
                    length[index] = layout[place].count
                end = np.cumsum(length)
                elements = np.empty(int(end[-1]), field.dtype)
                for index, layout, stored in groups:
                    here = (end - length)[index][:, np.newaxis] + np.arange(layout[place].count)
                    elements[here] = _values(stored, layout[place], field.dtype)
                sequences[field.name], lengths[field.name] = elements, length
        self._done.append(MessageColumns(self._source, count, numbers, sequences, lengths))

    def _groups(
        self, serialized: list[bytes]
    ) -> Iterator[tuple[npt.NDArray[np.intp], list[_Place], npt.NDArray[np.uint8]]]:
        """Yield messages of one layout: their indices, the layout, and bytes, one row each."""
        sizes = np.array([len(message) for message in serialized])
        for size in np.unique(sizes).tolist():
            index = np.flatnonzero(sizes == size)
            joined = b"".join([serialized[i] for i in index.tolist()])
            stored = np.frombuffer(joined, dtype=np.uint8).reshape(-1, size)
            while len(index):
                layout, is_equal = self._layout(stored)
                yield index[is_equal], layout, stored[is_equal]
                index, stored = index[~is_equal], stored[~is_equal]

    def _layout(self, stored: npt.NDArray[np.uint8]) -> tuple[list[_Place], npt.NDArray[np.bool_]]:
        """Return where the fields of the first of some messages lie, and which are like it."""
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
                position = _aligned(position, _COUNT.itemsize)
                end = position + _COUNT.itemsize
                count = int.from_bytes(first[position:end], "little")
                is_equal &= (stored[:, position:end] == stored[0, position:end]).all(axis=1)
                position = end
            if count:
                position = _aligned(position, field.dtype.itemsize)
            layout.append(_Place(position, count))
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
class _Place:
    """Where the elements of a field begin, and how many there are."""

    position: int
    count: int


def _fields(message_type: Any, prefix: str = "") -> Iterator[_Field]:
    """Yield the fields of a type in their order, those of nested messages in their place."""
    for name, declared in message_type.get_fields_and_field_types().items():
        path = f"{prefix}{name}"
        match = _DECLARED.match(declared)
        number = (
            _NUMBERS.get(match["sequence"] or match["fixed"] or match["one"]) if match else None
        )
        if _STRING.match(declared):
            yield _Field(path, "text", np.dtype("u1"))
        elif match and number and match["sequence"]:
            yield _Field(path, "list", np.dtype(number))
        elif match and number:
            shape = (int(match["size"]),) if match["size"] else ()
            yield _Field(path, "number", np.dtype(number), shape)
        elif re.fullmatch(r"\w+/\w+", declared):
            yield from _fields(message_class(declared), f"{path}.")
        else:
            raise TypeError(f"field '{path}' is {declared}: it cannot become a column")


def _aligned(position: int, size: int) -> int:
    """Return the next place at which a number of a size may begin."""
    return position + (_HEADER_SIZE - position) % size


def _values(stored: npt.NDArray[np.uint8], place: _Place, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """Return the elements of a field of all messages, one row each."""
    end = place.position + place.count * dtype.itemsize
    part = np.ascontiguousarray(stored[:, place.position : end])
    return part.view(dtype).reshape(len(stored), place.count)

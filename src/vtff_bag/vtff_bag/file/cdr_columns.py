"""Many messages of one type as columns, without a Python object for each message.

Messages of observations come at 20 Hz and hold columns themselves. Compiled loops find where the
fields of each message begin, and copy them one message after the other.

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
from vtff_bag.file.message_batches import MessageBatch, copy_parts, read_integer
from vtff_bag.file.message_definitions import message_class
from vtff_dynamics.compiled import compiled

__all__ = ["ColumnCollector", "MessageColumns"]

_HEADER_SIZE = 4
_LITTLE_ENDIAN = 1  # second byte of the header
_COUNT_SIZE = 4
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
        self._is_counted = np.array([field.kind != "number" for field in self._fields], dtype=bool)
        self._size = np.array([field.dtype.itemsize for field in self._fields], dtype=np.int64)
        self._elements = np.array([field.elements for field in self._fields], dtype=np.int64)
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
            self._decode_waiting()

    def add_batch(self, batch: MessageBatch) -> None:
        """Add the next messages, all of a batch; raises as `add`."""
        self._decode_waiting()
        self._decode(batch.stored, batch.begin, batch.end)

    def columns(self) -> MessageColumns:
        """Return all messages added so far; raises as `add`."""
        self._decode_waiting()
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

    def _decode_waiting(self) -> None:
        if not self._waiting:
            return
        end = np.cumsum([len(serialized) for serialized in self._waiting])
        stored = np.frombuffer(b"".join(self._waiting), dtype=np.uint8)
        self._waiting = []
        self._decode(stored, np.concatenate(([0], end[:-1])), end)

    def _decode(
        self,
        stored: npt.NDArray[np.uint8],
        begin: npt.NDArray[np.int64],
        end: npt.NDArray[np.int64],
    ) -> None:
        """Decode messages in some bytes, each between a begin and an end, shape (m,)."""
        if not len(begin):
            return
        place, count, first_bad, is_short = _find_fields(
            stored, begin, end, self._is_counted, self._size, self._elements
        )
        if first_bad >= 0:
            raise BagReadError(self._describe_fault(int((end - begin)[first_bad]), is_short))
        numbers, sequences, lengths = {}, {}, {}
        for index, field in enumerate(self._fields):
            if field.kind == "text":
                continue
            elements = np.empty(int(count[index].sum()), field.dtype)
            length = count[index] * field.dtype.itemsize
            copy_parts(stored, place[index], length, elements.view(np.uint8))
            if field.kind == "number":
                numbers[field.name] = elements.reshape(len(begin), *field.shape)
            else:
                sequences[field.name], lengths[field.name] = elements, count[index]
        self._decoded.append(MessageColumns(self._source, len(begin), numbers, sequences, lengths))

    def _describe_fault(self, size: int, is_short: bool) -> str:
        """Return what is wrong with a message of a size, bytes."""
        if not is_short:
            return f"{self._source}: a message is not a {self._type_name} in little-endian CDR"
        return f"{self._source}: a message is not a {self._type_name}: its {size} bytes are too few"


@dataclass(frozen=True)
class _Field:
    name: str
    kind: str  # "number", "list" or "text"
    dtype: np.dtype[Any]
    shape: tuple[int, ...] = ()

    @property
    def elements(self) -> int:
        return int(np.prod(self.shape, dtype=int))


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


@compiled
def _find_fields(stored, begin, end, is_counted, size, elements):  # type: ignore[no-untyped-def]
    """Return where the fields of messages are.

    Parameters
    ----------
    stored : ndarray of uint8
    begin, end : ndarray of int, shape (m,)
        First byte of each message, and the byte after its last one.
    is_counted : ndarray of bool, shape (f,)
        Which fields begin with the number of their elements.
    size, elements : ndarray of int, shape (f,)
        Bytes of an element of each field, and number of elements where it is fixed.

    Returns
    -------
    place, count : ndarray of int, shape (f, m)
        Position of the first element in `stored`, and number of elements.
    first_bad : int
        A message that is not of these fields; -1 if all are.
    is_short : bool
        Whether that one is too short; otherwise it has another header.
    """
    fields, messages = len(size), len(begin)
    place = np.empty((fields, messages), dtype=np.int64)
    count = np.empty((fields, messages), dtype=np.int64)
    for message in range(messages):
        first, length = begin[message], end[message] - begin[message]
        if length < _HEADER_SIZE or stored[first + 1] != _LITTLE_ENDIAN:
            return place, count, message, False
        position = _HEADER_SIZE
        for field in range(fields):
            number = elements[field]
            if is_counted[field]:
                # Numbers are aligned to their size, from the end of the header.
                position += (_HEADER_SIZE - position) % _COUNT_SIZE
                if position + _COUNT_SIZE > length:
                    return place, count, message, True
                number = read_integer(stored, first + position, _COUNT_SIZE)
                position += _COUNT_SIZE
            if number > 0:
                position += (_HEADER_SIZE - position) % size[field]
            place[field, message] = first + position
            count[field, message] = number
            position += number * size[field]
            if position > length:
                return place, count, message, True
    return place, count, -1, False

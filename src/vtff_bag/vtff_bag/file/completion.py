"""Completion of a bag whose recorder was lost, with what a second recorder got from the nodes."""

from __future__ import annotations

import collections
import hashlib
import os
import pathlib
import shutil

from vtff_bag.file.errors import BagReadError, BagWriteError
from vtff_bag.file.reader import BagReader
from vtff_bag.file.recover import copy_messages
from vtff_bag.file.writer import BagWriter

__all__ = ["complete_bag"]


def complete_bag(path: pathlib.Path, second: pathlib.Path) -> int:
    """Add to a bag the messages that only the bag of a second recorder holds.

    Publishers hold their newest messages for late readers, so that the second bag begins before
    the first one breaks off. A message is in both where topic and bytes are the same; where a
    node published the same bytes several times, each bag counts them. The new bag takes the folder
    of the first one when it is closed; then the second one is removed.

    Parameters
    ----------
    path
        Folder of the bag that was not closed; it may hold nothing that can be read.
    second
        Folder of the bag of the second recorder.

    Returns
    -------
    int
        Number of messages that were added.

    Raises
    ------
    BagReadError
        If the second bag cannot be read.
    BagWriteError
        If the new bag cannot be written. In both cases the two bags are left as they are.
    """
    added = BagReader(second)
    missing = collections.Counter(
        _key(message.topic, message.serialized) for message in added.raw_messages()
    )
    workspace = path.with_name(f".{path.name}_complete")
    try:
        count = _write_complete_bag(path, added, missing, workspace / path.name)
        incomplete = workspace / "incomplete"
        if path.exists():
            os.replace(path, incomplete)
        os.replace(workspace / path.name, path)
        shutil.rmtree(second, ignore_errors=True)
    except OSError as error:
        raise BagWriteError(f"{path}: cannot complete: {error.strerror or error}") from error
    finally:
        shutil.rmtree(workspace, ignore_errors=True)
    return count


def _write_complete_bag(
    path: pathlib.Path,
    added: BagReader,
    missing: collections.Counter[bytes],
    folder: pathlib.Path,
) -> int:
    def is_missing(topic: str, serialized: bytes) -> bool:
        key = _key(topic, serialized)
        if missing[key] <= 0:
            return False
        missing[key] -= 1
        return True

    def count_as_recorded(topic: str, serialized: bytes) -> bool:
        is_missing(topic, serialized)
        return True

    try:
        first: BagReader | None = BagReader(path, scan=True)
    except BagReadError:  # the recorder was lost before it had written anything
        first = None
    custom = {**(first.custom_data if first is not None else {}), **added.custom_data}
    with BagWriter(folder, custom) as writer:
        if first is not None:
            for content in first.contents:
                copy_messages(content, first, writer, count_as_recorded)
        count = writer.message_count
        for content in added.contents:
            copy_messages(content, added, writer, is_missing)
        return writer.message_count - count


def _key(topic: str, serialized: bytes) -> bytes:
    return hashlib.blake2b(topic.encode() + b"\0" + serialized, digest_size=16).digest()

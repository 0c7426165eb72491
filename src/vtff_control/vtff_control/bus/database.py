"""Messages of a DBC file by name, with the signals that a program needs."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping
from typing import Any

import cantools

__all__ = ["load_messages"]


def load_messages(
    dbc_file: str | pathlib.Path, signals_of: Mapping[str, tuple[str, ...]]
) -> dict[str, Any]:
    """Return the messages by name, with all their signals checked to be there.

    Parameters
    ----------
    dbc_file
        Path of the DBC file.
    signals_of
        Signals that are needed, by message.

    Raises
    ------
    ValueError
        If the file cannot be read or lacks a message or signal; the message names it.
    """
    try:
        database: Any = cantools.database.load_file(str(dbc_file), database_format="dbc")
    except (OSError, UnicodeDecodeError, cantools.database.Error) as error:
        raise ValueError(f"{dbc_file}: cannot be read as a DBC file: {error}") from error
    messages = {message.name: message for message in database.messages}
    for name, signals in signals_of.items():
        if name not in messages:
            raise ValueError(f"{dbc_file}: has no message {name}")
        missing = set(signals) - {signal.name for signal in messages[name].signals}
        if missing:
            raise ValueError(f"{dbc_file}: message {name} has no signal {min(missing)}")
    return {name: messages[name] for name in signals_of}

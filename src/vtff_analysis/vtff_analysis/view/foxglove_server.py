"""Websocket of the Foxglove protocol: recorded or live topics for Foxglove and Lichtblick."""

from __future__ import annotations

import importlib
import logging
from typing import Any

from vtff_bag.file.errors import UnknownTypeError
from vtff_bag.file.message_definitions import message_definition

DEFAULT_PORT = 8765
HOST = "127.0.0.1"


class FoxgloveMissingError(ImportError):
    """The package foxglove-sdk is not installed."""


class FoxgloveServer:
    """Offers topics with unchanged messages and their message definitions.

    Parameters
    ----------
    port
        Port of the websocket; 0 for a free one.

    Raises
    ------
    FoxgloveMissingError
        If foxglove-sdk is not installed.
    RuntimeError
        If the port is taken.
    """

    def __init__(self, port: int = DEFAULT_PORT) -> None:
        try:
            # Imported by name: package.xml does not declare an optional package.
            foxglove = importlib.import_module("foxglove")
        except ImportError as error:
            raise FoxgloveMissingError(
                "--foxglove needs the package foxglove-sdk: "
                "python -m pip install foxglove-sdk (in .venv)"
            ) from error
        self._foxglove = foxglove
        _silence(foxglove)
        # An own context: topics of other servers in this process are not offered.
        self._context = foxglove.Context()
        self._server = foxglove.start_server(
            name="vtff",
            host=HOST,
            port=port,
            capabilities=[foxglove.Capability.Time],
            context=self._context,
        )
        self._channels: dict[str, Any] = {}

    @property
    def address(self) -> str:
        """Address that Foxglove connects to."""
        return f"ws://{HOST}:{self._server.port}"

    def send(self, topic: str, type_name: str, serialized: bytes, stamp: int) -> None:
        """Send a message; a topic whose definition is not installed is left out.

        Parameters
        ----------
        topic, type_name
            ``/name`` and ``package/msg/Type``.
        serialized
            Message in CDR.
        stamp
            ns since 1970.
        """
        if topic not in self._channels:
            self._channels[topic] = self._make_channel(topic, type_name)
        channel = self._channels[topic]
        if channel is not None:
            channel.log(bytes(serialized), log_time=max(0, stamp))
            self._server.broadcast_time(max(0, stamp))

    def _make_channel(self, topic: str, type_name: str) -> Any:
        try:
            definition = message_definition(type_name)
        except UnknownTypeError:
            return None
        schema = self._foxglove.Schema(name=type_name, encoding="ros2msg", data=definition.encode())
        return self._foxglove.Channel(
            topic, schema=schema, message_encoding="cdr", context=self._context
        )

    def stop(self) -> None:
        """Close all connections."""
        self._server.stop()


def _silence(foxglove: Any) -> None:
    """Keep the threads of the SDK from logging through Python, for good.

    `stop` holds the interpreter's lock while it waits for those threads; a thread that has a line
    to log waits for that lock, and neither goes on.
    """
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    foxglove.set_log_level("CRITICAL")  # the SDK logs nothing from this level on
    # The SDK gives the root logger a handler, which is not its business here.
    root.handlers[:], root.level = handlers, level

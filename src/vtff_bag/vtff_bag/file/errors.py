"""Errors of the bag library; each text names the file or the message type."""

from __future__ import annotations


class BagError(Exception):
    """An error of a bag: base class of the other errors."""


class BagReadError(BagError):
    """A bag cannot be opened, or nothing in it is readable."""


class BagWriteError(BagError):
    """A bag cannot be created or extended, for example because the disk is full."""


class BagExistsError(BagWriteError):
    """A folder or file at the place of a bag to be written is not overwritten."""


class UnknownTypeError(BagError):
    """The definition of a message type is not installed."""

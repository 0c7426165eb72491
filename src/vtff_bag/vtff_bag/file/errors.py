"""Errors of the bag library; every text names the file or the type concerned."""

from __future__ import annotations


class BagError(Exception):
    """Anything that is wrong with a bag."""


class BagReadError(BagError):
    """A bag cannot be opened or holds nothing readable."""


class BagWriteError(BagError):
    """A bag cannot be created or extended, for example because the disk is full."""


class UnknownTypeError(BagError):
    """The definition of a message type is not installed."""

"""YAML texts of bounded depth and size: a hostile or damaged file is one line, not a traceback."""

from __future__ import annotations

import re
from typing import Any

import yaml

__all__ = ["FAST_LOADER", "PlainYamlError", "parse_yaml"]

#: Levels of lists and mappings within each other that a file may have.
MAXIMUM_DEPTH = 32
#: Values that a file may hold, those that an alias stands for counted each time.
MAXIMUM_VALUES = 100_000

#: Loader of libyaml where PyYAML was built with it, ten times as fast. It is for files that
#: programs write: a lone "!" means something else to it than to the loader of Python.
FAST_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

#: What the constructors of PyYAML raise on tagged values of the wrong form, such as a 13th month.
_CONSTRUCTION_ERRORS = (ValueError, LookupError, TypeError, AttributeError, OverflowError)


class PlainYamlError(ValueError):
    """A text is not YAML or nested or repeated too much; the message is one line."""


class _NumberLoader(yaml.SafeLoader):
    """Takes 2e-4 for a number, as YAML 1.2 and ROS do; to YAML 1.1 it is a text."""


_NumberLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


def parse_yaml(text: str, loader: Any = _NumberLoader) -> Any:
    """Return what a YAML text holds.

    Parameters
    ----------
    text
        One YAML document.
    loader
        Class of the loader, one of those that construct plain values only.

    Raises
    ------
    PlainYamlError
        If the text is not YAML, holds a value of the wrong form, or is deeper than
        `MAXIMUM_DEPTH` or larger than `MAXIMUM_VALUES`.
    """
    try:
        _check_size(text, loader)
        return yaml.load(text, Loader=loader)
    except PlainYamlError:
        raise
    except yaml.YAMLError as error:
        raise PlainYamlError(" ".join(str(error).split())) from error
    except _CONSTRUCTION_ERRORS as error:
        raise PlainYamlError(
            f"a value has the wrong form: {' '.join(str(error).split())}"
        ) from error


def _check_size(text: str, loader: Any) -> None:
    """Check depth and size before anything is built; the parser of events does not recurse."""
    sizes = [0]  # values in each collection that is open, the document first
    anchors: list[str | None] = []  # of the open collections
    size_of_anchor: dict[str, int] = {}
    for event in yaml.parse(text, Loader=loader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.CollectionStartEvent):
            sizes.append(1)
            anchors.append(event.anchor)
            if len(anchors) > MAXIMUM_DEPTH:
                raise PlainYamlError(f"line {line}: nested deeper than {MAXIMUM_DEPTH} levels")
            continue
        if isinstance(event, yaml.CollectionEndEvent):
            size, anchor = sizes.pop(), anchors.pop()
        elif isinstance(event, yaml.ScalarEvent):
            size, anchor = 1, event.anchor
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor in anchors:
                raise PlainYamlError(f"line {line}: '*{event.anchor}' stands within itself")
            size, anchor = size_of_anchor.get(str(event.anchor), 1), None
        else:
            continue
        if anchor is not None:
            size_of_anchor[anchor] = size
        sizes[-1] += size
        if sum(sizes) > MAXIMUM_VALUES:
            raise PlainYamlError(f"line {line}: more than {MAXIMUM_VALUES} values")

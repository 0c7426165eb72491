"""Plug-ins: estimators and controllers that an installed package brings, found by entry point.

A package names its class in a group of entry points, such as ``vtff.controllers``; the name of the
entry is what a system file sets. What vtff ships is found in the same way. The interface of each
group is a Protocol in the package that uses it (docs/plugins.md).
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import math
import pathlib
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from vtff_node.plugins.time_limit import TimeLimitReachedError, time_limit

__all__ = [
    "Plugin",
    "PluginError",
    "PluginGroup",
    "help_lines",
    "load_plugin",
    "plugin_names",
]

ResultT = TypeVar("ResultT")


class PluginError(RuntimeError):
    """A plug-in cannot be used, or has failed; one line that names its package and class."""


@dataclass(frozen=True)
class PluginGroup:
    """A group of entry points, and how a node uses it.

    Parameters
    ----------
    name : str
        Name of the group, such as ``vtff.controllers``.
    parameter : str
        Parameter of the node that names the entry.
    methods : tuple of str
        Methods that an object of the group has.
    """

    name: str
    parameter: str
    methods: tuple[str, ...]


@dataclass
class Plugin:
    """A loaded plug-in.

    Parameters
    ----------
    group : PluginGroup
    name : str
        Name of the entry point.
    origin : str
        Package with version, module and class, for messages.
    factory : callable
        The class (or function), called as ``factory(setting)``, or as ``factory(setting,
        parameters)`` where it has a table of parameters.
    call_limit : float
        Longest wall time of one call, s.
    sample_time : float
        Scenario time between calls that answer a sample, s.

    Attributes
    ----------
    calls, late_calls : int
        Calls that answered a sample, and those of them that lasted longer than `sample_time`.
    longest_call : float
        The longest of them, s of wall time.
    """

    group: PluginGroup
    name: str
    origin: str
    factory: Callable[..., Any]
    call_limit: float = 10.0
    sample_time: float = math.inf
    calls: int = dataclasses.field(default=0, init=False)
    late_calls: int = dataclasses.field(default=0, init=False)
    longest_call: float = dataclasses.field(default=0.0, init=False)

    @property
    def parameter_table(self) -> type | None:
        """The plug-in's frozen dataclass of parameters, its attribute `Parameters`, if any."""
        table: type | None = getattr(self.factory, "Parameters", None)
        return table

    def describe(self, problem: str) -> str:
        """Return a problem in one line, with the plug-in's name, package and class before it."""
        line = " ".join(problem.split())
        return f"{self.group.parameter} '{self.name}' ({self.origin}): {line}"

    def make(self, setting: Any, parameters: Any | None) -> Any:
        """Return an object of the plug-in.

        Parameters
        ----------
        setting : object
            What the node knows, such as the interval between calls.
        parameters : object or None
            Values of `parameter_table`.

        Raises
        ------
        ValueError
            If the plug-in refuses a value in this way.
        PluginError
            If it fails otherwise or lacks a method.
        """
        arguments = (setting,) if self.parameter_table is None else (setting, parameters)
        try:
            made = self.factory(*arguments)
        except ValueError as error:
            raise ValueError(self.describe(str(error))) from error
        except (Exception, SystemExit) as error:
            raise PluginError(self.describe(_describe_error("start", error))) from error
        for method in self.group.methods:
            if not callable(getattr(made, method, None)):
                raise PluginError(self.describe(f"it has no method '{method}'"))
        return made

    def call(
        self,
        function: Callable[..., ResultT],
        *arguments: Any,
        check: Callable[[ResultT], None] | None = None,
    ) -> ResultT:
        """Call a method of the plug-in's object.

        Parameters
        ----------
        function : callable
            The bound method.
        arguments
            Its arguments.
        check : callable, optional
            Raises ValueError where the result is not usable. A call with a check answers a sample,
            and its time is counted.

        Raises
        ------
        PluginError
            If the call raises, lasts longer than `call_limit`, or returns what is not usable. In
            the main thread a call that does not end is interrupted, unless it never returns from
            compiled code.
        """
        name = getattr(function, "__name__", str(function))
        started = time.monotonic()
        try:
            with time_limit(self.call_limit):
                result = function(*arguments)
        except TimeLimitReachedError:
            raise PluginError(self._too_slow(name)) from None
        except (Exception, SystemExit) as error:
            raise PluginError(self.describe(_describe_error(name, error))) from error
        elapsed = time.monotonic() - started
        if elapsed > self.call_limit:
            raise PluginError(self._too_slow(name))
        if check is not None:
            self._count_call(elapsed)
            try:
                check(result)
            except ValueError as error:
                raise PluginError(self.describe(f"{name}: {error}")) from error
        return result

    @property
    def lateness(self) -> str:
        """How often calls lasted longer than `sample_time`, in one line; empty if none did."""
        if not self.late_calls:
            return ""
        return self.describe(
            f"{self.late_calls} of {self.calls} calls lasted longer than the "
            f"{self.sample_time:g} s between samples, the longest {self.longest_call:.1f} s; "
            "in real time they would be late"
        )

    def _count_call(self, elapsed: float) -> None:
        self.calls += 1
        self.late_calls += elapsed > self.sample_time
        self.longest_call = max(self.longest_call, elapsed)

    def _too_slow(self, name: str) -> str:
        return self.describe(f"{name}: too slow, no answer within {self.call_limit:g} s")


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names that installed packages offer in a group, those of vtff first."""
    entries = importlib.metadata.entry_points(group=group)
    ordered = sorted(entries, key=lambda entry: (not _is_shipped(entry), entry.name))
    return tuple(dict.fromkeys(entry.name for entry in ordered))


def load_plugin(group: PluginGroup, name: str) -> Plugin:
    """Load a plug-in by the name of its entry point.

    Raises
    ------
    ValueError
        If no package, or more than one, offers the name.
    PluginError
        If its module or class cannot be loaded.
    """
    entries = importlib.metadata.entry_points(group=group.name, name=name)
    # The distribution `vtff` and its single packages may both be installed: the same class.
    by_class = {entry.value: entry for entry in entries}
    if not by_class:
        names = ", ".join(plugin_names(group.name)) or f"none in the group {group.name}"
        raise ValueError(f"parameter '{group.parameter}' is '{name}'; installed are: {names}")
    if len(by_class) > 1:
        origins = "; ".join(sorted(_origin(entry) for entry in by_class.values()))
        raise ValueError(f"{group.parameter} '{name}': several packages offer it: {origins}")
    (entry,) = by_class.values()
    try:
        factory = entry.load()
    except (Exception, SystemExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise PluginError(
            f"{group.parameter} '{name}' ({_origin(entry)}): cannot be loaded: {reason}"
        ) from error
    plugin = Plugin(group, name, _origin(entry), factory)
    if not callable(factory):
        raise PluginError(plugin.describe(f"a class is expected, not {type(factory).__name__}"))
    table = plugin.parameter_table
    if table is not None and not dataclasses.is_dataclass(table):
        raise PluginError(plugin.describe("its attribute Parameters is not a dataclass"))
    return plugin


def help_lines(group: PluginGroup, describe_table: Callable[[type], Sequence[str]]) -> list[str]:
    """Return the lines of ``--help`` on the plug-ins of a group that have parameters."""
    lines: list[str] = []
    for name in plugin_names(group.name):
        try:
            plugin = load_plugin(group, name)
        except (ValueError, PluginError) as error:
            lines.append(f"{error}")
            continue
        if plugin.parameter_table is not None:
            lines.append(f"Parameters with {group.parameter}:={name} ({plugin.origin}):")
            lines += describe_table(plugin.parameter_table)
    return lines


def _is_shipped(entry: importlib.metadata.EntryPoint) -> bool:
    return entry.value.startswith("vtff_")


def _origin(entry: importlib.metadata.EntryPoint) -> str:
    distribution = entry.dist
    package = "?" if distribution is None else f"{distribution.name} {distribution.version}"
    return f"{package}, {entry.value}"


def _describe_error(name: str, error: BaseException) -> str:
    text = f"{name}: {type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    if frames:
        text += f" ({pathlib.PurePath(frames[-1].filename).name}, line {frames[-1].lineno})"
    return text

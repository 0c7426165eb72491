"""What a formation guidance is asked for: modes, reconfigurations, and a timeline of both."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from vtff_control.guidance.reconfiguration_plan import OBJECTIVES
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "MODES",
    "ModeRequest",
    "ReconfigurationRequest",
    "Request",
    "RequestError",
    "TimelineEntry",
    "read_number",
    "read_setting",
    "read_timed_lines",
    "read_timeline",
]

T = TypeVar("T")

MODES = ("hold", "keep", "reconfigure", "phase", "free_drift", "abort")

#: Orbits of a phasing at most: 17 years on a low orbit.
LARGEST_ORBITS = 1e5


class RequestError(ValueError):
    """A request is refused; one line that says why."""


@dataclass(frozen=True)
class ModeRequest:
    """A change of the mode.

    Parameters
    ----------
    mode
        One of `MODES` but ``reconfigure``.
    formation
        For ``keep``.
    angle_deg, orbits
        For ``phase``: angle ahead on the orbit (negative: behind) and duration.

    Raises
    ------
    RequestError
        If something is missing or does not belong to the mode.
    """

    mode: str
    formation: str = ""
    angle_deg: float = 0.0
    orbits: float = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        modes = [mode for mode in MODES if mode != "reconfigure"]
        if self.mode not in modes:
            raise RequestError(f"mode: one of {', '.join(modes)} expected, got '{self.mode}'")
        if bool(self.formation) != (self.mode == "keep"):
            raise RequestError(
                "formation: a name expected with mode 'keep'"
                if self.mode == "keep"
                else f"formation: mode '{self.mode}' takes none, got '{self.formation}'"
            )
        if self.mode == "phase":
            if not 0.0 < abs(self.angle_deg) <= 360.0:
                raise RequestError(
                    f"angle_deg: not zero, at most 360 expected, got {self.angle_deg:g}"
                )
            if not 0.0 < self.orbits <= LARGEST_ORBITS:
                raise RequestError(
                    f"orbits: more than 0, at most {LARGEST_ORBITS:g} expected, got {self.orbits:g}"
                )
        elif self.angle_deg or self.orbits:
            raise RequestError(f"angle_deg, orbits: mode '{self.mode}' takes none")


@dataclass(frozen=True)
class ReconfigurationRequest:
    """A reconfiguration.

    Parameters
    ----------
    formation
        Name of the formation to reach.
    duration
        From the request to the arrival, s.
    closest_approach
        Smallest distance of any pair, m; 0: as the guidance is set.
    acceleration_cap
        On each axis, m/s2; 0: as the guidance is set.
    axes
        With thrust, some of R, T and N.
    objective
        One of `vtff_control.guidance.reconfiguration_plan.OBJECTIVES`.
    passive_safety_orbits
        Orbits of drift in which a loss of thrust is safe; 0: not asked.
    preempt
        Whether it ends a reconfiguration that runs.
    designs
        Mean relative elements of every spacecraft in the formation, m, each of shape (6,), as in
        `vtff_control.guidance.formations`; None for a formation that the guidance has.

    Raises
    ------
    RequestError
        If a value is impossible.
    """

    formation: str
    duration: float
    closest_approach: float = 0.0
    acceleration_cap: float = 0.0
    axes: str = "RTN"
    objective: str = "norms"
    passive_safety_orbits: float = 0.0
    preempt: bool = False
    designs: Mapping[str, FloatArray] | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        if not self.formation:
            raise RequestError("formation: a name expected")
        for name, elements in (self.designs or {}).items():
            if np.shape(elements) != (6,) or not np.isfinite(elements).all():
                raise RequestError(f"designs: six numbers expected for {name}")
        if not (math.isfinite(self.duration) and self.duration > 0.0):
            raise RequestError(f"duration: more than 0 s expected, got {self.duration:g}")
        for name in ("closest_approach", "acceleration_cap", "passive_safety_orbits"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise RequestError(f"{name}: 0 or more expected, got {value:g}")
        if not self.axes or set(self.axes) - set("RTN") or len(set(self.axes)) != len(self.axes):
            raise RequestError(f"axes: some of R, T and N expected, got '{self.axes}'")
        if self.objective not in OBJECTIVES:
            raise RequestError(
                f"objective: one of {', '.join(OBJECTIVES)} expected, got '{self.objective}'"
            )


Request = ModeRequest | ReconfigurationRequest


@dataclass(frozen=True)
class TimelineEntry:
    """A request and its time.

    Attributes
    ----------
    time
        s after the first states.
    request
        Mode or reconfiguration that is asked for then.
    """

    time: float
    request: Request


def read_timeline(lines: Sequence[str]) -> list[TimelineEntry]:
    """Return the requests of a timeline in the order of their times.

    Parameters
    ----------
    lines
        One request each: time in s, mode, the formation where the mode has one, and fields of
        `ModeRequest` or `ReconfigurationRequest` as ``name=value``, such as
        ``120 reconfigure pco duration=4500 axes=TN``.

    Raises
    ------
    RequestError
        If a line has another form; the text names the line.
    """
    timed = read_timed_lines(lines, _read_request, "time and mode expected, such as '120 keep pco'")
    return [TimelineEntry(time, request) for time, request in timed]


def read_timed_lines(
    lines: Sequence[str], read_words: Callable[[list[str]], T], expected: str
) -> list[tuple[float, T]]:
    """Return what the lines of a timeline ask for, in the order of their times.

    Parameters
    ----------
    lines
        One entry each: time in s and at least one word more. Empty lines count for nothing.
    read_words
        Makes the entry of the words after the time, or raises RequestError.
    expected
        Text for a line without two words.

    Returns
    -------
    list of tuple
        Time in s and entry.

    Raises
    ------
    RequestError
        If a line has another form; the text names the line.
    """
    entries = []
    for line in filter(str.strip, lines):
        words = line.split()
        try:
            if len(words) < 2:
                raise RequestError(expected)
            time = read_number("time", words[0])
            if time < 0.0:
                raise RequestError(f"time: 0 s or more expected, got {words[0]}")
            entries.append((time, read_words(words[1:])))
        except RequestError as error:
            raise RequestError(f"timeline, '{line}': {error}") from error
    return sorted(entries, key=lambda entry: entry[0])


def read_setting(text: str, names: Iterable[str]) -> tuple[str, str]:
    """Return name and value of ``name=value``.

    Raises
    ------
    RequestError
        If the text has another form or the name is none of the names.
    """
    name, equals, value = text.partition("=")
    if not equals or name not in names:
        raise RequestError(f"'{text}': name=value expected, of {', '.join(names)}")
    return name, value


def read_number(name: str, text: str) -> float:
    """Return the finite number that a text is; raises RequestError with the name."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RequestError(f"{name}: a number expected, got '{text}'")
    return value


def _read_request(words: list[str]) -> Request:
    mode, settings = words[0], words[1:]
    if mode not in MODES:
        raise RequestError(f"mode: one of {', '.join(MODES)} expected, got '{mode}'")
    kind = ReconfigurationRequest if mode == "reconfigure" else ModeRequest
    values: dict[str, object] = {} if mode == "reconfigure" else {"mode": mode}
    if settings and "=" not in settings[0]:
        values["formation"] = settings.pop(0)
    fields = {
        field.name: str(field.type)
        for field in dataclasses.fields(kind)
        if field.name not in ("designs", "mode")
    }
    for setting in settings:
        name, text = read_setting(setting, fields)
        values[name] = _value(name, fields[name], text)
    try:
        return kind(**values)  # type: ignore[arg-type]
    except TypeError as error:
        required = "formation and duration" if mode == "reconfigure" else "mode"
        raise RequestError(f"{required} expected") from error


def _value(name: str, kind: str, text: str) -> object:
    if kind == "float":
        return read_number(name, text)
    if kind == "bool":
        if text not in ("true", "false"):
            raise RequestError(f"{name}: true or false expected, got '{text}'")
        return text == "true"
    return text

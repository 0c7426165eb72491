"""The interface of a guidance, which a plug-in of ``vtff.guidances`` implements.

Once per sample a guidance gets the states of the whole formation and answers with the wanted state
and the feedforward thrust of every spacecraft. The node `formation_guidance` uses it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vtff_control.guidance.keeping import T5_ENGINE, KeepingEngine
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "PLUGIN_MODE",
    "FormationState",
    "Guidance",
    "GuidanceResult",
    "GuidanceSetting",
    "SpacecraftTarget",
    "check_guidance_result",
    "describe_field",
]

PLUGIN_MODE = "plugin"


@dataclass(frozen=True)
class GuidanceSetting:
    """Setting that `formation_guidance` gives a guidance; the guidance may leave parts of it.

    Attributes
    ----------
    chief, deputies
        Names of the spacecraft.
    sample_time
        Interval between states in s, for which thrust is held.
    delay_steps
        Whole sample intervals between a state and the start of the thrust that answers it.
    engine
        Thrust of each spacecraft on an axis.
    mass
        Mass of each spacecraft, kg.
    formations
        Formations by name, from `vtff_control.guidance.formations.read_formations`.
    """

    chief: str
    deputies: tuple[str, ...]
    sample_time: float = 1.0
    delay_steps: int = 1
    engine: KeepingEngine = T5_ENGINE
    mass: float = 1600.0
    formations: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)

    @property
    def spacecraft(self) -> tuple[str, ...]:
        """Names, the chief first."""
        return (self.chief, *self.deputies)


@dataclass(frozen=True, eq=False)
class FormationState:
    """The formation at one time.

    Attributes
    ----------
    stamp
        Time of validity in whole nanoseconds.
    state_chief_gcrf
        Position (m) and velocity (m/s) of the chief in GCRF, shape (6,).
    relative_states
        State of each deputy: position (m) and rotating-frame velocity (m/s) in the chief's RTN
        frame, shape (6,).
    covariances
        Covariances of these states, shape (6, 6); a deputy whose state is the truth is absent.
    """

    stamp: int
    state_chief_gcrf: FloatArray
    relative_states: Mapping[str, FloatArray]
    covariances: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class SpacecraftTarget:
    """Target of a spacecraft for a step.

    Attributes
    ----------
    relative_state
        Wanted state relative to the chief in RTN, m and m/s, shape (6,).
    acceleration_rtn
        Feedforward thrust of the spacecraft itself in the chief's RTN axes, m/s2, shape (3,).
    """

    relative_state: FloatArray
    acceleration_rtn: FloatArray


@dataclass(frozen=True, eq=False)
class GuidanceResult:
    """Outcome of one step.

    Attributes
    ----------
    targets
        Targets of every spacecraft, the chief too.
    mode
        Mode in force; a plug-in may leave it.
    formation
        Formation that is kept or approached; empty without.
    reason
        Why the mode changed or a request was refused last, one line.
    time_left
        To the end of the mode, s.
    closest_approach
        Smallest distance of any pair in the plan, m; not a number without one.
    velocity_changes_left
        Velocity change that the plan still has for each spacecraft, m/s.
    """

    targets: Mapping[str, SpacecraftTarget]
    mode: str = PLUGIN_MODE
    formation: str = ""
    reason: str = ""
    time_left: float = math.inf
    closest_approach: float = math.nan
    velocity_changes_left: Mapping[str, float] = field(default_factory=dict)


class Guidance(Protocol):
    """Methods of a guidance.

    A plug-in is a class made as ``Class(setting)`` with a `GuidanceSetting`, or, where it has an
    attribute ``Parameters`` (a frozen dataclass), as ``Class(setting, parameters)``. One that takes
    requests (modes, reconfigurations, a timeline) also has the methods of
    `vtff_control.guidance.formation_guidance.FormationGuidance` for them.
    """

    def reset(self) -> None:
        """Forget what was: time has jumped back."""

    def step(self, state: FormationState) -> GuidanceResult:
        """Return what every spacecraft shall do; called once per sample.

        Parameters
        ----------
        state
            The formation now.
        """


def check_guidance_result(result: object, spacecraft: tuple[str, ...]) -> None:
    """Refuse the result of a guidance that cannot be published.

    Parameters
    ----------
    result
        Result that a guidance has returned.
    spacecraft
        Names that must have a target.

    Raises
    ------
    ValueError
        If it is no GuidanceResult, or a target is missing, has a wrong shape or is not finite.
    """
    if not isinstance(result, GuidanceResult):
        raise ValueError(f"a GuidanceResult is expected, got {type(result).__name__}")
    for name in spacecraft:
        target = result.targets.get(name)
        if not isinstance(target, SpacecraftTarget):
            raise ValueError(f"targets: no SpacecraftTarget for {name}")
        for what, length in (("relative_state", 6), ("acceleration_rtn", 3)):
            values = np.asarray(getattr(target, what))
            if values.shape != (length,) or values.dtype.kind not in "fiu":
                raise ValueError(
                    f"{what} of {name}: {length} numbers expected, "
                    f"got shape {values.shape} of {values.dtype}"
                )
            if not np.isfinite(values).all():
                raise ValueError(f"{what} of {name}: not finite, {values.tolist()}")


def describe_field(default: float, description: str, unit: str = "", minimum: float = 0.0) -> float:
    """Return the dataclass field of a number, which a node can take for its own parameter.

    Parameters
    ----------
    default
        Value where nothing is given.
    description, unit
        Text and unit that ``vtff node NODE --help`` prints.
    minimum
        Smallest value that a node takes.
    """
    metadata = {"description": description, "unit": unit, "minimum": minimum}
    value: float = field(default=default, metadata=metadata)
    return value

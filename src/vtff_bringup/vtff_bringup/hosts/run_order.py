"""What the main part of a run was told on its command line, and tells the other parts."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

from vtff_bringup.run.host_session import HostError
from vtff_bringup.system.description import RunSettings
from vtff_bringup.system.overrides import parse_override

__all__ = ["RunOrder"]


@dataclasses.dataclass(frozen=True)
class RunOrder:
    """Arguments and options of a run.

    Attributes
    ----------
    overrides
        ``key:=value`` texts.
    pacing, duration, seed, max_lag
        As in `RunSettings`.
    composed
        Whether the nodes of each host share a process; None: in lockstep they do.
    report
        Whether the host that records writes a report.
    """

    overrides: tuple[str, ...] = ()
    pacing: str = "lockstep"
    duration: float | None = None
    seed: int | None = None
    max_lag: float | None = None
    composed: bool | None = None
    report: bool = True

    def settings(self, run_directory: pathlib.Path, free_ports: dict[str, int]) -> RunSettings:
        """Return the settings with which a host loads the system file."""
        return RunSettings(
            run_directory=run_directory,
            pacing=self.pacing,
            duration=self.duration,
            seed=self.seed,
            max_lag=self.max_lag,
            free_ports=free_ports,
        )

    @property
    def shares_process(self) -> bool:
        """Whether the nodes of each host share a process.

        In real time each has a process of its own, so that none waits for the work of another.
        """
        return self.pacing == "lockstep" if self.composed is None else self.composed

    def as_message(self) -> dict[str, Any]:
        """Return the order as a message for another host."""
        return dataclasses.asdict(self)

    @classmethod
    def from_message(cls, content: Any) -> RunOrder:
        """Return the order in a message.

        Raises
        ------
        HostError
            If the message has not the form of one.
        """
        try:
            order = cls(
                overrides=tuple(str(text) for text in content["overrides"]),
                pacing=str(content["pacing"]),
                duration=None if content["duration"] is None else float(content["duration"]),
                seed=None if content["seed"] is None else int(content["seed"]),
                max_lag=None if content["max_lag"] is None else float(content["max_lag"]),
                composed=None if content["composed"] is None else content["composed"] is True,
                report=content["report"] is True,
            )
        except (KeyError, TypeError, ValueError) as error:
            raise HostError("what came is no order of a run") from error
        if order.pacing not in ("lockstep", "realtime"):
            raise HostError(f"what came is no order of a run: pacing '{order.pacing}'")
        return order

    def find_conflict(self, other: RunOrder) -> str:
        """Return what another part was given that this main part was not; empty for nothing.

        What a part is given besides has to be what the main part was given.
        """
        values = dict(parse_override(text) for text in self.overrides)
        for text in other.overrides:
            name, value = parse_override(text)
            if name not in values:
                return f"{name} is {value} there and is not given here"
            if values[name] != value:
                return f"{name} is {value} there and {values[name]} here"
        default = RunOrder()
        for field in dataclasses.fields(self):
            if field.name == "overrides":
                continue
            own, its = getattr(self, field.name), getattr(other, field.name)
            if its != getattr(default, field.name) and its != own:
                return f"{field.name.replace('_', '-')} is {its} there and {own} here"
        return ""

"""Signals as they arrive at a simulated receiver: true geometry, clock, delays and power."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.line_of_sight import LineOfSight
from vtff_sim_bridge.gnss.link_plan import LinkPlan

__all__ = ["ArrivingSignals"]

_OPTIONAL = ("wind_up", "antenna_delay")


@dataclass(frozen=True, eq=False)
class ArrivingSignals:
    """True state of a receiver and of its signals at k epochs: m links to n satellites.

    Parameters
    ----------
    plan : LinkPlan
        The links and their constants.
    line_of_sight : LineOfSight
        Geometry, (k, n).
    position_itrf, velocity_itrf : ndarray, shape (k, 3)
        Receiver at the time of reception, m, m/s.
    clock_offset, clock_drift : ndarray, shape (k,)
        s, s/s; receiver clock less GPS time.
    elapsed : ndarray, shape (k,)
        Time tag since the start of the run, s.
    slant_tec_tecu : ndarray, shape (k, n)
    s4_l1 : ndarray, shape (k, n)
        Largest S4 on L1 of the regions that the ray crosses.
    cn0_dbhz : ndarray, shape (k, m)
        With scintillation, without the noise of its estimate.
    code_delay, phase_delay : ndarray, shape (k, m)
        Lengths that ionosphere and scintillation add to the code and carrier ranges, m.
    jerk : ndarray, shape (k, n)
        Third derivative of the range that the receiver's motion causes, m/s3; only where loops
        slip by noise and dynamics, else zero.
    wind_up : ndarray, shape (k, n), or None
        Turns in `phase_delay`, cycles; None where they are not counted.
    antenna_delay : ndarray, shape (k, m), or None
        Length that the phase centres of the antenna add, m; None where they are its reference
        point.
    """

    plan: LinkPlan
    line_of_sight: LineOfSight
    position_itrf: FloatArray
    velocity_itrf: FloatArray
    clock_offset: FloatArray
    clock_drift: FloatArray
    elapsed: FloatArray
    slant_tec_tecu: FloatArray
    s4_l1: FloatArray
    cn0_dbhz: FloatArray
    code_delay: FloatArray
    phase_delay: FloatArray
    jerk: FloatArray
    wind_up: FloatArray | None = None
    antenna_delay: FloatArray | None = None

    @property
    def epoch_count(self) -> int:
        """Number of epochs."""
        return len(self.elapsed)

    def at(self, epochs: slice) -> ArrivingSignals:
        """Return the signals at some of the epochs."""
        if epochs.indices(self.epoch_count) == (0, self.epoch_count, 1):
            return self
        columns: dict[str, Any] = {
            field.name: getattr(self, field.name)[epochs]
            for field in fields(self)
            if field.name not in ("plan", "line_of_sight", *_OPTIONAL)
        }
        geometry = {name: column[epochs] for name, column in vars(self.line_of_sight).items()}
        for name in _OPTIONAL:
            column = getattr(self, name)
            columns[name] = None if column is None else column[epochs]
        return ArrivingSignals(self.plan, LineOfSight(**geometry), **columns)

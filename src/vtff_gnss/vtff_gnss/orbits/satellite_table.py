"""What orbits of GNSS satellites are asked for, whether broadcast or precise."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.broadcast_orbit import SatelliteStates

__all__ = ["SatelliteOrbits", "SatelliteTable"]


class SatelliteTable(Protocol):
    """Orbits and clocks of n satellites, in the order of system and number.

    Attributes
    ----------
    system, prn, source : ndarray of uint8, shape (n,)
    group_delay, group_delay_secondary : ndarray, shape (n,)
        As in `BroadcastEphemeris`, s; zero where no message tells them.
    """

    system: npt.NDArray[np.uint8]
    prn: npt.NDArray[np.uint8]
    source: npt.NDArray[np.uint8]
    group_delay: FloatArray
    group_delay_secondary: FloatArray

    def __len__(self) -> int:
        """Return the number of satellites."""
        ...

    def __hash__(self) -> int:
        """Return the identity: a table does not change."""
        ...

    def select(self, rows: npt.NDArray[np.intp]) -> SatelliteTable:
        """Return a table of some rows."""
        ...

    def states(self, time: GpsTime, offset: npt.ArrayLike = 0.0) -> SatelliteStates:
        """Return orbit and clock of all satellites at ``time + offset``."""
        ...


class SatelliteOrbits(Protocol):
    """Orbits and clocks of many satellites over a span of time."""

    def __len__(self) -> int:
        """Return zero if nothing is known."""
        ...

    def table(self, time: GpsTime) -> SatelliteTable:
        """Return the satellites that are known at a time."""
        ...

    def next_change(self, time: GpsTime) -> GpsTime | None:
        """Return until when `table` gives the object of `time`; None if for ever."""
        ...

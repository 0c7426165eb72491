"""The receiver's own navigation solution and clock, as dataclasses."""

from __future__ import annotations

from dataclasses import dataclass

from vtff_dynamics.time.timescales import GpsTime

__all__ = [
    "STATUS_DIFFERENTIAL",
    "STATUS_FIXED",
    "STATUS_FLOAT",
    "STATUS_NONE",
    "STATUS_SINGLE",
    "Fix",
    "ReceiverTime",
]

STATUS_NONE = 0
STATUS_SINGLE = 1
STATUS_DIFFERENTIAL = 2
STATUS_FLOAT = 3
STATUS_FIXED = 4


@dataclass(frozen=True)
class Fix:
    """Position, velocity and time solution of the receiver (``vtff_msgs/GnssFix``).

    Parameters
    ----------
    time : GpsTime
        Epoch of the solution.
    status : int
        ``STATUS_*``.
    receiver_solution_type : int
        The receiver's own code (NovAtel table "Position or Velocity Type").
    position, velocity : tuple of 3 float
        Earth-fixed, m and m/s; NaN with `STATUS_NONE`, and the velocity alone where the receiver
        had no velocity solution.
    position_sigma, velocity_sigma : tuple of 3 float
        m and m/s; NaN where the value is.
    velocity_latency : float
        s; the velocity is valid this long before `time`.
    satellites_tracked, satellites_used : int
        Satellites tracked and used in the solution.
    clock_offset, clock_offset_sigma : float
        s, receiver clock minus GPS time; NaN where the receiver did not report it.
    """

    time: GpsTime
    status: int
    receiver_solution_type: int
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    position_sigma: tuple[float, float, float]
    velocity_sigma: tuple[float, float, float]
    velocity_latency: float
    satellites_tracked: int
    satellites_used: int
    clock_offset: float
    clock_offset_sigma: float

    @property
    def gps_week(self) -> int:
        """Full GPS week number since 1980-01-06."""
        return self.time.week

    @property
    def gps_time_of_week(self) -> float:
        """Seconds of the GPS week."""
        return self.time.time_of_week


@dataclass(frozen=True)
class ReceiverTime:
    """The receiver's own estimate of its clock.

    Parameters
    ----------
    time : GpsTime
        Receiver time of the estimate.
    is_valid : bool
        The receiver's clock model is valid.
    clock_offset : float
        s, receiver clock minus GPS time.
    clock_offset_sigma : float
        s.
    utc_offset : float
        s; UTC = GPS time + `utc_offset` (negative: -18 s since 2017).
    """

    time: GpsTime
    is_valid: bool
    clock_offset: float
    clock_offset_sigma: float
    utc_offset: float

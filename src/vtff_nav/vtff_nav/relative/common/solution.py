"""The interface of the relative navigation filters: what goes in and what comes out.

Both estimators (`vtff_nav.relative.cdgps.estimator` and `vtff_nav.relative.paper.estimator`) are
used in the same way: ephemerides and thrust are added as they arrive, and
`RelativeEstimator.process` is called once for each epoch with what the two receivers have measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observations import ObservationEpoch

__all__ = [
    "AMBIGUITY_FIXED",
    "AMBIGUITY_FLOAT",
    "AMBIGUITY_HELD",
    "SOLUTION_CODE",
    "SOLUTION_FIXED",
    "SOLUTION_FLOAT",
    "SOLUTION_NONE",
    "SOLUTION_PREDICTED",
    "AmbiguityTable",
    "DifferentialTecTable",
    "LaserMeasurement",
    "RelativeEstimator",
    "RelativeSolution",
]

SOLUTION_NONE = 0
SOLUTION_PREDICTED = 1
SOLUTION_CODE = 2
SOLUTION_FLOAT = 3
SOLUTION_FIXED = 4
"""Numbers of ``vtff_msgs/RelativeState``."""

AMBIGUITY_FLOAT = 0
AMBIGUITY_FIXED = 1
AMBIGUITY_HELD = 2
"""Numbers of ``vtff_msgs/AmbiguityStatus``."""


@dataclass(frozen=True, eq=False)
class LaserMeasurement:
    """A range measured by a laser between the two spacecraft (``vtff_msgs/LaserRange``).

    Parameters
    ----------
    time : GpsTime
        Time tag of the instrument.
    range : float
        m, as measured: true range + latency times range rate + noise.
    range_sigma : float
        m.
    """

    time: GpsTime
    range: float
    range_sigma: float


def _bytes() -> npt.NDArray[np.uint8]:
    return np.zeros(0, dtype=np.uint8)


def _floats() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class AmbiguityTable:
    """Carrier-phase ambiguities, deputy less chief, as columns of ``vtff_msgs/AmbiguityStatus``.

    Parameters
    ----------
    system, prn, band, attribute, reference_prn, state : ndarray of uint8, shape (n,)
        `reference_prn` is 0 where the ambiguity is single-differenced. A fixed ambiguity is that
        of the double difference with the reference satellite of its system and signal.
    ambiguity_cycles : ndarray, shape (n,)
        Cycles; an integer where `state` is not `AMBIGUITY_FLOAT`.
    ambiguity_sigma_cycles : ndarray, shape (n,)
        One sigma of the float estimate of this epoch, cycles.
    fixed_since : tuple of GpsTime or None, length n
        Epoch at which the integer was fixed; None where float.
    """

    system: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    prn: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    band: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    attribute: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    reference_prn: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    ambiguity_cycles: FloatArray = field(default_factory=_floats)
    ambiguity_sigma_cycles: FloatArray = field(default_factory=_floats)
    state: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    fixed_since: tuple[GpsTime | None, ...] = ()

    def __len__(self) -> int:
        """Return the number of ambiguities."""
        return len(self.prn)


@dataclass(frozen=True, eq=False)
class DifferentialTecTable:
    """Differential slant TEC, deputy less chief, as columns of ``vtff_msgs/SlantTec``.

    Only satellites whose ambiguities are integers on both signals are in it.

    Parameters
    ----------
    system, prn, band_first, band_second : ndarray of uint8, shape (n,)
    stec_tecu, stec_sigma_tecu : ndarray, shape (n,)
        TECU, one sigma. The level, common to all satellites of a system, comes from the state of
        the filter and is part of the sigma.
    elevation, azimuth : ndarray, shape (n,)
        At the chief, rad.
    arc : ndarray of uint32, shape (n,)
        Number of the continuous arc; changes whenever the integer is decided anew.
    """

    system: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    prn: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    band_first: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    band_second: npt.NDArray[np.uint8] = field(default_factory=_bytes)
    stec_tecu: FloatArray = field(default_factory=_floats)
    stec_sigma_tecu: FloatArray = field(default_factory=_floats)
    elevation: FloatArray = field(default_factory=_floats)
    azimuth: FloatArray = field(default_factory=_floats)
    arc: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self.prn)


@dataclass(frozen=True, eq=False)
class RelativeSolution:
    """Deputy relative to chief at an epoch (``vtff_msgs/RelativeState`` and more).

    Parameters
    ----------
    time : GpsTime
        Time of validity, GPS time.
    solution : int
        ``SOLUTION_*``; with `SOLUTION_NONE` the numbers below are NaN.
    position_rtn, velocity_rtn : ndarray, shape (3,)
        In the chief's RTN frame; m and m/s, the derivative seen in the frame that turns about N
        with h/r2 (as `vtff_dynamics.frames.frames.relative_state_rtn` without acceleration).
    covariance_rtn : ndarray, shape (6, 6)
        Of position and velocity.
    position_itrf : ndarray, shape (3,)
        The baseline, deputy less chief, in Earth-fixed axes, m.
    covariance_position_itrf : ndarray, shape (3, 3)
    position_chief_gcrf, velocity_chief_gcrf : ndarray, shape (3,)
        m and m/s.
    covariance_chief_gcrf : ndarray, shape (6, 6)
    satellites_used : int
        Satellites in common view that were used at this epoch.
    ambiguities_fixed : int
        Integers that the solution rests on.
    ratio, success_rate : float
        Of the last integer search; 0 when not tested.
    innovation_rms : float
        Innovations normalised by their predicted sigmas, RMS; 0 without measurements.
    normalised_innovation_squared : float
        v' S^-1 v of the measurements used; `innovation_count` degrees of freedom.
    innovation_count : int
    age : float
        s since the last measurement update.
    ambiguities : AmbiguityTable
    differential_tec : DifferentialTecTable
    local_electron_density : float
        Electrons per m3 between the two altitudes; NaN where not estimated.
    local_electron_density_sigma : float
    laser_latency, laser_latency_sigma : float
        s; NaN without laser.
    laser_residual : float
        m, after the compensation of the latency; NaN without laser.
    clock_difference : float
        Receiver clock of the deputy less that of the chief, s; NaN if unknown.
    degraded : tuple of str
        Why the solution is not what it should be, for people; empty if nothing is wrong.
    excluded : tuple of str
        Signals left out at this epoch and why, e.g. ``"G05 L1: cycle slip"``.
    """

    time: GpsTime
    solution: int
    position_rtn: FloatArray
    velocity_rtn: FloatArray
    covariance_rtn: FloatArray
    position_itrf: FloatArray
    covariance_position_itrf: FloatArray
    position_chief_gcrf: FloatArray
    velocity_chief_gcrf: FloatArray
    covariance_chief_gcrf: FloatArray
    satellites_used: int = 0
    ambiguities_fixed: int = 0
    ratio: float = 0.0
    success_rate: float = 0.0
    innovation_rms: float = 0.0
    normalised_innovation_squared: float = 0.0
    innovation_count: int = 0
    age: float = 0.0
    ambiguities: AmbiguityTable = field(default_factory=AmbiguityTable)
    differential_tec: DifferentialTecTable = field(default_factory=DifferentialTecTable)
    local_electron_density: float = float("nan")
    local_electron_density_sigma: float = float("nan")
    laser_latency: float = float("nan")
    laser_latency_sigma: float = float("nan")
    laser_residual: float = float("nan")
    clock_difference: float = float("nan")
    degraded: tuple[str, ...] = ()
    excluded: tuple[str, ...] = ()

    @classmethod
    def none(cls, time: GpsTime, degraded: tuple[str, ...], age: float = 0.0) -> RelativeSolution:
        """Return a solution that says only why there is none."""
        vector, matrix = np.full(3, np.nan), np.full((6, 6), np.nan)
        return cls(
            time=time,
            solution=SOLUTION_NONE,
            position_rtn=vector,
            velocity_rtn=vector,
            covariance_rtn=matrix,
            position_itrf=vector,
            covariance_position_itrf=matrix[:3, :3],
            position_chief_gcrf=vector,
            velocity_chief_gcrf=vector,
            covariance_chief_gcrf=matrix,
            age=age,
            degraded=degraded,
        )


class RelativeEstimator(Protocol):
    """What a relative navigation filter offers."""

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Take a broadcast ephemeris; repetitions cost nothing."""

    def add_thrust(self, start: GpsTime, duration: float, acceleration_rtn: npt.ArrayLike) -> None:
        """Take the thrust acceleration of the deputy over ``[start, start + duration)``.

        Parameters
        ----------
        start : GpsTime
        duration : float
            s.
        acceleration_rtn : array_like, shape (3,)
            m/s2, in the chief's RTN axes at `start`, held inertially over the interval.

        Notes
        -----
        To be called before the epochs in the interval are processed; without it there is no
        thrust.
        """

    def process(
        self,
        time: GpsTime,
        chief: ObservationEpoch | None,
        deputy: ObservationEpoch | None,
        laser: LaserMeasurement | None = None,
    ) -> RelativeSolution:
        """Go on to an epoch and use what was measured there.

        Parameters
        ----------
        time : GpsTime
            Epoch, later than the one before; the solution is valid at this GPS time. The time
            tags of `chief` and `deputy` are equal to it (in receiver time).
        chief, deputy : ObservationEpoch or None
            None where a receiver has sent nothing for this epoch.
        laser : LaserMeasurement, optional
        """

    def reset(self) -> None:
        """Forget every estimate; ephemerides are kept."""

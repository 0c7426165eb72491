"""The interface of the relative navigation filters: their input, their solution, its constants.

Both estimators (`vtff_nav.relative.cdgps.estimator` and `vtff_nav.relative.paper.estimator`) are
used in the same way: ephemerides and thrust are added as they arrive, and
`RelativeEstimator.process` is called once for each epoch with the observations of both receivers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, is_finite
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observations import ObservationEpoch

__all__ = [
    "AMBIGUITY_FIXED",
    "AMBIGUITY_FLOAT",
    "AMBIGUITY_HELD",
    "SOLUTION_CODE",
    "SOLUTION_FIXED",
    "SOLUTION_FLOAT",
    "SOLUTION_NAMES",
    "SOLUTION_NONE",
    "SOLUTION_PREDICTED",
    "SOLUTION_TRUTH",
    "AmbiguityTable",
    "DifferentialTecTable",
    "LaserMeasurement",
    "RelativeEstimator",
    "RelativeSolution",
    "check_solution",
]

SOLUTION_NONE = 0
SOLUTION_PREDICTED = 1
SOLUTION_CODE = 2
SOLUTION_FLOAT = 3
SOLUTION_FIXED = 4
SOLUTION_TRUTH = 5
"""Kind of a relative state, as in ``vtff_msgs/RelativeState``; no filter returns the truth."""

SOLUTION_NAMES: Mapping[int, str] = MappingProxyType(
    {
        SOLUTION_NONE: "none",
        SOLUTION_PREDICTED: "predicted",
        SOLUTION_CODE: "code",
        SOLUTION_FLOAT: "float",
        SOLUTION_FIXED: "fixed",
    }
)
"""Names of the kinds of solution that a filter returns."""

AMBIGUITY_FLOAT = 0
AMBIGUITY_FIXED = 1
AMBIGUITY_HELD = 2
"""State of an ambiguity, as in ``vtff_msgs/AmbiguityStatus``."""


@dataclass(frozen=True, eq=False)
class LaserMeasurement:
    """A range measured by a laser between the two spacecraft (``vtff_msgs/LaserRange``).

    Parameters
    ----------
    time : GpsTime
        Time tag of the instrument.
    range : float
        Measured range, m: true range + latency times range rate + noise.
    range_sigma : float
        m.
    """

    time: GpsTime
    range: float
    range_sigma: float


def _no_bytes() -> npt.NDArray[np.uint8]:
    return np.zeros(0, dtype=np.uint8)


def _no_floats() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class AmbiguityTable:
    """Carrier-phase ambiguities, deputy less chief, as columns of ``vtff_msgs/AmbiguityStatus``.

    Parameters
    ----------
    system, prn, band, attribute : ndarray of uint8, shape (n,)
        Signal of the ambiguity.
    reference_prn : ndarray of uint8, shape (n,)
        Reference satellite of a fixed ambiguity, which is that of a double difference; 0 where the
        ambiguity is single-differenced.
    ambiguity_cycles : ndarray, shape (n,)
        Cycles; an integer where `state` is not `AMBIGUITY_FLOAT`.
    ambiguity_sigma_cycles : ndarray, shape (n,)
        One sigma of the float estimate of this epoch, cycles.
    state : ndarray of uint8, shape (n,)
        ``AMBIGUITY_*``.
    fixed_since : tuple of GpsTime or None, length n
        Epoch at which the integer was fixed; None where the ambiguity is float.
    """

    system: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    prn: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    band: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    attribute: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    reference_prn: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    ambiguity_cycles: FloatArray = field(default_factory=_no_floats)
    ambiguity_sigma_cycles: FloatArray = field(default_factory=_no_floats)
    state: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    fixed_since: tuple[GpsTime | None, ...] = ()

    def __len__(self) -> int:
        """Return the number of ambiguities."""
        return len(self.prn)


@dataclass(frozen=True, eq=False)
class DifferentialTecTable:
    """Differential slant TEC, deputy less chief, as columns of ``vtff_msgs/SlantTec``.

    The table holds the satellites whose ambiguities are integers on two signals.

    Parameters
    ----------
    system, prn, band_first, band_second : ndarray of uint8, shape (n,)
        Satellite, and the RINEX frequency digits of its two signals.
    stec_tecu, stec_sigma_tecu : ndarray, shape (n,)
        TECU, one sigma. The level, common to all satellites of a system, comes from the state of
        the filter and is part of the sigma.
    elevation, azimuth : ndarray, shape (n,)
        Direction of the satellite at the chief, rad.
    arc : ndarray of uint32, shape (n,)
        Number of the continuous arc; it changes whenever the integer is decided anew.
    """

    system: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    prn: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    band_first: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    band_second: npt.NDArray[np.uint8] = field(default_factory=_no_bytes)
    stec_tecu: FloatArray = field(default_factory=_no_floats)
    stec_sigma_tecu: FloatArray = field(default_factory=_no_floats)
    elevation: FloatArray = field(default_factory=_no_floats)
    azimuth: FloatArray = field(default_factory=_no_floats)
    arc: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))

    def __len__(self) -> int:
        """Return the number of satellites."""
        return len(self.prn)


@dataclass(frozen=True, eq=False)
class RelativeSolution:
    """State of the deputy relative to the chief at an epoch (``vtff_msgs/RelativeState`` and more).

    Parameters
    ----------
    time : GpsTime
        Time of validity, GPS time.
    solution : int
        ``SOLUTION_*``; with `SOLUTION_NONE` the numbers below are NaN.
    position_rtn, velocity_rtn : ndarray, shape (3,)
        State in the chief's RTN frame; m and m/s. The velocity is the derivative seen in the frame
        that turns about N with h/r2 (as in `vtff_dynamics.frames.rtn.relative_state_rtn`
        without acceleration).
    covariance_rtn : ndarray, shape (6, 6)
        Covariance of position and velocity.
    position_itrf : ndarray, shape (3,)
        Baseline, deputy less chief, in Earth-fixed axes, m.
    covariance_position_itrf : ndarray, shape (3, 3)
    position_chief_gcrf, velocity_chief_gcrf : ndarray, shape (3,)
        State of the chief, m and m/s.
    covariance_chief_gcrf : ndarray, shape (6, 6)
    satellites_used : int
        Number of satellites in common view that were used at this epoch.
    ambiguities_fixed : int
        Number of integers that the solution rests on.
    ratio, success_rate : float
        Ratio and bootstrapped success rate of the last integer search; 0 when nothing was tested.
    innovation_rms : float
        RMS of the innovations, normalised by their predicted sigmas; 0 without measurements.
    normalised_innovation_squared : float
        v' S^-1 v of the measurements used; `innovation_count` degrees of freedom.
    innovation_count : int
    age : float
        Time since the last measurement update, s.
    ambiguities : AmbiguityTable
    differential_tec : DifferentialTecTable
    local_electron_density : float
        Electron density between the two altitudes, 1/m3; NaN where it is not estimated.
    local_electron_density_sigma : float
    laser_latency, laser_latency_sigma : float
        Latency of the laser, s; NaN without laser.
    laser_residual : float
        Measured less predicted range, latency included, m; NaN without laser.
    clock_difference : float
        Receiver clock of the deputy less that of the chief, s; NaN if unknown.
    degraded : tuple of str
        Sentences for people on what is wrong with the solution; empty if nothing is.
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
        """Return the solution of kind `SOLUTION_NONE` with the reasons for it in `degraded`."""
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
    """Methods of a relative navigation filter, which a plug-in of ``vtff.estimators`` implements.

    A plug-in is a class made as ``Class(setting)`` with an
    `vtff_nav.relative.common.estimator_setting.EstimatorSetting`, or, where it has an attribute
    ``Parameters`` (a frozen dataclass), as ``Class(setting, parameters)``.
    """

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Add a broadcast ephemeris; one that is already there costs nothing."""

    def add_thrust(self, start: GpsTime, duration: float, acceleration_rtn: npt.ArrayLike) -> None:
        """Add the thrust acceleration of the deputy over ``[start, start + duration)``.

        Parameters
        ----------
        start : GpsTime
        duration : float
            s.
        acceleration_rtn : array_like, shape (3,)
            m/s2, in the chief's RTN axes at `start`, held inertially over the interval.

        Notes
        -----
        The thrust must be added before the epochs in the interval are processed; the filter
        assumes no thrust where none was added.
        """

    def process(
        self,
        time: GpsTime,
        chief: ObservationEpoch | None,
        deputy: ObservationEpoch | None,
        laser: LaserMeasurement | None = None,
    ) -> RelativeSolution:
        """Predict the state to an epoch and update it with the measurements of that epoch.

        Parameters
        ----------
        time : GpsTime
            GPS time of the epoch, at which the solution is valid; later than the last epoch. The
            time tags of `chief` and `deputy` are equal to it (in receiver time).
        chief, deputy : ObservationEpoch or None
            Observations of each receiver; None where it has sent nothing for this epoch.
        laser : LaserMeasurement, optional
        """

    def reset(self) -> None:
        """Forget every estimate; keep the ephemerides."""


_SHAPES = {
    "position_rtn": (3,),
    "velocity_rtn": (3,),
    "covariance_rtn": (6, 6),
    "position_itrf": (3,),
    "covariance_position_itrf": (3, 3),
    "position_chief_gcrf": (3,),
    "velocity_chief_gcrf": (3,),
    "covariance_chief_gcrf": (6, 6),
}


def check_solution(solution: object) -> None:
    """Refuse a solution that cannot be published.

    Raises
    ------
    ValueError
        If it is no RelativeSolution, its kind is none that a filter returns, or an array has a
        wrong shape or, unless the kind is `SOLUTION_NONE`, a number that is not finite.
    """
    if not isinstance(solution, RelativeSolution):
        raise ValueError(f"a RelativeSolution is expected, got {type(solution).__name__}")
    if solution.solution not in SOLUTION_NAMES:
        raise ValueError(f"solution: {solution.solution!r} is none of {sorted(SOLUTION_NAMES)}")
    for name, shape in _SHAPES.items():
        array = np.asarray(getattr(solution, name))
        if array.shape != shape or array.dtype.kind not in "fiu":
            raise ValueError(
                f"{name}: numbers of shape {shape} expected, "
                f"got shape {array.shape} of {array.dtype}"
            )
        if solution.solution != SOLUTION_NONE and not is_finite(array):
            raise ValueError(f"{name}: not finite in a solution of kind {solution.solution}")

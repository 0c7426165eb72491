"""The relative navigation filter over recorded epochs."""

from __future__ import annotations

import collections
import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from vtff_analysis.baseline.sources import LOWEST_ORBIT, BaselineError, BaselineSources, Position
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf, rotation_itrf_to_enu
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.dynamics import Dynamics
from vtff_nav.relative.common.measurements import DEFAULT_BANDS, MeasurementNoise
from vtff_nav.relative.common.solution import SOLUTION_NONE, RelativeSolution
from vtff_nav.relative.paper.estimator import PaperConfiguration, PaperEstimator

__all__ = ["BaselineOptions", "BaselineRun", "process_baseline"]

_ENU_NAMES = ("east", "north", "up")
_RTN_NAMES = ("radial", "in-track", "cross-track")
# A priori sigma of the vertical content of each shell over a receiver on the ground.
_CONTENT_SIGMA_TECU = 20.0


@dataclass(frozen=True)
class BaselineOptions:
    """Options of the computation of a baseline.

    Parameters
    ----------
    dynamics : str
        Motion of the rover relative to the base: ``static``, ``kinematic`` or ``orbital``.
    estimator : str
        ``cdgps`` or ``paper``.
    bands : mapping of int to tuple of int
        RINEX frequency digits that are used, by system.
    elevation_mask_deg : float
        Lowest elevation that is used.
    position_base_itrf : tuple of 3 float or None
        Surveyed position of the base, m; None if it is estimated.
    noise : MeasurementNoise
        Measurement noise of each receiver.
    troposphere : bool
        Whether the troposphere is modelled.
    start, end : GpsTime or None
        First and last epoch that are used; None for all epochs.
    """

    dynamics: Dynamics = "kinematic"
    estimator: str = "cdgps"
    bands: Mapping[int, tuple[int, ...]] = field(default_factory=lambda: dict(DEFAULT_BANDS))
    elevation_mask_deg: float = 10.0
    position_base_itrf: Position | None = None
    noise: MeasurementNoise = MeasurementNoise()
    troposphere: bool = False
    start: GpsTime | None = None
    end: GpsTime | None = None


@dataclass(frozen=True, eq=False)
class BaselineRun:
    """Solutions of all common epochs, as columns; n epochs.

    Parameters
    ----------
    axes : tuple of str
        Names of the local axes: east, north, up of the base, or radial, in-track, cross-track.
    time_nanoseconds : ndarray of int64, shape (n,)
        GPS time, as `GpsTime.nanoseconds`.
    solution : ndarray of uint8, shape (n,)
        ``SOLUTION_*`` of `vtff_nav.relative.common.solution`.
    baseline_itrf, baseline_local : ndarray, shape (n, 3)
        Rover less base, m; NaN without solution.
    sigma_local : ndarray, shape (n, 3)
        One sigma, m.
    rotation_to_local : ndarray, shape (n, 3, 3)
        Rotation from ITRF to the local axes.
    position_base_itrf : ndarray, shape (n, 3)
        Position of the base, surveyed or estimated, m.
    satellites_used, ambiguities_fixed : ndarray of int, shape (n,)
        Numbers of satellites and of fixed ambiguities.
    ratio, age : ndarray, shape (n,)
        Ratio of the ambiguity test, and s since the last measurement update.
    degraded : dict of str to int
        Reasons of a degraded solution, with their number of epochs.
    unpaired : tuple of 2 int
        Number of epochs that only the rover and only the base has.
    """

    axes: tuple[str, str, str]
    time_nanoseconds: npt.NDArray[np.int64]
    solution: npt.NDArray[np.uint8]
    baseline_itrf: FloatArray
    baseline_local: FloatArray
    sigma_local: FloatArray
    rotation_to_local: FloatArray
    position_base_itrf: FloatArray
    satellites_used: npt.NDArray[np.intp]
    ambiguities_fixed: npt.NDArray[np.intp]
    ratio: FloatArray
    age: FloatArray
    degraded: dict[str, int]
    unpaired: tuple[int, int]

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.time_nanoseconds)

    @property
    def seconds(self) -> FloatArray:
        """Seconds since the first epoch, shape (n,)."""
        return np.asarray(
            (self.time_nanoseconds - self.time_nanoseconds[0]) / NANOSECONDS_PER_SECOND
        )


def process_baseline(
    sources: BaselineSources,
    options: BaselineOptions,
    progress: Callable[[int, int], None] | None = None,
) -> BaselineRun:
    """Run the filter over all epochs that both receivers have.

    Parameters
    ----------
    sources : BaselineSources
        Observations of the two receivers.
    options : BaselineOptions
        Settings of the filter.
    progress : callable, optional
        Called as ``progress(epochs_done, epochs)``.

    Raises
    ------
    BaselineError
        If there are no common epochs, if the options contradict each other, or if the motion is one
        of receivers on the ground and the base is in orbit.
    """
    pairs = sources.common_epochs(options.start, options.end)
    estimator = _make_estimator(options)
    for ephemeris in sources.ephemerides:
        estimator.add_ephemeris(ephemeris)
    if sources.precise_orbits is not None:
        estimator.use_orbits(sources.precise_orbits)
    solutions = []
    thrust = collections.deque(sources.thrust)
    for done, (rover, base) in enumerate(pairs, start=1):
        time = sources.base.time(base)
        while thrust and thrust[0].start < time:
            burn = thrust.popleft()
            estimator.add_thrust(burn.start, burn.duration, burn.acceleration_rtn)
        epochs = sources.base.epoch(base), sources.rover.epoch(rover)
        solutions.append(estimator.process(time, *epochs))
        if options.dynamics != "orbital" and solutions[-1].solution != SOLUTION_NONE:
            _require_ground(solutions[-1], options.dynamics)
        if progress is not None:
            progress(done, len(pairs))
    unpaired = len(sources.rover) - len(pairs), len(sources.base) - len(pairs)
    if options.start is not None or options.end is not None:
        unpaired = (0, 0)
    return _make_run(solutions, options, sources.position_base_itrf, unpaired)


def _require_ground(solution: RelativeSolution, dynamics: Dynamics) -> None:
    position_itrf = rotation_gcrf_to_itrf(solution.time) @ solution.position_chief_gcrf
    height = geodetic_from_itrf(position_itrf)[2]
    if height > LOWEST_ORBIT:
        raise BaselineError(
            f"--dynamics {dynamics}: the base is in orbit, {height / 1e3:.0f} km high; "
            "take --dynamics orbital"
        )


def _make_estimator(options: BaselineOptions) -> CdgpsEstimator | PaperEstimator:
    if options.estimator == "paper":
        if options.dynamics != "orbital":
            raise BaselineError("estimator paper: for receivers in orbit only (--dynamics orbital)")
        return PaperEstimator(
            PaperConfiguration(
                bands=dict(options.bands),
                measurement_noise=options.noise,
                elevation_mask_deg=options.elevation_mask_deg,
            )
        )
    configuration = CdgpsConfiguration(
        dynamics=options.dynamics,
        position_chief_itrf=options.position_base_itrf,
        measurement_noise=options.noise,
        bands=dict(options.bands),
        elevation_mask_deg=options.elevation_mask_deg,
        troposphere=options.troposphere,
    )
    if options.dynamics != "orbital":
        # Both receivers see the whole ionosphere at slightly different elevations: without it a
        # baseline of 2 km is 1 to 2 mm too short.
        configuration = dataclasses.replace(
            configuration, estimate_plasma=True, plasma_shell_sigma_tecu=_CONTENT_SIGMA_TECU
        )
    return CdgpsEstimator(configuration)


def _make_run(
    solutions: list[RelativeSolution],
    options: BaselineOptions,
    position_base_itrf: Position | None,
    unpaired: tuple[int, int],
) -> BaselineRun:
    to_itrf = [rotation_gcrf_to_itrf(solution.time) for solution in solutions]
    base = np.array([to @ s.position_chief_gcrf for to, s in zip(to_itrf, solutions, strict=True)])
    if options.dynamics == "orbital":
        axes = _RTN_NAMES
        rotation = np.array(
            [_rtn_from_itrf(s, to) for s, to in zip(solutions, to_itrf, strict=True)]
        )
    else:
        axes = _ENU_NAMES
        # All epochs share one origin: the axes must not move with the estimate of the base.
        origin = options.position_base_itrf or position_base_itrf
        if origin is None and np.isfinite(base).any():
            origin = np.nanmedian(base, axis=0)
        rotation = np.full((len(solutions), 3, 3), np.nan)
        if origin is not None:
            rotation[:] = rotation_itrf_to_enu(origin)
    baseline = np.array([s.position_itrf for s in solutions])
    covariance = np.array([s.covariance_position_itrf for s in solutions])
    local = rotation @ covariance @ rotation.transpose(0, 2, 1)
    return BaselineRun(
        axes=axes,
        time_nanoseconds=np.array([s.time.nanoseconds for s in solutions], dtype=np.int64),
        solution=np.array([s.solution for s in solutions], dtype=np.uint8),
        baseline_itrf=baseline,
        baseline_local=np.einsum("nij,nj->ni", rotation, baseline),
        sigma_local=np.sqrt(np.einsum("nii->ni", local)),
        rotation_to_local=rotation,
        position_base_itrf=base,
        satellites_used=np.array([s.satellites_used for s in solutions], dtype=np.intp),
        ambiguities_fixed=np.array([s.ambiguities_fixed for s in solutions], dtype=np.intp),
        ratio=np.array([s.ratio for s in solutions]),
        age=np.array([s.age for s in solutions]),
        degraded=dict(Counter(reason for s in solutions for reason in s.degraded)),
        unpaired=unpaired,
    )


def _rtn_from_itrf(solution: RelativeSolution, to_itrf: FloatArray) -> FloatArray:
    if solution.solution == SOLUTION_NONE:
        return np.full((3, 3), np.nan)
    state = np.concatenate((solution.position_chief_gcrf, solution.velocity_chief_gcrf))
    return np.asarray(rotation_gcrf_to_rtn(state) @ to_itrf.T)

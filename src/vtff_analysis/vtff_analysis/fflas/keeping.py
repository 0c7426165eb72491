"""Keeping of paper 002's formations by pulses, on truth or on drawn navigation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vtff_analysis.closed_loop.drawn_navigation import DrawnNavigation, NavigationErrorModel
from vtff_analysis.fflas.reconfiguration import FFLAS_MASS, FFLAS_PERIOD, chief_elements_mean
from vtff_analysis.studies.formation_designs import fflas_formations
from vtff_control.guidance.keeping import T5_ENGINE, FormationKeeper
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_dynamics.vectors import FloatArray

__all__ = ["EPOCH", "Keeping", "keep_formation"]

EPOCH: GpsTime = parse_epoch("2016-03-21T01:00:00 GPS")
_STEP = 10.0  # s
_UPDATE = 60.0  # s between states that the estimators take


@dataclass(frozen=True, eq=False)
class Keeping:
    """A flight with keeping; the first orbit, in which the loop settles, does not count.

    Attributes
    ----------
    formation
        Name.
    times
        Times of the samples, s, shape (k,).
    positions
        Relative positions in RTN, m, shape (k, m, 3).
    deviations
        From the design, m, shape (k, m, 3).
    thrust
        In each step after the sample, m/s2, shape (k, m, 3).
    """

    formation: str
    times: FloatArray
    positions: FloatArray
    deviations: FloatArray
    thrust: FloatArray

    @property
    def counted(self) -> slice:
        """Samples after the first orbit."""
        return slice(math.ceil(FFLAS_PERIOD / _STEP), None)

    @property
    def velocity_change_per_day(self) -> FloatArray:
        """Sum over the axes of each satellite, m/s in a day, shape (m,)."""
        thrust = np.abs(self.thrust[self.counted])
        per_day: FloatArray = thrust.sum(axis=(0, 2)) * 86400.0 / len(thrust)
        return per_day

    @property
    def rms(self) -> FloatArray:
        """Root mean square of the deviation in space of each satellite, m, shape (m,)."""
        squares = (self.deviations[self.counted] ** 2).sum(axis=2)
        rms: FloatArray = np.sqrt(squares.mean(axis=0))
        return rms

    @property
    def closest_pair(self) -> float:
        """Smallest distance of two satellites, m."""
        return self._closest((0, 1, 2))

    @property
    def closest_pair_radial_normal(self) -> float:
        """Smallest distance of two satellites in the R-N plane, m."""
        return self._closest((0, 2))

    def _closest(self, axes: tuple[int, ...]) -> float:
        positions = self.positions[self.counted][:, :, axes]
        pairs = itertools.combinations(range(positions.shape[1]), 2)
        return min(closest_on_path(positions[:, j] - positions[:, i]) for i, j in pairs)


def keep_formation(
    formation: str,
    duration: float = 86400.0 + FFLAS_PERIOD,
    force_model: ForceModel | None = None,
    navigation: NavigationErrorModel | None = None,
    thrust: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Keeping:
    """Fly a formation with keeping about the reference orbit of paper 002.

    Parameters
    ----------
    formation
        Name, of `vtff_analysis.studies.formation_designs.fflas_formations`.
    duration
        s, with the first orbit, which does not count.
    force_model
        Forces on all spacecraft; default JGM-3 8x8.
    navigation
        Errors of the relative states that the keepers see; default none. The seed is that of the
        first satellite, the others take the next ones.
    thrust
        False lets the formation drift.
    progress
        Called with the share that is done.
    """
    forces = ForceModel() if force_model is None else force_model
    chief_mean = chief_elements_mean()
    chief_state = state_from_elements(osculating_elements(chief_mean))
    designs = list(fflas_formations()[formation].values())
    chief = Propagator(EPOCH, chief_state, forces, step=_STEP)
    deputies = [
        Propagator(
            EPOCH,
            deputy_state_gcrf(chief_state, relative_state_of_mean_elements(chief_mean, design)),
            forces,
            step=_STEP,
        )
        for design in designs
    ]
    keepers = [FormationKeeper(design, T5_ENGINE, FFLAS_MASS, _STEP) for design in designs]
    estimates = [
        None
        if navigation is None
        else DrawnNavigation(
            NavigationErrorModel(**{**vars(navigation), "seed": navigation.seed + index}),
            forces,
            _UPDATE,
        )
        for index in range(len(designs))
    ]
    count = int(duration // _STEP)
    positions = np.empty((count, len(designs), 3))
    deviations = np.empty((count, len(designs), 3))
    applied = np.zeros((count, len(designs), 3))
    every = round(_UPDATE / _STEP)
    for index in range(count):
        time = _STEP * index
        state = chief.state_gcrf
        rotation = rotation_gcrf_to_rtn(state)
        for craft, (deputy, keeper, drawn) in enumerate(
            zip(deputies, keepers, estimates, strict=True)
        ):
            relative = relative_state_rtn(state, deputy.state_gcrf)
            if index % every == 0:
                if drawn is None:
                    keeper.estimator.update(time, state, relative)
                else:
                    keeper.estimator.update(
                        time, state, *drawn.estimate(deputy.time, time, state, relative)
                    )
                target = keeper.target()
                deviations[index : index + every, craft] = relative[:3] - target[:3]
            positions[index, craft] = relative[:3]
            command = keeper.command(time) if thrust else np.zeros(3)
            applied[index, craft] = command
            keeper.estimator.add_thrust(command, _STEP)
            deputy.advance(rotation.T @ command)
        chief.advance()
        if progress is not None and index % 360 == 0:
            progress(index / count)
    times: FloatArray = _STEP * np.arange(count, dtype=float)
    return Keeping(formation, times, positions, deviations, applied)

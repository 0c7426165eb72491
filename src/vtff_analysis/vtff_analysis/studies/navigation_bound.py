"""Bound of relative navigation with known integers: a covariance analysis, without filter.

An estimator that knows the true noise of the phases (white and Gauss-Markov, one process for each
signal) and the integers from the start cannot have a smaller covariance than the Kalman recursion
here (Gelb 1974, Applied Optimal Estimation, sections 4.2 and 4.5: correlated measurement noise is
part of the state). An error of a filter that is compared with it needs many runs: the covariance is
that of the mean over all noise.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.vectors import FloatArray

__all__ = ["PhaseNoise", "PhaseSky", "motion_covariances"]

_UNKNOWN_POSITION_SIGMA = 10.0
_UNKNOWN_VELOCITY_SIGMA = 1.0
_UNKNOWN_BIAS_SIGMA = 100.0


@dataclass(frozen=True)
class PhaseNoise:
    """Noise of the phases of one receiver, m; the two receivers have the same.

    Parameters
    ----------
    white_sigma : float
        Sigma of the white noise of an epoch.
    slow_sigma : float
        Sigma of the Gauss-Markov processes; 0: there are none.
    correlation_time : float
        Correlation time of the Gauss-Markov processes, s.
    """

    white_sigma: float
    slow_sigma: float = 0.0
    correlation_time: float = 100.0


@dataclass(frozen=True, eq=False)
class PhaseSky:
    """Phases of an epoch that both receivers have.

    Parameters
    ----------
    signals : sequence of hashable, of length m
        Name of the Gauss-Markov process of each phase: its own, or one of all of a satellite.
    groups : sequence of hashable, of length m
        Phases of one group share a receiver bias.
    directions : ndarray, shape (m, 3)
        Unit vectors to the satellites in the axes of the state.
    nuisance : ndarray, shape (m, k)
        Derivatives by k further parameters, as the densities of layers of plasma, m.
    white_sigmas : ndarray, shape (m,), optional
        White noise of each phase at one receiver, m, in place of `PhaseNoise.white_sigma`; codes
        are phases with more noise.
    """

    signals: Sequence[Hashable]
    groups: Sequence[Hashable]
    directions: FloatArray
    nuisance: FloatArray
    white_sigmas: FloatArray | None = None


def motion_covariances(
    epochs: Iterable[tuple[PhaseSky, FloatArray, FloatArray]],
    noise: PhaseNoise,
    interval: float = 1.0,
    acceleration_sigma: float = 0.0,
    nuisance_sigma: float = 1.0,
    nuisance_time: float = 1200.0,
) -> FloatArray:
    """Return the smallest covariance of relative position and velocity at epochs, (n, 6, 6).

    Parameters
    ----------
    epochs : iterable of (PhaseSky, ndarray (9, 9), ndarray (9, 9))
        Phases; transition and process noise of position, velocity and empirical acceleration from
        the epoch before (not used at the first).
    noise : PhaseNoise
    interval : float
        Between epochs, s.
    acceleration_sigma : float
        Steady-state sigma of the empirical acceleration, m/s2.
    nuisance_sigma, nuisance_time : float
        Steady-state sigma and correlation time (s) of the further parameters, Gauss-Markov.
    """
    recursion: _Recursion | None = None
    covariances = []
    for sky, transition, process_noise in epochs:
        if recursion is None:
            count = sky.nuisance.shape[1]
            recursion = _Recursion(noise, acceleration_sigma, count, nuisance_sigma, nuisance_time)
        else:
            recursion.predict(interval, transition, process_noise)
        recursion.update(sky)
        covariances.append(recursion.covariance[:6, :6].copy())
    return np.array(covariances)


class _Recursion:
    """Covariance of motion, further parameters, clock, biases of groups and slow errors."""

    def __init__(
        self,
        noise: PhaseNoise,
        acceleration_sigma: float,
        nuisance_count: int,
        nuisance_sigma: float,
        nuisance_time: float,
    ) -> None:
        self._noise = noise
        self._nuisance = slice(9, 9 + nuisance_count)
        self._nuisance_variance, self._nuisance_time = nuisance_sigma**2, nuisance_time
        self._clock = 9 + nuisance_count
        self._column: dict[Hashable, int] = {}
        self._slow: list[int] = []
        sigmas = [_UNKNOWN_POSITION_SIGMA] * 3 + [_UNKNOWN_VELOCITY_SIGMA] * 3
        sigmas += [acceleration_sigma] * 3 + [nuisance_sigma] * nuisance_count
        self.covariance: FloatArray = np.diag(np.square([*sigmas, _UNKNOWN_BIAS_SIGMA]))

    def _columns(self, kind: str, names: Sequence[Hashable], variance: float) -> list[int]:
        """Return the columns of states by name; those that are new have a variance."""
        columns = []
        for name in names:
            column = self._column.get((kind, name))
            if column is None:
                column = self._column[kind, name] = len(self.covariance)
                grown = np.zeros((column + 1, column + 1))
                grown[:column, :column] = self.covariance
                grown[column, column] = variance
                self.covariance = grown
                if kind == "slow":
                    self._slow.append(column)
            columns.append(column)
        return columns

    def predict(self, interval: float, transition: FloatArray, process_noise: FloatArray) -> None:
        """Go on to the next epoch."""
        size = len(self.covariance)
        factor, added = np.ones(size), np.zeros(size)
        for columns, time, variance in (
            (np.arange(size)[self._nuisance], self._nuisance_time, self._nuisance_variance),
            (self._slow, self._noise.correlation_time, self._slow_variance),
        ):
            decay = math.exp(-interval / time)
            factor[columns], added[columns] = decay, (1.0 - decay**2) * variance
        # The clock difference of an epoch says nothing of the next one.
        factor[self._clock], added[self._clock] = 0.0, _UNKNOWN_BIAS_SIGMA**2
        covariance = factor[:, None] * self.covariance * factor
        covariance[:9] = transition @ covariance[:9]
        covariance[:, :9] = covariance[:, :9] @ transition.T
        covariance[:9, :9] += process_noise
        covariance.flat[:: size + 1] += added
        self.covariance = covariance

    @property
    def _slow_variance(self) -> float:
        return 2.0 * self._noise.slow_sigma**2

    def update(self, sky: PhaseSky) -> None:
        """Take the phases of an epoch."""
        count = len(sky.signals)
        if not count:
            return
        # The first group has its bias in the clock.
        first = sky.groups[0] if not self._column else None
        groups = self._columns("group", sky.groups, _UNKNOWN_BIAS_SIGMA**2)
        if first is not None:
            self.covariance[groups[0], groups[0]] = 0.0
        has_slow = self._noise.slow_sigma > 0.0
        slow = self._columns("slow", sky.signals, self._slow_variance) if has_slow else []
        rows = np.arange(count)
        design = np.zeros((count, len(self.covariance)))
        design[:, :3] = -sky.directions
        design[:, self._nuisance] = sky.nuisance
        design[:, self._clock] = 1.0
        design[rows, groups] = 1.0
        if has_slow:
            design[rows, slow] = 1.0
        cross = self.covariance @ design.T
        innovation = design @ cross
        white = self._noise.white_sigma if sky.white_sigmas is None else sky.white_sigmas
        innovation.flat[:: count + 1] += 2.0 * np.square(white)
        self.covariance = self.covariance - cross @ np.linalg.solve(innovation, cross.T)
        self.covariance = 0.5 * (self.covariance + self.covariance.T)

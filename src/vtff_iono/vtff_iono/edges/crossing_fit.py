"""Fits of walls to the contents of two spacecraft about a crossing.

D, the lagged difference of the contents of a satellite, and M, their mean, are fitted for all
satellites together (`vtff_iono.edges.edge_crossing`): altitudes at which both spacecraft cross the
wall, its width, and the density beside it. The noise of the contents is what the residuals show
(`vtff_iono.edges.content_noise`), so that fit and noise are found in turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_iono.edges.content_noise import (
    ContentNoise,
    SlowBasis,
    first_noise,
    noise_of_residuals,
)
from vtff_iono.edges.wall_width import WALL_SHAPES, WidthsByShape, shape_misfits, wall_integrals

__all__ = [
    "DEPTH_UNIT",
    "Wall",
    "WallFit",
    "Window",
    "WindowSatellite",
    "difference_and_mean",
    "fit_line",
    "fit_widths",
]

DEPTH_UNIT = 1e3
"""Unit of depths, m."""

# The fit and the noise that its residuals show are found in turns, each fit in at most so many
# steps, which end where the sum of squares falls by less than this. A step that does not help is
# tried again so many times, shorter (Levenberg 1944, Marquardt 1963).
_FITS, _STEPS, _SHORTER = 3, 25, 6
_LEAST_DROP = 1e-3
_DAMPING, _LESS_DAMPING, _MORE_DAMPING = 1e-3, 0.2, 5.0
# Step of the parameters for derivatives; as a part where they are larger than one.
_PARAMETER_STEP = 1e-3
# Number of altitudes that are searched.
_SEARCH_STEPS = 20
# Depths are in km and altitudes in units of 100 m, so that all parameters are near one.
_ALTITUDE_UNIT = 100.0
# m; width of the thinnest wall, and km: what is believed of the width beforehand.
_LEAST_WIDTH = 50.0
_WIDTH_PRIOR = 20.0


@dataclass(frozen=True, eq=False)
class Wall:
    """Altitudes at which chief and deputy cross a wall, (2,), m, its width, m, and its shape."""

    altitude: FloatArray
    width: float
    shape: int


@dataclass(frozen=True, eq=False)
class WindowSatellite:
    """Lagged difference D and mean M of the contents of a satellite, and their model; k samples.

    Parameters
    ----------
    slow : SlowBasis
        Constants of the arcs and polynomials.
    observed : ndarray, shape (2, k)
        D and M, TECU.
    path : ndarray, shape (2, k)
        Paths of the rays of chief and deputy through a layer over its height.
    samples : ndarray of int, shape (k,)
        Which of the samples of the window these are.
    """

    slow: SlowBasis
    observed: FloatArray
    path: FloatArray
    samples: npt.NDArray[np.int64]

    def change(self, vertical: FloatArray) -> FloatArray:
        """Return what vertical contents in the window, (..., 2, n), add to D and M, (..., 2, k)."""
        contents = vertical.reshape(-1, *vertical.shape[-2:])
        changes: FloatArray = _changes(self.path, contents, self.samples)
        return changes.reshape(*vertical.shape[:-1], len(self.samples))


@dataclass(frozen=True, eq=False)
class Window:
    """Contents of both spacecraft about a crossing, to which walls are fitted.

    Parameters
    ----------
    altitude : ndarray, shape (2, n)
        Altitudes of chief and deputy, m.
    satellites : list of WindowSatellite
    """

    altitude: FloatArray
    satellites: list[WindowSatellite]

    def whitened(self, noise: ContentNoise) -> FloatArray:
        """Return D and M of all satellites in units of their noise, shape (m,)."""
        return noise.whiten(satellite.observed for satellite in self.satellites)

    def design(self, noise: ContentNoise, wall: Wall, dense_side: float) -> FloatArray:
        """Return what the wall adds to `whitened`, shape (m, 2); see `_wall`."""
        both = np.array(self._wall(wall, dense_side))
        return noise.whiten(satellite.change(both) for satellite in self.satellites)

    def inside(self, wall: Wall, dense_side: float) -> list[FloatArray]:
        """Return of each satellite which part of a wall the samples have crossed, (k,)."""
        depth = dense_side * (self.altitude.mean(axis=0) - wall.altitude.mean())
        part = np.clip(0.5 + depth / wall.width, 0.0, 1.0)
        return [part[satellite.samples] for satellite in self.satellites]

    def residuals(self, wall: Wall, dense_side: float, change: FloatArray) -> list[FloatArray]:
        """Return D and M of each satellite less those of the wall, TECU."""
        first, second = self._wall(wall, dense_side)
        vertical = change[0] * first + change[1] * second
        return [satellite.observed - satellite.change(vertical) for satellite in self.satellites]

    def _wall(self, wall: Wall, dense_side: float) -> tuple[FloatArray, FloatArray]:
        """Return contents of densities that are one and the depth, each of shape (2, n).

        Both times the part of the wall that is crossed: where a part of the density is missing,
        what is missing grows with the density itself.
        """
        depth = dense_side * (self.altitude - wall.altitude[:, np.newaxis]) / DEPTH_UNIT
        return wall_integrals(wall.shape, depth, wall.width / DEPTH_UNIT)


@dataclass(frozen=True, eq=False)
class WallFit:
    """A wall that was fitted.

    Parameters
    ----------
    wall : Wall
    noise : ContentNoise
    covariance : ndarray, shape (2, 2)
        Covariance of the altitudes, m^2.
    square_sigma : float
        Sigma of the square of the width, m^2.
    change : float
        Density next to the wall, TECU per kilometre.
    significance : float
        Square root of the drop of chi-square.
    """

    wall: Wall
    noise: ContentNoise
    covariance: FloatArray
    square_sigma: float
    change: float
    significance: float


def fit_line(
    window: Window,
    altitude: float,
    reach: float,
    width: float,
    dense_side: float,
    samples: tuple[int, ...],
) -> WallFit | None:
    """Return the fit of a wall that rises linearly; None if contents do not determine it.

    The noise of a satellite is even in time.

    Parameters
    ----------
    window : Window
    altitude, reach : float
        Altitude of the wall, and how far from there it is searched to either side, m.
    width : float
        Width from which the fit begins, m.
    dense_side : float
        1 where the dense side is above the wall, -1 below it.
    samples : tuple of int
        Numbers of samples over which residuals are averaged: for the noise of scintillation, and
        that while slow noise is not yet known.
    """
    bases = [satellite.slow for satellite in window.satellites]
    wall = Wall(np.full(2, altitude), math.hypot(width, _LEAST_WIDTH), 0)
    fit = _Fitted(
        window, ContentNoise.only_white(bases, np.ones((len(bases), 2))), wall, dense_side
    )
    fit.take_noise(first_noise(bases, fit.errors(), samples))
    fit.search(reach)
    fit.improve()
    for _ in range(1, _FITS):
        fit.take_noise(noise_of_residuals(fit.noise, fit.errors(), None, samples[0]))
        fit.improve()
    return fit.result()


def fit_widths(
    window: Window, line: WallFit, dense_side: float, samples: tuple[int, ...]
) -> WidthsByShape | None:
    """Return the widths of walls of all shapes near the fit of a line; None if there are none.

    Scintillation is on one side of a wall, where it also breaks arcs. It would hide there among the
    constants of arcs, and a wall would seem better known than it is; so that the noise is that of
    either side.

    Parameters
    ----------
    window : Window
    line : WallFit
        Fit of a wall that rises linearly.
    dense_side, samples
        As in `fit_line`.
    """
    fits = []
    for shape in range(len(WALL_SHAPES)):
        fit = _fit_shape(window, shape, line, dense_side, samples)
        if fit is None:
            return None
        fits.append(fit)
    return WidthsByShape(
        width=np.array([fit.wall.width for fit in fits]),
        sigma=np.array([fit.square_sigma for fit in fits]),
        misfit=shape_misfits(np.array([_costs(window, fit, fits, dense_side) for fit in fits])),
        is_of_square=True,
    )


def _fit_shape(
    window: Window, shape: int, line: WallFit, dense_side: float, samples: tuple[int, ...]
) -> WallFit | None:
    """Return the fit of a wall of a shape with the noise of either side; None if there is none."""
    wall = Wall(line.wall.altitude, line.wall.width, shape)
    fit = _Fitted(window, line.noise, wall, dense_side)
    for _ in range(1, _FITS):
        inside = window.inside(fit.wall, dense_side)
        fit.take_noise(noise_of_residuals(fit.noise, fit.errors(), inside, samples[0]))
        fit.improve()
    return fit.result(is_jackknife=True)


def _costs(window: Window, fit: WallFit, fits: list[WallFit], dense_side: float) -> FloatArray:
    """Return the sums of squares of m satellites over the noise that the fits have shown, in mean.

    With the noise of its own fit alone they would not be comparable: noise is larger where a wall
    fits worse.
    """
    ends = np.cumsum([satellite.observed.size for satellite in window.satellites])[:-1]
    costs = np.zeros(len(window.satellites))
    for other in fits:
        design = window.design(other.noise, fit.wall, dense_side)
        residual, _, _ = _solution(window.whitened(other.noise), design)
        costs += [float(part @ part) / len(fits) for part in np.split(residual, ends)]
    return costs


class _Fitted:
    """A wall while it is fitted.

    Parameters of a fit are how far both altitudes are from a first one, and the square of the
    width, on which contents depend where it is small.
    """

    def __init__(self, window: Window, noise: ContentNoise, wall: Wall, dense_side: float) -> None:
        self.noise = noise
        self._window, self._dense_side = window, dense_side
        self._origin, self._shape = wall.altitude, wall.shape
        self._parameters = np.array([0.0, 0.0, _square_of(wall.width)])
        self._derivatives = np.empty((0, 3))
        self._observed = window.whitened(noise)

    @property
    def wall(self) -> Wall:
        """The wall as it is fitted now."""
        return self._place(self._parameters)

    def take_noise(self, noise: ContentNoise) -> None:
        """Go on with another noise."""
        self.noise, self._observed = noise, self._window.whitened(noise)

    def errors(self) -> list[FloatArray]:
        """Return the residuals of D and M of each satellite, TECU."""
        _, change, _ = _solution(self._observed, self._design(self.wall))
        return self._window.residuals(self.wall, self._dense_side, change)

    def search(self, reach: float) -> None:
        """Take the best common altitude within a distance, m."""
        common = np.linspace(-reach, reach, _SEARCH_STEPS + 1) / _ALTITUDE_UNIT
        trials = [np.array([both, both, self._parameters[2]]) for both in common]
        costs = [float(np.sum(self._residuals(trial) ** 2)) for trial in trials]
        self._parameters = trials[int(np.argmin(costs))]

    def improve(self) -> None:
        """Go to the least sum of squares."""
        self._parameters, self._derivatives = _least_squares(self._residuals, self._parameters)

    def result(self, is_jackknife: bool = False) -> WallFit | None:
        """Return the fit; None if contents do not determine it."""
        information = self._derivatives.T @ self._derivatives
        # The samples do not determine the width of a thin wall; the altitudes do not depend on it.
        information[2, 2] += _WIDTH_PRIOR**-4
        if not np.linalg.cond(information) < 1e12:
            return None
        _, change, significance = _solution(self._observed, self._design(self.wall))
        residual = self._residuals(self._parameters)
        satellites = self._window.satellites
        spread = _spread(self._derivatives, residual, information, satellites, is_jackknife)
        return WallFit(
            wall=self.wall,
            noise=self.noise,
            covariance=_ALTITUDE_UNIT**2 * spread[:2, :2],
            square_sigma=math.sqrt(spread[2, 2]) * DEPTH_UNIT**2,
            change=float(change[0]),
            significance=significance,
        )

    def _place(self, parameters: FloatArray) -> Wall:
        altitudes = self._origin + _ALTITUDE_UNIT * parameters[:2]
        return Wall(altitudes, _width_of(parameters[2]), self._shape)

    def _design(self, wall: Wall) -> FloatArray:
        return self._window.design(self.noise, wall, self._dense_side)

    def _residuals(self, parameters: FloatArray) -> FloatArray:
        return _solution(self._observed, self._design(self._place(parameters)))[0]


def _spread(
    derivatives: FloatArray,
    residual: FloatArray,
    information: FloatArray,
    satellites: list[WindowSatellite],
    is_jackknife: bool,
) -> FloatArray:
    """Return the covariance of the parameters: that of the noise, or what satellites differ by.

    The residuals of a satellite pull the parameters to its side. Satellites err independently of
    each other, so that these pulls have a covariance of their own, whatever it is that is wrong
    with a satellite (Liang and Zeger 1986, Biometrika 73:13). In the directions in which it is
    larger, it counts: those of the mean of both altitudes, of their difference and of the width.
    """
    spread = np.linalg.inv(information)
    ends = np.cumsum([satellite.observed.size for satellite in satellites])[:-1]
    pulls = np.array(
        [
            of_satellite.T @ error
            for of_satellite, error in zip(
                np.split(derivatives, ends), np.split(residual, ends), strict=True
            )
        ]
    )
    count = len(satellites)
    moved = pulls @ spread
    if is_jackknife and count > 1:
        # A satellite of which much is known has pulled the fit to itself, and seems to agree.
        moved = np.array(
            [
                np.linalg.solve(information - of_satellite.T @ of_satellite, pull)
                for of_satellite, pull in zip(np.split(derivatives, ends), pulls, strict=True)
            ]
        )
        moved *= (count - 1) / count
    basis = np.array([[1.0, 1.0, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.0, 1.0]])
    inverse = np.linalg.inv(basis)
    scatter = np.sum((moved @ inverse) ** 2, axis=0) * count / max(1, count - 1)
    stated = inverse.T @ spread @ inverse
    factor = np.sqrt(np.maximum(1.0, scatter / np.diag(stated)))
    return np.asarray(basis.T @ (stated * np.outer(factor, factor)) @ basis)


def _least_squares(
    residuals: Callable[[FloatArray], FloatArray], start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return parameters of the least sum of squares near a start, and the derivatives there.

    Steps of the derivatives are absolute: parameters may be zero, where a relative one is lost.
    """
    parameters, value = start, residuals(start)
    cost, damping = float(value @ value), _DAMPING
    derivatives = np.empty((len(value), len(start)))
    for _ in range(_STEPS):
        for index, step in enumerate(_PARAMETER_STEP * np.maximum(1.0, np.abs(parameters))):
            beside = parameters.copy()
            beside[index] += step
            derivatives[:, index] = (residuals(beside) - value) / step
        normal, gradient = derivatives.T @ derivatives, derivatives.T @ value
        drop = 0.0
        for _ in range(_SHORTER):
            damped = normal + damping * (np.diag(np.diag(normal)) + 1e-9 * np.eye(len(start)))
            trial = parameters - np.linalg.solve(damped, gradient)
            value_there = residuals(trial)
            cost_there = float(value_there @ value_there)
            if cost_there < cost:
                drop = cost - cost_there
                parameters, value, cost = trial, value_there, cost_there
                damping *= _LESS_DAMPING
                break
            damping *= _MORE_DAMPING
        if drop < _LEAST_DROP:
            break
    return parameters, derivatives


def _width_of(square: float) -> float:
    """Return the width, m, of its square in units of depth, less that of the thinnest wall.

    Contents are as smooth in that number as they are in the square of the width: a root would make
    them steep where the wall is thin, and a thin wall seem well known.
    """
    return math.hypot(DEPTH_UNIT * math.sqrt(abs(square)), _LEAST_WIDTH)


def _square_of(width: float) -> float:
    """Return the square of a width, of which `_width_of` makes it."""
    return max(0.0, width**2 - _LEAST_WIDTH**2) / DEPTH_UNIT**2


def _solution(observed: FloatArray, design: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return residuals over their sigmas, changes of content, (2,), and significance.

    The density next to the edge and its gradient are estimated, common to all satellites.
    """
    change, *_ = np.linalg.lstsq(design, observed, rcond=None)
    residual = observed - design @ change
    drop = float(observed @ observed - residual @ residual)
    return residual, np.asarray(change), math.sqrt(max(0.0, drop))


def difference_and_mean(pair: FloatArray) -> FloatArray:
    """Return deputy less chief, and their mean, of rows chief and deputy, shape (2, k)."""
    chief, deputy = pair
    return np.array((deputy - chief, 0.5 * (chief + deputy)))


@compiled
def _changes(path, vertical, samples):  # type: ignore[no-untyped-def]
    """Return what vertical contents (m, 2, n) add to D and M, shape (m, 2, k).

    `path` (2, k) and `samples` (k,) are those of `WindowSatellite`.
    """
    changes = np.empty((len(vertical), 2, len(samples)))
    for number in range(len(vertical)):
        for row in range(len(samples)):
            chief = path[0, row] * vertical[number, 0, samples[row]]
            deputy = path[1, row] * vertical[number, 1, samples[row]]
            changes[number, 0, row] = deputy - chief
            changes[number, 1, row] = 0.5 * (chief + deputy)
    return changes

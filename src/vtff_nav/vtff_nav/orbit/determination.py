"""Mean elements and decay of one orbit, fitted to an arc of GNSS fixes by batch least squares.

The fitted numbers are mean elements and the rate of the semi-major axis; a step of the search moves
the orbit by the epicycle equations (mean relative elements with the secular effect of J2). The
orbit itself is integrated, because an epicycle without the tesseral harmonics is some hundred
metres off within an arc: more than the errors of the fixes. Two things keep the covariance honest.
Errors of fixes are slow (orbits, clocks and ionosphere last for half an hour), and neighbouring
fixes are weighed as what they are: almost the same measurement. Forces that are not modelled (drag
between day and night, radiation) return with the orbit; their amplitudes are estimated from a prior
(empirical accelerations once per revolution).

References
----------
Tapley, Schutz and Born (2004), Statistical Orbit Determination, sections 4.3 (batch least squares)
and 4.17 (empirical accelerations).
Hashida and Palmer (2001), Epicyclic motion of satellites about an oblate planet, J. Guidance
Control Dynamics 24(3), for the estimator of the SNAP-1 campaign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.mean_elements import (
    elements_from_state,
    mean_elements,
    osculating_elements,
    secular_rates,
    state_from_elements,
)
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.relative.relative_elements import (
    control_matrix,
    elements_of_deputy,
    linear_map_rtn,
)
from vtff_dynamics.relative.transition import (
    drag_effect,
    j2_transition_matrix,
    propagate_mean_elements,
)
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray

__all__ = ["DeterminedOrbit", "OrbitFitModel", "average_mean_elements", "determine_orbit"]

_DECAY = 6
_EMPIRICAL = 7
_PARAMETERS = 13
"""Mean relative elements (6, m), rate of the semi-major axis (m/s), and the empirical
accelerations by cosine and sine of the mean argument of latitude in R, T and N (m/s2)."""

_ITERATIONS = 20
_CONVERGED = 1e-3  # m, of every element
_SAMPLE_SPACING = 180.0  # s, of the average over an orbit


@dataclass(frozen=True)
class OrbitFitModel:
    """Errors of fixes and forces that the fit assumes.

    Parameters
    ----------
    white_sigma : float
        Error of a fix that is new in every fix, on each axis, m.
    slow_sigma, correlation_time : float
        Slow error of a fix on each axis, m, and its correlation time, s.
    empirical_sigma : float
        Amplitude of forces that are not modelled and return with the orbit, m/s2, on each axis.
    force_model : ForceModel
        Forces, without drag: its mean is what the rate of the semi-major axis stands for.
    step : float
        Step of the integration, s; fixes are a whole number of steps apart.

    Raises
    ------
    ValueError
        If a number is out of its range; the message names it.
    """

    white_sigma: float = 3.0
    slow_sigma: float = 5.0
    correlation_time: float = 1800.0
    empirical_sigma: float = 1e-7
    force_model: ForceModel = field(
        default_factory=lambda: ForceModel(degree=30, order=30, third_bodies=("sun", "moon"))
    )
    step: float = 20.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("white_sigma", "correlation_time", "empirical_sigma", "step"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}: more than 0 expected, got {getattr(self, name):g}")
        if not 0.0 <= self.slow_sigma < math.inf:
            raise ValueError(f"slow_sigma: 0 or more expected, got {self.slow_sigma:g}")


@dataclass(frozen=True)
class DeterminedOrbit:
    """The orbit of an arc.

    Attributes
    ----------
    time
        Middle of the arc.
    elements_mean
        Mean quasi-nonsingular elements there, m and rad, shape (6,), averaged over whole orbits.
    axis_rate
        Rate of the semi-major axis, m/s.
    covariance
        Covariance of the mean relative elements (m) at the middle and of the rate (m/s), shape
        (7, 7).
    residual
        Root mean square of the fixes less the orbit, on each axis, m.
    weighted_residual
        Root mean square of the residuals in units of their sigmas; 1 if the model of the errors is
        right.
    """

    time: GpsTime
    elements_mean: FloatArray
    axis_rate: float
    covariance: FloatArray
    residual: float
    weighted_residual: float

    @property
    def axis_sigma(self) -> float:
        """Sigma of the semi-major axis, m."""
        return math.sqrt(float(self.covariance[0, 0]))


def determine_orbit(
    time: GpsTime,
    seconds: npt.ArrayLike,
    fixes_gcrf: npt.ArrayLike,
    model: OrbitFitModel | None = None,
) -> DeterminedOrbit:
    """Fit an orbit to the fixes of an arc of an orbit or more.

    Parameters
    ----------
    time : GpsTime
        Time of the first fix.
    seconds : array_like, shape (n,)
        Times of the fixes after the first, s, rising from 0; gaps are allowed.
    fixes_gcrf : array_like, shape (n, 6)
        Positions and velocities, m and m/s. Positions are fitted; the search begins at the first
        fix with its velocity.
    model : OrbitFitModel, optional

    Raises
    ------
    ValueError
        If the fixes are fewer than five, not finite, not in steps of the model or shorter than an
        orbit, or the search does not converge.
    """
    model = model or OrbitFitModel()
    steps, fixes = _check_fixes(seconds, fixes_gcrf, model.step)
    mean, rate = mean_elements(elements_from_state(fixes[0])), 0.0
    factor = np.linalg.cholesky(_fix_covariance(steps, model))
    prior = np.zeros(_PARAMETERS)  # weights, as inverse sigmas
    prior[_EMPIRICAL:] = 1.0 / model.empirical_sigma
    for _ in range(_ITERATIONS):
        states = _integrate(time, mean, rate, int(steps[-1]), model)
        latitude, effects = _effects(mean, model.step, int(steps[-1]))
        design = linear_map_rtn(_mean_motion(mean), latitude)[steps, :3] @ effects[steps]
        to_rtn = rotation_gcrf_to_rtn(states[steps])
        design = np.swapaxes(to_rtn, 1, 2) @ design
        residual = fixes[:, :3] - states[steps, :3]
        # The axes have each their own slow error. It keeps to GCRF and not to the orbit's axes: the
        # satellites whose orbits and clocks are wrong stand nearly still there.
        columns = np.concatenate((design, residual[:, :, None]), axis=2)
        whitened = solve_triangular(factor, columns.reshape(len(steps), -1), lower=True)
        whitened = whitened.reshape(columns.shape)
        rows, values = whitened[:, :, :_PARAMETERS], whitened[:, :, _PARAMETERS]
        weighted = np.vstack((rows.reshape(-1, _PARAMETERS), np.diag(prior)[_EMPIRICAL:]))
        observed = np.concatenate((values.ravel(), np.zeros(_PARAMETERS - _EMPIRICAL)))
        # Columns of equal length: lengths of m and of m/s2 differ by 1e9.
        scale = 1.0 / np.linalg.norm(weighted, axis=0)
        solution, *_ = np.linalg.lstsq(weighted * scale, observed, rcond=None)
        change = scale * solution
        mean = elements_of_deputy(mean, change[:6])
        rate += float(change[_DECAY])
        if np.abs(change[:6]).max() < _CONVERGED:
            break
    else:
        raise ValueError("fixes_gcrf: the fit of an orbit does not converge")
    inverse = np.linalg.inv((weighted * scale).T @ (weighted * scale))
    covariance = scale[:, None] * inverse * scale
    left = residual - design @ change
    white = observed - weighted @ change
    middle = int(steps[-1]) // 2
    empirical = effects[middle, :, _EMPIRICAL:] @ change[_EMPIRICAL:]
    to_middle = np.eye(_EMPIRICAL, _PARAMETERS)
    to_middle[:6] = effects[middle]
    return DeterminedOrbit(
        time + model.step * middle,
        elements_of_deputy(average_mean_elements(states, middle, model.step), empirical),
        rate,
        to_middle @ covariance @ to_middle.T,
        math.sqrt(float(np.mean(left**2))),
        math.sqrt(float(np.mean(white[: left.size] ** 2))),
    )


def average_mean_elements(states_gcrf: FloatArray, middle: int, step: float) -> FloatArray:
    """Return mean elements at a row of an orbit, averaged over the whole orbits about it.

    The theory of mean elements is of the first order in J2; what it leaves, and the tesseral
    harmonics, have no mean over an orbit but are tens of metres at a moment.

    Parameters
    ----------
    states_gcrf : ndarray, shape (n, 6)
        m and m/s, in equal steps.
    middle : int
        The row.
    step : float
        s.

    Raises
    ------
    ValueError
        If there is less than half an orbit on either side of the row.
    """
    centre = mean_elements(elements_from_state(states_gcrf[middle]))
    rate = float(secular_rates(centre)[1])
    half = 0.5 * 2.0 * math.pi / rate  # s
    orbits = math.floor(min(middle, len(states_gcrf) - 1 - middle) * step / half)
    if orbits < 1:
        raise ValueError("states_gcrf: half an orbit on either side of the middle expected")
    # Samples in the middles of equal parts of the time: a sum of them has no error of its ends.
    parts = math.ceil(2.0 * orbits * half / _SAMPLE_SPACING)
    edges = orbits * half * ((2.0 * np.arange(parts) + 1.0) / parts - 1.0)
    total = np.zeros(6)
    for offset in edges:
        row = middle + round(float(offset) / step)
        known = mean_elements(elements_from_state(states_gcrf[row]))
        difference = known - propagate_mean_elements(centre, (row - middle) * step)
        for angle in (1, 5):
            difference[angle] = math.remainder(float(difference[angle]), 2.0 * math.pi)
        total += difference
    average: FloatArray = centre + total / parts
    return average


def _check_fixes(
    seconds: npt.ArrayLike, fixes_gcrf: npt.ArrayLike, step: float
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return the numbers of the steps of the fixes, and the fixes."""
    times, fixes = np.asarray(seconds, dtype=float), np.asarray(fixes_gcrf, dtype=float)
    if times.ndim != 1 or fixes.shape != (len(times), 6) or len(times) < 5:
        raise ValueError(
            f"fixes_gcrf: five or more rows of 6 numbers expected, one for each of seconds; got "
            f"{fixes.shape} and {times.shape}"
        )
    if not (np.isfinite(times).all() and np.isfinite(fixes).all()):
        raise ValueError("fixes_gcrf: finite numbers expected")
    steps = np.round(times / step)
    if steps[0] != 0 or np.abs(times - step * steps).max() > 1e-6 or (np.diff(steps) < 1).any():
        raise ValueError(f"seconds: rising multiples of {step:g} s from 0 expected")
    return steps.astype(int), fixes


def _fix_covariance(steps: npt.NDArray[np.intp], model: OrbitFitModel) -> FloatArray:
    """Return the covariance of the errors of all fixes on one axis, m2, shape (n, n)."""
    apart = model.step * np.abs(steps[:, None] - steps)
    covariance: FloatArray = model.slow_sigma**2 * np.exp(-apart / model.correlation_time)
    covariance[np.diag_indices(len(steps))] += model.white_sigma**2
    return covariance


def _mean_motion(elements: FloatArray) -> float:
    return math.sqrt(GM_EARTH / float(elements[0]) ** 3)


def _integrate(
    time: GpsTime, elements_mean: FloatArray, rate: float, steps: int, model: OrbitFitModel
) -> FloatArray:
    """Return the states of the orbit of mean elements at every step, m and m/s, (steps + 1, 6).

    The rate of its semi-major axis, m/s, is an acceleration along the track.
    """
    states = np.empty((steps + 1, 6))
    states[0] = state_from_elements(osculating_elements(elements_mean))
    propagator = Propagator(time, states[0], model.force_model, step=model.step)
    along = 0.5 * rate * _mean_motion(elements_mean)
    for row in range(steps):
        velocity = states[row, 3:]
        push = along / math.sqrt(float(velocity @ velocity)) * velocity if along else None
        states[row + 1] = propagator.advance(push)
    return states


def _effects(elements_mean: FloatArray, step: float, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return what the parameters make of the mean elements at every step.

    Returns
    -------
    ndarray, shape (steps + 1,)
        Mean argument of latitude, rad.
    ndarray, shape (steps + 1, 6, 13)
        Derivatives of mean relative elements (m) by the parameters.
    """
    rate = float(secular_rates(elements_mean)[1])
    mean_motion = _mean_motion(elements_mean)
    seconds = step * np.arange(steps + 1.0)
    latitude = float(elements_mean[1]) + rate * seconds
    effects = np.zeros((steps + 1, 6, _PARAMETERS))
    for row, after in enumerate(seconds.tolist()):
        effects[row, :, :6] = j2_transition_matrix(elements_mean, after)
        effects[row, :, _DECAY] = drag_effect(elements_mean, after)
    push = np.array([control_matrix(mean_motion, angle) for angle in latitude.tolist()])
    for wave, values in enumerate((np.cos(latitude), np.sin(latitude))):
        # Change of the elements by the acceleration; a change of the axis drifts along the track.
        kick = step * push * values[:, None, None]
        grown = np.cumsum(kick, axis=0) - 0.5 * (kick + kick[0])
        axis = grown[:, 0]
        drift = step * (np.cumsum(axis, axis=0) - 0.5 * (axis + axis[0]))
        grown[:, 1] -= 1.5 * mean_motion * drift
        effects[:, :, _EMPIRICAL + 3 * wave : _EMPIRICAL + 3 * wave + 3] = grown
    return latitude, effects

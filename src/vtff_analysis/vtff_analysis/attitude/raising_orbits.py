"""Orbits of SNAP-1 in its raising campaign, determined from GPS fixes as its operators did.

On a day the receiver gives fixes every 20 s over three to four orbits, and the ground fits mean
elements and their decay to them. The truth of an arc is integrated with more than the fit knows:
gravity to degree 40, drag of an atmosphere with day and night, radiation; fixes have slow errors
and white ones. An arc lies between two firings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_analysis.attitude.orbit_raising import FIRST_FIRING, LAUNCH, OrbitRaising
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.relative.relative_elements import relative_elements_of
from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_dynamics.vectors import FloatArray
from vtff_nav.orbit.determination import average_mean_elements, determine_orbit
from vtff_sim_bridge.on_board.own_fix import FixErrors, OwnFixEmulation

__all__ = ["FIX_ASSUMPTIONS", "DeterminedOrbits", "FixArc", "determine_raising_orbits", "fly_arc"]

FIX_ASSUMPTIONS = (
    "fixes: errors of 3 m, white, and of 5 m, slow over half an hour, on each axis (paper: < 15 m)",
    "arcs of 3.5 orbits without a firing in them",
    "0.1 m2 to air and sunlight, 6.5 kg; density of Harris and Priester",
)
"""Values of fixes and arcs that the paper does not give."""

_FIX_SPACING = 20.0  # s
_ARC_ORBITS = 3.5
_ORBIT = 5931.0  # s
_WHITE_SIGMA = 3.0  # m
_AVERAGED = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 0.0])  # elements that hardly change in an arc
_ADJUSTMENTS = 2
_SLOW_ERRORS = FixErrors(position_sigma=5.0, correlation_time=1800.0, velocity_sigma=0.1)
_TRUE_FORCES = ForceModel(
    degree=40,
    order=40,
    drag="harris_priester",
    solar_radiation_pressure=True,
    third_bodies=("sun", "moon"),
    mass=6.5,
    drag_area=0.1,
    radiation_area=0.1,
)


@dataclass(frozen=True)
class FixArc:
    """True orbit of an arc and the fixes of it.

    Attributes
    ----------
    time
        Time of the first fix.
    seconds
        Times of the fixes after it, s.
    fixes_gcrf
        Positions and velocities, m and m/s, shape (n, 6).
    elements_mean
        True mean elements in the middle, averaged over whole orbits, m and rad, shape (6,).
    """

    time: GpsTime
    seconds: FloatArray
    fixes_gcrf: FloatArray
    elements_mean: FloatArray


@dataclass(frozen=True)
class DeterminedOrbits:
    """Determined orbits of the campaign, one row for each arc, and their errors.

    Attributes
    ----------
    days
        Middle of the arc, days since the launch.
    elements_mean
        m and rad, shape (rows, 6).
    errors, covariances
        Mean relative elements of the true orbit from the determined one, m, shape (rows, 6), and
        their covariance, m2, shape (rows, 6, 6).
    before_firings
        True for the arcs before the first firing.
    """

    days: FloatArray
    elements_mean: FloatArray
    errors: FloatArray
    covariances: FloatArray
    before_firings: np.ndarray[tuple[int], np.dtype[np.bool_]]

    @property
    def error_over_sigma(self) -> FloatArray:
        """Root mean square of each error over its sigma, shape (6,)."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2)
        ratio: FloatArray = np.sqrt((self.errors**2 / variances).mean(axis=0))
        return ratio

    @property
    def eccentricity(self) -> FloatArray:
        """Mean eccentricity of each arc."""
        eccentricity: FloatArray = np.hypot(self.elements_mean[:, 2], self.elements_mean[:, 3])
        return eccentricity

    def decay(self) -> tuple[float, float]:
        """Return the decay before the first firing by the determined axes, and its sigma, m a day.

        The slope of a line through them, weighed alike.
        """
        days, axes = self.days[self.before_firings], self.elements_mean[self.before_firings, 0]
        gain = (days - days.mean()) / ((days - days.mean()) ** 2).sum()
        variances = self.covariances[self.before_firings, 0, 0]
        return -float(gain @ axes), float(np.sqrt(gain**2 @ variances))


def fly_arc(elements_mean: FloatArray, day: float, seed: int = 1) -> FixArc:
    """Fly an arc with given mean elements and draw its fixes.

    Parameters
    ----------
    elements_mean : ndarray, shape (6,)
        m and rad. Axis, eccentricity vector and inclination are averages about the middle of the
        arc; argument of latitude and node are those of its start.
    day : float
        Middle of the arc, days since the launch.
    seed : int
        Seed of the errors of the fixes; each day has its own.
    """
    launch = parse_epoch(f"{LAUNCH.isoformat()}T00:00:00 UTC")
    steps = 2 * round(0.5 * _ARC_ORBITS * _ORBIT / _FIX_SPACING)
    time = launch + (day * SECONDS_PER_DAY - 0.5 * steps * _FIX_SPACING)
    start = elements_mean
    for _ in range(_ADJUSTMENTS):
        state = state_from_elements(osculating_elements(start))
        propagator = Propagator(time, state, _TRUE_FORCES, step=_FIX_SPACING)
        states = np.array([state, *(propagator.advance() for _ in range(steps))])
        average = average_mean_elements(states, steps // 2, _FIX_SPACING)
        # Mean elements of the first moment are a hundred metres off the average.
        start = start + _AVERAGED * (elements_mean - average)
    address = round(10.0 * day)
    emulation = OwnFixEmulation(_SLOW_ERRORS, "snap1", seed * 100_000 + address)
    seconds = _FIX_SPACING * np.arange(steps + 1.0)
    fixes = np.array(
        [
            emulation.measure(round(after * NANOSECONDS_PER_SECOND), true)
            for after, true in zip(seconds.tolist(), states, strict=True)
        ]
    )
    generator = np.random.default_rng((seed, address, 0xF1))
    fixes[:, :3] += _WHITE_SIGMA * generator.standard_normal((steps + 1, 3))
    return FixArc(time, seconds, fixes, average)


def determine_raising_orbits(
    campaign: OrbitRaising, every: int = 3, seed: int = 1
) -> DeterminedOrbits:
    """Determine the orbit on days of the campaign.

    Parameters
    ----------
    campaign : OrbitRaising
    every : int
        Days from arc to arc; the operators had one on every day.
    seed : int
        Seed of the errors of the fixes.
    """
    days, elements, errors, covariances, before = [], [], [], [], []
    for row in range(0, len(campaign.days), round(every / (campaign.days[1] - campaign.days[0]))):
        day = float(campaign.days[row])
        arc = fly_arc(campaign.elements_mean[row], day, seed)
        orbit = determine_orbit(arc.time, arc.seconds, arc.fixes_gcrf)
        days.append(day)
        elements.append(orbit.elements_mean)
        errors.append(relative_elements_of(orbit.elements_mean, arc.elements_mean))
        covariances.append(orbit.covariance[:6, :6])
        before.append(day < (FIRST_FIRING - LAUNCH).days)
    return DeterminedOrbits(
        np.array(days),
        np.array(elements),
        np.array(errors),
        np.array(covariances),
        np.array(before),
    )

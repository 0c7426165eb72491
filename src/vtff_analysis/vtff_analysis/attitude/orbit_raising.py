"""Orbit raising of SNAP-1 towards Tsinghua-1, figures 10 and 11 of the paper, in mean elements.

Both orbits drift by their difference in semi-major axis; SNAP-1 decays faster, and firings raise
it. Two numbers that the paper does not give are fitted to two that it does: the difference of the
decays to the separation of 15 August, and what the last firings gave to the date of the closest
approach. What is compared is not fitted: the day and height of the largest separation, the raise,
and the smallest separation. The smallest separation rests on how near "nearly 90 deg" of
15 August was: a degree less there leaves five degrees more in March.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import date

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from vtff_dynamics.constants import J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.orbit.mean_elements import secular_rates
from vtff_dynamics.vectors import FloatArray

__all__ = ["FIRST_FIRING", "LAUNCH", "RAISING_ASSUMPTIONS", "OrbitRaising", "fly_orbit_raising"]

RAISING_ASSUMPTIONS = (
    "decay of SNAP-1 less that of Tsinghua-1 constant, fitted to 90 deg on 15 August (paper: "
    "nearly 90; a degree less leaves five degrees more at the closest approach)",
    "firings of 3 s, 50 mN, 6.5 kg every 3.5 orbits, along the track, of equal strength in August "
    "and September; none but tests before 30 August",
    "sum of the firings of October fitted to the closest approach on 12 March 2001",
    "eccentricity at the launch 0.001 with the perigee at the equator",
)
"""Values that the paper does not give, and those that are fitted."""

LAUNCH = date(2000, 6, 28)
"""Day from which the days of the campaign count."""

FIRST_FIRING = date(2000, 8, 30)
"""Day of the first firing but for tests."""

_SEEN = date(2000, 8, 15)
_LAST_FIRINGS = (date(2000, 10, 20), date(2000, 10, 28))
_CLOSEST = date(2001, 3, 12)
_BELOW_AT_LAUNCH, _ABOVE_AT_LAST = 1500.0, 1000.0  # m
_ORBITS_BETWEEN = 3.5
_FIRING = 3.0 * 0.05 / 6.5  # m/s: s, N, kg
_AXIS, _INCLINATION, _ECCENTRICITY = 7.082e6, math.radians(98.1), 1e-3
_J3 = -2.5327e-6  # unnormalised, of JGM-3
_DAYS = 300
_STEPS_PER_DAY = 10
_SECONDS = 86400.0 / _STEPS_PER_DAY


@dataclass(frozen=True)
class OrbitRaising:
    """The campaign, one row for each tenth of a day from the launch.

    Attributes
    ----------
    days
        Since 28 June 2000.
    axis_difference
        Mean semi-major axis of SNAP-1 less that of Tsinghua-1, m.
    elements_mean
        Mean quasi-nonsingular elements of SNAP-1, m and rad, shape (rows, 6); the argument of
        latitude is 0 throughout.
    separation_deg
        SNAP-1 ahead of Tsinghua-1 along the orbit.
    decay_difference
        Fitted decay of SNAP-1 less that of Tsinghua-1, m a day.
    last_firings
        Fitted raise by the firings of October, m.
    peak_day, peak_deg
        Largest separation.
    raised_day
        Day on which SNAP-1 is 1 km above.
    closest_deg
        Smallest separation after the firings.
    perigee_period
        Period in which J2 turns the perigee, days.
    """

    days: FloatArray
    axis_difference: FloatArray
    elements_mean: FloatArray
    separation_deg: FloatArray
    decay_difference: float
    last_firings: float
    peak_day: float
    peak_deg: float
    raised_day: float
    closest_deg: float
    perigee_period: float

    @property
    def eccentricity(self) -> FloatArray:
        """Mean eccentricity of SNAP-1."""
        eccentricity: FloatArray = np.hypot(self.elements_mean[:, 2], self.elements_mean[:, 3])
        return eccentricity


def fly_orbit_raising(separation_seen_deg: float = 90.0) -> OrbitRaising:
    """Fly the campaign from the launch to after the closest approach.

    Parameters
    ----------
    separation_seen_deg : float
        Separation on 15 August, to which the decay is fitted.
    """
    aim = math.radians(separation_seen_deg)
    seen = (_SEEN - LAUNCH).days * _STEPS_PER_DAY
    decay = float(brentq(lambda rate: _fly(rate, 0.0)[1][seen] - aim, 0.0, 100.0, xtol=1e-6))
    closest = (_CLOSEST - LAUNCH).days * _STEPS_PER_DAY
    last = float(brentq(lambda total: _fly(decay, total)[0][closest], 0.0, 5000.0, xtol=1e-3))
    axis, separation, eccentricity = _fly(decay, last)
    separation_deg = np.degrees(separation)
    days = np.arange(len(axis)) / _STEPS_PER_DAY
    elements = np.tile(_elements(_AXIS), (len(axis), 1))
    elements[:, 0] += axis
    elements[:, 2], elements[:, 3] = eccentricity.real, eccentricity.imag
    elements[:, 5] = 86400.0 * days * secular_rates(_elements(_AXIS))[5]
    peak = int(np.argmax(separation_deg))
    raised = int(np.argmax(axis >= _ABOVE_AT_LAST))
    return OrbitRaising(
        days,
        axis,
        elements,
        separation_deg,
        decay,
        last,
        float(days[peak]),
        float(separation_deg[peak]),
        float(days[raised]),
        float(separation_deg[raised:].min()),
        abs(2.0 * math.pi / _perigee_rate()) / 86400.0,
    )


def _elements(axis: float) -> FloatArray:
    return np.array([axis, 0.0, _ECCENTRICITY, 0.0, _INCLINATION, 0.0])


def _perigee_rate() -> float:
    """Return the rate at which J2 turns the perigee, rad/s."""
    return float(secular_rates(_elements(_AXIS))[3]) / _ECCENTRICITY


def _fly(
    decay: float, last_firings: float
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.complex128]]:
    """Return difference of the axes, m, separation, rad, and eccentricity vector in steps.

    Parameters
    ----------
    decay : float
        Difference of the decays, m a day.
    last_firings : float
        Raise by the firings of October, m.
    """
    rate = float(secular_rates(_elements(_AXIS))[1])
    small = 1000.0
    by_axis = (float(secular_rates(_elements(_AXIS + small))[1]) - rate) / small
    speed = rate * _AXIS
    firings_a_day = 86400.0 * rate / (2.0 * math.pi) / _ORBITS_BETWEEN
    raise_a_day = 2.0 * _AXIS * _FIRING / speed * firings_a_day
    begin = (FIRST_FIRING - LAUNCH).days
    begin_last, end_last = ((day - LAUNCH).days for day in _LAST_FIRINGS)
    # J3 moves the eccentricity vector to a point about which J2 turns it.
    frozen = -0.5 * _J3 / J2_EARTH * RADIUS_EARTH_JGM3 / _AXIS * math.sin(_INCLINATION)
    turn = np.exp(1j * _perigee_rate() * _SECONDS)
    vector = _ECCENTRICITY + 0.0j
    axis, separation, raising = -_BELOW_AT_LAUNCH, 0.0, True
    rows = np.empty((_DAYS * _STEPS_PER_DAY, 2))
    vectors = np.empty(len(rows), dtype=complex)
    for number in range(len(rows)):
        rows[number] = axis, separation
        vectors[number] = vector
        day = number / _STEPS_PER_DAY
        raised = 0.0
        raising = raising and axis < _ABOVE_AT_LAST
        if raising and day >= begin:
            raised = raise_a_day / _STEPS_PER_DAY
        elif begin_last <= day < end_last:
            raised = last_firings / (end_last - begin_last) / _STEPS_PER_DAY
        change = raised - decay / _STEPS_PER_DAY
        separation += by_axis * (axis + 0.5 * change) * _SECONDS
        axis += change
        # Thrust along the track over the ascending node: 2 dv / v towards it, and a is 2 a dv / v.
        vector = 1j * frozen + (vector - 1j * frozen) * turn + raised / _AXIS
    return rows[:, 0], rows[:, 1], vectors

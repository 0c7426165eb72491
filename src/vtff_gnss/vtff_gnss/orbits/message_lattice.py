"""Orbits and clocks that stay continuous although navigation messages round their numbers.

A navigation message holds integers (times a power of two). Two successive sets of one satellite
describe the same orbit only to that rounding: 20 mm in mean anomaly, 100 mm in the clock of GPS.
A simulator whose truth is the broadcast orbit would show these steps in its carrier phases.
Here the rates are chosen such that what they add up to between two sets, `SET_INTERVAL` apart, is
a whole number of message steps. All sets are then exact numbers of the message and join.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtff_gnss.constants import GPS_PI

__all__ = [
    "ANGLE_STEP",
    "RATE_STEP",
    "SET_INTERVAL",
    "LatticeMotion",
    "clock_steps",
    "lattice_motion",
    "node_rate_steps",
]

SET_INTERVAL = 7200
"""s between the reference times of successive sets (IS-GPS-200, 20.3.4.5: two hours)."""

ANGLE_STEP = 2.0**-31 * GPS_PI
"""rad; resolution of the angles of an orbit (IS-GPS-200 table 20-III; Galileo OS SIS ICD)."""

RATE_STEP = 2.0**-43 * GPS_PI
"""rad/s; resolution of mean motion difference and node rate (same sources)."""

_AXIS_ROOT_STEP = 2.0**-19
_AXIS_ROOT_CANDIDATES = 2000
_MEAN_MOTION_TOLERANCE = 1e-12

# Multiples of this many rate steps add up to whole angle steps: SET_INTERVAL is 2^5 * 225 s and
# the resolutions differ by 2^12 s. Clock offset and drift differ likewise.
_WHOLE_RATE_MULTIPLE = 2**7
_STEPS_PER_MULTIPLE = 225

# Sets between two turns of the clock's drift: 333 days, within which no clock leaves +-0.5 ms.
_CLOCK_QUARTER_PERIOD = 4000


@dataclass(frozen=True)
class LatticeMotion:
    """Mean motion in numbers of the message.

    Parameters
    ----------
    square_root_of_semi_major_axis : float
        m^0.5.
    mean_motion_difference : float
        rad/s.
    steps_per_set : int
        Mean anomaly gained in `SET_INTERVAL`, in `ANGLE_STEP`.
    """

    square_root_of_semi_major_axis: float
    mean_motion_difference: float
    steps_per_set: int


def lattice_motion(
    gravitational_parameter: float, mean_motion: float, mean_motion_difference: float
) -> LatticeMotion:
    """Return message numbers for a mean motion whose sets join to about 1e-6 m.

    Parameters
    ----------
    gravitational_parameter : float
        m3/s2, of the system.
    mean_motion : float
        rad/s wanted; met within 1e-12 rad/s (0.002 deg a year).
    mean_motion_difference : float
        rad/s; the part of `mean_motion` that is not Keplerian, met within 10 %.
    """
    axis_root = (gravitational_parameter / (mean_motion - mean_motion_difference) ** 2) ** (1 / 6)
    middle = round(axis_root / _AXIS_ROOT_STEP)
    indices = np.arange(middle - _AXIS_ROOT_CANDIDATES, middle + _AXIS_ROOT_CANDIDATES + 1)
    keplerian = np.sqrt(gravitational_parameter) / (indices * _AXIS_ROOT_STEP) ** 3
    nearest = np.rint((mean_motion - keplerian) / RATE_STEP)
    difference_steps = nearest[:, np.newaxis] + np.arange(-2, 3)
    candidates = keplerian[:, np.newaxis] + difference_steps * RATE_STEP
    gained = candidates * SET_INTERVAL / ANGLE_STEP
    miss = np.abs(gained - np.rint(gained))
    miss[np.abs(candidates - mean_motion) > _MEAN_MOTION_TOLERANCE] = np.inf
    row, column = np.unravel_index(int(np.argmin(miss)), miss.shape)
    return LatticeMotion(
        square_root_of_semi_major_axis=float(indices[row] * _AXIS_ROOT_STEP),
        mean_motion_difference=float(difference_steps[row, column] * RATE_STEP),
        steps_per_set=int(np.rint(gained[row, column])),
    )


def node_rate_steps(node_rate: float) -> tuple[int, int]:
    """Return a node rate in `RATE_STEP`, and the `ANGLE_STEP` that it gains in `SET_INTERVAL`.

    The rate is the nearest one, within 2.3e-11 rad/s, whose gain is whole.
    """
    multiple = round(node_rate / (_WHOLE_RATE_MULTIPLE * RATE_STEP))
    return multiple * _WHOLE_RATE_MULTIPLE, multiple * _STEPS_PER_MULTIPLE


def clock_steps(
    index: int, phase: int, drift_multiple: int, used_before_reference: bool
) -> tuple[int, int]:
    """Return clock offset and drift of a set in steps of the message: a triangle over time.

    Parameters
    ----------
    index : int
        Number of the set, counted in `SET_INTERVAL`.
    phase : int
        Shift of the triangle, in sets.
    drift_multiple : int
        Drift in 128 steps of the message; the sign is that of the first quarter.
    used_before_reference : bool
        The set is in use before its reference time (GPS) rather than after it (Galileo): at a
        turn its drift is that of the side on which it is used.

    Returns
    -------
    offset_steps, drift_steps : int
    """
    here = _triangle(index + phase)
    slope = here - _triangle(index + phase - 1)
    if not used_before_reference:
        slope = _triangle(index + phase + 1) - here
    return (
        here * drift_multiple * _STEPS_PER_MULTIPLE,
        slope * drift_multiple * _WHOLE_RATE_MULTIPLE,
    )


def _triangle(index: int) -> int:
    """Return a triangle wave with slopes of one and extremes of a quarter period."""
    quarter = _CLOCK_QUARTER_PERIOD
    phase = (index + quarter) % (4 * quarter)
    return phase - quarter if phase < 2 * quarter else 3 * quarter - phase

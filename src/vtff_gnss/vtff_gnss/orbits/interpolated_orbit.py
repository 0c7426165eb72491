"""Orbit and clock of satellites between exact evaluations of their ephemerides.

Position, velocity and acceleration at both ends of an interval determine a polynomial of degree 5
(quintic Hermite interpolation); clock offset and drift one of degree 3. The remainder is::

    |f - p| <= max |f^(6)| h^6 / (6! 2^6)        and        max |f^(4)| h^4 / (4! 2^4)

in the interval (Davis, Interpolation and Approximation, theorem 3.5.1). A satellite at r = 27e6 m
moves relative to the Earth-fixed axes with at most w = 2.2e-4 rad/s and twice that in the
harmonic corrections (below 1e-4 r), so that ``|f^(6)|`` < 4e-15 m/s6: with h = 30 s the error is
below 1e-10 m, and below rounding (4e-9 m). That of the clock is below 1e-11 m.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable, SatelliteStates
from vtff_gnss.orbits.compiled_sight import interpolation_powers

__all__ = ["InterpolatedOrbits"]

_INTERVAL = 30
_INTERVAL_NANOSECONDS = _INTERVAL * NANOSECONDS_PER_SECOND

# Rows: powers 0 to 5 of s in [0, 1]. Columns: value, first and second derivative by s at 0; the
# same at 1, but the value less that at 0, which would cost digits otherwise.
_QUINTIC = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
        [0.0, -6.0, -1.5, 10.0, -4.0, 0.5],
        [0.0, 8.0, 1.5, -15.0, 7.0, -1.0],
        [0.0, -3.0, -0.5, 6.0, -3.0, 0.5],
    ]
)
# The same for powers 0 to 3; value and first derivative.
_CUBIC = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, -2.0, 3.0, -1.0], [0.0, 1.0, -2.0, 1.0]]
)


class InterpolatedOrbits:
    """States of an `EphemerisTable` for many times that follow one another.

    Intervals begin at multiples of 30 s of GPS time, so that a state does not depend on what was
    asked for before.

    Parameters
    ----------
    table : EphemerisTable
        n satellites.
    """

    def __init__(self, table: EphemerisTable) -> None:
        self.table = table
        self._interval: int | None = None
        # Polynomials of position and clock, (4, power, n); that of the clock has degree 3.
        self._polynomials: FloatArray = np.empty((4, 6, 0))

    def motion(self, time: GpsTime, offset: FloatArray) -> FloatArray:
        """Return position (m) and clock offset (s) at ``time + offset``, and their derivatives.

        Parameters
        ----------
        time : GpsTime
            Chooses the interval: offsets of up to 2 s beyond it do no harm.
        offset : ndarray, shape (k,)
            s.

        Returns
        -------
        ndarray, shape (4, 3 k, n)
            Position (3) and clock offset of n satellites; the k values, then the first and the
            second derivatives. The second derivative of the clock offset is not used.
        """
        interval = time.nanoseconds // _INTERVAL_NANOSECONDS
        if interval != self._interval:
            self._take(interval)
        begin = interval * _INTERVAL_NANOSECONDS
        since = (time.nanoseconds - begin) / NANOSECONDS_PER_SECOND
        powers = interpolation_powers(since, offset, float(_INTERVAL))
        return np.asarray(powers @ self._polynomials)

    def states(self, time: GpsTime, offset: npt.ArrayLike) -> SatelliteStates:
        """Return orbit and clock of all satellites at ``time + offset``.

        Only tests call this method, also through `lines_of_sight`: the reference of
        `vtff_gnss.orbits.line_of_sight.rays_of_epochs`.

        Parameters
        ----------
        time : GpsTime
            Chooses the interval, see `motion`.
        offset : array_like, shape (k, 1)
            s.

        Returns
        -------
        SatelliteStates
            With leading axis ``(k, n)``; as `EphemerisTable.states` gives it, to rounding.
        """
        epochs = np.array(offset, dtype=float)[:, 0].copy()
        motion = self.motion(time, epochs).reshape(4, 3, len(epochs), -1)
        # Components first, as those who use the states want them.
        position, velocity, acceleration = np.moveaxis(motion[:3], 0, -1)
        return SatelliteStates(
            position_itrf=position,
            velocity_itrf=velocity,
            acceleration_itrf=acceleration,
            clock_offset=motion[3, 0],
            clock_drift=motion[3, 1],
        )

    def _take(self, interval: int) -> None:
        """Evaluate both ends of an interval."""
        begin = GpsTime(interval * _INTERVAL_NANOSECONDS)
        states = self.table.states(begin, np.array([[0.0], [float(_INTERVAL)]]))
        ends = np.stack(
            (
                states.position_itrf,
                states.velocity_itrf * _INTERVAL,
                states.acceleration_itrf * _INTERVAL**2,
            ),
            axis=1,
        )
        ends[1, 0] -= ends[0, 0]
        clocks = np.stack((states.clock_offset, states.clock_drift * _INTERVAL), axis=1)
        clocks[1, 0] -= clocks[0, 0]
        self._polynomials = np.zeros((4, 6, clocks.shape[-1]))
        # (end and derivative, n, 3) to (3, power, n)
        self._polynomials[:3] = _QUINTIC @ np.moveaxis(ends.reshape(6, -1, 3), -1, 0)
        self._polynomials[3, :4] = _CUBIC @ clocks.reshape(4, -1)
        self._interval = interval

"""Ephemerides and thrust that a relative estimator is given between epochs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, is_finite
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.satellite_table import SatelliteOrbits, SatelliteTable
from vtff_nav.relative.common.antenna_correction import Attitudes
from vtff_nav.relative.common.body_attitude import BodyAttitude
from vtff_nav.relative.common.dynamics import ThrustInterval

__all__ = ["EstimatorInputs"]

_ATTITUDES_KEPT = 8
_LONGEST_ATTITUDE_AGE = 60.0  # s; rates of 1e-5 rad/s that are not known turn by 0.03 deg


class EstimatorInputs:
    """Base class of the estimators: methods of `RelativeEstimator` that all of them share.

    Parameters
    ----------
    ephemerides : iterable of BroadcastEphemeris, optional
        Ephemerides to begin with.
    """

    def __init__(self, ephemerides: Iterable[BroadcastEphemeris] = ()) -> None:
        self._ephemerides = dict.fromkeys(ephemerides)
        self._store: EphemerisStore | None = None
        self._precise_orbits: SatelliteOrbits | None = None
        self._thrust: list[ThrustInterval] = []
        self._attitudes: tuple[list[BodyAttitude], list[BodyAttitude]] = ([], [])

    def add_ephemeris(self, ephemeris: BroadcastEphemeris) -> None:
        """Add a broadcast ephemeris; one that is already there costs nothing."""
        if ephemeris not in self._ephemerides:
            self._ephemerides[ephemeris] = None
            self._store = None

    def use_orbits(self, orbits: SatelliteOrbits) -> None:
        """Use these orbits and clocks in place of the ephemerides."""
        self._precise_orbits = orbits

    def add_attitude(self, attitude: BodyAttitude, *, is_of_chief: bool = False) -> None:
        """Add an estimated attitude; it counts for the epochs after it until there is a newer one.

        An attitude of the time of an epoch does not count for that epoch: whether it comes before
        or after the observations must not change the solution. Only antennas whose attitude frame
        is "estimated" use attitudes.
        """
        of_receiver = self._attitudes[0 if is_of_chief else 1]
        of_receiver.append(attitude)
        del of_receiver[:-_ATTITUDES_KEPT]

    def _attitudes_at(self, time: GpsTime) -> Attitudes:
        """Return the newest attitudes before an epoch; None where none is young enough."""
        if not any(self._attitudes):
            return None, None
        chief, deputy = (
            next(
                (
                    attitude
                    for attitude in reversed(attitudes)
                    if 0.0 < time - attitude.time <= _LONGEST_ATTITUDE_AGE
                ),
                None,
            )
            for attitudes in self._attitudes
        )
        return chief, deputy

    def _corrections_since(self, before: Attitudes, attitudes: Attitudes) -> list[FloatArray]:
        """Return by how much measurements have turned attitudes since those before, rad.

        The corrections are those of chief and deputy, body axes, shape (3,) each; nan where an
        estimator tells none, or no attitude was before. That the body turns between two corrections
        is left out: 5 mrad of them in 5 s.
        """
        corrections = []
        for kept, first, second in zip(self._attitudes, before, attitudes, strict=True):
            if first is None or second is None or first not in kept:
                corrections.append(np.full(3, np.nan))
                continue
            later = kept[kept.index(first) + 1 : kept.index(second) + 1]
            corrections.append(sum((one.correction for one in later), np.zeros(3)))
        return corrections

    def add_thrust(self, start: GpsTime, duration: float, acceleration_rtn: npt.ArrayLike) -> None:
        """Add the thrust of the deputy; see `RelativeEstimator.add_thrust`.

        Raises
        ------
        ValueError
            If the acceleration is not three finite numbers or the duration not positive.
        """
        self._add_thrust(start, duration, acceleration_rtn, is_of_chief=False)

    def add_chief_thrust(
        self, start: GpsTime, duration: float, acceleration_rtn: npt.ArrayLike
    ) -> None:
        """Add the thrust of the chief, in the same axes as that of the deputy.

        Raises
        ------
        ValueError
            If the acceleration is not three finite numbers or the duration not positive.
        """
        self._add_thrust(start, duration, acceleration_rtn, is_of_chief=True)

    def _add_thrust(
        self,
        start: GpsTime,
        duration: float,
        acceleration_rtn: npt.ArrayLike,
        *,
        is_of_chief: bool,
    ) -> None:
        acceleration = np.array(acceleration_rtn, dtype=float)
        if acceleration.shape != (3,) or not is_finite(acceleration):
            raise ValueError("acceleration_rtn: three finite numbers expected")
        if not duration > 0.0:
            raise ValueError("duration: more than 0 s expected")
        if acceleration.any():
            self._thrust.append(ThrustInterval(start, duration, acceleration, is_of_chief))

    def _ephemeris_table(self, time: GpsTime) -> SatelliteTable:
        """Return the satellites whose orbit is known at a time."""
        if self._precise_orbits is not None:
            return self._precise_orbits.table(time)
        if self._store is None:
            self._store = EphemerisStore(self._ephemerides)
        return self._store.table(time)

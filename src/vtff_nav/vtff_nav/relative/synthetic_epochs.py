"""Some epochs of an imagined formation, in which an estimator compiles what it needs."""

from __future__ import annotations

import numpy as np

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.earth import state_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.orbit.gravity import predict_state
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.ideal_receiver import ideal_observations
from vtff_gnss.orbits.nominal_constellation import nominal_gps_constellation
from vtff_nav.relative.common.body_attitude import BodyAttitude
from vtff_nav.relative.common.estimator_inputs import EstimatorInputs
from vtff_nav.relative.common.solution import RelativeEstimator, RelativeSolution

__all__ = ["process_synthetic_epochs"]

_START = GpsTime.from_week_tow(2000, 0.0)
_RADIUS, _DISTANCE = 7e6, 500.0
_IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
_AT_REST = np.array([6.37e6, 0.0, 0.0, 0.0, 0.0, 0.0])
# The noise is learnt, and all of its models weighed, from the third epoch on; the filter of the
# paper starts after 60 s.
_EPOCHS, _INTERVAL = 8, 10.0


def process_synthetic_epochs(
    estimator: RelativeEstimator, *, is_in_orbit: bool = True
) -> RelativeSolution:
    """Process synthetic epochs with an estimator, and return its last solution.

    Parameters
    ----------
    estimator : RelativeEstimator
        An estimator that is used for nothing else.
    is_in_orbit : bool
        Whether the receivers fly; on the ground otherwise.
    """
    ephemerides = nominal_gps_constellation(_START, _START + _EPOCHS * _INTERVAL)
    for ephemeris in ephemerides:
        estimator.add_ephemeris(ephemeris)
    table = EphemerisStore(ephemerides).table(_START)
    speed = np.sqrt(GM_EARTH / _RADIUS)
    orbit = state_itrf_to_gcrf(_START, [_RADIUS, 0.0, 0.0, 0.0, 0.7 * speed, 0.7 * speed])
    for since in _INTERVAL * np.arange(_EPOCHS):
        time, chief = _START + float(since), _AT_REST
        if is_in_orbit:
            chief = state_gcrf_to_itrf(time, predict_state(orbit, float(since)))
        deputy = chief + np.array([0.0, _DISTANCE, 0.0, 0.0, 0.0, 0.0])
        estimator.add_thrust(time, 1.0, [0.0, 1e-6, 0.0])
        if isinstance(estimator, EstimatorInputs):
            attitude = BodyAttitude(time, _IDENTITY, np.zeros(3), 1e-6 * np.eye(3))
            estimator.add_attitude(attitude, is_of_chief=False)
            estimator.add_attitude(attitude, is_of_chief=True)
        observed = [ideal_observations(table, time, state) for state in (chief, deputy)]
        solution = estimator.process(time, observed[0], observed[1])
    return solution

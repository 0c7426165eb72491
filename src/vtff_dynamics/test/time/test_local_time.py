"""Local time of a longitude."""

import math

import numpy as np
import pytest
from dynamics_scenarios import EPOCH
from hypothesis import strategies as st

from vtff_dynamics.time.local_time import mean_solar_local_time_hours

STATE = np.array([4.2e6, -3.1e6, 4.5e6, 3.9e3, 6.1e3, 0.7e3])
component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).map(np.array)
seconds = st.integers(-(10**8), 10**8)


def test_local_time():
    # 00:59:43 UTC; 75 W is five hours earlier.
    utc = (59 + 43 / 60) / 60
    assert mean_solar_local_time_hours(EPOCH, 0.0) == pytest.approx(utc)
    assert mean_solar_local_time_hours(EPOCH, math.radians(-75)) == pytest.approx(utc + 19)

"""A chief that falls straight down has no axes in which a target could be held."""

import numpy as np
import pytest

from vtff_control.tracking.feedforward import target_acceleration, velocity_at_rest
from vtff_dynamics.constants import J2_EARTH


def test_a_chief_that_falls_has_no_plane():
    falling = np.array([7.0e6, 0.0, 0.0, -100.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="orbital plane"):
        velocity_at_rest(falling, np.ones(3), J2_EARTH)
    with pytest.raises(ValueError, match="orbital plane"):
        target_acceleration(falling, np.ones(6), 1, 1.0, J2_EARTH)

"""Chiefs and settings that the tests of the safety monitor share."""

import numpy as np

from vtff_control.safety.formation_safety import SafetySetting, SpacecraftInput
from vtff_control.safety.prediction import predict_chief_motion
from vtff_dynamics.orbit.elements import ClassicalElements

CHIEF = ClassicalElements(6928137.0, 0.001, 1.0, 0.0, 0.0, 0.0).to_state()
SETTING = SafetySetting(hard_radius=30.0, acceleration_cap=1.4)
COVARIANCE = np.diag([0.01**2] * 3 + [1e-4**2] * 3)


def relative(r=0.0, t=0.0, n=0.0, vr=0.0, vt=0.0, vn=0.0):
    return np.array([r, t, n, vr, vt, vn])


def predict_formation(states, covariances=None, orbits=1.0):
    """Return the free motion of deputies about the chief."""
    chief = predict_chief_motion(CHIEF, orbits)
    covariances = covariances or [COVARIANCE] * len(states)
    names = ("chief", *(f"deputy{index}" for index in range(len(states))))
    return chief.formation(names, states, covariances)


def heard(state, command=(0.0, 0.0, 0.0), reported=(0.0, 0.0, 0.0), chief=CHIEF):
    return SpacecraftInput(
        state,
        COVARIANCE,
        chief,
        np.array(reported, dtype=float),
        None if command is None else np.array(command, dtype=float),
    )

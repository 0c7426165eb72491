"""Nonlinear J2 motion by an integrator and equations that the library does not use."""

import math

import numpy as np
from scipy.integrate import solve_ivp

GM = 3.986004415e14
RADIUS = 6378136.3
J2 = 0.000484169548456 * math.sqrt(5.0)


def potential_gradient(positions):
    """Return the gradient of mu/r - J2 mu R^2 P2(sin latitude)/r^3 at positions (n, 3)."""
    r = np.linalg.norm(positions, axis=1, keepdims=True)
    z = positions[:, 2:]
    # U2 = -J2 mu R^2 (3 z^2 - r^2) / (2 r^5), differentiated term by term.
    strength = -0.5 * J2 * GM * RADIUS**2
    gradient = strength * (-2.0 * positions / r**5 - 5.0 * (3.0 * z**2 - r**2) * positions / r**7)
    gradient[:, 2:] += strength * 6.0 * z / r**5
    return -GM * positions / r**3 + gradient


def fly(states, times, thrust=None):
    """Return states (n, m, 6) at times of spacecraft that start with states (m, 6)."""
    states = np.asarray(states, dtype=float)

    def rate(time, flat):
        state = flat.reshape(-1, 6)
        acceleration = potential_gradient(state[:, :3])
        if thrust is not None:
            acceleration = acceleration + thrust(time, state)
        return np.hstack((state[:, 3:], acceleration)).ravel()

    solution = solve_ivp(
        rate,
        (times[0], times[-1]),
        states.ravel(),
        method="DOP853",
        rtol=1e-12,
        atol=1e-7,
        t_eval=times,
    )
    return solution.y.T.reshape(len(times), -1, 6)

"""Fixed-step orbit propagation of one spacecraft with thrust held over each step.

``integrator="euler"`` exists because paper 000 stepped its orbits so with SimGEN; it is not the
default because at 1 s it raises the semi-major axis of that orbit by 40 km in 2028 s.
"""

from __future__ import annotations

from typing import Any

import brahe
import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth_environment import brahe_constants
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray, is_finite

__all__ = ["INTEGRATORS", "ForceModel", "Propagator"]

INTEGRATORS = ("rk4", "euler")
"""Accepted integrators: classical Runge-Kutta of order 4, and explicit Euler."""


class Propagator:
    """Orbit of one spacecraft, advanced in equal steps.

    One object lives as long as its orbit: the time is counted in integer nanoseconds, so that it
    never drifts, and the thrust may differ at every step.

    Parameters
    ----------
    time : GpsTime
        Time of the initial state.
    state_gcrf : array_like, shape (6,)
        Position and velocity in GCRF, m and m/s.
    force_model : ForceModel, optional
        Forces; JGM-3 8x8 by default.
    integrator : str
        ``rk4`` or ``euler`` (explicit: ``r += v dt; v += a(r) dt`` from the old state).
    step : float
        Length of a step, s; a whole number of nanoseconds.

    Raises
    ------
    ValueError
        If the state is not six finite numbers, the step not positive or the integrator unknown.
    """

    def __init__(
        self,
        time: GpsTime,
        state_gcrf: npt.ArrayLike,
        force_model: ForceModel | None = None,
        integrator: str = "rk4",
        step: float = 1.0,
    ) -> None:
        if integrator not in INTEGRATORS:
            raise ValueError(f"integrator {integrator!r}: must be one of {', '.join(INTEGRATORS)}")
        if not 0.0 < step < float("inf"):
            raise ValueError(f"step {step}: must be positive and finite, in seconds")
        state: FloatArray = np.array(state_gcrf, dtype=float)
        if state.shape != (6,) or not is_finite(state):
            raise ValueError("state_gcrf: must be six finite numbers, position and velocity")
        if not any(state[:3].tolist()):
            raise ValueError("state_gcrf: the position is the centre of the Earth")
        self._step_nanoseconds = round(step * NANOSECONDS_PER_SECOND)
        if (
            self._step_nanoseconds < 1
            or abs(self._step_nanoseconds / NANOSECONDS_PER_SECOND - step) > 1e-12 * step
        ):
            raise ValueError(f"step {step}: must be a whole number of nanoseconds")
        self._step = self._step_nanoseconds / NANOSECONDS_PER_SECOND
        self._nanoseconds = time.nanoseconds
        self._state_gcrf: FloatArray = state
        self._force_model = force_model if force_model is not None else ForceModel()
        self._force_model.prepare_environment()
        self._integrator = integrator
        # Added to the derivative of the state by brahe in every stage of a step.
        self._thrust_derivative = np.zeros(6)
        self._takes_thrust = False
        self._brahe: Any = None

    @property
    def time(self) -> GpsTime:
        """Time of the current state."""
        return GpsTime(self._nanoseconds)

    @property
    def state_gcrf(self) -> FloatArray:
        """Current position and velocity in GCRF, m and m/s, shape (6,); a copy."""
        return np.array(self._state_gcrf)

    @property
    def force_model(self) -> ForceModel:
        """Forces of this propagator."""
        return self._force_model

    @property
    def integrator(self) -> str:
        """Name of the integrator."""
        return self._integrator

    @property
    def step(self) -> float:
        """Length of a step, s."""
        return self._step

    def advance(self, acceleration_gcrf: npt.ArrayLike | None = None) -> FloatArray:
        """Advance by one step and return the new state.

        Parameters
        ----------
        acceleration_gcrf : array_like, shape (3,), optional
            Acceleration by thrust, constant in GCRF over this step, m/s2. None is zero.

        Returns
        -------
        ndarray, shape (6,)
            Position and velocity in GCRF at the end of the step, m and m/s.

        Raises
        ------
        ValueError
            If the acceleration is not three finite numbers; nothing has then changed.
        """
        if acceleration_gcrf is None:
            self._thrust_derivative[3:] = 0.0
        else:
            thrust = np.asarray(acceleration_gcrf, dtype=float)
            if thrust.shape != (3,) or not is_finite(thrust):
                raise ValueError("acceleration_gcrf: must be three finite numbers")
            self._thrust_derivative[3:] = thrust
        if self._integrator == "rk4":
            self._step_rk4()
        else:
            self._step_euler()
        self._nanoseconds += self._step_nanoseconds
        return np.array(self._state_gcrf)

    def acceleration_gcrf(self) -> FloatArray:
        """Return the acceleration by the force model at the current state, m/s2, shape (3,).

        Thrust is not included: the caller knows what it is going to apply. Only tests call this
        method; a simulation asks the force model.
        """
        return self._force_model.acceleration(self.time, self._state_gcrf)

    def jerk_gcrf(self) -> FloatArray:
        """Return the jerk by gravity at the current state, m/s3, shape (3,).

        Only tests call this method; a simulation computes `gravity_jerks` of many states at once.
        """
        return self._force_model.jerk(self._state_gcrf)

    def _new_brahe_propagator(self) -> Any:
        """Return a brahe propagator that continues from the current time and state."""
        # A fixed-step integrator configuration alone is ignored: the orbit propagator takes its
        # step from initial_step, and 60 s where that is absent.
        configuration = brahe.NumericalPropagationConfig(
            brahe_constants.IntegrationMethod.RK4,
            brahe.IntegratorConfig.fixed_step(self._step),
            brahe.VariationalConfig(),
        ).with_initial_step(self._step)
        thrust_derivative = self._thrust_derivative
        propagator = brahe.NumericalOrbitPropagator(
            self.time.to_brahe_epoch(),
            self._state_gcrf,
            configuration,
            self._force_model.to_brahe(),
            control_input=(
                (lambda _seconds, _state, _parameters: thrust_derivative)
                if self._takes_thrust
                else None
            ),
        )
        propagator.set_trajectory_mode(brahe_constants.TrajectoryMode.DISABLED)
        return propagator

    def _step_rk4(self) -> None:
        """Advance the state by one Runge-Kutta step."""
        if not self._takes_thrust and any(self._thrust_derivative.tolist()):
            # The control callback costs a quarter of a step: free flight goes without it.
            self._takes_thrust = True
            self._brahe = None
        if self._brahe is None:
            self._brahe = self._new_brahe_propagator()
        self._brahe.step()
        self._state_gcrf = self._brahe.current_state()

    def _step_euler(self) -> None:
        """Advance the state by one explicit Euler step."""
        derivative = self._thrust_derivative.copy()
        derivative[:3] = self._state_gcrf[3:]
        derivative[3:] += self._force_model.acceleration(self.time, self._state_gcrf)
        self._state_gcrf = self._state_gcrf + self._step * derivative

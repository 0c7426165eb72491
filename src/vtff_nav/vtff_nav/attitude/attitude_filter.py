"""Attitude, rate and dipole from a magnetometer alone: a multiplicative filter.

The field turns along the orbit, so one vector observes the attitude in time, and the torque of the
dipole on the field makes the dipole observable through the rate. Bias of the magnetometer, inertia,
a torque that lasts, the error of the field model and the offsets of thrusters that miss the centre
of mass can be estimated besides; none of them is by default, and then the filter has rotation, rate
and dipole, the drift of the dipole and the error of the wheel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from vtff_dynamics.attitude.quaternion import (
    check_quaternion,
    conjugate,
    multiply,
    rotation_matrix,
    rotation_vector,
)
from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import FloatArray
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.field_error import FieldErrorModel
from vtff_nav.attitude.kernels import (
    BIAS,
    DIPOLE,
    DRIFT,
    FIELD,
    INERTIA,
    OFFSETS,
    RATE,
    ROTATION,
    TORQUE,
    WHEEL,
    predict_attitude,
    update_by_field,
)

__all__ = ["AttitudeEstimate", "AttitudeFilter", "FilterPeriod"]

_TWIN = 1e-9
"""Difference (rad, rad/s, A m2) that is rounding; parts that are not estimated have no sigma."""


@dataclass(frozen=True)
class FilterPeriod:
    """What is known of a period of the ADCS.

    Attributes
    ----------
    duration
        s.
    field_start_gcrf, field_end_gcrf
        Field of the model at its start and end, T, shape (3,).
    position_gcrf
        Position in its middle, m, shape (3,).
    wheel_start, wheel_end
        Momentum of the wheel, N m s.
    pulses
        On-times of the torquers from its start, s, with the sign of the moment, shape (3,).
    thruster_forces
        Forces of thrusters along the axes of the body in equal parts of the period, N, shape
        (parts, 3).
    """

    duration: float
    field_start_gcrf: FloatArray
    field_end_gcrf: FloatArray
    position_gcrf: FloatArray
    wheel_start: float
    wheel_end: float
    pulses: FloatArray
    thruster_forces: FloatArray = field(default_factory=lambda: np.zeros((1, 3)))


@dataclass(frozen=True)
class AttitudeEstimate:
    """What the filter knows.

    Attributes
    ----------
    quaternion_gcrf
        Body to GCRF, x, y, z, w, shape (4,).
    rate_body
        rad/s, shape (3,).
    dipole
        Residual moment, A m2, shape (3,).
    magnetometer_bias
        T, shape (3,); zero if not estimated.
    inertia_correction
        Share of each principal moment, shape (3,); zero if not estimated.
    field_error_gcrf
        True less model field, T, shape (3,); zero if not estimated.
    covariance
        Covariance of the error state of `vtff_nav.attitude.kernels`, which begins with rotation
        (rad, body axes), rate and dipole, shape (22, 22), or (190, 190) with an error of the field,
        and six more with offsets of thrusters; zero where not estimated.
    thruster_offsets
        Offsets of the lines of force from the centre of mass, m: row i those of the force along
        axis i, along the next two axes, shape (3, 2); zero if not estimated.
    """

    quaternion_gcrf: FloatArray
    rate_body: FloatArray
    dipole: FloatArray
    magnetometer_bias: FloatArray
    inertia_correction: FloatArray
    field_error_gcrf: FloatArray
    covariance: FloatArray
    thruster_offsets: FloatArray

    @property
    def rotation_gcrf_from_body(self) -> FloatArray:
        """Rotation matrix with ``vector_gcrf = R @ vector_body``, shape (3, 3)."""
        matrix: FloatArray = rotation_matrix(self.quaternion_gcrf)
        return matrix

    @property
    def rotation_sigma(self) -> float:
        """Root of the largest variance of the attitude about any axis, rad."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:3, :3])[-1])))

    @property
    def dipole_sigma(self) -> FloatArray:
        """Sigma of each axis of the dipole, A m2, shape (3,)."""
        sigma: FloatArray = np.sqrt(np.diag(self.covariance)[DIPOLE : DIPOLE + 3])
        return sigma


class AttitudeFilter:
    """The filter; `start`, then `predict` and `update` in turn.

    Its `correction` is the small rotation (rad, body axes) by which samples have turned the
    attitude since the last prediction; zero without one that was used.

    Parameters
    ----------
    body : BodyModel
    configuration : AttitudeFilterConfiguration
    quaternion_gcrf : array_like, shape (4,)
        First attitude.
    rate_body : array_like, shape (3,)
        First rate, rad/s.
    rotation_covariance : array_like, shape (3, 3), optional
        Covariance of the first attitude, rad2, body axes; default: the configuration's sigma.
    """

    def __init__(
        self,
        body: BodyModel,
        configuration: AttitudeFilterConfiguration,
        quaternion_gcrf: npt.ArrayLike,
        rate_body: npt.ArrayLike = (0.0, 0.0, 0.0),
        rotation_covariance: npt.ArrayLike | None = None,
    ) -> None:
        self._body = body
        self._configuration = configuration
        self._inertia = body.inertia_matrix
        self._wheel_axis = np.asarray(body.wheel_axis, dtype=float)
        self._coupling = np.ascontiguousarray(body.torquer_coupling, dtype=float)
        self._noise = configuration.noise()
        self._quaternion = check_quaternion("quaternion_gcrf", quaternion_gcrf)
        self._field_error: FieldErrorModel | None = None
        variances = np.zeros(0)
        if configuration.field_sigma > 0.0:
            self._field_error = FieldErrorModel(configuration.field_sigma)
            variances = self._field_error.variances
        offsets = OFFSETS if configuration.thruster_offset_sigma > 0.0 else 0
        self._field_end = FIELD + len(variances)
        states = self._field_end + offsets
        self._mean = np.zeros(states - RATE)
        self._mean[:3] = check_vector("rate_body", rate_body, 3, "rad/s")
        self._mean[3:6] = np.asarray(configuration.initial_dipole, dtype=float)
        sigma = np.zeros(states)
        sigma[ROTATION:RATE] = math.radians(configuration.initial_rotation_sigma_deg)
        sigma[RATE:DIPOLE] = configuration.initial_rate_sigma
        if configuration.estimates_dipole:
            sigma[DIPOLE:BIAS] = configuration.initial_dipole_sigma
            sigma[DRIFT:WHEEL] = configuration.dipole_drift_sigma
        sigma[BIAS:INERTIA] = configuration.bias_sigma
        sigma[INERTIA:DRIFT] = configuration.inertia_sigma
        sigma[TORQUE:FIELD] = configuration.torque_sigma
        sigma[FIELD : self._field_end] = np.sqrt(variances)
        sigma[self._field_end :] = configuration.thruster_offset_sigma
        self._covariance = np.diag(sigma**2)
        self._field_variances = variances
        self._field_partial = np.zeros((3, len(variances)))
        self._elapsed = 0.0
        if rotation_covariance is not None:
            self._covariance[:3, :3] = np.asarray(rotation_covariance, dtype=float)
        self._innovation = np.zeros(3)
        self.normalised_innovation_squared = math.nan
        self.log_likelihood = 0.0
        self.correction = np.zeros(3)

    def predict(self, period: FilterPeriod) -> None:
        """Predict to the end of a period."""
        rate = math.sqrt(float(self._mean[:3] @ self._mean[:3]))
        longest = min(self._configuration.longest_step, 0.3 / max(rate, 1e-9))
        if self._field_error is not None:
            middle = self._elapsed + 0.5 * period.duration
            self._field_partial = self._field_error.partial(period.position_gcrf, middle)
        self._elapsed += period.duration
        self.correction = np.zeros(3)
        predict_attitude(
            self._quaternion,
            self._mean,
            self._covariance,
            period.duration,
            max(1, min(200, math.ceil(period.duration / longest - 1e-9))),
            period.field_start_gcrf,
            period.field_end_gcrf,
            period.position_gcrf,
            period.wheel_start,
            period.wheel_end,
            self._wheel_axis,
            self._inertia,
            period.pulses,
            self._body.torquer_moment,
            self._coupling,
            self._noise,
            self._field_partial,
            self._field_variances,
            np.ascontiguousarray(period.thruster_forces, dtype=float),
        )

    def exchange_momentum(self, momentum: float) -> None:
        """Give the wheel a momentum, N m s, that the filter had believed in the body.

        The sum of both stays. The samples have shown a part of it already, if it came slowly: all
        of it is doubted.
        """
        change = -momentum * np.linalg.solve(self._inertia, self._wheel_axis)
        self._mean[:3] += change
        self._covariance[RATE:DIPOLE, RATE:DIPOLE] += np.outer(change, change)

    def update(
        self, measured_body: FloatArray, field_gcrf: FloatArray, gate: float = math.inf
    ) -> bool:
        """Update by a sample of the magnetometer, T, and the field of the model there, T.

        A normalised innovation squared (3 numbers) above `gate`, or that of the configuration, is
        that of a sample which is not used.

        Returns
        -------
        bool
            False if the sample was outside the gate and not used.
        """
        predicted = self._quaternion.copy()
        gate = min(gate, self._configuration.gate)
        square, likelihood = update_by_field(
            self._quaternion,
            self._mean,
            self._covariance,
            measured_body,
            field_gcrf,
            self._configuration.magnetometer_sigma,
            gate,
            self._field_partial,
            self._innovation,
        )
        self.normalised_innovation_squared = float(square)
        used = bool(square <= gate)
        if used:
            self.log_likelihood += float(likelihood)
            self.correction = rotation_vector(multiply(conjugate(predicted), self._quaternion))
        return used

    @property
    def quaternion_gcrf(self) -> FloatArray:
        """Body to GCRF, shape (4,)."""
        return np.array(self._quaternion)

    def is_twin_of(self, other: AttitudeFilter) -> bool:
        """Return whether another filter is within the sigma of every error.

        Both say then the same of attitude, rate and dipole.
        """
        small = rotation_vector(multiply(conjugate(other._quaternion), self._quaternion))
        difference = np.concatenate((small, self._mean[:6] - other._mean[:6]))
        sigma = np.sqrt(np.maximum(np.diag(other._covariance)[:BIAS], 1e-30))
        return bool((np.abs(difference) <= sigma + _TWIN).all())

    @property
    def estimate(self) -> AttitudeEstimate:
        """What the filter knows now; copies."""
        mean = self._mean.copy()
        return AttitudeEstimate(
            self._quaternion.copy(),
            mean[:3],
            mean[3:6],
            mean[6:9],
            mean[9:12],
            self._field_partial @ mean[FIELD - RATE : self._field_end - RATE],
            self._covariance.copy(),
            self._thruster_offsets(mean),
        )

    def _thruster_offsets(self, mean: FloatArray) -> FloatArray:
        offsets = mean[self._field_end - RATE :]
        return offsets.reshape(3, 2) if len(offsets) else np.zeros((3, 2))

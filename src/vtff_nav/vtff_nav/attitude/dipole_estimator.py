"""The paper's estimator of rate and dipole, 6 states (Steyn and Hashida 2001, equations 8 to 12).

It takes rates that an attitude filter found and the measured field, and gives the residual dipole;
the attitude filter then takes the dipole, and so on until it no longer moves (`iterate_dipole`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vtff_dynamics.vectors import FloatArray
from vtff_nav.attitude.attitude_filter import AttitudeFilter, FilterPeriod
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.kernels import predict_rate_and_dipole

__all__ = [
    "DipoleEstimator",
    "DipoleEstimatorConfiguration",
    "DipoleIteration",
    "estimate_rates",
    "iterate_dipole",
]


@dataclass(frozen=True)
class DipoleEstimatorConfiguration:
    """Noise of the paper's estimator.

    Parameters
    ----------
    rate_sigma : float
        Sigma of the rates that it is given, rad/s.
    magnetometer_sigma : float
        T.
    torque_noise : float
        N m sqrt(s). The paper's model has no gravity gradient: 1e-8 N m for a quarter of an orbit.
    dipole_walk : float
        A m2/sqrt(s).
    initial_rate_sigma, initial_dipole_sigma : float
        rad/s, A m2.
    longest_step : float
        s.
    """

    rate_sigma: float = 5e-4
    magnetometer_sigma: float = 60e-9
    torque_noise: float = 3e-7
    dipole_walk: float = 0.0
    initial_rate_sigma: float = 0.02
    initial_dipole_sigma: float = 0.2
    longest_step: float = 1.0


class DipoleEstimator:
    """Extended Kalman filter of rate (3) and dipole (3) on measured rates."""

    def __init__(
        self, body: BodyModel, configuration: DipoleEstimatorConfiguration | None = None
    ) -> None:
        self._configuration = configuration or DipoleEstimatorConfiguration()
        settings = self._configuration
        self._body = body
        self._inertia = body.inertia_matrix
        self._inverse = np.linalg.inv(self._inertia)
        self._wheel_axis = np.asarray(body.wheel_axis, dtype=float)
        self._coupling = np.ascontiguousarray(body.torquer_coupling, dtype=float)
        self._mean = np.zeros(6)
        self._covariance = np.diag(
            [settings.initial_rate_sigma**2] * 3 + [settings.initial_dipole_sigma**2] * 3
        )
        self._noise = np.array(
            [settings.torque_noise, settings.dipole_walk, settings.magnetometer_sigma]
        )

    @property
    def rate_body(self) -> FloatArray:
        """Rate, rad/s, shape (3,)."""
        return np.array(self._mean[:3])

    @property
    def dipole(self) -> FloatArray:
        """Dipole, A m2, shape (3,)."""
        return np.array(self._mean[3:])

    @property
    def covariance(self) -> FloatArray:
        """Covariance of rate and dipole, shape (6, 6)."""
        return np.array(self._covariance)

    def predict(
        self, period: FilterPeriod, field_start_body: FloatArray, field_end_body: FloatArray
    ) -> None:
        """Predict over a period with the field measured at its start and end, T, body axes."""
        steps = max(1, round(period.duration / self._configuration.longest_step))
        predict_rate_and_dipole(
            self._mean,
            self._covariance,
            period.duration,
            steps,
            field_start_body,
            field_end_body,
            period.wheel_start,
            period.wheel_end,
            self._wheel_axis,
            self._inertia,
            self._inverse,
            period.pulses,
            self._body.torquer_moment,
            self._coupling,
            self._noise,
        )

    def update(self, rate_body: FloatArray) -> None:
        """Update by a rate, rad/s, shape (3,)."""
        scatter = self._covariance[:3, :3] + self._configuration.rate_sigma**2 * np.eye(3)
        gain = np.linalg.solve(scatter, self._covariance[:3, :]).T
        self._mean = self._mean + gain @ (rate_body - self._mean[:3])
        kept = np.eye(6)
        kept[:, :3] -= gain
        self._covariance = (
            kept @ self._covariance @ kept.T + self._configuration.rate_sigma**2 * gain @ gain.T
        )


def estimate_rates(
    body: BodyModel,
    configuration: AttitudeFilterConfiguration,
    start: AttitudeFilter,
    periods: Sequence[FilterPeriod],
    measured_body: Sequence[FloatArray],
) -> FloatArray:
    """Return the rates that an attitude filter finds, rad/s, one row for each period.

    Parameters
    ----------
    start : AttitudeFilter
        Its attitude and rate are those at the start of the first period.
    measured_body : sequence of ndarray
        Sample of the magnetometer at the end of each period, T.
    """
    first = start.estimate
    running = AttitudeFilter(body, configuration, first.quaternion_gcrf, first.rate_body)
    rates = np.empty((len(periods), 3))
    for number, (period, sample) in enumerate(zip(periods, measured_body, strict=True)):
        running.predict(period)
        running.update(sample, period.field_end_gcrf)
        rates[number] = running.estimate.rate_body
    return rates


@dataclass(frozen=True)
class DipoleIteration:
    """One round of `iterate_dipole`: dipole, A m2, shape (3,), and its covariance (3, 3)."""

    dipole: FloatArray
    covariance: FloatArray


def iterate_dipole(
    body: BodyModel,
    attitude: AttitudeFilterConfiguration,
    start: AttitudeFilter,
    periods: Sequence[FilterPeriod],
    measured_body: Sequence[FloatArray],
    rounds: int = 8,
    tolerance: float = 5e-4,
    configuration: DipoleEstimatorConfiguration | None = None,
) -> list[DipoleIteration]:
    """Find the dipole in a log as the paper did: rates, dipole, rates with that dipole, ...

    Parameters
    ----------
    attitude : AttitudeFilterConfiguration
        Configuration of the filter that finds the rates; it takes the dipole of the round before.
    measured_body : sequence of ndarray
        Sample at the start of the first period and at the end of each, T.
    tolerance : float
        A m2; the rounds end when no axis moves by more.

    Returns
    -------
    list of DipoleIteration
        One for each round.
    """
    found: list[DipoleIteration] = []
    dipole = np.zeros(3)
    for _ in range(rounds):
        settings = replace(attitude, estimates_dipole=False, initial_dipole=dipole)
        rates = estimate_rates(body, settings, start, periods, measured_body[1:])
        estimator = DipoleEstimator(body, configuration)
        for number, period in enumerate(periods):
            estimator.predict(period, measured_body[number], measured_body[number + 1])
            estimator.update(rates[number])
        found.append(DipoleIteration(estimator.dipole, estimator.covariance[3:, 3:]))
        if np.abs(estimator.dipole - dipole).max() < tolerance:
            break
        dipole = estimator.dipole
    return found

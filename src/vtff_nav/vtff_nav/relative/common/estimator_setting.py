"""Parameters that the node `relative_ekf` gives a relative navigation filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vtff_dynamics.orbit.force_model import ForceModel
from vtff_nav.relative.common.antenna_correction import UNCALIBRATED, AntennaPair
from vtff_nav.relative.common.dynamics import Dynamics
from vtff_nav.relative.common.measurements import MeasurementNoise

__all__ = ["EstimatorSetting"]


@dataclass(frozen=True)
class EstimatorSetting:
    """Parameters of `relative_ekf` that concern the filter; a filter uses what it needs.

    Parameters
    ----------
    force_model : ForceModel or None
        Forces of the motion model; None for the filter's own choice.
    measurement_noise : MeasurementNoise
        Noise of each receiver.
    bands : mapping of int to tuple of int, or None
        RINEX frequency digits that are used, by system; None for the filter's own choice.
    elevation_mask_deg : float
        Lowest elevation that is used.
    longest_prediction : float
        Time without measurements after which navigation starts anew, s.
    dynamics : {"orbital", "kinematic", "static"}
        Motion of the deputy.
    integrator : str
        How the motion is stepped, one of `vtff_dynamics.orbit.propagator.INTEGRATORS`.
    longest_step : float
        Longest step of integration, s.
    empirical_acceleration_sigma : float
        Unmodelled relative acceleration along the track, m/s2: the drag of the two differs.
    empirical_across_sigma : float
        The same on the radial and on the normal axis, m/s2: a fifth of the solar radiation on a
        satellite of 0.01 m2/kg (6e-8 m/s2, Montenbruck and Gill 2000, section 3.4).
    empirical_gradient_sigma : float
        What is added to it for each metre of separation, 1/s2.
    thrust_sigma : float
        White error of the thrust as a part of its magnitude.
    thrust_scale_sigma, thrust_misalignment_sigma_deg : float
        A priori sigmas of scale and misalignment of the thrust.
    thrust_follows_attitude : bool
        Whether the deputy's thrusters are fixed in its body, so that the error of its estimated
        attitude turns the thrust; `antennas` then says that the attitude is estimated.
    slow_phase_sigma, slow_code_sigma, slow_error_time : float
        Slow errors of a receiver, m, and their correlation time, s, before they are estimated.
    plasma_gradient_sigma : float
        Horizontal gradient of the vertical TEC above the spacecraft, TECU/deg.
    success_rate : float
        Success rate that integers must have.
    antennas : AntennaPair or None
        Where the antennas are; None: in the centres of mass, and ideal. By default they are in the
        centres of mass, and nobody has calibrated them.
    """

    force_model: ForceModel | None = None
    measurement_noise: MeasurementNoise = MeasurementNoise()
    bands: Mapping[int, tuple[int, ...]] | None = None
    elevation_mask_deg: float = 5.0
    longest_prediction: float = 600.0
    dynamics: Dynamics = "orbital"
    integrator: str = "rk4"
    longest_step: float = 5.0
    empirical_acceleration_sigma: float = 5e-8
    empirical_across_sigma: float = 1e-8
    empirical_gradient_sigma: float = 2e-11
    thrust_sigma: float = 0.01
    thrust_scale_sigma: float = 0.05
    thrust_misalignment_sigma_deg: float = 2.0
    thrust_follows_attitude: bool = False
    slow_phase_sigma: float = 0.003
    slow_code_sigma: float = 0.3
    slow_error_time: float = 100.0
    plasma_gradient_sigma: float = 2.0
    success_rate: float = 0.999
    antennas: AntennaPair | None = AntennaPair(UNCALIBRATED, UNCALIBRATED)

"""The estimator cdgps as a plug-in of ``vtff.estimators``."""

from __future__ import annotations

from typing import Any

from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.dynamics import MotionNoise
from vtff_nav.relative.common.estimator_setting import EstimatorSetting

__all__ = ["common_options", "make_cdgps"]


def make_cdgps(setting: EstimatorSetting) -> CdgpsEstimator:
    """Return the filter of code and phase of all signals, with integers.

    Raises
    ------
    ValueError
        If a value is not possible; the text names it.
    """
    configuration = CdgpsConfiguration(
        dynamics=setting.dynamics,
        integrator=setting.integrator,
        longest_step=setting.longest_step,
        noise_relative=MotionNoise(
            setting.empirical_acceleration_sigma,
            gradient_sigma=setting.empirical_gradient_sigma,
            across_sigma=setting.empirical_across_sigma,
        ),
        thrust_relative_sigma=setting.thrust_sigma,
        thrust_scale_sigma=setting.thrust_scale_sigma,
        thrust_misalignment_sigma_deg=setting.thrust_misalignment_sigma_deg,
        thrust_follows_attitude=setting.thrust_follows_attitude,
        slow_phase_sigma=setting.slow_phase_sigma,
        slow_code_sigma=setting.slow_code_sigma,
        slow_error_time=setting.slow_error_time,
        plasma_gradient_sigma_tecu_per_deg=setting.plasma_gradient_sigma,
        success_rate=setting.success_rate,
        antennas=setting.antennas,
        **common_options(setting),
    )
    return CdgpsEstimator(configuration)


def common_options(setting: EstimatorSetting) -> dict[str, Any]:
    """Return the options of the configurations of both shipped estimators."""
    common: dict[str, Any] = {
        "measurement_noise": setting.measurement_noise,
        "elevation_mask_deg": setting.elevation_mask_deg,
        "longest_prediction": setting.longest_prediction,
    }
    if setting.force_model is not None:
        common["force_model"] = setting.force_model
    if setting.bands is not None:
        common["bands"] = dict(setting.bands)
    return common

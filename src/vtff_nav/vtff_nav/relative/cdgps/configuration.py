"""Parameters of the carrier-phase differential filter: process noise, elevation mask, bands.

The process noise is of type `vtff_nav.relative.common.dynamics.MotionNoise`; the parameters of
`relative_ekf` for it begin with ``empirical_``. The elevation mask here is that of relative
navigation; `ionosphere_processor` has its own. Defaults that every filter of `relative_ekf` has
stand in `vtff_nav.relative.common.estimator_setting`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from vtff_dynamics.orbit.force_model import ForceModel
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_nav.relative.common.antenna_correction import AntennaPair, check_frequencies
from vtff_nav.relative.common.dynamics import DYNAMICS, Dynamics, MotionNoise
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.measurements import DEFAULT_BANDS, MeasurementNoise

__all__ = ["CdgpsConfiguration"]


@dataclass(frozen=True)
class CdgpsConfiguration:
    """Parameters of `vtff_nav.relative.cdgps.estimator.CdgpsEstimator`.

    Parameters
    ----------
    dynamics : str
        ``orbital``: both spacecraft in orbit; ``kinematic``: the deputy moves freely on or near
        the ground; ``static``: it does not move.
    dynamics_chief : str or None
        Motion of the chief where the deputy is not in orbit; ``static`` by default.
    position_chief_itrf : tuple of 3 float or None
        Surveyed position of the antenna of a static chief, m.
    force_model, force_model_deputy : ForceModel
        Forces on the chief, and on the deputy if they differ. The default is that of real gravity,
        truncated where its gradient over 10 km is below the other unknown accelerations.
    integrator : str
        ``euler`` where the motion is simulated with explicit Euler steps, which no force explains.
    longest_step : float
        Longest step of integration, s; with ``euler`` the step of the simulation.
    noise_chief, noise_relative : MotionNoise
        Process noise of the chief's motion and of the relative motion, which is then adapted to
        the estimates. That of the chief must cover the forces that the model leaves out or has in
        excess: harmonics of the degrees 9 to 30 are some 2e-5 m/s2 in low orbit and change in 100
        to 600 s (an error of 5 mm/s in the chief's velocity turns its RTN frame by 0.6 mm at 1 km).
        Where both orbits are estimated together, it is at first only what the model leaves out of
        a real orbit (`vtff_dynamics.orbit.omitted_forces`): 0.03 mm/s are 1 mm at 225 km. When it
        was found to be so, that of the difference is what gravity beyond the model makes of it.
    thrust_relative_sigma : float
        White error of the thrust on each axis, relative to its magnitude.
    thrust_scale_sigma, thrust_misalignment_sigma_deg : float
        A priori sigmas of the scale of the thrust and, on each RTN axis, of its misalignment, both
        of which are estimated.
    thrust_follows_attitude : bool
        Whether the error of the deputy's estimated attitude turns its thrust, because the thrusters
        are fixed in its body.
    measurement_noise : MeasurementNoise
        Noise of each receiver.
    bands : mapping of int to tuple of int
        RINEX frequency digits used of each system.
    elevation_mask_deg : float
        Satellites lower above the horizontal plane are not used.
    ephemeris_sigma : float
        Error of broadcast orbit and clock in a range, m, as satellites state it (URA); where ranges
        show much smaller errors, these are believed.
    ephemeris_time : float
        Correlation time of that error, s.
    ephemeris_phase_sigma : float
        White error of the phases of the chief's orbit, m, for slow errors that they may have; where
        both orbits are estimated together, not more than the slow errors that were found.
    code_bias_sigma : float
        Ionosphere-free biases of the codes of satellites that no message tells, m: the part of the
        range errors that does not change.
    estimate_plasma : bool or None
        Estimate the plasma between and above the two altitudes; None: in orbit only.
    electron_density_sigma, electron_density_time : float
        Steady-state sigma (electrons/m3) and correlation time (s) of the density of each layer.
        Where both orbits are estimated together, it is longer if the gradients are small.
    layer_content_sigma_tecu : float
        Largest sigma of the vertical content of a layer, TECU. The sigma of the density of a thick
        layer is reduced to it.
    plasma_shell_sigma_tecu, plasma_gradient_sigma_tecu_per_deg : float
        A priori sigma of the vertical content of each shell (TECU), and steady-state sigma of its
        gradients to north and to east (TECU/deg), which is adapted to the gradients that are
        found.
    plasma_gradient_time : float
        Correlation time of these gradients, s: that in which low orbits cross some 2000 km.
    plasma_quiet_gradient_tecu_per_deg : float
        Sigma of these gradients that is believed where the measurements tell nothing of them.
    plasma_shell_heights : tuple of float
        Heights above the chief of the shells whose content has gradients, m; together they stand
        for content at any height between them.
    plasma_wave_sigma_tecu, plasma_wave_length, plasma_wave_time : float
        Waves of the vertical content above low orbits: a priori sigma (TECU), which is adapted to
        what is found, length (m) over its angle of a turn, and correlation time (s) of the content
        that a ray meets. The ground sees 0.08 to 1.5 TECU peak to peak by day (Oluwadare and others
        2022, doi:10.1007/s00024-022-03028-6), of which a tenth is above; waves are some 300 km long
        (Hernandez-Pajares, Juan and Sanz 2006, J. Geophys. Res. 111, A07S11), and an orbit crosses
        those of 100 to 1000 km in 13 to 130 s.
    plasma_layers : tuple of float
        Thicknesses above the chief of the layers of constant density whose sum stands for the
        profile, m.
    slow_phase_sigma, slow_code_sigma, slow_error_time : float
        Sigmas at one receiver (m) and correlation time (s) of slowly changing errors, such as
        multipath, that are assumed until the measurements have told their own.
    slow_error_memory : float
        Time over which they are estimated, s.
    receiver_bias_walk : float
        Random walk of the differences of receiver biases between signals, m/sqrt(s).
    troposphere : bool or None
        Model the troposphere (receivers below 20 km); None: unless in orbit.
    troposphere_distance_sigma, troposphere_height_sigma, troposphere_time : float
        Sigma of the difference of the zenith delays of both receivers that the model leaves, as
        parts of their distance and of their difference in height (root of the sum of squares), and
        its correlation time, s. It is estimated.
    success_rate : float
        Smallest bootstrapped success rate with which integers are accepted.
    failure_rate : float
        Failure rate of the ratio test: 0.001 or 0.01.
    smallest_ratio : float
        Smallest ratio of second to best squared norm with which integers are accepted.
    fault_sigmas : float
        A measurement with a larger normalised innovation is a fault.
    global_probability : float
        The filter starts anew when innovations of consecutive epochs are less likely than this.
    longest_prediction : float
        Time without measurements after which the solution is given up, s.
    antennas : AntennaPair or None
        Where the antennas of chief and deputy are; None: in the centres of mass.
    attitude_time : float
        Correlation time of errors of estimated attitudes, s.
    laser_latency_sigma : float
        A priori sigma of the latency of the laser, s.
    """

    dynamics: Dynamics = "orbital"
    dynamics_chief: Dynamics | None = None
    position_chief_itrf: tuple[float, float, float] | None = None
    force_model: ForceModel = field(default_factory=lambda: ForceModel(degree=50, order=50))
    force_model_deputy: ForceModel | None = None
    integrator: str = EstimatorSetting.integrator
    longest_step: float = EstimatorSetting.longest_step
    noise_chief: MotionNoise = MotionNoise(empirical_sigma=2e-5, empirical_time=200.0)
    noise_relative: MotionNoise = MotionNoise(
        empirical_sigma=EstimatorSetting.empirical_acceleration_sigma,
        gradient_sigma=EstimatorSetting.empirical_gradient_sigma,
        across_sigma=EstimatorSetting.empirical_across_sigma,
    )
    thrust_relative_sigma: float = EstimatorSetting.thrust_sigma
    thrust_scale_sigma: float = EstimatorSetting.thrust_scale_sigma
    thrust_misalignment_sigma_deg: float = EstimatorSetting.thrust_misalignment_sigma_deg
    thrust_follows_attitude: bool = EstimatorSetting.thrust_follows_attitude
    measurement_noise: MeasurementNoise = MeasurementNoise()
    bands: Mapping[int, tuple[int, ...]] = field(default_factory=lambda: dict(DEFAULT_BANDS))
    elevation_mask_deg: float = EstimatorSetting.elevation_mask_deg
    ephemeris_sigma: float = 2.0
    ephemeris_time: float = 21600.0
    code_bias_sigma: float = 0.3
    ephemeris_phase_sigma: float = 0.005
    estimate_plasma: bool | None = None
    electron_density_sigma: float = 1e12
    electron_density_time: float = 1200.0
    layer_content_sigma_tecu: float = 15.0
    plasma_shell_sigma_tecu: float = 0.5
    plasma_gradient_sigma_tecu_per_deg: float = EstimatorSetting.plasma_gradient_sigma
    plasma_gradient_time: float = 300.0
    plasma_quiet_gradient_tecu_per_deg: float = 0.03
    plasma_shell_heights: tuple[float, ...] = (100e3, 300e3)
    plasma_wave_sigma_tecu: float = 0.012
    plasma_wave_length: float = 50e3
    plasma_wave_time: float = 30.0
    plasma_layers: tuple[float, ...] = (40e3, 100e3, 250e3, 600e3)
    slow_phase_sigma: float = EstimatorSetting.slow_phase_sigma
    slow_code_sigma: float = EstimatorSetting.slow_code_sigma
    slow_error_time: float = EstimatorSetting.slow_error_time
    slow_error_memory: float = 3600.0
    receiver_bias_walk: float = 1e-6
    troposphere: bool | None = None
    troposphere_distance_sigma: float = 1e-6
    troposphere_height_sigma: float = 5e-5
    troposphere_time: float = 3600.0
    success_rate: float = EstimatorSetting.success_rate
    failure_rate: float = 0.001
    smallest_ratio: float = 2.0
    fault_sigmas: float = 5.0
    global_probability: float = 1e-9
    longest_prediction: float = EstimatorSetting.longest_prediction
    antennas: AntennaPair | None = None
    attitude_time: float = 600.0
    laser_latency_sigma: float = 0.02

    def __post_init__(self) -> None:
        """Check the parameters."""
        if self.dynamics not in DYNAMICS:
            raise ValueError(f"dynamics {self.dynamics!r}: one of {', '.join(DYNAMICS)} expected")
        chief = self.dynamics_chief
        if chief is not None and (chief == "orbital") != (self.dynamics == "orbital"):
            raise ValueError("dynamics_chief: orbital if, and only if, dynamics is orbital")
        if not 0.5 < self.success_rate < 1.0:
            raise ValueError("success_rate: between 0.5 and 1 expected")
        if not self.fault_sigmas > 3.0:
            raise ValueError("fault_sigmas: more than 3 expected")
        if not self.longest_prediction >= 0.0:
            raise ValueError("longest_prediction: 0 s or more expected")
        if self.antennas is not None:
            for antenna in self.antennas.both:
                check_frequencies(antenna, self.bands)

    @property
    def chief_motion(self) -> Dynamics:
        """Motion of the chief."""
        if self.dynamics_chief is not None:
            return self.dynamics_chief
        return "orbital" if self.dynamics == "orbital" else "static"

    @property
    def has_troposphere(self) -> bool:
        """Whether the troposphere is modelled."""
        return self.dynamics != "orbital" if self.troposphere is None else self.troposphere

    @property
    def layer_sigmas(self) -> tuple[float, ...]:
        """Steady-state sigma of the density of each layer, electrons per m3."""
        content = self.layer_content_sigma_tecu * ELECTRONS_PER_TECU
        return tuple(
            min(self.electron_density_sigma, content / thickness)
            for thickness in self.plasma_layers
        )

    @property
    def thrust_sigmas(self) -> tuple[float, ...]:
        """A priori sigmas of the scale (1) and of the misalignment (rad) of the thrust."""
        misalignment = math.radians(self.thrust_misalignment_sigma_deg)
        return (self.thrust_scale_sigma, misalignment, misalignment, misalignment)

    @property
    def has_plasma(self) -> bool:
        """Whether the plasma is estimated."""
        if self.estimate_plasma is None:
            return self.dynamics == "orbital"
        return self.estimate_plasma

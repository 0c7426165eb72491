"""Parameters of the filter of the testbed paper: process noise, elevation mask, weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from vtff_dynamics.orbit.force_model import ForceModel
from vtff_gnss import constants as c
from vtff_nav.relative.common.measurements import MeasurementNoise

__all__ = ["PaperConfiguration"]


@dataclass(frozen=True)
class PaperConfiguration:
    """Parameters of `vtff_nav.relative.paper.estimator.PaperEstimator`.

    Parameters
    ----------
    force_model : ForceModel
        Forces on both spacecraft.
    bands : mapping of int to tuple of int
        RINEX frequency digits of the phases used, for each system; the paper uses GPS L1.
    measurement_noise : MeasurementNoise
        Noise where the receivers state no sigmas; otherwise R comes from their sigmas.
    elevation_mask_deg : float
        Satellites lower above the local horizon of either spacecraft are not used.
    start_duration : float
        Time over which code differences are averaged before the filter starts, s.
    acceleration_noise : float
        Root of the spectral density of the white relative acceleration in Q, m/s2/sqrt(Hz).
    clock_noise, clock_rate_noise : float
        Roots of the spectral densities of the noise of the clock difference, m/sqrt(s), and of its
        rate, m/s/sqrt(s), for two TCXO.
    velocity_sigma : float
        Sigma of each axis of the first velocity, m/s.
    clock_sigma : float
        Sigma of the clock difference after the start or a jump, m, and of its first rate, m/s.
    longest_prediction : float
        Time without measurements after which the filter starts anew, s.
    """

    force_model: ForceModel = field(default_factory=ForceModel)
    bands: Mapping[int, tuple[int, ...]] = field(default_factory=lambda: {c.SYSTEM_GPS: (1,)})
    measurement_noise: MeasurementNoise = MeasurementNoise()
    elevation_mask_deg: float = 5.0
    start_duration: float = 60.0
    acceleration_noise: float = 1e-5
    clock_noise: float = 0.3
    clock_rate_noise: float = 0.5
    velocity_sigma: float = 0.02
    clock_sigma: float = 1.0
    longest_prediction: float = 600.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("start_duration", "acceleration_noise", "velocity_sigma", "clock_sigma"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: more than 0 expected, got {getattr(self, name)}")
        if not any(self.bands.values()):
            raise ValueError("bands: at least one signal expected")

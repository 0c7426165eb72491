"""Options of a baseline, completed by what is usual on the ground and in orbit."""

from __future__ import annotations

from vtff_analysis.baseline.processing import BaselineOptions
from vtff_analysis.baseline.sources import BaselineError, BaselineSources, Position
from vtff_dynamics.time.timescales import GpsTime
from vtff_nav.relative.common.measurements import MeasurementNoise

__all__ = ["complete_options"]

_ORBITAL_MASK_DEG, _GROUND_MASK_DEG = 5.0, 10.0
_GROUND_CODE_SIGMA, _GROUND_PHASE_SIGMA = 1.0, 0.003
"""m; they include the multipath of a simple antenna."""
_GROUND_ELEVATION_NOISE_RATIO = 1.0
"""Near the ground low satellites have more multipath."""


def complete_options(
    sources: BaselineSources,
    dynamics: str | None,
    estimator: str,
    bands: dict[int, tuple[int, ...]],
    elevation_mask_deg: float | None = None,
    base_position: Position | None = None,
    estimate_base: bool = False,
    sigmas: tuple[float | None, float | None] = (None, None),
    troposphere: bool | None = None,
    start: GpsTime | None = None,
    end: GpsTime | None = None,
) -> BaselineOptions:
    """Return options with defaults, where None is given, for ground or orbit.

    Parameters are those of `BaselineOptions`; `sigmas` are those of code and phase in m, and
    `estimate_base` leaves the position in the file of the base unused.

    Raises
    ------
    BaselineError
        If a position is given that shall be estimated.
    """
    if estimate_base and base_position is not None:
        raise BaselineError("--base-position and --estimate-base contradict each other")
    # Only a bag has no position of the base: its receivers are taken for spacecraft.
    is_in_orbit = sources.is_in_orbit is not False
    if dynamics is None:
        dynamics = "orbital" if is_in_orbit else "kinematic"
    is_orbital = dynamics == "orbital"
    if base_position is None and sources.is_position_stated and not (estimate_base or is_orbital):
        base_position = sources.position_base_itrf
    if elevation_mask_deg is None:
        elevation_mask_deg = _ORBITAL_MASK_DEG if is_orbital else _GROUND_MASK_DEG
    noise = _measurement_noise(is_orbital, *sigmas)
    return BaselineOptions(
        dynamics=dynamics,  # type: ignore[arg-type]
        estimator=estimator,
        bands=bands,
        elevation_mask_deg=elevation_mask_deg,
        position_base_itrf=base_position,
        noise=noise,
        troposphere=not is_orbital if troposphere is None else troposphere,
        start=start,
        end=end,
    )


def _measurement_noise(
    is_orbital: bool, code_sigma: float | None, phase_sigma: float | None
) -> MeasurementNoise:
    """Return the noise of each receiver.

    Receivers state their thermal noise (codes of 0.05 m in the logs of the OEMV), which near
    the ground is a small part of the multipath.
    """
    usual = MeasurementNoise()
    if is_orbital and code_sigma is None and phase_sigma is None:
        return usual
    usual_code, usual_phase = (
        (usual.code_sigma, usual.phase_sigma)
        if is_orbital
        else (_GROUND_CODE_SIGMA, _GROUND_PHASE_SIGMA)
    )
    return MeasurementNoise(
        code_sigma=code_sigma or usual_code,
        phase_sigma=phase_sigma or usual_phase,
        use_receiver_sigmas=False,
        elevation_noise_ratio=0.0 if is_orbital else _GROUND_ELEVATION_NOISE_RATIO,
    )

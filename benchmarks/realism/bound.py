"""The covariance bound for the geometry of a recorded flight."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from vtff_analysis.studies.navigation_bound import PhaseNoise, PhaseSky, motion_covariances
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import SignalKey, carrier_frequency_hz, satellite_number
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.model import DENSITY_UNIT, plasma_paths
from vtff_nav.relative.cdgps.output import relative_rtn
from vtff_nav.relative.common.dynamics import (
    MotionNoise,
    empirical_noise,
    transition_matrix,
)
from vtff_nav.relative.common.measurements import compute_geometry, satellite_numbers

from .recording import Recording
from .worlds import FIRST_SECOND

__all__ = ["bound_rms"]

# Forces are known, and so is the reported thrust; what is left is far below that of real orbits.
_MOTION = MotionNoise(empirical_sigma=1e-8)
_DISTANCE = 2.2e7  # m, of satellites
_BROADCAST_TIME = 21600.0  # s
_CODE_SIGMA = 0.3  # m, of a code; integers of the chief's phases are not known


def bound_rms(
    recording: Recording,
    noise: PhaseNoise,
    interval: int,
    broadcast_sigma: float = 0.0,
) -> float:
    """Return the RMS of the smallest 3-D sigma of position from `FIRST_SECOND` on, m.

    The integers, the forces and the noise of the phases are known; the density of the layers of
    plasma is not, with the sigmas that `relative_ekf` takes.

    Errors of broadcast orbits (each axis) and clocks, of a sigma in m, act twice: in the difference
    of ranges, and in the orbit of the chief, which turns its RTN frame.
    """
    plasma = CdgpsConfiguration()
    # One sigma for all layers: the paths are scaled by it.
    scale = np.array(plasma.layer_sigmas) / DENSITY_UNIT
    used = recording[::interval]
    epochs = list(_epochs(used, recording, interval, plasma.plasma_layers, scale))
    options = (float(interval), _MOTION.empirical_sigma, 1.0, plasma.electron_density_time)
    if broadcast_sigma == 0.0:
        relative = motion_covariances(epochs, noise, *options)
        variances = np.trace(relative[:, :3, :3], axis1=1, axis2=2)
    else:
        separation = used[0].state_deputy_gcrf[:3] - used[0].state_chief_gcrf[:3]
        # The error of a satellite across the ray turns it; both receivers have half the variance.
        turn = broadcast_sigma / _DISTANCE * float(np.linalg.norm(separation))
        slow = PhaseNoise(noise.white_sigma, turn / math.sqrt(2.0), _BROADCAST_TIME)
        by_satellite = [(_by_satellite(sky), phi, added) for sky, phi, added in epochs]
        relative = motion_covariances(by_satellite, slow, *options)
        ranges = PhaseNoise(_CODE_SIGMA / math.sqrt(2.0), broadcast_sigma, _BROADCAST_TIME)
        chief = motion_covariances(
            [(_without_plasma(sky), phi, added) for sky, phi, added in by_satellite],
            ranges,
            *options,
        )
        variances = np.array(
            [
                np.trace(
                    relative_rtn(
                        second.state_chief_gcrf,
                        second.state_deputy_gcrf - second.state_chief_gcrf,
                        covariance_chief,
                        covariance,
                    )[1][:3, :3]
                )
                for second, covariance_chief, covariance in zip(used, chief, relative, strict=True)
            ]
        )
    return float(np.sqrt(np.mean(variances[FIRST_SECOND // interval :])))


def _without_plasma(sky: PhaseSky) -> PhaseSky:
    """Return a sky without further parameters, which free combinations of carriers do not have."""
    return dataclasses.replace(sky, nuisance=np.zeros((len(sky.signals), 0)))


def _by_satellite(sky: PhaseSky) -> PhaseSky:
    """Return a sky whose slow errors are those of satellites."""
    satellites = [key.satellite for key in sky.signals if isinstance(key, SignalKey)]
    return dataclasses.replace(sky, signals=satellites)


def _epochs(
    used: Recording,
    recording: Recording,
    interval: int,
    layers: tuple[float, ...],
    scale: FloatArray,
) -> Iterator[tuple[PhaseSky, FloatArray, FloatArray]]:
    """Yield the sky of each epoch, and the transition to it."""
    ephemerides = [ephemeris for second in recording for ephemeris in second.ephemerides]
    store = EphemerisStore(dict.fromkeys(ephemerides))
    for second in used:
        chief_gcrf = second.state_chief_gcrf
        states_itrf = np.array(
            [
                state_gcrf_to_itrf(second.time, state)
                for state in (chief_gcrf, second.state_deputy_gcrf)
            ]
        )
        to_itrf = rotation_gcrf_to_itrf(second.time)
        table = store.table(second.time)
        seen = compute_geometry(table, second.time, np.zeros(2), states_itrf, to_itrf)
        known = set(satellite_numbers(table).tolist())
        keys = sorted(k for k in second.cycles if int(satellite_number(*k.satellite)) in known)
        system, prn, band = np.array(keys, dtype=np.int64).reshape(-1, 4)[:, :3].T
        columns = seen.columns(satellite_number(system, prn))
        heights = geodetic_from_itrf(states_itrf[:, :3])[:, 2]
        paths = plasma_paths(
            float(np.linalg.norm(chief_gcrf[:3])),
            float(heights[1] - heights[0]),
            seen.elevation[:, columns],
            layers,
        )
        frequency = carrier_frequency_hz(system, band)
        delay = IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU / frequency**2
        sky = PhaseSky(
            keys,
            [key.group for key in keys],
            seen.direction[1, columns],
            -delay[:, None] * paths * scale,
        )
        to_gcrf = rotation_gcrf_to_rtn(chief_gcrf).T
        step = float(interval)
        transition = transition_matrix(chief_gcrf[:3], to_gcrf, step, _MOTION.empirical_time)
        yield sky, transition, empirical_noise(_MOTION, to_gcrf, step)

"""The covariance bound for the geometry of a recorded flight."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vtff_analysis.studies.navigation_bound import PhaseNoise, PhaseSky, position_sigmas
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import carrier_frequency_hz, satellite_number
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.model import DENSITY_UNIT, plasma_paths
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


def bound_rms(recording: Recording, noise: PhaseNoise, interval: int) -> float:
    """Return the RMS of the smallest 3-D sigma of position from `FIRST_SECOND` on, m.

    The integers, the forces and the noise of the phases are known; the density of the layers of
    plasma is not, with the sigmas that `relative_ekf` takes.
    """
    plasma = CdgpsConfiguration()
    # One sigma for all layers: the paths are scaled by it.
    scale = np.array(plasma.layer_sigmas) / DENSITY_UNIT
    sigmas = position_sigmas(
        _epochs(recording[::interval], interval, plasma.plasma_layers, scale),
        noise,
        float(interval),
        _MOTION.empirical_sigma,
        nuisance_time=plasma.electron_density_time,
    )
    return float(np.sqrt(np.mean(sigmas[FIRST_SECOND // interval :] ** 2)))


def _epochs(
    recording: Recording, interval: int, layers: tuple[float, ...], scale: FloatArray
) -> Iterator[tuple[PhaseSky, FloatArray, FloatArray]]:
    """Yield the sky of each epoch, and the transition to it."""
    ephemerides = [ephemeris for second in recording for ephemeris in second.ephemerides]
    store = EphemerisStore(dict.fromkeys(ephemerides))
    for second in recording:
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

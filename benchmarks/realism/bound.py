"""The covariance bound for the geometry of a recorded flight."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vtff_analysis.studies.navigation_bound import PhaseNoise, PhaseSky, motion_covariances
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf, state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.omitted_forces import omitted_gravity, other_forces
from vtff_dynamics.vectors import FloatArray, norm
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import SignalKey, carrier_frequency_hz, satellite_number
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.output import relative_rtn
from vtff_nav.relative.common.dynamics import AccelerationNoise, MotionNoise
from vtff_nav.relative.common.measurements import compute_geometry, satellite_numbers
from vtff_nav.relative.kernels.motion import empirical_noise, transition_matrix
from vtff_nav.relative.kernels.sky import DENSITY_UNIT, plasma_paths, shell_paths

from .recording import Recording
from .worlds import FIRST_SECOND, RangeErrors

__all__ = ["bound_rms"]

# Forces are known, and so is the reported thrust; what is left is far below that of real orbits.
_FORCES_SIGMA = 1e-8  # m/s2
_OTHER_FORCES_TIME = 900.0  # s
_DISTANCE = 2.2e7  # m, of satellites
_CONSTANT = 1e12  # s: correlation time of what does not change in a flight


@dataclass(frozen=True, eq=False)
class _Epoch:
    """Phases of both receivers, and those of the chief, with the motion to their epoch.

    The motion is transition matrix and process noise, of the difference and of the chief.
    """

    sky: PhaseSky
    sky_of_chief: PhaseSky
    motion: tuple[FloatArray, FloatArray]
    motion_of_chief: tuple[FloatArray, FloatArray]


def bound_rms(
    recording: Recording,
    noise: PhaseNoise,
    interval: int,
    ranges: RangeErrors | None = None,
    gradient_tecu_per_deg: float = 0.0,
    omitted_degree: int | None = None,
) -> float:
    """Return the RMS of the smallest 3-D sigma of position from `FIRST_SECOND` on, m.

    The integers of the differences, the forces (but for gravity beyond `omitted_degree` and, with
    it, Moon, Sun, radiation and drag) and all sigmas are known; the density of the layers of plasma
    is not, with the sigmas that `relative_ekf` takes. Errors of the chief's orbit turn its RTN
    frame. They come from its ionosphere-free codes and phases, which have the mean noise of both
    receivers (the integers make the deputy's ranges as good as further ones of the chief).
    Broadcast errors also act in the difference of ranges. Both motions are taken for themselves:
    that an error of the chief turns the rays changes the sum by 1 % at 225 km.

    Parameters
    ----------
    recording : Recording
    noise : PhaseNoise
        Noise of the phases of a receiver.
    interval : int
        Between the epochs that are used, s.
    ranges : RangeErrors
        What the chief's ranges have besides.
    gradient_tecu_per_deg : float
        Sigma of unknown horizontal gradients of the plasma.
    omitted_degree : int, optional
        Degree up to which gravity is known, in a world with all forces.
    """
    ranges = ranges or RangeErrors()
    plasma = CdgpsConfiguration()
    used = recording[::interval]
    distance = norm(used[0].state_deputy_gcrf[:3] - used[0].state_chief_gcrf[:3])
    motions = _unknown_motions(omitted_degree, norm(used[0].state_chief_gcrf[:3]), distance)
    epochs = list(
        _epochs(used, recording, interval, plasma, noise, ranges, gradient_tecu_per_deg, motions)
    )
    sigma, sigma_of_chief = (motion.sigma.item(0) for motion in motions)
    density_time = plasma.electron_density_time
    if ranges.broadcast_sigma > 0.0:
        # The error of a satellite across the ray turns it; both receivers have half the variance.
        turn = ranges.broadcast_sigma / _DISTANCE * distance
        slow = PhaseNoise(noise.white_sigma, turn / math.sqrt(2.0), ranges.broadcast_time)
        skies = [_by_satellite(epoch.sky) for epoch in epochs]
    else:
        slow, skies = noise, [epoch.sky for epoch in epochs]
    relative = motion_covariances(
        ((sky, *epoch.motion) for sky, epoch in zip(skies, epochs, strict=True)),
        slow,
        float(interval),
        sigma,
        nuisance_time=density_time,
    )
    # Orbit error along the ray and clock error, and the biases of the codes.
    range_sigma = math.hypot(ranges.broadcast_sigma, ranges.signal_bias_sigma / math.sqrt(2.0))
    time = ranges.broadcast_time if ranges.broadcast_sigma > 0.0 else _CONSTANT
    chief = motion_covariances(
        ((epoch.sky_of_chief, *epoch.motion_of_chief) for epoch in epochs),
        PhaseNoise(noise.white_sigma, range_sigma, time),
        float(interval),
        sigma_of_chief,
    )
    variances = [
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
    return float(np.sqrt(np.mean(variances[FIRST_SECOND // interval :])))


def _unknown_motions(
    omitted_degree: int | None, radius: float, distance: float
) -> tuple[AccelerationNoise, AccelerationNoise]:
    """Return the accelerations that nobody knows, of the difference and of the chief."""
    if omitted_degree is None:
        known = MotionNoise(_FORCES_SIGMA).at_distance(0.0)
        return known, known
    gravity = omitted_gravity(omitted_degree, radius)
    of_difference = MotionNoise(
        _FORCES_SIGMA, gradient_sigma=gravity.gradient_sigma, gradient_time=gravity.gradient_time
    ).at_distance(distance)
    sigma, others = gravity.acceleration_sigma, other_forces(radius)
    rate = sigma**2 / gravity.acceleration_time + others**2 / _OTHER_FORCES_TIME
    variance = sigma**2 + others**2
    return of_difference, MotionNoise(math.sqrt(variance), variance / rate).at_distance(0.0)


def _by_satellite(sky: PhaseSky) -> PhaseSky:
    """Return a sky whose slow errors are those of satellites."""
    satellites = [key.satellite for key in sky.signals if isinstance(key, SignalKey)]
    return dataclasses.replace(sky, signals=satellites)


def _sky_of_chief(
    keys: list[SignalKey], directions: FloatArray, phase_sigma: float, code_sigma: float
) -> PhaseSky:
    """Return the ionosphere-free codes and phases of the satellites with two carriers and more.

    The phases have free ambiguities. Errors of a satellite are the same in both.
    """
    rows: dict[tuple[int, int], list[int]] = {}
    for row, key in enumerate(keys):
        rows.setdefault(key.satellite, []).append(row)
    rows = {satellite: members for satellite, members in rows.items() if len(members) > 1}
    # The sigma of the best combination without ionosphere, for carriers that are equally good.
    factors = []
    for members in rows.values():
        carriers = np.array([carrier_frequency_hz(keys[r].system, keys[r].band) for r in members])
        delay = (carriers[0] / carriers) ** 2
        spread = float(np.sum((delay - delay.mean()) ** 2))
        factors.append(math.sqrt(1.0 / len(members) + delay.mean() ** 2 / spread))
    satellites, first = list(rows), [members[0] for members in rows.values()]
    return PhaseSky(
        satellites * 2,
        ["code"] * len(satellites) + [("phase", satellite) for satellite in satellites],
        np.tile(directions[first], (2, 1)),
        np.zeros((2 * len(satellites), 0)),
        # Both receivers' ranges count: `motion_covariances` doubles the variances.
        0.5 * np.outer((code_sigma, phase_sigma), factors).ravel(),
    )


def _epochs(
    used: Recording,
    recording: Recording,
    interval: int,
    plasma: CdgpsConfiguration,
    noise: PhaseNoise,
    ranges: RangeErrors,
    gradient: float,
    motions: tuple[AccelerationNoise, AccelerationNoise],
) -> Iterator[_Epoch]:
    """Yield the sky of each epoch, and the motion to it."""
    # One sigma for all layers: the paths are scaled by it.
    scale = np.array(plasma.layer_sigmas) / DENSITY_UNIT
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
        paths = scale * plasma_paths(
            float(np.linalg.norm(chief_gcrf[:3])),
            float(heights[1] - heights[0]),
            seen.elevation[:, columns],
            np.array(plasma.plasma_layers),
        )
        if gradient > 0.0:
            shells = shell_paths(
                np.array([chief_gcrf[:3], second.state_deputy_gcrf[:3]]),
                seen.direction[:, columns],
                np.array(plasma.plasma_shell_heights[:1]),
            )
            sigmas = np.array([plasma.plasma_shell_sigma_tecu, gradient, gradient])
            paths = np.hstack((paths, shells * sigmas))
        frequency = carrier_frequency_hz(system, band)
        delay = IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU / frequency**2
        directions = seen.direction[1, columns]
        sky = PhaseSky(keys, [key.group for key in keys], directions, -delay[:, None] * paths)
        sky_of_chief = _sky_of_chief(keys, directions, noise.white_sigma, ranges.code_sigma)
        to_gcrf = rotation_gcrf_to_rtn(chief_gcrf).T
        step = float(interval)
        of_difference, of_chief = (
            (
                transition_matrix(chief_gcrf[:3], to_gcrf, step, forces.time),
                empirical_noise(forces.sigma, forces.time, to_gcrf, step),
            )
            for forces in motions
        )
        yield _Epoch(sky, sky_of_chief, of_difference, of_chief)

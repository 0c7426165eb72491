"""SNAP-1 row by row: what paper 003 and its table ask for, over drawn seeds, without ROS.

`bench_attitude.py` has the rows that need many drawn flights. Each case prints one line for each
flight and what is asked.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from bench_attitude import FIELD_SIGMA, BelievedFieldError, fly_cases
from scipy.special import chdtri

from vtff_analysis.attitude.loop import AttitudeHistory, AttitudeLoop, LoopConfiguration
from vtff_analysis.attitude.snap1 import (
    DIPOLE_FINAL,
    ORBITAL_PERIOD,
    ThreeAxisResult,
    fly_autonomous,
    fly_compass,
    fly_detumble,
    fly_kick,
    fly_three_axis,
    snap1_track,
)
from vtff_control.attitude.controller import MODES, AttitudeControlConfiguration
from vtff_dynamics.attitude.magnetic_field import DrawnFieldError, FieldError
from vtff_dynamics.attitude.orbit_axes import (
    orbit_rate,
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.attitude.quaternion import from_rotation_vector, multiply, rotation_matrix
from vtff_dynamics.attitude.rigid_body import AttitudeState
from vtff_dynamics.attitude.spacecraft import SpacecraftBody
from vtff_dynamics.time.timescales import parse_epoch
from vtff_dynamics.vectors import FloatArray, norm
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration

_WHEEL_RPM = -2700.0
_OUTSIDE = float(chdtri(3.0, 1e-3))
"""Chi squared of three numbers that an honest error exceeds once in a thousand."""
_OF_REFERENCE_ATTITUDE = (
    parse_epoch("2016-03-21T01:00:00 GPS"),
    np.array([6928137.0, 0.0, 0.0, 0.0, 3792.5442661521847, 6568.879358929605]),
)
_MANY_SOURCES = 1000


def compass(seeds: range) -> None:
    """Fly compass mode for a day: oscillations in an orbit, direction by averaging."""
    print("compass: rpm, seed, oscillations an orbit (9.5 to 11), direction off, deg (3)")
    for wheel_rpm in (0.0, -1000.0):
        for seed in seeds:
            flown = fly_compass(wheel_rpm, seed=seed)
            print(
                wheel_rpm, seed, round(flown.oscillations_per_orbit, 1),
                round(flown.direction_error_deg, 1), flush=True,
            )  # fmt: skip


def from_37_degrees(seeds: range) -> None:
    """Start the nine states 37 deg off: until it stays below 5 deg, the last of two orbits.

    The spacecraft points with wheel and torquers; the dipole is not known.
    """
    print(
        "from 37 deg: error of the field (nT), seed, s until below 5 deg for good (450), RMS of "
        "the last orbit, deg (0.2; 0.9), largest error of the dipole in it, mA m2 (1), NEES of it"
    )
    for sigma in (0.0, FIELD_SIGMA):
        for seed in seeds:
            track = snap1_track(sigma, seed)
            axis = np.random.default_rng((seed, 37)).standard_normal(3)
            off = math.radians(37.0) * axis / norm(axis)
            loop = _pointing_loop(
                track, seed, DIPOLE_FINAL, AttitudeFilterConfiguration(field_sigma=sigma)
            )
            state = loop.spacecraft.state
            loop.estimator.expect(
                multiply(state.quaternion_gcrf, from_rotation_vector(off)), state.rate_body
            )
            history = loop.fly(round(2.0 * ORBITAL_PERIOD / track.period))
            late = history.time > history.time[-1] - ORBITAL_PERIOD
            above = np.nonzero(~(history.attitude_error_deg < 5.0))[0]
            print(
                round(1e9 * sigma), seed, 5.0 * (above[-1] + 2.0),
                round(_rms(history.attitude_error_deg[late]), 2),
                round(1e3 * float(np.abs(history.dipole_error[late]).max()), 2),
                [round(float(history.normalised_error_squared(first, 3)[late].mean()), 2)
                 for first in (0, 3, 6)],
                flush=True,
            )  # fmt: skip


def three_axis(seeds: range) -> None:
    """Point for 14 h with compensation (6), (14) and none, as the paper did."""
    print("three axes: compensation, seed, 1 sigma of roll, pitch, yaw, deg; wheel, rpm")
    for name in ("first", "final", "none"):
        for seed in seeds:
            _print_pointing(name, seed, fly_three_axis(name, 14.0, seed=seed))


def closed(seeds: range) -> None:
    """Point for 8 h with estimate and compensation on board, without and with a field error."""
    print("closed on board: error of the field (nT), seed, roll, pitch, yaw, deg; wheel, rpm")
    for sigma in (0.0, FIELD_SIGMA):
        for seed in seeds:
            _print_pointing(round(1e9 * sigma), seed, fly_three_axis("estimated", 8.0, sigma, seed))


def autonomous(seeds: range) -> None:
    """Fly from the tumble of the launch to pointing, 16 h; the last four orbits count."""
    print("from tumble to pointing: seed, roll, pitch, yaw, deg; wheel, rpm; modes")
    for seed in seeds:
        flown = fly_autonomous(16.0, FIELD_SIGMA, seed)
        _print_pointing("autonomous", seed, flown)
        modes = {MODES[int(mode)] for mode in flown.history.mode}
        print("  modes:", [mode for mode in MODES if mode in modes], flush=True)


def pitch_step(seeds: range) -> None:
    """Command 10 and -20 deg of pitch, against the same flight without: noise cancels."""
    print("pitch step: deg, seed, s until within 2 % (102 to 138), overshoot, %")
    for step_deg in (10.0, -20.0):
        for seed in seeds:
            flown = []
            for reference_deg in (0.0, step_deg):
                loop = _pointing_loop(snap1_track(), seed, DIPOLE_FINAL)
                loop.fly(300)
                loop.controller.pitch_reference = math.radians(reference_deg)
                flown.append(loop.fly(60).angles_deg[:, 1])
            response = (flown[1] - flown[0]) / step_deg
            outside = np.nonzero(np.abs(response - 1.0) > 0.02)[0]
            print(
                step_deg, seed, 5.0 * (outside[-1] + 2), round(100.0 * (response.max() - 1.0), 1),
                flush=True,
            )  # fmt: skip


def damped_kick(seeds: range) -> None:
    """Fire in compass mode over the equator: what is left an orbit later."""
    print("kick, damped: seed, peak, deg; left after an orbit, deg")
    for seed in seeds:
        flown = fly_kick(strengths=(1.0,), seed=seed)
        print(seed, flown.peak_deg.round(1), round(flown.after_an_orbit_deg, 1), flush=True)


def detumble(seeds: range) -> None:
    """Detumble from 5 rpm within a day, to the reference of the Y-Thomson spin."""
    print("detumble: seed, h until x and z are below 0.01 rad/s, mean rates of the last orbit")
    for seed in seeds:
        flown = fly_detumble(seed=seed)
        _print_torquers(flown.history)
        print(seed, round(flown.settled_after / 3600.0, 2), flown.final_rate.round(4), flush=True)


def launch(seeds: range) -> None:
    """Fly five hours from the tumble of the launch: is what may steer within its covariance."""
    print(
        "launch tumble: seed, samples that may steer, from, h; largest error, deg; NEES; outside "
        "of 99.9 % of the covariance; new starts"
    )
    rows = []
    for seed in seeds:
        history = fly_autonomous(5.0, FIELD_SIGMA, seed).history
        valid = history.valid > 0.0
        squares = history.normalised_error_squared(0, 3)[valid]
        rows.append([squares.mean(), (3.0 * squares > _OUTSIDE).mean()])
        print(
            seed, int(valid.sum()), round(float(history.time[valid][0]) / 3600.0, 2),
            round(float(history.attitude_error_deg[valid].max()), 2),
            round(float(rows[-1][0]), 2), int((3.0 * squares > _OUTSIDE).sum()),
            int(history.restarts[-1]), flush=True,
        )  # fmt: skip
    mean, outside = np.mean(rows, axis=0)
    print(f"{len(rows)} flights: mean NEES {mean:.2f}, outside {outside:.4f}")


def turning(seeds: range) -> None:
    """Fly 2800 s of the deputy of `reference_attitude`, without receivers and thrust.

    Fields: none (no error), believed (drawn from what the filter believes), smooth (the spectrum
    of the emulated error, Gaussian at every place), emulated (that of the graph, for its seed).
    """
    print("turning: field, mean NEES of flights, its scatter, largest flight and piece of 200 s")
    epoch, state = _OF_REFERENCE_ATTITUDE
    radius = norm(state[:3])
    worlds: dict[str, Callable[[int], FieldError | None]] = {
        "none": lambda _: None,
        "believed": lambda seed: BelievedFieldError(FIELD_SIGMA, seed),
        "smooth": lambda seed: DrawnFieldError(FIELD_SIGMA, seed, radius, _MANY_SOURCES),
        "emulated": lambda seed: DrawnFieldError(FIELD_SIGMA, _seed_of_graph(seed), radius),
    }
    configuration = AttitudeFilterConfiguration(
        field_sigma=FIELD_SIGMA, initial_rotation_sigma_deg=1.0, initial_rate_sigma=2e-4
    )
    for name, field_error in worlds.items():
        pieces, outside, strengths = [], [], []
        for seed in seeds:
            track = OrbitTrack(epoch, state, field_error=field_error(seed))
            loop = _pointing_loop(track, seed, DIPOLE_FINAL, configuration)
            normal = np.random.default_rng((seed, 1)).standard_normal(3)
            truth = loop.spacecraft.state
            off = from_rotation_vector(math.radians(1.0) * normal)
            loop.estimator.expect(multiply(truth.quaternion_gcrf, off), truth.rate_body)
            squares = loop.fly(560).normalised_error_squared(0, 3)[40:]
            pieces.append(squares.reshape(13, 40).mean(axis=1))
            outside.append((3.0 * squares > _OUTSIDE).mean())
            strengths.append(
                _rms([track.true_field_gcrf(row) - track.field_gcrf(row) for row in range(560)])
            )
        table = np.array(pieces)
        flights = table.mean(axis=1)
        print(
            f"{name}: {flights.mean():.2f} +- {flights.std() / math.sqrt(len(flights)):.2f}, "
            f"{flights.std():.2f}, {flights.max():.2f}, {table.max():.1f}; outside of 99.9 % "
            f"{np.mean(outside):.4f}; error of the field along a flight "
            f"{1e9 * min(strengths):.0f} to {1e9 * max(strengths):.0f} nT; flights "
            f"{flights.round(2).tolist()}",
            flush=True,
        )


def _seed_of_graph(seed: int) -> int:
    """Return the seed with which `AttitudeTruth` draws the field of the deputy in a run."""
    return zlib.crc32(repr((seed, zlib.crc32(b"deputy"))).encode())


def _pointing_loop(
    track: OrbitTrack,
    seed: int,
    dipole: FloatArray,
    configuration: AttitudeFilterConfiguration | None = None,
) -> AttitudeLoop:
    """Return a loop that points at the Earth and compensates the dipole that it estimates."""
    state = track.state_gcrf(0)
    to_orbit = rotation_gcrf_to_orbit(state)
    quaternion = quaternion_from_roll_pitch_yaw(0.0, 0.0, 0.0, to_orbit)
    rate = rotation_matrix(quaternion).T @ (-orbit_rate(state) * to_orbit[1])
    start = AttitudeState(quaternion, rate, SpacecraftBody().wheel_momentum(_WHEEL_RPM))
    settings = LoopConfiguration(
        body=SpacecraftBody(dipole=dipole),
        filter=configuration or AttitudeFilterConfiguration(),
        control=AttitudeControlConfiguration(),
    )
    return AttitudeLoop(track, settings, start, seed, first="point")


def _print_pointing(name: object, seed: int, flown: ThreeAxisResult) -> None:
    print(
        name, seed, flown.statistics.sigma_deg.round(2),
        np.round(flown.wheel_variation_rpm, 0), flush=True,
    )  # fmt: skip
    _print_torquers(flown.history)


def _print_torquers(history: AttitudeHistory) -> None:
    """Print the longest pulse: 400 steps of 10 ms are 80 % of 5 s and leave the quiet window."""
    print(f"  longest pulse {np.nanmax(np.abs(history.pulse_steps)):.0f} of 400 steps", flush=True)


def _rms(values: npt.ArrayLike) -> float:
    return math.sqrt(float(np.mean(np.square(values))))


CASES: dict[str, Callable[[range], None]] = {
    case.__name__: case
    for case in (
        compass,
        from_37_degrees,
        three_axis,
        closed,
        autonomous,
        pitch_step,
        damped_kick,
        detumble,
        launch,
        turning,
    )
}


if __name__ == "__main__":
    fly_cases(__doc__, CASES)

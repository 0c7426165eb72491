"""Antennas away from the centres of mass: emulated receivers and the relative filter."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cdgps_test_support import (
    CHIEF,
    DEPUTY_250M,
    J2,
    L1_L2,
    REPOSITORY,
    SIGNALS,
    START,
    broadcast_ephemerides,
    configuration,
    epochs_of,
)

from vtff_dynamics.frames.earth import kinematics_itrf, rotation_gcrf_to_itrf
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.orbit.propagator import Propagator
from vtff_gnss.antex import PhaseCentre, PhaseCentreMap
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator
from vtff_nav.relative.common.antenna_correction import Antenna, AntennaPair
from vtff_nav.relative.common.measurements import (
    MeasurementNoise,
    SignalReader,
    compute_geometry,
    satellite_mask,
    satellite_numbers,
)
from vtff_nav.relative.common.solution import SOLUTION_FIXED
from vtff_sim_bridge.gnss.configuration import (
    ConstellationConfiguration,
    NoiseModel,
    ReceiverConfiguration,
    TrackingModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion

LEVER_ARMS = ((0.02, -0.05, -0.3), (-0.1, 0.12, -0.15))
WHITE_NOISE = NoiseModel("fixed", code_sigma=0.3, phase_sigma=0.001, doppler_sigma=0.01)


def phase_centre(sign: float) -> PhaseCentre:
    """Return an antenna with an offset, and variations of 6 mm with elevation and azimuth."""
    zenith, azimuth = np.radians(np.arange(0.0, 91.0, 5.0)), np.radians(np.arange(0.0, 361.0, 10.0))
    variation = 0.006 * sign * np.outer(np.cos(2.0 * azimuth), np.sin(zenith) ** 2)
    maps = {
        name: PhaseCentreMap(np.array([0.001, -0.002, size]), zenith, azimuth, variation)
        for name, size in (("G01", 0.06), ("G02", 0.09))
    }
    return PhaseCentre("PATCH NONE", maps)


ANTENNAS = AntennaPair(
    *(
        Antenna(lever_arm, phase_centre=phase_centre(sign))
        for lever_arm, sign in zip(LEVER_ARMS, (1.0, -1.0), strict=True)
    )
)


def with_antenna(receiver: ReceiverConfiguration, antenna: Antenna) -> ReceiverConfiguration:
    return dataclasses.replace(
        receiver, lever_arm_body=antenna.lever_arm_body, phase_centre=antenna.phase_centre
    )


def emulate(
    seconds: int, antennas: AntennaPair | None, noise: NoiseModel
) -> tuple[list[list[ObservationEpoch]], np.ndarray]:
    """Return the epochs of both receivers, and the states (seconds, 2, 6) of both craft, GCRF."""
    loaded = load_gnss_configuration(REPOSITORY / "config/gnss/noise_free.yaml")
    receivers = [
        dataclasses.replace(
            receiver,
            cn0_zenith_dbhz=SIGNALS,
            noise=noise,
            tracking=TrackingModel(threshold_dbhz=0.0),
        )
        for receiver in loaded.receivers
    ]
    if antennas is not None:
        receivers = [*map(with_antenna, receivers, antennas.both)]
    gnss = dataclasses.replace(
        loaded,
        receivers=tuple(receivers),
        constellation=ConstellationConfiguration(),
        profile=None,
    )
    emulated = {r.name: ReceiverFirmware(settings=HeaderSettings()) for r in gnss.receivers}
    for firmware in emulated.values():
        firmware.receive(b"LOG RANGEB ONTIME 1\r\n")
    crafts = [Propagator(START, state, J2) for state in (CHIEF, DEPUTY_250M)]
    vehicles = {name: VehicleMotion() for name in ("v1_m1", "v2_m1")}
    content = {name: bytearray() for name in emulated}
    receiver_set, states = None, []
    for second in range(seconds):
        states.append([craft.state_gcrf for craft in crafts])
        for craft, vehicle in zip(crafts, vehicles.values(), strict=True):
            position, velocity = craft.state_gcrf[:3], craft.state_gcrf[3:]
            motion = kinematics_itrf(
                craft.time, position, velocity, craft.acceleration_gcrf(), craft.jerk_gcrf()
            )
            vehicle.command(second * 10**9, MotionState(*(tuple(row.tolist()) for row in motion)))
            if receiver_set is None:
                receiver_set = ReceiverSet(
                    gnss, emulated, START, START + seconds, motion[:2].ravel(), TruthFile(None)
                )
            craft.advance(None)
        receiver_set.advance(
            second * 10**9, vehicles.__getitem__, lambda name, sent: content[name].extend(sent)
        )
    epochs = [list(epochs_of(bytes(sent)).values()) for sent in content.values()]
    return epochs, np.array(states)


def test_corrections_undo_what_the_emulator_adds():
    """Corrected measurements differ from those at the centres of mass by the ranges alone."""
    noise_free = NoiseModel("none")
    away, states = emulate(2, ANTENNAS, noise_free)
    central, _ = emulate(2, None, noise_free)
    ephemerides = broadcast_ephemerides(START, 2, "nominal")
    table = EphemerisTable(
        sorted({e.prn: e for e in ephemerides if e.system == 0}.values(), key=lambda e: e.prn)
    )
    reader = SignalReader(MeasurementNoise(), L1_L2)
    mask = satellite_mask(satellite_numbers(table))
    time = START + 1.0
    to_itrf = rotation_gcrf_to_itrf(time)
    states_itrf = np.array(
        [
            kinematics_itrf(time, s[:3], s[3:], np.zeros(3), np.zeros(3))[:2].ravel()
            for s in states[1]
        ]
    )
    rotations = ANTENNAS.rotations_body_to_itrf(time, states_itrf)
    ranges = [
        compute_geometry(table, time, np.zeros(2), moved, to_itrf)
        for moved in (ANTENNAS.states_itrf(states_itrf, rotations), states_itrf)
    ]
    largest = 0.0
    for receiver in range(2):
        raw, reference = (reader.read(epochs[receiver][1], mask) for epochs in (away, central))
        corrected = ANTENNAS.corrected(raw, receiver, ranges[0], to_itrf.T @ rotations[receiver])
        assert len(corrected) >= 12 and np.array_equal(corrected.signal, reference.signal)
        columns = ranges[0].columns(corrected.satellite)
        moved = (ranges[0].range - ranges[1].range)[receiver, columns]
        for name in ("pseudorange", "carrier_range"):
            change = getattr(corrected, name) - getattr(reference, name)
            np.testing.assert_allclose(change, moved, atol=2e-6)
            largest = max(
                largest, float(np.abs(getattr(raw, name) - getattr(reference, name) - moved).max())
            )
    assert largest > 0.05


@pytest.fixture(scope="module")
def flown() -> tuple[list[list[ObservationEpoch]], np.ndarray]:
    """Return 45 s of receivers with white noise whose antennas are away."""
    return emulate(45, ANTENNAS, WHITE_NOISE)


def last_error(
    flown: tuple[list[list[ObservationEpoch]], np.ndarray], antennas: AntennaPair | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the error of the last position, fixed, and its covariance."""
    (chief, deputy), states = flown
    ephemerides = broadcast_ephemerides(START, len(states), "nominal")
    estimator = CdgpsEstimator(configuration(antennas=antennas), ephemerides)
    for second, epochs in enumerate(zip(chief, deputy, strict=True)):
        solution = estimator.process(START + float(second), *epochs)
    assert solution.solution == SOLUTION_FIXED
    truth = relative_state_rtn(*states[-1])
    return solution.position_rtn - truth[:3], solution.covariance_rtn[:3, :3]


def test_given_antennas_leave_no_error(flown):
    error, covariance = last_error(flown, ANTENNAS)
    assert np.linalg.norm(error) < 2.5e-3
    assert error @ np.linalg.solve(covariance, error) < 16.0


def test_stated_errors_of_lever_arms_are_in_the_covariance(flown):
    """Half a metre between the antennas is inside the ellipsoid if, and only if, it is stated."""
    maps = [dataclasses.replace(a, lever_arm_body=(0.0, 0.0, 0.0)) for a in ANTENNAS.both]
    error, covariance = last_error(flown, AntennaPair(*maps))
    assert 0.15 < np.linalg.norm(error) < 0.4
    assert error @ np.linalg.solve(covariance, error) > 1e3
    stated = [dataclasses.replace(antenna, lever_arm_sigma=0.12) for antenna in maps]
    error, covariance = last_error(flown, AntennaPair(*stated))
    assert 0.2 < error @ np.linalg.solve(covariance, error) < 10.0
    # The difference of two independent lever arms: sqrt(2) 0.12 m on each axis, no more.
    sigmas = np.sqrt(np.diagonal(covariance))
    assert np.all((sigmas > 0.1) & (sigmas < 0.175))

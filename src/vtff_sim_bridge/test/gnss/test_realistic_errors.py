"""Errors of real receivers and skies, each against its definition, in what receivers measure."""

from __future__ import annotations

import dataclasses
import json
import math
import pathlib

import gnss_emulator_support as support
import numpy as np
import pytest

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_gnss.orbits.line_of_sight import elevation_azimuth, ellipsoid_normal
from vtff_sim_bridge.gnss.configuration import (
    BiasDriftModel,
    ConstellationConfiguration,
    MultipathModel,
    NoiseModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.gnss.sky import Constellation
from vtff_sim_bridge.gnss.vehicle_track import vehicle_track
from vtff_sim_bridge.simremote.motion import VehicleMotion
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

SECONDS = 12
SILENT = NoiseModel(model="none")


@pytest.fixture(scope="module")
def motions():
    return support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], SECONDS)


def observables(motions, truth_path: pathlib.Path | None = None, name: str = "chief", **changes):
    """Return code and carrier ranges of each second, (20 * seconds, links), with these fields."""
    base = support.with_receivers(support.configuration(), **{"noise": SILENT, **changes})
    return measured_ranges(support.Run(base, motions, truth_path=truth_path), name)


def measured_ranges(run: support.Run, name: str = "chief"):
    """Return pseudorange, carrier range and stated sigmas of a run after the first epoch."""
    code, phase, stated = [], [], []

    def keep(second: int) -> None:
        measured = run.measurements(name)
        if second:
            code.append(measured.observables.pseudorange)
            wavelength = measured.signals.plan.wavelength
            phase.append(
                (measured.observables.carrier_phase_cycles - measured.tracks.cycles) * wavelength
            )
            stated.append(measured.observables.sigmas)

    run.all(keep)
    return np.concatenate(code), np.concatenate(phase), stated


@pytest.fixture(scope="module")
def plain(motions):
    return observables(motions)


def seconds_of(path: pathlib.Path, receiver: str) -> list[dict]:
    """Return the records of the seconds of a receiver in a truth file."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [r for r in lines if r["record"] == "second" and r["receiver"] == receiver]


def test_gauss_markov_multipath_has_its_sigma_and_is_in_the_truth_file(motions, plain, tmp_path):
    model = MultipathModel(code_sigma=0.5, phase_sigma=0.005, correlation_time=0.2)
    path = tmp_path / "truth.jsonl"
    code, phase, _ = observables(motions, path, multipath=model)
    for change, sigma in ((code - plain[0], 0.5), (phase - plain[1], 0.005)):
        assert change.std() == pytest.approx(sigma, rel=0.1)
        # Both signals of a satellite, and two satellites, are independent.
        correlation = np.corrcoef(change.T) - np.eye(change.shape[1])
        assert np.sqrt(np.mean(correlation**2)) < 0.35
        assert np.mean(change[:-4] * change[4:]) == pytest.approx(sigma**2 * np.exp(-1.0), rel=0.25)
    told = seconds_of(path, "chief")[-1]["multipath"]
    tracked = np.array([value for signals in told.values() for value in signals.values()])
    assert len(tracked) >= 16
    measured = np.column_stack(((code - plain[0])[-1], (phase - plain[1])[-1]))
    distance = np.abs(tracked[:, None] - measured[None]).max(axis=2)
    assert distance.min(axis=1).max() < 2e-6


def test_gauss_markov_multipath_follows_elevation_and_cn0(motions, plain):
    size = {"code_sigma": 1.0, "phase_sigma": 0.01, "correlation_time": 100.0}
    constant = observables(motions, multipath=MultipathModel(**size))[0] - plain[0]
    low = MultipathModel(**size, elevation_model="cosine")
    base = support.with_receivers(support.configuration(), noise=SILENT, multipath=low)
    run = support.Run(base, motions)
    cosine = measured_ranges(run)[0] - plain[0]
    signals = run.measurements("chief").signals
    elevation = signals.line_of_sight.elevation[-1][signals.plan.satellite]
    np.testing.assert_allclose(cosine[-1] / constant[-1], np.cos(elevation), rtol=1e-4)
    weak = MultipathModel(**size, follows_cn0=True)
    follows = observables(motions, multipath=weak)[0] - plain[0]
    loss = signals.plan.cn0_zenith_dbhz - signals.cn0_dbhz[-1]
    assert loss.max() > 0.5
    expected = np.maximum(10.0 ** (loss / 20.0), 1.0)
    np.testing.assert_allclose(follows[-1] / constant[-1], expected, rtol=1e-4)


def test_multipath_of_two_antennas_and_two_seeds_is_independent(motions, plain):
    model = MultipathModel(code_sigma=1.0, correlation_time=0.05)
    chief = observables(motions, multipath=model)[0] - plain[0]
    deputy = observables(motions, name="deputy", multipath=model)[0]
    deputy = deputy - observables(motions, name="deputy")[0]
    columns = min(chief.shape[1], deputy.shape[1])
    product = np.mean(chief[:, :columns] * deputy[:, :columns])
    assert abs(product) < 5.0 / np.sqrt(chief.size / 2.0)
    base = support.with_receivers(support.configuration(seed=2), noise=SILENT, multipath=model)
    other = measured_ranges(support.Run(base, motions))[0]
    quiet = support.with_receivers(support.configuration(seed=2), noise=SILENT)
    other = other - measured_ranges(support.Run(quiet, motions))[0]
    assert abs(np.mean(chief * other)) < 5.0 / np.sqrt(chief.size / 2.0)


def test_receiver_states_a_factor_of_the_sigma_that_it_has(motions, plain):
    fixed = NoiseModel(model="fixed", code_sigma=0.6, phase_sigma=0.003, doppler_sigma=0.02)
    honest = observables(motions, noise=fixed)
    optimistic = observables(motions, noise=dataclasses.replace(fixed, stated_sigma_factor=0.5))
    np.testing.assert_array_equal(honest[0], optimistic[0])
    np.testing.assert_array_equal(honest[1], optimistic[1])
    assert (honest[1] - plain[1]).std() == pytest.approx(0.003, rel=0.05)
    for name, sigma in (("code", 0.6), ("phase", 0.003), ("doppler", 0.02)):
        assert np.unique(getattr(honest[2][-1], name)) == pytest.approx([sigma])
        assert np.unique(getattr(optimistic[2][-1], name)) == pytest.approx([0.5 * sigma])


def test_noise_of_the_loops_has_their_bandwidth(motions, plain):
    model = NoiseModel(
        model="fixed", code_loop_bandwidth_hz=2.0, phase_loop_bandwidth_hz=5.0, is_coloured=True
    )
    coloured = observables(motions, noise=model)
    white = observables(motions, noise=dataclasses.replace(model, is_coloured=False))
    for index, sigma, bandwidth in ((0, 0.3, 2.0), (1, 0.001, 5.0)):
        for ranges, expected in ((coloured, np.exp(-4.0 * bandwidth * 0.05)), (white, 0.0)):
            noise = ranges[index] - plain[index]
            assert noise.std() == pytest.approx(sigma, rel=0.06)
            product = np.mean(noise[:-1] * noise[1:]) / sigma**2
            assert product == pytest.approx(expected, abs=0.06)


def test_line_biases_drift_together_for_all_satellites_of_a_signal(motions, plain):
    model = BiasDriftModel(code_sigma=0.5, phase_sigma=0.005, correlation_time=2.0)
    base = support.with_receivers(support.configuration(), noise=SILENT, bias_drift=model)
    run = support.Run(base, motions)
    code, phase, _ = measured_ranges(run)
    band = run.measurements("chief").signals.plan.band
    lines = []
    for change, size in ((code - plain[0], 0.5), (phase - plain[1], 0.005)):
        for number in (1, 2):
            line = change[:, band == number]
            np.testing.assert_allclose(line - line[:, :1], 0.0, atol=3e-7)
            assert 0.2 * size < np.sqrt(np.mean(line**2)) < 3.0 * size
            lines.append(line[:, 0])
    assert np.abs(np.corrcoef(lines) - np.eye(4)).max() < 0.95


def gnss_file(tmp_path: pathlib.Path, text: str) -> pathlib.Path:
    """Return a GNSS file in which text stands for the multipath of all receivers."""
    path = tmp_path / "gnss.yaml"
    source = support.REPOSITORY / "config/gnss/noise_free.yaml"
    content = source.read_text(encoding="utf-8")
    path.write_text(content.replace("receiver_defaults:\n", f"receiver_defaults:\n{text}\n"))
    return path


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("  multipath: {code_sigma: -1.0}", r"receivers\[0\].multipath: code_sigma: 0 or more"),
        ("  multipath: {correlation_time: 0.0}", "multipath: correlation_time: more than 0"),
        ("  multipath: {elevation_model: sine}", "multipath: elevation_model: one of constant"),
        ("  bias_drift: {phase_sigma: -1.0}", "bias_drift: phase_sigma: 0 or more"),
        ("  bias_drift: {correlation_time: 0.0}", "bias_drift: correlation_time: more than 0"),
    ],
)
def test_wrong_values_are_refused_with_file_and_field(tmp_path, text, problem):
    with pytest.raises(ScenarioError, match=problem) as caught:
        load_gnss_configuration(gnss_file(tmp_path, text))
    assert "\n" not in str(caught.value) and "gnss.yaml" in str(caught.value)


def test_gradient_of_a_file_delays_the_code_and_advances_the_phase(motions, plain, tmp_path):
    path = tmp_path / "gnss.yaml"
    source = support.REPOSITORY / "config/gnss/noise_free.yaml"
    path.write_text(
        source.read_text(encoding="utf-8")
        + """
atmosphere:
  gradients:
    - {tecu_per_deg: 0.5, azimuth_deg: 0.0, shell_altitude: 700.0e3}
  travelling_disturbances:
    - {amplitude_tecu: 0.2, wavelength: 200.0e3, period: 1200.0, azimuth_deg: 180.0,
       shell_altitude: 700.0e3}
""",
        encoding="utf-8",
    )
    truth = tmp_path / "truth.jsonl"
    run = support.Run(load_gnss_configuration(path), motions, truth_path=truth)
    code, phase, _ = measured_ranges(run)
    code, phase = code - plain[0], phase - plain[1]
    np.testing.assert_allclose(code, -phase, atol=1e-6)
    assert code.min() >= -1e-6 and code.max() > 0.5
    plan = run.measurements("chief").signals.plan
    expected = 40.308e16 / plan.frequency**2
    last = seconds_of(truth, "chief")[-1]
    told = dict(zip(last["satellites"], last["slant_tec_tecu"], strict=True))
    for link, (prn, system) in enumerate(zip(plan.prn, plan.system, strict=True)):
        name = f"{'GRESCJI'[int(system)]}{int(prn):02d}"
        if name in told:
            assert code[-1, link] == pytest.approx(expected[link] * told[name], abs=1e-4)
    kinds = [json.loads(line).get("kind") for line in truth.read_text().splitlines()]
    assert {"HorizontalGradient", "TravellingDisturbance"} <= set(kinds)


def with_constellation(**changes: float):
    """Return the configuration without noise with other fields of the constellation."""
    base = support.with_receivers(support.configuration(), noise=SILENT)
    return dataclasses.replace(
        base, constellation=dataclasses.replace(base.constellation, **changes)
    )


def constellation(seed: int = 1, **changes: float) -> Constellation:
    """Return GPS satellites with errors over a day."""
    model = ConstellationConfiguration(**changes)
    return Constellation(model, support.START, support.START + 86400, {0}, seed)


def test_orbit_and_clock_errors_drift_with_their_correlation_time():
    satellites = [(0, prn) for prn in range(1, 32)]
    times = np.array([0.0, 3600.0, 36000.0])
    sizes = {"orbit_error_sigma": 1.5, "clock_error_sigma": 0.7, "error_correlation_time": 3600.0}
    drawn = np.array(
        [constellation(seed, **sizes).orbit_errors(satellites, times) for seed in range(1, 5)]
    )
    np.testing.assert_allclose(drawn.std(axis=(0, 1, 2))[:3], 1.5, rtol=0.15)
    assert drawn[..., 3].std() == pytest.approx(0.7, rel=0.15)
    unit = drawn / np.array([1.5, 1.5, 1.5, 0.7])
    product = np.mean(unit[:, 0] * unit[:, 1])
    assert product == pytest.approx(np.exp(-1.0), abs=0.12)
    assert np.mean(unit[:, 0] * unit[:, 2]) == pytest.approx(0.0, abs=0.15)
    assert np.mean(unit[..., 0] * unit[..., 1]) == pytest.approx(0.0, abs=0.2)
    assert np.mean(unit[:, :, 1:] * unit[:, :, :-1]) == pytest.approx(0.0, abs=0.15)
    constant = constellation(orbit_error_sigma=1.5).orbit_errors(satellites, times)
    np.testing.assert_array_equal(constant[0], constant[2])


def test_drifting_errors_are_in_code_phase_and_truth_file(motions, plain, tmp_path):
    path = tmp_path / "truth.jsonl"
    base = with_constellation(
        orbit_error_sigma=3.0, clock_error_sigma=2.0, error_correlation_time=60.0
    )
    run = support.Run(base, motions, truth_path=path)
    code, phase, _ = measured_ranges(run)
    np.testing.assert_allclose(code - plain[0], phase - plain[1], atol=1e-6)
    drift = (code - plain[0])[-1] - (code - plain[0])[0]
    assert np.abs(drift).max() > 0.3
    signals = run.measurements("chief").signals
    last = seconds_of(path, "chief")[-1]
    told = dict(zip(last["satellites"], last["range_error"], strict=True))
    for link, column in enumerate(signals.plan.satellite):
        name = f"G{signals.plan.satellites[column][1]:02d}"
        if name in told:
            assert (code - plain[0])[-1, link] == pytest.approx(told[name], abs=3e-6)


def test_uploads_move_the_message_and_not_the_satellite(motions, plain):
    run = support.Run(with_constellation(upload_error_sigma=20.0), motions)
    told = run.set.receivers["chief"]
    code, phase, _ = measured_ranges(run)
    np.testing.assert_allclose(code, plain[0], atol=1e-3)
    np.testing.assert_allclose(phase, plain[1], atol=1e-3)
    correct, sent = constellation(), constellation(upload_error_sigma=20.0)
    along, clock = [], []
    for hours in (0.5, 2.5, 4.5):
        time = support.START + hours * 3600.0
        for right, wrong in zip(
            correct.table(time).ephemerides, sent.table(time).ephemerides, strict=True
        ):
            angle = wrong.mean_anomaly - right.mean_anomaly
            along.append(math.remainder(angle, 2.0 * math.pi) * right.semi_major_axis)
            clock.append(299792458.0 * (wrong.af0 - right.af0))
            assert dataclasses.replace(
                wrong, mean_anomaly=right.mean_anomaly, af0=right.af0
            ) == dataclasses.replace(right, time=wrong.time)
    assert len(along) == 93
    for steps in (along, clock):
        assert np.std(steps) == pytest.approx(20.0, rel=0.25)
        # Each set has an error of its own.
        assert abs(np.corrcoef(steps[:31], steps[31:62])[0, 1]) < 0.6
    assert told.ephemerides(support.START + SECONDS)


ANTEX = """{version:<60}ANTEX VERSION / SYST
{nothing:<60}START OF ANTENNA
{name:<60}TYPE / SERIAL NO
     0.0                                                    DAZI
     0.0  90.0  45.0                                        ZEN1 / ZEN2 / DZEN
   G01                                                      START OF FREQUENCY
    100.00      0.00     50.00                              NORTH / EAST / UP
   NOAZI    0.00    0.00    0.00
   G01                                                      END OF FREQUENCY
   G02                                                      START OF FREQUENCY
      0.00    200.00      0.00                              NORTH / EAST / UP
   NOAZI    7.00    7.00    7.00
   G02                                                      END OF FREQUENCY
{nothing:<60}END OF ANTENNA
""".format(version="     1.4            M", nothing="", name="PATCH           NONE")


def turned(motions, angles: tuple[float, float, float]):
    """Return motion commands with an attitude."""
    return [[m._replace(heading_elevation_bank=angles) for m in step] for step in motions]


@pytest.mark.parametrize(
    ("angles", "expected_ned"),
    [
        ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
        ((math.pi / 2.0, 0.0, 0.0), (-2.0, 1.0, 3.0)),
        ((0.0, math.pi / 2.0, 0.0), (3.0, 2.0, -1.0)),
        ((0.0, 0.0, math.pi / 2.0), (1.0, -3.0, 2.0)),
    ],
)
def test_lever_arm_turns_with_the_body(motions, angles, expected_ned):
    track = []
    for lever in (None, (1.0, 2.0, 3.0)):
        motion = VehicleMotion()
        motion.command(0, turned(motions, angles)[0][0])
        track.append(vehicle_track(motion, 1, slice(0, 20), lever))
    lever = track[1].position_itrf - track[0].position_itrf
    latitude, longitude, _ = geodetic_from_itrf(track[0].position_itrf[0])
    up = np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    ned = np.array([np.cross(up, east), east, -up]) @ lever[0]
    np.testing.assert_allclose(ned, expected_ned, atol=1e-8)
    # The velocity of the antenna is the derivative of its position.
    slope = (track[1].position_itrf[2:] - track[1].position_itrf[:-2]) / 0.1
    centre = (track[0].position_itrf[2:] - track[0].position_itrf[:-2]) / 0.1
    moved = track[1].velocity_itrf - track[0].velocity_itrf
    np.testing.assert_allclose(moved[1:-1], slope - centre, atol=1e-6)
    assert np.linalg.norm(moved[0]) > 1e-3


def test_spinning_lever_arm_moves_with_the_spin(motions):
    motion = VehicleMotion()
    spin = motions[0][0]._replace(angular_velocity_body=(0.0, 0.0, 2.0))
    motion.command(0, spin)
    track = vehicle_track(motion, 1, slice(0, 20), (0.5, 0.0, 0.0))
    still = vehicle_track(motion, 1, slice(0, 20))
    speed = np.linalg.norm(track.velocity_itrf - still.velocity_itrf, axis=1)
    np.testing.assert_allclose(speed, 1.0, rtol=2e-3)


def test_lever_arm_and_phase_centre_of_a_file_are_in_the_ranges(motions, plain, tmp_path):
    (tmp_path / "patch.atx").write_text(ANTEX, encoding="ascii")
    text = """  lever_arm: {frame: body, position: [0.0, 0.0, -0.5]}
  phase_centre: {antex: patch.atx, antenna: PATCH NONE}"""
    truth = tmp_path / "truth.jsonl"
    run = support.Run(load_gnss_configuration(gnss_file(tmp_path, text)), motions, truth_path=truth)
    code, phase, _ = measured_ranges(run)
    signals = run.measurements("chief").signals
    plan, seen = signals.plan, signals.line_of_sight
    np.testing.assert_allclose(code - plain[0], phase - plain[1], atol=1e-6)
    zenith = ellipsoid_normal(signals.position_itrf[-1])
    elevation, azimuth = (
        angle[plan.satellite] for angle in elevation_azimuth(seen.direction_itrf[-1], zenith)
    )
    above = 0.5 * np.sin(elevation)
    on_l1 = -0.1 * np.cos(elevation) * np.cos(azimuth) - 0.05 * np.sin(elevation)
    on_l2 = -0.2 * np.cos(elevation) * np.sin(azimuth) + 0.007
    expected = np.where(plan.band == 1, on_l1, on_l2) - above
    np.testing.assert_allclose((phase - plain[1])[-1], expected, atol=2e-4)
    last = seconds_of(truth, "chief")[-1]["antenna_delay"]
    for satellite, by_signal in last.items():
        link = np.flatnonzero((plan.prn == int(satellite[1:])) & (plan.band == 2))[0]
        assert by_signal["G2W"][0] == pytest.approx(on_l2[link], abs=2e-4)
    lines = [json.loads(line) for line in truth.read_text(encoding="utf-8").splitlines()]
    told = next(line for line in lines if line["record"] == "receiver")
    assert told["phase_centre"] == "PATCH NONE" and told["lever_arm_body"] == [0.0, 0.0, -0.5]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("  lever_arm: {position: [0, 0, 1]}", r"receivers\[0\].lever_arm.frame: field is missing"),
        ("  lever_arm: {frame: rtn, position: [0, 0, 1]}", "lever_arm.frame: one of body expected"),
        ("  lever_arm: {frame: body, position: [0, 1]}", "lever_arm.position: three numbers"),
        ("  phase_centre: {antex: patch.atx, antenna: NO NONE}", "there is no antenna 'NO NONE'"),
        ("  phase_centre: {antex: none.atx, antenna: A B}", "phase_centre.antex: .*none.atx: No"),
        (
            "  phase_centre: {antex: patch.atx, antenna: PATCH NONE}",
            "phase_centre.antenna: .* has no frequency of G2W",
        ),
    ],
)
def test_wrong_antennas_are_refused_with_file_and_field(tmp_path, text, problem):
    (tmp_path / "patch.atx").write_text(ANTEX.replace("G02", "G05"), encoding="ascii")
    with pytest.raises(ScenarioError, match=problem) as caught:
        load_gnss_configuration(gnss_file(tmp_path, text))
    assert "\n" not in str(caught.value) and "gnss.yaml" in str(caught.value)

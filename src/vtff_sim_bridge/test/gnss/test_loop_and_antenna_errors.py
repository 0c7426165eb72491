"""Wind-up of antennas that turn, slips of loops by noise, and skies that the seed draws."""

from __future__ import annotations

import dataclasses
import math
import pathlib

import gnss_emulator_support as support
import numpy as np
import pytest
from scipy.special import iv

from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_gnss.orbits.line_of_sight import LineOfSight
from vtff_sim_bridge.gnss.configuration import (
    NoiseModel,
    TrackingModel,
    load_gnss_configuration,
)
from vtff_sim_bridge.gnss.signal_table import SIGNALS
from vtff_sim_bridge.noise.cycle_slips import NoiseSlips, slip_rate
from vtff_sim_bridge.receiver.tracking import Link, Tracker
from vtff_sim_bridge.receiver.wind_up import WindUp, wind_up_cycles
from vtff_sim_bridge.truth.scenario_fields import ScenarioError

CONFIG = pathlib.Path(__file__).resolve().parents[4] / "config"
RADIUS = 6.9e6
UP, EAST, NORTH = np.eye(3)


def line_of_sight(directions: np.ndarray) -> LineOfSight:
    """Return satellites on circular orbits in directions from a receiver on the x axis of ITRF."""
    receiver = RADIUS * UP
    along = directions @ receiver
    distance = -along + np.sqrt(along**2 + 2.66e7**2 - RADIUS**2)
    position = receiver + distance[:, None] * directions
    inertial = np.cross(NORTH, position)
    inertial *= 3.9e3 / np.linalg.norm(inertial, axis=1, keepdims=True)
    velocity = inertial - np.cross([0.0, 0.0, EARTH_ROTATION_RATE], position)
    zeros = np.zeros((1, len(directions)))
    return LineOfSight(
        **{
            **{field.name: zeros for field in dataclasses.fields(LineOfSight)},
            "range": distance[None],
            "direction_itrf": directions[None],
            "position_satellite_itrf": position[None],
            "velocity_satellite_itrf": velocity[None],
        }
    )


def level_body(heading: float) -> np.ndarray:
    """Return the axes of a level body, (1, 3, 3): x to the heading, z down."""
    forward = math.cos(heading) * NORTH + math.sin(heading) * EAST
    return np.array([[forward, np.cross(-UP, forward), -UP]])


def directions(*zenith_azimuth_deg: tuple[float, float]) -> np.ndarray:
    zenith, azimuth = np.radians(zenith_azimuth_deg).T
    horizontal = np.outer(np.cos(azimuth), NORTH) + np.outer(np.sin(azimuth), EAST)
    return np.sin(zenith)[:, None] * horizontal + np.outer(np.cos(zenith), UP)


def test_turn_under_a_satellite_is_its_angle():
    """Clockwise from above, as the field of GPS turns, the phase (RINEX) gains the angle."""
    sight = line_of_sight(directions((0.0, 0.0)))
    before = wind_up_cycles(sight, level_body(0.0))
    for heading_deg in (1.0, 60.0, -100.0):
        change = wind_up_cycles(sight, level_body(math.radians(heading_deg))) - before
        assert (change - heading_deg / 360.0 + 0.5) % 1.0 == pytest.approx(0.5, abs=1e-9)


def test_wind_up_is_the_phase_of_crossed_dipoles():
    """Against the voltage that right-handed fields of two dipoles induce in two dipoles."""
    sky = directions((10.0, 30.0), (50.0, 200.0), (75.0, 120.0), (85.0, 300.0))
    sight, body = line_of_sight(sky), level_body(0.7)
    expected = []
    for direction, position, velocity in zip(
        sky, sight.position_satellite_itrf[0], sight.velocity_satellite_itrf[0], strict=True
    ):
        inertial = velocity + np.cross([0.0, 0.0, EARTH_ROTATION_RATE], position)
        down = -position / np.linalg.norm(position)
        side = np.cross(down, inertial) / np.linalg.norm(np.cross(down, inertial))
        forward = np.cross(side, down)
        # The field far away is the sum of the dipoles without what points along the ray; the second
        # dipole of a right-handed antenna lags by a quarter.
        transverse = np.eye(3) - np.outer(direction, direction)
        field = transverse @ (forward - 1j * side)
        voltage = (body[0, 0] - 1j * -body[0, 1]) @ field
        expected.append(-np.angle(voltage) / (2.0 * math.pi))
    found = wind_up_cycles(sight, body)[0]
    difference = found - np.array(expected)
    difference = (difference - difference[0] + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(difference, 0.0, atol=0.01)


def test_turns_are_counted_without_jumps():
    sky, counted = directions((20.0, 10.0), (60.0, 250.0)), []
    sight, wind_up = line_of_sight(sky), WindUp()
    headings = np.radians(np.arange(0.0, 721.0, 30.0))
    for heading in headings:
        axes = level_body(heading)
        counted.append(wind_up.second(sight, axes, [(0, 1), (0, 2)], slice(0, 1))[0])
    counted = np.array(counted)
    assert np.abs(np.diff(counted, axis=0)).max() < 0.3
    np.testing.assert_allclose(counted[-1] - counted[0], 2.0, atol=1e-9)


def test_wind_up_is_in_phases_of_a_receiver_and_off_by_default():
    """The phase changes by whole wavelengths times the turns, the code does not."""
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 3)
    silent = {"noise": NoiseModel(model="none")}

    def measured(**changes: object):
        base = support.with_receivers(support.configuration(), **{**silent, **changes})
        run = support.Run(base, motions)
        run.all(lambda second: None)
        return run.measurements("chief")

    plain, winding = measured(), measured(has_wind_up=True)
    cycles = winding.signals.wind_up[:, winding.signals.plan.satellite]
    assert plain.signals.wind_up is None and np.ptp(cycles, axis=1).min() > 0.1
    change = winding.observables.carrier_phase_cycles - plain.observables.carrier_phase_cycles
    np.testing.assert_allclose(change, cycles, atol=1e-6)
    np.testing.assert_array_equal(winding.observables.pseudorange, plain.observables.pseudorange)


def rate(cn0_dbhz: float, jerk: float = 0.0, has_data: bool = False) -> float:
    arguments = np.array([cn0_dbhz]), np.array([jerk]), np.array([1575.42e6])
    return float(slip_rate(*arguments, np.array([has_data]), 15.0, 0.02)[0])


def test_slip_rate_is_viterbis():
    """The mean time between slips of a first-order loop in closed form, at two strengths."""
    for cn0_dbhz in (16.0, 22.0):
        ratio = 10.0 ** (0.1 * cn0_dbhz)
        rho = ratio / (15.0 * (1.0 + 1.0 / (0.04 * ratio)))
        mean_time = math.pi**2 * rho * iv(0, rho) ** 2 / 30.0
        assert rate(cn0_dbhz) == pytest.approx(1.0 / mean_time, rel=1e-9)
    assert rate(48.0) < 1e-100
    assert rate(25.0, has_data=True) > 1e6 * rate(25.0)


def test_dynamics_make_slips():
    """A jerk with a static error of 20 deg weakens the loop; the error of small ones does not."""
    natural = 15.0 / 0.7845
    jerk = math.radians(20.0) * natural**3 * 299792458.0 / 1575.42e6 / (2.0 * math.pi)
    assert rate(28.0, jerk) > 1e5 * rate(28.0)
    assert rate(28.0, 1e-3 * jerk) == pytest.approx(rate(28.0), rel=0.01)
    assert np.isfinite(rate(48.0, 1e9)) and rate(48.0, 1e9) <= 20.0


def test_slips_come_as_often_as_the_rate_says():
    slips = NoiseSlips(3, [(1, 0, prn, 1, 67) for prn in range(20)])
    rows = np.arange(20)
    has_data = rows % 2 == 0
    drawn = np.array(
        [
            slips.drawn(second, slice(0, 20), rows, np.full((20, 20), 0.5), has_data)
            for second in range(120)
        ]
    )
    count = np.count_nonzero(drawn)
    # 1200 expected, of Poisson: 35 either way.
    assert abs(count - 1200 * (1.0 - 0.5 * 0.5 / 20.0)) < 4.0 * 35.0
    assert set(np.unique(np.abs(drawn[..., has_data]))) == {0.0, 0.5}
    assert set(np.unique(np.abs(drawn[..., ~has_data]))) == {0.0, 1.0}
    assert abs(np.count_nonzero(drawn > 0.0) - 0.5 * count) < 4.0 * 0.5 * math.sqrt(count)
    again = NoiseSlips(3, [(1, 0, prn, 1, 67) for prn in range(20)])
    np.testing.assert_array_equal(
        again.drawn(77, slice(5, 9), rows[3:5], np.full((4, 2), 0.5), has_data[3:5]),
        drawn[77, 5:9, 3:5],
    )


def test_slips_move_the_phase_and_are_in_the_truth():
    signal = next(iter(support.configuration().receivers[0].cn0_zenith_dbhz))
    links, arcs = [Link(0, 5, SIGNALS[signal]), Link(0, 7, SIGNALS[signal])], []
    tracker = Tracker(links, TrackingModel(parity_delay=0.0), (), 1, 2, arcs.append)
    slips = np.zeros((6, 2))
    slips[2, 0], slips[4, 0], slips[4, 1] = 1.0, -0.5, -1.0
    can_track = np.ones((6, 2), dtype=bool)
    can_track[4, 1] = False  # a loop that does not track does not slip
    tracks = tracker.advance(0, np.arange(2), can_track, slips)
    np.testing.assert_array_equal(
        tracks.cycles[:, 0] - tracks.cycles[0, 0], [0.0, 0.0, 1.0, 1.0, 0.5, 0.5]
    )
    np.testing.assert_array_equal(tracks.cycles[:4, 1], tracks.cycles[0, 1])
    np.testing.assert_allclose(np.diff(tracks.lock_time[:, 0]), 0.05)
    told = [(arc.epoch, arc.event, arc.cycles) for arc in arcs if arc.link.prn == 5]
    assert told[1:] == [
        (2, "slip", tracks.cycles[2, 0]),
        (4, "half_cycle", tracks.cycles[4, 0]),
    ]


def test_weak_signals_of_a_receiver_slip_and_strong_ones_do_not():
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 8)

    def slipped(cn0_dbhz: float, has_noise_slips: bool) -> bool:
        base = support.configuration()
        tracking = dataclasses.replace(
            base.receivers[0].tracking, threshold_dbhz=5.0, has_noise_slips=has_noise_slips
        )
        signals = dict.fromkeys(base.receivers[0].cn0_zenith_dbhz, cn0_dbhz)
        base = support.with_receivers(base, tracking=tracking, cn0_zenith_dbhz=signals)
        run, cycles = support.Run(base, motions), []
        run.all(lambda second: cycles.append(run.measurements("chief").tracks.cycles[-1]))
        return bool(np.ptp(cycles[3:], axis=0).any())

    assert slipped(16.0, True)
    assert not slipped(16.0, False)
    assert not slipped(45.0, True)


def test_sky_is_drawn_by_the_seed_where_asked(tmp_path):
    text = (CONFIG / "gnss/reference.yaml").read_text(encoding="utf-8")
    path = tmp_path / "drawn.yaml"
    path.write_text(text + "draw: {constellation: true, electron_density_sigma: 0.3}\n")
    plain = load_gnss_configuration(CONFIG / "gnss/reference.yaml", seed=4)
    assert (plain.seed, plain.constellation.seed) == (4, 0)
    drawn = [load_gnss_configuration(path, seed) for seed in range(1, 41)]
    assert [configuration.constellation.seed for configuration in drawn] == list(range(1, 41))
    logarithms = [
        math.log(float(c.profile.density_per_m3.max() / plain.profile.density_per_m3.max()))
        for c in drawn
    ]
    assert np.std(logarithms) == pytest.approx(0.3, rel=0.35)
    again = load_gnss_configuration(path, 7)
    np.testing.assert_array_equal(again.profile.density_per_m3, drawn[6].profile.density_per_m3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("", "draw: {electron_density_sigma: -1.0}\n", "draw: electron_density_sigma: 0 or more"),
        ("", "draw: {ionosphere: true}\n", "draw.ionosphere: unknown field"),
        ("  baud: 460800", "  has_wind_up: perhaps", r"receivers\[0\].has_wind_up: true or false"),
        (
            "    channels: 12",
            "    has_noise_slips: 3",
            r"receivers\[0\].tracking.has_noise_slips: true or false",
        ),
        (
            "  regions: []",
            "  gradients: [{tecu_per_deg: steep, azimuth_deg: 0.0, shell_altitude: 7.0e5}]",
            r"atmosphere.gradients\[0\].tecu_per_deg: a number",
        ),
    ],
)
def test_wrong_options_are_one_line_with_file_and_field(tmp_path, old, new, message):
    text = (CONFIG / "gnss/reference.yaml").read_text(encoding="utf-8")
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace(old, new, 1) if old else text + new)
    with pytest.raises(ScenarioError, match=rf"{path}: {message}") as refusal:
        load_gnss_configuration(path)
    assert "\n" not in str(refusal.value)

"""Paper 001: the published program, and clusters that fly."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from vtff_analysis.cluster.cluster_flight import (
    cluster_of_run,
    describe_cluster,
    summarise_cluster,
)
from vtff_analysis.cluster.flight import Decay, draw_starts, fly_cluster
from vtff_analysis.cluster.literal import run_literal
from vtff_analysis.cluster.output import run_potential_field
from vtff_analysis.recordings.history import (
    AccelerationHistory,
    DeputyHistory,
    RelativeStateHistory,
    RunHistory,
)
from vtff_control.cluster.elements_field import ElementsField
from vtff_control.cluster.potential_field import equilibrium_distance
from vtff_sim_bridge.on_board.range_sensor import RangeSensor

SIDE = equilibrium_distance()
SLOW = [(1, "ellipse"), (2, "helix"), (2, "circle"), (3, "ellipse"), (5, "helix")]


def test_published_program_commands_nothing():
    literal = run_literal()
    assert max(literal.velocity_changes) <= 1e-12
    np.testing.assert_allclose(literal.separations, (305.2, 206.9, 506.2), atol=0.1)


def check(flight):
    last = flight.sides[flight.last_orbit]
    assert np.abs(last.mean(axis=0) / SIDE - 1.0).max() <= 0.01
    assert np.abs(last / SIDE - 1.0).max() <= 0.025
    assert flight.closest >= 500.0
    settled = flight.settling_time()
    assert math.isfinite(settled)
    assert flight.velocity_change(0.0, settled).max() <= 40.0


def recorded(positions, thrust, step=10):
    """Return a run of one chaser with these positions, m, (k, 3), and a constant thrust, m/s2."""
    start = 1_458_522_000_000_000_000
    time = start + 10**9 * step * np.arange(len(positions))
    fixes = np.tile([6678e3, 0.0, 0.0], (len(positions), 1))
    return RunHistory(
        start,
        int(time[-1]),
        {"/chaser/neighbours": len(positions)},
        deputies={
            "chaser": DeputyHistory(
                "chaser",
                truth=RelativeStateHistory(time, positions, np.zeros_like(positions)),
                applied=AccelerationHistory(time, np.tile(thrust, (len(positions), 1))),
            )
        },
        receivers={"chaser": SimpleNamespace(fix_position_itrf=fixes)},
    )


def test_figures_of_a_recorded_cluster():
    distances = np.concatenate((np.linspace(1800.0, SIDE, 101)[:-1], np.full(600, SIDE)))
    positions = distances[:, np.newaxis] * [0.6, 0.0, 0.8]
    history = recorded(positions, [3e-3, 0.0, 4e-3])
    summary = summarise_cluster(cluster_of_run(history))
    # Inside 2.5 % from the step on at which the line to the side is that near it.
    settled = 10.0 * math.ceil(100.0 * (1.0 - 0.025 * SIDE / (1800.0 - SIDE)))
    assert summary["cluster_settling_time_s"] == pytest.approx(settled)
    assert summary["cluster_settling_delta_v_m_per_s"] == pytest.approx(5e-3 * settled)
    assert summary["cluster_closest_m"] == pytest.approx(SIDE)
    assert summary["cluster_side_largest_error_percent"] == pytest.approx(0.0, abs=1e-9)
    assert summary["cluster_last_orbit_delta_v_m_per_s"] == pytest.approx(5e-3 * 5431, abs=0.06)
    assert f"{settled:.0f} s on" in describe_cluster(summary)
    short = summarise_cluster(cluster_of_run(recorded(positions[:50], np.zeros(3))))
    assert "cluster_last_orbit_delta_v_m_per_s" not in short
    assert "have not settled" in describe_cluster(short)
    # Half an orbit to the side, then as long as before: the last orbit has the way there in it.
    slow = np.concatenate((np.linspace(1800.0, SIDE, 301)[:-1], np.full(300, SIDE)))
    moving = recorded(slow[:, np.newaxis] * [0.6, 0.0, 0.8], np.zeros(3))
    late = summarise_cluster(cluster_of_run(moving))
    assert late["cluster_settling_time_s"] < 6000.0 - 2000.0
    assert "cluster_side_mean_error_percent" not in late
    no_sensor = dataclasses.replace(history, message_counts={})
    assert cluster_of_run(no_sensor) is None
    assert not summarise_cluster(None) and not describe_cluster({})


def test_a_start_in_space():
    check(fly_cluster(draw_starts(52, dimensions=3), 2.0, RangeSensor(), seed=52))


@pytest.mark.slow
def test_thirty_starts():
    for seed in range(30):
        check(fly_cluster(draw_starts(seed), 3.0, RangeSensor(), seed=seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 900, 901, 902, 903])
def test_a_chaser_blind_for_an_orbit_comes_back(seed):
    """Without the coast it was out of the range of its sensor after it, and lost."""
    begin, end = 9000.0, 9000.0 + 5431.0
    flight = fly_cluster(draw_starts(seed), 3.6, RangeSensor(outage=(begin, end)), seed=seed)
    sides = flight.sides
    assert sides[flight.times >= begin].max() > 1500.0  # it did not hold its place blindly
    assert flight.closest >= 500.0
    np.testing.assert_allclose(sides[-1], equilibrium_distance(), rtol=0.025)


@pytest.mark.slow
def test_a_decaying_neighbour_is_not_followed():
    starts = draw_starts(61)
    far = [
        fly_cluster(starts, 5.0, RangeSensor(), seed=61, decay=Decay(12000.0, 5e-5, watched)).sides[
            -1, 0
        ]
        for watched in (True, False)
    ]
    assert far[0] == pytest.approx(SIDE, rel=0.025)
    assert far[1] > 3.0 * SIDE


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 61])
def test_a_chaser_that_decays_drifts_through_a_helix(seed):
    """In an ellipse it comes to 55 m of the lead, and neither of the two thrusts."""
    decay = Decay(20000.0, 5e-5)
    flight = fly_cluster(
        draw_starts(seed),
        9.4,
        RangeSensor(misalignment_sigma=3e-4),
        seed=seed,
        orbits_from=7000.0,
        held=ElementsField("helix"),
        decay=decay,
    )
    assert flight.closest >= 500.0
    # Five orbits later the other one is where it was, and stays there for as little as before.
    assert flight.sides[flight.last_orbit, 0].max() < 2.4 * SIDE
    assert price_of_last_orbit(flight) <= 0.05


def price_of_last_orbit(flight):
    return flight.velocity_change(flight.times[-1] - flight.period, math.inf).max()


@pytest.mark.parametrize(
    ("chasers", "shape"),
    [(2, "ellipse"), *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
)
def test_orbits_hold_a_cluster(chasers, shape):
    """At rest the same cluster pays 5 to 19 m/s in every orbit."""
    flight = fly_cluster(
        draw_starts(4, chasers),
        5.0,
        RangeSensor(misalignment_sigma=3e-4),
        seed=4,
        orbits_from=7000.0,
        held=ElementsField(shape),
    )
    assert flight.closest >= 500.0
    assert price_of_last_orbit(flight) <= 0.05


@pytest.mark.slow
def test_study(tmp_path):
    found = run_potential_field(tmp_path, starts=1, say=lambda _: None)
    rows = found.rows
    assert "1 of 1 drawn starts" in found.sentence
    names = {path.name for path in tmp_path.iterdir() if path.suffix != ".json"}
    assert names == {
        "potential_field.csv",
        *(f"{name}.png" for name in ("figure_2", "paths", "sides", "decay")),
    }
    assert rows[0].measured.endswith("km/s")

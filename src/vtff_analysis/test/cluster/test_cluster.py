"""Paper 001: the published program, and clusters that fly."""

import math

import numpy as np
import pytest

from vtff_analysis.cluster.flight import Decay, RangeSensor, draw_starts, fly_cluster
from vtff_analysis.cluster.literal import run_literal
from vtff_analysis.cluster.output import run_potential_field
from vtff_control.guidance.potential_field import equilibrium_distance

SIDE = equilibrium_distance()


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


def test_starts():
    for seed, dimensions in ((51, 2), (52, 3)):
        starts = draw_starts(seed, dimensions=dimensions)
        assert np.linalg.norm(starts, axis=1).max() <= 3e3
        check(fly_cluster(starts, 3.0, RangeSensor(), seed=seed))


@pytest.mark.slow
def test_thirty_starts():
    for seed in range(30):
        check(fly_cluster(draw_starts(seed), 3.0, RangeSensor(), seed=seed))


@pytest.mark.parametrize(
    "seed",
    [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 3, 900, 901, 902, 903))],
)
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
def test_study(tmp_path):
    rows = run_potential_field(tmp_path, starts=1, say=lambda _: None)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "potential_field.csv",
        *(f"{name}.png" for name in ("figure_2", "paths", "sides", "decay")),
    }
    assert rows[0].measured.endswith("km/s")

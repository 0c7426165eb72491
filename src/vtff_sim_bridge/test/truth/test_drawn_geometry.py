"""Epoch and orbits that the seed of a run draws."""

import pathlib

import numpy as np
import pytest

from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.truth.scenario import Scenario, ScenarioError, read_scenario

REFERENCE = pathlib.Path(__file__).resolve().parents[4] / "config/scenario/reference.yaml"


def drawn(seed: int | None = None, **draw: object) -> Scenario:
    """Return the reference scenario with a section draw."""
    fields = parse_yaml(REFERENCE.read_text(encoding="utf-8"))
    if draw:
        fields["draw"] = draw
    return read_scenario(fields, "drawn", seed)


def test_orbits_turn_and_the_formation_stays() -> None:
    fixed = drawn()
    angles, heights = [], []
    for seed in range(300):
        scenario = drawn(seed, node=True, place_on_orbit=True)
        assert scenario.seed == seed and scenario.epoch == fixed.epoch
        chief, deputy = (craft.state_gcrf for craft in scenario.spacecraft)
        np.testing.assert_allclose(
            relative_state_rtn(chief, deputy),
            relative_state_rtn(fixed.chief.state_gcrf, fixed.deputies[0].state_gcrf),
            atol=1e-6,
        )
        normal = np.cross(chief[:3], chief[3:])
        assert normal[2] / np.linalg.norm(normal) == pytest.approx(0.5, abs=1e-9)
        angles.append(np.arctan2(normal[0], -normal[1]))
        heights.append(chief[2] / 6928137.0)
    # Uniform: the mean of the unit vectors is 0, the height is an arcsine of variance 3/8.
    assert abs(np.mean(np.exp(1j * np.array(angles)))) < 0.15
    assert np.var(heights) == pytest.approx(0.375, abs=0.05)
    assert abs(np.corrcoef(np.sin(angles), heights)[0, 1]) < 0.2


def test_each_is_drawn_for_itself_and_repeats() -> None:
    fixed = drawn()
    node = drawn(5, node=True)
    assert node.chief.state_gcrf[2] == pytest.approx(fixed.chief.state_gcrf[2], abs=1e-6)
    both = drawn(5, node=True, epoch_days=2.0)
    np.testing.assert_array_equal(node.chief.state_gcrf, both.chief.state_gcrf)
    delays = [drawn(seed, epoch_days=2.0).epoch - fixed.epoch for seed in range(300)]
    assert all(delay == int(delay) for delay in delays)
    assert 0.0 <= min(delays) and max(delays) < 172800.0
    assert np.mean(delays) == pytest.approx(86400.0, rel=0.12)
    assert np.std(delays) == pytest.approx(172800.0 / np.sqrt(12.0), rel=0.1)
    assert drawn(5, epoch_days=2.0).epoch == both.epoch
    np.testing.assert_array_equal(drawn(5).chief.state_gcrf, fixed.chief.state_gcrf)


@pytest.mark.parametrize(
    ("draw", "problem"),
    [
        ({"epoch_days": -1.0}, "drawn: draw: epoch_days: between 0 and 36525"),
        ({"node": 1.0}, "drawn: draw.node: true or false expected"),
        ({"inclination": True}, "drawn: draw.inclination: unknown field"),
    ],
)
def test_wrong_values_are_refused_with_file_and_field(
    draw: dict[str, object], problem: str
) -> None:
    with pytest.raises(ScenarioError, match=problem):
        drawn(1, **draw)


def test_a_century_is_the_longest_time_to_draw_from() -> None:
    assert drawn(3, epoch_days=36525.0).epoch - drawn().epoch > 0.0
    with pytest.raises(ScenarioError, match="epoch_days"):
        drawn(3, epoch_days=36525.1)

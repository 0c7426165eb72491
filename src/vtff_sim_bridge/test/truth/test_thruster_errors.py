"""Errors of thrusters: scale, direction, noise and bias against their definitions."""

import math
import pathlib

import numpy as np
import pytest

from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.truth.scenario import ScenarioError, read_scenario
from vtff_sim_bridge.truth.thruster_errors import ThrusterErrorModel, ThrusterErrors

REFERENCE = pathlib.Path(__file__).resolve().parents[4] / "config/scenario/reference.yaml"
STEPS = 4000
THRUST = np.array([0.3, -0.4, 1.2])
"""Reported acceleration with a length of 1.3 m/s2."""


def accelerations(model: ThrusterErrorModel, seed: int = 1, name: str = "deputy") -> np.ndarray:
    """Return the true acceleration of many steps in which the same thrust is reported."""
    errors = ThrusterErrors(model, seed, name)
    return np.array([errors.true_acceleration(step, THRUST) for step in range(STEPS)])


def test_scale_and_bias_change_length_and_offset() -> None:
    scaled = accelerations(ThrusterErrorModel(scale=1.05))
    np.testing.assert_allclose(scaled, np.tile(1.05 * THRUST, (STEPS, 1)), rtol=1e-14)
    biased = accelerations(ThrusterErrorModel(bias=(1e-3, -2e-3, 3e-3)))
    np.testing.assert_allclose(biased[0] - THRUST, [1e-3, -2e-3, 3e-3], atol=1e-15)


def test_misalignment_is_a_rotation_that_stays_for_a_run_and_differs_between_runs() -> None:
    true = accelerations(ThrusterErrorModel(misalignment_deg=2.0))
    np.testing.assert_array_equal(true, np.tile(true[0], (STEPS, 1)))
    assert np.linalg.norm(true[0]) == pytest.approx(1.3, rel=1e-14)
    sines = []
    for seed in range(2000):
        errors = ThrusterErrors(ThrusterErrorModel(misalignment_deg=2.0), seed, "deputy")
        direction = errors.true_acceleration(0, THRUST) / 1.3
        sines.append(np.linalg.norm(np.cross(direction, THRUST / 1.3)))
    angles = np.degrees(np.arcsin(sines))
    assert angles.max() <= 2.0 + 1e-9
    # The mean square of the sine between a fixed direction and a uniform axis is 2/3.
    assert np.mean(angles**2) == pytest.approx(2.0**2 * 2.0 / 3.0, rel=0.05)


def test_noise_is_white_and_in_proportion_to_the_thrust() -> None:
    noise = accelerations(ThrusterErrorModel(noise=0.01)) - THRUST
    np.testing.assert_allclose(noise.std(axis=0), 0.013, rtol=0.05)
    assert np.abs(noise.mean(axis=0)).max() < 4.0 * 0.013 / math.sqrt(STEPS)
    for first in range(3):
        correlation = np.corrcoef(noise[:-1, first], noise[1:, first])[0, 1]
        assert abs(correlation) < 4.0 / math.sqrt(STEPS)
        assert abs(np.corrcoef(noise[:, first], noise[:, first - 1])[0, 1]) < 4.0 / math.sqrt(STEPS)


def test_streams_of_spacecraft_and_seeds_are_independent_and_repeatable() -> None:
    model = ThrusterErrorModel(noise=0.01)
    deputy = accelerations(model)[:, 0]
    np.testing.assert_array_equal(deputy, accelerations(model)[:, 0])
    for other in (accelerations(model, name="deputy_2"), accelerations(model, seed=2)):
        assert abs(np.corrcoef(deputy, other[:, 0])[0, 1]) < 4.0 / math.sqrt(STEPS)


def test_a_thruster_that_rests_gives_nothing() -> None:
    errors = ThrusterErrors(ThrusterErrorModel(1.05, 2.0, 0.01, (1.0, 1.0, 1.0)), 1, "deputy")
    np.testing.assert_array_equal(errors.true_acceleration(0, np.zeros(3)), np.zeros(3))


def fields(**deputy: object) -> dict:
    """Return the fields of the reference scenario with others for the deputy."""
    content = parse_yaml(REFERENCE.read_text(encoding="utf-8"))
    content["spacecraft"][1].update(deputy)
    return content


def test_truth_flies_the_errors_of_the_scenario_and_the_motion_for_simgen_has_them() -> None:
    exact = read_scenario(fields(), "exact").formation_truth()
    scaled = read_scenario(fields(thruster_errors={"scale": 1.05}), "scaled").formation_truth()
    thrust = np.array([0.0, 0.5, 0.0])
    motion = scaled.motion_itrf("deputy", thrust) - scaled.motion_itrf("deputy")
    assert np.linalg.norm(motion[2]) == pytest.approx(1.05 * 0.5, rel=1e-6)
    start = exact.relative_state_rtn("deputy")[4]
    for truth in (exact, scaled):
        truth.advance({"deputy": thrust})
    gained = scaled.relative_state_rtn("deputy")[4] - start
    assert gained / (exact.relative_state_rtn("deputy")[4] - start) == pytest.approx(1.05, rel=1e-3)
    np.testing.assert_array_equal(exact.state_gcrf("chief"), scaled.state_gcrf("chief"))


def test_noise_of_the_flown_thrust_is_another_one_in_each_step() -> None:
    plain = read_scenario(fields(), "plain").formation_truth()
    noisy = read_scenario(fields(thruster_errors={"noise": 0.2}), "noisy").formation_truth()
    velocities = []
    for _ in range(4):
        for truth in (plain, noisy):
            truth.advance({"deputy": [0.0, 1.0, 0.0]})
        velocities.append((noisy.state_gcrf("deputy") - plain.state_gcrf("deputy"))[3:])
    errors = np.diff([np.zeros(3), *velocities], axis=0)  # m/s in a step, as m/s2
    distances = [
        np.linalg.norm(one - other) for one, other in zip(errors, errors[1:], strict=False)
    ]
    assert min(distances) > 0.02


def test_forces_of_the_deputy_replace_those_of_the_scenario() -> None:
    drag = {"drag": "harris_priester", "mass": 10.0, "drag_area": 1.0, "drag_coefficient": 2.2}
    content = fields(force_model={"drag_coefficient": 3.3})
    content["force_model"].update(drag)
    scenario = read_scenario(content, "drag")
    deputy = scenario.deputies[0].force_model
    assert deputy is not None
    assert (deputy.drag_coefficient, deputy.mass, deputy.degree) == (3.3, 10.0, 8)
    assert scenario.chief.force_model is None
    content = fields()
    content["force_model"].update(drag)
    same = read_scenario(content, "same").formation_truth()
    more = scenario.formation_truth()
    for _ in range(100):
        same.advance()
        more.advance()
    np.testing.assert_array_equal(same.state_gcrf("chief"), more.state_gcrf("chief"))
    model = scenario.force_model
    state = same.state_gcrf("deputy")
    without = type(model)(degree=8, order=8).acceleration(same.time, state)
    drag_acceleration = np.linalg.norm(model.acceleration(same.time, state) - without)
    moved = np.linalg.norm((more.state_gcrf("deputy") - same.state_gcrf("deputy"))[3:])
    assert moved == pytest.approx(0.5 * drag_acceleration * 100.0, rel=0.3)


@pytest.mark.parametrize(
    ("deputy", "problem"),
    [
        ({"thruster_errors": {"scale": -1.0}}, r"deputies: spacecraft\[1\].thruster_errors: scale"),
        ({"thruster_errors": {"noise": -0.1}}, "thruster_errors: noise: 0 or more"),
        ({"thruster_errors": {"bias": [1.0]}}, "thruster_errors: bias: three numbers"),
        ({"thruster_errors": {"bias": ["a", 1, 2]}}, "thruster_errors: bias: three numbers"),
        ({"thruster_errors": {"factor": 1.0}}, "thruster_errors.factor: unknown field"),
        ({"force_model": {"third_bodies": ["mars"]}}, r"\[1\].force_model: third_bodies 'mars'"),
        ({"force_model": {"wind": 1.0}}, "force_model.wind: unknown field"),
    ],
)
def test_wrong_values_are_refused_with_file_and_field(
    deputy: dict[str, object], problem: str
) -> None:
    with pytest.raises(ScenarioError, match=problem) as caught:
        read_scenario(fields(**deputy), "deputies")
    assert "\n" not in str(caught.value)


def test_thrusters_of_the_axes_give_together_what_acts() -> None:
    model = ThrusterErrorModel(1.1, 3.0, 0.02, (1e-3, -2e-3, 0.0))
    errors = ThrusterErrors(model, 4, "deputy")
    for step in range(5):
        rows = errors.accelerations_of_thrusters(step, THRUST)
        np.testing.assert_allclose(
            rows.sum(axis=0), errors.true_acceleration(step, THRUST), rtol=1e-14
        )
    assert not errors.accelerations_of_thrusters(0, np.zeros(3)).any()
    # Without noise and bias a thruster that is off gives nothing, and the others are askew.
    askew = ThrusterErrors(ThrusterErrorModel(1.0, 3.0), 4, "deputy")
    rows = askew.accelerations_of_thrusters(0, [0.0, 2.0, 0.0])
    assert not rows[[0, 2]].any()
    assert math.degrees(math.acos(rows[1, 1] / 2.0)) <= 3.0
    assert np.linalg.norm(rows[1]) == pytest.approx(2.0)

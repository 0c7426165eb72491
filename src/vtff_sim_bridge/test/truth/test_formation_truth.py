"""True motion of a formation: stepping, thrust axes and the motion sent to SimGEN."""

import math

import numpy as np
import pytest

from vtff_dynamics.attitude.quaternion import from_rotation_vector, rotation_matrix
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.time.timescales import parse_epoch
from vtff_sim_bridge.truth.formation_truth import FormationTruth
from vtff_sim_bridge.truth.scenario import state_ahead_on_orbit

EPOCH = parse_epoch("2016-03-21T01:00:00 GPS")
CHIEF = ClassicalElements(6880540.0, 0.044, 0.17, 4.5, math.pi, -1.5).to_state()


def formation(integrator: str = "rk4", deputies: int = 1) -> FormationTruth:
    """Return a formation with deputies 1 km apart."""
    craft = [("chief", CHIEF)]
    craft += [
        (f"deputy_{number}", state_ahead_on_orbit(CHIEF, 1000.0 * number))
        for number in range(1, deputies + 1)
    ]
    return FormationTruth(EPOCH, craft, ForceModel(), integrator)


def test_names_and_time() -> None:
    truth = formation(deputies=3)
    assert truth.chief == "chief"
    assert truth.deputies == ("deputy_1", "deputy_2", "deputy_3")
    for _ in range(5):
        truth.advance()
    assert truth.time - EPOCH == 5.0
    np.testing.assert_allclose(truth.relative_state_rtn("chief"), 0.0, atol=1e-12)


def test_thrust_is_held_inertially_in_the_axes_at_the_start_of_the_step() -> None:
    truth = formation(deputies=2)
    thrust_rtn = np.array([0.3, -1.2, 0.7])
    alone = Propagator(EPOCH, truth.state_gcrf("deputy_2"), ForceModel())
    for _ in range(3):
        rotation = rotation_gcrf_to_rtn(truth.state_gcrf("chief"))
        alone.advance(rotation.T @ thrust_rtn)
        truth.advance({"deputy_2": thrust_rtn})
    np.testing.assert_array_equal(truth.state_gcrf("deputy_2"), alone.state_gcrf)


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
def test_motions_of_many_steps_together_are_those_of_each_step(integrator) -> None:
    truth, other = formation(integrator, deputies=2), formation(integrator, deputies=2)
    later, at_once = [], []
    for step in range(70):
        thrust = {"deputy_1": [0.1, 0.0, 1e-3 * step]} if step % 2 else {}
        later.append(truth.motions_of_now(thrust, {}))
        at_once.append({name: other.motion_itrf(name, thrust.get(name)) for name in other.names})
        truth.advance(thrust)
        other.advance(thrust)
        if step == 20:
            later[-1]()
    for compute, expected in zip(later, at_once, strict=True):
        motions = compute()
        assert list(motions) == list(truth.names)
        for name, motion in motions.items():
            np.testing.assert_allclose(motion, expected[name], rtol=1e-13)


def test_thrust_of_one_deputy_moves_no_other() -> None:
    thrusting, coasting = formation(deputies=2), formation(deputies=2)
    for _ in range(3):
        thrusting.advance({"deputy_1": [1.0, 0.0, 0.0]})
        coasting.advance()
    for name in ("chief", "deputy_2"):
        np.testing.assert_array_equal(thrusting.state_gcrf(name), coasting.state_gcrf(name))
    moved = thrusting.relative_state_rtn("deputy_1") - coasting.relative_state_rtn("deputy_1")
    np.testing.assert_allclose(moved[[0, 3]], [4.5, 3.0], rtol=1e-3)


@pytest.mark.parametrize(
    ("accelerations", "problem"),
    [
        ({"deputy_9": [0, 0, 0]}, "unknown spacecraft 'deputy_9'"),
        ({"deputy_1": [0, 0]}, "acceleration of deputy_1"),
        ({"deputy_1": [0, 0, np.nan]}, "acceleration of deputy_1"),
    ],
)
def test_wrong_thrust_is_refused_before_anything_moves(
    accelerations: dict[str, list[float]], problem: str
) -> None:
    truth = formation()
    with pytest.raises(ValueError, match=problem):
        truth.advance(accelerations)
    assert truth.time == EPOCH
    np.testing.assert_array_equal(truth.state_gcrf("chief"), CHIEF)


def test_spacecraft_must_be_there_and_be_told_apart() -> None:
    with pytest.raises(ValueError, match="at least the chief"):
        FormationTruth(EPOCH, [], ForceModel())
    with pytest.raises(ValueError, match="not unique: chief, chief"):
        FormationTruth(EPOCH, [("chief", CHIEF), ("chief", CHIEF)], ForceModel())


@pytest.mark.parametrize("thrust_rtn", [None, [1.4, -1.4, 0.6]])
def test_extrapolated_motion_meets_the_truth_after_a_step(thrust_rtn: list[float] | None) -> None:
    truth = formation()
    motion = truth.motion_itrf("deputy_1", thrust_rtn)
    at_start = state_gcrf_to_itrf(truth.time, truth.state_gcrf("deputy_1"))
    np.testing.assert_allclose(motion[:2].ravel(), at_start, atol=1e-8)
    powers = np.array([1.0, 1.0, 0.5, 1.0 / 6.0])
    position = powers @ motion
    velocity = np.array([1.0, 1.0, 0.5]) @ motion[1:]
    truth.advance({} if thrust_rtn is None else {"deputy_1": thrust_rtn})
    after = state_gcrf_to_itrf(truth.time, truth.state_gcrf("deputy_1"))
    np.testing.assert_allclose(position, after[:3], atol=2e-6)
    np.testing.assert_allclose(velocity, after[3:], atol=1e-5)


def test_euler_motion_has_no_derivatives() -> None:
    truth = formation("euler")
    motion = truth.motion_itrf("deputy_1", [1.0, 0.0, 0.0])
    at_start = state_gcrf_to_itrf(truth.time, truth.state_gcrf("deputy_1"))
    np.testing.assert_allclose(motion[:2].ravel(), at_start, atol=1e-8)
    np.testing.assert_array_equal(motion[2:], np.zeros((2, 3)))
    truth.advance()
    after = state_gcrf_to_itrf(truth.time, truth.state_gcrf("deputy_1"))
    # The Coriolis term is what remains; with the curvature of the orbit it would be 4 m.
    assert np.linalg.norm(motion[0] + motion[1] - after[:3]) < 0.6


def test_thrust_along_body_axes_that_are_known_perfectly_flies_as_that_in_rtn() -> None:
    """The controller's vector goes into the body by the attitude, and out of it by the same."""
    in_rtn, in_body = formation(), formation()
    generator = np.random.default_rng(7)
    for second in range(600):
        thrust = 1e-2 * generator.standard_normal(3)
        to_rtn = rotation_gcrf_to_rtn(in_body.state_gcrf("chief"))
        turn = from_rotation_vector(second * np.array([1e-2, -2e-2, 5e-3]))
        to_gcrf = rotation_matrix(turn)
        in_rtn.advance({"deputy_1": thrust})
        in_body.advance({"deputy_1": (to_rtn @ to_gcrf).T @ thrust}, {"deputy_1": to_gcrf})
    difference = in_body.state_gcrf("deputy_1") - in_rtn.state_gcrf("deputy_1")
    moved = in_rtn.state_gcrf("deputy_1") - formation().state_gcrf("deputy_1")
    assert np.linalg.norm(moved[:3]) > 1e6
    # Rounding of positions of 7e6 m, 1e-9 m in each of 600 steps.
    assert np.abs(difference[:3]).max() < 1e-6
    assert np.abs(difference[3:]).max() < 1e-9

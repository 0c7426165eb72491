"""The closed loop against the numbers of the paper (appendix A, section 4.1)."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vtff_analysis.closed_loop.simulation import (
    ClosedLoopResult,
    DeputyHistory,
    simulate_closed_loop,
)
from vtff_control.tracking.sdre import SdreDesign
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_sim_bridge.truth.scenario import Scenario, Spacecraft, load_scenario

SCENARIOS = Path(__file__).resolve().parents[4] / "config" / "scenario"


@pytest.fixture(scope="module")
def reference() -> Scenario:
    return load_scenario(SCENARIOS / "reference.yaml")


@pytest.fixture(scope="module")
def remote_sensing() -> Scenario:
    return load_scenario(SCENARIOS / "remote_sensing.yaml")


@pytest.fixture(scope="module")
def paper_run(reference: Scenario) -> ClosedLoopResult:
    return simulate_closed_loop(reference, SdreDesign("paper", acceleration_cap=1.4))


@pytest.fixture(scope="module")
def paper_remote_sensing(remote_sensing: Scenario) -> ClosedLoopResult:
    return simulate_closed_loop(remote_sensing, SdreDesign("paper", acceleration_cap=1.0))


def steady_error(result: ClosedLoopResult, start: float, end: float) -> np.ndarray:
    """Deviation from the target position between two times, shape (n, 3)."""
    history = result.deputy()
    keeping = (result.time >= start) & (result.time <= end)
    return history.state_relative_rtn[keeping, :3] - history.target_rtn[:3]


def test_paper_design_comes_as_near_as_in_the_paper(paper_run: ClosedLoopResult) -> None:
    minimum, time = paper_run.minimum_in_track()
    assert minimum == pytest.approx(38.2, abs=0.5)
    assert 54.0 <= time <= 56.0


def test_paper_design_uses_the_thrust_of_the_paper(paper_run: ClosedLoopResult) -> None:
    radial, in_track, cross_track = paper_run.total_delta_v()
    assert radial == pytest.approx(2.48, rel=0.03)
    assert in_track == pytest.approx(75.47, rel=0.003)
    assert cross_track < 1e-3


def test_paper_design_keeps_the_formation(paper_run: ClosedLoopResult) -> None:
    assert paper_run.settling_time(1.0) <= 124.0
    assert np.abs(steady_error(paper_run, 300.0, 3600.0)).max() < 0.01


def test_the_force_model_does_not_matter_at_this_distance(
    reference: Scenario, paper_run: ClosedLoopResult
) -> None:
    two_body = dataclasses.replace(reference, force_model=ForceModel(gravity="two_body"))
    result = simulate_closed_loop(two_body, SdreDesign("paper", acceleration_cap=1.4), duration=200)
    difference = (
        result.deputy().state_relative_rtn[:, 1] - paper_run.deputy().state_relative_rtn[:201, 1]
    )
    assert np.abs(difference).max() < 0.02


def test_delay_and_timing_of_the_loop(paper_run: ClosedLoopResult) -> None:
    history = paper_run.deputy()
    np.testing.assert_array_equal(history.applied_rtn[0], np.zeros(3))
    np.testing.assert_array_equal(history.applied_rtn[1:], history.command_rtn[:-1])
    assert paper_run.time.shape == (3601,) and history.state_relative_rtn.shape == (3601, 6)


def test_thrust_is_held_inertially_in_the_axes_of_the_step_in_which_it_acts(
    reference: Scenario, paper_run: ClosedLoopResult
) -> None:
    history = paper_run.deputy()
    chief, deputy = (
        Propagator(reference.epoch, craft.state_gcrf, reference.force_model)
        for craft in reference.spacecraft
    )
    for step in range(60):
        axes = rotation_gcrf_to_rtn(chief.state_gcrf)
        deputy.advance(axes.T @ history.applied_rtn[step])
        chief.advance()
        relative = relative_state_rtn(chief.state_gcrf, deputy.state_gcrf)
        np.testing.assert_allclose(relative, history.state_relative_rtn[step + 1], atol=1e-8)


@pytest.mark.parametrize(("delay_steps", "minimum"), [(0, 63.3), (2, -14.7)])
def test_the_delay_makes_the_paper_s_overshoot(
    reference: Scenario, delay_steps: int, minimum: float
) -> None:
    result = simulate_closed_loop(
        reference,
        SdreDesign("paper", acceleration_cap=1.4),
        {"delay_steps": delay_steps},
        duration=150.0,
    )
    assert result.minimum_in_track()[0] == pytest.approx(minimum, abs=0.5)


def test_delay_aware_beats_the_paper_on_all_counts(reference: Scenario) -> None:
    result = simulate_closed_loop(reference, SdreDesign("delay_aware", acceleration_cap=1.4))
    assert result.minimum_in_track()[0] >= 95.0
    assert result.settling_time(1.0) <= 110.0
    assert result.total_delta_v()[1] <= 62.0


def test_remote_sensing_totals(paper_remote_sensing: ClosedLoopResult) -> None:
    radial, in_track, cross_track = paper_remote_sensing.total_delta_v()
    assert radial == pytest.approx(27.8, rel=0.02)
    assert in_track == pytest.approx(6.2, rel=0.05)
    assert cross_track < 0.05


def test_remote_sensing_is_reached_before_the_paper_s_98_seconds(
    paper_remote_sensing: ClosedLoopResult,
) -> None:
    assert paper_remote_sensing.settling_time(1.0) <= 98.0


def test_eccentricity_leaves_a_radial_error(paper_remote_sensing: ClosedLoopResult) -> None:
    radial = steady_error(paper_remote_sensing, 600.0, 3600.0)[:, 0]
    assert abs(radial.mean()) == pytest.approx(0.32, abs=0.02)


@pytest.mark.parametrize("gravity", ["spherical_harmonics", "two_body"])
def test_feedforward_removes_it_at_the_same_thrust(
    remote_sensing: Scenario, paper_remote_sensing: ClosedLoopResult, gravity: str
) -> None:
    scenario = dataclasses.replace(remote_sensing, force_model=ForceModel(gravity=gravity))
    design = SdreDesign(
        "paper",
        acceleration_cap=1.0,
        feedforward=True,
        feedforward_gravity="two_body" if gravity == "two_body" else "j2",
    )
    result = simulate_closed_loop(scenario, design)
    # Two-body is what the feedforward models; against 8x8 harmonics 4 mm remain cross-track.
    bound = 1e-4 if gravity == "two_body" else 5e-3
    assert np.abs(steady_error(result, 600.0, 3600.0)).max() < bound
    np.testing.assert_allclose(
        result.total_delta_v()[:2], paper_remote_sensing.total_delta_v()[:2], rtol=0.01
    )


@pytest.mark.parametrize(("feedforward", "reduced"), [(False, False), (True, True)])
def test_state_dependence_alone_does_not_remove_it(
    remote_sensing: Scenario,
    paper_remote_sensing: ClosedLoopResult,
    feedforward: bool,
    reduced: bool,
) -> None:
    design = SdreDesign("state_dependent", acceleration_cap=1.0, feedforward=feedforward)
    result = simulate_closed_loop(remote_sensing, design, duration=900.0)
    radial = steady_error(result, 300.0, 900.0)[:, 0]
    radial_paper = steady_error(paper_remote_sensing, 300.0, 900.0)[:, 0]
    if reduced:
        assert np.abs(radial).max() < 5e-3
    else:
        np.testing.assert_allclose(radial, radial_paper, rtol=0.01)


def test_two_runs_are_equal_to_the_last_bit(reference: Scenario) -> None:
    design = SdreDesign("delay_aware", acceleration_cap=1.4, feedforward=True)
    first, second = (
        simulate_closed_loop(reference, design, duration=60.0).deputy() for _ in range(2)
    )
    assert first.state_relative_rtn.tobytes() == second.state_relative_rtn.tobytes()
    assert first.applied_rtn.tobytes() == second.applied_rtn.tobytes()


@pytest.mark.parametrize(
    ("deviation", "settled"),
    [
        ([5.0, 2.0, 0.5, 0.9], 2.0),
        ([0.5, 5.0, 0.5, 0.9], 2.0),
        ([0.5, 0.2, 1.0, 0.9], 0.0),
        ([5.0, 0.1, 0.1, 1.1], np.inf),
        ([5.0, 5.0, 5.0, 0.1], 3.0),
    ],
)
def test_settling_time_is_when_the_target_is_kept_to_the_end(
    deviation: list[float], settled: float
) -> None:
    target = np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0])
    states = np.tile(target, (4, 1))
    states[:, 2] += deviation
    history = DeputyHistory(states, target, np.zeros((3, 3)), np.zeros((3, 3)))
    result = ClosedLoopResult(np.arange(4.0), np.zeros((4, 6)), {"deputy": history})
    assert result.settling_time(1.0) == settled


def test_every_deputy_with_a_target_is_controlled_on_its_own(reference: Scenario) -> None:
    other = Spacecraft(
        "deputy_2", "deputy", reference.deputies[0].state_gcrf, np.array([0, -80.0, 0, 0, 0, 0])
    )
    idle = dataclasses.replace(other, name="deputy_3", target_rtn=None)
    scenario = dataclasses.replace(reference, spacecraft=(*reference.spacecraft, other, idle))
    design = SdreDesign("delay_aware", acceleration_cap=1.4)
    result = simulate_closed_loop(scenario, design, duration=150.0)
    alone = simulate_closed_loop(reference, design, duration=150.0)
    assert list(result.deputies) == ["deputy", "deputy_2"]
    np.testing.assert_array_equal(
        result.deputy("deputy").state_relative_rtn, alone.deputy().state_relative_rtn
    )
    assert result.deputy("deputy_2").state_relative_rtn[-1, 1] == pytest.approx(-80.0, abs=0.5)


def test_thruster_parameters_are_used(reference: Scenario) -> None:
    design = SdreDesign("paper", acceleration_cap=1.4)
    thruster = {"acceleration_cap": 0.8, "quantum": 0.1}
    history = simulate_closed_loop(reference, design, thruster, duration=60.0).deputy()
    assert np.abs(history.command_rtn).max() == 1.4
    assert np.abs(history.applied_rtn).max() == pytest.approx(0.8)
    multiple = history.applied_rtn / 0.1
    np.testing.assert_allclose(multiple, np.rint(multiple), atol=1e-9)


def test_what_cannot_be_flown_is_refused(reference: Scenario) -> None:
    with pytest.raises(ValueError, match="sample_time"):
        simulate_closed_loop(reference, SdreDesign(sample_time=2.0))
    with pytest.raises(ValueError, match="duration"):
        simulate_closed_loop(reference, SdreDesign(), duration=0.1)
    without = tuple(dataclasses.replace(craft, target_rtn=None) for craft in reference.spacecraft)
    with pytest.raises(ValueError, match="no deputy has a target"):
        simulate_closed_loop(dataclasses.replace(reference, spacecraft=without), SdreDesign())

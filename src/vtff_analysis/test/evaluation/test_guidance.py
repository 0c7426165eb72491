"""Phases of a guided flight: spans, what each cost, how near the spacecraft came."""

import numpy as np
import pytest

from vtff_analysis.evaluation.guidance import phases_of, smallest_distance, summarise_guidance
from vtff_analysis.recordings.guidance import GuidanceHistory
from vtff_analysis.recordings.history import DeputyHistory, RelativeStateHistory, RunHistory

SECOND = 10**9


def history(modes, formations, closest):
    """Three spacecraft in line; the chief spends 1 mm/s a step, bravo 2, charlie 3."""
    count = len(modes)
    position = np.zeros((count, 3, 3))
    position[:, 1, 1], position[:, 2, 1] = 20.0, -30.0
    spent = 1e-3 * np.arange(1, count + 1)[:, None] * [1.0, 2.0, 3.0]
    return GuidanceHistory(
        time=SECOND * np.arange(count),
        spacecraft=("alpha", "bravo", "charlie"),
        mode=np.array(modes),
        formation=tuple(formations),
        reason=("",) * count,
        closest_approach=np.array(closest, dtype=float),
        position_rtn=position,
        velocity_change=spent,
    )


def test_phases_have_their_own_cost_and_distance():
    nan = np.nan
    guidance = history([1, 1, 2, 2, 2, 1], ["a", "a", "b", "b", "b", "b"], [nan, nan, 9, 9, 9, nan])
    flown = guidance.position_rtn.copy()
    flown[3, 1, 1] = 10.5  # bravo is 10.5 m from the chief once
    phases = phases_of(guidance, flown)
    assert [(p.mode, p.formation) for p in phases] == [
        ("keep", "a"), ("reconfigure", "b"), ("keep", "b"),
    ]  # fmt: skip
    assert [(p.first // SECOND, p.last // SECOND) for p in phases] == [(0, 1), (2, 4), (5, 5)]
    assert phases[1].velocity_change == pytest.approx(
        {"alpha": 3e-3, "bravo": 6e-3, "charlie": 9e-3}
    )
    total = sum(sum(phase.velocity_change.values()) for phase in phases)
    assert total == pytest.approx(guidance.velocity_change[-1].sum())
    assert np.isnan(phases[0].planned_closest) and phases[1].planned_closest == 9.0
    assert [p.flown_closest for p in phases] == pytest.approx([20.0, 10.5, 20.0])
    assert phases[1].deviation == pytest.approx({"bravo": 9.5 / np.sqrt(3.0), "charlie": 0.0})


def test_smallest_distance_is_that_of_any_pair():
    positions = np.array([[[0, 0, 0], [100, 0, 0], [100, 3, 4]], [[0, 0, 0], [1, 0, 0], [9, 9, 9]]])
    np.testing.assert_allclose(smallest_distance(positions.astype(float)), [5.0, 1.0])


def test_steps_without_states_cost_no_phase():
    guidance = history([0, 0], ["", ""], [np.nan, np.nan])
    (phase,) = phases_of(guidance, np.full((2, 3, 3), np.nan))
    assert np.isnan(phase.flown_closest) and phase.deviation == {}


def test_the_summary_is_of_the_last_phase_and_of_the_whole_flight():
    nan = np.nan
    guidance = history([1, 1, 2, 2, 1, 1], [*"aabbbb"], [nan, nan, 9, 9, nan, nan])
    deputies = {}
    for column, name in enumerate(guidance.spacecraft[1:], 1):
        position = guidance.position_rtn[:, column].copy()
        position[4:, 2] += 0.01 * column  # cross-track, in the last phase
        states = RelativeStateHistory(guidance.time, position, np.zeros_like(position))
        deputies[name] = DeputyHistory(name, truth=states)
    run = RunHistory(0, 5 * SECOND, {}, deputies=deputies, guidance=guidance)
    summary = summarise_guidance(run)
    assert summary["guidance_last_phase"] == "keep b"
    assert summary["guidance_last_phase_start_time_s"] == 4.0
    assert summary["guidance_last_phase_deviation_rms_m"] == pytest.approx(0.02)
    assert summary["guidance_closest_m"] == pytest.approx(20.0)
    assert summary["guidance_planned_closest_m"] == 9.0
    assert summary["guidance_delta_v_m_per_s"] == pytest.approx(0.036)
    assert summarise_guidance(RunHistory(0, 1, {})) == {}

"""Summaries of synthetic runs whose numbers are known beforehand."""

import numpy as np
import pytest

from vtff_analysis.evaluation.formation_flight import formation_flight
from vtff_analysis.evaluation.gnss_summary import summarise_receiver
from vtff_analysis.evaluation.summary import summarise_flight, summarise_run
from vtff_analysis.recordings.history import (
    AccelerationHistory,
    DeputyHistory,
    ReceiverHistory,
    RelativeStateHistory,
    RunHistory,
    SimulatorReport,
)
from vtff_analysis.recordings.settings import ControllerSettings, RunSettings

START = 1_458_522_000_000_000_000
SECOND = 1_000_000_000
TARGET = ControllerSettings(target_position_rtn=np.array([0.0, 100.0, 0.0]))


def times(count, first=0):
    return START + (first + np.arange(count, dtype=np.int64)) * SECOND


def states(position_rtn, first=0):
    position_rtn = np.asarray(position_rtn, dtype=float)
    return RelativeStateHistory(
        times(len(position_rtn), first), position_rtn, np.zeros_like(position_rtn)
    )


def thrust(acceleration_rtn, first=0):
    acceleration_rtn = np.asarray(acceleration_rtn, dtype=float)
    return AccelerationHistory(times(len(acceleration_rtn), first), acceleration_rtn)


def approach(count):
    """In-track 1000 m, but 40 m at 50 s, and 100 m with +-0.5 m from 110 s on."""
    position = np.zeros((count, 3))
    position[:, 1] = 1000.0
    position[50:51, 1] = 40.0
    position[110:, 1] = 100.0 + 0.5 * (-1.0) ** np.arange(len(position[110:]))
    return position


def test_keeping_phase_and_minimum():
    history = DeputyHistory(
        "deputy", truth=states(approach(326)), command=thrust(np.zeros((325, 3)))
    )
    summary = summarise_flight(formation_flight(history, TARGET))
    assert summary["minimum_in_track_m"] == 40.0
    assert summary["minimum_in_track_time_s"] == 50.0
    assert summary["minimum_separation_time_s"] == 50.0
    assert summary["keeping_start_time_s"] == 125.0
    assert summary["settling_time_s"] == 110.0
    assert summary["settling_time_radial_s"] == 0.0
    assert summary["keeping_in_track_maximum_m"] == 100.5
    assert summary["keeping_in_track_minimum_m"] == 99.5
    assert summary["keeping_in_track_rms_m"] == pytest.approx(0.5)
    assert summary["keeping_in_track_standard_deviation_m"] == pytest.approx(0.5, rel=1e-4)


def test_rms_is_about_the_target_not_about_the_mean():
    position = np.tile([0.3, 100.0, 0.0], (200, 1))
    summary = summarise_flight(formation_flight(DeputyHistory("d", truth=states(position)), TARGET))
    assert summary["keeping_radial_rms_m"] == pytest.approx(0.3)
    assert summary["keeping_radial_standard_deviation_m"] == pytest.approx(0.0, abs=1e-12)


def test_delta_v_by_phase_counts_only_what_acts_within_the_run():
    # Commands from 0 s on, thrust of 0.5 m/s2 from 1 s on, one beyond the end of the run.
    applied = np.tile([0.0, -0.5, 0.25], (200, 1))
    history = DeputyHistory(
        "deputy",
        truth=states(np.zeros((201, 3))),
        command=thrust(applied),
        applied=thrust(applied, first=1),
    )
    summary = summarise_flight(formation_flight(history))
    # Starts 1..199 s lie within the run of 200 s; 1..124 s in the acquisition.
    assert summary["delta_v_total_in_track_m_per_s"] == pytest.approx(0.5 * 199)
    assert summary["delta_v_acquisition_in_track_m_per_s"] == pytest.approx(0.5 * 124)
    assert summary["delta_v_keeping_in_track_m_per_s"] == pytest.approx(0.5 * 75)
    assert summary["delta_v_total_cross_track_m_per_s"] == pytest.approx(0.25 * 199)
    assert summary["delta_v_total_radial_m_per_s"] == 0.0
    assert summary["peak_acceleration_in_track_m_per_s2"] == 0.5


def test_settled_keeping_leaves_out_the_tail_of_the_acquisition():
    position = np.tile([0.3, 100.0, -0.1], (1001, 1))
    position[640:] = [0.001, 100.0, 0.002]
    applied = np.tile([0.0, -0.5, 0.25], (1000, 1))
    applied[640:] = [1e-6, 0.0, -2e-6]
    command = np.zeros((1000, 3))
    command[40:] = 0.1
    history = DeputyHistory(
        "deputy", truth=states(position), command=thrust(command), applied=thrust(applied)
    )
    summary = summarise_flight(formation_flight(history, TARGET))
    # Control starts at 40 s, so from 640 s on.
    assert summary["settled_keeping_radial_rms_m"] == pytest.approx(0.001)
    assert summary["settled_keeping_cross_track_rms_m"] == pytest.approx(0.002)
    assert summary["settled_keeping_delta_v_m_per_s_per_h"] == pytest.approx(3e-6 * 3600.0)
    assert summary["keeping_radial_rms_m"] > 0.1
    short = DeputyHistory("deputy", truth=states(position[:640]), command=thrust(command))
    assert not any("settled_k" in key for key in summarise_flight(formation_flight(short, TARGET)))


def test_phase_boundary_counts_from_the_first_command():
    history = DeputyHistory(
        "deputy", truth=states(approach(400)), command=thrust(np.zeros((300, 3)), first=30)
    )
    flight = formation_flight(history, TARGET)
    assert flight.keeping_start == 155.0
    assert flight.time[flight.keeping][0] == 155.0


def test_the_phase_begins_when_the_controller_does_not_when_navigation_starts():
    command = np.zeros((325, 3))
    command[60:] = 0.1
    history = DeputyHistory("deputy", truth=states(approach(326)), command=thrust(command))
    assert formation_flight(history, TARGET).keeping_start == 185.0


def test_short_run_has_no_keeping_keys():
    history = DeputyHistory("deputy", truth=states(approach(60)), applied=thrust(np.ones((60, 3))))
    summary = summarise_flight(formation_flight(history, TARGET))
    assert not [key for key in summary if key.startswith(("keeping_in", "delta_v_keeping"))]
    assert summary["delta_v_acquisition_radial_m_per_s"] == pytest.approx(59.0)
    assert summary["settling_time_s"] is None
    assert summary["minimum_in_track_m"] == 40.0


def test_published_target_replaces_the_configured_one_from_its_time_on():
    position = np.zeros((200, 3))
    position[:150, 1], position[150:, 1] = 100.0, 300.0
    history = DeputyHistory(
        "deputy", truth=states(position), target=states([[0.0, 300.0, 0.0]], first=150)
    )
    flight = formation_flight(history, TARGET)
    assert np.all(flight.deviation_rtn == 0.0)
    assert summarise_flight(flight)["target_in_track_m"] == 300.0


def test_no_target_gives_no_deviation():
    summary = summarise_flight(formation_flight(DeputyHistory("d", truth=states(approach(200)))))
    assert "keeping_in_track_mean_m" in summary
    assert "keeping_in_track_rms_m" not in summary
    assert "settling_time_s" not in summary


def test_deputy_without_states_has_no_flight():
    assert formation_flight(DeputyHistory("d", applied=thrust(np.ones((5, 3))))) is None


def run_of(deputies):
    flights = {name: formation_flight(deputy, TARGET) for name, deputy in deputies.items()}
    history = RunHistory(
        START,
        START + 200 * SECOND,
        {"/deputy/relative_state_truth": 402},
        deputies,
        simulator=SimulatorReport("reference", "lockstep", True, 200.0, 0, float("inf")),
    )
    return summarise_run(history, RunSettings(seed=7), flights)


def test_one_deputy_has_no_prefix_and_two_have():
    one = DeputyHistory("deputy", truth=states(approach(201)))
    two = DeputyHistory("wing/left", truth=states(approach(201) + 5.0))
    assert run_of({"deputy": one})["minimum_in_track_m"] == 40.0
    both = run_of({"deputy": one, "wing/left": two})
    assert both["deputy_minimum_in_track_m"] == 40.0
    assert both["wing_left_minimum_in_track_m"] == 45.0
    assert "minimum_in_track_m" not in both


def test_run_keys():
    summary = run_of({"deputy": DeputyHistory("deputy", truth=states(approach(201)))})
    assert summary["run_seed"] == 7
    assert summary["run_start_utc"] == "2016-03-21T01:00:00.000Z"
    assert summary["run_duration_s"] == 200.0
    assert summary["real_time_factor"] is None  # not finite
    assert summary["message_count_deputy_relative_state_truth"] == 402


def test_navigation_error_compares_equal_times():
    truth = states(np.zeros((100, 3)))
    estimate = states(np.tile([0.03, -0.04, 0.0], (50, 1)), first=20)
    summary = run_of(
        {"d": DeputyHistory("d", truth=truth, estimate=estimate, command=thrust([[0, 0, 0]]))}
    )
    assert summary["control_input"] == "navigation"
    assert summary["navigation_error_samples"] == 50
    assert summary["navigation_error_radial_mean_m"] == pytest.approx(0.03)
    assert summary["navigation_error_in_track_rms_m"] == pytest.approx(0.04)
    assert summary["navigation_error_maximum_m"] == pytest.approx(0.05)


def test_the_start_of_navigation_does_not_count_where_the_key_says_so():
    position = np.tile([3e-4, 0.0, 4e-4], (100, 1))
    position[:60] = 1.0
    summary = run_of(
        {"d": DeputyHistory("d", truth=states(np.zeros((100, 3))), estimate=states(position))}
    )
    assert summary["navigation_error_settled_3d_rms_m"] == pytest.approx(5e-4)
    assert summary["navigation_error_settled_3d_rms_m_per_s"] == 0.0
    assert summary["navigation_error_radial_rms_m"] > 0.5


def receiver(epoch_seconds, observations):
    """Epochs that all have the same (system, prn, band, attribute) observations."""
    count = len(epoch_seconds)
    columns = np.tile(np.array(observations, dtype=np.uint8).reshape(-1, 4), (count, 1))
    empty = np.empty(0, np.uint8)
    return ReceiverHistory(
        name="chief",
        epoch_time=START + np.array(epoch_seconds, dtype=np.int64) * SECOND,
        observations_per_epoch=np.full(count, len(observations), dtype=np.int64),
        system=columns[:, 0],
        prn=columns[:, 1],
        band=columns[:, 2],
        attribute=columns[:, 3],
        flags=np.full(len(columns), 16, dtype=np.uint16),
        cn0_dbhz=np.full(len(columns), 45.0, dtype=np.float32),
        fix_time=START + np.arange(3, dtype=np.int64) * SECOND,
        fix_status=np.array([0, 1, 1], dtype=np.uint8),
        ephemeris_system=empty,
        ephemeris_prn=empty,
    )


def test_receiver_counts_signals_satellites_and_gaps():
    observations = [(0, 5, 1, ord("C")), (0, 5, 2, ord("W")), (3, 5, 1, ord("C"))]
    summary = summarise_receiver(receiver([0, 1, 2, 3, 7, 8], observations))
    assert summary["gnss_epochs"] == 6
    assert summary["gnss_time_span_s"] == pytest.approx(8.0)
    assert summary["gnss_gaps"] == 1
    assert summary["gnss_missing_epochs"] == 3
    assert summary["gnss_longest_gap_s"] == pytest.approx(4.0)
    assert summary["gnss_satellites"] == 2
    assert summary["gnss_satellites_gps"] == summary["gnss_satellites_galileo"] == 1
    assert summary["gnss_satellites_per_epoch_mean"] == 2.0
    assert summary["gnss_observations_g1c"] == 6
    assert summary["gnss_observations_g2w"] == 6
    assert summary["gnss_observations_e1c"] == 6
    assert summary["gnss_observations"] == 18
    assert summary["gnss_possible_cycle_slips"] == 18
    assert summary["gnss_fixes"] == 3
    assert summary["gnss_fixes_usable"] == 2
    assert summary["gnss_ephemerides"] == 0


@pytest.mark.parametrize("epoch_seconds", [[], [0]])
def test_receiver_with_hardly_any_epoch(epoch_seconds):
    summary = summarise_receiver(receiver(epoch_seconds, [(0, 5, 1, ord("C"))]))
    assert summary["gnss_epochs"] == len(epoch_seconds)
    assert "gnss_gaps" not in summary

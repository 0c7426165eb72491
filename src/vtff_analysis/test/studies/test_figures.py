"""Names of figures: those of docs/summary.md, no others."""

from __future__ import annotations

import pathlib
import re

import pytest

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_analysis.closed_loop.summary import summarise_closed_loop
from vtff_analysis.studies.figures import (
    FLIGHT_FIGURES,
    NAVIGATION_FIGURES,
    RUN_FIGURES,
    describe_name,
    figure_problem,
    unit_of,
)
from vtff_control.tracking.sdre import SdreDesign
from vtff_sim_bridge.truth.scenario import load_scenario

ROOT = pathlib.Path(__file__).resolve().parents[4]
NOT_FIGURES = {
    *("run_name", "system", "argument_<name>", "run_start_utc", "run_seed", "scenario", "pacing"),
    *("vtff_version", "git_commit", "git_modified", "machine_cpu_model", "machine_cpu_cores"),
    *("machine_python", "machine_platform", "control_input", "controller_design"),
    *("controller_feedforward", "acceleration_cap_m_per_s2", "receivers"),
    *("safety_taken_over_deputies", "safety_reason", "safety_isolated_axes", "attitude_mode"),
    "guidance_last_phase",
}
"""Keys of a summary that say how it was made, or are words."""


def test_every_number_of_the_document_is_a_figure():
    text = (ROOT / "docs" / "summary.md").read_text(encoding="utf-8")
    documented = set()
    for key, meaning in re.findall(r"^\| `([^`]+)` \| (.*) \|$", text, re.MULTILINE):
        if ".png" in key or key in NOT_FIGURES:
            continue
        documented.add(key)
        if "(t)" in meaning:
            documented.add(key.replace("ionosphere_", "ionosphere_true_", 1))
    assert documented == {*FLIGHT_FIGURES, *NAVIGATION_FIGURES, *RUN_FIGURES}


def test_the_closed_loop_has_the_figures_of_a_flight():
    scenario = load_scenario(ROOT / "config" / "scenario" / "reference.yaml")
    result = simulate_closed_loop(scenario, SdreDesign(acceleration_cap=1.4), duration=650.0)
    names = {
        pattern.replace("<axis>", axis)
        for pattern in FLIGHT_FIGURES
        for axis in ("radial", "in_track", "cross_track")
    }
    assert set(summarise_closed_loop(result)) == names


@pytest.mark.parametrize(
    ("figure", "deputies", "library", "problem"),
    [
        ("settling_time_s", ["a"], True, ""),
        ("settling_time_s", ["a", "b"], True, "there is no figure 'settling_time_s'"),
        ("b_settling_time_s", ["a", "b"], False, ""),
        ("a_settling_time_s", ["a"], False, "there is no figure 'a_settling_time_s'"),
        ("chief_gnss_fixes", ["a"], False, ""),
        ("chief_gnss_fixes", ["a"], True, "there is no figure"),
        ("other_gnss_fixes", ["a"], False, "did you mean: chief_gnss_fixes"),
        ("chief_gnss_observations_g1c", ["a"], False, ""),
        ("ionosphere_true_lag_s", ["a"], False, ""),
        ("ionosphere_lags", ["a"], False, "did you mean: ionosphere_lag_s"),
        ("message_count_sim_status", ["a"], False, ""),
        ("pair_a_b_error_settled_nees", ["a", "b"], False, ""),
        ("pair_a_c_error_settled_nees", ["a", "b"], False, "did you mean: pair_a_b_error_settled"),
        ("b_safety_taken_over_time_s", ["a", "b"], False, ""),
    ],
)
def test_a_name_that_no_run_has_is_refused(figure, deputies, library, problem):
    found = figure_problem(figure, ["chief", *deputies], deputies, library=library)
    assert (problem in found) if problem else (found == "")


@pytest.mark.parametrize(
    ("figure", "unit"),
    [
        ("delta_v_total_radial_m_per_s", "m/s"),
        ("peak_acceleration_radial_m_per_s2", "m/s²"),
        ("settling_time_s", "s"),
        ("final_radial_m", "m"),
        ("message_count", ""),
        ("settled_keeping_delta_v_m_per_s_per_h", "m/s per h"),
        ("survey_drift_m_s", "m/s"),
        ("attitude_wheel_lowest_rpm", "rpm"),
        ("attitude_dipole_error_rms_a_m2", "A m²"),
    ],
)
def test_units_come_from_names(figure, unit):
    assert unit_of(figure) == unit


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("settling_time_s", "settling time"),
        ("delta_v_total_in_track_m_per_s", "velocity change total in-track"),
        ("navigation_error_settled_3d_rms_m", "navigation error settled 3-D RMS"),
        ("navigation_error_settled_nees", "navigation error settled NEES"),
        ("survey_edges_2km", "survey edges 2 km apart"),
        ("thrust_cap", "thrust cap"),
    ],
)
def test_names_have_words(name, words):
    assert describe_name(name) == words


def test_the_words_of_two_figures_differ():
    """In a campaign they are told apart by their words and units."""
    names = [*FLIGHT_FIGURES, *NAVIGATION_FIGURES, *RUN_FIGURES]
    shown = {(describe_name(name), unit_of(name)) for name in names}
    assert len(shown) == len(names)

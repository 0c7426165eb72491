"""The verdict of a run: chosen by what it was about, in fitting units, and never misleading."""

from __future__ import annotations

import pytest

from vtff_analysis.report.verdict import find_verdict, subject_of

FORMATION = {
    "run_duration_s": 3600.0,
    "scenario": "reference",
    "receivers": "emulated",
    "argument_gnss": "/somewhere/gnss/reference.yaml",
    "run_seed": 7,
    "message_count": 210353,
    "control_input": "navigation",
    "minimum_separation_m": 96.8,
    "settling_time_s": 99.0,
    "keeping_start_time_s": 125.0,
    "keeping_radial_rms_m": 3e-3,
    "keeping_in_track_rms_m": 4e-3,
    "keeping_cross_track_rms_m": 0.0,
    "settled_keeping_radial_rms_m": 0.3e-3,
    "settled_keeping_in_track_rms_m": 0.4e-3,
    "settled_keeping_cross_track_rms_m": 0.0,
    "settled_keeping_delta_v_m_per_s_per_h": 0.005,
    "truth_fed_settled_keeping_radial_rms_m": 0.02e-3,
    "navigation_error_samples": 3601,
    "navigation_error_settled_samples": 3541,
    "navigation_error_settled_3d_rms_m": 0.25e-3,
    "navigation_error_settled_nees": 0.9,
    "chief_gnss_epochs": 3601,
}

#: Figures of a flight 15 km behind the chief through an irregularity, with the controller.
IONOSPHERE = {
    **FORMATION,
    "scenario": "esf",
    "minimum_separation_m": 14999.78,
    "ionosphere_chief_bottom_altitude_m": 289996.0,
    "ionosphere_true_chief_bottom_altitude_m": 290000.0,
    "ionosphere_chief_top_altitude_m": 350020.0,
    "ionosphere_true_chief_top_altitude_m": 350000.0,
    "ionosphere_chief_slant_tec_error_rms_tecu": 0.24,
}


def figures(verdict):
    return {figure.label: figure for figure in verdict.figures}


def says(sentence, *parts):
    """Return whether a sentence has these numbers and names; its words are free."""
    return all(part in sentence for part in parts)


def test_a_formation_is_told_in_millimetres_beside_paper_and_truth():
    verdict = find_verdict(FORMATION, ["deputy"])
    assert verdict.subject == "formation" and verdict.is_good
    assert says(verdict.sentence, "0.300", "0.400", " mm")
    radial = figures(verdict)["keeping, radial"]
    assert (radial.measured, radial.paper, radial.bound) == ("0.300 mm", "", "0.0200 mm")
    assert figures(verdict)["fuel for keeping"].measured == "120 mm/s per day"
    assert says(verdict.conditions, "3600 s", "emulated", "'reference'", "seed 7")


def test_the_paper_is_compared_over_its_own_span():
    """The paper's statistics begin at 125 s: those of a settled formation are no match for them."""
    verdict = find_verdict(FORMATION, ["deputy"])
    # The paper's hardware kept 490, 190 and 180 mm: 555.5 mm together, here 5 mm.
    assert says(verdict.sentence, "125 s", "5.00 mm", "emulated", "556 mm", "paper", "110 times")
    radial = figures(verdict)["from 125 s on, radial"]
    assert (radial.measured, radial.paper, radial.ratio) == (
        "3.00 mm",
        "490 mm",
        "160 times smaller",
    )
    short = {key: value for key, value in FORMATION.items() if "settled_keeping" not in key}
    assert "paper" not in find_verdict(short, ["deputy"]).sentence
    real = find_verdict({**FORMATION, "receivers": "real"}, ["deputy"])
    assert says(real.sentence, "5.00 mm", "556 mm") and "emulated" not in real.sentence


def test_a_run_that_was_asked_to_end_before_it_could_settle_is_not_blamed():
    short = {key: value for key, value in FORMATION.items() if "keeping_" not in key}
    short.update(run_duration_s=60.0, keeping_start_time_s=125.0, settling_time_s=None)
    for axis, first, last in (("radial", 0, 3), ("in_track", 1000, 104), ("cross_track", 0, 0)):
        target = 100.0 if axis == "in_track" else 0.0
        short.update({f"initial_{axis}_m": float(first), f"final_{axis}_m": float(last)})
        short[f"target_{axis}_m"] = target
    sentence = find_verdict(short, ["deputy"]).sentence
    assert says(sentence, "60 s", "acquisition", "deputy", "5.00 m", "900 m")
    long = find_verdict({**short, "run_duration_s": 300.0}, ["deputy"]).sentence
    assert says(long, "300 s", "within 1 m", "deputy", "5.00 m") and "acquisition" not in long


def test_an_ionosphere_that_ended_early_is_not_told_as_a_formation_15_km_away():
    early = {key: value for key, value in IONOSPHERE.items() if "ionosphere" not in key}
    verdict = find_verdict({**early, "ionosphere_vertical_edges": 0}, ["deputy"])
    assert verdict.subject == "ionosphere" and "no receiver bias" in verdict.sentence
    assert "closest" not in " ".join(figures(verdict))


@pytest.mark.parametrize(("system", "printed"), [("laser", "2.10 mm"), ("reference", "10.7 mm")])
def test_navigation_with_a_laser_stands_beside_that_of_its_paper(system, printed):
    laser = {key: value for key, value in FORMATION.items() if key != "control_input"}
    laser |= {"scenario": "laser_250m", "system": f"/somewhere/{system}.yaml"}
    verdict = find_verdict(laser, ["deputy"])
    assert verdict.subject == "navigation"
    assert says(verdict.sentence, "0.250 mm", "3-D RMS", printed)
    assert figures(verdict)["navigation, 3-D RMS error after 60 s"].paper == printed


def test_a_spacecraft_that_still_tumbles_is_told_with_its_rate():
    summary = {
        "run_duration_s": 1500.0,
        "attitude_mode": "detumble",
        "attitude_point_time_s": None,
        "attitude_first_rate_deg_per_s": 25.1,
        "attitude_last_rate_deg_per_s": 24.9,
    }
    sentence = find_verdict(summary, []).sentence
    assert says(sentence, "detumble", "24.9 deg/s", "25.1")


def test_a_covariance_is_not_judged_by_a_few_epochs():
    summary = {**FORMATION, "navigation_error_settled_samples": 1}
    sentence = find_verdict({**summary, "navigation_error_settled_nees": 1.78}, ["deputy"]).sentence
    assert says(sentence, "one epoch", "60 s") and "too small" not in sentence


def test_a_run_through_an_ionosphere_is_about_the_ionosphere():
    """One of the misleading cases: its cards told a closest approach of 14999.78 m."""
    verdict = find_verdict(IONOSPHERE, ["deputy"])
    assert verdict.subject == "ionosphere"
    assert "20.0 m" in verdict.sentence
    shown = " ".join([verdict.sentence, *(f"{f.label} {f.measured}" for f in verdict.figures)])
    assert "14999" not in shown and "closest" not in shown and "210353" not in shown
    assert figures(verdict)["lower edge at the chief"].bound == "290.000 km"


@pytest.mark.parametrize(
    ("nees", "said"), [(0.3, "too large"), (0.6, "honest"), (1.4, "honest"), (2.0, "too small")]
)
def test_the_stated_covariance_is_judged(nees, said):
    summary = {**FORMATION, "navigation_error_settled_nees": nees}
    assert says(find_verdict(summary, ["deputy"]).sentence, said, f"NEES {nees:.2f}")


def test_a_deputy_that_was_taken_over_is_said_first():
    summary = {**IONOSPHERE, "safety_taken_over_time_s": 12.0}
    verdict = find_verdict(summary, ["deputy"])
    assert not verdict.is_good
    assert says(verdict.sentence.partition(".")[0], "safety", "deputy", "12 s")
    assert find_verdict({**summary, "safety_taken_over_time_s": None}, ["deputy"]).is_good


def test_a_run_that_was_ended_early_is_said():
    verdict = find_verdict({**FORMATION, "run_complete": False}, ["deputy"])
    assert not verdict.is_good and "before its planned end" in verdict.sentence


@pytest.mark.parametrize(("percent", "is_said"), [(4.0, False), (95.0, True)])
def test_an_algorithm_slower_than_real_time_is_said(percent, is_said):
    numbers = {**FORMATION, "late_calls_percent": percent, "late_calls_longest_s": 3.02}
    verdict = find_verdict(numbers, ("deputy",))
    assert says(verdict.sentence, "95 %", "3.0") == is_said
    assert verdict.is_good != is_said


def test_several_deputies_have_their_own_figures():
    summary = {"run_duration_s": 100.0, "message_count": 5}
    for name, error in (("bravo", 2e-3), ("charlie", 3.0)):
        summary[f"{name}_control_input"] = "navigation"
        summary[f"{name}_settling_time_s"] = None
        summary[f"{name}_navigation_error_settled_3d_rms_m"] = error
    verdict = find_verdict(summary, ["bravo", "charlie"])
    assert says(verdict.sentence, "bravo", "target")
    label = "navigation, 3-D RMS error after 60 s"
    assert figures(verdict)[f"bravo: {label}"].measured == "2.00 mm"
    assert figures(verdict)[f"charlie: {label}"].measured == "3.00 m"


@pytest.mark.parametrize(
    ("summary", "deputies", "subject"),
    [
        ({"navigation_error_samples": 3}, ["deputy"], "navigation"),
        ({"chief_gnss_epochs": 3}, [], "log"),
        ({"message_count": 3}, [], "messages"),
        ({"ionosphere_density_error_per_cm3": None, "chief_gnss_epochs": 3}, [], "log"),
    ],
)
def test_the_subject_is_what_was_recorded(summary, deputies, subject):
    assert subject_of(summary, deputies) == subject
    complete = {"run_duration_s": 9.0, "message_count": 3, **summary}
    assert find_verdict(complete, deputies).subject == subject


SURVEY = {
    "run_duration_s": 9000.0,
    "scenario": "survey_software",
    "message_count": 3000,
    "control_input": "truth",
    "minimum_separation_m": 304.0,
    "settled_keeping_radial_rms_m": 11.2,
    "survey_walls": 6,
    "survey_edges_two_spacecraft": 12,
    "survey_edges_1km": 6,
    "survey_edges_2km": 5,
    "survey_unsupported_crossings": 1,
    "survey_drift_m_s": 101.4,
    "survey_drift_sigma_m_s": 2.0,
    "survey_true_drift_m_s": 100.0,
    "survey_plans": 1,
    "survey_velocity_change_m_s": 2.8354,
}


def test_a_survey_is_about_edges_and_not_about_a_target():
    verdict = find_verdict(SURVEY, ["deputy"])
    assert verdict.subject == "survey"
    assert says(verdict.sentence, "12 edges", "6 of them", "2.84 m/s")
    assert "target" not in verdict.sentence
    shown = figures(verdict)
    assert (shown["zonal drift, eastward"].measured, shown["zonal drift, eastward"].bound) == (
        "101 ± 2 m/s",
        "100 m/s",
    )
    assert shown["closest to the chief"].measured == "304 m"


def test_a_survey_without_walls_says_so():
    nothing = {**SURVEY, "survey_walls": 0}
    assert "no wall" in find_verdict(nothing, ["deputy"]).sentence


def test_a_guided_formation_is_judged_by_its_phases():
    """Within 1 m of its target says nothing of a formation that is kept to centimetres."""
    summary = {
        **FORMATION,
        "guidance_last_phase": "keep helix",
        "guidance_last_phase_start_time_s": 9000.0,
        "guidance_last_phase_deviation_rms_m": 0.0252,
        "guidance_closest_m": 12.4,
        "guidance_planned_closest_m": 10.21,
        "guidance_delta_v_m_per_s": 0.00179,
    }
    verdict = find_verdict(summary, ["deputy"])
    numbers = ("keep helix", "9000 s", "25.2 mm", "12.4 m", "deputy", "0.250 mm")
    assert says(verdict.sentence, *numbers, "10.2 m")
    assert "paper" not in verdict.sentence and "target" not in verdict.sentence
    assert figures(verdict)["velocity change of all"].measured == "1.79 mm/s"
    unplanned = {**summary, "guidance_planned_closest_m": None}
    sentence = find_verdict(unplanned, ["deputy"]).sentence
    assert says(sentence, *numbers) and "10.2 m" not in sentence and "planned" not in sentence


CLUSTER = {
    "run_duration_s": 16260.0,
    "scenario": "potential_field",
    "message_count": 3000,
    "cluster_equilibrium_m": 864.6,
    "cluster_closest_m": 805.0,
    "cluster_settling_time_s": 4130.0,
    "cluster_settling_delta_v_m_per_s": 22.0,
    "cluster_side_mean_error_percent": 0.5,
    "cluster_side_largest_error_percent": 2.1,
    "cluster_last_orbit_delta_v_m_per_s": 17.0,
}


def test_a_cluster_that_misses_a_bound_is_not_called_good():
    assert find_verdict(CLUSTER, ["a", "b"]).is_good
    near = find_verdict({**CLUSTER, "cluster_closest_m": 480.0}, ["a", "b"])
    assert not near.is_good
    assert says(near.sentence.partition(".")[0], "480 m", "500 m")
    dear = find_verdict({**CLUSTER, "cluster_last_orbit_delta_v_m_per_s": 21.0}, ["a", "b"])
    assert not dear.is_good and says(dear.sentence, "21.0 m/s", "18 m/s")
    assert figures(dear)["last orbit: velocity change, largest"].bound == "18 m/s"


def test_a_receiver_without_observations_is_not_called_complete():
    summary = {"run_duration_s": 9.0, "message_count": 3, "chief_gnss_epochs": 0}
    summary.update(deputy_gnss_epochs=10, deputy_gnss_missing_epochs=0)
    verdict = find_verdict(summary, [])
    assert not verdict.is_good
    chief, deputy = (part for part in verdict.sentence.split(".") if part)
    assert says(chief, "chief", "no observations") and says(deputy, "deputy", "10 epochs")


def test_the_density_of_all_satellites_is_not_set_against_the_papers_of_one():
    summary = {**IONOSPHERE, "scenario": "plumex", "ionosphere_density_error_per_cm3": 3112.0}
    summary["ionosphere_density_error_single_satellite_per_cm3"] = 24472.0
    shown = figures(find_verdict(summary, ["deputy"]))
    together = shown["density of all satellites, mean error"]
    assert (together.measured, together.paper) == ("3110 cm⁻³", "")
    single = shown["density of one satellite, mean error"]
    assert (single.measured, single.paper) == ("24500 cm⁻³", "65600 cm⁻³")

"""Figures that a campaign can keep: the numbers of a run's summary (docs/summary.md)."""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Sequence

__all__ = [
    "FLIGHT_FIGURES",
    "NAVIGATION_FIGURES",
    "RUN_FIGURES",
    "describe_name",
    "figure_problem",
    "unit_of",
]

FLIGHT_FIGURES = (
    "initial_<axis>_m",
    "final_<axis>_m",
    "target_<axis>_m",
    "minimum_in_track_m",
    "minimum_in_track_time_s",
    "minimum_separation_m",
    "minimum_separation_time_s",
    "settling_time_s",
    "settling_time_<axis>_s",
    "keeping_start_time_s",
    "keeping_<axis>_maximum_m",
    "keeping_<axis>_minimum_m",
    "keeping_<axis>_mean_m",
    "keeping_<axis>_rms_m",
    "keeping_<axis>_standard_deviation_m",
    "settled_keeping_<axis>_rms_m",
    "settled_keeping_delta_v_m_per_s_per_h",
    "delta_v_total_<axis>_m_per_s",
    "delta_v_acquisition_<axis>_m_per_s",
    "delta_v_keeping_<axis>_m_per_s",
    "peak_acceleration_<axis>_m_per_s2",
)
"""Figures of positions and thrust: of every run, and of the closed loop without ROS."""

NAVIGATION_FIGURES = (
    "navigation_error_samples",
    "navigation_error_<axis>_mean_m",
    "navigation_error_<axis>_rms_m",
    "navigation_error_maximum_m",
    "navigation_error_settled_samples",
    "navigation_error_settled_3d_rms_m",
    "navigation_error_settled_3d_rms_m_per_s",
    "navigation_error_settled_nees",
    "truth_fed_settled_keeping_<axis>_rms_m",
    "truth_fed_settled_keeping_delta_v_m_per_s_per_h",
    "safety_watched_steps",
    "safety_taken_over_time_s",
)
"""Figures of runs with navigation or `formation_safety`, one set for each deputy."""

RUN_FIGURES = (
    "pair_<deputy>_<deputy>_minimum_separation_m",
    "pair_<deputy>_<deputy>_error_settled_3d_rms_m",
    "pair_<deputy>_<deputy>_error_settled_nees",
    "late_calls_percent",
    "late_calls_longest_s",
    "receiver_logs_damaged",
    "receiver_logs_undecoded",
    "safety_hard_radius_m",
    "safety_smallest_predicted_separation_m",
    "safety_largest_probability",
    "attitude_point_time_s",
    "attitude_first_rate_deg_per_s",
    "attitude_last_rate_deg_per_s",
    "attitude_error_rms_deg",
    "attitude_error_nees",
    "attitude_dipole_error_rms_a_m2",
    "attitude_roll_mean_deg",
    "attitude_pitch_mean_deg",
    "attitude_yaw_mean_deg",
    "attitude_roll_sigma_deg",
    "attitude_pitch_sigma_deg",
    "attitude_yaw_sigma_deg",
    "attitude_wheel_lowest_rpm",
    "attitude_wheel_highest_rpm",
    "attitude_unanswered_periods",
    "late_commands",
    "message_count",
    "message_count_<topic>",
    "real_time_factor",
    "run_complete",
    "run_duration_s",
    "<craft>_gnss_epochs",
    "<craft>_gnss_time_span_s",
    "<craft>_gnss_interval_s",
    "<craft>_gnss_gaps",
    "<craft>_gnss_missing_epochs",
    "<craft>_gnss_longest_gap_s",
    "<craft>_gnss_satellites",
    "<craft>_gnss_satellites_<system>",
    "<craft>_gnss_satellites_per_epoch_minimum",
    "<craft>_gnss_satellites_per_epoch_mean",
    "<craft>_gnss_satellites_per_epoch_maximum",
    "<craft>_gnss_observations",
    "<craft>_gnss_observations_<signal>",
    "<craft>_gnss_possible_cycle_slips",
    "<craft>_gnss_cn0_mean_dbhz",
    "<craft>_gnss_fixes",
    "<craft>_gnss_fixes_usable",
    "<craft>_gnss_ephemerides",
    "<craft>_gnss_ephemeris_satellites",
    "ionosphere_vertical_edges",
    "ionosphere_<craft>_bottom_time_s",
    "ionosphere_true_<craft>_bottom_time_s",
    "ionosphere_<craft>_top_time_s",
    "ionosphere_true_<craft>_top_time_s",
    "ionosphere_<craft>_bottom_altitude_m",
    "ionosphere_true_<craft>_bottom_altitude_m",
    "ionosphere_<craft>_top_altitude_m",
    "ionosphere_true_<craft>_top_altitude_m",
    "ionosphere_vtec_bottom_tecu",
    "ionosphere_true_vtec_bottom_tecu",
    "ionosphere_vtec_top_tecu",
    "ionosphere_true_vtec_top_tecu",
    "ionosphere_separation_rising_m",
    "ionosphere_true_separation_rising_m",
    "ionosphere_separation_falling_m",
    "ionosphere_true_separation_falling_m",
    "ionosphere_lag_s",
    "ionosphere_true_lag_s",
    "ionosphere_first_event_latitude_deg",
    "ionosphere_true_first_event_latitude_deg",
    "ionosphere_first_event_longitude_deg",
    "ionosphere_true_first_event_longitude_deg",
    "ionosphere_last_event_latitude_deg",
    "ionosphere_true_last_event_latitude_deg",
    "ionosphere_last_event_longitude_deg",
    "ionosphere_true_last_event_longitude_deg",
    "ionosphere_<craft>_scintillating_minutes",
    "ionosphere_true_<craft>_scintillating_minutes",
    "ionosphere_<craft>_scintillation_detected_percent",
    "ionosphere_<craft>_scintillation_false_percent",
    "ionosphere_density_error_per_cm3",
    "ionosphere_density_error_bubble_1_per_cm3",
    "ionosphere_density_error_bubble_2_per_cm3",
    "ionosphere_density_error_bubble_3_per_cm3",
    "ionosphere_density_error_single_satellite_per_cm3",
    "ionosphere_density_error_single_satellite_bubble_1_per_cm3",
    "ionosphere_density_error_single_satellite_bubble_2_per_cm3",
    "ionosphere_density_error_single_satellite_bubble_3_per_cm3",
    "ionosphere_differential_tec_rms_tecu",
    "ionosphere_<craft>_slant_tec_error_rms_tecu",
    "ionosphere_<craft>_receiver_slant_tec_<pair>_samples",
    "ionosphere_<craft>_receiver_slant_tec_<pair>_mean_difference_tecu",
    "ionosphere_<craft>_receiver_slant_tec_<pair>_scatter_tecu",
    "ionosphere_<craft>_receiver_s4_<signal>_samples",
    "ionosphere_<craft>_receiver_s4_<signal>_mean_difference",
    "ionosphere_<craft>_receiver_s4_<signal>_scatter",
    "ionosphere_<craft>_receiver_sigma_phi_<signal>_samples",
    "ionosphere_<craft>_receiver_sigma_phi_<signal>_mean_difference_rad",
    "ionosphere_<craft>_receiver_sigma_phi_<signal>_scatter_rad",
    "guidance_last_phase_start_time_s",
    "guidance_last_phase_deviation_rms_m",
    "guidance_closest_m",
    "guidance_planned_closest_m",
    "guidance_delta_v_m_per_s",
    "cluster_equilibrium_m",
    "cluster_closest_m",
    "cluster_side_minimum_end_m",
    "cluster_side_maximum_end_m",
    "cluster_settling_time_s",
    "cluster_settling_delta_v_m_per_s",
    "cluster_side_mean_error_percent",
    "cluster_side_largest_error_percent",
    "cluster_last_orbit_delta_v_m_per_s",
    "survey_walls",
    "survey_crossings",
    "survey_unsupported_crossings",
    "survey_edges_two_spacecraft",
    "survey_edges_1km",
    "survey_edges_2km",
    "survey_drift_m_s",
    "survey_drift_sigma_m_s",
    "survey_true_drift_m_s",
    "survey_drift_error_m_s",
    "survey_drift_error_sigma",
    "survey_false_crossings",
    "survey_missed_crossings",
    "survey_crossing_error_rms_s",
    "survey_crossing_error_rms_sigma",
    "survey_next_crossing_error_s",
    "survey_next_crossing_error_sigma",
    "survey_plans",
    "survey_velocity_change_m_s",
)
"""Further figures of runs, one set for each run."""

_UNITS = {
    "_m_per_s_per_h": "m/s per h",
    "_m_per_s2": "m/s²",
    "_m_per_s": "m/s",
    "_m_s": "m/s",
    "_a_m2": "A m²",
    "_rpm": "rpm",
    "_per_cm3": "cm⁻³",
    "_dbhz": "dB-Hz",
    "_tecu": "TECU",
    "_percent": "%",
    "_deg": "deg",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
}

#: Parts of names that are not written as they are spoken.
_WORDS = {
    "in_track": "in-track",
    "cross_track": "cross-track",
    "delta_v": "velocity change",
    "3d": "3-D",
    "rms": "RMS",
    "nees": "NEES",
    "gnss": "GNSS",
    "cn0": "C/N0",
    "vtec": "vertical TEC",
    "tec": "TEC",
    "s4": "S4",
    "1km": "1 km apart",
    "2km": "2 km apart",
}

_AXES = ("radial", "in_track", "cross_track")

_PLACEHOLDERS = {
    "<axis>": f"({'|'.join(_AXES)})",
    "<system>": "(gps|glonass|sbas|galileo|beidou|qzss|navic)",
    "<signal>": "[a-z][0-9][a-z]",
    "<pair>": "[a-z][0-9]{2}",
    "<topic>": "[a-z0-9_]+",
}


def unit_of(figure: str) -> str:
    """Return the unit that the end of a figure's name tells; empty for none."""
    return next((unit for ending, unit in _UNITS.items() if figure.endswith(ending)), "")


def describe_name(name: str) -> str:
    """Return the name of a figure or a variable in words, without its unit (`unit_of`)."""
    ending = next((ending for ending in _UNITS if name.endswith(ending)), "")
    text = f"_{name.removesuffix(ending)}_"
    for part, words in _WORDS.items():
        text = text.replace(f"_{part}_", f"_{words}_")
    return text.strip("_").replace("_", " ")


def figure_problem(
    figure: str, spacecraft: Sequence[str], deputies: Sequence[str], *, library: bool
) -> str:
    """Tell what is wrong with the name of a figure.

    Parameters
    ----------
    figure
        Name as given by the user.
    spacecraft, deputies
        Names of all spacecraft of the scenario, and of its deputies. With more than one deputy
        the figures of a flight begin with the deputy's name.
    library
        True for the closed loop without ROS, which has the figures of the flight alone.

    Returns
    -------
    str
        One line; empty if a run can have this figure.
    """
    prefixes = [f"{name}_" for name in deputies] if len(deputies) > 1 else [""]
    of_deputy = FLIGHT_FIGURES if library else (*FLIGHT_FIGURES, *NAVIGATION_FIGURES)
    patterns = [prefix + pattern for prefix in prefixes for pattern in of_deputy]
    if not library:
        for pattern in RUN_FIGURES:
            if "<deputy>" in pattern:
                pairs = itertools.combinations(sorted(deputies), 2)
                patterns += [pattern.replace("<deputy>_<deputy>", "_".join(pair)) for pair in pairs]
            else:
                patterns += [pattern.replace("<craft>", name) for name in spacecraft]
    if any(re.fullmatch(_expression(pattern), figure) for pattern in patterns):
        return ""
    names = {pattern.replace("<axis>", axis) for pattern in patterns for axis in _AXES}
    near = difflib.get_close_matches(figure, sorted(names), n=3)
    hint = f"; did you mean: {', '.join(near)}?" if near else "; see docs/summary.md"
    return f"there is no figure {figure!r}{hint}"


def _expression(pattern: str) -> str:
    for placeholder, expression in _PLACEHOLDERS.items():
        pattern = pattern.replace(placeholder, expression)
    return pattern

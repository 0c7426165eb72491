"""Numbers that Peng and others print for the runs that vtff repeats.

The paper is that of the Virginia Tech Formation Flying Testbed (VTFFTB) and its use for ionospheric
remote sensing; table A1 also prints results of Park and others. Every number is as printed, under
the key of the summary that it is compared with (docs/summary.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class PaperColumn:
    """Results of one run that the paper prints.

    Attributes
    ----------
    title
        Heading of the column.
    source
        Section, figure or table of the paper.
    hardware_in_the_loop
        Whether GNSS receivers and filter fed the controller; otherwise the truth fed it.
    values
        Printed numbers by the keys of the summary.
    """

    title: str
    source: str
    hardware_in_the_loop: bool
    values: Mapping[str, float]


_REFERENCE_SOFTWARE = PaperColumn(
    title="paper\nsoftware",
    source="appendix A.1",
    hardware_in_the_loop=False,
    values={
        "delta_v_total_radial_m_per_s": 2.43,
        "delta_v_total_in_track_m_per_s": 75.48,
        "delta_v_total_cross_track_m_per_s": 1.07e-5,
        "minimum_in_track_m": 38.17,
        "minimum_in_track_time_s": 56.0,
        "settling_time_in_track_s": 124.0,
        "keeping_start_time_s": 125.0,
    },
)

_REFERENCE_HIL = PaperColumn(
    title="paper\nHIL",
    source="appendix A.2 and table A1",
    hardware_in_the_loop=True,
    values={
        "delta_v_total_radial_m_per_s": 5.63,
        "delta_v_total_in_track_m_per_s": 76.88,
        "delta_v_total_cross_track_m_per_s": 1.12,
        "delta_v_acquisition_in_track_m_per_s": 75.45,
        "delta_v_keeping_in_track_m_per_s": 1.44,
        "minimum_in_track_m": 38.17,
        "minimum_in_track_time_s": 56.0,
        "settling_time_in_track_s": 124.0,
        "keeping_start_time_s": 125.0,
        "keeping_radial_maximum_m": 0.98,
        "keeping_radial_minimum_m": -7.16,
        "keeping_radial_mean_m": -0.040,
        "keeping_radial_rms_m": 0.49,
        "keeping_in_track_maximum_m": 102.82,
        "keeping_in_track_minimum_m": 99.27,
        "keeping_in_track_mean_m": 100.0094,
        "keeping_in_track_rms_m": 0.19,
        "keeping_cross_track_maximum_m": 2.62,
        "keeping_cross_track_minimum_m": -0.28,
        "keeping_cross_track_mean_m": 0.015,
        "keeping_cross_track_rms_m": 0.18,
    },
)

_REFERENCE_PARK = PaperColumn(
    title="Park et al.\nHIL",
    source="table A1",
    hardware_in_the_loop=True,
    values={
        "keeping_radial_maximum_m": 1.13,
        "keeping_radial_minimum_m": -1.62,
        "keeping_radial_mean_m": 0.0,
        "keeping_radial_rms_m": 0.17,
        "keeping_in_track_maximum_m": 100.81,
        "keeping_in_track_minimum_m": 99.58,
        "keeping_in_track_mean_m": 100.19,
        "keeping_in_track_rms_m": 0.091,
        "keeping_cross_track_maximum_m": 0.39,
        "keeping_cross_track_minimum_m": -0.50,
        "keeping_cross_track_mean_m": 0.0,
        "keeping_cross_track_rms_m": 0.070,
    },
)

_REMOTE_SENSING_HIL = PaperColumn(
    title="paper\nHIL",
    source="section 4.1",
    hardware_in_the_loop=True,
    values={
        "delta_v_total_radial_m_per_s": 27.95,
        "delta_v_total_in_track_m_per_s": 6.95,
        "delta_v_total_cross_track_m_per_s": 0.61,
        "settling_time_radial_s": 98.0,
        "settling_time_in_track_s": 57.0,
    },
)

_SPREAD_F_HIL = PaperColumn(
    title="paper\nHIL",
    source="sections 4.1 and 4.2",
    hardware_in_the_loop=True,
    values={
        **_REMOTE_SENSING_HIL.values,
        "ionosphere_chief_bottom_time_s": 1957.0,
        "ionosphere_chief_top_time_s": 2165.0,
        "ionosphere_deputy_bottom_time_s": 1961.0,
        "ionosphere_deputy_top_time_s": 2169.0,
        "ionosphere_chief_bottom_altitude_m": 290e3,
        "ionosphere_chief_top_altitude_m": 350e3,
        "ionosphere_vtec_bottom_tecu": 30.17,
        "ionosphere_vtec_top_tecu": 30.10,
        # The paper prints no sign; the deputy is below.
        "ionosphere_separation_rising_m": -1183.16,
        "ionosphere_lag_s": 2.0,
        "ionosphere_first_event_latitude_deg": -7.1,
        "ionosphere_first_event_longitude_deg": -82.7,
        "ionosphere_last_event_latitude_deg": -8.8,
        "ionosphere_last_event_longitude_deg": -67.6,
    },
)

_PLUMEX_HIL = PaperColumn(
    title="paper\nHIL",
    source="section 4.3 (a measured rocket profile, one satellite)",
    hardware_in_the_loop=True,
    values={
        "ionosphere_density_error_single_satellite_per_cm3": 6.56e4,
        "ionosphere_density_error_single_satellite_bubble_1_per_cm3": 5.28e4,
        "ionosphere_density_error_single_satellite_bubble_2_per_cm3": 7.86e4,
        "ionosphere_density_error_single_satellite_bubble_3_per_cm3": 6.15e4,
    },
)

_COLUMNS = {
    "reference": (_REFERENCE_SOFTWARE, _REFERENCE_HIL, _REFERENCE_PARK),
    "remote_sensing": (_REMOTE_SENSING_HIL,),
    "esf": (_SPREAD_F_HIL,),
    "esf_paper": (_SPREAD_F_HIL,),
    "plumex": (_PLUMEX_HIL,),
}

_NAVIGATION_ERRORS = {
    ("laser_250m", False): 10.7e-3,
    ("laser_250m", True): 2.1e-3,
    ("laser_5km", False): 29.8e-3,
    ("laser_5km", True): 14.1e-3,
}
"""3-D RMS errors that paper 004 prints, simulated, m, by scenario and whether a laser ranges."""

IONOSPHERE_PREFIX = "ionosphere_"
"""Prefix of the keys of the ionosphere."""

PAPER_DURATION = 3600.0
"""Length in s of the paper's runs, over which its totals are summed."""


def paper_columns(scenario: str | None) -> tuple[PaperColumn, ...]:
    """Return the paper's results for a scenario; empty for a scenario that the paper lacks."""
    return _COLUMNS.get(scenario or "", ())


def paper_plateau(scenario: str | None) -> list[float]:
    """Return the vertical TEC that the paper prints inside its bubble, TECU; empty without one."""
    names = ("ionosphere_vtec_top_tecu", "ionosphere_vtec_bottom_tecu")
    columns = paper_columns(scenario)
    return [column.values[name] for column in columns for name in names if name in column.values]


def paper_navigation_error(scenario: str | None, has_laser: bool) -> float | None:
    """Return the 3-D RMS error of the relative position that paper 004 prints, m, if it does."""
    return _NAVIGATION_ERRORS.get((scenario or "", has_laser))


def formation_columns(scenario: str | None) -> tuple[PaperColumn, ...]:
    """Return the paper's results on the formation flight of a scenario."""
    return tuple(
        column
        for column in paper_columns(scenario)
        if any(not key.startswith(IONOSPHERE_PREFIX) for key in column.values)
    )

"""The thrust-cap study against the numbers of the paper's appendix A.1."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_analysis.closed_loop.summary import summarise_closed_loop
from vtff_analysis.studies.thrust_cap import (
    ThrustCapFindings,
    ThrustCapPoint,
    find_landmarks,
    thrust_cap_point,
    write_csv,
    write_plot,
)
from vtff_control.tracking.sdre import SdreDesign
from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.truth.scenario import load_scenario

CONFIGURATION = Path(__file__).resolve().parents[4] / "config"
REFERENCE = CONFIGURATION / "scenario" / "reference.yaml"
CAMPAIGN = CONFIGURATION / "campaign" / "thrust_cap.yaml"
CAPS = (
    *(0.01, 0.018, 0.019, 0.02, 0.021, 0.1, 1.0, 1.15, 1.175, 1.2, 1.3),
    *(1.35, 1.4, 1.42, 1.44, 1.46, 1.6, 1.9, 1.95, 2.0, 10.0),
)


@pytest.fixture(scope="module")
def points() -> list[ThrustCapPoint]:
    scenario = load_scenario(REFERENCE)
    return [
        thrust_cap_point(
            cap,
            summarise_closed_loop(simulate_closed_loop(scenario, SdreDesign(acceleration_cap=cap))),
        )
        for cap in CAPS
    ]


@pytest.fixture(scope="module")
def findings(points: list[ThrustCapPoint]) -> ThrustCapFindings:
    return find_landmarks(points)


def test_formation_is_reached_from_the_paper_s_cap(findings: ThrustCapFindings) -> None:
    assert findings.smallest_settling_cap == pytest.approx(0.020, abs=0.002)


def test_deputy_no_longer_passes_the_chief_from(findings: ThrustCapFindings) -> None:
    assert 1.15 <= findings.sign_change_cap <= 1.20


def test_local_optimum_of_the_in_track_total(findings: ThrustCapFindings) -> None:
    assert 1.35 <= findings.optimum_cap <= 1.45
    assert findings.optimum_delta_v == pytest.approx(75.4, abs=0.3)


def test_largest_minimum(findings: ThrustCapFindings) -> None:
    assert findings.largest_minimum_cap == pytest.approx(1.95, abs=0.05)
    assert findings.largest_minimum_in_track == pytest.approx(69.0, abs=0.5)


def test_large_caps(findings: ThrustCapFindings) -> None:
    assert findings.asymptotic_delta_v == pytest.approx(97.2, abs=0.5)


def test_the_campaign_s_caps_cover_the_paper_s_range_and_landmarks() -> None:
    campaign = parse_yaml(CAMPAIGN.read_text(encoding="utf-8"))
    caps = campaign["vary"]["thrust_cap"]["values"]
    assert caps[0] == 0.01 and caps[-1] == 10.0 and np.all(np.diff(caps) > 0.0)
    assert {0.02, 1.2, 1.4, 1.95} <= set(caps)


def test_a_run_without_a_number_is_named() -> None:
    figures = {f"delta_v_total_{axis}_m_per_s": 1.0 for axis in ("radial", "in_track")}
    figures |= {"delta_v_total_cross_track_m_per_s": None, "settling_time_s": 1.0}
    with pytest.raises(ValueError, match="no delta_v_total_cross_track_m_per_s"):
        thrust_cap_point(1.0, figures)


def test_csv_holds_every_point(points: list[ThrustCapPoint], tmp_path: Path) -> None:
    path = tmp_path / "thrust_cap.csv"
    write_csv(points, path)
    with open(path, encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(points)
    assert list(rows[0]) == [
        "cap_m_per_s2",
        "delta_v_radial_m_per_s",
        "delta_v_in_track_m_per_s",
        "delta_v_cross_track_m_per_s",
        "minimum_in_track_m",
        "minimum_in_track_time_s",
        "settling_time_s",
    ]
    for row, point in zip(rows, points, strict=True):
        np.testing.assert_allclose(
            [float(value) for value in row.values()], dataclasses.astuple(point), rtol=1e-8
        )
    assert rows[0]["settling_time_s"] == "inf"


def test_plot_is_a_picture(points: list[ThrustCapPoint], tmp_path: Path) -> None:
    path = tmp_path / "thrust_cap.png"
    write_plot(points, path)
    assert path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 20_000


def test_landmarks_that_are_not_in_the_points_are_named(points: list[ThrustCapPoint]) -> None:
    with pytest.raises(ValueError, match="not reached"):
        find_landmarks(points[:2])
    with pytest.raises(ValueError, match="does not change sign"):
        find_landmarks(points[-3:])

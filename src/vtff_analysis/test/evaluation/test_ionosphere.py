"""Numbers of the ionosphere in a report: against a made-up truth and against a GPStation-6."""

from __future__ import annotations

import dataclasses
import io
import json
import pathlib
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from full_run_samples import SECOND, START, BagOfMessages  # noqa: E402

from vtff_analysis.evaluation.ionosphere import summarise_ionosphere  # noqa: E402
from vtff_analysis.evaluation.receiver_comparison import compare_with_receiver  # noqa: E402
from vtff_analysis.recordings.history import (  # noqa: E402
    Boundary,
    DensityHistory,
    RunHistory,
    SatelliteColumns,
)
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth, SatelliteTruth  # noqa: E402
from vtff_analysis.report import write_report  # noqa: E402
from vtff_analysis.report.ionosphere_table import ionosphere_rows  # noqa: E402
from vtff_dynamics.time.timescales import GpsTime  # noqa: E402
from vtff_gnss.novatel import IsmScintillation, IsmSlantTec  # noqa: E402
from vtff_msgs.msg import Scintillation, SlantTec  # noqa: E402
from vtff_node.conversions.gnss import (  # noqa: E402
    ism_scintillation_to_message,
    ism_slant_tec_to_message,
)
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile  # noqa: E402
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion  # noqa: E402

BOTTOM, TOP, SEPARATION, SPEED = 290e3, 350e3, -1000.0, 300.0
SUMMARY_DOCUMENT = (pathlib.Path(__file__).resolve().parents[4] / "docs" / "summary.md").read_text(
    encoding="utf-8"
)

REGION = IrregularityRegion(
    *("spread_f", -0.2, 0.0, 20.0, 22.0), altitude_bottom=BOTTOM, altitude_top=TOP,
    s4=0.4, decorrelation_time=0.5,
)  # fmt: skip
PERIGEE = 600  # s into the run
SECONDS = np.arange(1200)
CHIEF_ALTITUDE = 200e3 + SPEED * np.abs(SECONDS - PERIGEE)


def made_up_truth():
    time = START + SECONDS * SECOND
    crafts = {"chief": 0.0, "deputy": SEPARATION}
    # 0.066 deg a second along the equator, the deputy 2 s behind.
    longitude = {"chief": 0.066 * SECONDS, "deputy": 0.066 * (SECONDS - 2.0)}
    satellites = np.full(len(SECONDS), 5)
    s4 = np.where((SECONDS >= 960) & (SECONDS < 1080), 0.4, 0.0)
    return IonosphereTruth(
        profile=ElectronDensityProfile([0.0, 2000e3], [1e12, 1e12]),
        time=dict.fromkeys(crafts, time),
        altitude={name: CHIEF_ALTITUDE + lead for name, lead in crafts.items()},
        latitude_deg=dict.fromkeys(crafts, np.zeros(len(SECONDS))),
        longitude_deg=longitude,
        regions=(REGION,),
        satellites={"chief": SatelliteTruth(time, satellites, np.full(len(SECONDS), 30.0), s4)},
    )


def made_up_density(error=0.0):
    return DensityHistory(
        time=START + SECONDS * SECOND,
        altitude=CHIEF_ALTITUDE + 0.5 * SEPARATION,
        separation=np.full(len(SECONDS), SEPARATION),
        latitude_deg=np.zeros(len(SECONDS)),
        longitude_deg=0.066 * (SECONDS - 1.0),
        density=np.full(len(SECONDS), 1e12 + error),
        sigma=np.full(len(SECONDS), 1e10),
    )


def edge(seconds, craft, entry, altitude):
    time = START + round(seconds * SECOND)
    return Boundary(time, "vertical", "density", entry, craft, 255, 0, 0.0, 0.0, altitude)


def scintillation_windows(ends, is_strong):
    """Scintillation of G05 in windows that end `ends` seconds after the start."""
    return SatelliteColumns(
        time=START + ends * SECOND,
        system=np.zeros(len(ends), np.uint8),
        prn=np.full(len(ends), 5, np.uint8),
        values={"band": np.ones(len(ends)), "s4_corrected": np.where(is_strong, 0.4, 0.01)},
    )


def made_up_run(error=0.0, late=0.0):
    """Return a run that finds each edge `late` s after its crossing."""
    edges = []
    for craft, lead in (("chief", 0.0), ("deputy", SEPARATION)):
        for altitude, sign in ((TOP, -1.0), (BOTTOM, -1.0), (BOTTOM, 1.0), (TOP, 1.0)):
            seconds = PERIGEE + sign * (altitude - lead - 200e3) / SPEED
            entry = (altitude == TOP) == (sign < 0.0)
            edges.append(edge(seconds + late, craft, entry, altitude))
    minutes = np.arange(60, 1200, 60)
    strong = (minutes > 960) & (minutes <= 1080)
    scintillation = scintillation_windows(minutes, strong)
    slant_tec = SatelliteColumns(
        time=START + SECONDS * SECOND,
        system=np.zeros(len(SECONDS), np.uint8),
        prn=np.full(len(SECONDS), 5, np.uint8),
        values={
            "rejected": np.zeros(len(SECONDS)),
            "elevation": np.full(len(SECONDS), 1.0),
            "stec_tecu": np.full(len(SECONDS), 30.5),
            "vtec_tecu": np.full(len(SECONDS), 20.0),
        },
    )
    return RunHistory(
        START,
        START + 1199 * SECOND,
        {},
        slant_tec={"/chief/iono/slant_tec": slant_tec},
        scintillation={"/chief/iono/scintillation": scintillation},
        density=made_up_density(error),
        satellite_density=SatelliteColumns(
            time=START + SECONDS * SECOND,
            system=np.zeros(len(SECONDS), np.uint8),
            prn=np.full(len(SECONDS), 5, np.uint8),
            values={
                "altitude": CHIEF_ALTITUDE + 0.5 * SEPARATION,
                "density": np.full(len(SECONDS), 1e12 + 2.0 * error),
            },
        ),
        boundaries=tuple(edges),
    )


def test_the_density_of_one_satellite_stands_beside_that_of_the_paper():
    """The paper's profile is that of one satellite; the density of all was set beside it."""
    truth = dataclasses.replace(made_up_truth(), regions=())
    found = summarise_ionosphere(made_up_run(3e9), truth)
    rows = {
        (label, measured): paper
        for label, paper, measured, _ in ionosphere_rows({**found, "scenario": "plumex"})
    }
    assert rows["  at 340 to 380 km (bubble 3), cm-3", "3000"] == ""
    assert rows["  at 340 to 380 km (bubble 3), cm-3", "6000"] == "61500"
    assert rows["density of all satellites, mean error, cm-3", "3000"] == ""
    assert rows["density of one satellite, mean error, cm-3", "6000"] == "65600"


def test_without_a_profile_there_is_no_error_of_that_of_one_satellite():
    """A formation that keeps its altitude has none; a figure stood beside the paper's profile."""
    run = made_up_run(3e9)
    falling = {
        field.name: getattr(run.density, field.name)[: PERIGEE - 100]
        for field in dataclasses.fields(run.density)
    }
    run = dataclasses.replace(run, density=DensityHistory(**falling))
    found = summarise_ionosphere(run, made_up_truth())
    assert [name for name in found if "density_error" in name] == []


@settings(max_examples=20, deadline=None)
@given(late=st.floats(-5.0, 5.0), error=st.floats(-1e11, 1e11))
def test_a_run_with_known_errors(late, error):
    found = summarise_ionosphere(made_up_run(error, late), made_up_truth(), lag=2.1)
    assert found["ionosphere_vertical_edges"] == 8
    for craft in ("chief", "deputy"):
        for name in ("bottom", "top"):
            key = f"{craft}_{name}_time_s"
            difference = found[f"ionosphere_{key}"] - found[f"ionosphere_true_{key}"]
            assert difference == pytest.approx(late, abs=1e-3)
    # A common error of the times does not move the separation.
    for leg in ("rising", "falling"):
        assert found[f"ionosphere_separation_{leg}_m"] == pytest.approx(SEPARATION, rel=1e-3)
        assert found[f"ionosphere_true_separation_{leg}_m"] == pytest.approx(SEPARATION, rel=1e-6)
    assert found["ionosphere_density_error_per_cm3"] == pytest.approx(abs(error) * 1e-6, abs=1e-3)
    single = found["ionosphere_density_error_single_satellite_per_cm3"]
    assert single == pytest.approx(2.0 * abs(error) * 1e-6, abs=1e-3)
    content = abs(error) * 1000.0 / 1e16
    assert found["ionosphere_differential_tec_rms_tecu"] == pytest.approx(content, abs=1e-9)
    assert found["ionosphere_chief_slant_tec_error_rms_tecu"] == pytest.approx(0.5, abs=1e-9)
    assert found["ionosphere_true_lag_s"] == pytest.approx(2.0, rel=1e-3)


def test_scintillating_minutes_and_their_place():
    found = summarise_ionosphere(made_up_run(), made_up_truth())
    assert found["ionosphere_chief_scintillating_minutes"] == 2
    assert found["ionosphere_true_chief_scintillating_minutes"] == 2
    assert found["ionosphere_chief_scintillation_detected_percent"] == 100.0
    assert found["ionosphere_chief_scintillation_false_percent"] == 0.0
    assert found["ionosphere_true_first_event_longitude_deg"] == pytest.approx(0.066 * 960)
    # The middle of the minute, of the middle between the spacecraft.
    assert found["ionosphere_first_event_longitude_deg"] == pytest.approx(0.066 * 989)


def test_minutes_are_counted_from_windows_of_any_length():
    """The truth, too: a window of ten seconds is no false one because no minute ends there."""
    ends = np.arange(10, 1200, 10)
    is_strong = (ends > 960) & (ends <= 1080)
    # The first strong window is missed, and one before is false.
    windows = scintillation_windows(ends, is_strong ^ np.isin(ends, (500, 970)))
    run = dataclasses.replace(made_up_run(), scintillation={"/chief/iono/scintillation": windows})
    found = summarise_ionosphere(run, made_up_truth())
    assert found["ionosphere_chief_scintillating_minutes"] == pytest.approx(2.0)
    assert found["ionosphere_true_chief_scintillating_minutes"] == pytest.approx(2.0)
    percent = found["ionosphere_chief_scintillation_detected_percent"]
    assert percent == pytest.approx(100.0 * 11 / 12)
    others = np.count_nonzero(~is_strong) - 1  # the last strong second ends the window before it
    percent = found["ionosphere_chief_scintillation_false_percent"]
    assert percent == pytest.approx(100.0 / others, rel=0.02)
    # The middle of the false window, which is the first.
    assert found["ionosphere_first_event_longitude_deg"] == pytest.approx(0.066 * 494)


def test_edges_of_other_structures_do_not_make_a_separation():
    run = made_up_run()
    # The deputy has missed what the chief has found first, and found something else.
    first = min((e for e in run.boundaries if e.spacecraft == "deputy"), key=lambda e: e.time)
    other = dataclasses.replace(first, time=first.time - 50 * SECOND, altitude=TOP + 15e3)
    boundaries = tuple(other if e is first else e for e in run.boundaries)
    found = summarise_ionosphere(dataclasses.replace(run, boundaries=boundaries), None)
    assert found["ionosphere_separation_falling_m"] == pytest.approx(SEPARATION, rel=1e-3)


def test_without_truth_only_what_was_measured_is_told():
    found = summarise_ionosphere(made_up_run(), None)
    assert found["ionosphere_vertical_edges"] == 8
    assert not [key for key in found if "true" in key or "error" in key]
    assert summarise_ionosphere(RunHistory(0, 0, {}), None) == {}


def test_the_paper_stands_beside_the_measured():
    found = summarise_ionosphere(made_up_run(), made_up_truth(), lag=2.1)
    rows = {row[0]: row[1:] for row in ionosphere_rows({"scenario": "esf", **found})}
    assert rows["separation from edges, rising, m"] == ("-1183.2", "-1000.0", "-1000.0")
    assert rows["lag of the deputy's fluctuations, s"][:2] == ("2.00", "2.10")
    assert ionosphere_rows({"scenario": "esf"}) == []


@pytest.mark.parametrize("regions", [(REGION,), ()])
def test_every_key_is_documented(regions):
    truth = dataclasses.replace(made_up_truth(), regions=regions)
    found = summarise_ionosphere(made_up_run(), truth, lag=2.1)
    for key in found:
        documented = re.sub("chief|deputy", "<craft>", key).replace("ionosphere_true", "ionosphere")
        assert f"| `{documented}` |" in SUMMARY_DOCUMENT, key


# ---- a receiver that forms indices itself -----------------------------------------------------


def write_gpstation_bag(folder, bias=3.0, noise=0.25):
    """Write a bag in which the receiver's TEC is off by a bias and alternating noise."""
    bag = BagOfMessages(folder)
    prn = np.array([3, 7], np.uint8)
    zeros, ones = np.zeros(2, np.uint8), np.ones(2, np.uint8)
    for second in range(0, 301, 15):
        time = START + second * SECOND
        true = 20.0 + prn + 0.01 * second
        ours = SlantTec(system=zeros, prn=prn, band_first=ones, band_second=2 * ones)
        ours.stec_tecu, ours.rejected = true, np.array([0, 4 if second == 150 else 0], np.uint16)
        bag.add("/chief/iono/slant_tec", time, ours)
        wrong = bias + noise * (-1.0) ** (second // 15)
        own = IsmSlantTec(
            GpsTime.from_unix_nanoseconds(time), zeros, prn, ones, 2 * ones,
            true - wrong, np.zeros(2), np.ones(2), np.ones(2),
        )  # fmt: skip
        bag.add("/chief/gnss/ism/slant_tec", time, ism_slant_tec_to_message(own, "antenna"))
        if second % 60 == 0 and second:
            add_indices(bag, time, prn)
    bag.writer.close()
    return folder


def add_indices(bag, time, prn):
    zeros, ones = np.zeros(2, np.uint8), np.ones(2, np.uint8)
    letter = np.full(2, ord("C"), np.uint8)
    ours = Scintillation(window=60.0, system=zeros, prn=prn, band=ones, attribute=letter)
    ours.s4_corrected = np.array([0.4, 0.1], np.float32)
    ours.sigma_phi = np.array([0.3, 0.2], np.float32)
    bag.add("/chief/iono/scintillation", time, ours)
    unknown = np.zeros(2)
    own = IsmScintillation(
        GpsTime.from_unix_nanoseconds(time), zeros, prn, ones, letter,
        # sqrt(total^2 - correction^2) = 0.4 and 0.1
        np.array([0.5, 0.125]), np.array([0.3, 0.075]),
        np.tile(np.array([[0.25], [0.15]]), 5),
        *(unknown for _ in range(6)),
    )  # fmt: skip
    bag.add("/chief/gnss/ism/scintillation", time, ism_scintillation_to_message(own, "antenna"))


def test_the_receivers_own_indices_are_compared(tmp_path):
    bag = write_gpstation_bag(tmp_path / "recorded")
    console = Console(file=io.StringIO(), width=120)
    folder = write_report(bag, console, output=tmp_path / "report")
    summary = json.loads((folder / "summary.json").read_text())
    stem = "ionosphere_chief_receiver_slant_tec_g12"
    assert summary[f"{stem}_samples"] == 41  # one of 42 was rejected
    assert summary[f"{stem}_mean_difference_tecu"] == pytest.approx(3.0, abs=0.02)
    assert summary[f"{stem}_scatter_tecu"] == pytest.approx(0.25, abs=0.01)
    assert summary["ionosphere_chief_receiver_s4_g1c_mean_difference"] == pytest.approx(0, abs=1e-6)
    phase = summary["ionosphere_chief_receiver_sigma_phi_g1c_mean_difference_rad"]
    assert phase == pytest.approx(0.05, abs=1e-6)
    assert (folder / "receiver_ionosphere.png").stat().st_size > 10_000
    assert "receiver's own (GPStation-6)" in (folder / "report.html").read_text()


def test_nothing_is_compared_without_the_receivers_own():
    assert compare_with_receiver(made_up_run()) == []

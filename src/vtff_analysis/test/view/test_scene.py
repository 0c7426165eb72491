"""The scene of the viewer: positions in ITRF, links, times, thinning, and news of a live scene."""

import json
import math
import pathlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_analysis.view.scene import COLUMNS, Scene, Series, find_manoeuvres

ROOT = pathlib.Path(__file__).resolve().parents[4]
SAMPLE = ROOT / "bags/sample"
SECOND = 10**9
START = 1_458_521_983 * SECOND


def test_a_sample_that_is_not_newer_is_left_out():
    scene = Scene("run", START)
    for seconds in (1, 2, 2, 1, 3):
        scene.add(
            "link", START + seconds * SECOND, [40.0 + seconds], craft="chief", satellite="G05"
        )
    series = scene.series["link/chief/G05"]
    assert series.time == [1.0, 2.0, 3.0]
    assert series.values == [[41.0, 42.0, 43.0]]


def test_a_sample_holds_until_it_is_too_old():
    scene = Scene("run", START)
    scene.add("link", START, [40.0], craft="chief", satellite="G05")
    series = scene.series["link/chief/G05"]
    assert series.at(-0.1) is None
    assert series.at(100.0) == {"cn0_dbhz": 40.0}
    assert series.at(2.0, hold=1.5) is None


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ValueError, match="a sample of 'orbit' has 6 values"):
        Scene("run", START).add("orbit", START, [1.0, 2.0], craft="chief", source="truth")


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["G01", "G02", "E30"]),
            st.floats(allow_nan=True, allow_infinity=True),
            st.booleans(),
        ),
        max_size=40,
    )
)
def test_news_together_are_the_whole(samples):
    """Whenever a page asks, in the end it has what a page has that loads everything at once."""
    scene = Scene("run", START, live=True)
    received: dict[str, dict] = {}
    sent: dict[str, int] = {}
    for number, (satellite, value, asks) in enumerate(samples):
        scene.add("link", START + number * SECOND, [value], craft="chief", satellite=satellite)
        if asks or number == len(samples) - 1:
            text = json.dumps(scene.as_json(sent), allow_nan=False)
            sent = scene.counts()
            for part in json.loads(text)["series"]:
                known = received.setdefault(part["name"], {"time": [], "cn0_dbhz": []})
                known["time"] += part["time"]
                known["cn0_dbhz"] += part["cn0_dbhz"]
    whole = scene.as_json()["series"]
    assert received == {part["name"]: {k: part[k] for k in ("time", "cn0_dbhz")} for part in whole}


def test_what_is_not_finite_becomes_none():
    scene = Scene("run", START)
    scene.add("pierce", START, [1.0, math.nan, math.inf, 3.0], craft="chief", satellite="G05")
    sent = scene.as_json()["series"][0]
    assert [sent[name] for name in COLUMNS["pierce"]] == [[1.0], [None], [None], [3.0]]


pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

import full_run_samples  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from geometry_msgs.msg import AccelStamped  # noqa: E402

from vtff_analysis.recordings.orbits import read_orbits  # noqa: E402
from vtff_analysis.view.bag_scene import read_scene  # noqa: E402
from vtff_analysis.view.regions import irregularity_regions  # noqa: E402
from vtff_analysis.view.scene_builder import SceneBuilder, sample_interval  # noqa: E402
from vtff_analysis.view.text import scene_lines, scene_text  # noqa: E402
from vtff_bag.file.reader import BagReader  # noqa: E402
from vtff_bag.run.description import RunDescription  # noqa: E402
from vtff_dynamics.constants import SPEED_OF_LIGHT  # noqa: E402
from vtff_dynamics.time.timescales import GpsTime  # noqa: E402
from vtff_gnss.signals import satellite_name  # noqa: E402
from vtff_msgs.msg import (  # noqa: E402
    ElectronDensity,
    FormationSafety,
    GnssObservations,
    OrbitState,
    RelativeState,
    SurveyGuidance,
)
from vtff_node.stamps import to_stamp  # noqa: E402


@pytest.fixture(scope="module")
def sample():
    return read_scene(SAMPLE)


def test_spacecraft_are_where_the_exported_orbits_are(sample):
    for orbit in read_orbits(BagReader(SAMPLE)):
        series = sample.series[f"orbit/{orbit.name}/truth"]
        start = GpsTime.from_unix_nanoseconds(sample.start)
        assert series.time == pytest.approx([time - start for time in orbit.time], abs=1e-6)
        np.testing.assert_allclose(np.array(series.values).T, orbit.state_itrf, atol=1e-6)


def test_links_are_as_long_as_the_pseudoranges_say(sample):
    """An independent measure of both ends: the receiver timed the signal on its way.

    The satellite moves 300 m while the signal travels, and the receiver's clock is off by
    30 ns; the clock of the satellite is off by what its ephemeris tells.
    """
    compared = 0
    ephemerides = BagReader(SAMPLE).messages("/chief/gnss/ephemeris")
    clock = {e.message.prn: e.message.af0 for e in ephemerides}
    for decoded in BagReader(SAMPLE).messages("/chief/gnss/epoch"):
        message: GnssObservations = decoded.message
        stamp = int(message.header.stamp.sec) * SECOND + int(message.header.stamp.nanosec)
        time = sample.seconds(stamp)
        chief = sample.series["orbit/chief/truth"].at(time)
        for system, prn, pseudorange in zip(
            message.system, message.prn, message.pseudorange, strict=True
        ):
            name = satellite_name(system, prn)
            satellite = sample.series[f"satellite/{name}"]
            if not any(abs(time - at) < 1e-6 for at in satellite.time):
                continue  # between whole minutes the page interpolates
            ends = [np.array([s["x"], s["y"], s["z"]]) for s in (chief, satellite.at(time))]
            travelled = pseudorange + SPEED_OF_LIGHT * clock[prn]
            assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(travelled, abs=1000.0)
            assert sample.series[f"link/chief/{name}"].at(time, hold=0.5) is not None
            compared += 1
    assert compared >= 8


def test_both_receivers_have_eight_links_at_any_time(sample):
    for craft in ("chief", "deputy"):
        links = [s for s in sample.of_kind("link") if s.labels["craft"] == craft]
        for time in np.arange(5.0, 140.0, 15.0):
            assert sum(link.at(float(time), hold=1.5) is not None for link in links) >= 8


def test_times_count_from_the_first_message(sample):
    reader = BagReader(SAMPLE)
    assert sample.start == reader.start_time
    assert sample.duration == pytest.approx((reader.end_time - reader.start_time) / SECOND)
    newest = max(s.time[-1] for s in sample.series.values() if s.kind != "satellite")
    assert newest <= sample.duration


def test_everything_of_a_run_is_shown(tmp_path):
    scene = read_scene(full_run_samples.write_full_run(tmp_path / "bag", seconds=130))
    kinds = {series.kind for series in scene.series.values()}
    assert kinds == set(COLUMNS) - {"attitude", "density", "safety", "wall"}
    assert scene.notes == []
    assert len(scene.dip_equator) == 73
    vertical = scene.series["pierce/deputy/G07"].at(100.0)
    assert vertical["vtec_tecu"] == pytest.approx(14.0, abs=1e-4)
    assert math.isnan(vertical["latitude_deg"])  # that program has left the column out
    assert scene.series["boundary/deputy"].values[0] == [-11.5]
    assert "in-trk" in scene_text(scene) and len(scene_text(scene, rows=7).splitlines()) == 10


def test_every_deputy_of_a_formation_is_shown(tmp_path):
    """Whatever the spacecraft are called, each has its orbit, place and thrust."""
    bag = full_run_samples.BagOfMessages(tmp_path / "bag")
    names = ("alpha", "bravo", "charlie", "deputy_7")
    for second in range(0, 60, 10):
        time = full_run_samples.START + second * SECOND
        for number, name in enumerate(names):
            orbit = OrbitState(child_frame_id=name, source=OrbitState.SOURCE_TRUTH)
            orbit.header.frame_id = "gcrf"
            orbit.position, orbit.velocity = full_run_samples.orbit(second, 1e-4 * number)
            bag.add(f"/{name}/truth/orbit", time, orbit)
            if name == "alpha":
                continue
            for topic, along in (("relative_state_truth", 100.0), ("relative_state", 101.0)):
                state = RelativeState(child_frame_id=name, solution=RelativeState.SOLUTION_FIXED)
                state.header.frame_id = "alpha/rtn"
                state.position = [0.0, along * number, 0.0]
                bag.add(f"/{name}/{topic}", time, state)
            thrust = AccelStamped()
            thrust.header.frame_id = "alpha/rtn"
            thrust.accel.linear.y = 0.01 * number
            bag.add(f"/{name}/propulsion/thrust_applied", time, thrust)
    bag.writer.close()
    scene = read_scene(tmp_path / "bag")
    assert scene.notes == []
    sent = {series["name"]: series for series in scene.as_json()["series"]}
    for number, name in enumerate(names):
        assert len(sent[f"orbit/{name}/truth"]["time"]) == 6
        if number:
            assert sent[f"relative/{name}/truth"]["in_track"] == [100.0 * number] * 6
            assert sent[f"relative/{name}/estimate"]["in_track"] == [101.0 * number] * 6
            assert sent[f"thrust/{name}/applied"]["in_track"] == [0.01 * number] * 6
            table = scene_text(scene).split(f"deputy {name}\n")[1].split("\n\n")[0]
            assert f"{101.0 * number:.2f}" in table and f"{0.01 * number:.3f}" in table
    lines = scene_lines(scene, scene.duration)
    assert [line.split()[-1] for line in lines] == list(names[1:])
    assert [float(line.split()[5]) for line in lines] == [101.0, 202.0, 303.0]
    assert not any("alpha" in name for name in sent if name.startswith("relative/"))


def test_a_topic_that_does_not_decode_is_named(tmp_path):
    from vtff_bag.file.writer import BagWriter

    writer = BagWriter(tmp_path / "bag", steady_clock=lambda: 0.0)
    topic = writer.add_topic("/chief/truth/orbit", "vtff_msgs/msg/OrbitState")
    writer.write(topic, b"\x00\x01\x00\x00\x01", START)
    writer.close()
    scene = read_scene(tmp_path / "bag")
    assert not scene.series
    assert "/chief/truth/orbit" in scene.notes[0]


@pytest.mark.parametrize(("duration", "interval"), [(60.0, 1.0), (3600.0, 2.0), (40_000.0, 20.0)])
@given(phase=st.floats(0.0, 0.2))
def test_long_runs_are_thinned_alike_on_every_topic(duration, interval, phase):
    assert sample_interval(duration) == interval
    builder = SceneBuilder(Scene("run", START), interval)
    stamps = [START + round((second + phase) * SECOND) for second in range(300)]
    kept = [stamp for stamp in stamps if builder.claim_slot("/chief/gnss/epoch", stamp)]
    # A topic that begins later keeps samples of the same times, but perhaps for its first.
    others = [stamp for stamp in stamps[7:] if builder.claim_slot("/deputy/gnss/epoch", stamp)]
    assert set(others[1:]) <= set(kept)


def test_no_ephemeris_and_no_boundary_is_thinned():
    builder = SceneBuilder(Scene("run", START))
    for topic in ("/chief/gnss/ephemeris", "/deputy/iono/irregularity_boundaries"):
        assert all(builder.claim_slot(topic, START) for _ in range(5))


def test_region_stands_still_relative_to_the_sun():
    described = RunDescription(arguments={"gnss": str(ROOT / "config/gnss/esf.yaml")})
    (region,) = irregularity_regions(described, START)
    # 2016-03-21 00:59:43 UTC: 20 h local time is 15 deg * (20 - 0.995) east.
    assert region.longitude_west_deg == pytest.approx(15.0 * (20.0 - 3583.0 / 3600.0) - 360.0)
    assert region.width_deg == pytest.approx(30.0)
    assert region.longitude_rate_deg == pytest.approx(-360.0 / 86400.0)
    assert (region.altitude_bottom, region.altitude_top) == (290e3, 350e3)


@pytest.mark.parametrize("named", [None, "", "<none>", "/not/here.yaml"])
def test_without_the_file_there_is_no_region(named):
    assert irregularity_regions(RunDescription(arguments={"gnss": named}), START) == ()


def deputy_state(solution, position=(0.0, 100.0, 0.0)):
    message = RelativeState(child_frame_id="deputy", solution=solution)
    message.position = np.array(position)
    message.covariance = np.diag([1e-6, 4e-6, 9e-6, 1.0, 1.0, 1.0]).ravel()
    return message


def test_a_fix_that_is_lost_for_one_second_of_a_long_run_is_an_event():
    builder = SceneBuilder(Scene("run", START), interval=20.0)
    for second in range(100):
        fixed = second != 47
        state = deputy_state(RelativeState.SOLUTION_FIXED if fixed else RelativeState.SOLUTION_CODE)
        state.header.stamp = to_stamp(START + second * SECOND)
        stamp = START + second * SECOND
        assert builder.claim_slot("/deputy/relative_state", stamp)
        builder.add("/deputy/relative_state", stamp, state)
    scene = builder.scene
    assert [(event.time, event.text) for event in scene.events] == [
        (0.0, "deputy: integers fixed"),
        (47.0, "deputy: integers lost, codes only"),
        (48.0, "deputy: integers fixed"),
    ]
    assert len(scene.series["relative/deputy/estimate"].time) == 6  # thinned as all series are
    assert scene.series["covariance/deputy"].at(0.0) == {
        "rr": 1e-6, "rt": 0.0, "rn": 0.0, "tt": 4e-6, "tn": 0.0, "nn": 9e-6,
    }  # fmt: skip


def test_a_survey_has_walls_that_drift_and_events_with_reasons():
    builder = SceneBuilder(Scene("survey", start=START))
    told = [("default", 0, []), ("default", 0, [-60.0, -50.0]), ("transfer", 1, [-60.0])]
    for number, (phase, plans, longitudes) in enumerate(told):
        time = START + 100 * number * SECOND
        message = SurveyGuidance(phase=phase, reason="as told", plans=plans)
        message.wall_longitude_deg = longitudes
        message.wall_drift, message.wall_sigma = [[v] * len(longitudes) for v in (100.0, 5e3)]
        message.header.stamp = to_stamp(time)
        builder.add("/formation/survey", time, message)
    scene = builder.scene
    assert [(event.time, event.kind, event.text) for event in scene.events] == [
        (200.0, "survey", "survey: transfer, as told")
    ]
    wall = scene.series["wall/1"].at(250.0)
    assert wall["longitude_deg"] == -60.0
    assert wall["rate_deg"] * 3600.0 == pytest.approx(math.degrees(100.0 * 3600.0 / 6.75e6))
    assert math.isnan(scene.series["wall/2"].at(250.0)["longitude_deg"])
    assert scene.series["wall/2"].at(150.0)["longitude_deg"] == -50.0


def test_safety_faults_and_densities_are_shown():
    builder = SceneBuilder(Scene("run", START))
    safety = FormationSafety(hard_radius=30.0, spacecraft=["deputy"], reason=["thruster stuck on"])
    for second, mode in enumerate((0, 0, 2, 2)):
        safety.mode, safety.isolated_axes = [mode], [0]
        safety.header.stamp = to_stamp(START + second * SECOND)
        builder.add("/formation/safety", START + second * SECOND, safety)
    status = DiagnosticStatus(name="relative_ekf", level=DiagnosticStatus.ERROR, message="no fix")
    array = DiagnosticArray(status=[status])
    array.header.stamp = to_stamp(START + 5 * SECOND)
    builder.add("/diagnostics", START, array)
    builder.add("/diagnostics", START, array)  # still the same fault
    density = ElectronDensity(
        system=[0, 255], prn=[7, 0], density=[9e11, 1e12], density_sigma=[1e11, 2e10]
    )
    density.position = np.array([6_778_137.0, 0.0, 0.0])
    density.header.stamp = to_stamp(START + 6 * SECOND)
    builder.add("/deputy/iono/electron_density", START, density)
    scene = builder.scene
    assert scene.hard_radius == 30.0
    assert [(event.time, event.kind, event.text) for event in scene.events] == [
        (2.0, "safety", "deputy: evades: thruster stuck on"),
        (5.0, "fault", "relative_ekf: no fix"),
    ]
    sample = scene.series["density/deputy"].at(6.0)
    assert sample["altitude"] == pytest.approx(400e3)
    assert (sample["per_cm3"], sample["sigma"]) == (pytest.approx(1e6), pytest.approx(2e4))


def test_manoeuvres_are_burns_with_pauses_between():
    thrust = Series("thrust", {"deputy": "deputy", "source": "applied"})
    for second in range(300):
        burns = 10 <= second < 20 or 25 <= second < 30 or 200 <= second < 210
        thrust.time.append(float(second))
        for column, value in zip(thrust.values, (0.0, 0.02 if burns else 1e-5, 0.0), strict=True):
            column.append(value)
    first, second = find_manoeuvres(thrust)
    assert (first.time, first.text) == (10.0, "deputy: thrust for 20 s, 0.3 m/s")
    assert (second.time, second.text) == (200.0, "deputy: thrust for 10 s, 0.2 m/s")
    assert find_manoeuvres(Series("thrust", {"deputy": "deputy", "source": "applied"})) == []

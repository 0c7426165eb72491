"""Exports read back by the programs that they are for, with the numbers of the bag."""

import csv
import datetime
import json
import warnings

import numpy as np
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

import bag_samples  # noqa: E402
import full_run_samples  # noqa: E402

from vtff_analysis.export.columns import (  # noqa: E402
    explode_columns,
    message_columns,
    unit_of_comment,
)
from vtff_analysis.recordings.orbits import read_orbits  # noqa: E402
from vtff_bag.file.reader import BagReader  # noqa: E402
from vtff_bringup.cli import make_app  # noqa: E402
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_gnss.signals import satellite_name  # noqa: E402

SECONDS = 60
FORMATS = ("--csv", "--parquet", "--rinex", "--sp3", "--oem", "--czml")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The bag and the folder with all formats."""
    folder = tmp_path_factory.mktemp("export")
    bag = full_run_samples.write_full_run(folder / "made", seconds=SECONDS)
    result = CliRunner().invoke(make_app(), ["export", str(bag), *FORMATS])
    assert result.exit_code == 0, result.output
    return BagReader(bag), folder / "made_export"


def messages(reader, topic):
    return [decoded.message for decoded in reader.messages(topic)]


def test_csv_has_one_row_a_signal_with_exact_numbers(exported):
    reader, folder = exported
    with (folder / "chief_gnss_epoch.csv").open() as file:
        rows = list(csv.DictReader(file))
    epochs = messages(reader, "/chief/gnss/epoch")
    assert len(rows) == sum(len(epoch.prn) for epoch in epochs)
    expected = [value for epoch in epochs for value in epoch.pseudorange]
    assert [float(row["pseudorange"]) for row in rows] == expected
    stamps = {int(row["header.stamp_ns"]) for row in rows}
    assert stamps == {full_run_samples.START + s * 10**9 for s in range(SECONDS + 1)}
    assert {row["header.frame_id"] for row in rows} == {""}


def test_csv_of_plain_messages_has_one_row_each(exported):
    reader, folder = exported
    with (folder / "deputy_truth_orbit.csv").open() as file:
        rows = list(csv.DictReader(file))
    expected = [message.position[1] for message in messages(reader, "/deputy/truth/orbit")]
    assert [float(row["position[1]"]) for row in rows] == expected
    assert {row["child_frame_id"] for row in rows} == {"deputy"}


def test_parquet_has_one_row_a_message(exported):
    reader, folder = exported
    for topic in reader.topics.values():
        name = topic.name.strip("/").replace("/", "_")
        table = parquet.read_table(folder / f"{name}.parquet")
        assert table.num_rows == topic.message_count, topic.name
    table = parquet.read_table(folder / "chief_gnss_epoch.parquet")
    expected = [epoch.pseudorange.tolist() for epoch in messages(reader, "/chief/gnss/epoch")]
    assert table["pseudorange"].to_pylist() == expected


def test_parquet_tells_units_times_and_source(exported):
    _, folder = exported
    schema = parquet.read_schema(folder / "deputy_relative_state.parquet")
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in schema}
    assert units["position[2]"] == "m" and units["velocity[0]"] == "m/s" and units["age"] == "s"
    assert units["log_time_ns"] == "ns since 1970-01-01, UTC" == units["header.stamp_ns"]
    assert units["solution"] == units["ratio"] == units["child_frame_id"] == ""
    told = json.loads(parquet.read_metadata(folder / "chief_gnss_epoch.parquet").metadata[b"vtff"])
    start = np.datetime64(full_run_samples.START, "ns")
    assert told["first_time"] == f"{start} UTC"
    assert told["last_time"] == f"{start + np.timedelta64(SECONDS, 's')} UTC"
    assert (told["topic"], told["bag"]) == ("/chief/gnss/epoch", "made")
    assert told["type"] == "vtff_msgs/msg/GnssObservations" and told["vtff"]


@pytest.mark.parametrize(
    ("comment", "unit"),
    [
        ("m, derivative seen in the rotating frame", "m"),
        ("m/s", "m/s"),
        ("electrons/m^3", "electrons/m^3"),
        ("s of week", "s"),
        ("rad at toe", "rad"),
        ("mode of the controller", ""),
        ("stamp: time of validity", ""),
        ("second-best over best", ""),
        ("TECU, one sigma", "TECU"),
        ("0 = healthy", ""),
        ("", ""),
    ],
)
def test_units_of_comments(comment, unit):
    assert unit_of_comment(comment) == unit


def test_parquet_is_the_default(tmp_path):
    bag_samples.write_bag(tmp_path / "texts", bag_samples.sample_messages(9))
    result = CliRunner().invoke(make_app(), ["export", str(tmp_path / "texts")])
    assert result.exit_code == 0
    written = list((tmp_path / "texts_export").iterdir())
    assert written and {path.suffix for path in written} == {".parquet"}


def test_columns_of_every_message_have_the_declared_types(tmp_path):
    """Also where the first rows have empty lists, and with numbers that only uint64 can hold."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from vtff_analysis.export import tables
    from vtff_msgs.msg import ReceiverLog, SlantTec

    bag = full_run_samples.BagOfMessages(tmp_path / "bag")
    for number in range(3):
        time = full_run_samples.START + number
        full = number == 2
        bag.add("/tec", time, SlantTec(stec_tecu=[1.5, 2.5] if full else [], system=[1] * 2 * full))
        status = DiagnosticStatus(name="a", level=DiagnosticStatus.WARN, message="=")
        bag.add("/diagnostics", time, DiagnosticArray(status=[status] * full))
        bag.add("/raw", time, ReceiverLog(name="RANGEB", data=[0, 255] * number))
    text = bag.writer.add_topic("/text", "std_msgs/msg/String")
    bag.writer.write(text, bag_samples.string_message("late"), 2**63)
    bag.writer.close()
    reader = BagReader(tmp_path / "bag")
    for batch in (1, 5000):
        tables.BATCH, before = batch, tables.BATCH
        try:
            files, notes = tables.export_parquet(reader, tmp_path)
        finally:
            tables.BATCH = before
        assert notes == [] and len(files) == 4
    assert parquet.read_table(tmp_path / "tec.parquet")["stec_tecu"].to_pylist() == [
        *([], [], [1.5, 2.5])
    ]
    assert parquet.read_table(tmp_path / "raw.parquet")["data"].to_pylist()[1] == [0, 255]
    (level,) = parquet.read_table(tmp_path / "diagnostics.parquet")["status"].to_pylist()[2]
    assert json.loads(level)["level"] == 1
    assert parquet.read_table(tmp_path / "text.parquet")["log_time_ns"].to_pylist() == [2**63]


def test_a_long_topic_is_written_in_batches(exported, monkeypatch, tmp_path):
    from vtff_analysis.export import tables

    reader, folder = exported
    monkeypatch.setattr(tables, "BATCH", 7)
    for export, suffix in ((tables.export_csv, "csv"), (tables.export_parquet, "parquet")):
        export(reader, tmp_path)
        for name in ("chief_gnss_epoch", "deputy_relative_state"):
            again, before = tmp_path / f"{name}.{suffix}", folder / f"{name}.{suffix}"
            if suffix == "csv":
                assert again.read_bytes() == before.read_bytes()
            else:
                assert parquet.read_table(again).equals(parquet.read_table(before))


def test_rinex_is_read_by_rtklib(exported):
    pyrtklib = pytest.importorskip("pyrtklib", reason="the referee is not installed")
    reader, folder = exported
    nav, obs, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    for name in ("chief.rnx", "chief_nav.rnx"):
        assert pyrtklib.readrnx(str(folder / name), 1, "", obs, nav, station) == 1
    expected = {}
    for epoch in messages(reader, "/chief/gnss/epoch"):
        for prn, code, phase in zip(
            epoch.prn, epoch.pseudorange, epoch.carrier_phase_cycles, strict=True
        ):
            expected[round(epoch.gps_time_of_week), int(prn)] = (code, phase)
    week = pyrtklib.Arr1Dint(1)
    number = pyrtklib.Arr1Dint(1)
    found = {}
    for i in range(obs.n):
        observation = obs.data[i]
        pyrtklib.satsys(observation.sat, number)
        second = round(pyrtklib.time2gpst(observation.time, week))
        found[second, number[0]] = (observation.P[0], observation.L[0])
    assert found.keys() == expected.keys()
    for key, (code, phase) in expected.items():
        assert found[key] == pytest.approx((code, phase), abs=6e-4)  # F14.3
    assert sum(nav.eph[i].sat > 0 for i in range(nav.n)) == 31


def test_rinex_is_read_by_georinex(exported):
    georinex = pytest.importorskip("georinex", reason="the referee is not installed")
    reader, folder = exported
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = georinex.load(folder / "chief.rnx")
        ephemerides = georinex.load(folder / "chief_nav.rnx")
    first = messages(reader, "/chief/gnss/epoch")[0]
    for prn, code in zip(first.prn, first.pseudorange, strict=True):
        value = theirs["C1C"].sel(sv=satellite_name(0, int(prn))).values[0]
        assert float(value) == pytest.approx(code, abs=6e-4)
    assert len(ephemerides.sv) == 31


@pytest.mark.parametrize("craft", ["chief", "deputy"])
def test_oem_is_read_by_the_oem_package(exported, craft):
    oem = pytest.importorskip("oem", reason="the referee is not installed")
    reader, folder = exported
    (segment,) = oem.OrbitEphemerisMessage.open(str(folder / f"{craft}.oem")).segments
    assert segment.metadata["REF_FRAME"] == "GCRF"
    expected = messages(reader, f"/{craft}/truth/orbit")
    states = list(segment.states)
    assert len(states) == len(expected)
    for state, message in zip(states, expected, strict=True):
        assert state.position * 1e3 == pytest.approx(message.position, abs=1e-6)
        assert state.velocity * 1e3 == pytest.approx(message.velocity, abs=1e-9)
        utc = datetime.datetime.fromtimestamp(message.header.stamp.sec, datetime.timezone.utc)
        assert state.epoch.isot.startswith(f"{utc:%Y-%m-%dT%H:%M:%S}")


def test_sp3_is_read_by_georinex(exported):
    georinex = pytest.importorskip("georinex", reason="the referee is not installed")
    reader, folder = exported
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = georinex.load(folder / "orbits.sp3")
    for name, orbit in zip(("L01", "L02"), read_orbits(reader), strict=True):
        chosen = theirs.sel(sv=name)
        assert chosen["position"].values * 1e3 == pytest.approx(orbit.state_itrf[:, :3], abs=6e-4)
        assert chosen["velocity"].values * 0.1 == pytest.approx(orbit.state_itrf[:, 3:], abs=6e-8)
    # GPS time is 17 s ahead of UTC in 2016.
    assert str(theirs.time.values[0]).startswith("2016-03-21T01:00:17")


def test_sp3_lines_stand_where_the_format_wants_them(exported):
    _, folder = exported
    lines = (folder / "orbits.sp3").read_text().splitlines()
    assert lines[0].startswith("#dV2016  3 21  1  0 17.00000000") and len(lines[0]) == 60
    assert [line[:2] for line in lines[2:12]] == ["+ "] * 5 + ["++"] * 5
    assert {len(line) for line in lines[2:12]} == {60}
    assert all(len(line) <= 80 for line in lines)
    assert lines[-1] == "EOF"


def test_czml_holds_what_czml3_makes_of_the_same_states(exported):
    czml3 = pytest.importorskip("czml3", reason="the referee is not installed")
    from czml3.properties import Position
    from czml3.types import Cartesian3Value

    reader, folder = exported
    document, *packets = json.loads((folder / "orbits.czml").read_text())
    assert document["id"] == "document" and document["version"] == czml3.CZML_VERSION
    for packet, orbit in zip(packets, read_orbits(reader), strict=True):
        samples = [
            value
            for time, state in zip(orbit.time, orbit.state_gcrf, strict=True)
            for value in (time - orbit.time[0], *state[:3])
        ]
        theirs = Position(
            epoch=packet["position"]["epoch"],
            referenceFrame="INERTIAL",
            interpolationAlgorithm="LAGRANGE",
            interpolationDegree=5,
            cartesian=Cartesian3Value(values=samples),
        )
        made = json.loads(czml3.Packet(id=orbit.name, position=theirs).dumps())
        ours, made = packet["position"], made["position"]
        assert ours.pop("cartesian") == pytest.approx(made.pop("cartesian"), abs=1e-4)
        for key, value in ours.items():
            if key == "epoch":
                assert made[key].startswith(value.removesuffix("Z"))
            else:
                assert made[key] == value


def test_orbits_of_receivers_stand_in_for_truth(tmp_path):
    bag = full_run_samples.BagOfMessages(tmp_path / "bag")
    from vtff_msgs.msg import GnssFix

    for second in range(5):
        fix = GnssFix(status=GnssFix.STATUS_SINGLE if second else GnssFix.STATUS_NONE)
        fix.position, fix.velocity = full_run_samples.earth_fixed(float(second))
        bag.add("/chief/gnss/fix", full_run_samples.START + second * 10**9, fix)
    bag.writer.close()
    (orbit,) = read_orbits(BagReader(tmp_path / "bag"))
    assert (orbit.name, orbit.source, len(orbit.time)) == ("chief", "receiver", 4)
    again = state_gcrf_to_itrf(orbit.time[0], orbit.state_gcrf[0])
    assert again == pytest.approx(orbit.state_itrf[0], abs=1e-6)
    (thinned,) = read_orbits(BagReader(tmp_path / "bag"), interval=2.0)
    assert len(thinned.time) == 2


def test_lists_of_different_length_become_texts():
    columns = {"log_time_ns": [1, 2], "a": [[1, 2], [3]], "b": [[1], [2, 3]]}
    assert explode_columns(columns)["a"] == ["[1, 2]", "[3]"]
    assert explode_columns({"log_time_ns": [1], "a": [None]}) == {"log_time_ns": [1], "a": [None]}


def test_empty_lists_keep_the_row():
    columns = {"log_time_ns": [1, 2], "a": [[], [3, 4]], "c": ["x", "y"]}
    assert explode_columns(columns) == {
        "log_time_ns": [1, 2, 2],
        "a": [None, 3, 4],
        "c": ["x", "y", "y"],
    }


def test_no_messages_give_no_rows():
    assert message_columns([]) == {"log_time_ns": []}


def test_what_a_bag_does_not_hold_is_named(tmp_path):
    bag_samples.write_bag(tmp_path / "texts", bag_samples.sample_messages(9))
    for arguments, named in (
        (["--rinex"], "no observations"),
        (["--oem"], "no orbits"),
    ):
        result = CliRunner().invoke(make_app(), ["export", str(tmp_path / "texts"), *arguments])
        assert result.exit_code == 2 and named in result.output, result.output
    result = CliRunner().invoke(make_app(), ["export", str(tmp_path / "texts"), "--csv"])
    assert result.exit_code == 0
    text = (tmp_path / "texts_export" / "topic_0.csv").read_text().splitlines()
    assert text[0] == "log_time_ns,data" and len(text) == 4
    assert np.all([line.split(",")[0].isdigit() for line in text[1:]])

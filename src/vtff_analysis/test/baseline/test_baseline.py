"""Baselines of recorded receivers: real and simulated pairs, summaries, truth, error messages."""

from __future__ import annotations

import csv
import dataclasses
import errno
import json
import pathlib

import numpy as np
import pytest
from bag_samples import sample_messages, write_bag
from pyarrow import parquet
from sample_files import export_sample
from shared_data import require_shared
from typer.testing import CliRunner

from vtff_analysis.baseline.bag_sources import from_bag
from vtff_analysis.baseline.output import write_csv, write_epochs, write_plot
from vtff_analysis.baseline.processing import BaselineOptions, BaselineRun, process_baseline
from vtff_analysis.baseline.sources import BaselineError, TrueBaseline, from_files
from vtff_analysis.baseline.summary import summarise
from vtff_analysis.baseline.truth import errors_local
from vtff_bag.file.message_definitions import message_definition
from vtff_bag.file.metadata import offered_qos
from vtff_bag.file.writer import BagWriter
from vtff_bringup.cli import make_app
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.constants import SYSTEM_GALILEO
from vtff_gnss.files.observation_files import open_observations
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.rinex.observation import read_rinex_observation
from vtff_gnss.rinex.write.navigation import write_rinex_navigation
from vtff_gnss.rinex.write.observation import write_rinex_observation
from vtff_nav.relative.common.measurements import MeasurementNoise

SPIRENT = "data/navigation/spirent_dynamic"
LEO = "data/navigation/leo_250m"
OEM = "data/oem"
ROVER = f"{SPIRENT}/Rover-dynamic_MO_Spirent.obs.gz"
BASE = f"{SPIRENT}/Base-static_MO_Spirent.obs.gz"
NAVIGATION = f"{SPIRENT}/RINEX_GN_Spirent.23N"
MOTION = f"{SPIRENT}/Rover-dynamic_motion_Spirent.csv.gz"


def shared(*paths):
    return tuple(require_shared(path) for path in paths)


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """Return the sample bag as RINEX files: two receivers in orbit."""
    return export_sample(tmp_path_factory.mktemp("sample"))


def vtff(*arguments):
    return CliRunner().invoke(make_app(), [str(argument) for argument in arguments])


def computed(out, *arguments):
    """Run `vtff baseline` and return its numbers."""
    result = vtff("baseline", *arguments, "--out", out)
    assert result.exit_code == 0, result.output
    return json.loads((out / "baseline.json").read_text()), result.output


def run_of(count=20, **changes) -> BaselineRun:
    """Return a run of a rover at rest 3, 4, 12 m east, north, up of its base, all fixed."""
    generator = np.random.default_rng(1)
    start = parse_epoch("2024-01-10T00:00:00 GPS").nanoseconds
    local = np.array([3.0, 4.0, 12.0]) + generator.normal(0.0, 1e-3, (count, 3))
    columns = {
        "axes": ("east", "north", "up"),
        "time_nanoseconds": start + np.arange(count) * 1_000_000_000,
        "solution": np.full(count, 4, dtype=np.uint8),
        "baseline_itrf": local.copy(),
        "baseline_local": local,
        "sigma_local": np.full((count, 3), 1e-3),
        "rotation_to_local": np.tile(np.eye(3), (count, 1, 1)),
        "position_base_itrf": np.tile([6.4e6, 0.0, 0.0], (count, 1)),
        "satellites_used": np.full(count, 8),
        "ambiguities_fixed": np.full(count, 14),
        "ratio": np.full(count, 10.0),
        "age": np.zeros(count),
        "degraded": {},
        "unpaired": (0, 0),
        **changes,
    }
    return BaselineRun(**columns)


def test_spirent_pair_reaches_the_bound_of_issue_4(tmp_path):
    found, _ = computed(tmp_path, *shared(ROVER, BASE, NAVIGATION), "--truth", *shared(MOTION))
    assert (found["epochs"], found["fixed_fraction"]) == (601, 1.0)
    assert found["errors"]["epochs"] == 601
    assert found["errors"]["rms_3d"] <= 0.35e-3
    assert (tmp_path / "baseline.png").stat().st_size > 20_000


def test_real_static_pair_of_novatel_receivers(tmp_path):
    logs = shared(f"{OEM}/gavlab_test2_rcvr2.dat", f"{OEM}/gavlab_test2_rcvr1.dat")
    found, output = computed(tmp_path, *logs, "--dynamics", "static")
    assert (found["epochs"], found["fixed_fraction"]) == (426, 1.0)
    assert np.linalg.norm(found["scatter"]) <= 5e-3
    assert 1.69 < np.linalg.norm(found["mean"]) < 1.73
    assert "NovAtel RANGECMP" in output and "1 damaged" in output


def test_real_pair_without_dynamics_scatters_as_little_as_with_rtklib(tmp_path):
    """RTKLIB, whose low satellites weigh less too, has 1.5, 1.5, 3.4 mm; with equal weights 2.7."""
    logs = shared(f"{OEM}/gavlab_test2_rcvr2.dat", f"{OEM}/gavlab_test2_rcvr1.dat")
    found, _ = computed(tmp_path, *logs, "--dynamics", "kinematic")
    assert (found["epochs"], found["fixed_fraction"]) == (426, 1.0)
    assert (np.array(found["scatter"]) <= [1.5e-3, 1.5e-3, 3.4e-3]).all()


def test_rtklib_finds_the_same_baseline_in_the_files_written_from_the_logs(tmp_path):
    rtklib = pytest.importorskip("pyrtklib", reason="the referee is not installed")
    rover, base = shared(f"{OEM}/gavlab_test2_rcvr2.dat", f"{OEM}/gavlab_test2_rcvr1.dat")
    logs = {"rover": open_observations(rover), "base": open_observations(base)}
    for name, log in logs.items():
        write_rinex_observation(tmp_path / name, log.table)
    write_rinex_navigation(tmp_path / "nav", logs["base"].ephemerides + logs["rover"].ephemerides)
    options, output, files = rtklib.prcopt_t(), rtklib.solopt_t(), rtklib.filopt_t()
    rtklib.resetsysopts()
    rtklib.getsysopts(options, output, files)
    options.mode, options.nf, options.modear = rtklib.PMODE_KINEMA, 2, 1
    options.elmin, options.navsys, options.refpos = np.radians(10.0), 1, 0
    for axis, coordinate in enumerate(logs["base"].approximate_position):
        options.rb[axis] = coordinate
    output.posf = 1  # Earth-fixed
    arguments = [rtklib.gtime_t(), rtklib.gtime_t(), 0.0, 0.0, options, output, rtklib.filopt_t()]
    inputs = [str(tmp_path / name) for name in ("rover", "base", "nav")]
    result = rtklib.Arr1Dchar(str(tmp_path / "result"))
    assert rtklib.postpos(*arguments, inputs, len(inputs), result, "", "") == 0
    lines = (tmp_path / "result").read_text().splitlines()
    rows = np.array([line.split()[2:6] for line in lines if line[0] != "%"], dtype=float)
    assert len(rows) == 429 and (rows[:, 3] == 1).all()
    theirs = rows[:, :3].mean(axis=0) - logs["base"].approximate_position
    sources = from_files(rover, base)
    noise = MeasurementNoise(1.0, 0.003, use_receiver_sigmas=False)
    position = logs["base"].approximate_position
    run = process_baseline(
        sources,
        BaselineOptions(
            dynamics="static", noise=noise, position_base_itrf=position, end=sources.base.time(40)
        ),
    )
    assert (run.solution == 4).all()
    np.testing.assert_allclose(run.baseline_itrf.mean(axis=0), theirs, atol=0.01)


@pytest.mark.slow
def test_leo_pair_reaches_the_bound_of_issue_4(tmp_path):
    files = shared(f"{LEO}/250m_B.obs.gz", f"{LEO}/250m_A.obs.gz", NAVIGATION)
    found, _ = computed(tmp_path, *files, "--truth", *shared(f"{LEO}/250m_truth.npz"))
    assert found["errors_converged"]["rms_3d"] <= 0.6e-3
    # RINEX without Doppler: the first epoch gives no velocity.
    assert found["counts"]["fixed"] == 6000


def test_epochs_of_a_bag_give_what_the_files_give(tmp_path, sample):
    sources = from_files(sample.rover, sample.base, [sample.navigation])
    write_sample_bag(tmp_path / "pair", sources, 20)
    options = BaselineOptions(dynamics="orbital", elevation_mask_deg=5.0)
    start = sources.base.time(0)
    from_bag_run = process_baseline(from_bag(tmp_path / "pair"), options)
    limited = dataclasses.replace(options, end=start + 19)
    expected = process_baseline(sources, limited)
    np.testing.assert_array_equal(from_bag_run.baseline_itrf, expected.baseline_itrf)
    assert len(expected) == 20 and (expected.solution[1:] == 4).all()
    with pytest.raises(BaselineError, match="no message on /other/gnss/epoch"):
        from_bag(tmp_path / "pair", "other")


def write_sample_bag(directory, sources, count):
    from rclpy.serialization import serialize_message

    from vtff_node.conversions.gnss import ephemeris_to_message, observations_to_message

    writer = BagWriter(directory, {})

    def topic(name, kind):
        kind = f"vtff_msgs/msg/{kind}"
        return writer.add_topic(name, kind, [offered_qos()], "", message_definition(kind))

    names = ("deputy", "chief", "other")
    epochs = {name: topic(f"/{name}/gnss/epoch", "GnssObservations") for name in names}
    ephemerides = topic("/chief/gnss/ephemeris", "GnssEphemeris")
    tables = {"deputy": sources.rover, "chief": sources.base}
    first = None
    for index in range(count):
        for name, table in tables.items():
            epoch = table.epoch(index)
            stamp = epoch.time.to_unix_nanoseconds()
            if first is None:
                first = stamp
                for ephemeris in sources.ephemerides:
                    content = serialize_message(ephemeris_to_message(ephemeris))
                    writer.write(ephemerides, content, first)
            content = serialize_message(observations_to_message(epoch, f"{name}/gnss_antenna"))
            writer.write(epochs[name], content, stamp)
    writer.close()


def test_limits_and_unpaired_epochs(tmp_path, sample):
    base, rover = tmp_path / "base.rnx", tmp_path / "rover.rnx"
    for source, path, rows in (
        (sample.base, base, range(0, 40, 2)),
        (sample.rover, rover, range(30)),
    ):
        epochs = read_rinex_observation(source).table
        table = ObservationTable.from_epochs(epochs.epoch(i) for i in rows)
        write_rinex_observation(path, table)
    navigation = sample.navigation
    found, output = computed(tmp_path / "all", rover, base, navigation)
    assert found["epochs"] == 15
    assert "15 in 28 s, 15 + 5 without partner" in output
    options = ("--start", "10", "--end", "2016-03-21T01:00:20")
    found, _ = computed(tmp_path / "some", rover, base, navigation, *options)
    assert (found["epochs"], found["duration"]) == (6, 10.0)
    result = vtff("baseline", rover, base, navigation, "--start", "9000", "--out", tmp_path / "no")
    assert result.exit_code == 2 and "within --start and --end" in result.output
    assert not (tmp_path / "no").exists()


def test_own_csv_as_truth_gives_no_error(tmp_path):
    run = run_of()
    path = write_csv(run, None, tmp_path / "baseline.csv")
    np.testing.assert_allclose(errors_local(run, path), 0.0, atol=1e-6)
    with open(path, encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    assert rows[1]["time_gps"] == "2024-01-10T00:00:01"
    assert rows[1]["solution"] == "fixed"


def test_epochs_are_parquet_with_units_and_all_digits(tmp_path):
    run = run_of()
    errors = np.full((len(run), 3), 0.25)
    path = write_epochs(run, errors, tmp_path, "parquet", "rover relative to base")
    np.testing.assert_array_equal(errors_local(run, path), 0.0)
    table = parquet.read_table(path)
    assert np.array_equal(table["baseline_x"].to_numpy(), run.baseline_itrf[:, 0])
    assert table.schema.field("error_east").metadata[b"unit"] == b"m"
    told = json.loads(table.schema.metadata[b"vtff"])
    assert told["source"] == "rover relative to base"
    csv_path = write_epochs(run, errors, tmp_path, "csv", "")
    with csv_path.open(encoding="ascii") as file:
        assert next(csv.reader(file)) == [*table.column_names[:-7], *table.column_names[-4:],
                                          *table.column_names[-7:-4]]  # fmt: skip


def test_truth_only_where_it_is_known():
    run = run_of(5)
    truth = TrueBaseline(run.time_nanoseconds[1:3], run.baseline_itrf[1:3] - [0.0, 0.0, 0.001])
    errors = errors_local(run, truth)
    assert np.isnan(errors[[0, 3, 4]]).all()
    np.testing.assert_allclose(errors[1:3], [[0.0, 0.0, 0.001]] * 2, atol=1e-12)
    summary = summarise(run, errors)
    assert summary.errors.epochs == 2
    assert summary.errors.rms_3d == pytest.approx(0.001)
    assert summary.errors_converged is None


@pytest.mark.parametrize(
    ("content", "name"),
    [(b"", "a.csv"), (b"x,y\n1,2\n", "a.csv"), (b"PK\x03\x04broken", "a.npz"), (b"no", "a.npz"),
     (b"\x1f\x8b broken", "a.csv.gz")],
)  # fmt: skip
def test_files_that_are_no_truth(content, name, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(BaselineError, match=name):
        errors_local(run_of(), path)


def test_truth_of_another_day(tmp_path):
    run = run_of()
    later = dataclasses.replace(run, time_nanoseconds=run.time_nanoseconds + 86_400_000_000_000)
    path = write_csv(later, None, tmp_path / "later.csv")
    with pytest.raises(BaselineError, match="no epoch in common"):
        errors_local(run, path)


def test_summary_counts_only_what_is_fixed():
    solution = np.full(20, 4, dtype=np.uint8)
    solution[:5] = [0, 1, 2, 3, 3]
    local = run_of().baseline_local.copy()
    local[0], local[1:5] = np.nan, 50.0
    summary = summarise(run_of(solution=solution, baseline_local=local))
    assert summary.counts == {"none": 1, "predicted": 1, "code": 1, "float": 2, "fixed": 15}
    assert summary.time_to_first_fix == 5.0
    assert summary.fixed_fraction == 0.75
    assert summary.mean == pytest.approx((3.0, 4.0, 12.0), abs=1e-3)
    assert summary.longest == pytest.approx(13.0, abs=5e-3)
    assert summary.is_at_rest and max(summary.scatter) < 2e-3


def test_summary_without_any_solution_and_plots_of_all_kinds(tmp_path):
    nothing = np.full((20, 3), np.nan)
    run = run_of(solution=np.zeros(20, np.uint8), baseline_local=nothing, sigma_local=nothing)
    summary = summarise(run)
    assert summary.mean is None and summary.time_to_first_fix is None
    moving = run_of()
    moving = dataclasses.replace(moving, baseline_local=moving.baseline_local * 100.0
                                 * np.arange(20.0)[:, None])  # fmt: skip
    single = run_of(1)
    for index, (drawn, errors) in enumerate(
        [(run, None), (moving, None), (moving, moving.sigma_local), (single, None)]
    ):
        path = write_plot(drawn, errors, tmp_path / f"{index}.png", "title")
        assert path.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent.rnx", "base.rnx"], "absent.rnx: No such file"),
        (["text", "text"], "text: neither RINEX nor a NovAtel log"),
        (["absent"], "absent: no such file or bag"),
        (["text"], "is no bag: name the observations of the base too"),
        (["bag", "text"], "is a bag, which holds both receivers"),
        (["folder", "text"], "folder: not a bag"),
        (["folder"], "folder"),
        (["text", "text", "--dynamics", "fast"], "'fast' is not one of 'static'"),
        (["text", "text", "--estimator", "mine"], "'mine' is not one of 'cdgps'"),
        (["text", "text", "--signals", "X9"], "--signals 'X9'"),
    ],
)
def test_wrong_arguments_are_named(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pathlib.Path("text").write_text("nothing of use")
    pathlib.Path("folder").mkdir()
    write_bag(pathlib.Path("bag"), sample_messages(3))
    result = vtff("baseline", *arguments)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.output.split())
    assert not list(tmp_path.glob("baseline_*"))


def test_a_full_disk_is_no_wrong_argument(tmp_path, sample, monkeypatch):
    def fail(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("vtff_analysis.baseline.output.write_epochs", fail)
    result = vtff("baseline", *sample, "--end", "5", "--out", tmp_path / "out")
    assert result.exit_code == 1, result.output
    assert "out: No space left on device" in result.output.replace("\n", "")


def test_wrong_arguments_with_good_files(tmp_path, sample):
    files = [*sample]
    galileo = [tmp_path / "rover_e.rnx", tmp_path / "base_e.rnx"]
    for source, path in zip(files[:2], galileo, strict=True):
        table = open_observations(source, signals=("1C",)).table
        systems = np.full_like(table.columns["system"], SYSTEM_GALILEO)
        columns = {**table.columns, "system": systems}
        write_rinex_observation(path, dataclasses.replace(table, columns=columns))
    for arguments, message in (
        (files[:2], "no ephemerides: "),
        ([*galileo, files[2], "--signals", "E1"], "no ephemerides of the systems E"),
        ([*files, "--dynamics", "kinematic"], "--dynamics kinematic: the base is in orbit"),
        ([*files, "--start", "soon"], "--start: epoch 'soon GPS'"),
        ([*files, "--estimate-base", "--base-position", "1", "2", "3"], "contradict each other"),
    ):
        result = vtff("baseline", *arguments, "--out", tmp_path / "out")
        assert result.exit_code == 2, result.output
        assert message in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()


def test_the_estimator_of_the_paper_is_for_receivers_in_orbit(sample):
    sources = from_files(sample.rover, sample.base, [sample.navigation])
    options = BaselineOptions(dynamics="kinematic", estimator="paper")
    with pytest.raises(BaselineError, match="for receivers in orbit only"):
        process_baseline(sources, options)


def test_help_teaches():
    text = " ".join(vtff("baseline", "--help").output.split())
    for word in ("Hatanaka", "--dynamics", "--elevation-mask", "--truth", "For example"):
        assert word in text

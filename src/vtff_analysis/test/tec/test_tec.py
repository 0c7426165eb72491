"""`vtff tec`: real and damaged files, a bag, tables, plots and messages."""

import errno
import gzip
import json
import pathlib

import numpy as np
import pytest
from bag_samples import sample_messages, write_bag
from bias_file_support import sinex_file, sinex_line
from formation_recording import formation_seconds
from pyarrow import compute, csv, parquet
from sample_files import export_sample, require_sample_bag
from shared_data import require_shared
from typer.testing import CliRunner

from vtff_analysis.tec.processing import phase_cutoff_hz
from vtff_bag.file.message_definitions import installed_type_hash, message_definition
from vtff_bag.file.metadata import offered_qos
from vtff_bag.file.reader import BagReader
from vtff_bag.file.writer import BagWriter
from vtff_bringup.cli import make_app
from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_gnss.files.observation_files import open_observations
from vtff_gnss.rinex.compressed_file import decompress_hatanaka
from vtff_gnss.rinex.write.observation import write_rinex_observation
from vtff_gnss.signals import satellite_name
from vtff_iono.content.slant_tec import Rejection
from vtff_iono.formation_ionosphere import FormationIonosphere
from vtff_iono.ionosphere_processor_node import IonosphereProcessorParameters, formation_settings

ROOT = pathlib.Path(__file__).resolve().parents[4]
OBSERVATIONS = "vtff_msgs/msg/GnssObservations"


def bele(name):
    return require_shared(f"data/ionosphere/bele_2024010/{name}")


def run(*arguments):
    return CliRunner().invoke(make_app(), ["tec", *(str(part) for part in arguments)])


@pytest.fixture(scope="module")
def hours(tmp_path_factory):
    """Return three quiet hours of the day at Belem with the signals of GPS and Galileo only."""
    path = bele("BELE00BRA_R_20240100000_01D_30S_MO.crx.gz")
    content, _ = decompress_hatanaka(gzip.decompress(path.read_bytes()), path)
    lines = content.decode().splitlines(keepends=True)
    end = next(i for i, line in enumerate(lines) if "END OF HEADER" in line) + 1
    kept, inside = lines[:end], False
    for line in lines[end:]:
        if line.startswith(">"):
            inside = 4 <= int(line[13:15]) < 7
        if inside:
            kept.append(line)
    folder = tmp_path_factory.mktemp("bele")
    path = folder / "bele.rnx"
    path.write_text("".join(kept))
    return path


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """Return the sample bag as RINEX files of receivers in orbit."""
    return export_sample(tmp_path_factory.mktemp("sample"))


@pytest.fixture(scope="module")
def bag_run(tmp_path_factory):
    """Return what `vtff tec` wrote about the sample bag, and its result."""
    folder = tmp_path_factory.mktemp("bag") / "out"
    result = run(require_sample_bag(), "--format", "parquet", "--out", folder)
    assert result.exit_code == 0, result.output
    return folder


def test_a_batch_with_broken_files(tmp_path, hours):
    """The good file is processed; each of the others has one message that names it."""
    junk = tmp_path / "junk.obs"
    junk.write_text("no RINEX\n")
    cut = tmp_path / "cut.rnx"
    cut.write_text(hours.read_text()[:-300])
    out = tmp_path / "out"
    nav = bele("BRDC00IGS_R_20240100000_01D_MN.rnx.gz")
    biases = bele("CAS0OPSRAP_20240100000_01D_01D_DCB.BIA.gz")
    result = run(
        junk, hours, cut, tmp_path / "absent.rnx", "--nav", nav, "--biases", biases, "--out", out
    )
    assert result.exit_code == 1, result.output
    for name in ("junk.obs", "cut.rnx", "absent.rnx"):
        assert any(
            name in line and line.startswith("error:") for line in result.output.splitlines()
        ), result.output
    assert "1 receivers, 3 failed" in result.output
    (found,) = json.loads((out / "tec.json").read_text())
    assert found["good_samples"] > 5_000
    assert {bias["pair"] for bias in found["receiver_biases"]} >= {"G C1C-C2W", "E C1X-C5X"}
    table = parquet.read_table(out / "bele_tec.parquet")
    metadata = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert metadata["stec_tecu"] == b"TECU" and metadata["elevation_deg"] == b"deg"
    page = (out / "tec.html").read_text(encoding="utf-8")
    assert "receiver bias G C1C-C2W" in page and " ns, in slant TEC " in page
    assert "1 receiver, 3 failed: vertical TEC " in page
    told = json.loads(table.schema.metadata[b"vtff"])
    assert told["table"] == "tec" and told["first_time"].endswith("GPS")
    assert table.num_rows > found["good_samples"]
    good = np.array(table["rejected"]) == 0
    assert np.isfinite(np.array(table["stec_tecu"])[good]).all()
    assert (np.array(table["stec_sigma_tecu"])[good] > 0.0).all()
    assert (out / "bele_roti.parquet").is_file() and (out / "bele_tec.png").stat().st_size > 20_000


def test_files_of_one_name_keep_their_tables_and_the_order(tmp_path, sample):
    """Three at once; what is printed and summed up stands in the order of the arguments."""
    paths = [tmp_path / folder / "same.rnx" for folder in ("one", "two", "three")]
    good = sample.rover.read_text()
    for path, text in zip(paths, (good, "no RINEX\n", good), strict=True):
        path.parent.mkdir()
        path.write_text(text)
    out = tmp_path / "out"
    result = run(
        *paths, "--nav", sample.navigation, "--biases", "none", "--format", "csv", "--out", out
    )
    assert result.exit_code == 1 and "2 receivers, 1 failed" in result.output
    assert result.output.count("no satellite biases are removed") == 2
    told = [line for line in result.output.splitlines() if "same.rnx" in line]
    assert ["error" in line for line in told] == [False, True, False]
    alike = [(out / f"same{end}_tec.csv").read_bytes() for end in ("", "_3")]
    assert alike[0] == alike[1]
    assert csv.read_csv(out / "same_tec.csv").num_rows > 0


def test_a_full_disk_is_no_wrong_argument(tmp_path, sample, monkeypatch):
    def fail(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("vtff_analysis.tec.batch.write_tables", fail)
    out = tmp_path / "out"
    result = run(sample.rover, "--nav", sample.navigation, "--out", out)
    assert result.exit_code == 1
    assert "out: No space left on device" in result.output.replace("\n", "")


def test_biases_of_another_year(tmp_path, sample):
    """Biases of 2024 are refused for the sample, which is of 2016."""
    biases = sinex_file(tmp_path, sinex_line("DSB", "G07", "", "C1C", "C2W", -3.25, 0.5))
    out = tmp_path / "out"
    result = run(sample.rover, "--nav", sample.navigation, "--biases", biases, "--out", out)
    assert result.exit_code == 2
    assert "valid from 2024-01-10" in result.output and "of 2016-03-21" in result.output


def test_chosen_systems(tmp_path, hours):
    """GPS alone has the contents that it has beside Galileo."""
    navigation = ("--nav", bele("BRDC00IGS_R_20240100000_01D_MN.rnx.gz"))
    tables = {}
    for systems in ("GE", "G"):
        out = tmp_path / systems
        result = run(hours, *navigation, "--systems", systems, "--no-plots", "--out", out)
        assert result.exit_code == 0, result.output
        (path,) = out.glob("*_tec.parquet")
        tables[systems] = parquet.read_table(path).to_pydict()
    both, gps = tables["GE"], tables["G"]
    assert {name[0] for name in gps["satellite"]} == {"G"}
    assert {name[0] for name in both["satellite"]} == {"G", "E"}
    rows = [row for row, name in enumerate(both["satellite"]) if name[0] == "G"]
    for name in ("gps_time", "satellite", "pair", "elevation_deg", "arc"):
        assert gps[name] == [both[name][row] for row in rows]
    for wrong in ("X", "g", ""):
        result = run(hours, *navigation, "--systems", wrong, "--out", tmp_path / "wrong")
        assert result.exit_code == 2
        assert f"--systems '{wrong}': letters out of GRSECJI are required" in result.output
        assert not (tmp_path / "wrong").exists()


def test_one_frequency_is_not_enough(tmp_path, sample):
    path = tmp_path / "single.rnx"
    write_rinex_observation(path, open_observations(sample.rover, signals=("1C", "1X")).table)
    result = run(path, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "single.rnx" in result.output and "no second frequency" in result.output


def test_what_is_asked_for_wrongly(tmp_path, sample):
    assert run(sample.rover, "--format", "xlsx").exit_code == 2
    result = run(sample.rover, "--nav", tmp_path / "absent.nav")
    assert result.exit_code == 2 and "absent.nav" in result.output
    result = run(sample.rover, "--out", tmp_path / "out")
    assert result.exit_code == 2 and "--nav" in result.output


def test_a_bag_of_two_receivers(bag_run):
    out = bag_run
    assert len(json.loads((out / "tec.json").read_text())) == 2
    for name in ("sample_chief", "sample_deputy"):
        assert parquet.read_table(out / f"{name}_tec.parquet").num_rows > 1000
        assert parquet.read_table(out / f"{name}_scintillation.parquet").num_rows >= 0


def test_folders_and_bags_without_observations(tmp_path, sample):
    """One line for each; the good file among them is processed."""
    (tmp_path / "folder").mkdir()
    write_bag(tmp_path / "other", sample_messages(10))
    silent = BagWriter(tmp_path / "silent", {})
    silent.add_topic(
        "/chief/gnss/high_rate",
        OBSERVATIONS,
        [offered_qos()],
        installed_type_hash(OBSERVATIONS),
        message_definition(OBSERVATIONS),
    )
    silent.close()
    (tmp_path / "empty.obs").touch()
    names = ("folder", "other", "silent", "empty.obs")
    paths = [tmp_path / name for name in names]
    files = (*paths, sample.rover)
    result = run(*files, "--nav", sample.navigation, "--out", tmp_path / "out")
    assert result.exit_code == 1, result.output
    errors = [line for line in result.output.splitlines() if line.startswith("error:")]
    assert len(errors) == 4
    for name, line in zip(names, errors, strict=True):
        assert name in line
    assert "not a bag" in errors[0] and "no topic NAME/gnss/high_rate" in errors[1]
    assert "0 epochs" in errors[2] and "empty" in errors[3]
    assert "1 receivers, 4 failed" in result.output


@pytest.mark.parametrize(
    ("hours_read", "smallest_count"),
    [(2, 8_000), pytest.param(24, 100_000, marks=pytest.mark.slow)],
)
def test_compact_rinex_that_is_compressed(tmp_path, hours_read, smallest_count):
    """As the archives give them; the file of two hours is the first part of the real day."""
    original = bele("BELE00BRA_R_20240100000_01D_30S_MO.crx.gz")
    lines = gzip.decompress(original.read_bytes()).splitlines(keepends=True)
    # Only the first epoch is written with its date; the others are differences to it.
    path = tmp_path / original.name
    path.write_bytes(gzip.compress(b"".join(lines[: len(lines) * hours_read // 24])))
    nav = bele("BRDC00IGS_R_20240100000_01D_MN.rnx.gz")
    result = run(path, "--nav", nav, "--format", "parquet", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "RINEX 3.05 (Hatanaka)" in result.output
    table = parquet.read_table(tmp_path / "out" / "BELE00BRA_R_20240100000_01D_30S_MO_tec.parquet")
    assert table.num_rows > smallest_count


def test_content_of_a_bag_is_that_of_the_node_without_receiver_bias(bag_run):
    """Online and offline level an arc with the same samples."""
    bag = require_sample_bag()
    table = parquet.read_table(bag_run / "sample_deputy_tec.parquet")
    offline = {
        key: (content, code, arc)
        for *key_parts, content, code, arc in zip(
            *(
                table[name].to_pylist()
                for name in (
                    "gps_time", "satellite", "pair", "stec_online_tecu", "stec_code_tecu", "arc",
                )
            ),
            strict=True,
        )
        if (key := tuple(key_parts))
    }  # fmt: skip
    spacecraft = FormationIonosphere()
    compared = 0
    for ephemerides, second in formation_seconds(BagReader(bag)):
        for ephemeris in ephemerides:
            spacecraft.add_ephemeris(ephemeris)
        result = spacecraft.process(second)
        epoch = result.spacecraft[1].epoch
        time = np.datetime64("1980-01-06", "ms") + np.timedelta64(epoch.time // 1_000_000, "ms")
        biases = spacecraft.spacecraft[1].receiver_biases
        for row, link in enumerate(epoch.links):
            name = satellite_name(link.system, link.prn)
            pair = f"{link.code_first}-{link.code_second}"
            bias = biases.get((link.system, link.code_first, link.code_second))
            removed = 0.0 if bias is None else bias.bias_tecu
            content, code, arc = offline[time.item(), name, pair]
            if epoch.rejected[row] & Rejection.NO_SATELLITE_BIAS:
                continue
            assert epoch.stec_code_tecu[row] + removed == pytest.approx(code, abs=1e-9)
            assert epoch.arc[row] == arc
            # Elevations differ by those of positions of metres, and so do weights and masks.
            if np.isfinite(content) and not epoch.rejected[row] & ~Rejection.NO_RECEIVER_BIAS:
                assert epoch.stec_tecu[row] + removed == pytest.approx(content, abs=1e-3)
                compared += 1
    assert compared > 100


def test_sigma_phi_of_a_bag_is_that_of_the_node(bag_run):
    """A recording has one sigma-phi, whoever computes it: its cut-off is that of orbit."""
    bag = require_sample_bag()
    table = parquet.read_table(bag_run / "sample_deputy_scintillation.parquet")
    formation = FormationIonosphere(formation_settings(IonosphereProcessorParameters()))
    online = []
    for ephemerides, second in formation_seconds(BagReader(bag)):
        for ephemeris in ephemerides:
            formation.add_ephemeris(ephemeris)
        deputy = formation.process(second).spacecraft[1]
        online += [window for window, _ in deputy.scintillation]
    assert len(online) >= 2
    compared = 0
    for window in online:
        assert window.phase_cutoff_hz == 1.0
        time = np.datetime64("1980-01-06", "ms") + np.timedelta64(window.time // 1_000_000, "ms")
        offline = table.filter(compute.equal(table["gps_time_end"], time.item()))
        names = [satellite_name(*key) for key in zip(window.system, window.prn, strict=True)]
        assert offline["satellite"].to_pylist() == names
        assert offline["phase_cutoff_hz"].unique().to_pylist() == [1.0]
        sigma_phi = offline["sigma_phi"].to_numpy()
        np.testing.assert_allclose(sigma_phi, window.sigma_phi, rtol=1e-9)
        compared += np.count_nonzero(np.isfinite(sigma_phi))
    assert compared > 20


@pytest.mark.parametrize(("altitude", "expected"), [(50.0, 0.1), (149e3, 0.1), (151e3, 1.0)])
def test_cut_off_of_sigma_phi_follows_the_motion_of_the_receiver(altitude, expected):
    """The custom of ground receivers below the ionosphere, that of the node in orbit."""
    position = itrf_from_geodetic(np.array([[0.1, 0.2, altitude]] * 3))
    position[1] = np.nan
    assert phase_cutoff_hz(position) == expected
    assert phase_cutoff_hz(position[0]) == expected

"""The one way into observation files: formats found by content, errors of all kinds."""

from __future__ import annotations

import gzip
import shutil

import hatanaka
import numpy as np
import pytest
from constellation_test_support import BRDC, SPIRENT, drawn_navigation_file, shared_file
from encoder_test_support import receiver_log
from gnss_test_support import examples, oem_file
from hypothesis import given
from hypothesis import strategies as st
from rinex_test_support import (
    BELE,
    LEO,
    epoch_3,
    header_3,
    header_line,
    real_observations,
    types_3,
    value,
)

from vtff_dynamics.frames.geodetic import rotation_itrf_to_enu
from vtff_gnss.files.observation_files import (
    ObservationFileError,
    check_receiver_log,
    open_ephemerides,
    open_observations,
)
from vtff_gnss.novatel import read_log
from vtff_gnss.observations import ObservationEpoch

SMALL = (
    header_3(types_3("G", "C1C", "L1C"))
    + epoch_3(0.0, 1)
    + f"G05{value(2.0e7)}{value(1.0e8)}\n"
    + epoch_3(1.0, 1)
    + f"G05{value(2.0e7)}{value(1.0e8)}\n"
)


def test_rinex_by_content_whatever_its_name(tmp_path):
    path = tmp_path / "bele.gps"
    shutil.copy(shared_file(BELE), path)
    found = open_observations(path, systems="G", signals=("1C", "2W"))
    assert found.format_name == "RINEX 3.05 (Hatanaka)"
    assert (len(found.table), found.ephemerides, found.remarks) == (2880, (), ())
    header = real_observations("bele").header
    offset = np.array(found.approximate_position) - header.approximate_position
    enu = rotation_itrf_to_enu(header.approximate_position) @ offset
    np.testing.assert_allclose(enu, [0.0, 0.0, 0.008], atol=1e-8)


def test_a_spacecraft_has_the_position_of_its_header():
    assert open_observations(shared_file(LEO)).approximate_position == (6.93e6, 0.0, 0.0)


def test_novatel_logs(tmp_path):
    path = oem_file("gavlab_test2_rcvr1.dat")
    expected = [e for e in read_log(path) if isinstance(e, ObservationEpoch)]
    packed = tmp_path / "log.obs"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert_log_is_read(path, expected)
    assert_log_is_read(packed, expected)


def assert_log_is_read(path, expected):
    reports = []
    found = open_observations(path, progress=lambda *report: reports.append(report))
    assert found.format_name == "NovAtel RANGECMP"
    assert list(found.epochs()) == expected
    assert len(found.ephemerides) == 13
    # BESTXYZ of the same receiver, which stands still.
    height = np.linalg.norm(found.approximate_position)
    assert 6.35e6 < height < 6.39e6
    assert reports and reports[-1][0] == reports[-1][1]


def test_ascii_logs_and_mixed_range_logs():
    found = open_observations(oem_file("gavlab_test2_rcvr1_decompressed.ASC"))
    assert found.format_name == "NovAtel RANGE"
    assert len(found.table) == 436
    mixed = open_observations(oem_file("gavlab_OnceEachAgain.GPS"))
    assert (np.diff(mixed.table.time_nanoseconds) > 0).all()


def test_selection_of_signals_in_a_receiver_log():
    path = oem_file("gavlab_test2_rcvr1.dat")
    everything, part = open_observations(path), open_observations(path, "G", ("1C",))
    np.testing.assert_array_equal(part.table.time_nanoseconds, everything.table.time_nanoseconds)
    assert set(part.table.columns["band"].tolist()) == {1}
    for index in (0, 100, 435):
        epoch = everything.table.epoch(index)
        is_kept = (epoch.system == 0) & (epoch.band == 1) & (epoch.attribute == ord("C"))
        np.testing.assert_array_equal(
            part.table.epoch(index).pseudorange, epoch.pseudorange[is_kept]
        )


def test_damaged_rinex_is_refused_or_read_in_part(tmp_path):
    path = tmp_path / "cut.rnx"
    path.write_text(SMALL[:-20])
    with pytest.raises(ObservationFileError, match=r"cut\.rnx:7: the file ends inside"):
        open_observations(path)
    found = open_observations(path, partial=True)
    assert len(found.table) == 1
    assert found.remarks[0].startswith("only 1 epochs were read: ")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"GPS data\n" * 20, "neither RINEX nor a NovAtel log"),
        (bytes(range(256)) * 4, "neither RINEX nor a NovAtel log"),
        (b"\x1f\x8b\x08 nonsense", "compressed file is damaged"),
        (b"\xaaD\x12\x1c" + bytes(400), "0 NovAtel logs, but none with observations"),
        (header_3(types_3("G", "C1C")).encode(), "no observations in this file"),
        (
            header_line("     3.05           N: GNSS NAV DATA", "RINEX VERSION / TYPE").encode(),
            "a navigation file",
        ),
    ],
)
def test_error_names_the_file(content, message, tmp_path):
    path = tmp_path / "some.obs"
    path.write_bytes(content)
    with pytest.raises(ObservationFileError, match=message) as caught:
        open_observations(path)
    assert "some.obs" in str(caught.value)


def test_signals_that_are_not_there(tmp_path):
    path = tmp_path / "small.rnx"
    path.write_text(SMALL)
    with pytest.raises(ObservationFileError, match="no observations of systems E and signals 1C"):
        open_observations(path, systems="E", signals=("1C",))


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        open_observations(tmp_path / "absent.rnx")


@given(st.binary(max_size=300), st.sampled_from([b"", b"\xaaD\x12\x1c", b"#RANGEA,", b"\x1f\x8b"]))
@examples(150)
def test_arbitrary_files_give_one_exception(tmp_path_factory, content, start):
    path = tmp_path_factory.getbasetemp() / "arbitrary"
    path.write_bytes(start + content)
    for function in (open_observations, open_ephemerides):
        with pytest.raises(ObservationFileError):
            function(path)


def test_ephemerides_of_a_navigation_file(tmp_path):
    assert len(open_ephemerides(drawn_navigation_file())) == 31
    small = tmp_path / "small.rnx"
    small.write_text(SMALL)
    with pytest.raises(ObservationFileError, match="file type 'O'"):
        open_ephemerides(small)


def test_ephemerides_of_real_navigation_files_and_logs(tmp_path):
    assert len(open_ephemerides(shared_file(SPIRENT))) == 31
    assert len(open_ephemerides(oem_file("gavlab_test2_rcvr1.dat"))) == 13
    packed = tmp_path / "brdc.Z"
    packed.write_bytes(hatanaka.compress(gzip.decompress(shared_file(BRDC).read_bytes()),
                                         compression="Z"))  # fmt: skip
    assert len(open_ephemerides(packed)) == 435 + 9784


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (SMALL.encode(), "a RINEX file; a NovAtel log is required"),
        (bytes(range(256)) * 400, "no NovAtel log that vtff reads was found"),
        (b"\x1f\x8b\x08 nonsense", "compressed file is damaged"),
        (receiver_log(2).replace(b"\xaaD\x12", b"\xaaD\x11"), "no NovAtel log that vtff reads"),
    ],
)
def test_a_file_without_a_receiver_log_is_refused(content, message, tmp_path):
    path = tmp_path / "some.gps"
    path.write_bytes(content)
    with pytest.raises(ObservationFileError, match=message) as caught:
        check_receiver_log(path)
    assert "some.gps" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("before", [b"", bytes(100_000)])
def test_a_receiver_log_is_accepted(before, tmp_path):
    path = tmp_path / "some.gps.gz"
    path.write_bytes(gzip.compress(before + receiver_log(2)))
    check_receiver_log(path)

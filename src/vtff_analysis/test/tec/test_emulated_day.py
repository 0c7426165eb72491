"""A day of a receiver in orbit with known biases: RINEX 2.20, SP3, OEM, CODE DCB."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from emulated_day import EPOCHS, START, STEP, write_day
from typer.testing import CliRunner

from vtff_analysis.export.oem import format_oem
from vtff_analysis.recordings.orbits import Orbit
from vtff_analysis.tec.errors import TecError
from vtff_analysis.tec.processing import process
from vtff_analysis.tec.receiver_orbit import open_receiver_orbit
from vtff_analysis.tec.sources import from_file
from vtff_bringup.cli import make_app
from vtff_dynamics.frames.earth import state_itrf_to_gcrf
from vtff_gnss.files.navigation_files import open_navigation
from vtff_iono.bias.bias_files import read_code_biases
from vtff_iono.bias.code_biases import CodeBiasTable

TECU_PER_NS = 2.85335


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """Return two hours of the day."""
    return write_day(tmp_path_factory.mktemp("day"), epochs=720)


def run(*arguments):
    return CliRunner().invoke(make_app(), ["tec", *(str(part) for part in arguments)])


def biases_of(folder):
    (receiver,) = json.loads((folder / "tec.json").read_text())
    return receiver["receiver_biases"]


def test_p_codes_and_their_biases(day, tmp_path):
    """Only P1-P2 is known: the P code is used, which has no phase of its own, and that is told."""
    out = tmp_path / "out"
    result = run(day.observations, "--nav", day.orbits, "--orbit", day.own_orbit,
                 "--biases", day.biases_p1p2, "--out", out)  # fmt: skip
    assert result.exit_code == 0, result.output
    (bias,) = biases_of(out)
    assert bias["pair"] == "G C1W-C2W"
    assert abs(bias["bias_ns"] - day.receiver_p1p2_ns) < 2.0 * bias["sigma_ns"] < 1.0
    assert "G C1W-C2W is used" in result.output and "C1C - C1W is -1.8" in result.output
    assert list(out.glob("*.png")) != [] and "data:image/png" in (out / "tec.html").read_text()


def test_two_bias_files_complete_each_other(day, tmp_path):
    out = tmp_path / "out"
    result = run(day.observations, "--nav", day.orbits, "--biases", day.biases_p1p2,
                 "--biases", day.biases_p1c1, "--no-plots", "--out", out)  # fmt: skip
    assert result.exit_code == 0, result.output
    assert list(out.glob("*.png")) == [] and "data:image/png" not in (out / "tec.html").read_text()
    (bias,) = biases_of(out)
    assert bias["pair"] == "G C1C-C2W"
    assert abs(bias["bias_ns"] - day.receiver_c1p2_ns) < 2.0 * bias["sigma_ns"] < 1.0
    assert "is used, whose" not in result.output


def test_biases_of_another_year_go_on_only_if_asked(day, tmp_path):
    old = tmp_path / "old.DCB"
    old.write_text(day.biases_p1p2.read_text().replace("D203, 2010", "D203, 2009"))
    arguments = (day.observations, "--nav", day.orbits, "--orbit", day.own_orbit, "--biases", old)
    result = run(*arguments, "--out", tmp_path / "refused")
    assert result.exit_code == 2
    assert "364 days away; --allow-old-biases uses them" in result.output
    assert not (tmp_path / "refused").exists()
    result = run(*arguments, "--allow-old-biases", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "364 days away" in result.output
    (bias,) = biases_of(tmp_path / "out")
    assert abs(bias["bias_ns"] - day.receiver_p1p2_ns) < 2.0 * bias["sigma_ns"]


def test_own_orbit_from_sp3_and_oem(day, tmp_path):
    times = np.array([(START + STEP * k).nanoseconds for k in range(720)])
    file = open_receiver_orbit(day.own_orbit)
    assert np.abs(file.positions(times) - day.position_itrf).max() < 2e-2
    states = [np.concatenate((p, np.zeros(3))) for p in day.position_itrf[::6]]
    epochs = tuple(START + 60.0 * k for k in range(len(states)))
    gcrf = np.array([state_itrf_to_gcrf(t, s) for t, s in zip(epochs, states, strict=True)])
    path = tmp_path / "leo.oem"
    path.write_text(format_oem(Orbit("leo", "truth", epochs, gcrf, np.array(states))))
    error = open_receiver_orbit(path).positions(times[:-5]) - day.position_itrf[:-5]
    assert np.abs(error).max() < 0.1


def test_orbit_files_that_are_none(day, tmp_path):
    with pytest.raises(TecError, match=r"satellites \(G01"):
        open_receiver_orbit(day.orbits)
    path = tmp_path / "some.oem"
    for content, message in ((b"junk", "neither an SP3 nor an OEM"),
                             (b"CCSDS_OEM_VERS = 2.0\njunk", "CCSDS OEM")):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(TecError, match=message):
            open_receiver_orbit(path)


@pytest.mark.slow
def test_a_whole_day_and_its_quarters(tmp_path):
    """The receiver bias within two of its sigmas; pieces of 6 h agree within 0.5 TECU."""
    day = write_day(tmp_path)
    source, navigation = from_file(day.observations), open_navigation([day.orbits])
    orbit = open_receiver_orbit(day.own_orbit)
    tables = [read_code_biases(path) for path in (day.biases_p1p2, day.biases_p1c1)]
    for biases, truth in (
        (tables[0], day.receiver_p1p2_ns),
        (CodeBiasTable.joined(tables), day.receiver_c1p2_ns),
    ):
        whole = process(source, navigation, biases, orbit)
        (bias,) = whole.content.receiver_biases.values()
        # A delay of the first code lowers the content.
        assert abs(-bias.bias_tecu / TECU_PER_NS - truth) < 2.0 * bias.sigma_tecu / TECU_PER_NS
        quarter = EPOCHS // 4
        found = []
        for start in range(0, EPOCHS, quarter):
            part = source.table.epochs_at(np.arange(start, start + quarter))
            result = process(dataclasses.replace(source, table=part), navigation, biases, orbit)
            found += [b.bias_tecu for b in result.content.receiver_biases.values()]
        assert len(found) == 4 and max(found) - min(found) < 0.5

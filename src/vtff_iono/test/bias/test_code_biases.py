"""Code biases: files of real agencies, chains of pairs, broadcast group delays, broken files."""

import json
import math

import numpy as np
import pytest
from bias_file_support import sinex_file, sinex_line
from hypothesis import given
from hypothesis import strategies as st
from iono_test_support import bele_file, examples

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_gnss.constants import SYSTEM_GALILEO, SYSTEM_GPS
from vtff_gnss.orbits.nominal_constellation import (
    nominal_galileo_constellation,
    nominal_gps_constellation,
)
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_iono.bias.bias_files import read_code_biases
from vtff_iono.bias.code_biases import BiasFileError, CodeBias, CodeBiasTable, broadcast_code_biases

CAS = "CAS0OPSRAP_20240100000_01D_01D_DCB.BIA.gz"
NOON = parse_epoch("2024-01-10T12:00:00 GPS")

DCB = """\
CODE'S MONTHLY GNSS P1-P2 DCB SOLUTION, YEAR-MONTH: 10-07             04-AUG-10 05:47
--------------------------------------------------------------------------------

DIFFERENTIAL (P1-P2) CODE BIASES FOR SATELLITES AND RECEIVERS:

PRN / STATION NAME        VALUE (NS)  RMS (NS)
***   ****************    *****.***   *****.***
G02                          11.109     0.010
R07                           2.250     0.020
G     ALGO 40104M002         -3.345     0.030
"""


def table(*edges, sigma=1e-10):
    return CodeBiasTable(
        CodeBias(SYSTEM_GPS, 1, "", a, b, GpsTime(0), NOON + 86400, value, sigma)
        for a, b, value in edges
    )


def test_cas_satellites_and_receiver_of_the_truth_file():
    biases = read_code_biases(bele_file(CAS))
    truth = json.loads(bele_file("truth_dcb.json").read_text())
    for name, value in truth["sat_DSB_C1C_C2W_ns_CAS"].items():
        bias, sigma = biases.satellite_bias(SYSTEM_GPS, int(name[1:]), "C1C", "C2W", NOON)
        assert bias * 1e9 == pytest.approx(value, abs=1e-9)
        assert 0.0 < sigma < 0.2e-9
    stated = truth["receiver_DSB_C1C_C2W_ns_CAS"]["BELE"]
    bias, sigma = biases.receiver_bias("BELE", SYSTEM_GPS, "C1C", "C2W", NOON)
    assert (bias * 1e9, sigma * 1e9) == pytest.approx((stated["value"], stated["std"]))
    # C2X is known only by way of C2W.
    chained, _ = biases.receiver_bias("BELE", SYSTEM_GPS, "C1C", "C2X", NOON)
    assert chained * 1e9 == pytest.approx(0.019 + 0.996)


def test_broadcast_delays_agree_with_the_network():
    network = read_code_biases(bele_file(CAS))
    navigation = read_rinex_navigation(bele_file("BRDC00IGS_R_20240100000_01D_MN.rnx.gz"))
    broadcast = broadcast_code_biases(navigation.ephemerides)
    for system, first, second in ((SYSTEM_GPS, "C1W", "C2W"), (SYSTEM_GALILEO, "C1X", "C5X")):
        difference = np.array(
            [
                network.satellite_bias(system, prn, first, second, NOON)[0]
                - broadcast.satellite_bias(system, prn, first, second, NOON)[0]
                for prn in range(1, 37)
            ]
        )
        difference = difference[np.isfinite(difference)]
        assert len(difference) > 20
        assert np.std(difference) < 0.5e-9  # the wrong sign would give 5 ns


@examples(50)
@given(st.lists(st.floats(-1e-8, 1e-8), min_size=1, max_size=6))
def test_a_chain_is_the_sum_of_its_links_and_turns_round(values):
    signals = [f"C{index}X" for index in range(len(values) + 1)]
    biases = table(*zip(signals[:-1], signals[1:], values, strict=True))
    forward, sigma = biases.satellite_bias(SYSTEM_GPS, 1, signals[0], signals[-1], NOON)
    backward, _ = biases.satellite_bias(SYSTEM_GPS, 1, signals[-1], signals[0], NOON)
    assert forward == pytest.approx(sum(values), abs=1e-20)
    assert backward == pytest.approx(-forward, abs=1e-20)
    assert sigma == pytest.approx(1e-10 * math.sqrt(len(values)))


def test_absolute_biases_make_pairs_and_unknown_ones_are_nan():
    biases = table(("C1C", "", 5e-9), ("C2W", "", 2e-9))
    assert biases.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", NOON)[0] == pytest.approx(3e-9)
    assert math.isnan(biases.satellite_bias(SYSTEM_GPS, 1, "C1C", "C5X", NOON)[0])
    assert math.isnan(biases.satellite_bias(SYSTEM_GPS, 2, "C1C", "C2W", NOON)[0])
    assert math.isnan(biases.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", NOON + 90_000)[0])
    tolerated = biases.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", NOON + 90_000, tolerance=86400.0)
    assert tolerated[0] == pytest.approx(3e-9)


def test_dcb_file_of_code(tmp_path):
    path = tmp_path / "P1P21007.DCB"
    path.write_text(DCB)
    biases = read_code_biases(path)
    in_month = parse_epoch("2010-07-31T23:00:00 GPS")
    bias, sigma = biases.satellite_bias(SYSTEM_GPS, 2, "C1W", "C2W", in_month)
    assert (bias, sigma) == pytest.approx((11.109e-9, 0.010e-9))
    assert biases.satellite_bias(1, 7, "C1P", "C2P", in_month)[0] == pytest.approx(2.25e-9)
    assert biases.receiver_bias("ALGO", SYSTEM_GPS, "C1W", "C2W", in_month)[0] == pytest.approx(
        -3.345e-9
    )
    with pytest.raises(BiasFileError, match=r"P1P21007.DCB.*2010-07-01 to 2010-08-01.*2024-01-10"):
        biases.require_valid(NOON)
    biases.require_valid(in_month)


def own_bias_file(folder, name="own.BIA"):
    """Write a Bias-SINEX file with a bias of each GPS satellite on 2024-01-10."""
    lines = (
        sinex_line("DSB", f"G{prn:02d}", "", "C1C", "C2W", -0.903 - 0.1 * prn, 0.05)
        for prn in range(1, 33)
    )
    return sinex_file(folder, *lines, name=name)


def test_file_of_another_year(tmp_path):
    biases = read_code_biases(own_bias_file(tmp_path))
    with pytest.raises(BiasFileError, match=r"valid from 2024-01-10.*observations are of 2023"):
        biases.require_valid(NOON - 365 * 86400)


def test_broken_files_are_named(tmp_path):
    text = own_bias_file(tmp_path).read_text()
    assert "  -1.0030 " in text and "2024:010:" in text
    cases = {
        "rinex.bia": ("     3.05           OBSERVATION DATA\n", "neither a Bias-SINEX file"),
        "empty.bia": ("", "neither a Bias-SINEX file"),
        "cut.bia": (text[: len(text) // 2], "cut off"),
        "value.bia": (text.replace("  -1.0030 ", "  -1.0o30 ", 1), r"value.bia:\d+: ESTIMATED_VAL"),
        "time.bia": (text.replace("2024:010:", "2024-010:", 3), r"time.bia:\d+: BIAS_START"),
        "title.dcb": (DCB.replace("YEAR-MONTH", "WHEN"), "YEAR-MONTH"),
        "month.dcb": (DCB.replace("10-07", "10-17"), "month 17"),
        "none.dcb": (DCB[: DCB.index("G02")], "cut off"),
    }
    for name, (content, message) in cases.items():
        path = tmp_path / name
        path.write_text(content)
        with pytest.raises(BiasFileError, match=message) as raised:
            read_code_biases(path)
        assert name in str(raised.value)
    path = tmp_path / "cut.bia.gz"
    path.write_bytes(own_bias_file(tmp_path, "own.BIA.gz").read_bytes()[:-100])
    with pytest.raises(BiasFileError, match="compressed file is damaged"):
        read_code_biases(path)
    with pytest.raises(BiasFileError, match="holds no code bias"):
        CodeBiasTable([]).require_valid(NOON)


def test_a_chain_of_small_variances_is_preferred():
    """A direct pair of 3 ns against two pairs of 1 ns; of two perfect ones the shorter chain."""

    def bias(first, second, value, sigma):
        return CodeBias(SYSTEM_GPS, 1, "", first, second, GpsTime(0), NOON, value, sigma)

    edges = [bias("C1C", "C1W", 1e-9, 1e-9), bias("C1W", "C2W", 2e-9, 1e-9)]
    rough = CodeBiasTable([*edges, bias("C1C", "C2W", 9e-9, 3e-9)])
    value, sigma = rough.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", NOON)
    assert (value, sigma) == pytest.approx((3e-9, math.sqrt(2.0) * 1e-9))
    fine = CodeBiasTable([*edges, bias("C1C", "C2W", 9e-9, 1.3e-9)])
    assert fine.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", NOON) == pytest.approx((9e-9, 1.3e-9))
    perfect = [bias("C1C", "C1W", 1e-9, 0.0), bias("C1W", "C2W", 2e-9, 0.0)]
    perfect = CodeBiasTable([*perfect, bias("C1C", "C2W", 9e-9, 0.0)])
    assert perfect.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", NOON)[0] == 9e-9


def test_a_bias_is_valid_to_its_ends_and_a_tolerance_beyond():
    bias = CodeBias(SYSTEM_GPS, 1, "", "C1C", "C2W", NOON, NOON + 60.0, 1e-9, 0.0)
    biases = CodeBiasTable([bias])
    for offset, tolerance, is_valid in (
        (-0.1, 0.0, False),
        (0.0, 0.0, True),
        (60.0, 0.0, True),
        (60.1, 0.0, False),
        (-10.0, 10.0, True),
        (70.0, 10.0, True),
        (-10.1, 10.0, False),
        (70.1, 10.0, False),
    ):
        time = NOON + offset
        value, _ = biases.satellite_bias(SYSTEM_GPS, 1, "C1C", "C2W", time, tolerance)
        assert math.isfinite(value) == is_valid
        if is_valid:
            biases.require_valid(time, tolerance)
        else:
            with pytest.raises(BiasFileError):
                biases.require_valid(time, tolerance)


def test_broadcast_delays_of_drawn_satellites():
    """TGD is scaled to the difference of the signals; Galileo has two, GPS none of C1C - C1W."""
    end = NOON + 7200.0
    gps = nominal_gps_constellation(NOON, end)
    galileo = nominal_galileo_constellation(NOON, end)
    table_of_both = broadcast_code_biases([*gps, *galileo])
    for ephemeris, first, second, delay, frequency in (
        (gps[0], "C1W", "C2W", gps[0].group_delay, 1227.60e6),
        (galileo[0], "C1C", "C5Q", galileo[0].group_delay, 1176.45e6),
        (galileo[0], "C1X", "C5X", galileo[0].group_delay, 1176.45e6),
        (galileo[0], "C1C", "C7Q", galileo[0].group_delay_secondary, 1207.14e6),
        (galileo[0], "C1X", "C7X", galileo[0].group_delay_secondary, 1207.14e6),
    ):
        time = ephemeris.time_of_ephemeris
        bias = table_of_both.satellite_bias(ephemeris.system, ephemeris.prn, first, second, time)
        expected = delay * (1.0 - (1575.42e6 / frequency) ** 2)
        assert bias == pytest.approx((expected, 0.5e-9))
    coarse = table_of_both.satellite_bias(SYSTEM_GPS, gps[0].prn, "C1C", "C1W", NOON)
    assert coarse == pytest.approx((0.0, 1.2e-9))
    both = table_of_both.satellite_bias(SYSTEM_GPS, gps[0].prn, "C1C", "C2W", NOON)
    assert both[1] == pytest.approx(1.3e-9)
    half = 0.5 * gps[0].fit_interval
    alone = broadcast_code_biases(gps[:1])
    reference = gps[0].time_of_ephemeris
    for offset, is_valid in ((-half, True), (half, True), (-half - 1, False), (half + 1, False)):
        bias = alone.satellite_bias(SYSTEM_GPS, gps[0].prn, "C1W", "C2W", reference + offset)
        assert math.isfinite(bias[0]) == is_valid
    assert "G" in alone.origin and "none" in broadcast_code_biases([]).origin

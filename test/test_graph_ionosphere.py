"""`vtff run esf` and `plumex`: the ionosphere that two spacecraft see, against the true one."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from formation_recording import formation_seconds
from graph_support import ROOT, assert_equal_messages, topics

from vtff_analysis.tec.bag_sources import from_bag
from vtff_analysis.tec.processing import process
from vtff_bag.file.message_content import read_content
from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_gnss.files.navigation_files import NavigationFiles
from vtff_iono.conversions import boundary_to_message, density_to_message, slant_tec_to_message
from vtff_iono.density.density_profile import binned_profile
from vtff_iono.edges.window_scores import score_windows
from vtff_iono.formation_ionosphere import FormationIonosphere
from vtff_iono.ionosphere_processor_node import (
    IonosphereProcessorParameters,
    formation_settings,
)
from vtff_iono.links.geometry_free import tecu_per_metre
from vtff_iono.scintillation.fluctuation_lag import fluctuation_lag
from vtff_msgs.msg import IrregularityBoundary
from vtff_node.stamps import to_nanoseconds
from vtff_sim_bridge.atmosphere.electron_density import read_profile

CRAFT = ("chief", "deputy")
BOTTOM, TOP = 290e3, 350e3
TECU_PER_METRE = tecu_per_metre(1575.42e6, 1227.60e6)


def messages(run, topic):
    return [item.message for item in BagReader(run).messages(topic)]


def seconds_of(message):
    return to_nanoseconds(message.header.stamp) * 1e-9


def true_seconds(run, craft):
    """Yield what the receiver of a spacecraft was given, second by second."""
    with (run / "gnss_truth.jsonl").open() as lines:
        for line in lines:
            record = json.loads(line)
            if record["record"] == "second" and record["receiver"] == craft:
                yield record


class Truth:
    """True motion of a run, from its bag, and the profile that its receivers saw."""

    def __init__(self, run, table):
        self.profile = read_profile(ROOT / "config" / "ionosphere" / table)
        self.start = None
        self.time, self.altitude = {}, {}
        for craft in CRAFT:
            orbit = messages(run, f"/{craft}/truth/orbit")
            stamps = np.array([to_nanoseconds(m.header.stamp) for m in orbit])
            self.start = stamps[0] * 1e-9
            places = np.array(
                [
                    rotation_gcrf_to_itrf(GpsTime.from_unix_nanoseconds(int(stamp))) @ m.position
                    for stamp, m in zip(stamps, orbit, strict=True)
                ]
            )
            self.time[craft] = stamps * 1e-9 - self.start
            self.altitude[craft] = geodetic_from_itrf(places)[:, 2]

    def at(self, craft, time):
        return np.interp(time, self.time[craft], self.altitude[craft])

    def crossings(self, craft, altitude):
        """Return times and vertical speeds of the crossings of an altitude."""
        time, height = self.time[craft], self.altitude[craft] - altitude
        before = np.flatnonzero(np.diff(np.sign(height)) != 0)
        speed = np.diff(height)[before] / np.diff(time)[before]
        return [(time[i] - height[i] / v, v) for i, v in zip(before, speed, strict=True)]

    def density(self, time):
        """Return the density averaged over the vertical separation."""
        chief, deputy = self.at("chief", time), self.at("deputy", time)
        return self.profile.mean_density(np.minimum(chief, deputy), np.maximum(chief, deputy))


def densities(run, truth):
    """Return time, altitude, combined density, sigma and true density."""
    table = [
        (seconds_of(m) - truth.start, m.altitude, m.density[-1], m.density_sigma[-1])
        for m in messages(run, "/deputy/iono/electron_density")
    ]
    table = np.array([row for row in table if math.isfinite(row[2])])
    return (*table.T, truth.density(table[:, 0]))


def vertical_boundaries(run):
    return [
        m
        for m in messages(run, "/deputy/iono/irregularity_boundary")
        if m.kind == IrregularityBoundary.KIND_VERTICAL
    ]


# ---- a short run -----------------------------------------------------------------------------


SHORT = "esf.yaml", "--duration", 12, "--composed", "--no-report"


@pytest.fixture(scope="module")
def short(runs):
    return runs.make("esf_short", *SHORT)[0]


def test_online_and_offline_give_the_same_bytes(short):
    formation = FormationIonosphere(formation_settings(IonosphereProcessorParameters()))
    offline = {"slant_tec": [], "density": [], "boundary": []}
    for ephemerides, second in formation_seconds(BagReader(short)):
        for ephemeris in ephemerides:
            formation.add_ephemeris(ephemeris)
        result = formation.process(second)
        offline["slant_tec"].append(slant_tec_to_message(result.spacecraft[0].epoch, "chief"))
        offline["density"] += (
            density_to_message(density, "deputy") for density in result.density[0]
        )
        offline["boundary"] += [
            boundary_to_message(b, "chief", "deputy") for b in result.boundaries[0]
        ]
    for name, topic in (
        ("slant_tec", "/chief/iono/slant_tec"),
        ("density", "/deputy/iono/electron_density"),
    ):
        online = messages(short, topic)
        assert len(online) >= 10
        pairs = itertools.zip_longest(online, offline[name])
        assert all(read_content(one) == read_content(other) for one, other in pairs)


def test_two_runs_are_equal_byte_for_byte(short, runs):
    """With receivers in the loop, down to densities and contents."""
    again = runs.make("esf_short_again", *SHORT)[0]
    names = {name for name in topics(short) if "iono/" in name or name.startswith("/deputy/")}
    assert {"/chief/iono/slant_tec", "/deputy/iono/electron_density"} <= names <= topics(again)
    assert_equal_messages(short, again, names)
    assert BagReader(short).topics["/deputy/iono/electron_density"].message_count >= 9


def test_the_first_densities_are_right_within_their_sigmas(short):
    truth = Truth(short, "esf.csv")
    _, _, density, sigma, true = densities(short, truth)
    assert len(density) >= 9
    assert np.abs(density - true)[3:].max() < 5.0 * sigma[3:].max()
    assert np.abs(density - true)[3:].mean() < 4e10


# ---- the paper's scenarios, an hour each --------------------------------------------------------


@pytest.fixture(scope="module")
def esf(runs):
    return runs.make("esf", "esf.yaml", "--composed", "--no-report")[0]


@pytest.fixture(scope="module")
def plumex(runs):
    return runs.make("plumex", "plumex.yaml", "--composed", "--no-report")[0]


@pytest.mark.slow
@pytest.mark.parametrize("craft", CRAFT)
def test_both_find_both_edges_on_both_passes(esf, craft):
    truth = Truth(esf, "esf.csv")
    found = [m for m in vertical_boundaries(esf) if m.spacecraft == craft]
    assert len(found) == 4
    wanted = sorted(t for h in (BOTTOM, TOP) for t, _ in truth.crossings(craft, h))
    for message, time, entry, altitude in zip(
        sorted(found, key=seconds_of),
        wanted,
        (True, False, True, False),
        (TOP, BOTTOM, BOTTOM, TOP),
        strict=True,
    ):
        assert message.entry == entry
        assert seconds_of(message) - truth.start == pytest.approx(time, abs=1.0)
        assert message.altitude == pytest.approx(altitude, abs=100.0)


@pytest.mark.slow
def test_vertical_separation_from_the_times_of_the_edges(esf):
    truth = Truth(esf, "esf.csv")
    times = {
        craft: sorted(
            seconds_of(m) - truth.start for m in vertical_boundaries(esf) if m.spacecraft == craft
        )
        for craft in CRAFT
    }
    speeds = [
        v for _, v in sorted(truth.crossings("chief", BOTTOM) + truth.crossings("chief", TOP))
    ]
    for chief, deputy, speed in zip(times["chief"], times["deputy"], speeds, strict=True):
        middle = 0.5 * (chief + deputy)
        true = truth.at("deputy", middle) - truth.at("chief", middle)
        assert (chief - deputy) * speed == pytest.approx(true, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("craft", CRAFT)
def test_scintillating_minutes_are_those_whose_rays_cross(esf, craft):
    minutes = {}
    for second in true_seconds(esf, craft):
        for satellite, s4 in zip(second["satellites"], second["s4_l1"], strict=True):
            key = satellite, second["time"] // 60 + 1
            minutes[key] = minutes.get(key, 0.0) + (s4 > 0.2)
    found, crossing = [], []
    start = Truth(esf, "esf.csv").start
    for message in messages(esf, f"/{craft}/iono/scintillation"):
        # Windows begin at whole minutes of GPS time, as the run does; the stamp is their end.
        minute = round((seconds_of(message) - start) / 60.0)
        for prn, band, s4 in zip(message.prn, message.band, message.s4_corrected, strict=True):
            if band == 1 and math.isfinite(s4):
                found.append(s4 > 0.2)
                crossing.append(minutes.get((f"G{prn:02d}", minute), 0.0))
    score = score_windows(found, crossing)
    assert score.detection_rate >= 0.95
    assert score.false_alarm_rate < 0.01


@pytest.mark.slow
def test_fluctuations_of_the_deputy_come_two_seconds_later(esf):
    power = {}
    for craft in CRAFT:
        fast = messages(esf, f"/{craft}/gnss/high_rate")[1950 * 20 : 2250 * 20]
        for message in fast:
            for prn, band, cn0 in zip(message.prn, message.band, message.cn0_dbhz, strict=True):
                if band == 1:
                    power.setdefault((craft, prn), []).append(10.0 ** (0.1 * cn0))
    whole = [p for c, p in power if c == "chief" and len(power[c, p]) == 6000]
    whole = [prn for prn in whole if len(power.get(("deputy", prn), [])) == 6000]
    chief, deputy = (np.array([power[craft, prn] for prn in whole]) for craft in CRAFT)
    assert fluctuation_lag(chief, deputy, 20.0).lag == pytest.approx(2.0, abs=0.2)


@pytest.fixture(scope="module")
def esf_paper(runs):
    return runs.make("esf_paper", "esf_paper.yaml", "--composed", "--no-report")[0]


@pytest.mark.slow
@pytest.mark.parametrize("craft", CRAFT)
@pytest.mark.parametrize("system", ["esf", "esf_paper"])
def test_rays_enter_and_leave_when_they_do(craft, system, request):
    """The edge at 20 h, and in esf_paper that at 21 h."""
    run = request.getfixturevalue(system)
    start = Truth(run, "esf.csv").start
    crossing = [s["time"] for s in true_seconds(run, craft) if max(s["s4_l1"], default=0) > 0.2]
    edges = [
        (m.entry, seconds_of(m) - start)
        for m in messages(run, "/deputy/iono/irregularity_boundary")
        if m.spacecraft == craft and m.source == IrregularityBoundary.SOURCE_S4
    ]
    assert min(t for entry, t in edges if entry) == pytest.approx(crossing[0], abs=15.0)
    assert max(t for entry, t in edges if not entry) == pytest.approx(crossing[-1], abs=15.0)


@pytest.mark.slow
@pytest.mark.parametrize("craft", CRAFT)
def test_events_of_the_paper(esf_paper, craft):
    """Section 4.2: edges at 1957 and 2165 s, between about 7 S 82 W and 9 S 67 W."""
    truth = Truth(esf_paper, "esf.csv")
    found = sorted(
        (m for m in vertical_boundaries(esf_paper) if m.spacecraft == craft), key=seconds_of
    )
    assert [m.entry for m in found] == [True, False, True, False]
    second_pass = found[2:]
    times = [seconds_of(m) - truth.start for m in second_pass]
    assert times == pytest.approx([1957.0, 2165.0], abs=40.0)
    assert [m.altitude for m in second_pass] == pytest.approx([BOTTOM, TOP], abs=100.0)
    assert [m.latitude_deg for m in second_pass] == pytest.approx([-7.0, -9.0], abs=1.0)
    assert [m.longitude_deg for m in second_pass] == pytest.approx([-82.0, -67.0], abs=2.0)


@pytest.mark.slow
def test_plumex_density(plumex):
    truth = Truth(plumex, "plumex.csv")
    time, altitude, density, sigma, true = densities(plumex, truth)
    # Each leg by itself: both cross the same altitudes.
    for leg in (time < 1370.0, time > 1370.0):
        measured = binned_profile(altitude[leg], density[leg], sigma[leg])
        wanted = binned_profile(altitude[leg], true[leg], np.ones(np.count_nonzero(leg)))
        error = np.abs(measured.density - wanted.density)
        whole = (measured.altitude > 236e3) & (measured.altitude < 567e3)
        assert error[whole].mean() <= 2e10
        for low, high in ((340e3, 380e3), (395e3, 435e3), (480e3, 520e3)):
            inside = (measured.altitude > low) & (measured.altitude < high)
            if inside.any():
                assert error[inside].mean() <= 2e10


def true_contents(run, craft):
    """Return the contents of satellites, TECU, by second and name."""
    return {
        round(second["time"]): dict(
            zip(second["satellites"], second["slant_tec_tecu"], strict=True)
        )
        for second in true_seconds(run, craft)
    }


def true_receiver_bias(run, craft):
    """Return the code bias L1 - L2 of a receiver, s."""
    with (run / "gnss_truth.jsonl").open() as lines:
        records = map(json.loads, lines)
        biases = next(
            r["biases"] for r in records if r["record"] == "receiver" and r["receiver"] == craft
        )
    return (biases["G1C"] - biases["G2W"]) / SPEED_OF_LIGHT


@pytest.mark.slow
@pytest.mark.parametrize("craft", CRAFT)
@pytest.mark.parametrize("system", ["esf", "plumex"])
def test_absolute_slant_tec_online(craft, system, request):
    run = request.getfixturevalue(system)
    truth, start = true_contents(run, craft), Truth(run, f"{system}.csv").start
    errors = []
    for message in messages(run, f"/{craft}/iono/slant_tec"):
        second = truth.get(round(seconds_of(message) - start), {})
        rows = zip(message.prn, message.stec_tecu, message.rejected, strict=True)
        errors += [
            stec - second[f"G{prn:02d}"]
            for prn, stec, rejected in rows
            if not rejected and f"G{prn:02d}" in second
        ]
    assert len(errors) > 10_000
    assert math.sqrt(np.mean(np.square(errors))) <= 0.5


@pytest.mark.slow
@pytest.mark.parametrize("system", ["esf", "plumex"])
def test_absolute_slant_tec_offline(system, request):
    """`vtff tec` of the bag: contents, receiver biases and their sigmas."""
    run = request.getfixturevalue(system)
    start = round(Truth(run, f"{system}.csv").start * 1e9)
    for craft in CRAFT:
        found = process(from_bag(run, f"/{craft}"), NavigationFiles(), "broadcast").content
        (bias,) = found.receiver_biases.values()
        value, sigma = bias.code_bias(TECU_PER_METRE)
        error = abs(value - true_receiver_bias(run, craft))
        assert error <= 0.15e-9
        assert error <= 2.0 * sigma
        truth = true_contents(run, craft)
        time = found.rows.pairs.time
        unix = time + (GpsTime(int(time[0])).to_unix_nanoseconds() - time[0])
        elapsed = (unix - start) * 1e-9
        whole = np.flatnonzero((found.rejected == 0) & (np.abs(elapsed - np.round(elapsed)) < 1e-3))
        errors = []
        for row in whole.tolist():
            name = f"G{found.links[found.rows.pairs.link[row]].prn:02d}"
            true = truth.get(round(elapsed[row]), {}).get(name)
            if true is not None:
                errors.append(found.stec_tecu[row] - true)
        assert len(errors) > 10_000
        assert math.sqrt(np.mean(np.square(errors))) <= 0.5


@pytest.mark.slow
def test_differential_tec_at_one_second(plumex):
    """The noise of the combined density, carried back to the content between the spacecraft."""
    truth = Truth(plumex, "plumex.csv")
    time, _, density, _, true = densities(plumex, truth)
    separation = truth.at("chief", time) - truth.at("deputy", time)
    later = time > 100.0
    content = ((density - true) * separation / ELECTRONS_PER_TECU)[later]
    assert math.sqrt(np.mean(content**2)) <= 0.005

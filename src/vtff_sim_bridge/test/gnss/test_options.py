"""Options of the receivers: what the truth file tells of them is what is in the measurements."""

from __future__ import annotations

import dataclasses
import json
import math

import gnss_emulator_support as support
import numpy as np
import pytest

from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_gnss import constants as c
from vtff_gnss.antenna_pattern import ParabolicPattern
from vtff_gnss.fix import STATUS_NONE, Fix
from vtff_gnss.novatel import RawLog, ReceiverLogStream
from vtff_gnss.novatel.encode.lnav import quantize_lnav
from vtff_gnss.novatel.range.range_logs import RANGE_RECORD, RANGECMP_RECORD
from vtff_gnss.signals import carrier_wavelength, satellite_name
from vtff_sim_bridge.gnss.configuration import MultipathModel, TrackingModel
from vtff_sim_bridge.gnss.power_levels import PowerLevels
from vtff_sim_bridge.gnss.vehicle_track import vehicle_track
from vtff_sim_bridge.simremote.language import parse_command
from vtff_sim_bridge.simremote.motion import MotionState, VehicleMotion
from vtff_sim_bridge.simremote.power_command import PowerCommand

SECONDS = 6
GPS = c.SYSTEM_GPS


@pytest.fixture(scope="module")
def motions():
    return support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], SECONDS)


@pytest.fixture(scope="module")
def plain(motions) -> support.Run:
    return support.Run(support.configuration(), motions, support.LOGS).all()


def with_constellation(**changes: float) -> object:
    base = support.configuration()
    return dataclasses.replace(
        base, constellation=dataclasses.replace(base.constellation, **changes)
    )


def records(path) -> list[dict]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def differences(run: support.Run, other: support.Run, name: str, index: int = -1):
    """Return names of satellite and signal, and differences of code and carrier range, m."""
    one, two = run.epochs(name)[index], other.epochs(name)[index]
    assert np.array_equal(one.prn, two.prn) and np.array_equal(one.band, two.band)
    names = [
        (satellite_name(s, p), f"{c.SYSTEM_LETTERS[s]}{b}{chr(a)}")
        for s, p, b, a in zip(
            *(getattr(one, n).tolist() for n in ("system", "prn", "band", "attribute")),
            strict=True,
        )
    ]
    code = one.pseudorange - two.pseudorange
    wavelength = carrier_wavelength(one.system, one.band)
    phase = (one.carrier_phase_cycles - two.carrier_phase_cycles) * wavelength
    return names, code, phase


def test_truth_file_tells_every_bias_in_the_pseudoranges(motions, plain, tmp_path):
    path = tmp_path / "truth.jsonl"
    base = support.with_receivers(
        with_constellation(inter_signal_sigma=0.7), biases={"G1C": 0.25, "G2W": -1.5}
    )
    biased = support.Run(base, motions, support.LOGS, truth_path=path).all()
    told = records(path)
    satellites = {r["satellite"]: r for r in told if r["record"] == "satellite"}
    (deputy,) = (r for r in told if r["record"] == "receiver" and r["receiver"] == "deputy")
    assert deputy["biases"] == {"G1C": 0.25, "G2W": -1.5}
    assert deputy["clock"]["oscillator"] == "perfect" and deputy["antenna"] is None
    names, code, phase = differences(biased, plain, "deputy")
    assert len(names) >= 16
    for (satellite, signal), change in zip(names, code, strict=True):
        expected = satellites[satellite]["signals"][signal]["bias"] + deputy["biases"][signal]
        assert change == pytest.approx(expected, abs=1e-6)
    assert np.abs(phase).max() < 1e-6
    # The broadcast part: IS-GPS-200, TGD on L1 and gamma TGD on L2.
    plan = biased.measurements("deputy").signals.plan
    for ephemeris in plan.ephemerides:
        signals = satellites[satellite_name(GPS, ephemeris.prn)]["signals"]
        assert signals["G1C"]["group_delay"] == pytest.approx(299792458.0 * ephemeris.group_delay)
        ratio = signals["G2W"]["group_delay"] / signals["G1C"]["group_delay"]
        assert ratio == pytest.approx((154 / 120) ** 2)


def test_orbit_and_clock_errors_are_those_of_the_truth_file(motions, plain, tmp_path):
    path = tmp_path / "truth.jsonl"
    base = with_constellation(orbit_error_sigma=3.0, clock_error_sigma=1.0)
    run = support.Run(base, motions, support.LOGS, truth_path=path).all()
    satellites = {r["satellite"]: r for r in records(path) if r["record"] == "satellite"}
    told_by_satellites = plain.measurements("chief").signals.plan.ephemerides
    assert run.measurements("chief").signals.plan.ephemerides == told_by_satellites
    names, code, phase = differences(run, plain, "chief")
    measured = run.measurements("chief")
    seen, plan = measured.signals.line_of_sight, measured.signals.plan
    expected = {}
    for column, satellite in enumerate(plan.satellites):
        told = satellites[satellite_name(*satellite)]
        position = seen.position_satellite_itrf[-1, column]
        normal = np.cross(position, seen.velocity_satellite_itrf[-1, column])
        axes = [position, np.cross(normal, position), normal]
        axes = [axis / np.linalg.norm(axis) for axis in axes]
        error = sum(e * axis for e, axis in zip(told["orbit_error"], axes, strict=True))
        expected[satellite_name(*satellite)] = (
            float(error @ seen.direction_itrf[-1, column]) - told["clock_error"]
        )
    assert max(map(abs, expected.values())) > 1.0
    for (satellite, _), code_change, phase_change in zip(names, code, phase, strict=True):
        assert code_change == pytest.approx(expected[satellite], abs=1e-6)
        assert phase_change == pytest.approx(expected[satellite], abs=1e-6)


def test_multipath_is_bounded_slow_and_different_for_each_signal(motions, plain):
    model = MultipathModel(code_amplitude=2.0, phase_amplitude=0.01, period=60.0)
    base = support.with_receivers(support.configuration(), multipath=model)
    run = support.Run(base, motions, support.LOGS).all()
    elevation = run.measurements("chief").signals.line_of_sight.elevation[-1]
    plan = run.measurements("chief").signals.plan
    bound = {
        satellite_name(*s): math.cos(e) for s, e in zip(plan.satellites, elevation, strict=True)
    }
    names, code, phase = differences(run, plain, "chief")
    assert all(abs(x) <= 2.0 * bound[s] + 1e-6 for (s, _), x in zip(names, code, strict=True))
    assert all(abs(x) <= 0.01 * bound[s] + 1e-6 for (s, _), x in zip(names, phase, strict=True))
    assert np.sqrt(np.mean(code**2)) > 0.4 and len(np.unique(np.round(code, 6))) == len(code)
    later = differences(run, plain, "chief", -2)[1]
    # The shortest period is 42 s.
    assert np.abs(code - later).max() <= 2.0 * 2.0 * math.pi / 42.0 / 20.0 + 1e-3
    other = differences(run, plain, "deputy")
    assert np.abs(dict(zip(names, code, strict=True))[other[0][0]] - other[1][0]) > 1e-3


def power(time: float, text: str) -> PowerCommand:
    command = parse_command(f"-,{text}")
    value = float(command.arguments[1])
    return PowerCommand(
        command.verb, round(time * 1e9), command.arguments[0].lower(), value, command.arguments
    )


def played(base, motions, commands: list[PowerCommand], chunk: int = 10**9) -> support.Run:
    return support.Run(base, motions, support.LOGS, chunk=chunk, power_commands=commands).all()


@pytest.mark.parametrize("chunk", [10**9, 5 * 10**7])
def test_power_commands_change_cn0_and_take_signals_away(motions, plain, chunk):
    prn = int(plain.epochs("chief")[0].prn[0])
    commands = [
        power(1.5, "POW_LEV,V1_A1,-3.5,GPS,0,0,1,1,1,1,0"),
        power(3.0, f"POW_ON,v1_a1,0,GPS,{prn},0,0,0,0"),
        power(4.0, f"POW_ON,v1_a1,1,GPS,{prn},0,0,0,0"),
        power(5.25, f"POW_LEV,v1_a1,2,GPS,{prn},0,0,0,1,1,0"),
    ]
    run = played(support.configuration(), motions, commands, chunk)
    assert run.content["deputy"] == plain.content["deputy"]
    epochs, reference = run.epochs("chief"), plain.epochs("chief")
    for index, expected in ((29, 0.0), (30, -3.5), (59, -3.5)):
        change = epochs[index].cn0_dbhz - reference[index].cn0_dbhz
        assert change == pytest.approx(expected, abs=1e-4)
    has_signal = [prn in epoch.prn for epoch in epochs]
    # Two seconds of acquisition after the second without signal.
    assert has_signal == [True] * 60 + [False] * 60 + [True] * (len(epochs) - 120)
    last, before = epochs[-1], reference[-1]
    changes = (last.cn0_dbhz - before.cn0_dbhz)[last.prn == prn]
    assert changes == pytest.approx(2.0, abs=1e-4)


def test_a_level_holds_from_the_next_epoch_of_every_receiver(motions, plain):
    commands: list[PowerCommand] = []
    run = support.Run(support.configuration(), motions, support.LOGS, power_commands=commands)

    def command(second: int) -> None:
        if second == 3:
            commands.extend(power(3.0, f"POW_LEV,v{k}_a1,-3.5,GPS,0,0,1,1,1,1,0") for k in (1, 2))

    run.all(command)
    for name in ("chief", "deputy"):
        levels, usual = (
            np.array([epoch.cn0_dbhz[0] for epoch in each.epochs(name)]) for each in (run, plain)
        )
        change = levels - usual
        assert change[:61] == pytest.approx(0.0, abs=1e-4)
        assert change[61:] == pytest.approx(-3.5, abs=1e-4)


@pytest.mark.parametrize(
    "text",
    [
        "POW_LEV,v1_a1,-3,GPS,5,0,1,0,1,1,0",  # a channel of the simulator
        "POW_LEV,v1_a1,-3,GPS,5,0,0,0,1,0,0",  # one frequency
        "POW_LEV,v1_a1,-3,GPS,5,0,0,0,1,0",  # the same, without the last field
        "POW_LEV,v1_a1,-3,GPS,5,1,0,0,1,1,0",  # a multipath copy
        "POW_LEV,v1_a1,-3,GLONASS,5,0,0,0,1,1,0",
        "POW_LEV,v1_a1,-3,GPS,x,0,0,0,1,1,0",
    ],
)
def test_power_commands_without_sure_meaning_have_no_effect(text, caplog):
    levels = PowerLevels([power(0.0, text)], "v1_m1")
    assert levels.offsets_db(1, slice(None), [(GPS, 5)]) == pytest.approx(0.0)
    assert levels.offsets_db(2, slice(None), [(GPS, 5)]) is None
    assert "POW_LEV" in caplog.text


def test_power_of_all_transmitter_types_concerns_galileo_too():
    levels = PowerLevels([power(0.0, "POW_LEV,v2_a1,-6,GPS,0,0,0,1,1,1,1")], "v2_m1")
    offsets = levels.offsets_db(1, slice(None), [(GPS, 5), (c.SYSTEM_GALILEO, 7)])
    assert offsets == pytest.approx(-6.0)
    assert (
        PowerLevels([power(0.0, "POW_ON,v2_a1,0,GPS,0,0,0,1,1")], "v1_m1").offsets_db(
            1, slice(None), [(GPS, 5)]
        )
        is None
    )


@pytest.mark.parametrize(
    ("angles", "ned"),
    [
        ((0.3, 0.0, 0.0), (0.0, 0.0, -1.0)),
        ((0.0, 0.5 * math.pi, 0.0), (-1.0, 0.0, 0.0)),
        ((0.5 * math.pi, 0.5 * math.pi, 0.0), (0.0, -1.0, 0.0)),
        ((0.0, 0.0, 0.5 * math.pi), (0.0, 1.0, 0.0)),
        ((0.5 * math.pi, 0.0, 0.5 * math.pi), (-1.0, 0.0, 0.0)),
        ((0.0, 0.0, math.pi), (0.0, 0.0, 1.0)),
    ],
)
def test_boresight_is_the_top_of_the_body(motions, angles, ned):
    state = motions[0][0]._replace(heading_elevation_bank=angles)
    motion = VehicleMotion()
    motion.command(0, state)
    track = vehicle_track(motion, 1, slice(None))
    assert track.boresight_itrf is not None
    latitude, longitude, _ = geodetic_from_itrf(track.position_itrf[7])
    north = (
        -math.sin(latitude) * math.cos(longitude),
        -math.sin(latitude) * math.sin(longitude),
        math.cos(latitude),
    )
    east = (-math.sin(longitude), math.cos(longitude), 0.0)
    down = np.cross(north, east)
    expected = ned[0] * np.array(north) + ned[1] * np.array(east) + ned[2] * np.array(down)
    assert track.boresight_itrf[7] == pytest.approx(expected, abs=1e-9)


def test_track_is_the_extrapolated_motion(motions):
    spin = motions[1][0]._replace(
        jerk_itrf=(0.01, -0.02, 0.03), angular_velocity_body=(0.0, 0.0, 0.2)
    )
    motion = VehicleMotion()
    motion.command(0, motions[0][0])
    motion.command(500_000_000, spin)
    track = vehicle_track(motion, 1, slice(3, 20))
    for index in range(3, 20):
        state: MotionState = motion.at((index + 1) * 50_000_000)
        assert tuple(track.position_itrf[index]) == state.position_itrf
        assert tuple(track.velocity_itrf[index]) == state.velocity_itrf
        assert tuple(track.acceleration_itrf[index]) == state.acceleration_itrf
    assert np.array_equal(track.position_itrf[0], track.position_itrf[3])
    motion = VehicleMotion()
    motion.command(0, motions[0][0])
    assert vehicle_track(motion, 1, slice(None)).boresight_itrf is None


def test_antenna_turned_over_loses_the_front_to_back_ratio(motions):
    antenna = ParabolicPattern(0.0, math.radians(104.0), 20.0)
    base = support.with_receivers(support.configuration(), antenna=antenna)
    upright = support.Run(base, motions, support.LOGS).all()
    turned = [
        [s._replace(heading_elevation_bank=(1.0, 0.0, math.pi)) for s in states]
        for states in motions
    ]
    down = support.Run(base, turned, support.LOGS).all()
    up, over = upright.epochs("chief")[40], down.epochs("chief")[40]
    assert np.array_equal(up.pseudorange, over.pseudorange)
    measured = upright.measurements("chief")
    highest = measured.signals.plan.satellites[
        int(np.argmax(measured.signals.line_of_sight.elevation[-1]))
    ][1]
    row = (up.prn == highest) & (up.band == 1)
    elevation = measured.signals.line_of_sight.elevation[-1].max()
    fall = 12.0 * ((0.5 * math.pi - elevation) / math.radians(104.0)) ** 2
    assert up.cn0_dbhz[row] - over.cn0_dbhz[row] == pytest.approx(20.0 - fall, abs=0.1)


def test_cold_start(motions):
    tracking = TrackingModel(threshold_dbhz=0.0, acquisition_delay=1.0, cold_start_duration=2.0)
    base = support.with_receivers(support.configuration(), tracking=tracking)
    logs = support.LOGS + b"LOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n"
    run = support.Run(base, motions, logs).all()
    stream = ReceiverLogStream(raw_logs="all")
    events = stream.feed(bytes(run.content["chief"])) + stream.close()
    unknown = [e.name for e in events if isinstance(e, RawLog) and e.time is None]
    # Epochs at 0 to 2 s.
    assert unknown.count("RANGEB") == 41 and unknown.count("BESTXYZB") == 3
    assert len(unknown) == 41 + 3 + 3
    epochs = run.epochs("chief")
    assert epochs[0].time == run.start + 2.05
    first = next(e.time for e in epochs if len(e))
    assert first - run.start == pytest.approx(2.05 + 1.0)
    fixes = [event for event in events if isinstance(event, Fix)]
    assert [fix.status != STATUS_NONE for fix in fixes] == [False, True, True, True]
    with pytest.raises(ValueError, match="cold_start_duration"):
        TrackingModel(cold_start_duration=0.5)


def test_gps_orbits_are_those_of_the_message(plain):
    for ephemeris in plain.measurements("chief").signals.plan.ephemerides:
        assert quantize_lnav(ephemeris) == ephemeris


def test_ephemerides_are_received_again_every_30_seconds():
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 35)
    run = support.Run(
        support.configuration(), motions, b"LOG RAWEPHEMB ONNEW\r\nLOG GPSEPHEMB ONCHANGED\r\n"
    )
    tracked: list[int] = []
    run.all(lambda _: tracked.append(len(run.measurements("chief").tracked_satellites(-1))))
    stream = ReceiverLogStream(raw_logs="all", every_ephemeris=True)
    logs = [e.name for e in stream.feed(bytes(run.content["chief"])) if isinstance(e, RawLog)]
    first_time = logs.count("GPSEPHEMB")
    assert max(tracked) <= first_time <= max(tracked) + 1
    assert logs.count("RAWEPHEMB") == first_time + tracked[30]


@pytest.mark.parametrize("log", ["RANGE", "RANGECMP"])
def test_status_words_tell_the_channels(log):
    """Each satellite has one of its own, of its system, and keeps it."""
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 20)
    run = support.Run(
        support.configuration("benchmark"), motions, f"LOG {log}B ONTIME 1\r\n".encode()
    ).all()
    stream = ReceiverLogStream(raw_logs="all")
    record = RANGE_RECORD if log == "RANGE" else RANGECMP_RECORD
    held: dict[tuple[int, int], int] = {}
    for event in stream.feed(bytes(run.content["chief"])):
        if not isinstance(event, RawLog):
            continue
        records = np.frombuffer(event.content, record, count=36, offset=32)
        status = records["tracking_status"]
        systems = (status >> 16 & 7).tolist()
        channels = dict(
            zip(
                zip(systems, records["prn"].tolist(), strict=True),
                (status >> 5 & 31).tolist(),
                strict=True,
            )
        )
        assert sorted(channels.values()) == list(range(12))
        assert all((channel >= 6) == (system > 0) for (system, _), channel in channels.items())
        assert all(held[key] == channels[key] for key in held.keys() & channels.keys())
        held = channels

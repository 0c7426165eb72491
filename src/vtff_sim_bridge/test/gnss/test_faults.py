"""Determinism of the bytes, independence of effects, and every fault as it shows in the stream."""

from __future__ import annotations

import dataclasses
import json

import gnss_emulator_support as support
import numpy as np
import pytest

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss import constants as c
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.signals import carrier_wavelength
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import NoiseModel
from vtff_sim_bridge.gnss.faults import Fault
from vtff_sim_bridge.gnss.receiver_clock import ClockModel

SECONDS = 12
EVERYWHERE = IrregularityRegion(
    "everywhere", -0.5 * np.pi, 0.5 * np.pi, 0.0, 24.0, 0.0, 3e6, s4=0.6, decorrelation_time=0.4
)


@pytest.fixture(scope="module")
def motions():
    return support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], SECONDS)


@pytest.fixture(scope="module")
def calm(motions) -> support.Run:
    return support.Run(support.configuration(), motions, support.LOGS).all()


def with_fault(motions, **fields: object) -> support.Run:
    """Return a noise-free run in which the deputy has one fault."""
    fault = Fault(receiver="deputy", **fields)  # type: ignore[arg-type]
    base = support.configuration(faults=(fault,))
    return support.Run(base, motions, support.LOGS).all()


def phase_change(faulty: support.Run, calm: support.Run, key, index: int) -> float:
    """Return by how many cycles the phase of a signal differs between two runs."""
    one, other = faulty.epochs("deputy")[index], calm.epochs("deputy")[index]
    return float(
        one.carrier_phase_cycles[support.signal_index(one)[key]]
        - other.carrier_phase_cycles[support.signal_index(other)[key]]
    )


def first_key(run: support.Run) -> tuple[int, int, int]:
    return next(key for key in support.signal_index(run.epochs("deputy")[0]) if key[2] == 1)


def satellite_name(key: tuple[int, int, int]) -> str:
    return f"{c.SYSTEM_LETTERS[key[0]]}{key[1]:02d}"


def eventful() -> dict[str, object]:
    """Return the changes of a configuration in which much happens within four seconds."""
    return {
        "regions": (EVERYWHERE,),
        "faults": (
            Fault("corrupted_bytes", "chief", time=1.0, duration=1.0, rate=1e-3),
            Fault("outage", "deputy", time=1.15, duration=0.8, signal="G1C"),
            Fault("clock_jump", "deputy", time=2.1, seconds=1e-6),
        ),
    }


MANY_LOGS = support.LOGS + b"LOG BESTXYZB ONTIME 0.5\r\nLOG RANGECMP4B ONTIME 0.25\r\n"


@pytest.mark.parametrize("chunk", [50_000_000, 250_000_000])
def test_bytes_do_not_depend_on_the_steps_of_scenario_time(chunk):
    motions = support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], 4)
    base = support.configuration("reference", **eventful())
    whole = support.Run(base, motions, MANY_LOGS).all()
    parts = support.Run(base, motions, MANY_LOGS, chunk=chunk).all()
    assert parts.content == whole.content
    assert len(whole.content["chief"]) > 70_000


def test_one_effect_does_not_change_the_numbers_of_another(motions):
    """Code noise, ambiguities and clock are the same with scintillation and phase noise off."""
    base = support.configuration("reference", profile=None)
    rich = support.Run(base, motions, support.LOGS).all()
    noise = NoiseModel(model="fixed", code_sigma=0.3, phase_sigma=0.0, doppler_sigma=0.0)
    poor_base = support.with_receivers(base, noise=noise)
    poor_base = dataclasses.replace(poor_base, receivers=poor_base.receivers[1:])
    poor = support.Run(poor_base, [state[:2] for state in motions], support.LOGS).all()
    one, other = rich.epochs("deputy")[55], poor.epochs("deputy")[55]
    assert np.array_equal(one.pseudorange, other.pseudorange)
    difference = one.carrier_phase_cycles - other.carrier_phase_cycles
    assert 0.0 < np.abs(difference).max() < 0.05


def test_silent_slip(motions, calm):
    key = first_key(calm)
    faulty = with_fault(
        motions, kind="slip", time=5.0, satellite=satellite_name(key), signal="G1C", cycles=7.0
    )
    assert phase_change(faulty, calm, key, 99) == 0.0
    assert phase_change(faulty, calm, key, 100) == pytest.approx(7.0, abs=1e-6)
    assert phase_change(faulty, calm, (0, key[1], 2), 100) == 0.0
    epoch = faulty.epochs("deputy")[100]
    assert not epoch.flags[support.signal_index(epoch)[key]] & c.FLAG_LOCK_LOST


def test_slip_that_the_receiver_tells(motions, calm):
    key = first_key(calm)
    faulty = with_fault(
        motions,
        kind="slip",
        time=5.0,
        satellite=satellite_name(key),
        signal="G1C",
        cycles=-3.0,
        is_silent_slip=False,
    )
    epoch = faulty.epochs("deputy")[100]
    row = support.signal_index(epoch)[key]
    assert phase_change(faulty, calm, key, 100) == pytest.approx(-3.0, abs=1e-6)
    assert epoch.lock_time[row] == 0.0
    assert epoch.flags[row] & c.FLAG_LOCK_LOST


def test_half_cycle_slip(motions, calm):
    key = first_key(calm)
    faulty = with_fault(
        motions, kind="half_cycle", time=6.0, satellite=satellite_name(key), signal="G1C"
    )
    assert phase_change(faulty, calm, key, 120) == pytest.approx(0.5, abs=1e-6)
    flags = [
        int(epoch.flags[support.signal_index(epoch)[key]]) & c.FLAG_HALF_CYCLE_ADDED
        for epoch in faulty.epochs("deputy")[119:121]
    ]
    assert flags[0] != flags[1]


def test_parity_is_unknown_at_first_and_the_half_cycle_is_then_added(calm):
    epochs = calm.epochs("deputy")
    places, later = support.signal_index(epochs[5]), support.signal_index(epochs[25])
    known = [bool(epochs[5].flags[row] & c.FLAG_PARITY_KNOWN) for row in places.values()]
    assert not any(known)
    assert all(epochs[25].flags[row] & c.FLAG_PARITY_KNOWN for row in later.values())
    halves = {bool(epochs[25].flags[row] & c.FLAG_HALF_CYCLE_ADDED) for row in later.values()}
    assert halves == {True, False}


def test_outage_of_one_satellite_then_lock_anew(motions, calm):
    key = first_key(calm)
    faulty = with_fault(
        motions, kind="outage", time=4.0, duration=2.0, satellite=satellite_name(key)
    )
    seen = [key in support.signal_index(epoch) for epoch in faulty.epochs("deputy")]
    # Two seconds without signal, then two until lock.
    assert seen == [True] * 80 + [False] * 80 + [True] * (len(seen) - 160)
    epoch = faulty.epochs("deputy")[160]
    assert epoch.lock_time[support.signal_index(epoch)[key]] == 0.0
    cycles = phase_change(faulty, calm, key, 200)
    assert cycles != 0.0 and cycles == pytest.approx(round(cycles), abs=1e-6)


def test_clock_jump(motions, calm):
    faulty = with_fault(motions, kind="clock_jump", time=3.0, seconds=1e-4)
    one, other = faulty.epochs("deputy"), calm.epochs("deputy")
    assert np.array_equal(one[59].pseudorange, other[59].pseudorange)
    moved = one[60].pseudorange - other[60].pseudorange
    # Range rates of 8 km/s make 0.8 m of 0.1 ms.
    assert moved == pytest.approx(SPEED_OF_LIGHT * 1e-4, abs=1.0)
    wavelength = carrier_wavelength(one[60].system, one[60].band)
    phase = (one[60].carrier_phase_cycles - other[60].carrier_phase_cycles) * wavelength
    assert phase == pytest.approx(moved, abs=1e-4)


def test_silent_receiver_works_on(motions, calm):
    faulty = with_fault(motions, kind="silent", time=3.0, duration=4.0)
    times = [epoch.time - faulty.start for epoch in faulty.epochs("deputy")]
    assert times == pytest.approx([k / 20.0 for k in range(241) if not 60 <= k < 140])
    assert faulty.epochs("deputy")[-1] == calm.epochs("deputy")[-1]
    assert faulty.content["chief"] == calm.content["chief"]


@pytest.mark.parametrize("kind", ["corrupted_bytes", "dropped_bytes"])
def test_damaged_bytes_cost_frames_and_never_give_wrong_ones(motions, calm, kind):
    faulty = with_fault(motions, kind=kind, time=2.0, duration=8.0, rate=1 / 2000)
    stream = ReceiverLogStream()
    events = stream.feed(bytes(faulty.content["deputy"])) + stream.close()
    epochs = [event for event in events if isinstance(event, ObservationEpoch)]
    right = {epoch.time: epoch for epoch in calm.epochs("deputy")}
    assert 81 <= len(epochs) < len(right)
    for epoch in epochs:
        expected = right[epoch.time]
        assert np.array_equal(epoch.pseudorange, expected.pseudorange)
        assert np.array_equal(epoch.carrier_phase_cycles, expected.carrier_phase_cycles)


def test_truth_file_tells_arcs_faults_and_seconds(motions, tmp_path):
    key_fault = Fault("slip", "deputy", time=5.0, signal="G2W", cycles=2.0)
    path = tmp_path / "truth.jsonl"
    run = support.Run(
        support.configuration("reference", faults=(key_fault,)),
        motions,
        support.LOGS,
        truth_path=path,
    ).all()
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    kinds = [record["record"] for record in records]
    assert kinds.count("second") == 2 * (SECONDS + 1) and kinds.count("fault") == 1
    slips = [r for r in records if r["record"] == "arc" and r["event"] == "slip"]
    epoch = run.epochs("deputy")[100]
    assert len(slips) == sum(key[2] == 2 for key in support.signal_index(epoch))
    assert {slip["signal"] for slip in slips} == {"G2W"}
    last = next(r for r in reversed(records) if r["record"] == "second")
    measured = run.measurements("deputy")
    assert last["clock_offset"] == measured.signals.clock_offset[-1]
    assert len(last["slant_tec_tecu"]) == len(last["satellites"]) >= 8


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"kind": "flood"}, "kind"),
        ({"kind": "slip"}, "cycles"),
        ({"kind": "slip", "cycles": 0.5}, "cycles"),
        ({"kind": "outage"}, "duration"),
        ({"kind": "outage", "duration": 1.0, "satellite": "X01"}, "satellite"),
        ({"kind": "outage", "duration": 1.0, "signal": "G9Z"}, "signal"),
        ({"kind": "clock_jump"}, "seconds"),
        ({"kind": "corrupted_bytes", "duration": 1.0}, "rate"),
        ({"kind": "slip", "cycles": 1.0, "duration": 1.0}, "duration"),
    ],
)
def test_fault_without_meaning_is_refused(fields, named):
    with pytest.raises(ValueError, match=named):
        Fault(receiver="deputy", time=1.0, **fields)


def test_clock_models_are_refused_by_name():
    with pytest.raises(ValueError, match="oscillator"):
        ClockModel("quartz")

"""Noise, clocks, scintillation and solutions of simulated receivers against what they should be."""

from __future__ import annotations

import dataclasses

import gnss_emulator_support as support
import numpy as np
import pytest

from vtff_gnss.fix import Fix
from vtff_gnss.novatel import ReceiverLogStream
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import NoiseModel, TrackingModel
from vtff_sim_bridge.gnss.receiver_clock import OSCILLATORS, ClockModel, ReceiverClock
from vtff_sim_bridge.noise.random_streams import Effect, NoiseField

FIX_SECONDS = 400


@pytest.fixture(scope="module")
def fixes() -> tuple[support.Run, np.ndarray, list[Fix]]:
    """Return a run at 0.3 m code noise, true positions, and the fixes that were logged."""
    motions = support.orbit_motions([support.CHIEF_GCRF], FIX_SECONDS)
    base = support.configuration("reference")
    base = dataclasses.replace(
        base,
        receivers=(dataclasses.replace(base.receivers[0], biases={}),),
        constellation=dataclasses.replace(base.constellation, inter_signal_sigma=0.0),
    )
    run = support.Run(base, motions, b"LOG BESTXYZB ONTIME 1\r\nLOG TIMEB ONTIME 1\r\n")
    truth = []

    def keep(_second: int) -> None:
        measured = run.measurements("chief")
        offset = measured.signals.clock_offset[-1]
        truth.append(
            (*measured.signals.position_itrf[-1], *measured.signals.velocity_itrf[-1], offset)
        )

    run.all(keep)
    stream = ReceiverLogStream()
    events = stream.feed(bytes(run.content["chief"])) + stream.close()
    return run, np.array(truth), [event for event in events if isinstance(event, Fix)]


def test_fix_is_unbiased_and_its_sigma_is_honest(fixes):
    """Ionosphere-free, through an evening ionosphere, with 9 or more satellites."""
    _, truth, solutions = fixes
    assert len(solutions) == len(truth) == FIX_SECONDS + 1
    error = np.array([fix.position for fix in solutions]) - truth[:, :3]
    sigma = np.array([fix.position_sigma for fix in solutions])
    assert np.abs(error.mean(axis=0)).max() < 0.3
    # Fixes are independent: the mean square of the normalised error scatters by 4 % here.
    assert np.mean((error / sigma) ** 2) == pytest.approx(0.8, abs=0.25)
    clock_error = np.array([fix.clock_offset for fix in solutions]) - truth[:, 6]
    # TIME comes after BESTXYZ: the decoder does not know yet that it has to wait for the first.
    assert abs(clock_error[1:].mean()) < 1e-9
    # Single-frequency Doppler: the ionosphere changes by some millimetres a second.
    velocity_error = np.array([fix.velocity for fix in solutions]) - truth[:, 3:6]
    assert np.abs(velocity_error.mean(axis=0)).max() < 0.01
    assert np.sqrt(np.mean(velocity_error**2)) < 0.03


def test_scatter_of_the_fix_is_noise_times_dilution(fixes):
    run, truth, solutions = fixes
    error = np.array([fix.position for fix in solutions]) - truth[:, :3]
    measured = run.measurements("chief")
    tracked = np.unique(measured.signals.plan.satellite[measured.tracks.is_tracked[-1]])
    design = np.column_stack(
        (-measured.signals.line_of_sight.direction_itrf[-1, tracked], np.ones(len(tracked)))
    )
    dilution = np.sqrt(np.trace(np.linalg.inv(design.T @ design)[:3, :3]))
    ionosphere_free = 0.3 * np.hypot(2.5457, 1.5457)
    scatter = np.sqrt(np.mean(np.sum(error[-100:] ** 2, axis=1)))
    assert scatter == pytest.approx(dilution * ionosphere_free, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("s4", [0.2, 0.4, 0.6, 0.8])
def test_s4_of_unsmoothed_cn0(s4):
    """1 h of 20 Hz C/N0 of one receiver, all satellites, against the S4 of the region."""
    region = IrregularityRegion(
        "everywhere", -0.5 * np.pi, 0.5 * np.pi, 0.0, 24.0, 0.0, 3e6, s4, decorrelation_time=0.5
    )
    seconds = 3600
    one = support.orbit_motions([support.CHIEF_GCRF], seconds, step=1.0)
    base = support.with_receivers(
        support.configuration(),
        cn0_zenith_dbhz={"G1C": 45.0},
        tracking=TrackingModel(threshold_dbhz=-100.0, channels=4),
    )
    base = dataclasses.replace(base, receivers=base.receivers[:1], regions=(region,))
    run = support.Run(base, one)
    powers: list[np.ndarray] = []

    def keep(_second: int) -> None:
        measured = run.measurements("chief")
        part = 10.0 ** (0.1 * measured.observables.cn0_dbhz) * measured.observables.pseudorange**2
        powers.append(part[measured.tracks.is_tracked])

    run.all(keep)
    power = np.concatenate(powers)
    assert len(power) > 3.5 * 20 * seconds
    assert np.std(power) / np.mean(power) == pytest.approx(s4, abs=0.02)


def test_cn0_noise_has_the_s4_floor_of_20_hz():
    motions = support.orbit_motions([support.CHIEF_GCRF], 100)
    base = support.with_receivers(
        support.configuration(), cn0_zenith_dbhz={"G1C": 45.0}, noise=NoiseModel(model="cn0")
    )
    base = dataclasses.replace(base, receivers=base.receivers[:1])
    run = support.Run(base, motions)
    powers: list[np.ndarray] = []

    def keep(_second: int) -> None:
        measured = run.measurements("chief")
        part = 10.0 ** (0.1 * measured.observables.cn0_dbhz) * measured.observables.pseudorange**2
        powers.append(part[measured.tracks.is_tracked])

    run.all(keep)
    power = np.concatenate(powers)
    # 2 / (C/N0 T), facts of the ionosphere: 0.035 at 45 dB-Hz, here weaker or stronger by range.
    assert np.std(power) / np.mean(power) == pytest.approx(0.035, abs=0.008)


def test_noise_has_the_stated_sigma():
    motions = support.orbit_motions([support.CHIEF_GCRF], 30)
    quiet = support.configuration()
    quiet = dataclasses.replace(quiet, receivers=quiet.receivers[:1])
    noisy = support.with_receivers(
        quiet, noise=NoiseModel(model="fixed", code_sigma=0.3, phase_sigma=0.001)
    )
    one = support.Run(noisy, motions, support.LOGS).all().epochs("chief")
    other = support.Run(quiet, motions, support.LOGS).all().epochs("chief")
    code = np.concatenate([a.pseudorange - b.pseudorange for a, b in zip(one, other, strict=True)])
    wavelength = {1: 0.19029367, 2: 0.24421021}
    phase = np.concatenate(
        [
            (a.carrier_phase_cycles - b.carrier_phase_cycles)
            * np.array([wavelength[band] for band in a.band.tolist()])
            for a, b in zip(one, other, strict=True)
        ]
    )
    assert len(code) > 8000
    assert np.std(code) == pytest.approx(0.3, rel=0.03)
    assert np.std(phase) == pytest.approx(0.001, rel=0.03)
    assert abs(np.mean(code)) < 0.02
    assert one[5].pseudorange_sigma == pytest.approx(0.3)


def test_noise_of_a_link_does_not_depend_on_other_links():
    addresses = [(7, 0, prn, 1, 67) for prn in range(1, 20)]
    alone = NoiseField(1, Effect.CODE_NOISE, addresses[4:5])
    together = NoiseField(1, Effect.CODE_NOISE, addresses)
    rows = np.arange(19)
    for second in (0, 63, 64, 200):
        whole = together.second(second, rows)
        assert np.array_equal(whole[:, 4], alone.second(second, np.array([0]))[:, 0])
    assert not np.array_equal(whole[:, 3], whole[:, 4])


@pytest.mark.parametrize("oscillator", ["TCXO", "OCXO", "CSAC"])
def test_allan_deviation_of_free_oscillators(oscillator):
    clock = ReceiverClock(ClockModel(oscillator, is_steered=False), seed=3, receiver=5)
    offsets = np.concatenate([clock.second(second)[0] for second in range(1, 4001)])
    for seconds in (1, 10):
        phase = offsets[:: 20 * seconds]
        second_difference = phase[2:] - 2.0 * phase[1:-1] + phase[:-2]
        measured = np.mean(second_difference**2) / (2.0 * seconds**2)
        white, walk = OSCILLATORS[oscillator]
        expected = white / (2.0 * seconds) + 2.0 * np.pi**2 / 3.0 * walk * seconds
        assert np.sqrt(measured) == pytest.approx(np.sqrt(expected), rel=0.15)


def test_steering_takes_the_offset_to_zero_and_keeps_it():
    model = ClockModel("TCXO", initial_offset=1e-6, initial_drift=1e-7)
    clock = ReceiverClock(model, seed=1, receiver=1)
    offsets = np.array([clock.second(second)[0][-1] for second in range(1, 601)])
    assert np.abs(offsets[0]) > 9e-7
    assert np.abs(offsets[200:]).max() < 1e-7
    assert np.abs(offsets[200:].mean()) < 1e-8


def test_clock_jump_comes_at_its_epoch():
    model = ClockModel("perfect", is_steered=False)
    offsets, drifts = ReceiverClock(model, 1, 1, jumps=[(7, 1e-3)]).second(1)
    assert offsets.tolist() == [0.0] * 6 + [1e-3] * 14
    assert not drifts.any()

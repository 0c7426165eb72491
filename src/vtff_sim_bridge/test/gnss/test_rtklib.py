"""RTKLIB on the bytes of the simulated receivers: scenario of 250 m, paper 004 (Oh et al. 2016).

No ionosphere, 1 mm and 0.3 m noise, ephemerides of a Spirent simulator, mask 5 deg, 12 channels,
6001 epochs at 1 Hz. RTKLIB reads the RANGE and RAWEPHEM logs; it knows of the receivers nothing
else. The position of the base is set at every epoch, because RTKLIB's own single point of a
receiver in orbit is corrected for an ionosphere and a troposphere that are not there.
"""

from __future__ import annotations

import dataclasses

import gnss_emulator_support as support
import numpy as np
import pytest
from shared_data import require_shared

from vtff_dynamics.time.timescales import GpsTime, parse_epoch
from vtff_sim_bridge.gnss.configuration import (
    ConstellationConfiguration,
    NoiseModel,
    TrackingModel,
)
from vtff_sim_bridge.simremote.motion import MotionState

pyrtklib = pytest.importorskip("pyrtklib", reason="the referee is not installed")

NAVIGATION = "data/navigation/spirent_dynamic/RINEX_GN_Spirent.23N"
TRUTH = "data/navigation/leo_250m/250m_truth.npz"
LOGS = b"LOG RANGEB ONTIME 1\r\nLOG RAWEPHEMB ONCHANGED\r\n"
SECONDS = 6000
GPS_EPOCH_UNIX = 315_964_800


@pytest.fixture(scope="module")
def run() -> tuple[support.Run, dict[GpsTime, tuple[np.ndarray, np.ndarray]]]:
    """Return the run and the true positions of both by receiver time."""
    navigation, truth = require_shared(NAVIGATION), require_shared(TRUTH)
    start = parse_epoch("2023-01-08T10:00:00 GPS")
    motions = commands_from(np.load(truth))
    base = support.with_receivers(
        support.configuration(),
        noise=NoiseModel(model="fixed", code_sigma=0.3, phase_sigma=0.001, doppler_sigma=0.0),
        # RTKLIB does not fix an ambiguity before the half cycle is known.
        tracking=TrackingModel(
            channels=12, threshold_dbhz=0.0, elevation_mask_deg=5.0, parity_delay=0.0
        ),
    )
    constellation = ConstellationConfiguration(source=str(navigation))
    base = dataclasses.replace(base, constellation=constellation)
    made = support.Run(base, motions, LOGS, start=start)
    truth = {}

    def keep(second: int) -> None:
        positions = [
            made.measurements(name).signals.position_itrf[-1] for name in ("chief", "deputy")
        ]
        truth[start + second] = (positions[0], positions[1])

    made.all(keep)
    return made, truth


def commands_from(truth) -> list[list[MotionState]]:
    """Return motion commands: positions of the file, derivatives by differences at 1 s."""
    motions = []
    columns = []
    for name in ("A", "B"):
        position = truth[name]
        velocity = np.empty_like(position)
        # Seven-point differences; the ends, where there is no motion between epochs, are plain.
        velocity[3:-3] = (
            45.0 * (position[4:-2] - position[2:-4])
            - 9.0 * (position[5:-1] - position[1:-5])
            + (position[6:] - position[:-6])
        ) / 60.0
        velocity[:3] = np.gradient(position[:7], axis=0, edge_order=2)[:3]
        velocity[-3:] = np.gradient(position[-7:], axis=0, edge_order=2)[-3:]
        columns.append((position, velocity))
    for k in range(SECONDS + 1):
        motions.append(
            [MotionState(tuple(p[k].tolist()), tuple(v[k].tolist())) for p, v in columns]
        )
    return motions


def decoded(content: bytes):
    """Return RTKLIB's observations by time and its decoder, with the ephemerides."""
    raw = pyrtklib.raw_t()
    pyrtklib.init_raw(raw, pyrtklib.STRFMT_OEM4)
    epochs = {}
    for byte in content:
        if pyrtklib.input_oem4(raw, byte) == 1:
            time = raw.obs.data[0].time
            nanoseconds = (time.time - GPS_EPOCH_UNIX) * 10**9 + round(time.sec * 1e9)
            epochs[GpsTime(nanoseconds)] = [copied(raw.obs.data[i]) for i in range(raw.obs.n)]
    return epochs, raw


def copied(source) -> dict:
    """Return the fields of an observation that a solution needs."""
    return {
        "time": (source.time.time, source.time.sec),
        "sat": source.sat,
        **{
            name: [getattr(source, name)[j] for j in range(2)]
            for name in ("P", "L", "D", "SNR", "LLI", "code")
        },
    }


def filled(target, fields: dict, receiver: int) -> None:
    target.time.time, target.time.sec = fields["time"]
    target.sat, target.rcv = fields["sat"], receiver
    for name in ("P", "L", "D", "SNR", "LLI", "code"):
        for j in range(2):
            getattr(target, name)[j] = fields[name][j]


def options(frequencies: int, mode: int):
    chosen = pyrtklib.prcopt_t()
    pyrtklib.resetsysopts()
    pyrtklib.getsysopts(chosen, None, None)
    chosen.mode = pyrtklib.PMODE_KINEMA
    chosen.nf = frequencies
    chosen.navsys = pyrtklib.SYS_GPS
    chosen.elmin = np.radians(5.0)
    chosen.ionoopt, chosen.tropopt = pyrtklib.IONOOPT_OFF, pyrtklib.TROPOPT_OFF
    chosen.modear = mode
    chosen.thresar[0] = 3.0
    # The noise is the same at all elevations.
    chosen.err[1], chosen.err[2] = 0.003, 0.0
    chosen.dynamics = 0
    return chosen


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frequencies", "mode", "rms"), [(2, 3, 1.6e-3), (1, 1, 2.27e-3)], ids=["L1L2 hold", "L1 cont"]
)
def test_kinematic_baseline(run, frequencies, mode, rms):
    """Facts on navigation, section 5: 100 % fixed, 1.60 mm with L1 and L2, 2.27 mm with L1."""
    made, truth = run
    chief, navigation = decoded(bytes(made.content["chief"]))
    deputy, _ = decoded(bytes(made.content["deputy"]))
    rtk = pyrtklib.rtk_t()
    pyrtklib.rtkinit(rtk, options(frequencies, mode))
    errors, is_fixed = [], []
    for time in sorted(chief.keys() & deputy.keys()):
        fields = [(2, o) for o in chief[time]] + [(1, o) for o in deputy[time]]
        epoch = pyrtklib.Arr1Dobsd_t(len(fields))
        rover = [item for item in fields if item[0] == 1]
        base = [item for item in fields if item[0] == 2]
        for i, (receiver, observation) in enumerate(rover + base):
            filled(epoch[i], observation, receiver)
        base_position, rover_position = truth[time]
        for axis in range(3):
            rtk.opt.rb[axis] = rtk.rb[axis] = float(base_position[axis])
        pyrtklib.rtkpos(rtk, epoch.ptr, len(fields), navigation.nav)
        is_fixed.append(rtk.sol.stat == pyrtklib.SOLQ_FIX)
        errors.append([rtk.sol.rr[axis] - rover_position[axis] for axis in range(3)])
    assert len(errors) == SECONDS + 1
    error = np.array(errors)
    measured_rms = np.sqrt(np.mean(np.sum(error**2, axis=1)))
    print(f"nf {frequencies}: fixed {np.mean(is_fixed):.4%}, 3-D RMS {measured_rms * 1e3:.3f} mm")
    assert np.mean(is_fixed) == 1.0
    assert measured_rms == pytest.approx(rms, rel=0.1)

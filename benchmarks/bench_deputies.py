"""Two deputies of one chief: how their errors correlate, and the honesty of their difference.

The flight of config/system/formation_three.yaml without ROS: truth, controllers fed with truth,
bytes of three emulated receivers, decoders, and a filter for each deputy with the parameters of
config/system/realistic.yaml. NEES of each deputy and of the difference is e' P^-1 e over three, so
1 is honest; correlations are those of the errors of both, about zero, radial, in-track and normal.
A flight of 900 s has few independent errors: only the mean over many says something.

    python benchmarks/bench_deputies.py [--seeds 10] [--first-seed 1] [--draw] [--worse 2]
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np
from realism.recording import DESIGN, LOGS
from realism.worlds import CONFIG, FIRST_SECOND, calibrated_in_file
from tables import add_write_option, write_rows

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_analysis.evaluation.deputy_pairs import normalised_error
from vtff_dynamics.frames.rtn import relative_state_rtn
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.novatel import ReceiverLogStream
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.observations import ObservationEpoch
from vtff_nav.relative.common.deputy_difference import difference_of_deputies
from vtff_nav.relative.common.estimator_setting import EstimatorSetting
from vtff_nav.relative.common.solution import SOLUTION_NONE
from vtff_nav.relative.shipped_estimators import make_cdgps
from vtff_sim_bridge.bridge.simgen_link import motion_state
from vtff_sim_bridge.gnss.configuration import (
    GnssConfiguration,
    assign_vehicles,
    load_gnss_configuration,
)
from vtff_sim_bridge.receiver.receiver_firmware import ReceiverFirmware
from vtff_sim_bridge.receiver.truth_file import TruthFile
from vtff_sim_bridge.simgen.gnss_emulation import ReceiverSet
from vtff_sim_bridge.simremote.motion import VehicleMotion
from vtff_sim_bridge.truth.drawn_geometry import GeometryDraw
from vtff_sim_bridge.truth.scenario import Scenario, load_scenario

_DRAW = GeometryDraw(epoch_days=1.0, node=True, place_on_orbit=True)


COLUMNS = (
    "flights",
    "3-D RMS of bravo, charlie, their difference, mm (worst flight)",
    "NEES of the three",
    "correlation R, T, N",
)
"""Columns of the row that is kept."""


def make_flight(
    seed: int, seconds: int, is_drawn: bool, worse: float
) -> tuple[Scenario, GnssConfiguration]:
    """Return scenario and receivers; the last deputy has noise and multipath `worse` as large."""
    scenario = load_scenario(CONFIG / "scenario/formation_three.yaml")
    gnss = load_gnss_configuration(CONFIG / "gnss/formation_three.yaml")
    craft = scenario.spacecraft
    if is_drawn:
        drawn, first = _DRAW.draw(seed), craft[0].state_gcrf
        craft = tuple(
            dataclasses.replace(one, state_gcrf=drawn.turned(one.state_gcrf, first))
            for one in craft
        )
        scenario = dataclasses.replace(scenario, epoch=scenario.epoch + float(drawn.delay))
        constellation = dataclasses.replace(gnss.constellation, seed=seed)
        gnss = dataclasses.replace(gnss, constellation=constellation)
    scenario = dataclasses.replace(scenario, seed=seed, duration=float(seconds), spacecraft=craft)
    *others, last = gnss.receivers
    noise, multipath = (
        dataclasses.replace(
            model, code_sigma=worse * model.code_sigma, phase_sigma=worse * model.phase_sigma
        )
        for model in (last.noise, last.multipath)
    )
    last = dataclasses.replace(last, noise=noise, multipath=multipath)
    gnss = dataclasses.replace(gnss, seed=seed, receivers=(*others, last))
    vehicles = {one.name: f"v{number}_m1" for number, one in enumerate(craft, start=1)}
    return scenario, assign_vehicles(gnss, vehicles)


def fly(scenario: Scenario, gnss: GnssConfiguration) -> list[tuple[FloatArray, FloatArray]]:
    """Return errors of position, m, (n, 3), and their covariances, (n, 3, 3), of each deputy."""
    firmware = {
        receiver.name: ReceiverFirmware(settings=HeaderSettings(generation=receiver.generation))
        for receiver in gnss.receivers
    }
    for emulated in firmware.values():
        emulated.receive(LOGS)
    chief, *deputies = (craft.name for craft in scenario.spacecraft)
    planned = simulate_closed_loop(scenario, DESIGN)
    truth = scenario.formation_truth()
    receivers = ReceiverSet(
        gnss,
        firmware,
        scenario.epoch,
        scenario.epoch + scenario.duration,
        truth.motion_itrf(chief)[:2].ravel(),
        TruthFile(None),
    )
    streams = {name: ReceiverLogStream() for name in firmware}
    vehicles = {receiver.vehicle: VehicleMotion() for receiver in gnss.receivers}
    filters = {name: make_cdgps(calibrated_in_file(EstimatorSetting())) for name in deputies}
    errors: dict[str, list[FloatArray]] = {name: [] for name in deputies}
    covariances: dict[str, list[FloatArray]] = {name: [] for name in deputies}
    for second in range(round(scenario.duration)):
        nanoseconds = second * 10**9
        thrust = {name: planned.deputy(name).applied_rtn[second] for name in deputies}
        for name, motion in zip((chief, *deputies), vehicles.values(), strict=True):
            motion.command(nanoseconds, motion_state(truth.motion_itrf(name, thrust.get(name))))
        sent: dict[str, bytearray] = {name: bytearray() for name in streams}
        receivers.advance(
            nanoseconds, vehicles.__getitem__, lambda name, new, sent=sent: sent[name].extend(new)
        )
        for motion in vehicles.values():
            motion.forget_before(nanoseconds)
        epochs: dict[str, ObservationEpoch | None] = {}
        for name, stream in streams.items():
            events = stream.feed(bytes(sent[name]))
            observed = [event for event in events if isinstance(event, ObservationEpoch)]
            epochs[name] = observed[-1] if observed else None
            for event in events:
                if isinstance(event, BroadcastEphemeris):
                    for estimator in filters.values():
                        estimator.add_ephemeris(event)
        for name, estimator in filters.items():
            solution = estimator.process(truth.time, epochs[chief], epochs[name])
            true = relative_state_rtn(truth.state_gcrf(chief), truth.state_gcrf(name))
            if second >= FIRST_SECOND:
                if solution.solution == SOLUTION_NONE:
                    raise SystemExit(f"{name} has no solution after {second} s")
                errors[name].append(solution.position_rtn - true[:3])
                covariances[name].append(solution.covariance_rtn[:3, :3])
            if thrust[name].any():
                estimator.add_thrust(truth.time, 1.0, thrust[name])
        truth.advance(thrust)
    return [(np.array(errors[name]), np.array(covariances[name])) for name in deputies]


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10, help="number of flights (%(default)s)")
    parser.add_argument("--first-seed", type=int, default=1, help="(%(default)s)")
    parser.add_argument("--seconds", type=int, default=900, help="length of one (%(default)s)")
    parser.add_argument("--draw", action="store_true", help="epoch, place and sky from the seed")
    parser.add_argument(
        "--worse", type=float, default=1.0, help="noise of the last deputy's receiver, as a factor"
    )
    add_write_option(parser, "deputies")
    given = parser.parse_args()
    if given.seeds < 1 or given.seconds <= FIRST_SECOND or not given.worse > 0.0:
        parser.error(f"a flight or more of more than {FIRST_SECOND} s, and a factor, expected")
    print("seed   RMS, mm: B, C, B-C      NEES: B, C, B-C     correlation: R, T, N")
    figures = []
    products = np.zeros((3, 3))
    for seed in range(given.first_seed, given.first_seed + given.seeds):
        first, second = fly(*make_flight(seed, given.seconds, given.draw, given.worse))
        pair = difference_of_deputies(first[0], second[0], first[1], second[1])
        row = [1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1))) for error in (first[0], second[0])]
        row.append(1e3 * np.sqrt(np.mean(np.sum(pair[0] ** 2, axis=1))))
        row += [float(normalised_error(*one) or np.nan) for one in (first, second, pair)]
        figures.append(row)
        terms = np.array(
            [np.mean(a * b, axis=0) for a, b in ((first[0],) * 2, (second[0],) * 2)]
            + [np.mean(first[0] * second[0], axis=0)]
        )
        products += terms
        _print(f"{seed:4d}", row, terms)
    _print("mean", np.mean(figures, axis=0).tolist(), products)
    if given.write:
        name = "drawn geometry" if given.draw else "shipped geometry"
        name += f", noise of charlie times {given.worse:g}" if given.worse != 1.0 else ""
        mean, worst = np.mean(figures, axis=0), np.max(figures, axis=0)
        row = [
            name,
            f"{_join(mean[:3], 1)} ({_join(worst[:3], 1)})",
            _join(mean[3:], 2),
            _join(_correlation(products), 2),
        ]
        last = given.first_seed + given.seeds - 1
        write_rows("deputies", COLUMNS, [row], f"{given.first_seed} to {last}")


def _correlation(terms: FloatArray) -> FloatArray:
    correlation: FloatArray = terms[2] / np.sqrt(terms[0] * terms[1])
    return correlation


def _join(values: FloatArray, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _print(label: str, row: list[float], terms: FloatArray) -> None:
    texts = [f"{value:6.2f}" for value in (*row, *_correlation(terms))]
    print(
        f"{label}  {''.join(texts[:3])}     {''.join(texts[3:6])}     {''.join(texts[6:])}",
        flush=True,
    )


if __name__ == "__main__":
    main()

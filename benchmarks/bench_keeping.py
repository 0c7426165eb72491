"""Keeping of paper 002 on navigation, without ROS: from the triangle to the PCO, and three hours.

The forces, the engines and the guidance are those of `vtff run fflas`, the navigation is drawn:
Gauss-Markov errors of each axis, and the covariance of them times the square of a factor. Figures
are those of the deputies from the arrival on; dv is that of the spacecraft that spends most, as a
sum over axes, scaled to a day.

    python benchmarks/bench_keeping.py --seeds 21 22 23
    python benchmarks/bench_keeping.py --seeds 1 11 --position 2.5 --velocity 30 --correlation 600 \
        --stated 0.6
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np

from vtff_analysis.closed_loop.drawn_navigation import DrawnNavigation, NavigationErrorModel
from vtff_control.guidance.formation_guidance import FormationGuidance, FormationGuidanceParameters
from vtff_control.guidance.formations import read_formations
from vtff_control.guidance.interface import FormationState, GuidanceSetting
from vtff_control.guidance.requests import ReconfigurationRequest
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray
from vtff_node.executables import share_file
from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.truth.scenario import load_scenario

STEP = 10.0  # s
ASKED, DURATION = 30.0, 4560.0  # s: when the reconfiguration is asked for, and its length
PUSH_TIME, PUSH_LENGTH = 3600.0, 100.0  # s after the arrival, s


class KeepingFlight:
    """The flight of `vtff run fflas` with drawn navigation.

    Parameters
    ----------
    model
        Errors of navigation; each deputy has its own seed.
    stated
        Stated sigma over the true one.
    push
        Velocity along the track that the first deputy gets an hour after the arrival, m/s, in
        100 s; the guidance is not told.
    """

    def __init__(self, model: NavigationErrorModel, stated: float, push: float = 0.0) -> None:
        scenario = load_scenario(share_file("vtff_bringup", "config/scenario/fflas.yaml"))
        scenario = dataclasses.replace(scenario, step=STEP, seed=model.seed)
        self.truth = scenario.formation_truth()
        names = tuple(spacecraft.name for spacecraft in scenario.spacecraft)
        file = share_file("vtff_bringup", "config/formation/fflas.yaml")
        formations = read_formations(parse_yaml(Path(file).read_text()), "fflas.yaml", names)
        setting = GuidanceSetting(names[0], names[1:], STEP, formations=formations)
        self.guidance = FormationGuidance(setting, FormationGuidanceParameters("triangle"))
        self.names = names
        self.navigation = {
            name: DrawnNavigation(
                dataclasses.replace(model, seed=100 * model.seed + number),
                scenario.force_model,
                STEP,
            )
            for number, name in enumerate(names[1:])
        }
        self.stated = stated
        self.push = push
        self.pending = np.zeros((len(names), 3))

    def fly(self, end: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Fly to a time after the arrival, s.

        Returns
        -------
        tuple
            Positions and deviations from the targets in the chief's RTN frame, m, and thrust, m/s2,
            each of shape (k, spacecraft, 3) with a sample every `STEP` from the arrival on; the
            closest approach before, m.
        """
        rows: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        closest, before, asked, steps = math.inf, np.zeros((0, 3)), None, 0
        while len(rows) * STEP < end:
            chief, now = self.truth.state_gcrf(self.names[0]), self.truth.time
            true = {name: self.truth.relative_state_rtn(name) for name in self.names[1:]}
            states, covariances = {}, {}
            for name, drawn in self.navigation.items():
                states[name], covariance = drawn.estimate(now, 0.0, chief, true[name])
                covariances[name] = self.stated**2 * covariance
            result = self.guidance.step(FormationState(now.nanoseconds, chief, states, covariances))
            targets = [result.targets[name] for name in self.names]
            if asked is None and STEP * steps >= ASKED:
                asked = self.guidance.request(ReconfigurationRequest("pco", DURATION))
            positions = np.array([np.zeros(3), *(state[:3] for state in true.values())])
            if asked is not None and asked.finished:
                wanted = np.array([target.relative_state[:3] for target in targets])
                rows.append((positions, positions - wanted, self.pending.copy()))
            elif len(before):
                closest = min(closest, _closest(np.array([before, positions])))
            before, steps = positions, steps + 1
            thrust = self.pending.copy()
            if 0.0 <= len(rows) * STEP - PUSH_TIME < PUSH_LENGTH:
                thrust[1, 1] += self.push / PUSH_LENGTH
            self.truth.advance(dict(zip(self.names, thrust, strict=True)))
            self.pending = np.array([target.acceleration_rtn for target in targets])
        flown, deviations, thrusts = (np.array(column) for column in zip(*rows, strict=True))
        return flown, deviations, thrusts, closest


def _closest(positions: FloatArray) -> float:
    pairs = itertools.combinations(range(positions.shape[1]), 2)
    return min(closest_on_path(positions[:, j] - positions[:, i]) for i, j in pairs)


def describe(positions: FloatArray, deviations: FloatArray, thrust: FloatArray) -> str:
    """Return the figures of a span in a line."""
    spent = np.abs(thrust).sum(axis=(0, 2)) * STEP * 86400.0 / (len(thrust) * STEP)
    squares = (deviations[:, 1:] ** 2).mean(axis=0)
    rms = 100.0 * np.sqrt(squares.sum(axis=1))
    worst = int(np.argmax(rms))
    axes = 100.0 * np.sqrt(squares[worst])
    return (
        f"{1e3 * spent.max():5.1f} mm/s a day, RMS {rms[worst]:4.1f} cm "
        f"(R {axes[0]:.1f}, T {axes[1]:.1f}, N {axes[2]:.1f}), pairs {_closest(positions):5.2f} m"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[21, 22, 23])
    parser.add_argument("--hours", type=float, default=3.0, help="after the arrival")
    parser.add_argument("--position", type=float, default=1.5, help="sigma of each axis, mm")
    parser.add_argument("--velocity", type=float, default=15.0, help="sigma of each axis, um/s")
    parser.add_argument("--correlation", type=float, default=300.0, help="of the errors, s")
    parser.add_argument("--stated", type=float, default=1.0, help="stated sigma over the true one")
    parser.add_argument("--push", type=float, default=0.0, help="mm/s that nobody commanded")
    parser.add_argument("--spans", action="store_true", help="each half hour on its own, too")
    given = parser.parse_args()
    for seed in given.seeds:
        model = NavigationErrorModel(
            1e-3 * given.position, 1e-6 * given.velocity, given.correlation, seed=seed
        )
        flight = KeepingFlight(model, given.stated, 1e-3 * given.push)
        *flown, closest = flight.fly(3600.0 * given.hours)
        positions, deviations, thrust = flown
        print(f"seed {seed}: {describe(*flown)}; before the arrival {closest:.2f} m", flush=True)
        samples = int(1800.0 / STEP)
        for begin in range(0, len(positions), samples) if given.spans else ():
            span = slice(begin, begin + samples)
            text = describe(positions[span], deviations[span], thrust[span])
            print(f"  {STEP * begin / 3600.0:.1f} h: {text}", flush=True)


if __name__ == "__main__":
    main()

"""Survey of nights with drifting bubbles against the formation held 1 km below and 15 km behind.

Nights, orbits, drifts and errors are drawn by seed. There is no ROS and no receiver in this loop:
navigation is drawn, and what the ionosphere chain would tell is emulated from the truth with errors
(vtff_sim_bridge.atmosphere.ray_edge_emulation). The motion is true: JGM-3 8x8 and drag.

    python benchmarks/bench_survey.py --seeds 1 2 3
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it; as the vtff command does.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})

import numpy as np  # noqa: E402
from survey.loop import STEP, Case, FalseEdge, Flown, fly, fly_fixed  # noqa: E402
from survey.night import draw_night  # noqa: E402

from vtff_control.survey.prediction import PredictedCrossing  # noqa: E402
from vtff_sim_bridge.atmosphere.walls import (  # noqa: E402
    WallTruth,
    edges_by_difference,
    nearest_wall,
    next_crossing_error,
)

DIFFERENCES = (500.0, 1000.0, 2000.0)


def prediction_errors(flown: Flown) -> tuple[float, float]:
    """Return the largest error (s) and the largest error over sigma of each next crossing.

    After two passes and more; each wall and spacecraft at the first decision after a pass.
    """
    errors, normalised = [], []
    for prediction in flown.predictions:
        first: dict[tuple[int, str], PredictedCrossing] = {}
        for crossing in prediction.crossings:
            first.setdefault((crossing.wall, crossing.spacecraft), crossing)
        for (number, spacecraft), crossing in first.items():
            wall = prediction.walls[number]
            if wall.passes < 2:
                continue
            place = wall.longitude_at(prediction.time)
            true, _ = nearest_wall(flown.truth, prediction.time, place, wall.is_entry)
            error = next_crossing_error(
                flown.truth, true, spacecraft, prediction.time, crossing.time
            )
            if error is not None:
                errors.append(abs(error))
                normalised.append(abs(error) / crossing.time_sigma)
    return max(errors, default=np.nan), max(normalised, default=np.nan)


def drift_error(flown: Flown) -> float:
    """Return the largest error of the drift of a wall at the end, m/s."""
    errors = []
    for wall in flown.guidance.estimate.walls:
        if wall.passes >= 2:
            (region, _), _ = nearest_wall(flown.truth, wall.time, wall.longitude, wall.is_entry)
            errors.append(abs(wall.drift - float(flown.truth.regions[region].drift_east or 0.0)))
    return max(errors, default=np.nan)


def counts(truth: WallTruth) -> list[int]:
    """Return the edges crossed with at least each altitude difference."""
    differences = np.array(edges_by_difference(truth.crossings))
    return [int((differences >= least).sum()) for least in DIFFERENCES]


def dv_after_acquisition(flown: Flown) -> tuple[float, float, float]:
    """Return velocity changes: until the first ellipse, and after it in all and an hour, m/s."""
    arrived = flown.guidance.arrived
    if not np.isfinite(arrived):
        return float(flown.velocity_change.sum()), 0.0, 0.0
    index = int(arrived / STEP) + 2
    after = float(flown.velocity_change[index:].sum())
    hours = (len(flown.velocity_change) - index) * STEP / 3600.0
    return float(flown.velocity_change[:index].sum()), after, after / hours


def row(name: str, flown: Flown) -> str:
    """Return a row of the table."""
    first, _, rate = dv_after_acquisition(flown)
    time_error, normalised = prediction_errors(flown)
    edges = "/".join(str(count) for count in counts(flown.truth))
    return (
        f"| {name} | {edges} | {first:.2f} | {rate:.3f} | {drift_error(flown):.1f} | "
        f"{time_error:.1f} ({normalised:.1f}) | {flown.closest:.0f} | {flown.closest_drift:.0f} | "
        f"{len(flown.guidance.plans)} |"
    )


def false_edges_among(truth: WallTruth) -> Case:
    """Return a night with false edges in every pass.

    An entry by one ray and one by four within the first bubble, an entry and an exit by four rays
    between the first and the second, and interference between the second and the third.
    """
    times = {
        (*crossing.wall, crossing.number): crossing.time
        for crossing in truth.crossings
        if crossing.spacecraft == "chief"
    }
    edges, interference = [], []
    for number in range(1 + max(key[2] for key in times)):
        walls = [times.get((*wall, number)) for wall in itertools.product(range(3), (True, False))]
        if None in walls:
            continue
        entry, exit_1, entry_2, exit_2, entry_3, _ = np.array(walls, dtype=float).tolist()
        middle, gap = 0.5 * (entry + exit_1), entry_2 - exit_1
        edges += [
            FalseEdge(middle - 12.0, True, 1),
            FalseEdge(middle, True, 4),
            FalseEdge(exit_1 + 0.4 * gap, True, 4),
            FalseEdge(exit_1 + 0.7 * gap, False, 4),
        ]
        interference.append((exit_2 + 0.4 * (entry_3 - exit_2), exit_2 + 0.6 * (entry_3 - exit_2)))
    return Case(false_edges=tuple(edges), interference=tuple(interference))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--cases", nargs="+", help="names of cases; all if not given")
    parser.add_argument("--log", action="store_true", help="print what was decided and why")
    given = parser.parse_args()
    print("| night | edges with spacecraft 0.5/1/2 km apart in altitude | m/s to first ellipse |")
    print("m/s an hour after | drift error m/s | next crossing s (sigmas) | closest m |")
    print("closest in drift m | plans |")
    for seed in given.seeds:
        night = draw_night(seed)
        fixed = fly_fixed(night)
        edges = "/".join(str(count) for count in counts(fixed))
        print(f"| seed {seed}, fixed -1 km / -15 km | {edges} | | | | | | | |", flush=True)
        orbit = night.period
        cases = {
            "survey": Case(),
            "no bubbles": Case(has_bubbles=False),
            "no bubbles, false edges": Case(
                has_bubbles=False,
                false_edges=(FalseEdge(900.0, True, 1), FalseEdge(2500.0, True, 4)),
                interference=((4000.0, 4020.0), (7000.0, 7060.0)),
            ),
            "false edges among bubbles": false_edges_among(fixed),
            "contact lost in the transfer": Case(outage=(2600.0, 2600.0 + orbit)),
            "contact lost in the survey": Case(outage=(9000.0, 9000.0 + orbit)),
        }
        for name, case in cases.items():
            if given.cases and name not in given.cases:
                continue
            flown = fly(night, case)
            print(row(f"seed {seed}, {name}", flown), flush=True)
            if given.log:
                print("\n".join(flown.log), file=sys.stderr, flush=True)
            if name == "survey":
                again = fly(night, case, 0.3 * night.duration)
                same = np.array_equal(
                    again.velocity_change, flown.velocity_change[: len(again.velocity_change)]
                )
                print(f"| seed {seed}, again: {'same' if same else 'DIFFERENT'} | | | | | | | | |")


if __name__ == "__main__":
    main()

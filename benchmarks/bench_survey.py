"""Survey of nights with drifting bubbles against the formation held 1 km below and 15 km behind.

Nights, orbits, drifts and errors are drawn by seed. There is no ROS and no receiver in this loop:
navigation is drawn, and what the ionosphere chain would tell is emulated from the truth with errors
(vtff_sim_bridge.atmosphere.ray_edge_emulation). The motion is true: JGM-3 8x8 and drag.

    python benchmarks/bench_survey.py --seeds 1 2 3
"""

from __future__ import annotations

import argparse
import os
import sys

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it; as the vtff command does.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})

import numpy as np  # noqa: E402
from survey.loop import STEP, Case, Flown, fly, fly_fixed  # noqa: E402
from survey.night import Night, TrueCrossing, draw_night, edges_by_difference  # noqa: E402

DIFFERENCES = (500.0, 1000.0, 2000.0)


def prediction_errors(flown: Flown) -> tuple[float, float]:
    """Return the largest error (s) and the largest error over sigma of each next crossing.

    After two passes and more; each wall and spacecraft at the first decision after a pass.
    """
    errors, normalised = [], []
    for prediction in flown.predictions:
        if prediction.passes < 2:
            continue
        first = {}
        for crossing in prediction.crossings:
            first.setdefault((crossing.wall, crossing.spacecraft), crossing)
        for crossing in first.values():
            times = [c.time for c in flown.crossings if c.spacecraft == crossing.spacecraft]
            error = min(abs(time - crossing.time) for time in times)
            # One that the flight did not reach any more.
            if crossing.time < flown.crossings[-1].time + 300.0:
                errors.append(error)
                normalised.append(error / crossing.time_sigma)
    return max(errors, default=np.nan), max(normalised, default=np.nan)


def drift_error(night: Night, flown: Flown) -> float:
    """Return the largest error of the drift of a wall at the end, m/s."""
    errors = []
    for wall in flown.guidance.estimate.walls:
        if wall.passes >= 2:
            region = min(
                night.regions,
                key=lambda r: abs(_middle_longitude(night, r, wall.time) - wall.longitude),
            )
            errors.append(abs(wall.drift - float(region.drift_east or 0.0)))
    return max(errors, default=np.nan)


def _middle_longitude(night: Night, region: object, time: float) -> float:
    west, width = region.longitude_limits(night.start)  # type: ignore[attr-defined]
    middle = west + 0.5 * width + float(region.drift_angle(time))  # type: ignore[attr-defined]
    return (middle + np.pi) % (2.0 * np.pi) - np.pi


def counts(crossings: list[TrueCrossing]) -> list[int]:
    """Return the edges crossed with at least each altitude difference."""
    differences = np.array(edges_by_difference(crossings))
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


def row(name: str, night: Night, flown: Flown) -> str:
    """Return a row of the table."""
    first, _, rate = dv_after_acquisition(flown)
    time_error, normalised = prediction_errors(flown)
    edges = "/".join(str(count) for count in counts(flown.crossings))
    return (
        f"| {name} | {edges} | {first:.2f} | {rate:.3f} | {drift_error(night, flown):.1f} | "
        f"{time_error:.1f} ({normalised:.1f}) | {flown.closest:.0f} | {flown.closest_drift:.0f} | "
        f"{len(flown.guidance.plans)} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--log", action="store_true", help="print what was decided and why")
    given = parser.parse_args()
    print("| night | edges with spacecraft 0.5/1/2 km apart in altitude | m/s to first ellipse |")
    print("m/s an hour after | drift error m/s | next crossing s (sigmas) | closest m |")
    print("closest in drift m | plans |")
    for seed in given.seeds:
        night = draw_night(seed)
        fixed = "/".join(str(count) for count in counts(fly_fixed(night)))
        print(f"| seed {seed}, fixed -1 km / -15 km | {fixed} | | | | | | | |", flush=True)
        orbit = night.period
        cases = {
            "survey": Case(),
            "no bubbles, false edges": Case(
                has_bubbles=False, false_edges=((900.0, 1), (2500.0, 1), (7000.0, 3))
            ),
            "contact lost in the transfer": Case(outage=(2600.0, 2600.0 + orbit)),
            "contact lost in the survey": Case(outage=(9000.0, 9000.0 + orbit)),
        }
        for name, case in cases.items():
            flown = fly(night, case)
            print(row(f"seed {seed}, {name}", night, flown), flush=True)
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

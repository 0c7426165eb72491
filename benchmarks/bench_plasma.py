"""The ionosphere chain in plasma and with receivers that it was not tuned on, against the truth.

Flights without ROS: true orbits, emulated receivers at 20 Hz before their logs are encoded, the
relative filter that vtff ships, and the ionosphere chain. Orbits, constellation, plasma and noise
are drawn by seed (benchmarks/plasma/worlds.py). With --cache, flights are kept and taken again.
"""

from __future__ import annotations

import argparse
import math
import os
import pathlib
import sys
from collections.abc import Sequence

from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

# Before numpy is imported, which reads it; as the vtff command does.
os.environ.update({**ONE_BLAS_THREAD, **os.environ})

import numpy as np  # noqa: E402
from plasma.chain import ChainResult, run_chain  # noqa: E402
from plasma.figures import (  # noqa: E402
    absolute_figures,
    density_figures,
    edge_figures,
    false_edges,
    wall_errors,
)
from plasma.recording import load_or_fly  # noqa: E402
from plasma.worlds import PlasmaWorld, draw_bubble_world, quiet_worlds  # noqa: E402
from tables import add_write_option, write_rows  # noqa: E402

from vtff_nav.relative.common.estimator_setting import EstimatorSetting  # noqa: E402

Flown = list[tuple[PlasmaWorld, ChainResult]]

# Absolute contents are there from the tenth minute on.
COLUMNS = ("figure", "must", "measured")
"""Columns of the rows of bubbles that are kept."""
_ABSOLUTE_MINUTES = ((10, 20), (20, 50), (50, 70))
_AGE_MINUTES = ((0, 5.0), (5, 10.0), (10, math.inf))


def fly(worlds: Sequence[PlasmaWorld], cache: pathlib.Path | None) -> Flown:
    """Fly worlds and run the chain over them."""
    flown: Flown = []
    # Antennas are stated to be ideal, as they are in these worlds.
    setting = EstimatorSetting(antennas=None)
    for number, world in enumerate(worlds, 1):
        name = f"{world.name.replace(' ', '_').replace('/', '')}-{world.seed}"
        recording = load_or_fly(name, world.scenario(), world.gnss(), setting, cache)
        flown.append((world, run_chain(recording, world)))
        print(f"{number} of {len(worlds)}: {world.name}", file=sys.stderr, flush=True)
    return flown


def report_quiet(flown: Flown) -> None:
    """Print false edges, densities, absolute contents and processor time of quiet flights."""
    print(
        "| quiet plasma | s | false edges | density: mean error, stated sigma, 1e4 cm-3 | z RMS,",
        end=" ",
    )
    print("largest z |", end=" ")
    for first, last in _ABSOLUTE_MINUTES:
        print(f"absolute TEC, minutes {first} to {last}: RMS, z RMS |", end=" ")
    print("processor, s per s |")
    print("|---|---|---|---|---|" + "---|" * len(_ABSOLUTE_MINUTES) + "---|")
    for world, result in flown:
        density = density_figures(world, result)
        absolute = [
            absolute_figures(world, result, 60.0 * first, 60.0 * last)
            for first, last in _ABSOLUTE_MINUTES
        ]
        print(
            f"| {world.name}, seed {world.seed} | {world.seconds} | {len(result.edges) // 2} | "
            f"{density.mean_error:.1f}, {density.sigma:.1f} | {density.z_rms:.2f}, "
            f"{density.largest_z:.1f} | "
            + "".join(f"{of_time.rms:.2f}, {of_time.z_rms:.2f} | " for of_time in absolute)
            + f"{result.processor_time:.3f} |"
        )
    hours = sum(world.seconds for world, _ in flown) / 3600.0
    print(f"{sum(len(r.edges) // 2 for _, r in flown)} false edges in {hours:.1f} h")
    print()
    report_ages(flown)


def report_ages(flown: Flown) -> None:
    """Print the errors of absolute contents by the ages of their arcs."""
    print("| absolute TEC by the age of its arc, min |", end=" ")
    for first, last in _ABSOLUTE_MINUTES:
        print(f"minutes {first} to {last}: part, RMS, z RMS; what codes allow |", end=" ")
    print()
    print("|---|" + "---|" * len(_ABSOLUTE_MINUTES))
    for world, result in flown:
        for youngest, oldest in _AGE_MINUTES:
            name = f"from {youngest}" if math.isinf(oldest) else f"{youngest} to {oldest:g}"
            print(f"| {world.name}, seed {world.seed}: {name} |", end=" ")
            ages = 60.0 * youngest, 60.0 * oldest
            for first, last in _ABSOLUTE_MINUTES:
                found = absolute_figures(world, result, 60.0 * first, 60.0 * last, ages)
                print(f"{100.0 * found.part:.0f} %, {found.rms:.2f}, {found.z_rms:.2f};", end=" ")
                print(f"{found.code_bound:.2f} |", end=" ")
            print()


def report_bubbles(flown: Flown) -> None:
    """Print what was told of the walls of drawn bubbles."""
    figures = edge_figures(flown)
    print(f"walls of {len(flown)} bubbles: {figures.walls}, with a contrast over 5 sigma ", end="")
    low, high = figures.strong_interval
    print(
        f"{figures.strong_walls}; of these told {figures.strong_told} ({low:.2f} to {high:.2f}), ",
        end="",
    )
    print(f"of the others {figures.told - figures.strong_told}; ", end="")
    print(f"told where there is none {figures.false}")
    low, high = figures.time_z_interval
    print(f"time error over sigma, RMS {figures.time_z:.2f} ({low:.2f} to {high:.2f}), ", end="")
    print(f"median {figures.time_z_median:.2f}")
    print(
        f"widths over 1 km within 30 %: {figures.widths_good} of {figures.widths}, of those whose "
        f"sigma is below 20 % {figures.widths_sure_good} of {figures.widths_sure}, of those whose "
        f"bound is below 15 % {figures.widths_possible_good} of {figures.widths_possible}; "
        f"median error {100.0 * figures.width_error:.0f} %,",
        end=" ",
    )
    low, high = figures.width_z_interval
    print(f"error over sigma RMS {figures.width_z:.2f} ({low:.2f} to {high:.2f})")
    low, high = figures.separation_z_interval
    print(
        f"separation, mean of two walls: {figures.separations} bubbles, error over sigma RMS "
        f"{figures.separation_z:.2f} ({low:.2f} to {high:.2f}), error RMS ",
        end="",
    )
    low, high = (100.0 * value for value in figures.separation_error_interval)
    print(
        f"{100.0 * figures.separation_error:.1f} % ({low:.1f} to {high:.1f}), bound "
        f"{100.0 * figures.separation_bound:.1f} %"
    )
    ratios = [density_figures(world, result) for world, result in flown]
    z = math.sqrt(np.mean([r.z_rms**2 for r in ratios if math.isfinite(r.z_rms)]))
    print(f"density z RMS {z:.2f}, largest {max(r.largest_z for r in ratios):.1f}; ", end="")
    print(f"beyond 3 sigma below zero: {sum(r.impossible for r in ratios)} seconds")
    for world, result in flown:
        density = density_figures(world, result)
        print(f"  {world.name}: density z RMS {density.z_rms:.2f}, largest {density.largest_z:.1f}")
        for error in wall_errors(world, result):
            print(f"  {error}")
        for line in false_edges(world, result):
            print(f"  {line}")


def bubble_rows(flown: Flown) -> list[list[str]]:
    """Return the rows of drawn bubbles: figure, what it must be, and what was measured."""
    figures = edge_figures(flown)
    ratios = [density_figures(world, result) for world, result in flown]
    z = math.sqrt(np.mean([r.z_rms**2 for r in ratios if math.isfinite(r.z_rms)]))
    largest, impossible = max(r.largest_z for r in ratios), sum(r.impossible for r in ratios)
    low, high = figures.strong_interval
    times, widths = figures.time_z_interval, figures.width_z_interval
    separations = figures.separation_z_interval
    return [
        [
            "walls over 5 sigma",
            "90 % told, none false",
            f"{figures.strong_walls} of {figures.walls} walls; {figures.strong_told} of "
            f"{figures.strong_walls} told ({low:.2f} to {high:.2f}), "
            f"{figures.told - figures.strong_told} others, {figures.false} false",
        ],
        [
            "time of a wall over its sigma, RMS",
            "0.8 to 1.3",
            f"{figures.time_z:.2f} ({times[0]:.2f} to {times[1]:.2f})",
        ],
        [
            "widths over 1 km within 30 %",
            "30 %",
            f"{figures.widths_good} of {figures.widths}; over its sigma "
            f"{figures.width_z:.2f} ({widths[0]:.2f} to {widths[1]:.2f})",
        ],
        [
            "separation of two walls over its sigma, RMS",
            "0.8 to 1.3",
            f"{figures.separation_z:.2f} ({separations[0]:.2f} to {separations[1]:.2f})",
        ],
        [
            "separation of two walls, error",
            "2 %, or the bound",
            f"{100.0 * figures.separation_error:.1f} % RMS of {figures.separations} bubbles, bound "
            f"{100.0 * figures.separation_bound:.1f} %",
        ],
        [
            "density over its sigma, RMS; largest; seconds below zero by 3 sigma",
            "0.7 to 1.3; 8; none",
            f"{z:.2f}; {largest:.1f}; {impossible}",
        ],
    ]


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    rows = ("bubbles", "close", "quiet")
    parser.add_argument("row", nargs="?", choices=rows, default="bubbles", help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=101, help="first seed (%(default)s)")
    parser.add_argument("--count", type=int, default=5, help="flights (%(default)s)")
    parser.add_argument("--seconds", type=int, default=3600, help="of quiet ones (%(default)s)")
    parser.add_argument("--separation", type=float, default=500.0, help="of close, m (%(default)g)")
    parser.add_argument("--cache", type=pathlib.Path, help="folder in which flights are kept")
    add_write_option(parser, "plasma, of bubbles")
    options = parser.parse_args()
    if options.write and options.row != "bubbles":
        parser.error("--write: rows of bubbles alone are kept")
    seeds = range(options.seed, options.seed + options.count)
    if options.row == "quiet":
        worlds = quiet_worlds(options.seed, options.count, options.seconds)
        report_quiet(fly(worlds, options.cache))
    else:
        separation = options.separation if options.row == "close" else None
        flown = fly([draw_bubble_world(s, separation) for s in seeds], options.cache)
        report_bubbles(flown)
        if options.write:
            write_rows("plasma", COLUMNS, bubble_rows(flown), f"{seeds[0]} to {seeds[-1]}")


if __name__ == "__main__":
    main()

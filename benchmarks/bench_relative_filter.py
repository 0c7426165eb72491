"""Time of one epoch of the carrier-phase filter: 12 satellites, L1 and L2, in orbit.

Run with the workspace environment: ``python benchmarks/bench_relative_filter.py [epochs]``. The
observations are those of the 250 m scenario in the shared data (``VTFF_SHARED``). The smallest time
tells what the filter costs; the median also what else the machine was doing.
"""

from __future__ import annotations

import argparse
import os
import pathlib
import time

import numpy as np

from vtff_dynamics.orbit.force_model import ForceModel
from vtff_gnss.rinex.navigation import read_rinex_navigation
from vtff_gnss.rinex.observation import read_rinex_observation
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.estimator import CdgpsEstimator

REPOSITORY = pathlib.Path(__file__).resolve().parents[1]
SHARED = pathlib.Path(os.environ.get("VTFF_SHARED", REPOSITORY.parent / "shared"))
DATA = SHARED / "data/navigation"
WARM_UP = 30


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("epochs", type=int, nargs="?", default=300, help="(%(default)s)")
    count = parser.parse_args().epochs
    if count <= WARM_UP:
        parser.error(f"epochs: more than {WARM_UP} expected, got {count}")
    if not DATA.exists():
        print(f"{DATA} is absent: nothing measured")
        return
    receivers = [
        list(read_rinex_observation(DATA / f"leo_250m/250m_{name}.obs.gz").epochs())[:count]
        for name in "AB"
    ]
    ephemerides = read_rinex_navigation(DATA / "spirent_dynamic/RINEX_GN_Spirent.23N").ephemerides
    print(" forces      smallest  median  ms per epoch")
    for label, model in (("J2", ForceModel(degree=2, order=0)), ("20 x 20", ForceModel(degree=20))):
        estimator = CdgpsEstimator(CdgpsConfiguration(force_model=model), ephemerides)
        times = []
        for chief, deputy in zip(*receivers, strict=True):
            begin = time.perf_counter()
            estimator.process(chief.time, chief, deputy)
            times.append(time.perf_counter() - begin)
        milliseconds = 1e3 * np.array(times[WARM_UP:])
        print(f" {label:<10} {milliseconds.min():9.2f} {np.median(milliseconds):7.2f}")


if __name__ == "__main__":
    main()

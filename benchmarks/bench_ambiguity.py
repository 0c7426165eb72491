"""Time of the integer search, alone and with validation, for models of two receivers in LEO.

Run with the workspace environment: ``python benchmarks/bench_ambiguity.py [repetitions]``. The
models are those of n + 1 satellites and signals after ten epochs: three weak directions, the
position, and 1 mm / 0.3 m of noise. Compilation is timed on its own, without and with the cache.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from vtff_nav.relative.integers.least_squares import search
from vtff_nav.relative.integers.validation import partial_fix

PHASE_SIGMA = 1e-3
CODE_SIGMA = 0.3
EPOCHS = 10
WAVELENGTHS = (0.1902936728, 0.2442102134)


def double_difference_covariance(n: int, generator: np.random.Generator) -> np.ndarray:
    """Return the covariance of n ambiguities, cycles^2; from 12 on half of them are L2."""
    signals = 1 if n < 12 else 2
    satellites = n // signals + 1
    azimuth = generator.uniform(0.0, 2.0 * np.pi, satellites)
    elevation = np.arcsin(generator.uniform(0.09, 1.0, satellites))
    direction = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    difference = np.hstack([-np.ones((satellites - 1, 1)), np.eye(satellites - 1)])
    scatter = 2.0 * difference @ difference.T
    design = difference @ direction.T
    position = np.linalg.inv(design.T @ np.linalg.solve(scatter, design)) * CODE_SIGMA**2 / signals
    blocks = [
        [design @ position @ design.T / (a * b) for b in WAVELENGTHS[:signals]]
        for a in WAVELENGTHS[:signals]
    ]
    for index, wavelength in enumerate(WAVELENGTHS[:signals]):
        blocks[index][index] = blocks[index][index] + scatter * (PHASE_SIGMA / wavelength) ** 2
    return np.block(blocks) / EPOCHS


def median(function, repetitions: int) -> float:  # type: ignore[no-untyped-def]
    """Return the median time of a call, s."""
    times = []
    for _ in range(repetitions):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def seconds_of_new_process(cache: str) -> tuple[float, float]:
    """Return the times of import and of the first search in a new process, s."""
    code = (
        "import time; begin = time.perf_counter()\n"
        "from vtff_nav.relative.integers.least_squares import search\n"
        "imported = time.perf_counter()\n"
        "search([0.3, 0.4], [[1.0, 0.9], [0.9, 1.0]])\n"
        "print(imported - begin, time.perf_counter() - imported)"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    first, second = done.stdout.split()
    return float(first), float(second)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "repetitions", type=int, nargs="?", default=300, help="searches (%(default)s)"
    )
    repetitions = parser.parse_args().repetitions
    with tempfile.TemporaryDirectory() as cache:
        for label in ("without cache", "with cache"):
            imported, compiled = seconds_of_new_process(cache)
            print(
                f"new process {label:<14} import {imported:5.2f} s, first search {compiled:5.2f} s"
            )
    search([0.3, 0.4], [[1.0, 0.9], [0.9, 1.0]])  # compiles
    print(" n  search, two candidates in us  with validation  nodes  success rate")
    for n in (6, 12, 20, 40, 60):
        generator = np.random.default_rng(n)
        covariance = double_difference_covariance(n, generator)
        truth = generator.integers(-5_000_000, 5_000_000, n)
        ambiguities = truth + np.linalg.cholesky(covariance) @ generator.normal(size=n)
        solution = search(ambiguities, covariance)
        alone = median(lambda a=ambiguities, q=covariance: search(a, q), repetitions)
        tested = median(lambda a=ambiguities, q=covariance: partial_fix(a, q), repetitions)
        print(
            f"{n:2d} {1e6 * alone:29.1f} {1e6 * tested:16.1f} {solution.nodes:6d}"
            f" {solution.success_rate:13.6f}"
        )


if __name__ == "__main__":
    main()

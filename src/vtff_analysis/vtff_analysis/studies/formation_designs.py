"""Formations without thrust: the relative-motion model and passive safety, against J2 truth.

The truth is the nonlinear motion of every spacecraft under the point mass and J2. Two questions:
how well mean relative elements predict it over days, and how near the spacecraft of paper 002
(Scala and others, FFLAS mission extension) come to each other when nobody controls them.
"""

from __future__ import annotations

import csv
import itertools
import math
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.relative.designs import (
    cartwheel,
    general_circular,
    helix,
    leader_follower,
    projected_circular_radial_normal,
    projected_circular_track_normal,
)
from vtff_dynamics.relative.relative_elements import elements_of_deputy
from vtff_dynamics.relative.separation import SafetyFigures, safety_figures
from vtff_dynamics.relative.transition import propagate_relative_state
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "FFLAS_PHASES",
    "FreePair",
    "ModelError",
    "describe_designs",
    "fflas_formations",
    "fly_formation",
    "model_error",
    "model_errors",
    "write_formation_designs",
]

ORBITS = 15
_STEP = 10.0  # s
FFLAS_AXIS = 7153100.0  # m, table 4 of the paper
FFLAS_RADIAL = 7.5  # m
FFLAS_PHASES = {"A": 1.5 * math.pi, "B": math.pi / 6.0, "C": 5.0 * math.pi / 6.0}
"""Phases alpha of table 4, rad."""


@dataclass(frozen=True)
class ModelError:
    """Largest error of the model over `ORBITS` orbits."""

    design: str
    size: float
    eccentricity: float
    error: float

    @property
    def percent(self) -> float:
        """Error in per cent of the size of the formation."""
        return 100.0 * self.error / self.size


@dataclass(frozen=True)
class FreePair:
    """Two spacecraft of a formation over `ORBITS` orbits without thrust, lengths in m.

    Attributes
    ----------
    formation, first, second
        Names.
    closest, farthest
        Distance.
    closest_radial_normal
        Smallest distance in the R-N plane of the reference orbit.
    designed
        What the relative elements promise for one orbit without perturbations.
    """

    formation: str
    first: str
    second: str
    closest: float
    farthest: float
    closest_radial_normal: float
    designed: SafetyFigures


def describe_designs(errors: Sequence[ModelError], pairs: Sequence[FreePair]) -> str:
    """Return in plain words how well designs are predicted, and which formation is safe."""
    worst = max(row.percent for row in errors)
    literal = min(
        (pair for pair in pairs if pair.formation == "pco_literal"), key=lambda pair: pair.closest
    )
    apart = min(pair.closest_radial_normal for pair in pairs if pair.formation == "helix")
    return (
        f"Over {ORBITS} orbits without thrust mean relative elements predict every design to "
        f"{worst:.2f} % of its size. Equation (7) of the paper, taken literally, brings "
        f"{literal.first} and {literal.second} within {literal.closest:.2f} m of each other; in a "
        f"helix of the same size all stay {apart:.1f} m apart in the R-N plane alone, so that no "
        "error along the track brings two together."
    )


def model_errors() -> list[ModelError]:
    """Return the errors of all designs at 250 m and 5 km, eccentricity 0 and 0.01."""
    return [
        error
        for eccentricity in (0.0, 0.01)
        for size in (250.0, 5000.0)
        for error in model_error(size, eccentricity)
    ]


def model_error(size: float, eccentricity: float, orbits: int = ORBITS) -> list[ModelError]:
    """Return the error of the prediction by mean relative elements, for every design.

    Parameters
    ----------
    size
        Largest distance of the formation from its chief, m.
    eccentricity
        Mean eccentricity of a chief at 7000 km, 60 deg inclination (paper 004).
    orbits
        Length of the prediction.
    """
    chief = np.array(
        [
            7.0e6,
            0.5,
            eccentricity * math.cos(0.3),
            eccentricity * math.sin(0.3),
            math.radians(60.0),
            1.0,
        ]
    )
    designs = {
        "leader_follower": leader_follower(size),
        "projected_circular_track_normal": projected_circular_track_normal(size, 0.3),
        "projected_circular_radial_normal": projected_circular_radial_normal(0.5 * size, 0.3),
        "general_circular": general_circular(size, 0.3),
        "cartwheel": cartwheel(0.5 * size, 0.3),
        "helix": helix(0.5 * size, size, 0.3),
    }
    period = 2.0 * math.pi * math.sqrt(chief[0] ** 3 / GM_EARTH)
    times = np.arange(0.0, orbits * period, _STEP)
    elements = [chief, *(elements_of_deputy(chief, relative) for relative in designs.values())]
    flown = free_flight([state_from_elements(osculating_elements(e)) for e in elements], times)
    errors = []
    for index, (name, relative) in enumerate(designs.items(), start=1):
        largest = 0.0
        for moment in range(0, len(times), 23):
            true = relative_state_rtn(flown[moment, 0], flown[moment, index])
            model = propagate_relative_state(chief, relative, float(times[moment]))
            largest = max(largest, float(np.linalg.norm(model[:3] - true[:3])))
        errors.append(ModelError(name, size, eccentricity, largest))
    return errors


def fflas_formations() -> dict[str, dict[str, FloatArray]]:
    """Return the formations of paper 002, relative elements of each satellite in m.

    ``pco`` is the projected circular orbit of table 4 without the in-track offset of eq. (7);
    ``pco_literal`` has it (delta lambda = 2 rho_x cos alpha), which puts B and C on a collision
    course; ``helix`` has the same amplitudes with parallel e and i vectors.
    """
    double = 2.0 * FFLAS_RADIAL
    phases = {name: -(alpha + 0.5 * math.pi) for name, alpha in FFLAS_PHASES.items()}
    return {
        "pco": {
            name: projected_circular_track_normal(double, phase) for name, phase in phases.items()
        },
        "pco_literal": {
            name: projected_circular_track_normal(
                double, phase, double * math.cos(FFLAS_PHASES[name])
            )
            for name, phase in phases.items()
        },
        "helix": {name: helix(FFLAS_RADIAL, double, phase) for name, phase in phases.items()},
    }


def fly_formation(
    formation: str,
    relative: Mapping[str, FloatArray],
    elements: str = "osculating",
    orbits: int = ORBITS,
) -> list[FreePair]:
    """Let a formation drift about the reference orbit of paper 002, and return its pairs.

    Parameters
    ----------
    formation
        Name, for the result.
    relative
        Relative elements of each satellite to the reference orbit, m.
    elements
        ``osculating``: the formation is set up in osculating elements, as the paper does; ``mean``
        in mean ones, which closes it under J2.
    orbits
        Length of the flight.
    """
    chief = np.array([FFLAS_AXIS, 0.0, 0.0, 0.0, math.radians(98.51), math.radians(270.0)])
    craft = [chief, *(elements_of_deputy(chief, values) for values in relative.values())]
    if elements == "mean":
        craft = [osculating_elements(values) for values in craft]
    elif elements != "osculating":
        raise ValueError(f"elements: osculating or mean expected, got {elements!r}")
    period = 2.0 * math.pi * math.sqrt(FFLAS_AXIS**3 / GM_EARTH)
    times = np.arange(0.0, orbits * period, _STEP)
    flown = free_flight([state_from_elements(values) for values in craft], times)
    rotations = np.array([rotation_gcrf_to_rtn(state) for state in flown[:, 0]])
    names = list(relative)
    pairs = []
    for first, second in itertools.combinations(range(len(names)), 2):
        difference = flown[:, second + 1, :3] - flown[:, first + 1, :3]
        rtn = np.einsum("nij,nj->ni", rotations, difference)
        distance = np.linalg.norm(rtn, axis=1)
        pairs.append(
            FreePair(
                formation,
                names[first],
                names[second],
                float(distance.min()),
                float(distance.max()),
                float(np.hypot(rtn[:, 0], rtn[:, 2]).min()),
                safety_figures(relative[names[second]], relative[names[first]]),
            )
        )
    return pairs


def write_formation_designs(
    folder: pathlib.Path, errors: Sequence[ModelError], pairs: Sequence[tuple[str, FreePair]]
) -> list[pathlib.Path]:
    """Write the two tables of the study as CSV, and return their paths.

    Parameters
    ----------
    folder
        Existing folder.
    errors
        Rows that `model_errors` returns.
    pairs
        Kind of elements and pair, of `fly_formation`.
    """
    tables = {
        "model_errors.csv": (
            ["design", "size_m", "eccentricity", "error_m", "error_percent"],
            [[e.design, e.size, e.eccentricity, e.error, e.percent] for e in errors],
        ),
        "free_pairs.csv": (
            ["formation", "elements", "first", "second", "closest_m", "farthest_m", "closest_rn_m"],
            [
                [
                    *(pair.formation, elements, pair.first, pair.second),
                    *(pair.closest, pair.farthest, pair.closest_radial_normal),
                ]
                for elements, pair in pairs
            ],
        ),
    }
    paths = []
    for name, (header, rows) in tables.items():
        path = folder / name
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(rows)
        paths.append(path)
    return paths

"""The ionosphere chain over a recorded flight, and its errors against the truth."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.signals import SignalKey
from vtff_iono.edges.boundary import Boundary, BoundarySource
from vtff_iono.formation_ionosphere import FormationIonosphere
from vtff_iono.links.signal_pairs import Link
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.navigation_choice import NavigationChoice
from vtff_nav.relative.common.solution import AMBIGUITY_FLOAT, SOLUTION_NONE, RelativeSolution
from vtff_sim_bridge.atmosphere.slant_tec import SlantTecIntegrator

from .recording import RecordedSecond, Recording
from .worlds import PlasmaWorld

__all__ = ["ChainResult", "run_chain"]

# Columns of `ChainResult.density`.
TIME, ALTITUDE, DENSITY, SIGMA, TRUE, COLUMN_LENGTH = range(6)


@dataclass(frozen=True, eq=False)
class ChainResult:
    """What the chain makes of a flight.

    Parameters
    ----------
    density : ndarray, shape (n, 6)
        Seconds with a density: time into the flight, s, altitude, m, density, sigma and true mean
        density between the spacecraft, 1/m3, and their true vertical separation, m.
    absolute : ndarray, shape (m, 5)
        Good absolute slant contents of the last epochs of seconds: time into the flight, s,
        spacecraft, error and sigma, TECU, and age of the arc, s.
    edges : list of Boundary
        Vertical edges.
    column_errors : dict of int to ndarray, shape (n, 3)
        By PRN: time into the flight, s, error of the differential slant content with all integers
        known, TECU, and path of the ray through a layer over its height.
    altitudes : ndarray, shape (k, 3)
        Time into the flight, s, and true altitudes of chief and deputy, m.
    processor_time : float
        Processor time of the chain, s for each second of the flight.
    """

    density: FloatArray
    absolute: FloatArray
    edges: list[Boundary]
    column_errors: dict[int, FloatArray]
    altitudes: FloatArray
    processor_time: float
    start: int


def _integers(solution: RelativeSolution) -> dict[SignalKey, float]:
    table = solution.ambiguities
    names = ("system", "prn", "band", "attribute", "ambiguity_cycles", "state")
    rows = zip(*(getattr(table, name).tolist() for name in names), strict=True)
    return {
        SignalKey(system, prn, band, attribute): cycles
        for system, prn, band, attribute, cycles, state in rows
        if state != AMBIGUITY_FLOAT
    }


def _second(recorded: RecordedSecond, choice: NavigationChoice) -> FormationSecond:
    """Return a second as the node would put it together."""
    solution, pair = recorded.solution, None
    if solution.solution != SOLUTION_NONE:
        chief = np.concatenate((solution.position_chief_gcrf, solution.velocity_chief_gcrf))
        deputy = deputy_state_gcrf(
            chief, np.concatenate((solution.position_rtn, solution.velocity_rtn))
        )
        pair = (
            state_gcrf_to_itrf(recorded.time, chief),
            state_gcrf_to_itrf(recorded.time, deputy),
        )
    time_nanoseconds = recorded.time.nanoseconds
    states, (is_trusted,) = choice.choose(time_nanoseconds, [pair], recorded.fixes_itrf)
    integers = _integers(solution) if is_trusted else {}
    is_known = is_trusted and pair is not None
    sigma = math.sqrt(np.trace(solution.covariance_rtn[:3, :3])) if is_known else math.inf
    return FormationSecond(time_nanoseconds, recorded.observations, states, (integers,), (sigma,))


def run_chain(recording: Recording, world: PlasmaWorld) -> ChainResult:
    """Run the ionosphere chain over a flight."""
    formation, choice = FormationIonosphere(), NavigationChoice()
    profile = world.gnss().profile
    assert profile is not None
    integrator = SlantTecIntegrator(profile)
    times = np.array([second.time.nanoseconds for second in recording])
    start = int(times[0])
    elapsed = (times - start) * 1e-9
    altitudes = np.array([integrator.altitude(second.position_itrf) for second in recording])
    densities, contents, edges = [], [], []
    errors: dict[int, list[tuple[float, float, float]]] = {}
    begun: dict[tuple[int, Link, int], float] = {}
    spent = 0.0
    for at, recorded in zip(elapsed.tolist(), recording, strict=True):
        for prn, of_satellite in recorded.column_errors.items():
            errors.setdefault(prn, []).append((at, *of_satellite))
        second = _second(recorded, choice)
        began = time.process_time()
        for ephemeris in recorded.ephemerides:
            formation.add_ephemeris(ephemeris)
        result = formation.process(second)
        spent += time.process_time() - began
        for density in result.density[0]:
            if not np.isfinite(density.epoch.density):
                continue
            at = (density.time - start) * 1e-9
            low, high = sorted(np.interp(at, elapsed, column) for column in altitudes.T)
            densities.append(
                (
                    at,
                    density.epoch.altitude,
                    density.epoch.density,
                    density.epoch.sigma,
                    float(profile.mean_density(low, high)),
                    high - low,
                )
            )
        for craft, of_craft in enumerate(result.spacecraft):
            if of_craft.epoch is None:
                continue
            epoch, truth = of_craft.epoch, recorded.stec_tecu[craft]
            at = (epoch.time - start) * 1e-9
            for row, link in enumerate(epoch.links):
                age = at - begun.setdefault((craft, link, int(epoch.arc[row])), at)
                if epoch.rejected[row] == 0 and link.system == SYSTEM_GPS and link.prn in truth:
                    error = float(epoch.stec_tecu[row]) - truth[link.prn]
                    contents.append((at, craft, error, float(epoch.stec_sigma_tecu[row]), age))
        edges += [b for b in result.boundaries[0] if b.source == BoundarySource.DENSITY]
    return ChainResult(
        np.array(densities).reshape(-1, 6),
        np.array(contents).reshape(-1, 5),
        edges,
        {prn: np.array(rows) for prn, rows in errors.items()},
        np.column_stack((elapsed, altitudes)),
        spent / len(recording),
        start,
    )

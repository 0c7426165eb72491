"""Reconfiguration of paper 002: velocity changes, closest approach, time to solve.

Every plan is solved with the problem compiled, without and with an earlier plan, and flown again in
the nonlinear motion under J2. Times are wall times beside the processor time of the process; on a
busy machine only the second counts.

    python benchmarks/bench_guidance.py
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from vtff_analysis.fflas.reconfiguration import (
    FFLAS_PERIOD,
    ORBITS,
    fly_reconfiguration,
    formation_states,
    reconfiguration_planner,
    triangle_states,
)

CASES = (
    ("norms", "RTN", 0.0),
    ("axes", "RTN", 0.0),
    ("axes", "TN", 0.0),
    ("energy", "RTN", 0.0),
    ("norms", "RTN", 1.0),
)


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    initial = triangle_states()
    print("velocity changes of A, B, C and total in cm/s: norms | sums over axes")
    for formation in ("pco", "helix"):
        final = formation_states(formation, ORBITS * FFLAS_PERIOD)
        for objective, axes, drift_orbits in CASES:
            planner = reconfiguration_planner(objective, axes, drift_orbits)
            planner.plan(initial, final)  # compiles
            begin = time.process_time()
            plan = planner.plan(initial, final)
            processor = time.process_time() - begin
            begin = time.process_time()
            warm = planner.plan(initial, final, plan)
            processor_warm = time.process_time() - begin
            flown = fly_reconfiguration(plan, final)
            safety = f", passive safety for {drift_orbits:g} orbit" if drift_orbits else ""
            print(f"triangle -> {formation}, least {objective} on {axes}{safety}")
            norms, sums = 100.0 * plan.velocity_changes, 100.0 * plan.velocity_changes_axes.sum(1)
            print(
                "  "
                + " ".join(f"{value:.2f}" for value in (*norms, norms.sum()))
                + " | "
                + " ".join(f"{value:.2f}" for value in (*sums, sums.sum()))
            )
            print(
                f"  closest {plan.closest_approach:.3f} m planned, {flown.closest_approach:.3f} m "
                f"flown; arrival within {1e3 * flown.arrival_error:.1f} mm; thrust lost: "
                f"{flown.closest_drifts.min():.2f} m at the worst step"
            )
            if plan.safe_step is not None:
                later = flown.closest_drifts[plan.safe_step :].min()
                print(f"  at the start of steps from {plan.safe_step} on {later:.2f} m")
                during = plan.closest_drifts_during[plan.safe_step :]
                wanted = planner.limits.closest_approach
                unsafe = ", ".join(
                    f"{plan.safe_step + step} ({during[step]:.2f} m)"
                    for step in np.flatnonzero(during < wanted - 1e-2)
                )
                print(f"  lost during one of {len(during)} steps, unsafe: {unsafe or 'none'}")
            print(
                f"  {plan.passes} passes, {plan.solve_time:.2f} s wall, {processor:.2f} s "
                f"processor; from that plan {warm.passes}, {warm.solve_time:.2f} s, "
                f"{processor_warm:.2f} s"
            )


if __name__ == "__main__":
    main()

"""Verdict on a cluster, by the bounds that its guidance must keep."""

from __future__ import annotations

from vtff_analysis.report.verdict.figure import Figure, Summary

__all__ = ["cluster_figures", "missed_bounds"]

#: Figures of a cluster: end of the key, label, unit, decimals, limit that its guidance must keep.
_CLUSTER = (
    ("equilibrium_m", "side of the equilibrium", "m", 1, None),
    ("settling_time_s", "settled within 2.5 %", "s", 0, None),
    ("settling_delta_v_m_per_s", "velocity change to settle, largest", "m/s", 1, 40.0),
    ("side_mean_error_percent", "last orbit: largest error of a mean side", "%", 2, 1.0),
    ("side_largest_error_percent", "last orbit: largest error of a side", "%", 2, 2.5),
    ("last_orbit_delta_v_m_per_s", "last orbit: velocity change, largest", "m/s", 1, 18.0),
    ("closest_m", "closest of any two", "m", 0, 500.0),
)


def missed_bounds(summary: Summary) -> list[str]:
    """Return which bounds of a cluster its flight does not keep."""
    missed = [
        f"{label} {summary[f'cluster_{key}']:.{decimals}f} {unit} for {limit:g} {unit}"
        for key, label, unit, decimals, limit in _CLUSTER
        if limit is not None and _misses(key, summary.get(f"cluster_{key}"), limit)
    ]
    return [f"A bound is missed: {'; '.join(missed)}."] if missed else []


def _misses(key: str, value: float | None, limit: float) -> bool:
    if value is None:
        return False
    return value < limit if key == "closest_m" else value > limit


def cluster_figures(summary: Summary) -> list[Figure]:
    """Return the figures of a cluster beside the paper, which prints a triangle without numbers."""
    figures = []
    for key, label, unit, decimals, limit in _CLUSTER:
        value = summary.get(f"cluster_{key}")
        if value is not None:
            bound = "" if limit is None else f"{limit:g} {unit}"
            figures.append(Figure(label, f"{value:.{decimals}f} {unit}", "", bound))
    return figures

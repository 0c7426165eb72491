"""The groups of plug-ins that vtff has (docs/plugins.md)."""

from __future__ import annotations

from vtff_node.plugins.loading import PluginGroup

__all__ = ["CONTROLLERS", "ESTIMATORS", "GUIDANCES"]

#: `vtff_control.tracking.controller.Controller`, of the node `sdre_controller`.
CONTROLLERS = PluginGroup("vtff.controllers", "design", ("control", "reset"))
#: `vtff_nav.relative.common.solution.RelativeEstimator`, of the node `relative_ekf`.
ESTIMATORS = PluginGroup(
    "vtff.estimators", "estimator", ("add_ephemeris", "add_thrust", "process", "reset")
)
#: `vtff_control.guidance.interface.Guidance`, of the node `formation_guidance`.
GUIDANCES = PluginGroup("vtff.guidances", "guidance", ("step", "reset"))

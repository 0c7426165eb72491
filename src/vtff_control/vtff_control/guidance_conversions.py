"""Messages of a formation and its guidance as the values that algorithms take."""

from __future__ import annotations

import numpy as np

from vtff_control.guidance.interface import FormationState
from vtff_dynamics.vectors import FloatArray
from vtff_msgs.msg import FormationGuidance, RelativeState
from vtff_node.epoch_join import JoinedEpoch

__all__ = ["MODE_NAMES", "MODE_NUMBERS", "formation_state"]

MODE_NUMBERS = {
    "hold": FormationGuidance.MODE_HOLD,
    "keep": FormationGuidance.MODE_KEEP,
    "reconfigure": FormationGuidance.MODE_RECONFIGURE,
    "phase": FormationGuidance.MODE_PHASE,
    "free_drift": FormationGuidance.MODE_FREE_DRIFT,
    "abort": FormationGuidance.MODE_ABORT,
}
"""Number in FormationGuidance of each mode of `vtff_control.guidance.requests.MODES`."""

MODE_NAMES = {number: name for name, number in MODE_NUMBERS.items()} | {
    FormationGuidance.MODE_PLUGIN: "plugin"
}


def formation_state(
    epoch: JoinedEpoch, deputies: tuple[str, ...]
) -> tuple[FormationState | None, str]:
    """Return the state of a formation at an epoch, or why there is none.

    Parameters
    ----------
    epoch
        RelativeState of each deputy under its name.
    deputies
        Names. The chief's state is taken from the first deputy's message.

    Returns
    -------
    FormationState or None, str
        State, and an empty text; or None and the reason.
    """
    relative: dict[str, FloatArray] = {}
    covariances: dict[str, FloatArray] = {}
    chief = np.full(6, np.nan)
    for name in deputies:
        message = epoch.measured.get(name)
        if message is None:
            return None, f"no state of {name}"
        if message.solution == RelativeState.SOLUTION_NONE:
            return None, f"navigation of {name} has no solution"
        relative[name] = np.concatenate((message.position, message.velocity))
        if message.solution != RelativeState.SOLUTION_TRUTH:
            covariances[name] = np.array(message.covariance).reshape(6, 6)
        if name == deputies[0]:
            chief = np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf))
    arrays = (chief, *relative.values(), *covariances.values())
    if not all(np.isfinite(values).all() for values in arrays):
        return None, "a state is not finite"
    return FormationState(epoch.stamp_nanoseconds, chief, relative, covariances), ""

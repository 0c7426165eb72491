"""The interface of a formation controller, which a plug-in of ``vtff.controllers`` implements.

The controller gets one relative state per sample and answers with one acceleration. The node
`sdre_controller` and the closed loop without ROS (`vtff_analysis.closed_loop.simulation`) use it.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray, is_finite

__all__ = [
    "ControlResult",
    "Controller",
    "ControllerSetting",
    "check_control_result",
    "takes_covariance",
]


@dataclass(frozen=True)
class ControlResult:
    """Outcome of one control step.

    Attributes
    ----------
    acceleration_rtn
        Commanded acceleration in the chief's RTN axes in m/s2, shape (3,); zero if not valid.
    saturated
        True if the cap limited an axis.
    valid
        False if no command could be computed.
    reason
        Why the result is not valid, one line; empty if it is.
    degraded
        Why a valid command does not track the target, one line; empty if it does.
    """

    acceleration_rtn: FloatArray
    saturated: bool
    valid: bool
    reason: str = ""
    degraded: str = ""


@dataclass(frozen=True)
class ControllerSetting:
    """Parameters that `sdre_controller` gives a controller, which uses those that it needs.

    Attributes
    ----------
    sample_time
        Interval between states in s, for which a command is held.
    delay_steps
        Whole sample intervals between a state and the start of its thrust.
    acceleration_cap
        Largest magnitude of the command in m/s2, for all axes or for each of R, T, N.
    feedforward, feedforward_gravity, position_weight, velocity_weight, control_weight
        As in `vtff_control.tracking.sdre.SdreDesign`; a weight of None is the controller's own.
    tolerated_deviation, braking_share, quantum, maximum_sigma, maximum_sigma_ratio
        As in `vtff_control.tracking.sdre.SdreDesign`; None is the controller's own.
    """

    sample_time: float = 1.0
    delay_steps: int = 1
    acceleration_cap: float | Sequence[float] = 1.0
    feedforward: bool = False
    feedforward_gravity: str = "j2"
    position_weight: float | None = None
    velocity_weight: float | None = None
    control_weight: float | None = None
    tolerated_deviation: float | None = None
    braking_share: float | None = None
    quantum: float | None = None
    maximum_sigma: float = 100.0
    maximum_sigma_ratio: float = 0.25


class Controller(Protocol):
    """Methods of a formation controller.

    A plug-in is a class made as ``Class(setting)`` with a `ControllerSetting`, or, where it has an
    attribute ``Parameters`` (a frozen dataclass), as ``Class(setting, parameters)``.
    """

    def reset(self) -> None:
        """Forget what was commanded: a state was refused, or time has jumped."""

    def control(
        self,
        relative_state_rtn: npt.ArrayLike,
        state_chief_gcrf: npt.ArrayLike,
        target_rtn: npt.ArrayLike,
        stamp: int | None = None,
        covariance_rtn: npt.ArrayLike | None = None,
    ) -> ControlResult:
        """Compute the command for one state; called once per sample.

        Parameters
        ----------
        relative_state_rtn
            Position (m) and rotating-frame velocity (m/s) of the deputy in the chief's RTN frame,
            shape (6,).
        state_chief_gcrf
            Position (m) and velocity (m/s) of the chief in GCRF, shape (6,).
        target_rtn
            Wanted relative state in RTN, shape (6,).
        stamp
            Time of validity of the state in whole nanoseconds.
        covariance_rtn
            Covariance of the relative state (m2, m2/s, m2/s2), shape (6, 6); None for the truth. A
            state without measurements is a prediction: its covariance grows. The node gives this
            fifth argument only to a controller that takes it (`takes_covariance`); it lets any
            other act only while the bounds on sigma hold.
        """


def takes_covariance(controller: Controller) -> bool:
    """Return whether a controller takes the covariance as the fifth argument of ``control``."""
    try:
        inspect.signature(controller.control).bind(None, None, None, None, None)
    except (TypeError, ValueError):
        return False
    return True


def check_control_result(result: object) -> None:
    """Refuse the result of a controller that cannot be commanded.

    Raises
    ------
    ValueError
        If it is no ControlResult, or its acceleration has not three finite numbers.
    """
    if not isinstance(result, ControlResult):
        raise ValueError(f"a ControlResult is expected, got {type(result).__name__}")
    acceleration = np.asarray(result.acceleration_rtn)
    if acceleration.shape != (3,) or acceleration.dtype.kind not in "fiu":
        raise ValueError(
            "acceleration_rtn: three numbers (m/s2) expected, "
            f"got shape {acceleration.shape} of {acceleration.dtype}"
        )
    if not is_finite(acceleration):
        raise ValueError(f"acceleration_rtn: not finite, {acceleration.tolist()}")

"""The controllers that vtff ships, as plug-ins of ``vtff.controllers``; see `SdreDesign`.

The default weights of each design are `vtff_control.tracking.sdre.DEFAULT_WEIGHTS`.
"""

from __future__ import annotations

import dataclasses

from vtff_control.tracking.controller import ControllerSetting
from vtff_control.tracking.sdre import SdreController, SdreDesign

__all__ = [
    "DelayAwareController",
    "NavigationAwareController",
    "PaperController",
    "StateDependentController",
]


def _design(name: str, setting: ControllerSetting) -> SdreDesign:
    return SdreDesign(design=name, **dataclasses.asdict(setting))


class PaperController(SdreController):
    """Riccati gain on the coefficients of a circular chief orbit, as in the paper."""

    def __init__(self, setting: ControllerSetting) -> None:
        super().__init__(_design("paper", setting))


class StateDependentController(SdreController):
    """Riccati gain of the nonlinear matrix A(x), solved anew at every step."""

    def __init__(self, setting: ControllerSetting) -> None:
        super().__init__(_design("state_dependent", setting))


class DelayAwareController(SdreController):
    """Discrete Riccati gain with the commands that wait in the thruster as states."""

    def __init__(self, setting: ControllerSetting) -> None:
        super().__init__(_design("delay_aware", setting))


class NavigationAwareController(SdreController):
    """The gain of `DelayAwareController` with every option: what the shipped systems fly."""

    def __init__(self, setting: ControllerSetting) -> None:
        super().__init__(_design("navigation_aware", setting))

"""Angles."""

from __future__ import annotations

import math

__all__ = ["wrap_angle"]


def wrap_angle(angle: float) -> float:
    """Return an angle (rad) in [-pi, pi]."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi

"""Broadcast parameters of ionosphere models."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KlobucharParameters", "NeQuickParameters"]


@dataclass(frozen=True)
class KlobucharParameters:
    """Parameters of the GPS single-frequency model (IS-GPS-200, 20.3.3.5.1.7), as broadcast.

    Parameters
    ----------
    alpha : tuple of 4 float
        Amplitude of the vertical delay: s, s/semicircle, s/semicircle^2, s/semicircle^3.
    beta : tuple of 4 float
        Period of the model, likewise.
    """

    alpha: tuple[float, float, float, float]
    beta: tuple[float, float, float, float]


@dataclass(frozen=True)
class NeQuickParameters:
    """Effective ionisation level of the Galileo model (OS SIS ICD 5.1.6), as broadcast.

    Parameters
    ----------
    effective_ionisation : tuple of 3 float
        Solar flux units, per degree and per degree squared of modified dip latitude.
    """

    effective_ionisation: tuple[float, float, float]

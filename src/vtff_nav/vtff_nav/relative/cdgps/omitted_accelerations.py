"""Unmodelled accelerations that a force model leaves in a real orbit, before measurements tell."""

from __future__ import annotations

import math
from dataclasses import replace

from vtff_dynamics.orbit.omitted_forces import omitted_gravity, other_forces
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.common.dynamics import MotionNoise

__all__ = ["omitted_share", "relative_noise"]

# Kaula's rule is a mean over the globe. The RMS of the gradient that degrees 51 to 120 of EGM2008
# (Pavlis et al. 2012) make on an arc of 900 s at 550 km, over that of the rule: 0.93 in the median
# of 1500 drawn arcs, below 1.8 on 90 % and below 2.2 on 95 % of them; 3.9 over trenches.
_ROUGHNESS = 2.0


def omitted_share(configuration: CdgpsConfiguration, radius: float) -> float:
    """Return what the chief's force model leaves out in an orbit, over the stated sigma; at most 1.

    Parameters
    ----------
    configuration : CdgpsConfiguration
    radius : float
        Radius of the orbit, m.
    """
    forces, largest = configuration.force_model, configuration.noise_chief.empirical_sigma
    if not _is_of_real_orbit(configuration) or not largest > 0.0:
        return 1.0
    gravity = omitted_gravity(forces.degree, radius).acceleration_sigma
    return min(math.hypot(gravity, other_forces(radius)) / largest, 1.0)


def relative_noise(configuration: CdgpsConfiguration, radius: float) -> MotionNoise:
    """Return the noise of the difference where only gravity beyond the force model acts on it.

    That is no more than `CdgpsConfiguration.noise_relative`. Other forces have the sigma of that.

    Parameters
    ----------
    configuration : CdgpsConfiguration
    radius : float
        Radius of the orbit, m.
    """
    noise = configuration.noise_relative
    if not _is_of_real_orbit(configuration):
        return noise
    gravity = omitted_gravity(configuration.force_model.degree, radius)
    sigma = _ROUGHNESS * gravity.gradient_sigma
    if sigma >= noise.gradient_sigma:
        return noise
    return replace(noise, gradient_sigma=sigma, gradient_time=gravity.gradient_time)


def _is_of_real_orbit(configuration: CdgpsConfiguration) -> bool:
    """Return whether the force model has the gravity of the Earth.

    The accelerations that a motion in Euler steps leaves out cannot be foreseen.
    """
    is_harmonic = configuration.force_model.gravity == "spherical_harmonics"
    return is_harmonic and configuration.integrator != "euler"

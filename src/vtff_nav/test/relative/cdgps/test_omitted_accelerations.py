"""Accelerations that a force model leaves in a real orbit."""

import dataclasses

import pytest

from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.omitted_forces import omitted_gravity
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.omitted_accelerations import omitted_share, relative_noise
from vtff_nav.relative.common.dynamics import MotionNoise

RADIUS = 6.928e6


def configured(**changes):
    return dataclasses.replace(CdgpsConfiguration(), **changes)


def test_gravity_beyond_the_model_is_what_is_left_of_a_gradient():
    parameters = configured(force_model=ForceModel(degree=50, order=50))
    noise, gravity = relative_noise(parameters, RADIUS), omitted_gravity(50, RADIUS)
    assert noise.gradient_sigma == pytest.approx(2.0 * gravity.gradient_sigma)
    assert noise.gradient_time == gravity.gradient_time
    assert noise.empirical_sigma == parameters.noise_relative.empirical_sigma


@pytest.mark.parametrize(
    "changes",
    [
        {"force_model": ForceModel(degree=8, order=8)},
        {"force_model": ForceModel(gravity="two_body")},
        {"integrator": "euler", "longest_step": 1.0},
        {"noise_relative": MotionNoise(1e-9, gradient_sigma=1e-15)},
    ],
)
def test_the_noise_is_never_larger_than_stated(changes):
    parameters = configured(**changes)
    assert relative_noise(parameters, RADIUS) == parameters.noise_relative


def test_the_share_of_the_chief_falls_with_the_degree_to_that_of_other_forces():
    shares = [
        omitted_share(configured(force_model=ForceModel(degree=n, order=n)), RADIUS)
        for n in (2, 20, 50, 70)
    ]
    assert shares[0] == 1.0
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] == pytest.approx(1.8e-6 / 2e-5, rel=0.05)

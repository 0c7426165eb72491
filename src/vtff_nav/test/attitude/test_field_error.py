"""The error of the field model as a process: against potential fields along an orbit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from vtff_dynamics.attitude.magnetic_field import DrawnFieldError
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_nav.attitude.field_error import (
    FIELD_STATES,
    REPEATED_ORBIT,
    FieldErrorModel,
    track_rate,
)

RADIUS = 7.08e6
POSITION, VELOCITY = RADIUS * np.eye(3)[0], 7500.0 * np.eye(3)[2]
TURNS = np.radians([0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0])


def modelled(model: FieldErrorModel) -> np.ndarray:
    """Return the covariance of radial, along and across now with those of `TURNS` before."""
    along = VELOCITY - EARTH_ROTATION_RATE * np.array([0.0, RADIUS, 0.0])
    axes = rotation_gcrf_to_rtn(np.concatenate((POSITION, along)))
    partial = axes @ model.partial(POSITION, VELOCITY)
    return np.array(
        [partial @ model.transition(turn) @ model.covariance @ partial.T for turn in TURNS]
    )


def exact() -> np.ndarray:
    """Return the same of an isotropic potential field with equal mean squares of degrees 1 to 8.

    The covariance of V is a sum of Legendre polynomials; the others are its derivatives.
    """
    cosine, sine = np.cos(TURNS), np.sin(TURNS)
    total = np.zeros((len(TURNS), 3, 3))
    for degree in range(1, 9):
        potential = 3.0 / 8.0 / ((degree + 1) * (2 * degree + 1))
        polynomial = Legendre.basis(degree)
        first, second = polynomial.deriv()(cosine), polynomial.deriv(2)(cosine)
        total[:, 0, 0] += potential * (degree + 1) ** 2 * polynomial(cosine)
        total[:, 1, 1] += potential * (cosine * first - sine**2 * second)
        total[:, 2, 2] += potential * first
        total[:, 0, 1] -= potential * (degree + 1) * sine * first
        total[:, 1, 0] += potential * (degree + 1) * sine * first
    return total


def test_the_model_has_the_correlations_of_a_potential_field():
    """Sizes, the tie of radial and along, and no tie across; within a fifth of the variance."""
    model = modelled(FieldErrorModel(1.0)) / REPEATED_ORBIT
    np.testing.assert_allclose(model, exact(), atol=0.2 * model[0, 0, 0])
    assert np.trace(model[0]) == pytest.approx(3.0)


def test_the_variance_is_that_of_an_error_that_comes_again_after_an_orbit():
    """Radial component at a place and where the next orbit passes, 24.8 deg of longitude away."""
    inclination, shift = np.radians([98.1, 24.8])
    latitude = np.arcsin(np.sin(inclination) * np.sin(np.linspace(0.0, 2.0 * np.pi, 721)[1:]))
    apart = 2.0 * np.arcsin(np.cos(latitude) * np.sin(0.5 * shift))
    degrees = np.arange(1, 9)
    power = (degrees + 1.0) / (2.0 * degrees + 1.0)
    correlation = sum(
        weight * Legendre.basis(degree)(np.cos(apart)).mean()
        for degree, weight in zip(degrees, power / power.sum(), strict=True)
    )
    assert pytest.approx(1.0 + correlation, abs=0.01) == REPEATED_ORBIT


def test_a_drawn_error_of_the_truth_has_the_sign_of_the_model():
    """Radial now with along 15 deg before: the truth's own field, at drawn places."""
    generator, tie = np.random.default_rng(3), []
    for seed in range(20):
        error = DrawnFieldError(1.0, seed, RADIUS)
        for _ in range(12):
            first, second, normal = np.linalg.qr(generator.standard_normal((3, 3)))[0].T
            second = np.cross(normal, first)
            later = np.cos(TURNS[3]) * first + np.sin(TURNS[3]) * second
            tie.append(error.field_itrf(RADIUS * later) @ later)
            tie[-1] *= error.field_itrf(RADIUS * first) @ second
    model = modelled(FieldErrorModel(1.0))[3, 0, 1]
    assert np.mean(tie) < -0.3 and model < -0.3


def test_transition_is_that_of_many_small_steps():
    model = FieldErrorModel(3e-7)
    many = np.linalg.matrix_power(model.transition(0.005), 40)
    np.testing.assert_allclose(many, model.transition(0.2), atol=1e-9)
    noise = model.covariance - many @ model.covariance @ many.T
    assert np.linalg.eigvalsh(noise).min() > -1e-12 * noise.max()
    assert model.covariance.shape == (FIELD_STATES, FIELD_STATES)


def test_the_track_is_that_over_the_turning_earth():
    assert track_rate(POSITION, VELOCITY) == pytest.approx(
        np.hypot(7500.0, EARTH_ROTATION_RATE * RADIUS) / RADIUS
    )

"""The error of the field model as a process: against drawn potential fields along an orbit."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_dynamics.attitude.magnetic_field import DrawnFieldError
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_nav.attitude.field_error import FIELD_STATES, FieldErrorModel, track_rate

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


def drawn(count: int, sigma: float) -> np.ndarray:
    """Return the same of drawn fields on great circles."""
    generator = np.random.default_rng(3)
    total = np.zeros((len(TURNS), 3, 3))
    for seed in range(count):
        error = DrawnFieldError(sigma, seed, RADIUS)
        for _ in range(12):
            first, second, _ = np.linalg.qr(generator.standard_normal((3, 3)))[0]
            normal = np.cross(first, second)
            fields = []
            for turn in TURNS:
                radial = np.cos(turn) * first + np.sin(turn) * second
                axes = np.array([radial, np.cross(normal, radial), normal])
                fields.append(axes @ error.field_itrf(RADIUS * radial))
            total += np.einsum("ki,j->kij", np.array(fields), fields[0])
    return total / (12 * count)


def test_a_drawn_potential_field_has_the_correlations_of_the_model():
    """Sizes, the tie of radial and along, independence across; within a fifth of the variance."""
    model, truth = modelled(FieldErrorModel(1.0)), drawn(40, 1.0)
    np.testing.assert_allclose(model, truth, atol=0.2 * 1.7)
    # Radial less than along is not correlated where both are, but 15 deg apart it is: the sign.
    assert truth[3, 0, 1] < -0.4 and model[3, 0, 1] < -0.4
    assert np.trace(model[0]) == pytest.approx(3.0)


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

"""The harmonics of the error of the field model: against potential fields along an orbit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from vtff_dynamics.attitude.magnetic_field import DrawnFieldError
from vtff_dynamics.constants import EARTH_ROTATION_RATE
from vtff_nav.attitude.field_error import FIELD_STATES, FieldErrorModel

RADIUS = 7.08e6
TURNS = np.radians([0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0])


def drawn_axes(generator):
    """Return radial, along and across at a drawn place, the rows of a matrix."""
    first, second, _ = np.linalg.qr(generator.standard_normal((3, 3)))[0].T
    return np.array([first, second, np.cross(first, second)])


def turned(axes, angle):
    """Return these axes further along the track by an angle."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ axes


def exact():
    """Return covariances of radial, along, across now with those further along, by `TURNS`.

    The potential is isotropic, with equal mean squares of degrees 1 to 12: the covariance of V
    is a sum of Legendre polynomials, the others are its derivatives.
    """
    cosine, sine = np.cos(TURNS), np.sin(TURNS)
    total = np.zeros((len(TURNS), 3, 3))
    for degree in range(1, 13):
        potential = 3.0 / 12.0 / ((degree + 1) * (2 * degree + 1))
        polynomial = Legendre.basis(degree)
        first, second = polynomial.deriv()(cosine), polynomial.deriv(2)(cosine)
        total[:, 0, 0] += potential * (degree + 1) ** 2 * polynomial(cosine)
        total[:, 1, 1] += potential * (cosine * first - sine**2 * second)
        total[:, 2, 2] += potential * first
        total[:, 0, 1] += potential * (degree + 1) * sine * first
        total[:, 1, 0] -= potential * (degree + 1) * sine * first
    return total


@pytest.mark.parametrize("seed", range(4))
def test_the_model_has_the_correlations_of_a_potential_field(seed):
    """At drawn places and in drawn directions, in the axes of each place."""
    model = FieldErrorModel(1.0)
    axes = drawn_axes(np.random.default_rng(seed))
    here = axes @ model.partial(RADIUS * axes[0], 0.0)
    for angle, expected in zip(TURNS, exact(), strict=True):
        there = turned(axes, angle)
        found = here * model.variances @ (there @ model.partial(RADIUS * there[0], 0.0)).T
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert len(model.variances) == FIELD_STATES


def test_the_error_turns_with_the_earth_and_fades_with_height():
    model = FieldErrorModel(1.0)
    place = np.array([3e6, -4e6, 5e6])
    before = model.partial(place, 0.0)
    angle = EARTH_ROTATION_RATE * 5900.0
    turn = np.array(
        [
            [np.cos(angle), -np.sin(angle), 0.0],
            [np.sin(angle), np.cos(angle), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    np.testing.assert_allclose(model.partial(turn @ place, 5900.0), turn @ before, atol=1e-12)
    ratio = np.linalg.norm(model.partial(1.1 * place, 0.0), axis=0) / np.linalg.norm(before, axis=0)
    np.testing.assert_allclose(ratio[[0, -1]], [1.1**-3, 1.1**-14], rtol=1e-12)


@pytest.mark.parametrize("place", [(2e6, 3e6, 6e6), (0.0, 0.0, 7e6), (1.0, 0.0, -7e6)])
def test_each_harmonic_has_neither_curl_nor_divergence(place):
    """By central differences, also at the poles."""
    model, step = FieldErrorModel(1.0), 100.0
    scale = np.linalg.norm(model.partial(np.array(place), 0.0), axis=0).max() / np.linalg.norm(
        place
    )
    slopes = np.array(
        [
            model.partial(place + step * axis, 0.0) - model.partial(place - step * axis, 0.0)
            for axis in np.eye(3)
        ]
    ) / (2.0 * step)
    np.testing.assert_allclose(np.einsum("iic->c", slopes), 0.0, atol=1e-6 * scale)
    np.testing.assert_allclose(slopes, slopes.transpose(1, 0, 2), atol=1e-6 * scale)


def test_the_harmonics_explain_a_drawn_error_of_the_truth():
    """Fitted at places of a sphere, they give the field at others; degree 13 and up stay."""
    error = DrawnFieldError(1.0, 4, RADIUS)
    generator = np.random.default_rng(3)
    places = generator.standard_normal((300, 3))
    places *= RADIUS / np.linalg.norm(places, axis=1)[:, None]
    model = FieldErrorModel(1.0)
    partials = np.array([model.partial(place, 0.0) for place in places])
    fields = np.array([error.field_itrf(place) for place in places])
    design, values = partials[:200].reshape(-1, FIELD_STATES), fields[:200].ravel()
    coefficients = np.linalg.lstsq(design, values, rcond=None)[0]
    left = fields[200:] - partials[200:] @ coefficients
    assert np.sqrt(np.mean(left**2)) < 0.2 * np.sqrt(np.mean(fields[200:] ** 2))

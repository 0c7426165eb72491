"""The magnetic field against the published coefficients of IGRF, and the drawn error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtff_dynamics.attitude.magnetic_field import DrawnFieldError, magnetic_field_gcrf
from vtff_dynamics.attitude.orbit_track import OrbitTrack
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.time.timescales import parse_epoch

EPOCH = parse_epoch("2000-01-01T00:00:00 UTC")
IGRF_RADIUS = 6371.2e3  # m; of the definition of the coefficients
ORBIT = ClassicalElements(7.082e6, 1e-3, math.radians(98.1), 1.0, 0.5, 0.0).to_state()


def field_itrf(position_itrf, time=EPOCH):
    rotation = rotation_gcrf_to_itrf(time)
    return rotation @ magnetic_field_gcrf(time, rotation.T @ position_itrf)


def test_low_degrees_are_the_published_coefficients_of_2000():
    """Gauss coefficients by integration over a sphere; DGRF 2000 of IGRF-14 (Alken et al. 2021)."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    longitudes = 2.0 * math.pi * np.arange(32) / 32
    sums = np.zeros(4)
    for cosine, weight in zip(nodes, weights, strict=True):
        sine = math.sqrt(1.0 - cosine * cosine)
        for longitude in longitudes:
            up = np.array([sine * math.cos(longitude), sine * math.sin(longitude), cosine])
            radial = 1e9 * field_itrf(IGRF_RADIUS * up) @ up
            basis = np.array([up[2], up[0], up[1], 1.5 * cosine * cosine - 0.5])
            sums += weight / 32.0 * radial * basis
    # B_r = sum (n + 1) g P; the mean of P^2 over the sphere is 1 / (2 n + 1).
    degree = np.array([1, 1, 1, 2])
    measured = sums / 2.0 * (2 * degree + 1) / (degree + 1)
    np.testing.assert_allclose(measured, [-29619.4, -1728.2, 5186.1, -2267.7], atol=0.1)


def test_error_has_its_size_and_is_a_potential_field():
    error = DrawnFieldError(300e-9, seed=3)
    generator = np.random.default_rng(1)
    points = generator.standard_normal((2000, 3))
    points *= error.radius / np.linalg.norm(points, axis=1)[:, None]
    values = np.array([error.field_itrf(point) for point in points])
    assert np.sqrt(np.mean(values**2)) == pytest.approx(300e-9, rel=0.05)
    step = 1e3
    for point in points[:20]:
        gradient = np.array(
            [
                (error.field_itrf(point + offset) - error.field_itrf(point - offset)) / (2 * step)
                for offset in step * np.eye(3)
            ]
        )
        np.testing.assert_allclose(gradient, gradient.T, atol=1e-6 * np.abs(gradient).max())
        assert abs(np.trace(gradient)) < 1e-6 * np.abs(gradient).max()
    other = DrawnFieldError(300e-9, seed=4).field_itrf(points[0])
    assert np.linalg.norm(other - values[0]) > 30e-9


def test_track_gives_positions_and_fields_of_its_times():
    error = DrawnFieldError(300e-9, seed=3)
    track = OrbitTrack(EPOCH, ORBIT, field_error=error, drag_pressure=1e-14)
    interval = track.interval(2)
    np.testing.assert_array_equal(interval.position_gcrf[0], track.state_gcrf(2)[:3])
    np.testing.assert_array_equal(interval.field_gcrf[2], track.true_field_gcrf(3))
    time, state = track.time(3), track.state_gcrf(3)
    assert time - EPOCH == 15.0
    np.testing.assert_array_equal(track.field_gcrf(3), magnetic_field_gcrf(time, state[:3]))
    rotation = rotation_gcrf_to_itrf(time)
    np.testing.assert_allclose(
        track.true_field_gcrf(3) - track.field_gcrf(3),
        rotation.T @ error.field_itrf(rotation @ state[:3]),
        atol=1e-18,
    )
    # 8 km/s against air that turns along: about (7.5 km/s)^2 * 1e-14, against the motion.
    assert interval.drag_force_gcrf @ state[3:] < 0.0
    assert 5e-7 < np.linalg.norm(interval.drag_force_gcrf) < 7e-7


def test_parabola_through_five_seconds_leaves_a_millionth():
    track = OrbitTrack(EPOCH, ORBIT)
    fine = OrbitTrack(EPOCH, ORBIT, period=1.25)
    interval = track.interval(0)
    first, middle, last = interval.field_gcrf
    quarter = 0.375 * first + 0.75 * middle - 0.125 * last
    assert np.linalg.norm(quarter - fine.field_gcrf(1)) < 1e-6 * np.linalg.norm(first)


def test_years_without_a_field_are_refused():
    with pytest.raises(ValueError, match=r"epoch: .*IGRF-14 holds from 1900 to 2030") as caught:
        OrbitTrack(parse_epoch("2031-05-01T00:00:00 UTC"), ORBIT)
    assert "\n" not in str(caught.value)

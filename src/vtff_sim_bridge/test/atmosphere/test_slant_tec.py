"""Slant TEC against closed forms and adaptive quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from vtff_dynamics.constants import WGS84_SEMI_MAJOR_AXIS
from vtff_dynamics.frames.geodetic import geodetic_from_itrf, itrf_from_geodetic
from vtff_sim_bridge.atmosphere.density_models import (
    ChapmanLayer,
    bubble_profile,
    chapman_profile,
    constant_profile,
    plumex_like_profile,
)
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile
from vtff_sim_bridge.atmosphere.slant_tec import (
    ALTITUDE_MODELS,
    SlantTecIntegrator,
)

RADIUS = WGS84_SEMI_MAJOR_AXIS
RADIUS_GPS = 26.56e6
LAYER = ChapmanLayer(1.3e12, 350e3, 45e3, 70e3)
CHAPMAN = chapman_profile([LAYER])
PROFILES = {
    "chapman": CHAPMAN,
    "bubble": bubble_profile(CHAPMAN),
    "plumex": plumex_like_profile(5),
    "slab": constant_profile(1e12, 200e3, 800e3),
}
ELEVATIONS_DEG = (-25.0, -15.0, -5.0, -1.0, 0.0, 0.01, 1.0, 2.0, 2.4, 3.0, 5.0, 10.0, 30.0, 90.0)


def ray(altitude, elevation_deg, latitude=0.1, longitude=-1.3, azimuth=0.7, end=RADIUS_GPS):
    """Return receiver and satellite of a ray with an elevation above the sphere."""
    radial = itrf_from_geodetic([latitude, longitude, 1e12])
    radial /= np.linalg.norm(radial)
    east = np.cross([0.0, 0.0, 1.0], radial)
    east /= np.linalg.norm(east)
    north = np.cross(radial, east)
    elevation = math.radians(elevation_deg)
    direction = math.sin(elevation) * radial + math.cos(elevation) * (
        math.sin(azimuth) * east + math.cos(azimuth) * north
    )
    receiver = (RADIUS + altitude) * radial
    along = receiver @ direction
    length = -along + math.sqrt(along**2 - receiver @ receiver + end**2)
    return receiver, receiver + length * direction


def reference_tecu(profile, integrator, receiver, satellite):
    """Return the content by Gauss-Legendre quadrature between all corners of the table."""
    vector = satellite - receiver
    length = np.linalg.norm(vector)
    corners = _parts_at_altitudes(integrator, receiver, vector, profile.altitude)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = 0.5 * np.diff(corners)
    parts = 0.5 * (corners[1:] + corners[:-1])[:, None] + half[:, None] * nodes
    positions = receiver + parts[..., None] * vector
    return float(half @ (profile.density(integrator.altitude(positions)) @ weights)) * length / 1e16


def _parts_at_altitudes(integrator, receiver, vector, altitudes):
    # |A + t B|^2 of the (stretched) ray is a quadratic in t: three values fix it.
    t = np.array([0.0, 0.5, 1.0])
    square = (integrator.altitude(receiver + t[:, None] * vector) + RADIUS) ** 2
    c = square[0]
    a = 2.0 * (square[0] - 2.0 * square[1] + square[2])
    b = 0.5 * (square[2] - square[0] - a)
    discriminant = b * b - a * (c - (altitudes + RADIUS) ** 2)
    root = np.sqrt(discriminant[discriminant > 0.0])
    parts = np.concatenate(((-b + root) / a, (-b - root) / a, [0.0, 1.0, -b / a]))
    return np.unique(np.clip(parts, 0.0, 1.0))


@pytest.mark.parametrize("altitude_model", ALTITUDE_MODELS)
@pytest.mark.parametrize("name", PROFILES)
def test_equals_quadrature_at_all_elevations(name, altitude_model):
    profile = PROFILES[name]
    integrator = SlantTecIntegrator(profile, altitude_model)
    for altitude in (0.0, 289.98e3, 310e3, 349.96e3, 362e3, 500e3, 900e3):
        for elevation_deg in ELEVATIONS_DEG:
            receiver, satellite = ray(altitude, elevation_deg)
            stec = integrator.slant_tec_tecu(receiver, satellite[None])[0]
            expected = reference_tecu(profile, integrator, receiver, satellite)
            assert stec == pytest.approx(expected, abs=5e-4), (altitude, elevation_deg)


@pytest.mark.parametrize("elevation_deg", [-15.0, 0.5, 5.0, 20.0, 60.0])
@pytest.mark.parametrize("altitude", [250e3, 420e3])
def test_equals_adaptive_quadrature_of_the_chapman_formula(altitude, elevation_deg):
    """The layer is integrated as a formula: the error of the table is in it too."""
    integrator = SlantTecIntegrator(CHAPMAN, "spherical")
    receiver, satellite = ray(altitude, elevation_deg)
    length = np.linalg.norm(satellite - receiver)
    direction = (satellite - receiver) / length

    def density(s):
        height = np.linalg.norm(receiver + s * direction) - RADIUS
        return float(LAYER.density(height)) if 80e3 <= height <= 2000e3 else 0.0

    along = -float(receiver @ direction)
    perigee = math.sqrt(receiver @ receiver - along**2)
    points = [along + sign * math.sqrt(max((RADIUS + h) ** 2 - perigee**2, 0.0))
              for h in (80e3, 350e3, 500e3, 2000e3) for sign in (-1, 1)]  # fmt: skip
    points = sorted({p for p in points if 0.0 < p < length})
    expected, _ = quad(density, 0.0, length, points=points, limit=500, epsabs=1e11, epsrel=1e-10)
    stec = integrator.slant_tec_tecu(receiver, satellite[None])[0]
    assert stec == pytest.approx(expected / 1e16, abs=1e-3)


@pytest.mark.parametrize("elevation_deg", ELEVATIONS_DEG)
def test_slab_is_the_length_of_chords(elevation_deg):
    integrator = SlantTecIntegrator(PROFILES["slab"], "spherical")
    receiver, satellite = ray(400e3, elevation_deg)
    radius = RADIUS + 400e3
    start = radius * math.sin(math.radians(elevation_deg))
    perigee = radius * math.cos(math.radians(elevation_deg))

    def reach(altitude):
        return math.sqrt(max((RADIUS + altitude) ** 2 - perigee**2, 0.0))

    length = reach(800e3) - start - (2.0 * reach(200e3) if elevation_deg < 0.0 else 0.0)
    stec = integrator.slant_tec_tecu(receiver, satellite[None])[0]
    assert stec == pytest.approx(length * 1e12 / 1e16, abs=5e-4)


def test_zenith_is_the_vertical_tec():
    for profile in PROFILES.values():
        integrator = SlantTecIntegrator(profile, "spherical")
        for altitude in (0.0, 300e3, 350e3, 640e3):
            receiver, satellite = ray(altitude, 90.0)
            stec = integrator.slant_tec_tecu(receiver, satellite[None])[0]
            assert stec == pytest.approx(float(profile.vtec_above_tecu(altitude)), abs=1e-9)


@pytest.mark.parametrize("elevation_deg", [-20.0, -3.0, 0.0, 1.0, 12.0])
def test_ray_can_be_reversed_and_cut(elevation_deg):
    integrator = SlantTecIntegrator(PROFILES["bubble"])
    receiver, satellite = ray(330e3, elevation_deg)
    whole = integrator.slant_tec_tecu(receiver, satellite[None])[0]
    assert integrator.slant_tec_tecu(satellite, receiver[None])[0] == pytest.approx(whole, abs=1e-6)
    for part in (0.01, 0.1, 0.3):
        middle = receiver + part * (satellite - receiver)
        first = integrator.slant_tec_tecu(receiver, middle[None])[0]
        second = integrator.slant_tec_tecu(middle, satellite[None])[0]
        assert first + second == pytest.approx(whole, abs=1e-3)


def test_profile_that_reaches_beyond_the_satellite():
    integrator = SlantTecIntegrator(constant_profile(1e9, 200e3, 30000e3), "spherical")
    receiver, satellite = ray(400e3, 8.0)
    expected = np.linalg.norm(satellite - receiver) * 1e9 / 1e16
    assert integrator.slant_tec_tecu(receiver, satellite[None])[0] == pytest.approx(
        expected, abs=1e-4
    )


def test_receiver_far_above_the_peak_sees_the_plasmasphere():
    altitude = np.array([100e3, 350e3, 1000e3, 30000e3])
    integrator = SlantTecIntegrator(ElectronDensityProfile(altitude, [0.0, 1e12, 1e10, 1e6]))
    for elevation_deg in (0.5, 5.0, 40.0):
        receiver, satellite = ray(20000e3, elevation_deg, end=36000e3)
        expected = reference_tecu(integrator.profile, integrator, receiver, satellite)
        stec = integrator.slant_tec_tecu(receiver, satellite[None])[0]
        assert stec == pytest.approx(expected, abs=1e-5)


def test_links_are_independent_of_their_company():
    integrator = SlantTecIntegrator(PROFILES["plumex"])
    rays = [ray(300e3, elevation) for elevation in (5.0, 0.5, 80.0, -10.0)]
    receivers = np.stack([rays[0][0], ray(301e3, 0.0)[0]])
    satellites = np.stack([satellite for _, satellite in rays])
    together = integrator.slant_tec_tecu(receivers, np.stack([satellites, satellites]))
    assert together.shape == (2, 4)
    for row, receiver in enumerate(receivers):
        for column, satellite in enumerate(satellites):
            alone = integrator.slant_tec_tecu(receiver, satellite[None])[0]
            assert together[row, column] == pytest.approx(alone, abs=1e-6)


def test_ellipsoidal_altitude_is_geodetic_height():
    integrator = SlantTecIntegrator(CHAPMAN)
    latitude = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 181)
    at_reference = itrf_from_geodetic(
        np.stack([latitude, 0.3 + 0.0 * latitude, 0.0 * latitude + 350e3], axis=-1)
    )
    assert np.abs(integrator.altitude(at_reference) - 350e3).max() < 1.0
    near_equator = np.abs(latitude) <= math.radians(10.0)
    for height in (150e3, 290e3, 550e3):
        position = itrf_from_geodetic(
            np.stack([latitude, 0.3 + 0.0 * latitude, 0.0 * latitude + height], axis=-1)
        )
        error = np.abs(integrator.altitude(position) - geodetic_from_itrf(position)[:, 2])
        assert error[near_equator].max() < 25.0
        assert error.max() < 750.0


def test_wrong_arguments_are_refused():
    with pytest.raises(ValueError, match="altitude_model"):
        SlantTecIntegrator(CHAPMAN, "flat")
    integrator = SlantTecIntegrator(CHAPMAN)
    receiver, satellite = ray(300e3, 10.0)
    with pytest.raises(ValueError, match=r"got \(3,\) and \(3,\)"):
        integrator.slant_tec_tecu(receiver, satellite)
    with pytest.raises(ValueError, match="apart"):
        integrator.slant_tec_tecu(receiver, receiver[None])
    with pytest.raises(ValueError, match="finite"):
        integrator.slant_tec_tecu(receiver, np.full((1, 3), math.nan))

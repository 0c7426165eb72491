"""The layers of plasma against the slant content that the emulator integrates."""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import CHIEF, DEPUTY_5KM, DEPUTY_250M, START, broadcast_ephemerides

from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.filter import RelativeFilter
from vtff_nav.relative.cdgps.orbit_filter import CHIEF_MOTION
from vtff_nav.relative.cdgps.state import GaussianState
from vtff_nav.relative.common.dynamics import Prediction
from vtff_nav.relative.kernels.sky import DENSITY_UNIT, plasma_paths
from vtff_sim_bridge.atmosphere.density_models import (
    ChapmanLayer,
    chapman_profile,
    constant_profile,
)
from vtff_sim_bridge.atmosphere.slant_tec import SlantTecIntegrator

LAYERS = np.array(CdgpsConfiguration().plasma_layers)


def differential(profile, deputy):
    """Return differential slant TEC of the integrator and the paths of the layers."""
    table = EphemerisStore(broadcast_ephemerides(START, 60.0)).table(START)
    states = np.array([state_gcrf_to_itrf(START, state) for state in (CHIEF, deputy)])
    seen = lines_of_sight(table, START, np.zeros(2), states[:, :3], states[:, 3:])
    integrator = SlantTecIntegrator(profile)
    content = integrator.slant_tec_tecu(states[:, :3], seen.position_satellite_itrf)
    is_high = seen.elevation[0] > np.radians(5.0)
    altitude = integrator.altitude(states[:, :3])
    rise = float(altitude[1] - altitude[0])
    radius = float(np.linalg.norm(states[0, :3]))
    paths = plasma_paths(radius, rise, seen.elevation[:, is_high], LAYERS)
    return (content[1] - content[0])[is_high], paths


@pytest.mark.parametrize(
    ("deputy", "bound"), [(DEPUTY_250M, 2e-4), (DEPUTY_5KM, 3e-3)], ids=["250 m", "5 km"]
)
@pytest.mark.parametrize(
    "profile",
    [
        constant_profile(5e11, 450e3, 800e3),
        chapman_profile([ChapmanLayer(9e11, 378e3, 35e3, 55e3)]),
        chapman_profile([ChapmanLayer(1.5e12, 400e3, 40e3, 110e3)]),
    ],
    ids=["constant", "reference", "thick"],
)
def test_layers_reproduce_profiles(profile, deputy, bound):
    """Least squares of the layers leaves less than 0.2 (5 km: 3) mTECU above 5 deg."""
    content, paths = differential(profile, deputy)
    densities, *_ = np.linalg.lstsq(paths, content, rcond=None)
    assert np.abs(content - paths @ densities).max() < bound


def test_constant_layer_is_exact_at_the_equator():
    """A layer of the model is the layer of the integrator where the Earth is round."""
    altitude = float(np.linalg.norm(CHIEF[:3])) - 6378137.0
    thickness = LAYERS[1]
    profile = constant_profile(DENSITY_UNIT, 300e3, altitude + thickness)
    content, paths = differential(profile, DEPUTY_250M)
    np.testing.assert_allclose(content, paths[:, 1], rtol=5e-3)


def test_equal_receivers_see_no_difference():
    elevation = np.radians([[5.0, 40.0, 90.0]] * 2)
    np.testing.assert_allclose(plasma_paths(6.93e6, 0.0, elevation, LAYERS), 0.0, atol=1e-9)
    rise = plasma_paths(6.93e6, 1000.0, elevation, LAYERS)
    # At the zenith what lies between the altitudes is all.
    np.testing.assert_allclose(rise[2], -1000.0 * DENSITY_UNIT / 1e16, rtol=1e-9)


def test_layers_and_gradients_are_forgotten_in_their_own_times():
    """What moves with the spacecraft changes slower than what lies on their way."""
    parameters = CdgpsConfiguration(electron_density_time=1000.0, plasma_gradient_time=250.0)
    state, identity, zero = np.zeros(9), np.eye(9), np.zeros((9, 9))
    filter_ = RelativeFilter(parameters, state, identity, 0.0)
    layer, gradient = ("plasma", 0), ("plasma_shell", 0, "north")
    for label in (layer, gradient):
        filter_.state.mean[filter_.state.index(label)] = 1.0
    still = Prediction(state, state, identity, identity, zero, zero, np.zeros((9, 4)))
    for _ in range(10):
        filter_.predict(still, 25.0, np.zeros(2))
    assert filter_.state.value(layer) == pytest.approx(np.exp(-0.25))
    assert filter_.state.value(gradient) == pytest.approx(np.exp(-1.0))


@pytest.mark.parametrize(("are_joint", "gradient"), [(True, 0.03), (True, 3.0), (False, 0.03)])
def test_contents_change_by_gradients_where_these_show(are_joint, gradient):
    """Far apart a layer is kept as long as gradients of the sigma of the filter leave it alike."""
    parameters = CdgpsConfiguration(plasma_gradient_sigma_tecu_per_deg=gradient)
    state, identity, zero = np.zeros(9), np.eye(9), np.zeros((9, 9))
    filter_ = RelativeFilter(parameters, state, zero, 0.0)
    if are_joint:
        filter_.state.join(GaussianState(CHIEF_MOTION, state, zero))
    layer, speed = ("plasma", 3), 0.06  # deg/s
    filter_.state.renew(layer, 0.0)
    still = Prediction(state, state, identity, identity, zero, zero, np.zeros((9, 4)))
    for _ in range(10):
        filter_.predict(still, 10.0, np.array([0.0, 10.0 * speed]))
    content = filter_.state.sigma(layer) * DENSITY_UNIT * parameters.plasma_layers[3] / 1e16
    # A walk of 100 s along gradients that stay alike for 300 s, or the time that is given.
    walk = gradient * speed * np.sqrt(2.0 * parameters.plasma_gradient_time * 100.0)
    given = 15.0 * np.sqrt(1.0 - np.exp(-200.0 / parameters.electron_density_time))
    assert content == pytest.approx(min(walk, given) if are_joint else given, rel=0.01)


@pytest.mark.parametrize(("true", "smallest", "largest"), [(0.03, 0.03, 0.3), (2.0, 0.8, 2.0)])
def test_gradients_are_learnt_before_there_are_integers(true, smallest, largest):
    """From gradients that floats tell to 0.1 TECU/deg; without that, all sigmas are as likely."""
    parameters = CdgpsConfiguration()
    generator = np.random.default_rng(2)
    sigmas = []
    for _ in range(20):
        motion = np.concatenate((DEPUTY_5KM - CHIEF, np.zeros(3)))
        relative = RelativeFilter(parameters, motion, np.eye(9), 0.0)
        state = relative.state
        state.join(GaussianState(CHIEF_MOTION, np.zeros(9), np.eye(9)))
        columns = [k for k, label in enumerate(state.labels) if label[-1] in ("north", "east")]
        relative._learn_gradients()
        unknown = relative._gradient_sigma
        design = np.eye(len(state))[columns]
        values = np.hypot(true, 0.1) * generator.standard_normal(len(columns))
        empty = np.zeros((len(columns), 0))
        state.update(state.innovation(design, values, np.full(len(columns), 0.01), empty))
        for _ in range(5):
            relative._learn_gradients()
        sigmas.append(relative._gradient_sigma)
    assert unknown > 0.4 * parameters.plasma_gradient_sigma_tecu_per_deg
    assert smallest < np.median(sigmas) < largest

"""Propagation: references, conserved quantities, thrust, Euler, and the traps of brahe."""

import json
import math
import os
import subprocess
import sys

import brahe
import numpy as np
import pytest
from dynamics_scenarios import EPOCH, reference_orbit, remote_sensing_elements

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.earth import (
    state_gcrf_to_itrf,
)
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.orbit.propagator import ForceModel, Propagator
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_dynamics.time.timescales import parse_epoch

TWO_BODY = ForceModel(gravity="two_body")
STATE = np.array([6928137.0, 0.0, 0.0, 0.0, 3792.5442661521847, 6568.879358929605])


def advance(propagator, steps, thrust=None):
    """Advance by several steps and return the state."""
    for _ in range(steps):
        propagator.advance(thrust)
    return propagator.state_gcrf


def test_reference_orbit_of_four_codes_is_met_within_a_millimetre():
    reference = reference_orbit()
    propagator = Propagator(parse_epoch(reference["epoch"]), reference["initial"])
    state = advance(propagator, 3600)
    assert propagator.time - parse_epoch(reference["epoch"]) == 3600.0
    assert np.linalg.norm(state[:3] - reference["after_3600_s"][:3]) < 1e-3
    assert np.linalg.norm(state[3:] - reference["after_3600_s"][3:]) < 1e-6


@pytest.mark.parametrize(
    ("model", "integrator", "height", "second", "tolerance", "latitude_deg", "longitude_deg"),
    [
        (TWO_BODY, "rk4", 290e3, 2028, 10, -7.4, -74.0),
        (ForceModel(), "rk4", 290e3, 2088, 10, -7.9, -70.0),
        (TWO_BODY, "euler", 290e3, 1921, 15, -6.5, -81.0),
        (TWO_BODY, "euler", 350e3, 2141, 15, -8.2, -67.0),
    ],
)
def test_remote_sensing_chief_rises_through_the_bubble(
    model, integrator, height, second, tolerance, latitude_deg, longitude_deg
):
    propagator = Propagator(EPOCH, remote_sensing_elements()[0].to_state(), model, integrator)
    previous = math.inf
    for _ in range(2400):
        state = propagator.advance()
        position = state_gcrf_to_itrf(propagator.time, state)[:3]
        geodetic = geodetic_from_itrf(position)
        if previous < height <= geodetic[2]:
            break
        previous = geodetic[2]
    assert propagator.time - EPOCH == pytest.approx(second, abs=tolerance)
    assert np.degrees(geodetic[:2]) == pytest.approx([latitude_deg, longitude_deg], abs=0.6)
    local_time = mean_solar_local_time_hours(propagator.time, geodetic[1])
    assert 20.0 <= local_time <= 21.2


def test_two_body_conserves_energy_and_momentum_and_closes():
    elements = remote_sensing_elements()[0]
    initial = elements.to_state()
    period = 2 * math.pi / elements.mean_motion
    step = round(period / 5000, 9)
    state = advance(Propagator(EPOCH, initial, TWO_BODY, step=step), 5000)

    def energy(s):
        return s[3:] @ s[3:] / 2 - GM_EARTH / np.linalg.norm(s[:3])

    assert energy(state) == pytest.approx(energy(initial), rel=1e-11)
    np.testing.assert_allclose(
        np.cross(state[:3], state[3:]), np.cross(initial[:3], initial[3:]), rtol=1e-11, atol=1.0
    )
    np.testing.assert_allclose(state[:3], initial[:3], atol=0.05)


def test_runge_kutta_is_of_fourth_order():
    fine = advance(Propagator(EPOCH, STATE, TWO_BODY, step=1.0), 640)
    errors = [
        np.linalg.norm(advance(Propagator(EPOCH, STATE, TWO_BODY, step=step), count) - fine)
        for step, count in ((64.0, 10), (32.0, 20))
    ]
    assert 12.0 < errors[0] / errors[1] < 20.0


def test_euler_is_the_explicit_rule():
    model = ForceModel()
    thrust = np.array([0.1, -0.2, 0.3])
    acceleration = Propagator(EPOCH, STATE, model).acceleration_gcrf()
    state = Propagator(EPOCH, STATE, model, "euler").advance(thrust)
    np.testing.assert_array_equal(state[:3], STATE[:3] + STATE[3:])
    np.testing.assert_allclose(state[3:], STATE[3:] + acceleration + thrust, rtol=1e-15)


@pytest.mark.parametrize(
    "model",
    [
        TWO_BODY,
        ForceModel(),
        ForceModel(degree=70, order=70),
        ForceModel(degree=20, order=3),
        ForceModel(drag="harris_priester"),
        ForceModel(drag="nrlmsise00"),
        ForceModel(gravity="two_body", drag="nrlmsise00"),
        ForceModel(solar_radiation_pressure=True),
        ForceModel(third_bodies=("sun",)),
        ForceModel(third_bodies=("sun", "moon")),
    ],
    ids=repr,
)
def test_acceleration_is_the_one_that_is_integrated(model):
    step = 0.1
    # With a large area the small forces stand out of rounding.
    properties = {"mass": 10.0, "drag_area": 100.0, "radiation_area": 100.0}
    model = ForceModel(**{**vars(model), **properties})
    propagator = Propagator(EPOCH, STATE, model, step=step)
    propagator.advance()
    acceleration = propagator.acceleration_gcrf()
    middle_time = propagator.time
    after = propagator.advance()
    assert middle_time - EPOCH == step
    difference = (after[3:] - STATE[3:]) / (2 * step)
    # The central difference leaves step2 n2 a / 6 = 2e-8 m/s2.
    np.testing.assert_allclose(difference, acceleration, atol=5e-8)


@pytest.mark.parametrize(
    ("extra", "low", "high"),
    [
        ({"drag": "harris_priester"}, 6.0, 7.6),
        ({"drag": "nrlmsise00"}, 1.2, 1.5),
        ({"solar_radiation_pressure": True}, 0.35, 0.43),
        ({"third_bodies": ("sun", "moon")}, 5.5, 6.9),
        ({"degree": 20, "order": 20}, 28.0, 36.0),
        ({"degree": 70, "order": 70}, 26.0, 34.0),
    ],
)
def test_size_of_each_force_after_one_hour(extra, low, high):
    # Reference: 100 kg, 1 m2, Cd 2.2, Cr 1.3 at 550 km in March 2016, four codes (facts, 2.2).
    plain = advance(Propagator(EPOCH, STATE, step=10.0), 360)
    other = advance(Propagator(EPOCH, STATE, ForceModel(**extra), step=10.0), 360)
    assert low < np.linalg.norm(plain[:3] - other[:3]) < high


def test_thrust_is_held_over_each_step_and_may_change():
    state = STATE.copy()
    propagator = Propagator(EPOCH, STATE, TWO_BODY)
    generator = np.random.default_rng(7)
    for _ in range(20):
        thrust = generator.normal(size=3)
        propagator.advance(thrust)
        state = Propagator(EPOCH, state, TWO_BODY).advance(thrust)
    np.testing.assert_allclose(propagator.state_gcrf, state, rtol=1e-15)


def test_thrust_adds_its_impulse():
    thrust = np.array([0.0, 0.0, 1.4])
    free = Propagator(EPOCH, STATE).advance()
    pushed = Propagator(EPOCH, STATE).advance(thrust)
    np.testing.assert_allclose(pushed[3:] - free[3:], thrust, atol=2e-6)
    np.testing.assert_allclose(pushed[:3] - free[:3], thrust / 2, atol=1e-6)


def test_zero_thrust_late_first_thrust_and_none_are_one_motion():
    nothing, zero, early = (Propagator(EPOCH, STATE) for _ in range(3))
    early.advance(np.array([1e-300, 0.0, 0.0]))
    zero.advance(np.zeros(3))
    nothing.advance()
    for _ in range(50):
        zero.advance([0.0, 0.0, 0.0])
        nothing.advance(None)
        early.advance(None)
    np.testing.assert_array_equal(nothing.state_gcrf, zero.state_gcrf)
    np.testing.assert_array_equal(nothing.state_gcrf, early.state_gcrf)
    thrust = np.array([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(nothing.advance(thrust), early.advance(thrust))


def test_time_is_exact_with_steps_that_are_not_binary_fractions():
    propagator = Propagator(EPOCH, STATE, TWO_BODY, step=0.1)
    advance(propagator, 3000)
    assert propagator.time == EPOCH + 300
    whole = advance(Propagator(EPOCH, STATE, TWO_BODY, step=0.5), 600)
    np.testing.assert_allclose(propagator.state_gcrf[:3], whole[:3], atol=1e-5)


def test_states_are_copies():
    propagator = Propagator(EPOCH, STATE)
    propagator.state_gcrf[:] = 0.0
    propagator.advance()[:] = 0.0
    assert np.linalg.norm(propagator.state_gcrf[:3]) > 6e6
    assert STATE[0] == 6928137.0


@pytest.mark.parametrize("thrust", [[0.0, 0.0], [math.nan, 0, 0], [math.inf, 0, 0]])
def test_unusable_thrust_is_refused_and_changes_nothing(thrust):
    propagator = Propagator(EPOCH, STATE)
    with pytest.raises(ValueError, match="acceleration_gcrf"):
        propagator.advance(thrust)
    assert propagator.time == EPOCH
    np.testing.assert_array_equal(propagator.advance(), Propagator(EPOCH, STATE).advance())


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"integrator": "rk45"}, "integrator"),
        ({"step": 0.0}, "step"),
        ({"step": -1.0}, "step"),
        ({"step": 1e-10}, "step"),
        ({"step": 1.0 / 3.0}, "step"),
        ({"state_gcrf": [1.0, 2.0]}, "state_gcrf"),
        ({"state_gcrf": [math.nan] * 6}, "state_gcrf"),
        ({"state_gcrf": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]}, "state_gcrf"),
    ],
)
def test_unusable_arguments_are_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        Propagator(**{"time": EPOCH, "state_gcrf": STATE, **arguments})


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"gravity": "egm96"}, "gravity"),
        ({"degree": 71}, "degree"),
        ({"degree": 1, "order": 0}, "degree"),
        ({"degree": 8, "order": 9}, "order"),
        ({"drag": "jacchia"}, "drag"),
        ({"third_bodies": ("mars",)}, "third_bodies"),
        ({"mass": 0.0}, "mass"),
        ({"drag_area": -1.0}, "drag_area"),
        ({"radiation_coefficient": math.nan}, "radiation_coefficient"),
    ],
)
def test_unusable_force_models_are_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        ForceModel(**arguments)


def brahe_propagator(control_input=None, initial_step=None):
    """Return a brahe propagator as the library sets it up, or without its initial step."""
    configuration = brahe.NumericalPropagationConfig(
        brahe.IntegrationMethod.RK4,
        brahe.IntegratorConfig.fixed_step(1.0),
        brahe.VariationalConfig(),
    )
    if initial_step is not None:
        configuration = configuration.with_initial_step(initial_step)
    return brahe.NumericalOrbitPropagator(
        EPOCH.to_brahe_epoch(),
        STATE,
        configuration,
        TWO_BODY.to_brahe(),
        control_input=control_input,
    )


def test_trap_brahe_steps_one_second_only_with_an_initial_step():
    right, wrong = brahe_propagator(initial_step=1.0), brahe_propagator()
    for propagator in (right, wrong):
        propagator.propagate_to(EPOCH.to_brahe_epoch() + 600.0)
    assert len(right.trajectory) == 601
    assert len(wrong.trajectory) == 11  # 60 s: fixed_step(1.0) is ignored.
    ours = advance(Propagator(EPOCH, STATE, TWO_BODY), 600)
    np.testing.assert_allclose(ours, right.current_state(), rtol=1e-13)


def test_trap_brahe_control_input_is_the_derivative_of_the_state():
    calls = []

    def control(seconds, _state, _parameters):
        calls.append(seconds)
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0])

    propagator = brahe_propagator(control, 1.0)
    propagator.step()
    assert calls == [0.0, 0.5, 0.5, 1.0]
    free = brahe_propagator(None, 1.0)
    free.step()
    difference = propagator.current_state() - free.current_state()
    np.testing.assert_allclose(difference, [0, 0, 0.0, 0, 0, 2.0], atol=1.0 + 1e-5)
    assert difference[5] == pytest.approx(2.0, abs=1e-5)


def test_trap_brahe_point_mass_uses_the_gravitational_parameter_of_jgm3():
    assert brahe.GM_EARTH == GM_EARTH


def test_trap_trajectory_is_not_stored():
    propagator = Propagator(EPOCH, STATE)
    advance(propagator, 100)
    assert len(propagator._brahe.trajectory) <= 1


def test_trap_tables_are_the_packaged_ones_without_home_or_network(tmp_path):
    # An empty home folder has no cache; unusable proxies stand for the missing network.
    program = (
        "import json, sys, brahe\n"
        "from vtff_dynamics.orbit.propagator import ForceModel, Propagator\n"
        "from vtff_dynamics.time.timescales import parse_epoch\n"
        "model = ForceModel(drag='nrlmsise00')\n"
        "p = Propagator(parse_epoch('2016-03-21T01:00:00 GPS'), json.loads(sys.argv[1]), model)\n"
        "for _ in range(60): p.advance()\n"
        "print(json.dumps([p.state_gcrf.tolist(), brahe.get_global_eop_type(),"
        " brahe.get_global_eop_extrapolation()]))\n"
    )
    environment = {
        **os.environ,
        "HOME": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "http_proxy": "http://127.0.0.1:9",
        "https_proxy": "http://127.0.0.1:9",
    }
    output = subprocess.run(
        [sys.executable, "-c", program, json.dumps(STATE.tolist())],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    ).stdout
    state, table, extrapolation = json.loads(output)
    here = advance(Propagator(EPOCH, STATE, ForceModel(drag="nrlmsise00")), 60)
    assert state == here.tolist()
    assert (table, extrapolation) == ("StandardBulletinA", "Hold")

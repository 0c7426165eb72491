"""The benchmark of worlds that do not match the filter: recordings, integers, figures, errors."""

from __future__ import annotations

import dataclasses
import math
import pathlib
import subprocess
import sys

import numpy as np
import pytest

BENCHMARKS = pathlib.Path(__file__).resolve().parents[1] / "benchmarks"
SECONDS = 75

# Rows of the benchmark that are flown in short, with the length of their flights, s: what is 5 km
# apart, or is told by the first burn, is told in two minutes; slips come from 100 s on, and at
# 225 km there is an epoch each 10 s. `ideal_geometries` and `outage_loop` have tests of their own.
SHORT_FLIGHTS = {
    "thrust_1.05": 110,
    "forces": 110,
    "forces_5km": 110,
    "forces_225km": 200,
    "broadcast": 110,
    "broadcast_5km": 110,
    "multipath_5mm": 110,
    "multipath_sinusoid": 110,
    "stated_third": 110,
    "antennas_given": 110,
    "lever_arm_drawn": 110,
    "maps_not_given": 110,
    "gradient_0.5_5km": 110,
    "gradient_2_5km": 110,
    "realistic_loop": 110,
    "faults": 180,
}


@pytest.fixture(scope="module", autouse=True)
def _importable():
    """Let the folder of the benchmarks be imported from, as when one of them is run."""
    sys.path.insert(0, str(BENCHMARKS))
    yield
    sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Return a short flight in a drawn geometry, its recording, and the folder that keeps it."""
    from realism.recording import load_or_fly
    from realism.worlds import WORLDS

    cache = tmp_path_factory.mktemp("cache")
    world = WORLDS["ideal_geometries"]
    return load_or_fly("ideal_geometries", world, 2, SECONDS, cache), world, cache


def test_recording_is_kept_and_flown_anew_for_another_world(flown):
    from realism.recording import load_or_fly

    recording, world, cache = flown
    (kept,) = cache.iterdir()
    written = kept.stat().st_mtime_ns
    again = load_or_fly("ideal_geometries", world, 2, SECONDS, cache)
    assert kept.stat().st_mtime_ns == written and len(again) == len(recording) == SECONDS
    np.testing.assert_array_equal(again[-1].state_deputy_gcrf, recording[-1].state_deputy_gcrf)
    nearer = dataclasses.replace(world, distance=200.0)
    other = load_or_fly("ideal_geometries", nearer, 2, SECONDS, cache)
    (replaced,) = cache.iterdir()
    assert replaced != kept
    separation = other[0].state_deputy_gcrf[:3] - other[0].state_chief_gcrf[:3]
    assert np.linalg.norm(separation) == pytest.approx(200.0, abs=1e-3)


def test_seed_draws_the_geometry(flown):
    from realism.worlds import WORLDS

    _, world, _ = flown
    scenarios = [world.make(seed, SECONDS) for seed in (2, 3)]
    first, second = (scenario.chief.state_gcrf for scenario, _ in scenarios)
    assert np.linalg.norm(first - second) > 1e5
    assert scenarios[0][1].constellation.seed == 2
    fixed = [WORLDS["ideal"].make(seed, SECONDS)[0].chief.state_gcrf for seed in (2, 3)]
    np.testing.assert_array_equal(*fixed)


def test_errors_that_the_filter_states_are_drawn_with_its_sigmas():
    """Thrust errors and lever arms of two hundred seeds; those of other worlds are fixed."""
    from realism.worlds import LEVER_ARM_SIGMA, drawn_lever_arm, drawn_thrust_errors

    from vtff_nav.relative.common.estimator_setting import EstimatorSetting
    from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
    from vtff_sim_bridge.truth.scenario import load_scenario

    stated, config = EstimatorSetting(), BENCHMARKS.parent / "config"
    scenario = load_scenario(config / "scenario/reference.yaml")
    gnss = load_gnss_configuration(config / "gnss/reference.yaml")
    drawn = [drawn_thrust_errors(dataclasses.replace(scenario, seed=seed)) for seed in range(200)]
    models = [flown.deputies[0].thruster_errors for flown in drawn]
    scales = [model.scale - 1.0 for model in models]
    angles = [model.misalignment_deg for model in models]
    # The angle of a rotation whose three components have the stated sigma.
    assert np.std(scales) == pytest.approx(stated.thrust_scale_sigma, rel=0.15)
    assert np.sqrt(np.mean(np.square(angles)) / 3.0) == pytest.approx(
        stated.thrust_misalignment_sigma_deg, rel=0.15
    )
    change = drawn_lever_arm(LEVER_ARM_SIGMA)
    arms = [
        change(dataclasses.replace(gnss, seed=seed)).receivers[1].lever_arm_body
        for seed in range(200)
    ]
    np.testing.assert_allclose(np.std(arms, axis=0), LEVER_ARM_SIGMA, rtol=0.15)


def test_filter_flies_and_wrong_integers_are_counted(flown):
    """None is wrong in the ideal world; one that is made wrong in the truth is found."""
    from realism.flight import run_filter, summarise

    from vtff_nav.relative.common.estimator_setting import EstimatorSetting

    recording, world, _ = flown
    flight = run_filter(recording, world, EstimatorSetting())
    figures = summarise([flight], world)
    assert figures.integers > 20 * SECONDS and figures.wrong == figures.wrong_long == 0
    assert figures.fixed == 100.0 and figures.rms < 2.0
    first = min(recording[-1].cycles)
    tampered = [
        dataclasses.replace(second, cycles={**second.cycles, first: second.cycles[first] + 1.0})
        if index >= SECONDS - 6
        else second
        for index, second in enumerate(recording)
    ]
    flight = run_filter(tampered, world, EstimatorSetting())
    # Wrong for 6 epochs, of which those after 2 s count.
    assert (flight.wrong_integers, flight.wrong_integers_long) == (6, 3)


def test_bound_is_that_of_the_noise(flown):
    from realism.bound import bound_rms

    from vtff_analysis.studies.navigation_bound import PhaseNoise

    recording, _, _ = flown
    white, doubled, slow = (
        bound_rms(recording, PhaseNoise(*sigmas), 1)
        for sigmas in ((0.001,), (0.002,), (0.001, 0.002))
    )
    assert 2e-4 < white < 2e-3 and 1.5 * white < doubled < 2.1 * white
    assert 1.5 * doubled < slow
    # Over 250 m and in such a time gravity that is not known does little.
    beyond_30, beyond_2 = (
        bound_rms(recording, PhaseNoise(0.001), 1, omitted_degree=degree) for degree in (30, 2)
    )
    assert white < beyond_30 < beyond_2 < 1.01 * white


def test_errors_are_predicted_from_the_noise_of_the_world():
    """A filter that expects other noise than there is, a thrust error and an acceleration."""
    from realism.prediction import _ErrorState
    from realism.worlds import WhiteNoise

    from vtff_nav.relative.cdgps.state import GaussianState

    labels = [("motion", axis) for axis in range(9)]
    stated = GaussianState(labels, np.zeros(9), np.diag([1.0] * 9))
    state = _ErrorState(stated, WhiteNoise(phase_sigma=math.sqrt(0.5), code_sigma=math.sqrt(2.0)))
    state.add(("thrust", 0), 0.0, 0.0025)
    np.testing.assert_array_equal(np.diagonal(state.error_covariance), [1.0] * 6 + [0.0] * 4)
    state.disturbance = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    state.predict_gauss_markov(np.ones(10), np.zeros(10), np.zeros(10))
    # The code of the first axis has the noise that is expected, 4; the phase of the second has 1.
    design = np.zeros((2, 10))
    design[0, 0] = design[1, 1] = 1.0
    innovation = state.innovation(design, np.zeros(2), np.full(2, 4.0), np.zeros((2, 0)))
    state.update(innovation)
    np.testing.assert_allclose(np.diagonal(state.covariance)[:2], 0.8)
    np.testing.assert_allclose(np.diagonal(state.error_covariance)[:2], [0.8, 0.8**2 + 0.2**2])
    assert state.mean_error[0] == pytest.approx(-0.8 * 0.3)
    state.reweigh([("thrust", 0)], 0.0025, 0.0001)
    assert not state.error_covariance[9].any()
    state.remove([("motion", 0)])
    assert state.mean_error.shape == (9,) and state.error_covariance.shape == (9, 9)


def test_predicted_nees_is_near_one_in_the_ideal_world(flown):
    """Of that of the velocity some is missing: the filter allows for accelerations."""
    from realism.flight import run_filter, summarise

    from vtff_nav.relative.common.estimator_setting import EstimatorSetting

    recording, world, _ = flown
    figures = summarise([run_filter(recording, world, EstimatorSetting())], world)
    assert 0.6 < figures.predicted_position < 1.2
    assert 0.3 < figures.predicted_velocity < 1.2
    noisier = dataclasses.replace(
        world, white_noise=dataclasses.replace(world.white_noise, phase_sigma=0.002)
    )
    doubled = summarise([run_filter(recording, noisier, EstimatorSetting())], world)
    assert 3.0 < doubled.predicted_position / figures.predicted_position < 4.1


def test_closed_loop_flies_through_the_outage_of_the_approach():
    from realism.flight import fly

    from vtff_nav.relative.common.estimator_setting import EstimatorSetting

    flight = fly("outage_loop", 1, 70, EstimatorSetting(), None)
    assert flight.loop is not None and flight.wrong_integers_long == 0
    # Both thrusts of the approach were given: towards the chief, and to brake.
    assert flight.loop.dv > 30.0 and 90.0 < flight.loop.closest < 300.0


@pytest.mark.parametrize("name", SHORT_FLIGHTS)
def test_short_form_of_a_row(name):
    """Flights of seeds 1 and 2 are fixed, with the right integers, and honest."""
    from realism.flight import fly_closed_loop, run_filter, summarise
    from realism.recording import load_or_fly
    from realism.worlds import WORLDS

    from vtff_nav.relative.common.estimator_setting import EstimatorSetting

    world, seconds = WORLDS[name], SHORT_FLIGHTS[name]
    setting, flights = EstimatorSetting(), []
    for seed in (1, 2):
        if world.motion == "closed_loop":
            changed = world.change_setting(setting)
            flights.append(fly_closed_loop(*world.make(seed, seconds), changed))
        else:
            recording = load_or_fly(name, world, seed, seconds, None)
            unpredicted = dataclasses.replace(world, white_noise=None)
            flights.append(run_filter(recording, unpredicted, setting))
    figures = summarise(flights, world)
    assert figures.wrong_long == 0
    assert figures.fixed == 100.0 and figures.degraded < 5.0
    # Antennas that nobody has calibrated may be stated with too large a sigma.
    least = 0.0 if world.must.nees is not None and world.must.nees[0] == 0.0 else 0.3
    assert least <= figures.nees_position <= 2.5
    assert least <= figures.nees_velocity <= 2.5


def test_what_is_missed_is_told():
    from bench_realism import BOUND_FACTOR, judge
    from realism.flight import Figures
    from realism.worlds import Must

    values = dict.fromkeys((field.name for field in dataclasses.fields(Figures)), 1.0)
    figures = Figures(**{**values, "fixed": 100.0, "degraded": 0.0, "wrong_long": 0, "loops": ()})
    assert judge(figures, Must(rms_mm=1.0, fixed_percent=100.0))[1] == []
    missed = judge(dataclasses.replace(figures, nees_velocity=1.6, wrong_long=2), Must())[1]
    assert missed == ["NEES v 0.5..1.5 (1.60)", "no wrong integers (2.00)"]
    # What theory predicts for this filter is shown, and excuses nothing.
    careful = dataclasses.replace(figures, nees_velocity=0.4, predicted_velocity=0.45)
    assert judge(careful, Must())[1] == ["NEES v 0.5..1.5 (0.40)"]
    # What theory does not allow is not asked for.
    assert judge(figures, Must(rms_mm=0.9))[1] == []
    above = dataclasses.replace(figures, rms=1.01 * BOUND_FACTOR)
    assert judge(above, Must(rms_mm=0.9))[1] == ["RMS <= 1.2 (1.21)"]


def test_wrong_command_line_is_one_line():
    command = [sys.executable, str(BENCHMARKS / "bench_realism.py"), "--set", "success_rates=1"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 2
    assert "--set success_rates=1: FIELD=VALUE expected with one of" in run.stderr.splitlines()[-1]

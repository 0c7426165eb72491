"""The modes of a formation: flown on a truth of its own, refused, preempted, ended."""

import contextlib
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vtff_control.guidance.formation_guidance import (
    FormationGuidance,
    FormationGuidanceParameters,
)
from vtff_control.guidance.interface import FormationState, GuidanceSetting, check_guidance_result
from vtff_control.guidance.keeping import KeepingEngine
from vtff_control.guidance.requests import ModeRequest, ReconfigurationRequest, RequestError
from vtff_dynamics.constants import GM_EARTH, J2_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.rtn import (
    deputy_state_gcrf,
    relative_state_rtn,
    rotation_gcrf_to_rtn,
)
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.relative.relative_elements import (
    mean_relative_elements,
    relative_state_of_mean_elements,
)
from vtff_dynamics.relative.separation import closest_on_path

NAMES = ("alpha", "bravo", "charlie")
CHIEF_MEAN = np.array([7.1531e6, 0.4, 0.0, 0.0, math.radians(98.51), 1.0])
STEP = 20.0
FORMATIONS = {
    # A row along the track, and a projected circle of 15 m.
    "row": {
        name: np.array([0.0, offset, 0.0, 0.0, 0.0, 0.0])
        for name, offset in zip(NAMES, (0.0, 25.0, -25.0), strict=True)
    },
    "circle": {
        name: np.array(
            [0.0, 0.0, 7.5 * math.cos(p), 7.5 * math.sin(p), 15 * math.sin(p), -15 * math.cos(p)]
        )
        for name, p in zip(NAMES, (0.0, 2.1, -2.1), strict=True)
    },
    "nowhere": {name: np.array([0.0, 5e5 * i, 0, 0, 0, 0]) for i, name in enumerate(NAMES)},
    "collision": {name: np.zeros(6) for name in NAMES},
}


def rates(_, flat, thrust):
    """Rates of all states under the point mass and J2, written apart from the package's."""
    states = flat.reshape(-1, 6)
    position = states[:, :3]
    r = np.linalg.norm(position, axis=1, keepdims=True)
    z2 = (position[:, 2:] / r) ** 2
    strength = 1.5 * J2_EARTH * GM_EARTH * RADIUS_EARTH_JGM3**2 / r**5
    acceleration = -GM_EARTH / r**3 * position
    acceleration += strength * (
        (5.0 * z2 - 1.0) * position - 2.0 * position * np.array([0.0, 0.0, 1.0])
    )
    return np.hstack((states[:, 3:], acceleration + thrust)).ravel()


class Flight:
    """A formation under J2 whose thrust comes one step late, and may not be what was commanded."""

    def __init__(self, formation="row", scale=1.0, noise=(0.0, 0.0), seed=0, **parameters):
        setting = GuidanceSetting("alpha", NAMES[1:], STEP, formations=FORMATIONS)
        given = FormationGuidanceParameters(formation=formation, **parameters)
        self.guidance = FormationGuidance(setting, given)
        reference = state_from_elements(osculating_elements(CHIEF_MEAN))
        self.states = np.array(
            [
                deputy_state_gcrf(reference, relative_state_of_mean_elements(CHIEF_MEAN, design))
                for design in FORMATIONS[formation].values()
            ]
        )
        self.index = 0
        self.scale = scale
        self.noise = np.repeat(noise, 3)
        self.random = np.random.default_rng(seed)
        self.pending = np.zeros((3, 3))
        self.positions, self.targets, self.thrust, self.results = [], [], [], []

    @property
    def time(self):
        return self.index * STEP

    def state(self):
        chief = self.states[0]
        relative = {
            name: relative_state_rtn(chief, gcrf)
            for name, gcrf in zip(NAMES[1:], self.states[1:], strict=True)
        }
        self.positions.append([np.zeros(3), *(state[:3] for state in relative.values())])
        measured = {
            name: state + self.noise * self.random.normal(size=6)
            for name, state in relative.items()
        }
        covariances = {}
        if self.noise.any():
            covariances = dict.fromkeys(NAMES[1:], np.diag(self.noise**2))
        return FormationState(round(self.time * 1e9) + 10**18, chief, measured, covariances)

    def step(self):
        result = self.guidance.step(self.state())
        check_guidance_result(result, NAMES)
        acting, self.pending = (
            self.pending,
            np.array([result.targets[name].acceleration_rtn for name in NAMES]),
        )
        self.targets.append([result.targets[name].relative_state[:3] for name in NAMES])
        self.results.append(result)
        self.thrust.append(self.pending)
        inertial = self.scale * acting @ rotation_gcrf_to_rtn(self.states[0])
        solution = solve_ivp(
            rates,
            (0.0, STEP),
            self.states.ravel(),
            "DOP853",
            args=(inertial,),
            rtol=1e-11,
            atol=1e-6,
        )
        self.states = solution.y[:, -1].reshape(3, 6)
        self.index += 1
        return result

    def until(self, time):
        while self.time < time:
            self.step()
        return self

    def closest(self, first=0):
        positions = np.array(self.positions[first:])
        return min(
            np.linalg.norm(positions[:, j] - positions[:, i], axis=1).min()
            for i, j in itertools.combinations(range(3), 2)
        )


@pytest.mark.parametrize("scale", [1.0, 1.05])
def test_reconfiguration_arrives_although_thrust_is_late_and_too_strong(scale):
    flight = Flight(scale=scale, noise=(1e-3, 1e-5), seed=3)
    flight.step()
    followed = flight.guidance.request(ReconfigurationRequest("circle", 4560.0))
    flight.until(4560.0)
    assert not followed.finished
    flight.until(4700.0)
    assert followed.success
    assert flight.closest() >= 10.0
    assert followed.flight.plan.closest_approach >= 10.2
    result = flight.results[-1]
    assert (result.mode, result.formation) == ("keep", "circle")
    # The pairs stand to each other as the design says, whoever's frame it is.
    deviation = np.array(flight.positions[-1]) - np.array(flight.targets[-1])
    assert np.linalg.norm(deviation - deviation.mean(axis=0), axis=1).max() < 0.15
    elements = [
        mean_relative_elements(flight.states[0], relative_state_rtn(flight.states[0], gcrf))
        for gcrf in flight.states
    ]
    missing = np.array(elements) - np.array(list(FORMATIONS["circle"].values()))
    assert np.abs(missing - missing.mean(axis=0)).max() < 0.2
    # After thrust that was always too strong the filters of the keepers know how little they know;
    # the mean longitude, the second, goes on between their updates.
    others = [0, 2, 3, 4, 5]
    for name, true in zip(NAMES[1:], elements[1:], strict=True):
        estimator = flight.guidance._estimators[name]
        error = (estimator.elements - true)[others]
        covariance = estimator.covariance[np.ix_(others, others)]
        assert error @ np.linalg.solve(covariance, error) < 5.0 * len(others)
    planned = followed.flight.plan.velocity_changes
    commanded = np.array(list(followed.velocity_changes.values()))
    np.testing.assert_allclose(commanded, planned, rtol=0.15)
    largest = np.abs(np.array(flight.thrust)).max()
    assert largest <= 25e-3 / 1600.0 * (1.0 + 1e-9)


def test_refused_goals_leave_what_runs():
    flight = Flight()
    with pytest.raises(RequestError, match="no states yet"):
        flight.guidance.request(ReconfigurationRequest("circle", 4560.0))
    flight.until(100.0)
    for request, reason in (
        (ReconfigurationRequest("moon", 4560.0), "no formation 'moon'; there are: row, circle"),
        (ReconfigurationRequest("circle", 100.0), "duration: 100 s; the lead time and one step"),
        (
            ReconfigurationRequest("circle", 1e6),
            "duration: 1e\\+06 s; plans have at most 240 steps",
        ),
        (
            ReconfigurationRequest("circle", 4560.0, passive_safety_orbits=1e9),
            "passive_safety_orbits: 1e\\+09; a drift is followed for at most 240 steps",
        ),
        (ReconfigurationRequest("nowhere", 4560.0), "acceleration_cap: .* allowed .* needed"),
        (ReconfigurationRequest("collision", 4560.0), "closest_approach: 10.2 m wanted, but"),
        (ModeRequest("phase", angle_deg=10.0, orbits=15.0), "impossible with 1.56e-05 m/s2"),
        (ModeRequest("keep", "moon"), "no formation 'moon'"),
    ):
        with pytest.raises(RequestError, match=reason):
            flight.guidance.request(request)
        assert flight.step().reason
        assert flight.results[-1].mode == "keep"
    running = flight.guidance.request(ReconfigurationRequest("circle", 4560.0))
    assert flight.step().mode == "reconfigure"
    for request in (ReconfigurationRequest("row", 4560.0), ModeRequest("keep", "row")):
        with pytest.raises(RequestError, match="refused: a reconfiguration to 'circle' runs for"):
            flight.guidance.request(request)
    # A preempting goal that is impossible leaves the last safe plan, too.
    with pytest.raises(RequestError, match="impossible: acceleration_cap"):
        flight.guidance.request(ReconfigurationRequest("nowhere", 4560.0, preempt=True))
    assert flight.guidance.reconfiguration is running
    assert not running.finished


def test_preempting_goal_turns_back_from_the_middle_of_a_plan():
    flight = Flight()
    flight.step()
    first = flight.guidance.request(ReconfigurationRequest("circle", 4560.0))
    flight.until(1500.0)
    second = flight.guidance.request(ReconfigurationRequest("row", 4560.0, preempt=True))
    assert first.finished
    assert not first.success
    assert "preempted by a reconfiguration to 'row'" in first.message
    flight.until(6200.0)
    assert second.success
    assert flight.closest() >= 10.0
    separation = np.array(flight.positions[-1])
    np.testing.assert_allclose(separation[1] - separation[2], [0.0, 50.0, 0.0], atol=0.3)


@pytest.mark.parametrize("mode", ["free_drift", "abort"])
def test_thrust_ends_at_once_in_the_middle_of_a_plan(mode):
    flight = Flight()
    flight.step()
    followed = flight.guidance.request(ReconfigurationRequest("circle", 4560.0))
    flight.until(400.0)
    assert np.array(flight.thrust).any()
    flight.guidance.request(ModeRequest(mode))
    assert followed.message == f"ended by mode {mode}"
    burnt = len(flight.thrust)
    flight.until(800.0)
    assert not np.array(flight.thrust[burnt:]).any()
    assert flight.results[-1].mode == mode
    # A later request is met from where the drift has led.
    flight.guidance.request(ModeRequest("hold"))
    assert flight.step().mode == "hold"


def test_hold_keeps_the_elements_of_the_moment():
    flight = Flight("circle").until(200.0)
    flight.guidance.request(ModeRequest("hold"))
    flight.until(7000.0)
    # From then on what the change of mode has stirred is over.
    positions, targets = (np.array(of[250:]) for of in (flight.positions, flight.targets))
    deviation = positions - targets
    assert np.linalg.norm(deviation, axis=2).max() < 0.15
    assert flight.closest() > 20.0


@pytest.mark.parametrize("size", [1e-300, 1e300])
@pytest.mark.parametrize(
    "field",
    ["angle_deg", "orbits", "duration", "closest_approach", "acceleration_cap",
     "passive_safety_orbits"],
)  # fmt: skip
def test_goals_of_any_size_are_answered(field, size):
    """A client may send any number; a refusal is a line, and the guidance goes on."""
    flight = Flight("circle").until(100.0)
    with contextlib.suppress(RequestError):
        if field in ("angle_deg", "orbits"):
            asked = {"angle_deg": 1e-4, "orbits": 1.0, field: size}
            flight.guidance.request(ModeRequest("phase", **asked))
        else:
            asked = {"duration": 4560.0, field: size}
            flight.guidance.request(ReconfigurationRequest("circle", **asked))
    flight.step()


def test_phasing_moves_the_whole_formation_and_no_pair():
    flight = Flight("circle").until(100.0)
    # The thrust of keeping that is under way ends first.
    flight.guidance.request(ModeRequest("free_drift"))
    flight.until(140.0)
    flight.guidance.request(ModeRequest("phase", angle_deg=0.0005, orbits=1.0))
    start, before = flight.time, flight.states.ravel()
    while flight.step().mode == "phase":
        assert flight.time < 6500.0
    # Now that it is over, keeping goes on; none of its thrust has acted yet.
    drift = solve_ivp(
        rates,
        (start, flight.time),
        before,
        "DOP853",
        args=(np.zeros((3, 3)),),
        rtol=1e-11,
        atol=1e-6,
    )
    without = drift.y[:, -1].reshape(3, 6)
    moved = relative_state_rtn(without[0], flight.states[0])
    assert moved[1] == pytest.approx(math.radians(0.0005) * 7.1531e6, rel=0.03)
    for craft in (1, 2):
        with_phasing, without_phasing = (
            relative_state_rtn(states[0], states[craft])[:3] for states in (flight.states, without)
        )
        np.testing.assert_allclose(with_phasing, without_phasing, atol=0.05)
    assert flight.results[-1].mode == "keep"


def test_jump_back_begins_anew():
    flight = Flight().until(100.0)
    flight.guidance.request(ReconfigurationRequest("circle", 4560.0))
    flight.guidance.reset()
    assert flight.guidance.reconfiguration is None
    assert flight.step().mode == "keep"


def test_results_that_cannot_be_published_are_refused():
    result = Flight().step()
    target = result.targets["bravo"]
    for targets, reason in (
        ({"alpha": target}, "no SpacecraftTarget for bravo"),
        (
            {**result.targets, "bravo": replace(target, relative_state=np.zeros(3))},
            "relative_state of bravo: 6 numbers expected, got shape \\(3,\\)",
        ),
        (
            {**result.targets, "charlie": replace(target, acceleration_rtn=np.full(3, np.nan))},
            "acceleration_rtn of charlie: not finite",
        ),
    ):
        with pytest.raises(ValueError, match=reason):
            check_guidance_result(replace(result, targets=targets), NAMES)
    with pytest.raises(ValueError, match="GuidanceResult is expected, got NoneType"):
        check_guidance_result(None, NAMES)


def test_a_request_may_bring_its_own_designs():
    flight = Flight()
    flight.until(100.0)
    designs = {name: 1.1 * design for name, design in FORMATIONS["circle"].items()}
    for wrong, reason in (
        ({"alpha": np.zeros(6)}, "one for each of alpha, bravo, charlie"),
        ({name: np.zeros(5) for name in NAMES}, "six numbers expected for alpha"),
    ):
        with pytest.raises(RequestError, match=reason):
            flight.guidance.request(ReconfigurationRequest("own", 4560.0, designs=wrong))
    followed = flight.guidance.request(ReconfigurationRequest("own", 4560.0, designs=designs))
    assert followed.flight.formation == "own"
    # It has a name from now on.
    flight.guidance.request(ModeRequest("free_drift"))
    flight.guidance.request(ModeRequest("keep", "own"))
    assert flight.step().formation == "own"


def test_a_loss_of_thrust_kilometres_apart_is_safe_in_true_motion():
    """13 km back to an ellipse of 2.8 km: by linear motion 303 m after any loss, truly 36 m."""
    chief = np.array([-386596.0, -6768486.0, 69961.74, 7546.335, -448.9027, -1307.478])
    relative = np.array([-318.5256, 13003.52, 35.10554, -1.405465, -0.2164043, -0.2127499])
    design = np.array([0.0, 4000.0, 2631.139338, -957.656401, 197.33545, -71.82423])
    setting = GuidanceSetting(
        "alpha", ("bravo",), 10.0, engine=KeepingEngine(1.0, 1e-4, 1e-4), mass=100.0
    )
    guidance = FormationGuidance(
        setting, FormationGuidanceParameters(closest_approach=100.0, tracking_bandwidth=1e-3)
    )
    guidance.step(FormationState(10**18, chief, {"bravo": relative}, {}))
    asked = ReconfigurationRequest(
        "ellipse",
        5820.0,
        passive_safety_orbits=2.0,
        designs={"alpha": np.zeros(6), "bravo": design},
    )
    flight = guidance.request(asked).flight
    states = np.array([chief, deputy_state_gcrf(chief, relative)])
    start = solve_ivp(rates, (0.0, flight.start), states.ravel(), "DOP853", args=(0.0,), rtol=1e-10)
    flown = flight.rehearse(start.y[:, -1].reshape(2, 6), 1e-2, 10.0)
    for loss in (flown[30], flown[44], flown[46]):
        drift = solve_ivp(
            rates,
            (0.0, 11200.0),
            loss.ravel(),
            "DOP853",
            t_eval=np.arange(0.0, 11200.0, 20.0),
            args=(0.0,),
            rtol=1e-10,
        )
        assert closest_on_path(drift.y[6:9].T - drift.y[:3].T) > 100.0

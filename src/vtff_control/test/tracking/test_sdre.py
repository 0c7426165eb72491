"""The SDRE controller: designs, gain keeping, feedforward and refusal of unusable input."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtff_control.tracking.controller import takes_covariance
from vtff_control.tracking.feedforward import target_acceleration, velocity_at_rest
from vtff_control.tracking.riccati import delayed_riccati_gain, discretise, riccati_gain
from vtff_control.tracking.sdre import (
    DEFAULT_WEIGHTS,
    DESIGNS,
    SdreController,
    SdreDesign,
    stale_state_reason,
)
from vtff_dynamics.constants import GM_EARTH, J2_EARTH
from vtff_dynamics.frames.rtn import deputy_state_gcrf, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.elements import ClassicalElements, osculating_mean_motion
from vtff_dynamics.orbit.gravity import gravity_acceleration, predict_state
from vtff_dynamics.relative.motion import (
    frame_rates_rtn,
    hcw_state_matrix,
    relative_acceleration,
)

CHIEF = ClassicalElements(6928137.0, 1e-9, np.pi / 3.0, 0.0, 0.0, 0.0).to_state()
ECCENTRIC = ClassicalElements(6880540.0, 0.044, 0.17, 4.5, np.pi, -1.3).to_state()
TARGET = np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0])
NEAR = TARGET + np.array([0.3, -0.2, 0.1, 0.004, -0.002, 0.001])


def test_paper_design_is_the_riccati_feedback_of_hcw() -> None:
    controller = SdreController(SdreDesign("paper"))
    result = controller.control(NEAR, CHIEF, TARGET)
    mean_motion = np.sqrt(GM_EARTH / 6928137.0**3)
    gain = riccati_gain(hcw_state_matrix(mean_motion), DEFAULT_WEIGHTS["paper"])
    assert result.valid and not result.saturated and result.reason == ""
    np.testing.assert_allclose(result.acceleration_rtn, -gain @ (NEAR - TARGET), rtol=1e-9)


def test_delay_aware_counts_the_commands_that_wait() -> None:
    design = SdreDesign("delay_aware", acceleration_cap=10.0, delay_steps=2)
    controller = SdreController(design)
    mean_motion = osculating_mean_motion(CHIEF)
    gain = delayed_riccati_gain(hcw_state_matrix(mean_motion), design.weights, 1.0, 2)
    waiting = [np.zeros(3), np.zeros(3)]
    for step in range(4):
        command = controller.control(NEAR, CHIEF, TARGET, step * 10**9).acceleration_rtn
        expected = -gain @ np.concatenate((NEAR - TARGET, *waiting))
        np.testing.assert_allclose(command, expected, rtol=1e-9)
        waiting = [waiting[1], command]


def test_fast_sampling_without_delay_is_the_continuous_feedback() -> None:
    gain = riccati_gain(
        hcw_state_matrix(osculating_mean_motion(CHIEF)), SdreDesign("delay_aware").weights
    )
    expected = -gain @ (NEAR - TARGET)
    differences = []
    for sample_time in (0.1, 0.01):
        design = SdreDesign(
            "delay_aware", acceleration_cap=10.0, sample_time=sample_time, delay_steps=0
        )
        command = SdreController(design).control(NEAR, CHIEF, TARGET).acceleration_rtn
        differences.append(float(np.linalg.norm(command - expected) / np.linalg.norm(expected)))
    # The difference is of the first order in the sample time.
    assert differences[0] < 0.1
    assert differences[1] == pytest.approx(0.1 * differences[0], rel=0.2)


def test_a_gap_in_the_stamps_empties_the_queue() -> None:
    controller = SdreController(SdreDesign("delay_aware"))
    first = controller.control(NEAR, CHIEF, TARGET, 0).acceleration_rtn
    second = controller.control(NEAR, CHIEF, TARGET, 10**9).acceleration_rtn
    after_gap = controller.control(NEAR, CHIEF, TARGET, 5 * 10**9).acceleration_rtn
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(first, after_gap)


def test_state_dependent_design_approaches_paper_design_at_the_chief() -> None:
    near_chief = np.array([0.1, 0.2, -0.1, 0.0, 0.0, 0.0])
    commands = [
        SdreController(SdreDesign(name)).control(near_chief, CHIEF, np.zeros(6)).acceleration_rtn
        for name in ("paper", "state_dependent")
    ]
    np.testing.assert_allclose(commands[0], commands[1], rtol=1e-6, atol=1e-12)


def test_gain_is_kept_until_the_orbit_changes() -> None:
    controller = SdreController(SdreDesign("paper"))
    for factor in (1.0, 1.0 + 1e-3, 1.0 - 1e-3):
        controller.control(NEAR, CHIEF * factor, TARGET)
    assert controller.gain_solutions == 1
    first = controller.gain
    higher = ClassicalElements(7500e3, 0.0, 1.0, 0.0, 0.0, 0.0).to_state()
    controller.control(NEAR, higher, TARGET)
    assert controller.gain_solutions == 2
    assert first is not None and not np.array_equal(first, controller.gain)


def test_given_mean_motion_fixes_the_gain() -> None:
    controller = SdreController(SdreDesign("paper", mean_motion=1.1e-3))
    for state in (CHIEF, ECCENTRIC, CHIEF * 1.05):
        controller.control(NEAR, state, TARGET)
    assert controller.gain_solutions == 1


def test_state_dependent_gain_is_solved_at_every_step() -> None:
    controller = SdreController(SdreDesign("state_dependent"))
    for _ in range(3):
        controller.control(NEAR, CHIEF, TARGET)
    assert controller.gain_solutions == 3


@pytest.mark.parametrize("design", DESIGNS)
def test_command_is_capped_on_each_axis(design: str) -> None:
    controller = SdreController(SdreDesign(design, acceleration_cap=(0.1, 0.2, 5.0)))
    far = np.array([500.0, -900.0, 10.0, 0.0, 0.0, 0.0])
    result = controller.control(far, CHIEF, TARGET)
    assert result.saturated and result.valid
    np.testing.assert_array_equal(result.acceleration_rtn[:2], [-0.1, 0.2])
    assert -5.0 < result.acceleration_rtn[2] < 0.0


def inertial_state_at_rest(
    state_chief: np.ndarray, position_rtn: np.ndarray, **gravity: float
) -> np.ndarray:
    """Inertial state of a point fixed in the RTN axes, its velocity by differences in time."""

    def place(offset: float) -> np.ndarray:
        state = predict_state(state_chief, offset, **gravity)
        return state[:3] + rotation_gcrf_to_rtn(state).T @ position_rtn

    step = 0.1
    velocity = (8.0 * (place(step) - place(-step)) - place(2 * step) + place(-2 * step)) / 12.0
    return np.concatenate((place(0.0), velocity / step))


@pytest.mark.parametrize("gravity", ["two_body", "j2"])
def test_feedforward_holds_a_deputy_at_rest(gravity: str) -> None:
    """Over the step in which it acts, the command leaves the deputy where it is."""
    target = np.array([-1000.0, -15000.0, 300.0, 0.0, 0.0, 0.0])
    j2 = {} if gravity == "j2" else {"j2": 0.0}
    acceleration = target_acceleration(ECCENTRIC, target, 1, 1.0, j2.get("j2", J2_EARTH))

    def deputy_at_rest(state_chief: np.ndarray) -> np.ndarray:
        return inertial_state_at_rest(state_chief, target[:3], **j2)

    start = predict_state(ECCENTRIC, 1.0, **j2)
    held = rotation_gcrf_to_rtn(start).T @ acceleration
    state = deputy_at_rest(start)
    for _ in range(100):
        middle = state[:3] + 0.005 * state[3:]
        change = held + gravity_acceleration(middle, **j2)
        state = np.concatenate(
            (state[:3] + 0.01 * state[3:] + 0.5e-4 * change, state[3:] + 0.01 * change)
        )
    error = state - deputy_at_rest(predict_state(ECCENTRIC, 2.0, **j2))
    # The thrust itself moves it by 2 mm and 4 mm/s.
    assert np.linalg.norm(error[:3]) < 2e-6
    assert np.linalg.norm(error[3:]) < 2e-6


def test_a_deputy_on_its_target_gets_the_feedforward_alone() -> None:
    """A waiting command that holds the target is no deviation."""
    target = np.array([-1000.0, -15000.0, 0.0, 0.0, 0.0, 0.0])
    design = SdreDesign("delay_aware", feedforward=True, feedforward_gravity="two_body")
    controller = SdreController(design)
    held = target_acceleration(ECCENTRIC, target, 1, 1.0, 0.0)
    for step in range(4):
        result = controller.control(target, ECCENTRIC, target, step * 10**9)
        np.testing.assert_allclose(result.acceleration_rtn, held, rtol=1e-12)
    assert np.linalg.norm(held) > 1e-3


@pytest.mark.parametrize(("gravity", "j2"), [("two_body", 0.0), ("j2", J2_EARTH)])
@pytest.mark.parametrize("delay_steps", [0, 1, 2])
def test_gravity_and_delay_of_a_design_reach_the_feedforward(
    gravity: str, j2: float, delay_steps: int
) -> None:
    target = np.array([-1000.0, -15000.0, 2000.0, 0.0, 0.0, 0.0])
    design = SdreDesign(
        "delay_aware", feedforward=True, feedforward_gravity=gravity, delay_steps=delay_steps
    )
    controller = SdreController(design)
    at_rest = target + np.concatenate((np.zeros(3), velocity_at_rest(ECCENTRIC, target[:3], j2)))
    held = target_acceleration(ECCENTRIC, target, delay_steps, 1.0, j2)
    for step in range(4):
        result = controller.control(at_rest, ECCENTRIC, target, step * 10**9)
    np.testing.assert_allclose(result.acceleration_rtn, held, rtol=1e-9)


def test_feedforward_follows_a_moving_target() -> None:
    target = np.array([-1000.0, -15000.0, 300.0, 2.0, -3.0, 1.0])
    acceleration = target_acceleration(ECCENTRIC, target, 0, 1.0, 0.0)
    rates = frame_rates_rtn(ECCENTRIC)
    natural = relative_acceleration(
        target,
        float(np.linalg.norm(ECCENTRIC[:3])),
        rates.angular_velocity_rtn[2],
        rates.angular_acceleration_rtn[2],
    )
    # Half a second apart; the Coriolis part is 7e-3 m/s2.
    np.testing.assert_allclose(acceleration, -natural, atol=2e-5)


def test_feedforward_knows_how_rest_is_reported() -> None:
    target = np.array([0.0, -15000.0, 0.0, 0.0, 0.0, 0.0])
    polar = ClassicalElements(6928137.0, 1e-3, 1.2, 0.3, 0.1, 0.9).to_state()
    reported = velocity_at_rest(polar, target[:3], J2_EARTH)
    deputy = deputy_state_gcrf(polar, np.concatenate((target[:3], reported)))
    np.testing.assert_allclose(deputy, inertial_state_at_rest(polar, target[:3]), atol=1e-6)
    assert abs(reported[2]) > 1e-3


def covariance(position_sigma: float, velocity_sigma: float) -> np.ndarray:
    return np.diag([position_sigma**2] * 3 + [velocity_sigma**2] * 3)


CLOSING = np.array([0.0, 300.0, 0.0, 0.0, -20.0, 0.0])


@pytest.mark.parametrize("design", DESIGNS)
def test_a_good_covariance_changes_no_command_of_the_paper(design: str) -> None:
    """Neither does a poor one within the bounds, unless the bandwidth is told to follow it."""
    expected = SdreController(SdreDesign(design)).control(CLOSING, CHIEF, TARGET)
    for sigma in (1e-3, 50.0):
        result = SdreController(SdreDesign(design)).control(
            CLOSING, CHIEF, TARGET, None, covariance(sigma, 0.01 * sigma)
        )
        assert result.degraded == ""
        np.testing.assert_array_equal(result.acceleration_rtn, expected.acceleration_rtn)


@pytest.mark.parametrize("design", DESIGNS)
def test_out_of_bounds_the_deputy_brakes(design: str) -> None:
    controller = SdreController(SdreDesign(design, acceleration_cap=1.4))
    result = controller.control(CLOSING, CHIEF, TARGET, None, covariance(90.0, 5.0))
    assert result.valid and "0.25 of the distance of 300 m" in result.degraded
    # Brakes at the cap, although the target is nearer to the chief.
    assert result.acceleration_rtn[1] == 1.4
    controller.reset()
    # Receding by two sigma, less what the sigma of the position takes off: nothing to do.
    receding = np.array([0.0, 300.0, 0.0, 0.0, 2.0 * 5.0 * (1.0 - 90.0 / 300.0), 0.0])
    result = controller.control(receding, CHIEF, TARGET, None, covariance(90.0, 5.0))
    np.testing.assert_allclose(result.acceleration_rtn, 0.0, atol=1e-12)
    assert result.degraded and controller.control(receding, CHIEF, TARGET).degraded == ""


def test_an_unusable_covariance_is_refused() -> None:
    result = SdreController(SdreDesign()).control(
        NEAR, CHIEF, TARGET, None, np.full((6, 6), np.nan)
    )
    assert not result.valid and result.reason == "covariance: not finite"


def test_the_mean_of_rounded_commands_is_exact() -> None:
    design = SdreDesign("paper", quantum=1e-5)
    controller = SdreController(design)
    exact = SdreController(SdreDesign("paper"))
    state = TARGET + np.array([1e-4, -3e-4, 2e-4, 0.0, 0.0, 0.0])
    given = [controller.control(state, CHIEF, TARGET).acceleration_rtn for _ in range(500)]
    counts = np.array(given) / 1e-5
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    expected = exact.control(state, CHIEF, TARGET).acceleration_rtn
    assert np.abs(expected).max() < 1e-5, "a thruster that rounds would give nothing"
    np.testing.assert_allclose(np.mean(given, axis=0), expected, atol=1e-5 / 500)


def test_what_the_cap_cuts_off_is_not_made_up_for() -> None:
    controller = SdreController(SdreDesign("paper", quantum=1e-2))
    for _ in range(50):
        controller.control(CLOSING + [0.0, 1e4, 0.0, 0.0, 0.0, 0.0], CHIEF, TARGET)
    result = controller.control(TARGET, CHIEF, TARGET)
    assert np.abs(result.acceleration_rtn).max() <= 1e-2


def test_the_braking_share_limits_the_speed_to_what_can_be_stopped() -> None:
    """At the speed from which 0.6 of the cap stops before the target, no more is accelerated."""
    design = SdreDesign("paper", acceleration_cap=1.4, braking_share=0.6)
    far = np.array([0.0, 10_100.0, 0.0, 0.0, 0.0, 0.0])
    speed = np.sqrt(2.0 * 0.6 * 1.4 * 10_000.0)
    for factor, sign in ((0.9, -1.0), (1.1, 1.0)):
        state = far + [0.0, 0.0, 0.0, 0.0, -factor * speed, 0.0]
        command = SdreController(design).control(state, CHIEF, TARGET).acceleration_rtn
        assert np.sign(command[1]) == sign
    near = TARGET + [0.0, 5.0, 0.0, 0.0, -0.1, 0.0]
    linear = dataclasses.replace(design, braking_share=0.0)
    np.testing.assert_array_equal(
        SdreController(design).control(near, CHIEF, TARGET).acceleration_rtn,
        SdreController(linear).control(near, CHIEF, TARGET).acceleration_rtn,
    )


def test_a_disturbance_is_compensated() -> None:
    design = SdreDesign("delay_aware", disturbance_observer=True, delay_steps=1)
    controller = SdreController(design)
    mean_motion = osculating_mean_motion(CHIEF)
    transition, effect = discretise(hcw_state_matrix(mean_motion), 1.0)
    push = np.array([4e-6, -6e-6, 2e-6])
    deviation, acting = np.zeros(6), np.zeros(3)
    for step in range(400):
        result = controller.control(TARGET + deviation, CHIEF, TARGET, step * 10**9)
        deviation = transition @ deviation + effect @ (acting + push)
        acting = result.acceleration_rtn
    np.testing.assert_allclose(controller.disturbance_rtn, push, atol=1e-7)
    assert np.abs(deviation[:3]).max() < 2e-5
    without = np.abs(push).max() / 1e-2
    assert without > 5e-4


def test_a_new_target_is_no_disturbance() -> None:
    controller = SdreController(SdreDesign("delay_aware", disturbance_observer=True))
    for step in range(50):
        target = TARGET if step < 25 else TARGET + [0.0, 50.0, 0.0, 0.0, 0.0, 0.0]
        controller.control(TARGET, CHIEF, target, step * 10**9)
        if step == 25:
            # A new deviation is taken as it is, not as an error of the model.
            assert np.abs(controller.disturbance_rtn).max() < 1e-7


UNUSABLE = [
    (np.full(6, np.nan), CHIEF, TARGET, "relative state: not finite"),
    (NEAR, np.full(6, np.inf), TARGET, "chief state: not finite"),
    (NEAR, CHIEF, np.array([0, np.nan, 0, 0, 0, 0]), "target: not finite"),
    (NEAR[:5], CHIEF, TARGET, "relative state: shape"),
    ("state", CHIEF, TARGET, "relative state: not numeric"),
    (NEAR, np.zeros(6), TARGET, "chief state: inside the Earth"),
    (NEAR, CHIEF / 1000.0, TARGET, "inside the Earth"),
    (NEAR, CHIEF * np.array([1, 1, 1, 2, 2, 2]), TARGET, "not on an elliptic orbit"),
    (None, None, None, "relative state: "),
]


@pytest.mark.parametrize(("relative", "chief", "target", "reason"), UNUSABLE)
def test_unusable_input_gives_no_thrust_and_a_reason(
    relative: object, chief: object, target: object, reason: str
) -> None:
    controller = SdreController(SdreDesign())
    result = controller.control(relative, chief, target)  # type: ignore[arg-type]
    assert not result.valid and not result.saturated
    assert reason in result.reason and "\n" not in result.reason
    np.testing.assert_array_equal(result.acceleration_rtn, np.zeros(3))
    assert controller.control(NEAR, CHIEF, TARGET).valid, "it recovers by itself"


@pytest.mark.parametrize("design", DESIGNS)
def test_parallel_position_and_velocity_is_refused_where_a_frame_is_needed(design: str) -> None:
    falling = np.array([7e6, 0.0, 0.0, 100.0, 0.0, 0.0])
    result = SdreController(SdreDesign(design, feedforward=True)).control(NEAR, falling, TARGET)
    assert not result.valid and result.reason


def test_riccati_failure_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise np.linalg.LinAlgError("no stabilising\nsolution")

    monkeypatch.setattr("vtff_control.tracking.sdre.riccati_gain", fail)
    result = SdreController(SdreDesign()).control(NEAR, CHIEF, TARGET)
    assert not result.valid and result.reason == "no stabilising solution"


ANY_NUMBERS = st.lists(st.floats(), min_size=0, max_size=8)
ANY_STATE = st.one_of(
    ANY_NUMBERS,
    st.lists(st.floats(-1e8, 1e8), min_size=6, max_size=6),
    st.none(),
    st.text(max_size=3),
    st.lists(st.lists(st.integers(), max_size=3), max_size=3),
)


@settings(max_examples=150)
@given(ANY_STATE, ANY_STATE, ANY_STATE, st.sampled_from(DESIGNS), st.booleans(), st.booleans())
def test_control_never_raises_and_never_exceeds_the_cap(
    relative: object, chief: object, target: object, design: str, usual: bool, feedforward: bool
) -> None:
    controller = SdreController(SdreDesign(design, 0.7, feedforward))
    for state in (chief, CHIEF) if usual else (chief,):
        result = controller.control(relative, state, target)  # type: ignore[arg-type]
        assert np.all(np.abs(result.acceleration_rtn) <= 0.7)
        assert result.valid == (result.reason == "")
        assert result.valid or not result.acceleration_rtn.any()
    assert controller.control(NEAR, CHIEF, TARGET).valid


def test_same_calls_give_the_same_bits() -> None:
    controllers = [SdreController(SdreDesign("delay_aware", feedforward=True)) for _ in range(2)]
    rng = np.random.default_rng(3)
    for step in range(20):
        state = TARGET + rng.normal(size=6)
        first, second = (c.control(state, ECCENTRIC, TARGET, step * 10**9) for c in controllers)
        assert first.acceleration_rtn.tobytes() == second.acceleration_rtn.tobytes()


class FourArguments:
    def reset(self) -> None:
        """Forget nothing."""

    def control(self, relative_state_rtn, state_chief_gcrf, target_rtn, stamp=None):  # type: ignore[no-untyped-def]
        """Command nothing."""


def test_a_controller_that_takes_no_covariance_is_seen() -> None:
    assert takes_covariance(SdreController(SdreDesign()))
    assert not takes_covariance(FourArguments())


def test_stale_states_are_told_apart() -> None:
    second = 10**9
    assert stale_state_reason(100 * second, 101 * second, 1.5) == ""
    assert "3.000 s old" in stale_state_reason(98 * second, 101 * second, 1.5)
    assert "ahead" in stale_state_reason(110 * second, 101 * second, 1.5)


WRONG = {
    "design": ["lqr", ""],
    "feedforward_gravity": ["j4"],
    "acceleration_cap": [0.0, -1.0, float("nan"), (1.0, 2.0), (1.0, 0.0, 1.0)],
    "position_weight": [0.0, float("inf")],
    "velocity_weight": [-1.0],
    "control_weight": [float("nan")],
    "sample_time": [0.0, float("inf")],
    "delay_steps": [-1, 1.5, True, 101],
    "mean_motion": [0.0],
    "tolerated_deviation": [-1.0, float("nan")],
    "braking_share": [-0.1, 1.1],
    "quantum": [-1e-5, 2.0],
    "maximum_sigma": [-1.0],
    "maximum_sigma_ratio": [float("inf")],
}


@pytest.mark.parametrize(
    ("name", "value"), list(itertools.chain(*([(n, v) for v in vs] for n, vs in WRONG.items())))
)
def test_wrong_parameters_are_named(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        dataclasses.replace(SdreDesign(), **{name: value})

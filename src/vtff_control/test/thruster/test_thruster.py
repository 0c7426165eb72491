"""The thruster without a bus: delay, cap, quantum and refusal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vtff_control.thruster.thruster import Thruster

SECOND = 10**9


@pytest.mark.parametrize(("delay_steps", "step"), [(0, 1.0), (1, 1.0), (3, 0.1)])
def test_command_starts_after_whole_steps(delay_steps: int, step: float) -> None:
    thruster = Thruster(delay_steps=delay_steps, step=step)
    stamp = 1_458_521_983 * SECOND
    applied = thruster.command(stamp, [0.1, 0.0, -0.1])
    assert applied.start_stamp == stamp + delay_steps * round(step * SECOND)


def test_without_quantum_a_command_within_the_cap_is_untouched() -> None:
    command = np.array([0.1234567890123, -1.4, 1e-9])
    applied = Thruster(1.4).command(0, command)
    np.testing.assert_array_equal(applied.acceleration_rtn, command)
    assert not applied.saturated and applied.reason == ""


def test_cap_holds_on_each_axis() -> None:
    applied = Thruster((1.0, 2.0, 3.0)).command(0, [5.0, -5.0, 2.5])
    np.testing.assert_array_equal(applied.acceleration_rtn, [1.0, -2.0, 2.5])
    assert applied.saturated


@pytest.mark.parametrize(
    ("wanted", "given_by_thruster"),
    [(0.04, 0.0), (0.06, 0.1), (-0.06, -0.1), (0.24, 0.2), (0.36, 0.4), (9.0, 1.4), (-9.0, -1.4)],
)
def test_command_is_rounded_to_the_nearest_quantum(wanted: float, given_by_thruster: float) -> None:
    thruster = Thruster(1.4, quantum=0.1)
    applied = thruster.command(0, [wanted, 0.0, 0.0]).acceleration_rtn
    np.testing.assert_allclose(applied, [given_by_thruster, 0.0, 0.0], atol=1e-15)


def test_a_tie_goes_to_the_even_multiple() -> None:
    applied = Thruster(2.0, quantum=0.25).command(0, [0.125, 0.375, -0.625]).acceleration_rtn
    np.testing.assert_array_equal(applied, [0.0, 0.5, -0.5])


def test_rounding_never_exceeds_the_cap() -> None:
    applied = Thruster(0.95, quantum=0.2).command(0, [0.95, -0.94, 0.74])
    np.testing.assert_allclose(applied.acceleration_rtn, [0.8, -0.8, 0.8], atol=1e-15)


def test_no_thrust_has_no_sign() -> None:
    applied = Thruster(1.0, quantum=0.1).command(0, [-0.0, -0.01, 0.01]).acceleration_rtn
    assert applied.tobytes() == np.zeros(3).tobytes()


@pytest.mark.parametrize(
    "command", [[np.nan, 0, 0], [0, np.inf, 0], [0, 0], [[0, 0, 0]], "none", None, [1, "a", 2]]
)
def test_unusable_command_gives_nothing_and_a_reason(command: object) -> None:
    applied = Thruster().command(7, command)  # type: ignore[arg-type]
    np.testing.assert_array_equal(applied.acceleration_rtn, np.zeros(3))
    assert applied.reason.startswith("thrust command: ") and not applied.saturated
    assert applied.start_stamp == 7 + SECOND


@given(
    st.lists(st.floats(), min_size=3, max_size=3),
    st.floats(1e-3, 20.0),
    st.one_of(st.just(0.0), st.floats(1e-4, 5.0)),
)
def test_thrust_is_within_the_cap_and_a_multiple_of_the_quantum(
    command: list[float], cap: float, quantum: float
) -> None:
    applied = Thruster(cap, quantum).command(0, command).acceleration_rtn
    assert np.all(np.isfinite(applied))
    assert np.all(np.abs(applied) <= cap * (1.0 + 1e-12))
    if quantum:
        multiple = applied / quantum
        np.testing.assert_allclose(multiple, np.rint(multiple), rtol=1e-12, atol=1e-12)
        usable = np.all(np.isfinite(command)) and np.all(np.abs(command) <= cap - quantum)
        if usable:
            assert np.all(np.abs(applied - command) <= 0.5 * quantum * (1.0 + 1e-9))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("acceleration_cap", 0.0),
        ("acceleration_cap", (1.0, 2.0)),
        ("quantum", -0.1),
        ("quantum", float("nan")),
        ("delay_steps", -1),
        ("delay_steps", 1.0),
        ("step", 0.0),
    ],
)
def test_wrong_parameters_are_named(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"^{name}: "):
        Thruster(**{name: value})  # type: ignore[arg-type]


def test_a_stuck_axis_gives_what_it_is_stuck_at_until_it_is_isolated():
    thruster = Thruster(1.0, stuck_acceleration=(0.0, -0.4, 0.0), stuck_after=2.0)
    given = [thruster.command(k * 10**9, (0.1, 0.2, 0.0)).acceleration_rtn for k in range(3)]
    np.testing.assert_array_equal(given[1], [0.1, 0.2, 0.0])
    np.testing.assert_array_equal(given[2], [0.1, -0.4, 0.0])
    thruster.isolated = np.array([False, True, False])
    np.testing.assert_array_equal(
        thruster.command(3 * 10**9, (0.1, 0.2, 0.0)).acceleration_rtn, [0.1, 0.0, 0.0]
    )
    with pytest.raises(ValueError, match="stuck_acceleration: three numbers"):
        Thruster(1.0, stuck_acceleration=(1.0,))

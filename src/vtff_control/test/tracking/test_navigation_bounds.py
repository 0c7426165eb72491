"""States judged by their covariance: bounds on sigma, and the velocity beyond its own sigma."""

import numpy as np
import pytest

from vtff_control.tracking.navigation_bounds import (
    sigma_reason,
    significant_velocity,
    unsafe_velocity,
    usable_covariance,
)

STATE = np.array([0.0, 100.0, 0.0, 0.0, -2.0, 0.0])


def covariance(position_sigma: float, velocity_sigma: float) -> np.ndarray:
    return np.diag([position_sigma**2] * 3 + [velocity_sigma**2] * 3)


@pytest.mark.parametrize(
    ("sigma", "reason"),
    [
        (24.9, ""),
        (25.1, "25.1 m, more than 0.25 of the distance of 100 m"),
        (41.0, "41 m, more than 40 m"),
    ],
)
def test_sigma_is_bounded_in_itself_and_by_the_distance(sigma: float, reason: str) -> None:
    found = sigma_reason(STATE, covariance(sigma, 1.0), 40.0, 0.25)
    assert (reason in found) if reason else not found


def test_the_worst_direction_counts() -> None:
    direction = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    matrix = covariance(1.0, 1.0)
    matrix[:3, :3] += 30.0**2 * np.outer(direction, direction)
    assert "sigma of the position is 30 m" in sigma_reason(STATE, matrix, 100.0, 0.25)


def test_no_sigma_is_small_enough_on_the_chief() -> None:
    assert sigma_reason(np.zeros(6), covariance(1e-3, 1e-3), 100.0, 0.25)


def test_only_the_velocity_above_its_sigma_is_significant() -> None:
    np.testing.assert_allclose(
        significant_velocity(STATE[3:], covariance(1.0, 0.5)), [0.0, -1.5, 0.0]
    )
    np.testing.assert_array_equal(significant_velocity(STATE[3:], covariance(1.0, 2.5)), 0.0)
    np.testing.assert_array_equal(significant_velocity(np.zeros(3), covariance(1.0, 0.0)), 0.0)


@pytest.mark.parametrize("sigma", [0.5, 1.5, 8.0])
def test_removing_it_never_makes_the_expected_velocity_larger(sigma: float) -> None:
    """The true velocity is drawn about the estimate, as an honest covariance says."""
    draws = STATE[3:] + sigma * np.random.default_rng(5).standard_normal((4000, 3))
    removed = significant_velocity(STATE[3:], covariance(1.0, sigma))
    coasting = np.mean(np.sum(draws**2, axis=1))
    braking = np.mean(np.sum((draws - removed) ** 2, axis=1))
    assert braking < coasting if sigma < 2.0 else braking == coasting


def test_the_deputy_is_left_receding_from_the_chief() -> None:
    """By two sigma where it surely is on its side, by none where nobody knows."""
    near = np.array([0.0, -100.0, 0.0, 0.0, 0.0, 0.0])
    for sigma, expected in ((0.0, 1.0), (50.0, 0.5), (100.0, 0.0), (500.0, 0.0)):
        left = near[3:] - unsafe_velocity(near, covariance(sigma, 0.7))
        np.testing.assert_allclose(left, [0.0, -2.0 * 0.7 * expected, 0.0], atol=1e-12)
    drifting = np.array([0.0, -100.0, 0.0, 3.0, 5.0, 0.0])
    left = drifting[3:] - unsafe_velocity(drifting, covariance(0.0, 0.7))
    np.testing.assert_allclose(left, [0.7, -1.4, 0.0], atol=1e-12)
    np.testing.assert_array_equal(unsafe_velocity(np.zeros(6), covariance(1.0, 1.0)), 0.0)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.eye(3), "shape"),
        (np.full((6, 6), np.nan), "not finite"),
        (-np.eye(6), "negative variance"),
        ("much", "not numeric"),
    ],
)
def test_unusable_covariances_are_named(values: object, reason: str) -> None:
    with pytest.raises(ValueError, match=f"covariance: .*{reason}"):
        usable_covariance(values)  # type: ignore[arg-type]

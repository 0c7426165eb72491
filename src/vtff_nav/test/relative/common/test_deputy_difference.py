"""B less C from the filters of both, with their correlation through the chief."""

import numpy as np
import pytest

from vtff_nav.relative.common.deputy_difference import difference_of_deputies


@pytest.mark.parametrize("sigmas", [(1.0, 1.0, 1.0), (1.0, 1.0, 5.0), (1.0, 3.0, 1.0)])
def test_covariance_is_that_of_drawn_receivers(sigmas):
    """Positions of three receivers with independent errors; equal ones are what the share means."""
    generator = np.random.default_rng(3)
    chief, b, c = (s * generator.standard_normal((200_000, 3)) for s in sigmas)
    covariances = [np.cov((b - chief).T), np.cov((c - chief).T)]
    difference, covariance = difference_of_deputies((b - chief)[0], (c - chief)[0], *covariances)
    assert difference == pytest.approx((c - b)[0])
    true = np.cov((c - b).T)
    eigenvalues = np.linalg.eigvals(np.linalg.solve(true, covariance)).real
    if len(set(sigmas)) == 1:
        assert eigenvalues == pytest.approx(np.ones(3), abs=0.02)
    assert (eigenvalues > 0.9).all() and (eigenvalues < 1.1).all()


def test_without_a_share_the_states_are_independent():
    covariance = np.diag([1.0, 2.0, 3.0])
    _, sum_of_both = difference_of_deputies(
        np.zeros(3), np.ones(3), covariance, 2.0 * covariance, chief_share=0.0
    )
    assert sum_of_both == pytest.approx(3.0 * covariance)


def test_many_epochs_at_once():
    states, covariances = np.zeros((5, 6)), np.tile(np.eye(6), (5, 1, 1))
    difference, covariance = difference_of_deputies(states, states + 1.0, covariances, covariances)
    assert difference.shape == (5, 6) and covariance == pytest.approx(covariances)


@pytest.mark.parametrize(
    ("states", "share", "text"),
    [((np.zeros(3), np.zeros(6)), 0.5, "states"), ((np.zeros(3), np.zeros(3)), 0.6, "share")],
)
def test_wrong_input_is_refused(states, share, text):
    with pytest.raises(ValueError, match=text):
        difference_of_deputies(*states, np.eye(3), np.eye(3), share)

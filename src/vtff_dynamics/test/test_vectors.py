"""Norms of small matrices are those of numpy."""

import numpy as np
import pytest

from vtff_dynamics.vectors import frobenius_norm


def test_no_eigenvalue_exceeds_the_frobenius_norm():
    generator = np.random.default_rng(4)
    for _ in range(100):
        matrix = generator.standard_normal((3, 3))
        symmetric = matrix + matrix.T
        norm = frobenius_norm(symmetric)
        assert norm == pytest.approx(np.linalg.norm(symmetric), rel=1e-14)
        assert norm >= np.abs(np.linalg.eigvalsh(symmetric)).max()
        # The upper triangle does not count.
        assert frobenius_norm(np.tril(symmetric)) == norm

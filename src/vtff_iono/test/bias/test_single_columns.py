"""Products with columns of single effects are those of the same matrix written out."""

import numpy as np
import pytest

from vtff_iono.bias.single_columns import SingleColumns

COLUMN = np.array([[0, 3], [1, 3], [0, 2], [2, 4], [1, 4]])
SIZE = 6


def test_products_are_those_of_the_whole_matrix():
    generator = np.random.default_rng(1)
    value = generator.normal(size=COLUMN.shape)
    rows, factors = generator.normal(size=(len(COLUMN), 3)), generator.normal(size=SIZE)
    single, matrix = SingleColumns(COLUMN, value, SIZE), np.zeros((len(COLUMN), SIZE))
    np.put_along_axis(matrix, COLUMN, value, axis=1)
    assert single.times(factors) == pytest.approx(matrix @ factors, abs=1e-12)
    assert single.times_rows(rows) == pytest.approx(matrix.T @ rows, abs=1e-12)
    assert single.squares() == pytest.approx(matrix.T @ matrix, abs=1e-12)

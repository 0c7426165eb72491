"""Columns of normal equations in which each sample has one element of each kind.

An arc, a receiver bias and a satellite bias each have a column of their own, of which a sample has
one. Products with such a sparse matrix add up the samples in their order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray

__all__ = ["SingleColumns"]


class SingleColumns(NamedTuple):
    """A matrix of n rows with one element of each kind in every row.

    Attributes
    ----------
    column : ndarray of int64, shape (n, kinds)
        Column of each element; those of a row differ.
    value : ndarray, shape (n, kinds)
    size : int
        Number of columns, m.
    """

    column: npt.NDArray[np.int64]
    value: FloatArray
    size: int

    def times(self, factors: FloatArray) -> FloatArray:
        """Return the sums of the elements of rows times the factors (m,) of columns, (n,)."""
        sums: FloatArray = _sums_of_rows(self.column, self.value, factors)
        return sums

    def times_rows(self, rows: FloatArray) -> FloatArray:
        """Return the product of the transposed matrix and a matrix (n, k), shape (m, k)."""
        product: FloatArray = _sums_of_columns(self.column, self.value, self.size, rows)
        return product

    def squares(self) -> FloatArray:
        """Return the product of the transposed matrix and the matrix, shape (m, m)."""
        product: FloatArray = _products_of_columns(self.column, self.value, self.size)
        return product


@compiled
def _sums_of_rows(column, value, factors):  # type: ignore[no-untyped-def]
    """Return the sums that `SingleColumns.times` describes."""
    sums = np.zeros(len(value))
    for row in range(len(value)):
        for kind in range(value.shape[1]):
            sums[row] += value[row, kind] * factors[column[row, kind]]
    return sums


@compiled
def _sums_of_columns(column, value, size, rows):  # type: ignore[no-untyped-def]
    """Return the product that `SingleColumns.times_rows` describes."""
    product = np.zeros((size, rows.shape[1]))
    for row in range(len(value)):
        for kind in range(value.shape[1]):
            target, factor = column[row, kind], value[row, kind]
            for place in range(rows.shape[1]):
                product[target, place] += factor * rows[row, place]
    return product


@compiled
def _products_of_columns(column, value, size):  # type: ignore[no-untyped-def]
    """Return the product that `SingleColumns.squares` describes."""
    product = np.zeros((size, size))
    for row in range(len(value)):
        for kind in range(value.shape[1]):
            for other in range(value.shape[1]):
                product[column[row, kind], column[row, other]] += (
                    value[row, kind] * value[row, other]
                )
    return product

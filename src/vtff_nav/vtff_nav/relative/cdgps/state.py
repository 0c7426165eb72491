"""A Gaussian state whose members have labels, and its measurement update.

Clocks are white and unknown at every epoch. They are not states but nuisance parameters: the
update is that of an infinite prior variance, without the loss of digits of a large one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack
from scipy.special import gammaincc

from vtff_dynamics.vectors import FloatArray
from vtff_nav.relative.kernels.differences import leave_one_out
from vtff_nav.relative.kernels.gaussian import (
    decay_members,
    replace_members,
    symmetric_mean,
    symmetric_of_upper,
    without_nuisance,
)

__all__ = ["GaussianState", "Innovation", "Label"]

Label = tuple[Any, ...]
"""Name of a member: its kind and what it belongs to, such as ``("phase_bias", group)``."""


@dataclass(eq=False)
class Innovation:
    """The m measurements of an epoch before the update, with k nuisance parameters.

    Parameters
    ----------
    values : ndarray, shape (m,)
        Measured less predicted.
    variances : ndarray, shape (m,)
        Diagonal of the innovation covariance S.
    design : ndarray, shape (m, n)
        Derivatives H by the n members of the state.
    noise : ndarray, shape (m,)
        Variances of the measurement noise.
    weight : ndarray, shape (m, m)
        S^-1 with the nuisance parameters projected out; rows of measurements left out are zero.
    cross_covariance : ndarray, shape (n, m)
        P H', covariance of the state with the innovation.
    nuisance_gain : ndarray, shape (k, m)
        ``nuisance_gain @ values`` estimates the nuisance parameters.
    is_used : ndarray of bool, shape (m,)
        False for measurements left out.
    """

    values: FloatArray
    variances: FloatArray
    design: FloatArray
    noise: FloatArray
    weight: FloatArray
    cross_covariance: FloatArray
    nuisance_gain: FloatArray
    is_used: npt.NDArray[np.bool_]
    _leave_one_out: tuple[FloatArray, FloatArray] | None = field(default=None, init=False)
    _squared_norm: float | None = field(default=None, init=False)
    _probability: float | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Count the measurements that are used."""
        self.used_count = self.is_used.tobytes().count(1)

    @property
    def normalised(self) -> FloatArray:
        """Baarda's w of each measurement: standard normal without a fault, 0 if left out.

        Baarda (1968), A testing procedure for use in geodetic networks; Teunissen (1990) for the
        recursive filter.
        """
        residual, variance = self.leave_one_out
        return residual / np.sqrt(variance)

    @property
    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Residual of each measurement against all others, and its variance, shape (m,).

        The variance is infinite where there are too few other measurements, or the measurement is
        left out.
        """
        if self._leave_one_out is not None:
            return self._leave_one_out
        found: tuple[FloatArray, FloatArray] = leave_one_out(
            self.weight, self.weight @ self.values, self.variances, self.is_used
        )
        self._leave_one_out = found
        return found

    def add_noise(self, index: int, variance: float) -> None:
        """Add a variance to the noise of a measurement."""
        self._leave_one_out = self._squared_norm = self._probability = None
        column = self.weight[:, index].copy()
        self.weight -= np.outer(column, column / (1.0 / variance + column[index]))
        self.noise[index] += variance
        self.variances[index] += variance

    def leave_out(self, index: int) -> None:
        """Leave a measurement out, as if it had not been made."""
        self._leave_one_out = self._squared_norm = self._probability = None
        column = self.weight[:, index].copy()
        self.weight -= np.outer(column, column / column[index])
        self.weight[index, :] = 0.0
        self.weight[:, index] = 0.0
        self.used_count -= int(self.is_used[index])
        self.is_used[index] = False

    @property
    def squared_norm(self) -> float:
        """Normalised innovation squared v' S^-1 v: chi-square with `degrees_of_freedom`."""
        if self._squared_norm is None:
            self._squared_norm = float(self.values @ self.weight @ self.values)
        return self._squared_norm

    @property
    def are_all_used(self) -> bool:
        """Whether no measurement was left out."""
        return self.used_count == len(self.values)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of measurements used less that of nuisance parameters."""
        return self.used_count - len(self.nuisance_gain)

    @property
    def probability(self) -> float:
        """Probability of an innovation that is as large as a whole or larger; 1 if undecidable."""
        freedom = self.degrees_of_freedom
        if freedom <= 0:
            return 1.0
        if self._probability is None:
            self._probability = float(gammaincc(0.5 * freedom, 0.5 * max(self.squared_norm, 0.0)))
        return self._probability


class GaussianState:
    """Mean and covariance of labelled members.

    Parameters
    ----------
    labels : sequence of Label
    mean : array_like, shape (n,)
    covariance : array_like, shape (n, n)
    """

    def __init__(
        self, labels: Sequence[Label], mean: npt.ArrayLike, covariance: npt.ArrayLike
    ) -> None:
        self.labels = list(labels)
        self.mean: FloatArray = np.array(mean, dtype=float)
        self.covariance: FloatArray = np.array(covariance, dtype=float)
        self._number_labels()

    def _number_labels(self) -> None:
        self._index_of = {label: index for index, label in enumerate(self.labels)}
        self._forget_columns()

    def _forget_columns(self) -> None:
        """Forget what follows from the labels, which have changed."""
        #: Another object whenever the labels are others, in this state or in another one.
        self.labels_mark = object()
        self._columns_of: dict[tuple[str, ...], list[int]] = {}
        self._numbers_of: dict[tuple[str, ...], npt.NDArray[np.int64]] = {}

    def __len__(self) -> int:
        """Return the number of members."""
        return len(self.labels)

    def __contains__(self, label: Label) -> bool:
        """Return whether there is a member of that label."""
        return label in self._index_of

    def index(self, label: Label) -> int:
        """Return the index of a member in mean and covariance."""
        return self._index_of[label]

    def find(self, label: Label) -> int:
        """Return the index of a member in mean and covariance; -1 if there is none."""
        return self._index_of.get(label, -1)

    def columns(self, *kinds: str) -> list[int]:
        """Return the indices of all members of some kinds, in their order."""
        columns = self._columns_of.get(kinds)
        if columns is None:
            columns = [index for index, label in enumerate(self.labels) if label[0] in kinds]
            self._columns_of[kinds] = columns
        return columns

    def column_numbers(self, *kinds: str) -> npt.NDArray[np.int64]:
        """Return `columns` as an array; the same object while the labels stay."""
        numbers = self._numbers_of.get(kinds)
        if numbers is None:
            numbers = self._numbers_of[kinds] = np.array(self.columns(*kinds), dtype=np.int64)
        return numbers

    def span(self, *kinds: str) -> slice | list[int]:
        """Return the indices of all members of some kinds: a slice, if they follow each other."""
        columns = self.columns(*kinds)
        if columns and columns[-1] - columns[0] == len(columns) - 1:
            return slice(columns[0], columns[-1] + 1)
        return columns

    def labels_of(self, *kinds: str) -> list[Label]:
        """Return the labels of all members of some kinds, in their order."""
        return [self.labels[index] for index in self.columns(*kinds)]

    def value(self, label: Label) -> float:
        """Return the mean of a member."""
        return self.mean.item(self._index_of[label])

    def trace(self, count: int) -> float:
        """Return the sum of the variances of the first members."""
        return sum(self.covariance.item(i, i) for i in range(count))

    def sigma(self, label: Label) -> float:
        """Return the sigma of a member."""
        index = self._index_of[label]
        return math.sqrt(max(self.covariance.item(index, index), 0.0))

    def add(self, label: Label, mean: float, variance: float) -> None:
        """Add a member that is independent of the others."""
        size = len(self.labels)
        covariance = np.zeros((size + 1, size + 1))
        covariance[:size, :size] = self.covariance
        covariance[size, size] = variance
        self.covariance = covariance
        self.mean = np.append(self.mean, mean)
        self.labels.append(label)
        self._index_of[label] = size
        self._forget_columns()

    def add_copy(self, label: Label, original: Label, offset: float) -> None:
        """Add a member that is another one and a constant."""
        index = self._index_of[original]
        column = self.covariance[:, index].copy()
        self.add(label, self.mean.item(index) + offset, column.item(index))
        self.covariance[:-1, -1] = self.covariance[-1, :-1] = column

    def remove(self, labels: Iterable[Label]) -> None:
        """Remove members (marginalise); labels that are absent are ignored."""
        removed = self._index_of.keys() & set(labels)
        if not removed:
            return
        kept = [index for index, label in enumerate(self.labels) if label not in removed]
        self.labels = [self.labels[index] for index in kept]
        self.mean = self.mean[kept]
        self.covariance = self.covariance[np.ix_(kept, kept)]
        self._number_labels()

    def renew(self, label: Label, variance: float) -> None:
        """Give a member zero mean and a variance, independent of the others."""
        index = self._index_of[label]
        self.mean[index] = 0.0
        self.covariance[index, :] = 0.0
        self.covariance[:, index] = 0.0
        self.covariance[index, index] = variance

    def rename(self, old: Label, new: Label) -> None:
        """Give a member another label."""
        self.labels[self._index_of[old]] = new
        self._number_labels()

    def join(self, other: GaussianState) -> None:
        """Add the members of another state, which is independent, after those of this one."""
        size, total = len(self), len(self) + len(other)
        covariance = np.zeros((total, total))
        covariance[:size, :size] = self.covariance
        covariance[size:, size:] = other.covariance
        self.covariance = covariance
        self.mean = np.concatenate((self.mean, other.mean))
        self.labels += other.labels
        self._number_labels()

    def part(self, *kinds: str) -> GaussianState:
        """Return the members of some kinds as a state of their own (their marginal)."""
        columns = self.columns(*kinds)
        covariance = self.covariance[np.ix_(columns, columns)]
        return GaussianState(self.labels_of(*kinds), self.mean[columns], covariance)

    def predict_block(
        self, first: int, mean: FloatArray, transition: FloatArray, noise: FloatArray
    ) -> None:
        """Propagate members that stand one after another.

        Parameters
        ----------
        first : int
            Index of the first of them.
        mean : ndarray, shape (k,)
            Their propagated mean.
        transition, noise : ndarray, shape (k, k)
            Transition matrix and process noise.
        """
        block = slice(first, first + len(mean))
        self.mean[block] = mean
        covariance = self.covariance
        covariance[block, :] = transition @ covariance[block, :]
        covariance[:, block] = covariance[:, block] @ transition.T
        covariance[block, block] += noise

    def transform(self, columns: npt.ArrayLike, coefficients: FloatArray) -> None:
        """Replace some members by linear functions of all of them.

        Parameters
        ----------
        columns : array_like of int, shape (k,)
            Indices of the members.
        coefficients : ndarray, shape (k, n)
            Their derivatives by the n members.
        """
        changed = coefficients @ self.covariance
        replace_members(
            self.mean,
            self.covariance,
            np.asarray(columns, dtype=np.int64),
            coefficients @ self.mean,
            changed,
            changed @ coefficients.T,
        )

    def predict_gauss_markov(
        self, decay: FloatArray, steady_variance: FloatArray, growth: FloatArray
    ) -> None:
        """Propagate all members as first-order Gauss-Markov processes of zero mean.

        Parameters
        ----------
        decay : ndarray, shape (n,)
            Factors of the means over the step, exp(-step / correlation time); 1 for constants.
        steady_variance : ndarray, shape (n,)
            Variances that are reached without measurements.
        growth : ndarray, shape (n,)
            What the variances of members that walk grow by.
        """
        decay_members(self.mean, self.covariance, decay, steady_variance, growth)

    def add_noise(self, label: Label, variance: float) -> None:
        """Add a variance to a member: process noise of a random walk."""
        index = self._index_of[label]
        self.covariance[index, index] += variance

    def reweigh(self, labels: Sequence[Label], last: float, variance: float) -> None:
        """Give Gauss-Markov members of zero mean another steady-state variance.

        Parameters
        ----------
        labels : sequence of Label
        last, variance : float
            Variance that was assumed so far, and the one from now on; both more than zero.

        Notes
        -----
        That a member is smaller than was assumed is the same as a measurement of zero, whose
        information is the difference of both. For constant members that is exact.
        """
        columns = [self._index_of[label] for label in labels]
        if variance > last:
            self.covariance[columns, columns] += variance - last
        elif variance < last and labels:
            design = np.zeros((len(columns), len(self)))
            design[np.arange(len(columns)), columns] = 1.0
            noise = np.full(len(columns), 1.0 / (1.0 / variance - 1.0 / last))
            empty = np.zeros((len(columns), 0))
            self.update(self.innovation(design, -self.mean[columns], noise, empty))

    def log_likelihoods(
        self, labels: Sequence[Label], last: FloatArray, variances: FloatArray
    ) -> FloatArray:
        """Return the log likelihoods of all measurements with other prior variances of members.

        Parameters
        ----------
        labels : sequence of Label
            k members that were independent of each other and of zero mean before the measurements.
        last : ndarray, shape (k,)
            Prior variances that were assumed, more than zero.
        variances : ndarray, shape (m, k)
            Prior variances that are weighed.

        Returns
        -------
        ndarray, shape (m,)
            Up to a constant that is the same for all `variances`.
        """
        columns = [self._index_of[label] for label in labels]
        weight = np.linalg.inv(self.covariance[np.ix_(columns, columns)])
        told, axes = np.linalg.eigh(weight - np.diag(1.0 / last))
        told = told.clip(0.0)
        score = weight @ self.mean[columns]
        result = np.empty(len(variances))
        for row, sigma in enumerate(np.sqrt(variances)):
            scaled_axes, scaled_score = sigma[:, None] * axes, sigma * score
            total = np.eye(len(columns)) + (scaled_axes * told) @ scaled_axes.T
            explained = float(scaled_score @ np.linalg.solve(total, scaled_score))
            result[row] = 0.5 * (explained - float(np.linalg.slogdet(total)[1]))
        return result

    def doubt(self, factor: float, columns: Sequence[int], prior: FloatArray) -> None:
        """Divide the information of all measurements by a factor, but not that of the prior.

        Parameters
        ----------
        factor : float
            1 or more.
        columns : sequence of int
            Indices of k members of which something was known before.
        prior : ndarray, shape (k, k)
            Covariance of what was known.

        Notes
        -----
        Information P^-1 - P0^-1 of the measurements becomes (P^-1 - P0^-1) / f: the covariance is
        raised as a whole, and (1 - 1/f) of the prior counts once more. The means stay.
        """
        raised = factor * self.covariance
        if len(columns) and factor > 1.0:
            cross = raised[:, columns]
            total = cross[columns] + factor / (factor - 1.0) * prior
            scale = 1.0 / np.sqrt(np.diagonal(total))
            gain = cross * scale
            raised -= gain @ np.linalg.solve(total * scale[:, None] * scale, gain.T)
        self._set_covariance(raised)

    def innovation(
        self, design: FloatArray, values: FloatArray, variances: FloatArray, nuisance: FloatArray
    ) -> Innovation:
        """Return the innovation of measurements and its statistics.

        Parameters
        ----------
        design : ndarray, shape (m, n)
        values : ndarray, shape (m,)
            Measured less predicted.
        variances : ndarray, shape (m,)
            Variances of the measurement noise, which is independent.
        nuisance : ndarray, shape (m, k)
            Derivatives by the nuisance parameters; k may be 0.

        Raises
        ------
        ValueError
            If the innovation covariance is not positive definite, or a nuisance parameter has no
            measurement.
        """
        cross = self.covariance @ design.T
        covariance = design @ cross
        covariance.reshape(-1)[:: len(values) + 1] += variances
        factor, info = lapack.dpotrf(covariance, lower=1)
        if info != 0:
            raise ValueError("the innovation covariance is not positive definite")
        inverse, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
        # LAPACK fills only the lower half, in the order of Fortran.
        weight = symmetric_of_upper(inverse.T)
        if nuisance.shape[1]:
            weighted = weight @ nuisance
            normal = nuisance.T @ weighted
            if not min(normal.diagonal().tolist()) > 0.0:
                raise ValueError("a nuisance parameter has no measurement")
            if len(normal) == 1:
                gain = without_nuisance(weight, weighted, normal.item())
            else:
                gain = np.linalg.inv(normal) @ weighted.T
                weight = weight - weighted @ gain
        else:
            gain = np.zeros((0, len(values)))
        return Innovation(
            values=values,
            variances=covariance.diagonal().copy(),
            design=design,
            noise=np.array(variances),
            weight=weight,
            cross_covariance=cross,
            nuisance_gain=gain,
            is_used=np.ones(len(values), dtype=bool),
        )

    def update(self, innovation: Innovation) -> FloatArray:
        """Update with measurements; return the change of the mean, shape (n,).

        The covariance is updated in Joseph's form. It stays positive also where ambiguities unknown
        to metres are updated with phases of a millimetre.
        """
        gain = innovation.cross_covariance @ innovation.weight
        change: FloatArray = gain @ innovation.values
        self.mean += change
        remainder = -gain @ innovation.design
        remainder.reshape(-1)[:: len(self) + 1] += 1.0
        noise = (gain * innovation.noise) @ gain.T
        self._set_covariance(remainder @ self.covariance @ remainder.T + noise)
        return change

    def constrain(self, design: FloatArray, values: FloatArray, covariance: FloatArray) -> None:
        """Add `values` to ``design @ mean`` and give it a variance of zero.

        Parameters
        ----------
        design : ndarray, shape (m, n)
        values : ndarray, shape (m,)
        covariance : ndarray, shape (m, m)
            Covariance of ``design @ mean`` before: ``design @ P @ design.T``.
        """
        gain = np.linalg.solve(covariance, design @ self.covariance).T
        self.mean = self.mean + gain @ values
        remainder = np.eye(len(self)) - gain @ design
        self._set_covariance(remainder @ self.covariance @ remainder.T)

    def _set_covariance(self, covariance: FloatArray) -> None:
        self.covariance = symmetric_mean(covariance)

"""Attitude from nothing: many filters that start at turns about the measured field.

One sample of the field leaves the turn about the field unknown. The bank starts one filter for each
of some turns, weighs them by the likelihood of what they measure, and drops those that explain the
samples worse; a Gaussian sum whose members come down to one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from vtff_dynamics.attitude.quaternion import (
    conjugate,
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    rotation_vector,
)
from vtff_dynamics.vectors import FloatArray, cross, norm
from vtff_nav.attitude.attitude_filter import AttitudeEstimate, AttitudeFilter, FilterPeriod
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel

__all__ = ["AttitudeFilterBank"]


class AttitudeFilterBank:
    """Filters that come down to the one that explains the samples.

    Parameters
    ----------
    filters : iterable of AttitudeFilter
        One where the attitude is known already; see `about_field` for one that is not.
    drop_below : float
        Members whose likelihood is less than exp of minus this of the best are dropped.
    """

    def __init__(self, filters: Iterable[AttitudeFilter], drop_below: float = 30.0) -> None:
        self._filters = list(filters)
        self._drop_below = drop_below

    @classmethod
    def about_field(
        cls,
        body: BodyModel,
        configuration: AttitudeFilterConfiguration,
        measured_body: FloatArray,
        field_gcrf: FloatArray,
        members: int = 24,
    ) -> AttitudeFilterBank:
        """Return the filters of all turns about the field, from one sample of it.

        Parameters
        ----------
        body : BodyModel
        configuration : AttitudeFilterConfiguration
        measured_body : ndarray, shape (3,)
            First sample of the magnetometer, T.
        field_gcrf : ndarray, shape (3,)
            Field of the model there, T.
        members : int
            Turns about the field that are tried.
        """
        strength = norm(field_gcrf)
        along_body = measured_body / norm(measured_body)
        sigma = math.sqrt(
            configuration.magnetometer_sigma**2
            + configuration.bias_sigma**2
            + configuration.field_sigma**2
        )
        across, about = 2.0 * sigma / strength, 1.2 * math.pi / members
        projection = np.outer(along_body, along_body)
        covariance = across**2 * (np.eye(3) - projection) + about**2 * projection
        start = _alignment(along_body, field_gcrf / strength)
        turns = (2.0 * math.pi * number / members * along_body for number in range(members))
        return cls(
            AttitudeFilter(
                body,
                configuration,
                multiply(start, from_rotation_vector(turn)),
                rotation_covariance=covariance,
            )
            for turn in turns
        )

    @property
    def members(self) -> int:
        """Number of filters that are left."""
        return len(self._filters)

    @property
    def best(self) -> AttitudeFilter:
        """The filter with the largest likelihood."""
        return max(self._filters, key=lambda member: member.log_likelihood)

    @property
    def estimate(self) -> AttitudeEstimate:
        """What the best filter knows."""
        return self.best.estimate

    @property
    def spread(self) -> float:
        """Largest angle between the best member and another, rad; 0 when one is left."""
        inverse = conjugate(self.best.quaternion_gcrf)
        return max(
            norm(rotation_vector(multiply(inverse, member.quaternion_gcrf)))
            for member in self._filters
        )

    def predict(self, period: FilterPeriod) -> None:
        """Predict all members to the end of a period."""
        for member in self._filters:
            member.predict(period)

    def exchange_momentum(self, momentum: float) -> None:
        """Give the wheel a momentum, N m s, that all members had believed in the body."""
        for member in self._filters:
            member.exchange_momentum(momentum)

    def update(
        self, measured_body: FloatArray, field_gcrf: FloatArray, gate: float = math.inf
    ) -> bool:
        """Update all members by a sample and drop those that explain it worse.

        `gate` is that of `AttitudeFilter.update`.

        Returns
        -------
        bool
            False if the best member did not use the sample.
        """
        used = [member.update(measured_body, field_gcrf, gate) for member in self._filters]
        accepted = used[self._filters.index(self.best)]
        if len(self._filters) > 1:
            limit = self.best.log_likelihood - self._drop_below
            self._filters = [member for member in self._filters if member.log_likelihood >= limit]
            self._drop_twins()
        return accepted

    def _drop_twins(self) -> None:
        """Drop members that have come to the same attitude and rate as a likelier one."""
        kept: list[AttitudeFilter] = []
        for member in sorted(self._filters, key=lambda one: -one.log_likelihood):
            if not any(member.is_twin_of(other) for other in kept):
                kept.append(member)
        self._filters = kept


def _alignment(direction_body: FloatArray, direction_gcrf: FloatArray) -> FloatArray:
    """Return one of the attitudes that bring a body direction to a GCRF direction."""

    def axes(direction: FloatArray) -> FloatArray:
        helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
        second = cross(direction, helper)
        second /= norm(second)
        return np.array([direction, second, cross(direction, second)])

    quaternion: FloatArray = from_rotation_matrix(axes(direction_gcrf).T @ axes(direction_body))
    return quaternion

"""Attitude determination of one spacecraft: start, filter, watch over the samples, new start.

What a node, a log and the closed loop use. It starts a bank of filters with the first sample, names
samples that cannot be true (missing, saturated, stuck), predicts without them, and starts anew when
the filter no longer explains what is measured.

A search is far from linear: the sample that leaves one filter finds it degrees off, and surer than
it is. What it has learned of the field, which lasts for hours, would keep such an error. So where
the field has an error only the solution of the search is kept: a filter starts at it, with sigmas
that cover what a search leaves, and knows of the field what was known before. No attitude of a
search may steer, and none whose filter has ceased to explain the samples. A filter that has once
explained its samples uses no wild one: it would be moved by degrees and stay sure for an orbit.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray, norm
from vtff_nav.attitude.attitude_filter import AttitudeEstimate, AttitudeFilter, FilterPeriod
from vtff_nav.attitude.configuration import AttitudeFilterConfiguration, BodyModel
from vtff_nav.attitude.filter_bank import AttitudeFilterBank

__all__ = ["AttitudeDetermination", "DeterminationConfiguration", "DeterminationStatus"]


@dataclass(frozen=True)
class DeterminationConfiguration:
    """Limits of the watch over samples and filter.

    Parameters
    ----------
    largest_field : float
        Range of the magnetometer on each axis, T: a sample there is saturated.
    field_tolerance : float
        Share of the model's strength by which a sample's may differ.
    stuck_samples : int
        Equal samples in a row that make the sensor stuck.
    window : int
        Samples over which the innovations are judged.
    largest_innovation : float
        Mean of the normalised innovation squared of the window, for each of its three numbers,
        above which the filter starts anew; above the same mean of the last `confirming_samples` it
        no longer steers. An honest filter is above it once in 1e7 samples (chi squared).
    confirming_samples : int
        Samples after a solution that it must have explained before it may steer: whole turns
        between samples, and turns about the field, leave solutions that are far off and sure.
    largest_confirming_innovation : float
        Mean of their normalised innovation squared, for each of its three numbers, up to which they
        are explained (an honest filter is above it once in 1100 samples); one wild sample counts as
        `largest_single_innovation` at most.
    largest_single_innovation : float
        Normalised innovation squared of a sample, for each of its three numbers, above which a
        filter that has once been confirmed does not use it: one of an honest filter in 2e5.
    members : int
        Turns about the field that a start tries.
    converged_deg : float
        Largest sigma of the attitude of a solution that may steer, and largest angle between the
        filters that are left, deg.
    starting_rate : float
        Rate across the field up to which a start is tried, rad/s.
    found_deg : float
        Sigma of the attitude, and angle between the filters that are left, at which a search ends,
        deg.
    found_rotation_sigma_deg, found_rate_sigma, found_dipole_sigma : float
        Sigmas that cover the errors of a solution then: deg, rad/s, A m2, on each axis. From twelve
        tumbles after launch the errors are 0.9 deg, 1.5e-4 rad/s and 5e-3 A m2 (RMS), and of a body
        that turns fast up to 5e-4 rad/s.
    """

    largest_field: float = 60e-6
    field_tolerance: float = 0.2
    stuck_samples: int = 3
    window: int = 60
    largest_innovation: float = 3.0
    confirming_samples: int = 10
    largest_confirming_innovation: float = 2.0
    largest_single_innovation: float = 9.0
    members: int = 24
    converged_deg: float = 5.0
    starting_rate: float = 0.03
    found_deg: float = 0.7
    found_rotation_sigma_deg: float = 2.5
    found_rate_sigma: float = 3e-4
    found_dipole_sigma: float = 0.01


@dataclass(frozen=True)
class DeterminationStatus:
    """What became of a sample.

    Attributes
    ----------
    valid
        True if the attitude may steer.
    used
        True if the sample was used.
    members
        Filters that are left.
    restarts
        New starts since the beginning.
    normalised_innovation_squared
        Mean over the three numbers of this sample; nan if the sample was not used.
    reason
        Why not valid, or why the sample was not used, one line; else empty.
    """

    valid: bool
    used: bool
    members: int
    restarts: int
    normalised_innovation_squared: float
    reason: str = ""


class AttitudeDetermination:
    """Attitude, rate and dipole from samples of a magnetometer, whatever they are.

    Parameters
    ----------
    body : BodyModel
    filter_configuration : AttitudeFilterConfiguration
    configuration : DeterminationConfiguration, optional
    """

    def __init__(
        self,
        body: BodyModel,
        filter_configuration: AttitudeFilterConfiguration,
        configuration: DeterminationConfiguration | None = None,
    ) -> None:
        self._body = body
        self._filter_configuration = filter_configuration
        self._configuration = configuration or DeterminationConfiguration()
        self._bank: AttitudeFilterBank | None = None
        self._best_before: AttitudeFilter | None = None
        self._innovations: deque[float] = deque(maxlen=self._configuration.window)
        self._recent: deque[float] = deque(maxlen=self._configuration.confirming_samples)
        self._is_confirmed = False
        self._gates = False
        self._last = np.full(3, math.nan)
        self._equal = 0
        self._restarts = 0
        self._searches = False

    @property
    def estimate(self) -> AttitudeEstimate | None:
        """What is known; None before the first sample."""
        return None if self._bank is None else self._bank.estimate

    @property
    def correction(self) -> FloatArray:
        """Rotation by which the last sample turned the predicted attitude, rad, body axes, (3,).

        Zero where it was not used; nan where the estimate is of another filter than that before.
        """
        best = None if self._bank is None else self._bank.best
        if best is None or best is not self._best_before:
            return np.full(3, math.nan)
        return best.correction

    @property
    def status(self) -> DeterminationStatus:
        """Status of the present estimate, without a sample."""
        return self._status(False, math.nan)

    def process(
        self,
        period: FilterPeriod,
        measured_body: npt.ArrayLike | None,
        rate_across: float = 0.0,
    ) -> DeterminationStatus:
        """Take a period and the sample at its end.

        Parameters
        ----------
        period : FilterPeriod
        measured_body : array_like, shape (3,), or None
            Sample of the magnetometer, T; None if there is none.
        rate_across : float
            Rate of the body across the field, rad/s, where two samples show it: a spacecraft that
            tumbles is not started on.
        """
        field = period.field_end_gcrf
        reason = self._fault_of(measured_body, field)
        self._best_before = None if self._bank is None else self._bank.best
        if self._bank is not None:
            self._bank.predict(period)
        if reason:
            self._innovations.clear()
            return self._status(False, math.nan, reason)
        sample = np.asarray(measured_body, dtype=float)
        if self._bank is None:
            if rate_across > self._configuration.starting_rate:
                return self._status(
                    False, math.nan, f"tumbling: {rate_across:.3f} rad/s across the field"
                )
            self._start(sample, field)
            return self._status(True, math.nan)
        limit = self._configuration.largest_single_innovation
        used = self._bank.update(sample, field, 3.0 * limit if self._gates else math.inf)
        innovation = self._bank.best.normalised_innovation_squared / 3.0
        if self._searches:
            self._end_search(self._bank)
        # One wild sample is an outlier and no reason for a new start.
        self._innovations.append(min(innovation, 100.0 if used else limit))
        self._confirm(innovation)
        limit = self._configuration.largest_innovation
        full = len(self._innovations) == self._configuration.window
        if full and sum(self._innovations) / len(self._innovations) > limit:
            self._restarts += 1
            self._bank = None
            self._innovations.clear()
            return self._status(
                False, innovation, "starts anew: the filter did not explain the samples"
            )
        return self._status(used, innovation, "" if used else "sample outside the gate")

    def expect(self, quaternion_gcrf: FloatArray, rate_body: FloatArray) -> None:
        """Take it that the spacecraft has an attitude now, before the first sample.

        Its sigmas are those of the start in the configuration of the filter. A new start, if that
        attitude does not explain the samples, knows nothing.

        Parameters
        ----------
        quaternion_gcrf : ndarray, shape (4,)
            Body to GCRF, x, y, z, w.
        rate_body : ndarray, shape (3,)
            rad/s.
        """
        if self._bank is None and self._restarts == 0:
            self._bank = AttitudeFilterBank(
                [AttitudeFilter(self._body, self._filter_configuration, quaternion_gcrf, rate_body)]
            )
            self._is_confirmed = True

    def note_wheel(self, momentum: float) -> None:
        """Take it that the wheel had another momentum than was believed, by so much, N m s."""
        if self._bank is not None:
            self._bank.exchange_momentum(momentum)

    def _end_search(self, bank: AttitudeFilterBank) -> None:
        """Keep the solution of a search and nothing else, once it is there."""
        found, settings = bank.estimate, self._configuration
        if math.degrees(max(found.rotation_sigma, bank.spread)) > settings.found_deg:
            return
        self._searches = False
        configuration = replace(
            self._filter_configuration,
            initial_rotation_sigma_deg=settings.found_rotation_sigma_deg,
            initial_rate_sigma=settings.found_rate_sigma,
            initial_dipole=found.dipole,
            initial_dipole_sigma=settings.found_dipole_sigma,
        )
        self._bank = AttitudeFilterBank(
            [AttitudeFilter(self._body, configuration, found.quaternion_gcrf, found.rate_body)]
        )

    def _confirm(self, innovation: float) -> None:
        """Judge a solution by the last samples; those of a search do not count."""
        if not self._is_known:
            self._recent.clear()
            self._is_confirmed = False
            return
        settings = self._configuration
        self._recent.append(min(innovation, settings.largest_single_innovation))
        mean = sum(self._recent) / len(self._recent)
        if len(self._recent) < settings.confirming_samples:
            return
        limit = settings.largest_confirming_innovation
        if self._is_confirmed:
            limit = settings.largest_innovation
        self._is_confirmed = mean <= limit
        self._gates |= self._is_confirmed

    def _start(self, sample: FloatArray, field: FloatArray) -> None:
        self._innovations.clear()
        self._recent.clear()
        self._is_confirmed = False
        self._gates = False
        self._searches = self._filter_configuration.field_sigma > 0.0
        self._bank = AttitudeFilterBank.about_field(
            self._body,
            self._filter_configuration,
            sample,
            field,
            members=self._configuration.members,
        )

    def _fault_of(self, measured_body: npt.ArrayLike | None, field: FloatArray) -> str:
        """Return what is wrong with a sample, one line; empty if nothing is."""
        settings = self._configuration
        if measured_body is None:
            return "magnetometer silent"
        sample = np.asarray(measured_body, dtype=float)
        if sample.shape != (3,) or not np.isfinite(sample).all():
            return "magnetometer sample is not three finite numbers"
        self._equal = self._equal + 1 if np.array_equal(sample, self._last) else 1
        self._last = sample
        if np.abs(sample).max() >= settings.largest_field * (1.0 - 1e-9):
            return "magnetometer saturated"
        if self._equal >= settings.stuck_samples:
            return f"magnetometer stuck: {self._equal} equal samples"
        strength, expected = norm(sample), norm(field)
        if abs(strength - expected) > settings.field_tolerance * expected:
            return (
                f"magnetometer shows {1e6 * strength:.1f} uT where the field has "
                f"{1e6 * expected:.1f} uT"
            )
        return ""

    def _status(self, used: bool, innovation: float, reason: str = "") -> DeterminationStatus:
        if self._bank is None:
            return DeterminationStatus(
                False, used, 0, self._restarts, innovation, reason or "no sample yet"
            )
        valid = self._is_known and self._is_confirmed
        if not valid and not reason:
            sigma = math.degrees(self._bank.estimate.rotation_sigma)
            samples = self._configuration.confirming_samples
            reason = f"attitude not yet known: {self._bank.members} starts left, {sigma:.1f} deg"
            if self._is_known:
                reason = f"attitude not confirmed: {samples} samples have to be explained"
        return DeterminationStatus(
            valid, used, self._bank.members, self._restarts, innovation, reason
        )

    @property
    def _is_known(self) -> bool:
        """Whether a search is over, its filters agree, and are sure enough to steer by."""
        if self._bank is None or self._searches:
            return False
        uncertain = max(self._bank.estimate.rotation_sigma, self._bank.spread)
        return math.degrees(uncertain) <= self._configuration.converged_deg

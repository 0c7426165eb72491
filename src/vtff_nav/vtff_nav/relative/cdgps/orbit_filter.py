"""Absolute motion of one receiver from its own observations, aided by its dynamics.

There is no ionosphere model. With two frequencies the ionosphere-free combinations of code and
phase are used, with one frequency GRAPHIC, the mean of code and phase (Yunck 1993), in which the
ionospheric delay cancels. The ambiguities of the phases are real numbers.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import GM_EARTH, SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import state_itrf_to_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.satellite_table import SatelliteTable
from vtff_nav.relative.cdgps.configuration import CdgpsConfiguration
from vtff_nav.relative.cdgps.state import GaussianState, Innovation
from vtff_nav.relative.common.dynamics import DYNAMIC_STATES
from vtff_nav.relative.common.measurements import Geometry, SignalTable
from vtff_nav.relative.common.orbit_single_point import (
    Combinations,
    SinglePoint,
    form_combinations,
    solve_single_point,
    troposphere_delay,
)

__all__ = ["AbsoluteFilter"]

_LONGEST_ARC_GAP = 5.0
_UNKNOWN_AMBIGUITY_SIGMA = 30.0
# Sigma of the delay of a code on one frequency in low orbit or on the ground, m.
_SINGLE_FREQUENCY_DELAY_SIGMA = 5.0
_RESTART_EPOCHS = 5
_DETECTION_PASSES = 5
# Sigmas added to position and velocity when the motion was not as predicted, m and m/s.
_UNPREDICTED_MOTION_SIGMAS = (10.0, 1.0)


class AbsoluteFilter:
    """Position, velocity and clock of the chief.

    Parameters
    ----------
    configuration : CdgpsConfiguration
    """

    def __init__(self, configuration: CdgpsConfiguration) -> None:
        self._configuration = configuration
        self._is_orbital = configuration.chief_motion == "orbital"
        self._mask = math.radians(configuration.elevation_mask_deg)
        self.reset()

    def reset(self) -> None:
        """Forget every estimate."""
        self.state: GaussianState | None = None
        self.clock = 0.0
        self._last_point: SinglePoint | None = None
        self._last_seen: dict[tuple[str, int, int], GpsTime] = {}
        self._failures = 0

    @property
    def mean(self) -> FloatArray:
        """Position, velocity (navigation axes) and empirical acceleration, shape (9,)."""
        assert self.state is not None
        return self.state.mean[:DYNAMIC_STATES]

    @property
    def covariance(self) -> FloatArray:
        """Covariance of position and velocity (navigation axes), shape (6, 6)."""
        assert self.state is not None
        return self.state.covariance[:6, :6]

    def start(
        self, time: GpsTime, tag: GpsTime, signals: SignalTable, table: SatelliteTable
    ) -> bool:
        """Start from the codes of one epoch, or of two epochs without Doppler; return whether.

        Parameters
        ----------
        time : GpsTime
            Epoch of the first state.
        tag : GpsTime
            Time tag of the observations.
        signals : SignalTable
        table : SatelliteTable
        """
        configuration = self._configuration
        measured = form_combinations(signals, table)
        point = solve_single_point(measured, table, tag, self._mask, configuration.has_troposphere)
        if point is None:
            return False
        last, self._last_point = self._last_point, point
        is_dual = bool(np.median(measured.second_band) > 0)
        bias = configuration.ephemeris_sigma if is_dual else 2.0 * _SINGLE_FREQUENCY_DELAY_SIGMA
        covariance = np.zeros((DYNAMIC_STATES, DYNAMIC_STATES))
        covariance[:3, :3] = 4.0 * point.covariance + bias**2 * np.eye(3)
        covariance[6:, 6:] = configuration.noise_chief.empirical_sigma**2 * np.eye(3)
        mean = np.zeros(DYNAMIC_STATES)
        received = tag - point.clock / SPEED_OF_LIGHT
        if self._is_orbital:
            state = self._first_orbital_state(received, point, last, covariance)
            if state is None:
                return False
            mean[:6] = state
            mean[:3] += (time - received) * state[3:]
        else:
            mean[:3] = point.position_itrf
            if configuration.chief_motion == "kinematic":
                covariance[3:6, 3:6] = 100.0 * np.eye(3)
            if configuration.position_chief_itrf is not None:
                mean[:3] = configuration.position_chief_itrf
                covariance[:3, :3] = 1e-8 * np.eye(3)
        self.clock = point.clock / SPEED_OF_LIGHT
        self.state = GaussianState([("motion", i) for i in range(DYNAMIC_STATES)], mean, covariance)
        self._last_seen = {}
        self._failures = 0
        return True

    @staticmethod
    def _first_orbital_state(
        time: GpsTime, point: SinglePoint, last: SinglePoint | None, covariance: FloatArray
    ) -> FloatArray | None:
        """Return position and velocity in GCRF; set the covariance of the velocity.

        Without Doppler the velocity comes from the positions of two epochs; None if the last
        position is missing or too old.
        """
        if np.isfinite(point.velocity_itrf).all():
            covariance[3:6, 3:6] = point.velocity_sigma**2 * np.eye(3)
            return state_itrf_to_gcrf(
                time, np.concatenate((point.position_itrf, point.velocity_itrf))
            )
        if last is None or not 0.0 < point.time - last.time < 30.0:
            return None
        zero = np.zeros(3)
        time_before = last.time - last.clock / SPEED_OF_LIGHT
        duration = time - time_before
        now = state_itrf_to_gcrf(time, np.concatenate((point.position_itrf, zero)))[:3]
        before = state_itrf_to_gcrf(time_before, np.concatenate((last.position_itrf, zero)))[:3]
        gravity = -GM_EARTH * now / float(now @ now) ** 1.5
        velocity = (now - before) / duration + 0.5 * duration * gravity
        covariance[3:6, 3:6] = 2.0 * covariance[:3, :3] / duration**2
        return np.concatenate((now, velocity))

    def code_error(self, epoch: ObservationEpoch | None, state_itrf: FloatArray) -> FloatArray:
        """Return the error of the position from codes of a surveyed chief, m, shape (3,).

        It is known at the epoch of the start only, and zero otherwise.
        """
        point = self._last_point
        is_surveyed = self._configuration.position_chief_itrf is not None
        if not is_surveyed or epoch is None or point is None or point.time != epoch.time:
            return np.zeros(3)
        return point.position_itrf - state_itrf[:3]

    def predict(self, mean: FloatArray, transition: FloatArray, noise: FloatArray) -> None:
        """Propagate the state to the next epoch; see `GaussianState.predict_leading`."""
        assert self.state is not None
        self.state.predict_leading(mean, transition, noise)

    def update(
        self, time: GpsTime, signals: SignalTable, table: SatelliteTable, seen: Geometry
    ) -> None:
        """Update the state with the observations of an epoch.

        Parameters
        ----------
        time : GpsTime
        signals : SignalTable
        table : SatelliteTable
        seen : Geometry
            Geometry for the present state and `clock`.
        """
        state = self.state
        assert state is not None
        measured = form_combinations(signals, table)
        rows = seen.columns(measured.satellite)
        is_high = seen.elevation[0, rows] > self._mask
        measured, rows = measured.select(is_high), rows[is_high]
        if not len(measured):
            return
        clock = SPEED_OF_LIGHT * self.clock
        predicted = seen.range[0, rows] - seen.clock[0, rows] + clock
        if self._configuration.has_troposphere:
            delay = troposphere_delay(state.mean[:3], seen.elevation[0, rows])
            predicted = predicted + delay
        labels = self._ambiguities(time, measured, predicted)
        may_doubt_motion = self._configuration.chief_motion != "static"
        for _ in range(_DETECTION_PASSES):
            innovation, design_rows = self._innovation(measured, rows, seen, predicted, labels)
            normalised = np.abs(innovation.normalised)
            while normalised.size and normalised.max() > self._configuration.fault_sigmas:
                worst = int(normalised.argmax())
                if innovation.degrees_of_freedom <= 0:
                    break
                innovation.leave_out(worst)
                normalised = np.abs(innovation.normalised)
            slipped = [
                design_rows[index]
                for index in np.flatnonzero(~innovation.is_used).tolist()
                if index >= len(innovation.values) - len(measured)
            ]
            if not slipped:
                break
            if may_doubt_motion and 2 * len(slipped) > len(measured):
                # So many phases do not slip at once: the motion was not as predicted.
                may_doubt_motion = False
                for axis in range(6):
                    sigma = _UNPREDICTED_MOTION_SIGMAS[axis // 3]
                    state.add_noise(("motion", axis), sigma**2)
                continue
            for row in slipped:
                state.remove([labels[row]])
                self._last_seen.pop(labels[row], None)
            labels = self._ambiguities(time, measured, predicted)
        # Phases that do not fit begin anew and fit then: codes show a state that is wrong.
        is_code_used = innovation.is_used[: len(innovation.values) - len(measured)]
        is_bad = 2 * np.count_nonzero(~is_code_used) > len(is_code_used)
        self._failures = self._failures + 1 if is_bad else 0
        state.update(innovation)
        nuisance = innovation.nuisance_gain @ innovation.values
        self.clock += float(nuisance[0]) / SPEED_OF_LIGHT
        if self._failures >= _RESTART_EPOCHS:
            self.reset()

    def _ambiguities(
        self, time: GpsTime, measured: Combinations, predicted: FloatArray
    ) -> list[tuple[str, int, int]]:
        """Return the labels of the ambiguities; add new ambiguities and remove old ones."""
        state = self.state
        assert state is not None
        labels = []
        residual = measured.phase - predicted
        for row, (satellite, band, is_lost) in enumerate(
            zip(
                measured.satellite.tolist(),
                measured.second_band.tolist(),
                measured.is_lock_lost.tolist(),
                strict=True,
            )
        ):
            label = ("ambiguity", satellite, band)
            labels.append(label)
            last = self._last_seen.get(label)
            if is_lost and last is not None and last < time:
                state.remove([label])
            if label not in state:
                if band:
                    state.add(label, float(residual[row]), _UNKNOWN_AMBIGUITY_SIGMA**2)
                else:
                    # Phase less code, whose errors are the ionospheric delay and the code noise.
                    mean = float(measured.phase[row] - measured.code[row])
                    sigma = math.hypot(_SINGLE_FREQUENCY_DELAY_SIGMA, measured.code_sigma[row])
                    state.add(label, mean, sigma**2)
            self._last_seen[label] = time
        old = [k for k, last in self._last_seen.items() if time - last > _LONGEST_ARC_GAP]
        if old:
            state.remove(old)
            for label in old:
                del self._last_seen[label]
        return labels

    def _innovation(
        self,
        measured: Combinations,
        rows: npt.NDArray[np.intp],
        seen: Geometry,
        predicted: FloatArray,
        labels: list[tuple[str, int, int]],
    ) -> tuple[Innovation, list[int]]:
        """Return the innovation of codes and phases, and the row of `measured` of each.

        Codes are used of satellites with two frequencies only; they come before the phases.
        """
        state = self.state
        assert state is not None
        count = len(measured)
        code_rows = np.flatnonzero(measured.second_band > 0)
        order = np.concatenate((code_rows, np.arange(count)))
        size = len(order)
        design = np.zeros((size, len(state)))
        direction = -seen.direction[0, rows]
        design[:, :3] = direction[order]
        columns = [state.index(label) for label in labels]
        phase = np.arange(len(code_rows), size)
        design[phase, columns] = 1.0
        values = np.concatenate(
            (
                (measured.code - predicted)[code_rows],
                measured.phase - predicted - state.mean[columns],
            )
        )
        configuration = self._configuration
        variances = np.concatenate(
            (
                measured.code_sigma[code_rows] ** 2 + configuration.ephemeris_sigma**2,
                measured.phase_sigma**2 + configuration.ephemeris_phase_sigma**2,
            )
        )
        systems = np.unique(measured.system)
        nuisance = (measured.system[order, None] == systems[None, :]).astype(float)
        nuisance *= (1.0 - seen.range_rate[0, rows][order] / SPEED_OF_LIGHT)[:, None]
        return state.innovation(design, values, variances, nuisance), order.tolist()

"""Figures of the attitude of a recorded spacecraft: pointing, errors, dipole, wheel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.attitude import AttitudeRecording
from vtff_analysis.recordings.topics import key_part
from vtff_control.attitude.controller import MODES
from vtff_control.attitude.pointing import pointing_errors
from vtff_dynamics.attitude.quaternion import (
    conjugate,
    multiply,
    rotation_matrix,
    rotation_vector,
)
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "SETTLING",
    "AttitudeErrors",
    "attitude_errors",
    "mode_times",
    "pointing_angles_deg",
    "summarise_attitude",
]

SETTLING = 7200.0
"""Time from the begin of pointing to the begin of its statistics, s: more than one orbit."""

_SHORTEST = 600.0  # s of statistics


@dataclass(frozen=True, eq=False)
class AttitudeErrors:
    """True against estimated attitude, at the times that both have.

    Attributes
    ----------
    time
        ns since 1970.
    rotation
        True against estimated attitude as a rotation vector in body axes, rad, shape (rows, 3).
    dipole
        True less estimated dipole, A m2, shape (rows, 3).
    covariance
        Covariance of rotation, rate and dipole, shape (rows, 9, 9).
    valid
        True where the estimate may steer.
    """

    time: npt.NDArray[np.int64]
    rotation: FloatArray
    dipole: FloatArray
    covariance: FloatArray
    valid: npt.NDArray[np.bool_]

    @property
    def angle_deg(self) -> FloatArray:
        """Angle of the error, deg."""
        angle: FloatArray = np.degrees(np.linalg.norm(self.rotation, axis=1))
        return angle

    @property
    def sigma_deg(self) -> FloatArray:
        """Root of the trace of the covariance of the rotation, deg: what the angle should be."""
        trace = np.trace(self.covariance[:, :3, :3], axis1=1, axis2=2)
        sigma: FloatArray = np.degrees(np.sqrt(np.maximum(trace, 0.0)))
        return sigma

    def mean_nees(self, chosen: npt.NDArray[np.bool_]) -> float:
        """Return the mean normalised squared error of the rotation, over 3; nan without rows."""
        rows = chosen & (self.sigma_deg > 0.0)
        if not rows.any():
            return math.nan
        errors = self.rotation[rows]
        solved = np.linalg.solve(self.covariance[rows, :3, :3], errors[:, :, None])[..., 0]
        return float(np.einsum("ij,ij->i", errors, solved).mean()) / 3.0


def attitude_errors(recording: AttitudeRecording) -> AttitudeErrors | None:
    """Return the errors of the estimate; None without truth or estimate."""
    truth, estimate = recording.truth, recording.estimate
    if truth is None or estimate is None:
        return None
    time, of_truth, of_estimate = np.intersect1d(truth.time, estimate.time, return_indices=True)
    rotation = np.array(
        [
            rotation_vector(multiply(conjugate(estimated), true))
            for estimated, true in zip(
                estimate.quaternion[of_estimate], truth.quaternion[of_truth], strict=True
            )
        ]
    ).reshape(-1, 3)
    return AttitudeErrors(
        time,
        rotation,
        truth.dipole[of_truth] - estimate.dipole[of_estimate],
        estimate.covariance[of_estimate],
        estimate.valid[of_estimate],
    )


def pointing_angles_deg(recording: AttitudeRecording) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return times (ns) and roll, pitch, yaw to the orbit axes, deg; true ones where recorded."""
    columns = recording.truth or recording.estimate
    assert columns is not None
    chosen = np.linalg.norm(columns.state_gcrf[:, :3], axis=1) > 0.0
    angles = [
        np.degrees(pointing_errors(rotation_matrix(quaternion), rate, state).angles)
        for quaternion, rate, state in zip(
            columns.quaternion[chosen],
            columns.rate_body[chosen],
            columns.state_gcrf[chosen],
            strict=True,
        )
    ]
    return columns.time[chosen], np.array(angles).reshape(-1, 3)


def mode_times(recording: AttitudeRecording) -> list[tuple[int, str]]:
    """Return when the controller changed into which mode, ns; empty without a controller."""
    command = recording.command
    if command is None:
        return []
    changes = [0, *(np.nonzero(np.diff(command.mode))[0] + 1)]
    return [(int(command.time[row]), MODES[command.mode[row]]) for row in changes]


def summarise_attitude(
    recordings: Mapping[str, AttitudeRecording], start_time: int
) -> dict[str, Any]:
    """Return the keys ``attitude_...`` of docs/summary.md; empty without an attitude.

    Parameters
    ----------
    recordings
        By spacecraft.
    start_time
        Start of the run, ns since 1970.
    """
    summary: dict[str, Any] = {}
    for name, recording in recordings.items():
        prefix = f"{key_part(name)}_" if len(recordings) > 1 else ""
        numbers = _summarise(recording, start_time)
        summary |= {f"{prefix}attitude_{key}": value for key, value in numbers.items()}
    return summary


def _summarise(recording: AttitudeRecording, start_time: int) -> dict[str, Any]:
    numbers: dict[str, Any] = {}
    modes = mode_times(recording)
    begin = math.inf
    if modes:
        numbers["mode"] = modes[-1][1]
        if modes[-1][1] == "point":
            begin = (modes[-1][0] - start_time) * 1e-9
        numbers["point_time_s"] = begin
    errors = attitude_errors(recording)
    settled_after = begin + SETTLING
    if errors is not None and len(errors.time):
        seconds = (errors.time - start_time) * 1e-9
        settled = errors.valid & (seconds >= settled_after)
        if seconds[-1] < settled_after + _SHORTEST:
            settled = errors.valid
        if settled.any():
            numbers["error_rms_deg"] = float(np.sqrt(np.mean(errors.angle_deg[settled] ** 2)))
            numbers["error_nees"] = errors.mean_nees(settled)
            dipole = np.linalg.norm(errors.dipole[settled], axis=1)
            numbers["dipole_error_rms_a_m2"] = float(np.sqrt(np.mean(dipole**2)))
    columns = recording.truth or recording.estimate
    assert columns is not None
    if len(columns.time):
        first, last = np.degrees(np.linalg.norm(columns.rate_body[[0, -1]], axis=1))
        numbers |= {"first_rate_deg_per_s": float(first), "last_rate_deg_per_s": float(last)}
    time, angles = pointing_angles_deg(recording)
    seconds = (time - start_time) * 1e-9
    if len(seconds) and seconds[-1] >= settled_after + _SHORTEST:
        settled = seconds >= settled_after
        for column, angle in enumerate(("roll", "pitch", "yaw")):
            numbers[f"{angle}_mean_deg"] = float(angles[settled, column].mean())
            numbers[f"{angle}_sigma_deg"] = float(angles[settled, column].std())
        speed = columns.wheel_speed_rpm[(columns.time - start_time) * 1e-9 >= settled_after]
        numbers["wheel_lowest_rpm"] = float(speed.min())
        numbers["wheel_highest_rpm"] = float(speed.max())
    if recording.command is not None:
        numbers["unanswered_periods"] = int((~recording.command.accepted).sum())
    return numbers

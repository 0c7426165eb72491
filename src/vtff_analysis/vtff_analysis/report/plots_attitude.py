"""Plots of the attitude of a spacecraft: pointing, errors, rates, dipole, wheel and rods."""

from __future__ import annotations

import math
import pathlib
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_analysis.evaluation.attitude import (
    AttitudeErrors,
    attitude_errors,
    mode_times,
    pointing_angles_deg,
)
from vtff_analysis.plot_style import (
    AXIS_COLOURS,
    AXIS_STYLES,
    ESTIMATE_COLOUR,
    MARK_COLOUR,
    STATE_COLOUR,
    STYLE,
    make_figure,
    save_figure,
    time_unit_of,
)
from vtff_analysis.recordings.attitude import AttitudeRecording

__all__ = ["plot_attitude", "plot_dipole"]

_PULSE_STEP = 0.01  # s
_NAME_WIDTH = 0.08  # of a mode, as a share of the width of the plot


def plot_attitude(
    recording: AttitudeRecording, start_time: int, path: pathlib.Path, title: str
) -> pathlib.Path:
    """Draw roll, pitch and yaw, the error of the estimate with its sigma, and the rates.

    Small angles and errors are left out where there are none.
    """
    time, angles = pointing_angles_deg(recording)
    errors = attitude_errors(recording)
    columns = recording.truth or recording.estimate
    assert columns is not None
    factor, unit = _unit(columns.time, start_time)
    small = np.where(np.abs(angles).max(axis=1, keepdims=True) < 10.0, angles, np.nan)
    has_small = bool(np.isfinite(small).any())
    has_errors = errors is not None and bool((errors.sigma_deg > 0.0).any())
    with mpl.rc_context(STYLE):
        count = 2 + has_small + has_errors
        figure = make_figure(2.75 * count)
        axes: Any = figure.subplots(count, 1, sharex=True)
        _draw_axes(axes[0], (time - start_time) * factor, angles, ("roll", "pitch", "yaw"))
        axes[0].set_ylabel("to the orbit axes (deg)")
        if has_small:
            _draw_axes(axes[1], (time - start_time) * factor, small, ("roll", "pitch", "yaw"))
            axes[1].set(ylabel="the same, small angles (deg)", ylim=(-5.0, 5.0))
        if errors is not None and has_errors:
            _draw_errors(axes[-2], (errors.time - start_time) * factor, errors)
        rates = np.degrees(columns.rate_body)
        _draw_axes(axes[-1], (columns.time - start_time) * factor, rates, ("x", "y", "z"))
        axes[-1].set(ylabel="rate (deg/s)", xlabel=f"time since the start ({unit})")
        axes[-1].set_yscale("symlog", linthresh=0.1)
        for axis in axes:
            _mark_modes(axis, recording, start_time, factor, named=axis is axes[0])
        return save_figure(figure, path, title)


def _draw_errors(axis: Any, seconds: Any, errors: AttitudeErrors) -> None:
    """Draw errors and sigmas; those of an attitude that may not steer are faint."""
    is_known = errors.sigma_deg > 0.0
    for drawn, opacity in ((is_known & ~errors.valid, 0.25), (is_known & errors.valid, 1.0)):
        shown, label = np.where(drawn, 1.0, np.nan), "" if opacity == 1.0 else "_"
        axis.plot(
            seconds,
            shown * errors.angle_deg,
            color=STATE_COLOUR,
            alpha=opacity,
            label=label + "error",
        )
        axis.plot(
            seconds,
            shown * errors.sigma_deg,
            color=ESTIMATE_COLOUR,
            linestyle="--",
            alpha=opacity,
            label=label + "one sigma of the estimate",
        )
    axis.set_yscale("log")
    axis.set_ylabel("attitude error (deg)")
    axis.legend(loc="upper right")


def plot_dipole(
    recording: AttitudeRecording, start_time: int, path: pathlib.Path, title: str
) -> pathlib.Path:
    """Draw the dipole with its sigma beside the true one, the wheel, and the pulses of the rods.

    The dipole is left out where it has not been estimated.
    """
    columns = recording.estimate or recording.truth
    assert columns is not None
    factor, unit = _unit(columns.time, start_time)
    seconds = (columns.time - start_time) * factor
    with mpl.rc_context(STYLE):
        is_estimated = bool((columns.covariance[:, 6, 6] > 0.0).any())
        count = 2 + 3 * is_estimated
        figure = make_figure(2.2 * count)
        axes: Any = figure.subplots(count, 1, sharex=True)
        for row, (axis, name) in enumerate(zip(axes[:-2], "xyz", strict=False)):
            sigma = 1e3 * np.sqrt(np.maximum(columns.covariance[:, 6 + row, 6 + row], 0.0))
            value = np.where(sigma > 0.0, 1e3 * columns.dipole[:, row], np.nan)
            axis.fill_between(
                seconds,
                value - sigma,
                value + sigma,
                color=STATE_COLOUR,
                alpha=0.25,
                label="one sigma",
            )
            axis.plot(seconds, value, color=STATE_COLOUR, label="estimate")
            if recording.truth is not None:
                true = 1e3 * recording.truth.dipole[:, row]
                times = (recording.truth.time - start_time) * factor
                axis.plot(times, true, color="k", linestyle="--", lw=1.2, label="truth")
                middle = float(np.median(true))
                axis.set_ylim(middle - 40.0, middle + 40.0)
            axis.set_ylabel(f"dipole {name} (mA m$^2$)")
        if is_estimated:
            axes[0].legend(loc="upper right", ncols=3)
        axes[-2].plot(seconds, columns.wheel_speed_rpm, color=STATE_COLOUR)
        axes[-2].set_ylabel("wheel (rpm)")
        if recording.command is not None:
            _draw_axes(
                axes[-1],
                (recording.command.time - start_time) * factor,
                _PULSE_STEP * recording.command.pulse_steps,
                ("x", "y", "z"),
            )
        axes[-1].set(ylabel="pulse of the rod (s)", xlabel=f"time since the start ({unit})")
        for axis in axes:
            _mark_modes(axis, recording, start_time, factor, named=axis is axes[-2])
        return save_figure(figure, path, title)


def _unit(time: Any, start_time: int) -> tuple[float, str]:
    """Return the factor from ns to the unit of the time axis, and its name."""
    factor, unit = time_unit_of(float(time[-1] - start_time) * 1e-9)
    return factor * 1e-9, unit


def _draw_axes(axis: Any, time: Any, values: Any, names: tuple[str, ...]) -> None:
    for column, name in enumerate(names):
        axis.plot(
            time,
            values[:, column],
            color=AXIS_COLOURS[column],
            linestyle=AXIS_STYLES[column],
            lw=1.3,
            label=name,
        )
    axis.legend(loc="upper right", ncols=3)


def _mark_modes(
    axis: Any, recording: AttitudeRecording, start_time: int, factor: float, *, named: bool
) -> None:
    """Draw a line at each change of mode; names that would lie on another go below it."""
    low, high = axis.get_xlim()
    last, row = -math.inf, 0
    for time, mode in mode_times(recording):
        at = (time - start_time) * factor
        row = row + 1 if at - last < _NAME_WIDTH * (high - low) else 0
        last = at
        axis.axvline(at, color=MARK_COLOUR, lw=1.0, linestyle=":")
        if named:
            axis.annotate(
                mode,
                (at, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, -12 - 13 * row),
                textcoords="offset points",
                fontsize=10,
                color=MARK_COLOUR,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
            )

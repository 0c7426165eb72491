"""The attitude estimator alone on a recorded log of the ADCS module's CAN bus."""

from __future__ import annotations

import pathlib
from collections.abc import Iterator, Sequence

import numpy as np

from vtff_control.adcs.frames import AdcsFrames
from vtff_control.adcs.log import read_reports
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_nav.attitude.onboard import ModuleReport, OnboardAttitude, OnboardAttitudeEstimator
from vtff_nav.attitude.orbit_memory import OrbitMemory

__all__ = ["estimate_from_log"]


def estimate_from_log(
    log_file: str | pathlib.Path,
    frames: AdcsFrames,
    orbit: OrbitMemory,
    estimator: OnboardAttitudeEstimator,
    sample_times: Sequence[float] = (0.8, 0.0),
    pulse_step: float = 0.01,
) -> Iterator[tuple[int, OnboardAttitude]]:
    """Return stamp, ns since 1970, and what is known on board at the end of each period of a log.

    A period whose report is missing is bridged with the rods off.

    Parameters
    ----------
    log_file
        Log in candump's format, stamped with scenario time (parameter `log_file` of `adcs_can`).
    frames
        Decoder of the DBC file.
    orbit
        Orbit at the ends of the periods, or a state before them from which it is predicted.
    estimator
        A new estimator.
    sample_times
        Times of the samples before the end of a period, s, falling.
    pulse_step
        Length of a step of a pulse, s.

    Raises
    ------
    vtff_control.adcs.log.AdcsLogError
        If the log cannot be used.
    ValueError
        If the orbit at a period is not known.
    """
    last = None
    for stamp, content in read_reports(log_file, frames):
        period = round(content.period * NANOSECONDS_PER_SECOND)
        while last is not None and period > 0 and stamp - last >= 2 * period:
            last += period
            silent = ModuleReport(
                content.period,
                np.empty((0, 3)),
                (),
                content.wheel_speed_rpm,
                content.wheel_command_rpm,
                np.zeros(3),
                heard=False,
            )
            yield last, _process(estimator, orbit, last, period, silent)
        last = stamp
        count = len(content.field_body)
        report = ModuleReport(
            content.period,
            content.field_body[: len(sample_times)],
            tuple(sample_times[:count]),
            content.wheel_speed_rpm,
            content.wheel_command_rpm,
            pulse_step * np.array(content.pulse_steps, dtype=float),
        )
        yield stamp, _process(estimator, orbit, stamp, period, report)


def _process(
    estimator: OnboardAttitudeEstimator,
    orbit: OrbitMemory,
    stamp: int,
    period: int,
    report: ModuleReport,
) -> OnboardAttitude:
    start, end = orbit.at(stamp - period), orbit.at(stamp)
    if start is None or end is None:
        raise ValueError(f"orbit: not known at {stamp * 1e-9:.2f} s since 1970")
    return estimator.process(report, start.state_gcrf, start.field_gcrf, end.field_gcrf)

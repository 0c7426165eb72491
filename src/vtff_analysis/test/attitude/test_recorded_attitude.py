"""Attitude of a recording: what is read, its figures, its plots, its verdict."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from vtff_analysis.evaluation.attitude import SETTLING, mode_times, summarise_attitude
from vtff_analysis.recordings.attitude import AttitudeCollector, AttitudeRecording
from vtff_analysis.report.plots_attitude import plot_attitude, plot_dipole
from vtff_analysis.report.verdict import find_verdict
from vtff_control.attitude.controller import MODES
from vtff_dynamics.attitude.orbit_axes import (
    quaternion_from_roll_pitch_yaw,
    rotation_gcrf_to_orbit,
)
from vtff_dynamics.attitude.quaternion import from_rotation_vector, multiply

START = 981590400
PERIOD = 60
STATE = np.array([7e6, 0.0, 0.0, 0.0, 1e3, 7.4e3])
SIGMA = np.radians(0.5)
DIPOLE = np.array([0.03, 0.04, -0.12])


def stamp(seconds: float) -> SimpleNamespace:
    return SimpleNamespace(stamp=SimpleNamespace(sec=START + int(seconds), nanosec=0))


def state(seconds: float, quaternion: np.ndarray, dipole: np.ndarray, **others: object):
    return SimpleNamespace(
        header=stamp(seconds),
        quaternion=quaternion,
        rate_body=np.zeros(3),
        dipole=dipole,
        position_gcrf=STATE[:3],
        velocity_gcrf=STATE[3:],
        wheel_speed_rpm=-2700.0,
        valid=True,
        covariance=others.get("covariance", np.zeros(81)),
    )


def recording(duration: float, begin: float = 600.0, **topics: bool) -> AttitudeRecording:
    """Return a flight that points 2 deg off in roll from `begin` on, estimated with SIGMA."""
    collector = AttitudeCollector()
    truth = collector.handler("/snap1/truth/attitude")
    estimate = collector.handler("/snap1/attitude")
    command = collector.handler("/snap1/adcs/actuation")
    generator = np.random.default_rng(5)
    covariance = np.diag([SIGMA**2] * 3 + [1e-10] * 3 + [1e-6] * 3).ravel()
    for seconds in np.arange(0.0, duration, PERIOD):
        roll = np.radians(2.0 + 0.1 * (-1) ** int(seconds / PERIOD))
        true = quaternion_from_roll_pitch_yaw(roll, 0.0, 0.0, rotation_gcrf_to_orbit(STATE))
        error = from_rotation_vector(SIGMA * generator.standard_normal(3))
        if topics.get("has_truth", True):
            truth(state(seconds, true, DIPOLE))
        estimate(
            state(seconds, multiply(true, error), DIPOLE + [0.0, 0.0, 3e-3], covariance=covariance)
        )
        mode = MODES.index("point" if seconds >= begin else "compass")
        command(
            SimpleNamespace(
                header=stamp(seconds), mode=mode, pulse_steps=(1, 2, 3), accepted=seconds > 0.0
            )
        )
    return collector.recordings()["snap1"]


def test_other_topics_are_left_to_others():
    collector = AttitudeCollector()
    assert collector.handler("/snap1/truth/orbit") is None
    assert collector.handler("/snap1/adcs/report") is None
    assert collector.recordings() == {}


def test_figures_are_those_of_the_flight():
    flight = recording(SETTLING + 60_000.0)
    numbers = summarise_attitude({"snap1": flight}, START * 10**9)
    assert numbers["attitude_mode"] == "point" and numbers["attitude_point_time_s"] == 600.0
    assert numbers["attitude_roll_mean_deg"] == pytest.approx(2.0, abs=2e-3)
    assert numbers["attitude_roll_sigma_deg"] == pytest.approx(0.1, abs=1e-4)
    assert numbers["attitude_pitch_sigma_deg"] == pytest.approx(0.0, abs=1e-9)
    assert numbers["attitude_error_rms_deg"] == pytest.approx(0.5 * np.sqrt(3.0), rel=0.06)
    assert numbers["attitude_error_nees"] == pytest.approx(1.0, abs=0.12)
    assert numbers["attitude_dipole_error_rms_a_m2"] == pytest.approx(3e-3)
    assert numbers["attitude_wheel_lowest_rpm"] == numbers["attitude_wheel_highest_rpm"] == -2700
    assert numbers["attitude_unanswered_periods"] == 1
    assert [mode for _, mode in mode_times(flight)] == ["compass", "point"]


def test_a_short_flight_has_errors_and_no_angles_and_without_truth_no_errors():
    short = summarise_attitude({"snap1": recording(3000.0)}, START * 10**9)
    assert "attitude_error_rms_deg" in short and "attitude_roll_sigma_deg" not in short
    blind = summarise_attitude({"snap1": recording(3000.0, has_truth=False)}, START * 10**9)
    assert "attitude_error_rms_deg" not in blind and blind["attitude_mode"] == "point"
    both = summarise_attitude({"a": recording(3000.0), "b": recording(3000.0)}, START * 10**9)
    assert {"a_attitude_mode", "b_attitude_mode"} <= set(both)


def test_the_verdict_is_about_attitude_where_nothing_else_flew():
    summary = {"run_duration_s": 20000.0}
    summary |= summarise_attitude({"snap1": recording(20000.0)}, START * 10**9)
    verdict = find_verdict(summary, [])
    assert verdict.subject == "attitude"
    assert "points at the Earth from 600 s on" in verdict.sentence
    assert [figure.label for figure in verdict.figures][:3] == [
        "roll, one sigma", "pitch, one sigma", "yaw, one sigma",
    ]  # fmt: skip
    never = {"run_duration_s": 900.0}
    never |= summarise_attitude({"snap1": recording(900.0, begin=1e9)}, START * 10**9)
    assert "ended in mode compass" in find_verdict(never, []).sentence


def test_plots_are_drawn_with_and_without_truth(tmp_path):
    for number, has_truth in enumerate((True, False)):
        flight = recording(3000.0, has_truth=has_truth)
        for draw in (plot_attitude, plot_dipole):
            path = draw(flight, START * 10**9, tmp_path / f"{number}{draw.__name__}.png", "title")
            assert path.stat().st_size > 20_000

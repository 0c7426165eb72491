"""Node `attitude_controller`: from tumbling to pointing, one command in each period."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from vtff_control.attitude.controller import (
    MODES,
    AttitudeCommand,
    AttitudeControlConfiguration,
    AttitudeController,
    AttitudeKnowledge,
    ControlMode,
)
from vtff_control.attitude.timeline import parse_timeline
from vtff_control.attitude.torquers import TorquerLimits
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_msgs.msg import AdcsCommand, AdcsReport, AttitudeState
from vtff_node import diagnostics
from vtff_node.main import run_node
from vtff_node.node import VtffNode
from vtff_node.parameters import ParameterError, parameter
from vtff_node.stamps import StampOrder, to_nanoseconds

_CONTROL = AttitudeControlConfiguration
_DEFAULT = AttitudeControlConfiguration()
_LIMITS = TorquerLimits


@dataclass(frozen=True)
class AttitudeControllerParameters:
    """Parameters of `attitude_controller`."""

    spacecraft: str = parameter("spacecraft", "spacecraft that is turned")
    timeline: list[str] = parameter(
        ["0 point"],
        "'<seconds> <mode>': what is asked for from then on (off, detumble, thomson, compass, "
        "acquire, point; the way there is found); '<seconds> fire <seconds>': the thruster fires",
    )
    initial_mode: str = parameter(
        "",
        "mode of the spacecraft when the run begins; empty: that of the timeline, but detumble on "
        "the way to an attitude",
        choices=("", *MODES),
    )
    inertia: list[float] = parameter(
        np.diag(np.asarray(_DEFAULT.inertia)).tolist(), "principal moments, x y z", unit="kg m^2"
    )
    wheel_axis: list[float] = parameter(
        np.asarray(_DEFAULT.wheel_axis).tolist(), "axis of the wheel in the body"
    )
    wheel_inertia: float = parameter(_CONTROL.wheel_inertia, "momentum over rate", unit="kg m^2")
    wheel_largest_torque: float = parameter(_CONTROL.wheel_largest_torque, "motor", unit="N m")
    torquer_moment: float = parameter(_LIMITS.moment, "of a rod that is on", unit="A m^2")
    period: float = parameter(_LIMITS.period, "period of the ADCS", unit="s")
    quiet_window: float = parameter(
        _LIMITS.quiet_window, "end of a period without pulses, for the magnetometer", unit="s"
    )
    pulse_step: float = parameter(_LIMITS.pulse_step, "length of a step of a pulse", unit="s")
    compensation: str = parameter(
        _CONTROL.compensation,
        "against the residual dipole while pointing",
        choices=("none", "fixed", "estimated"),
    )
    fixed_compensation: list[float] = parameter(
        [0.0, 0.0, 0.0], "mean moment of the biased pulses", unit="A m^2"
    )
    pointing_wheel_rpm: float = parameter(_CONTROL.pointing_wheel_rpm, "while pointing", unit="rpm")
    compass_wheel_rpm: float = parameter(
        _CONTROL.compass_wheel_rpm, "before the wheel is started", unit="rpm"
    )
    settling_time: float = parameter(_CONTROL.settling_time, "of pitch to 2 %", unit="s")
    pitch_reference_deg: float = parameter(0.0, "wanted pitch", unit="deg")
    b_dot_gain: float = parameter(
        _CONTROL.b_dot_gain, "torque over rate while tumbling", unit="N m s", minimum=0.0
    )
    compass_gain: float = parameter(
        _CONTROL.compass_gain, "torque over rate in compass mode", unit="N m s", minimum=0.0
    )
    thomson_spin: float = parameter(_CONTROL.thomson_spin, "reference of the spin", unit="rad/s")
    detumbled_rate: float = parameter(
        _CONTROL.detumbled_rate, "rate below which the body no longer tumbles", unit="rad/s"
    )
    dipole_sigma: float = parameter(
        _CONTROL.dipole_sigma, "sigma with which the wheel may be started", unit="A m^2"
    )


class AttitudeControllerNode(VtffNode):
    """Attitude controller of one spacecraft, run in its namespace.

    Subscribes to adcs/report (vtff_msgs/AdcsReport) and attitude (vtff_msgs/AttitudeState); for
    each report it publishes adcs/command (vtff_msgs/AdcsCommand) for the period that begins then,
    when the attitude of the same stamp has come. If the next report comes first, the estimator is
    silent: the controller then goes on without attitude.
    """

    Parameters = AttitudeControllerParameters

    def __init__(self, **node_arguments: object) -> None:
        super().__init__("attitude_controller", **node_arguments)
        given: AttitudeControllerParameters = self.parameters
        try:
            configuration = AttitudeControlConfiguration(
                inertia=given.inertia,
                wheel_axis=given.wheel_axis,
                wheel_inertia=given.wheel_inertia,
                wheel_largest_torque=given.wheel_largest_torque,
                limits=TorquerLimits(
                    given.torquer_moment, given.period, given.quiet_window, given.pulse_step
                ),
                compensation=given.compensation,  # type: ignore[arg-type]
                fixed_compensation=given.fixed_compensation,
                pointing_wheel_rpm=given.pointing_wheel_rpm,
                compass_wheel_rpm=given.compass_wheel_rpm,
                settling_time=given.settling_time,
                pitch_reference=math.radians(given.pitch_reference_deg),
                b_dot_gain=given.b_dot_gain,
                compass_gain=given.compass_gain,
                thomson_spin=given.thomson_spin,
                detumbled_rate=given.detumbled_rate,
                dipole_sigma=given.dipole_sigma,
            )
        except ValueError as error:
            raise ParameterError(f"parameter {error}") from error
        try:
            self._timeline = parse_timeline(given.timeline)
        except ValueError as error:
            raise ParameterError(f"parameter 'timeline': {error}") from error
        first = self._timeline.mode_at(0.0)
        start: ControlMode = "detumble" if first in ("compass", "acquire", "point") else first
        start = next((mode for mode in MODES if mode == given.initial_mode), start)
        self._requested = first
        self._controller = AttitudeController(configuration, first, start)
        self._order = StampOrder()
        self._report: AdcsReport | None = None
        self._attitude: AttitudeState | None = None
        self._first_stamp = -1
        self._command: AttitudeCommand | None = None
        self._counts = {"commands": 0, "without attitude": 0, "module silent": 0}
        self._silent = False
        self._heard = True
        self._publisher = self.publisher(AdcsCommand, "adcs/command")
        self.subscribe(AdcsReport, "adcs/report", self._on_report)
        self.subscribe(AttitudeState, "attitude", self._on_attitude)

    def _on_report(self, message: AdcsReport) -> None:
        if not self.is_of_deputy(message, self.parameters.spacecraft, "adcs/report"):
            return
        if not self._order.accepts(to_nanoseconds(message.header.stamp)):
            return
        # The report before has no attitude: its period is over, this one is steered without.
        self._silent = self._report is not None
        self._report = message
        if self._silent and not self._attitude_is_there():
            self._act(None)
        else:
            self._act_when_complete()

    def _on_attitude(self, message: AttitudeState) -> None:
        self._attitude = message
        self._act_when_complete()

    def _attitude_is_there(self) -> bool:
        return (
            self._report is not None
            and self._attitude is not None
            and self._attitude.header.stamp == self._report.header.stamp
        )

    def _act_when_complete(self) -> None:
        if self._attitude_is_there():
            self._silent = False
            self._act(self._attitude)

    def _act(self, attitude: AttitudeState | None) -> None:
        """Publish the command of the period that begins with the report."""
        started = time.perf_counter()
        report, self._report = self._report, None
        assert report is not None
        stamp = to_nanoseconds(report.header.stamp)
        if self._first_stamp < 0:
            self._first_stamp = stamp
        elapsed = (stamp - self._first_stamp) / NANOSECONDS_PER_SECOND
        mode = self._timeline.mode_at(elapsed)
        if mode != self._requested:
            self._requested = mode
            self._controller.request(mode)
        self._heard = report.heard
        self._counts["commands"] += 1
        self._counts["without attitude"] += attitude is None
        self._counts["module silent"] += not report.heard
        command = self._controller.command(_knowledge(report, attitude))
        self._command = command
        message = AdcsCommand(
            header=report.header,
            child_frame_id=report.child_frame_id,
            mode=MODES.index(command.mode),
            accepted=True,
            pulse_steps=command.pulse_steps,
            wheel_speed_rpm=float(command.wheel_speed_rpm),
            reason="estimator silent" if attitude is None else command.reason,
        )
        firing = self._timeline.firing_in(elapsed, self.parameters.period)
        if firing is not None:
            message.firing_start_steps = round(
                (firing.start - elapsed) / self.parameters.pulse_step
            )
            message.firing_steps = round(firing.duration / self.parameters.pulse_step)
        self._publisher.publish(message)
        self.acknowledge_step(report.header.stamp, started)

    def health(self) -> list[diagnostics.DiagnosticStatus]:
        """Report the mode and what keeps the controller from the one that it is asked for."""
        level, text = diagnostics.WARN, "no report yet"
        command = self._command
        if command is not None:
            level, text = diagnostics.OK, command.mode
            if not self._heard:
                level, text = diagnostics.ERROR, "nothing heard from the ADCS module"
            elif self._silent:
                level, text = diagnostics.ERROR, f"{command.mode}: estimator silent"
            elif command.reason:
                level, text = diagnostics.WARN, f"{command.mode}: {command.reason}"
        return [
            diagnostics.status(
                f"{self.get_name()}: mode",
                level,
                text,
                {"asked for": self._requested, **self._counts},
                hardware_id=self.parameters.spacecraft,
            )
        ]


def _knowledge(report: AdcsReport, attitude: AttitudeState | None) -> AttitudeKnowledge:
    """Return what the controller is told by two messages; without attitude the samples alone."""
    samples = np.array(report.field_body).reshape(-1, 3)
    times = report.sample_times
    knows_attitude = attitude is not None and attitude.valid
    covariance = np.zeros(81) if attitude is None else np.asarray(attitude.covariance)
    variance = covariance.reshape(9, 9).diagonal()[6:]
    orbit = np.zeros(6)
    if attitude is not None:
        orbit = np.concatenate((attitude.position_gcrf, attitude.velocity_gcrf))
    return AttitudeKnowledge(
        samples_body=samples,
        sample_interval=times[0] - times[-1] if len(times) > 1 else 0.0,
        wheel_speed_rpm=report.wheel_speed_rpm if attitude is None else attitude.wheel_speed_rpm,
        wheel_follows=attitude is None or attitude.wheel_follows,
        attitude_is_valid=knows_attitude,
        quaternion_gcrf=np.array(attitude.quaternion if attitude is not None else (0, 0, 0, 1.0)),
        rate_body=np.zeros(3) if attitude is None else np.array(attitude.rate_body),
        dipole=np.zeros(3) if attitude is None else np.array(attitude.dipole),
        dipole_sigma=math.sqrt(float(variance.max())) if variance.max() > 0.0 else math.inf,
        state_gcrf=orbit,
        field_is_valid=report.heard and (attitude is None or attitude.field_valid),
    )


NODE_CLASS = AttitudeControllerNode


def main() -> None:
    """Run the node."""
    run_node(AttitudeControllerNode)

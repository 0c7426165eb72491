"""Bag of a run -> `RunHistory`, in one pass over the bag; needs rclpy."""

from __future__ import annotations

import functools
import pathlib
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from vtff_analysis.recordings.attitude import AttitudeCollector
from vtff_analysis.recordings.guidance import GUIDANCE_TOPIC, GuidanceCollector
from vtff_analysis.recordings.history import (
    AccelerationHistory,
    DeputyHistory,
    NavigationHistory,
    ReceiverHistory,
    RelativeStateHistory,
    RunHistory,
    SimulatorReport,
)
from vtff_analysis.recordings.recording_details import DetailCollector
from vtff_analysis.recordings.safety import SAFETY_TOPIC, SafetyCollector
from vtff_analysis.recordings.topics import CHIEF, DEPUTY, STATUS_TOPIC, relative_state_topic
from vtff_analysis.survey.recording import SURVEY_TOPIC, SurveyCollector
from vtff_bag.file.errors import UnknownTypeError
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader, RawMessage
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_msgs.msg import RelativeState, SimulatorStatus
from vtff_node.conversions.gnss import ephemeris_from_message
from vtff_node.stamps import to_nanoseconds

#: Name of a receiver whose topics have no namespace.
UNNAMED_RECEIVER = "receiver"

_PACINGS = {
    SimulatorStatus.PACING_LOCKSTEP: "lockstep",
    SimulatorStatus.PACING_REALTIME: "realtime",
}

_THRUST_TOPIC = re.compile(
    r"^/(?P<deputy>.+)/(?P<what>control/thrust_command|propulsion/thrust_applied)$"
)
_GNSS_TOPIC = re.compile(r"^(?:/(?P<receiver>.+))?/gnss/(?P<what>epoch|fix|ephemeris)$")

#: Columns of a relative state: position and velocity; of an estimate also their sigmas and quality.
_POSITION, _VELOCITY = slice(0, 3), slice(3, 6)
_POSITION_SIGMA, _VELOCITY_SIGMA = slice(6, 9), slice(9, 12)
_QUALITY = ("solution", "satellites_used", "ambiguities_fixed", "ratio", "innovation_rms")
_STATE_WIDTH = 6
_POSITION_COVARIANCE = slice(12, 21)
_ESTIMATE_WIDTH = 21 + len(_QUALITY)

Handler = Callable[[Any], None]


def read_run(bag: pathlib.Path) -> RunHistory:
    """Read what a report needs from a bag.

    Parameters
    ----------
    bag
        Bag directory or file. Topics that it does not have are missing in the result.

    Returns
    -------
    RunHistory

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag or nothing in it can be read.
    """
    reader = BagReader(bag)
    collector = _Collector()
    details = DetailCollector()
    safety = SafetyCollector()
    survey = SurveyCollector()
    attitude = AttitudeCollector()
    guidance = GuidanceCollector()
    decoders: dict[str, Callable[[RawMessage], None]] = {}
    for topic in reader.topics.values():
        handler = (
            collector.handler(topic.name)
            or details.handler(topic.name)
            or attitude.handler(topic.name)
        )
        if topic.name == SAFETY_TOPIC:
            handler = safety.add
        elif topic.name == GUIDANCE_TOPIC:
            handler = guidance.add
        elif topic.name == SURVEY_TOPIC:
            handler = survey.add
        if handler is None:
            continue
        try:
            decoders[topic.name] = _make_decoder(message_class(topic.type), handler)
        except UnknownTypeError as error:
            collector.notes.append(f"topic '{topic.name}' is left out: {error}")
    last_status: RawMessage | None = None
    for raw in reader.raw_messages(list(decoders)):
        if raw.topic == STATUS_TOPIC:
            last_status = raw  # the report needs only the last status
        else:
            _decode(decoders, raw, collector.notes)
    if last_status is not None:
        _decode(decoders, last_status, collector.notes)
    pairs = details.pairs()
    history = RunHistory(
        start_time=reader.start_time,
        end_time=reader.end_time,
        message_counts={topic.name: topic.message_count for topic in reader.topics.values()},
        deputies=collector.deputies(),
        receivers=collector.receivers(),
        simulator=collector.simulator,
        slant_tec=details.slant_tec(),
        scintillation=details.scintillation(),
        chief=collector.chief,
        pairs=pairs,
        health=details.health(),
        safety=safety.history,
        attitude=attitude.recordings(),
        guidance=guidance.history(),
        survey=survey.history,
        compute_time=details.compute_time(),
        command_latency=details.command_latency(),
        notes=tuple([*reader.notes, *collector.notes]),
    )
    # A run with one deputy is seen as its pair; reports go through `RunHistory.pairs`.
    return history.of_pair(next(iter([*pairs, *history.deputies]), DEPUTY))


def _make_decoder(message_type: Any, handler: Handler) -> Callable[[RawMessage], None]:
    def decode(raw: RawMessage) -> None:
        handler(deserialize_message(raw.serialized, message_type))

    return decode


def _decode(
    decoders: dict[str, Callable[[RawMessage], None]], raw: RawMessage, notes: list[str]
) -> None:
    """Hand a message to its handler; after a message that does not decode its topic is left out."""
    decode = decoders.get(raw.topic)
    if decode is None:
        return
    try:
        decode(raw)
    except Exception as error:  # rclpy raises its own and C++ exceptions here
        del decoders[raw.topic]
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        notes.append(f"topic '{raw.topic}': unreadable from {raw.log_time} ns on: {reason}")


class _Rows:
    """Collects times and rows of numbers, and returns them as arrays."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._times: list[int] = []
        self._rows: list[Any] = []

    def add(self, time: int, row: Any) -> None:
        self._times.append(time)
        self._rows.append(row)

    def arrays(self) -> tuple[Any, Any]:
        """Return ascending times (n,) without repetition, and rows (n, width)."""
        times, first = np.unique(np.array(self._times, dtype=np.int64), return_index=True)
        return times, np.array(self._rows, dtype=float).reshape(-1, self._width)[first]


class _Receiver:
    """Collects the messages of one receiver."""

    _COLUMNS = ("system", "prn", "band", "attribute", "flags", "cn0_dbhz")

    def __init__(self) -> None:
        self._epoch_times: list[int] = []
        self._counts: list[int] = []
        self._columns: dict[str, list[Any]] = {name: [] for name in self._COLUMNS}
        self._fixes: list[tuple[int, int]] = []
        self._positions: list[Any] = []
        self._ephemerides: list[BroadcastEphemeris] = []

    def add_epoch(self, message: Any) -> None:
        self._epoch_times.append(to_nanoseconds(message.header.stamp))
        self._counts.append(len(message.system))
        for name, column in self._columns.items():
            column.append(np.array(getattr(message, name), dtype=OBSERVATION_COLUMNS[name]))

    def add_fix(self, message: Any) -> None:
        self._fixes.append((to_nanoseconds(message.header.stamp), message.status))
        self._positions.append(message.position)

    def add_ephemeris(self, message: Any) -> None:
        self._ephemerides.append(ephemeris_from_message(message))

    def history(self, name: str) -> ReceiverHistory:
        columns = {
            name: np.concatenate([np.empty(0, OBSERVATION_COLUMNS[name]), *epochs])
            for name, epochs in self._columns.items()
        }
        fixes = np.array(self._fixes, dtype=np.int64).reshape(-1, 2)
        satellites = [(ephemeris.system, ephemeris.prn) for ephemeris in self._ephemerides]
        ephemerides = np.array(satellites, dtype=np.uint8).reshape(-1, 2)
        return ReceiverHistory(
            name=name,
            epoch_time=np.array(self._epoch_times, dtype=np.int64),
            observations_per_epoch=np.array(self._counts, dtype=np.int64),
            fix_time=fixes[:, 0],
            fix_status=fixes[:, 1].astype(np.uint8),
            ephemeris_system=ephemerides[:, 0],
            ephemeris_prn=ephemerides[:, 1],
            fix_position_itrf=np.array(self._positions, dtype=float).reshape(-1, 3),
            ephemerides=tuple(self._ephemerides),
            **columns,
        )


def _navigation_history(times: Any, values: Any) -> NavigationHistory:
    solution, satellites, ambiguities, ratio, innovation = values[:, -len(_QUALITY) :].T
    return NavigationHistory(
        time=times,
        position_sigma_rtn=values[:, _POSITION_SIGMA],
        velocity_sigma_rtn=values[:, _VELOCITY_SIGMA],
        solution=solution.astype(np.uint8),
        satellites_used=satellites.astype(np.uint8),
        ambiguities_fixed=ambiguities.astype(np.uint16),
        ratio=ratio,
        innovation_rms=innovation,
        position_covariance_rtn=values[:, _POSITION_COVARIANCE].reshape(-1, 3, 3),
    )


class _Collector:
    """Sorts messages by spacecraft while the bag is read."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.chief = CHIEF
        self.simulator: SimulatorReport | None = None
        self._relative: dict[str, dict[str, _Rows]] = {}
        self._thrust: dict[str, dict[str, _Rows]] = {}
        self._receivers: dict[str, _Receiver] = {}

    def handler(self, topic: str) -> Handler | None:
        """Return the function that takes the messages of a topic; None for an unused topic."""
        relative = relative_state_topic(topic)
        if relative is not None:
            return functools.partial(self._add_relative_state, *relative)
        if topic == STATUS_TOPIC:
            return self._set_status
        thrust = _THRUST_TOPIC.match(topic)
        if thrust is not None:
            what = "command" if thrust["what"] == "control/thrust_command" else "applied"
            rows = self._thrust.setdefault(thrust["deputy"], {}).setdefault(what, _Rows(3))
            return functools.partial(self._add_acceleration, rows)
        gnss = _GNSS_TOPIC.match(topic)
        if gnss is not None:
            name = gnss["receiver"] or UNNAMED_RECEIVER
            receiver = self._receivers.setdefault(name, _Receiver())
            handlers: dict[str, Handler] = {
                "epoch": receiver.add_epoch,
                "fix": receiver.add_fix,
                "ephemeris": receiver.add_ephemeris,
            }
            return handlers[gnss["what"]]
        return None

    def _add_relative_state(self, name: str, what: str, message: Any) -> None:
        if message.child_frame_id != name:
            raise ValueError(f"it names '{message.child_frame_id}', not the deputy '{name}'")
        self.chief = message.header.frame_id.rpartition("/")[0] or self.chief
        row = np.concatenate((message.position, message.velocity))
        unusable = what == "estimate" and message.solution == RelativeState.SOLUTION_NONE
        if unusable or not np.isfinite(row).all():
            return
        deputy = self._relative.setdefault(name, {})
        if what == "estimate":
            variance = np.asarray(message.covariance)[::7]  # the diagonal of a 6 by 6 matrix
            sigma = np.sqrt(np.where(variance > 0.0, variance, 0.0))
            position = np.asarray(message.covariance).reshape(6, 6)[:3, :3].ravel()
            quality = [getattr(message, name) for name in _QUALITY]
            row = np.concatenate((row, sigma, position, quality))
        width = _ESTIMATE_WIDTH if what == "estimate" else _STATE_WIDTH
        deputy.setdefault(what, _Rows(width)).add(to_nanoseconds(message.header.stamp), row)

    @staticmethod
    def _add_acceleration(rows: _Rows, message: Any) -> None:
        linear = message.accel.linear
        rows.add(to_nanoseconds(message.header.stamp), (linear.x, linear.y, linear.z))

    def _set_status(self, message: Any) -> None:
        self.simulator = SimulatorReport(
            scenario=message.scenario,
            pacing=_PACINGS.get(message.pacing, "unknown"),
            complete=message.state == SimulatorStatus.STATE_ENDED,
            time_into_run=message.time_into_run,
            late_commands=message.late_commands,
            real_time_factor=message.real_time_factor,
        )

    def deputies(self) -> dict[str, DeputyHistory]:
        histories = {}
        for name in sorted({*self._relative, *self._thrust}):
            histories_of_deputy: dict[str, Any] = {}
            for what, rows in self._relative.get(name, {}).items():
                times, values = rows.arrays()
                histories_of_deputy[what] = RelativeStateHistory(
                    times, values[:, _POSITION], values[:, _VELOCITY]
                )
                if what == "estimate":
                    histories_of_deputy["navigation"] = _navigation_history(times, values)
            for what, rows in self._thrust.get(name, {}).items():
                times, values = rows.arrays()
                if times.size:
                    histories_of_deputy[what] = AccelerationHistory(times, values)
            if histories_of_deputy:
                histories[name] = DeputyHistory(name, **histories_of_deputy)
        return histories

    def receivers(self) -> dict[str, ReceiverHistory]:
        return {name: self._receivers[name].history(name) for name in sorted(self._receivers)}

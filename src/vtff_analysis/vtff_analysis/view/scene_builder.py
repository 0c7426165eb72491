"""Messages of a run, from a bag or from the graph -> `Scene`."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from vtff_analysis.recordings.topics import relative_state_topic
from vtff_analysis.view.attitude import attitude_row
from vtff_analysis.view.satellites import SatellitePositions
from vtff_analysis.view.scene import Scene
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.fix import STATUS_NONE
from vtff_gnss.signals import satellite_name
from vtff_msgs.msg import AttitudeState, FormationSafety, RelativeState
from vtff_node.conversions.gnss import ephemeris_from_message
from vtff_node.stamps import to_nanoseconds
from vtff_node.start.listeners import DIAGNOSTICS_TOPIC
from vtff_sim_bridge.atmosphere.walls import WALL_RADIUS

_CRAFT_TOPIC = re.compile(
    r"^/(?P<craft>.+?)/(?P<what>truth/orbit|gnss/fix|gnss/epoch|gnss/ephemeris"
    r"|truth/attitude|attitude|control/thrust_command|propulsion/thrust_applied|iono/slant_tec|iono/scintillation)$"
)
_BOUNDARY_TOPIC = re.compile(r"boundar")

_SAFETY_TOPIC = "/formation/safety"
_SURVEY_TOPIC = "/formation/survey"
_DENSITY_TOPIC = re.compile(r"^/(?P<deputy>.+)/iono/electron_density$")

#: Topics of which every message is taken, whatever the interval of the samples: nothing that
#: happens for a second only is missed.
_NEVER_THINNED = re.compile(
    r"(/gnss/ephemeris|boundar\w*|/target|/relative_state|/formation/(?:safety|survey)|/diagnostics)$"
)

_EPHEMERIS = "/gnss/ephemeris"
_EARTH_FRAME = "earth"
_ALL_SATELLITES = 255  # system of the row of all satellites combined, ElectronDensity.msg
_PER_CM3 = 1e-6  # per cm3 in 1/m3

_SOLUTIONS = {
    RelativeState.SOLUTION_NONE: "no solution",
    RelativeState.SOLUTION_PREDICTED: "predicted only",
    RelativeState.SOLUTION_CODE: "codes only",
    RelativeState.SOLUTION_FLOAT: "float",
}
_MODES = {
    FormationSafety.MODE_MONITOR: "clear",
    FormationSafety.MODE_WATCH: "watched",
    FormationSafety.MODE_EVADE: "evades",
    FormationSafety.MODE_HOLD: "taken over, thrust off",
}

#: Shortest time between samples, s, and the number of samples beyond which this time grows: plots
#: are a few hundred pixels wide, and the globe interpolates.
SHORTEST_INTERVAL = 1.0
LONGEST_SERIES = 2000
#: The slot of a sample begins this fraction of the interval early: arrival times jitter around
#: whole seconds.
_EARLY = 0.25


Handler = Callable[[int, Any], None]


def sample_interval(duration: float) -> float:
    """Return the time between samples, whole s, of a scene with this duration in s."""
    return max(SHORTEST_INTERVAL, float(math.ceil(duration / LONGEST_SERIES)))


class SceneBuilder:
    """Adds messages to a scene.

    Parameters
    ----------
    scene
        The scene; a scene without a start starts with the first message.
    interval
        Time between the samples that are kept of each topic, s.
    """

    def __init__(self, scene: Scene, interval: float = SHORTEST_INTERVAL) -> None:
        self.scene = scene
        self._slot = round(interval * NANOSECONDS_PER_SECOND)
        self._newest: dict[str, int] = {}
        self._satellites = SatellitePositions(scene)
        self._solutions: dict[str, int] = {}
        self._faults: dict[str, bytes] = {}
        self._survey = ("default", 0)  # phase and number of plans

    def handler(self, topic: str) -> Handler | None:
        """Return the function of (ns since 1970, message) for a topic; None if it is not shown."""
        relative = relative_state_topic(topic)
        if relative is not None:
            return functools.partial(self._add_relative, *relative)
        match = _CRAFT_TOPIC.match(topic)
        if match is not None:
            craft = match["craft"].replace("/", ".")
            add = {
                "truth/orbit": self._add_orbit,
                "truth/attitude": self._add_attitude,
                "attitude": self._add_attitude,
                "gnss/fix": self._add_fix,
                "gnss/epoch": self._add_epoch,
                "gnss/ephemeris": self._add_ephemeris,
                "control/thrust_command": self._add_command,
                "propulsion/thrust_applied": self._add_applied,
                "iono/slant_tec": self._add_slant_tec,
                "iono/scintillation": self._add_scintillation,
            }[match["what"]]
            return lambda stamp, message: add(craft, stamp, message)
        match = _DENSITY_TOPIC.match(topic)
        if match is not None:
            return functools.partial(self._add_density, match["deputy"])
        if _BOUNDARY_TOPIC.search(topic):
            return self._add_boundary
        return {
            _SAFETY_TOPIC: self._add_safety,
            _SURVEY_TOPIC: self._add_survey,
            DIAGNOSTICS_TOPIC: self._add_diagnostics,
        }.get(topic)

    def claim_slot(self, topic: str, time: int) -> bool:
        """Return whether a message of this time is kept; its slot is then taken.

        Only the first message of a topic in a slot is kept. The slots are the same for
        all topics, so that samples of one time stay together.

        Parameters
        ----------
        topic
            Topic of the message.
        time
            Log time or time of arrival in the scale of the stamps, ns since 1970.
        """
        return self._take_slot(topic, time) or bool(_NEVER_THINNED.search(topic))

    def _take_slot(self, name: str, time: int) -> bool:
        """Return whether the slot of a time, ns, was free for a name; it is taken then."""
        slot = (time + round(_EARLY * self._slot)) // self._slot
        if self._newest.get(name) == slot:
            return False
        self._newest[name] = slot
        return True

    def add(self, topic: str, time: int, message: Any) -> None:
        """Add a message at its own stamp, or at `time` (ns since 1970) where it has none."""
        handler = self.handler(topic)
        if handler is None:
            return
        header = getattr(message, "header", None)
        stamp = (to_nanoseconds(header.stamp) if header is not None else 0) or time
        if topic.endswith(_EPHEMERIS):
            # An ephemeris may be older than the run: it does not set the start of the scene.
            handler(stamp, message)
            return
        if not self.scene.start:
            self.scene.start = stamp
        handler(stamp, message)
        self.scene.duration = max(self.scene.duration, self.scene.seconds(stamp))

    def finish(self) -> None:
        """Place the satellites up to the end of the scene."""
        self._satellites.extend()

    # ---- handlers ----------------------------------------------------------------------------

    def _add_orbit(self, craft: str, stamp: int, message: Any) -> None:
        state = np.concatenate((message.position, message.velocity))
        if not np.isfinite(state).all():
            return
        if message.header.frame_id != _EARTH_FRAME:
            state = state_gcrf_to_itrf(GpsTime.from_unix_nanoseconds(stamp), state)
        self.scene.add("orbit", stamp, state.tolist(), craft=craft, source="truth")

    def _add_fix(self, craft: str, stamp: int, message: Any) -> None:
        state = np.concatenate((message.position, message.velocity))
        if message.status == STATUS_NONE or not np.isfinite(state).all():
            return
        self.scene.add("orbit", stamp, state.tolist(), craft=craft, source="receiver")

    def _add_attitude(self, craft: str, stamp: int, message: Any) -> None:
        state = np.concatenate((message.position_gcrf, message.velocity_gcrf))
        is_truth = message.source == AttitudeState.SOURCE_TRUTH
        if not (np.linalg.norm(state[:3]) > 0.0 and (is_truth or message.valid)):
            return
        source = "truth" if is_truth else "estimate"
        row = attitude_row(stamp, np.asarray(message.quaternion), message.rate_body, state)
        row.append(float(message.wheel_speed_rpm))
        series = self.scene.series.get(f"attitude/{craft}/{source}")
        if series is not None:
            before = [column[-1] for column in series.values[:4]]
            if np.dot(before, row[:4]) < 0.0:  # the same rotation; the page interpolates
                row[:4] = [-value for value in row[:4]]
        self.scene.add("attitude", stamp, row, craft=craft, source=source)

    def _add_epoch(self, craft: str, stamp: int, message: Any) -> None:
        strongest: dict[tuple[int, int], float] = {}
        columns = (message.system, message.prn, message.cn0_dbhz)
        for system, prn, cn0 in zip(*columns, strict=True):
            satellite = (system, prn)
            strongest[satellite] = max(strongest.get(satellite, 0.0), cn0)
        for (system, prn), cn0 in strongest.items():
            satellite_id = satellite_name(system, prn)
            self.scene.add("link", stamp, [cn0], craft=craft, satellite=satellite_id)
            self._satellites.need(system, prn, stamp)

    def _add_ephemeris(self, craft: str, stamp: int, message: Any) -> None:
        self._satellites.add_ephemeris(ephemeris_from_message(message))

    def _add_command(self, deputy: str, stamp: int, message: Any) -> None:
        self._add_thrust(deputy, "command", stamp, message)

    def _add_applied(self, deputy: str, stamp: int, message: Any) -> None:
        self._add_thrust(deputy, "applied", stamp, message)

    def _add_thrust(self, deputy: str, source: str, stamp: int, message: Any) -> None:
        linear = message.accel.linear
        row = [linear.x, linear.y, linear.z]
        self.scene.add("thrust", stamp, row, deputy=deputy, source=source)

    def _add_relative(self, deputy: str, source: str, stamp: int, message: Any) -> None:
        if message.child_frame_id != deputy:
            named = message.child_frame_id
            note = f"{source} of '{deputy}': a message names '{named}' and is left out"
            if note not in self.scene.notes:
                self.scene.notes.append(note)
            return
        estimated = source == "estimate"
        if estimated:
            self._note_solution(deputy, stamp, message.solution)
            if not self._take_slot(f"relative/{deputy}", stamp):
                return
        unusable = estimated and message.solution == RelativeState.SOLUTION_NONE
        if unusable or not np.isfinite(message.position).all():
            return
        row = [float(value) for value in message.position]
        self.scene.add("relative", stamp, row, deputy=deputy, source=source)
        covariance = np.asarray(message.covariance).reshape(6, 6)[:3, :3]
        if estimated and np.isfinite(covariance).all():
            upper = covariance[np.triu_indices(3)].tolist()
            self.scene.add("covariance", stamp, upper, deputy=deputy)

    def _note_solution(self, deputy: str, stamp: int, solution: int) -> None:
        """Keep changes of the kind of solution; a fix that is lost or found again is an event."""
        before = self._solutions.get(deputy)
        if before == solution:
            return
        self._solutions[deputy] = solution
        self.scene.add("solution", stamp, [float(solution)], deputy=deputy)
        fixed = RelativeState.SOLUTION_FIXED
        if before == fixed:
            text = f"{deputy}: integers lost, {_SOLUTIONS.get(solution, 'unknown')}"
            self.scene.note_event(stamp, "solution", text)
        elif solution == fixed:
            self.scene.note_event(stamp, "solution", f"{deputy}: integers fixed")

    def _add_density(self, deputy: str, stamp: int, message: Any) -> None:
        columns = zip(message.system, message.density, message.density_sigma, strict=True)
        combined = [(value, sigma) for system, value, sigma in columns if system == _ALL_SATELLITES]
        if not combined or not np.isfinite(message.position).all():
            return
        latitude, longitude, altitude = geodetic_from_itrf(np.asarray(message.position))
        place = [float(np.degrees(latitude)), float(np.degrees(longitude)), float(altitude)]
        values = [float(value) * _PER_CM3 for value in combined[-1]]
        self.scene.add("density", stamp, [*place, *values], deputy=deputy)

    def _add_safety(self, stamp: int, message: Any) -> None:
        self.scene.hard_radius = float(message.hard_radius)
        columns = (message.spacecraft, message.mode, message.isolated_axes, message.reason)
        for name, mode, axes, reason in zip(*columns, strict=True):
            series = self.scene.series.get(f"safety/{name}")
            if series is not None and [column[-1] for column in series.values] == [mode, axes]:
                continue
            self.scene.add("safety", stamp, [float(mode), float(axes)], deputy=name)
            if series is not None or mode or axes:
                text = f"{name}: {_MODES.get(mode, 'unknown mode')}"
                self.scene.note_event(stamp, "safety", f"{text}: {reason}" if reason else text)

    def _add_survey(self, stamp: int, message: Any) -> None:
        """Keep the walls of plasma; a plan or another phase is an event with its reason."""
        told = (message.phase, message.plans)
        if told != self._survey:
            self.scene.note_event(stamp, "survey", f"survey: {message.phase}, {message.reason}")
        self._survey = told
        columns = (message.wall_longitude_deg, message.wall_drift, message.wall_sigma)
        rows = [
            [longitude, *(math.degrees(value / WALL_RADIUS) for value in (drift, sigma))]
            for longitude, drift, sigma in zip(*columns, strict=True)
        ]
        # A wall that is given up has no longitude any more.
        rows += [[math.nan] * 3] * (len(self.scene.of_kind("wall")) - len(rows))
        for number, row in enumerate(rows, 1):
            self.scene.add("wall", stamp, row, source=str(number))

    def _add_diagnostics(self, stamp: int, message: Any) -> None:
        for status in message.status:
            before = self._faults.get(status.name)
            self._faults[status.name] = status.level
            failed = status.level >= DiagnosticStatus.ERROR
            if failed and before != status.level:
                self.scene.note_event(stamp, "fault", f"{status.name}: {status.message}")

    def _add_slant_tec(self, craft: str, stamp: int, message: Any) -> None:
        names = ("pierce_latitude_deg", "pierce_longitude_deg", "stec_tecu", "vtec_tecu")
        columns = [_column(message, name) for name in names]
        rejected = _column(message, "rejected")
        rows = zip(message.system, message.prn, rejected, *columns, strict=True)
        for system, prn, reason, *values in rows:
            if not reason > 0:  # NaN where another program has left the column out
                satellite = satellite_name(system, prn)
                self.scene.add("pierce", stamp, values, craft=craft, satellite=satellite)

    def _add_scintillation(self, craft: str, stamp: int, message: Any) -> None:
        corrected, s4 = _column(message, "s4_corrected"), _column(message, "s4")
        sigma_phi = _column(message, "sigma_phi")
        first: dict[str, list[float]] = {}
        for row, system in enumerate(message.system):
            satellite = satellite_name(int(system), int(message.prn[row]))
            value = corrected[row] if math.isfinite(corrected[row]) else s4[row]
            # The first signal of a satellite is L1, whose index the paper shows.
            first.setdefault(satellite, [value, sigma_phi[row]])
        for satellite, values in first.items():
            self.scene.add("scintillation", stamp, values, craft=craft, satellite=satellite)

    def _add_boundary(self, stamp: int, message: Any) -> None:
        position = [message.latitude_deg, message.longitude_deg, message.altitude]
        if not any(position):  # another program may give only the Cartesian position
            latitude, longitude, altitude = geodetic_from_itrf(np.asarray(message.position))
            position = [float(np.degrees(latitude)), float(np.degrees(longitude)), float(altitude)]
        craft = message.spacecraft or "formation"
        self.scene.add("boundary", stamp, [*position, float(message.entry)], craft=craft)
        what = "enters" if message.entry else "leaves"
        text = f"{craft}: {what} an irregularity at {position[2] / 1e3:.1f} km"
        self.scene.note_event(stamp, "edge", text)


def _column(message: Any, name: str) -> list[float]:
    """Return a column of a message; NaN where another program has left the column out."""
    column = getattr(message, name)
    count = len(message.system)
    return list(column) if len(column) == count else [math.nan] * count

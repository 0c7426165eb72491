"""Messages of a run -> `Scene`. Takes message objects, whether from a bag or from the air."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from vtff_analysis.recordings.topics import ESTIMATE_TOPIC, TARGET_TOPIC, TRUTH_TOPIC
from vtff_analysis.view.satellites import SatellitePositions
from vtff_analysis.view.scene import Scene
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.signals import satellite_name

_RELATIVE_SOURCES = {TRUTH_TOPIC: "truth", ESTIMATE_TOPIC: "estimate", TARGET_TOPIC: "target"}
_CRAFT_TOPIC = re.compile(
    r"^/(?P<craft>.+)/(?P<what>truth/orbit|gnss/fix|gnss/epoch|gnss/ephemeris"
    r"|control/thrust_command|propulsion/thrust_applied|iono/slant_tec|iono/scintillation)$"
)
_BOUNDARY_TOPIC = re.compile(r"boundar")

#: Topics whose every message counts, however dense the scene.
_NEVER_THINNED = re.compile(r"(/gnss/ephemeris|boundar\w*|/target)$")

_EPHEMERIS = "/gnss/ephemeris"
_EARTH_FRAME = "earth"
_STATUS_NONE = 0  # vtff_msgs/GnssFix.STATUS_NONE
_SOLUTION_NONE = 0  # vtff_msgs/RelativeState.SOLUTION_NONE

#: Shortest time between samples, s, and the number of samples beyond which it grows: plots are
#: a few hundred pixels wide, and the globe interpolates.
SHORTEST_INTERVAL = 1.0
LONGEST_SERIES = 2000
#: Slots of one sample begin this part of the interval early: stamps on whole seconds jitter.
_EARLY = 0.25

_NANOSECONDS = 1_000_000_000

Handler = Callable[[int, Any], None]


def sample_interval(duration: float) -> float:
    """Return the time between samples of a scene of this duration, whole s."""
    return max(SHORTEST_INTERVAL, float(math.ceil(duration / LONGEST_SERIES)))


class SceneBuilder:
    """Puts messages into a scene.

    Parameters
    ----------
    scene
        The scene; its start is that of the first message if it has none.
    interval
        Time for which one sample of each topic is kept, s.
    """

    def __init__(self, scene: Scene, interval: float = SHORTEST_INTERVAL) -> None:
        self.scene = scene
        self._slot = round(interval * _NANOSECONDS)
        self._newest: dict[str, int] = {}
        self._satellites = SatellitePositions(scene)

    def handler(self, topic: str) -> Handler | None:
        """Return what takes (time in ns since 1970, message) of a topic; None if not shown."""
        if topic in _RELATIVE_SOURCES:
            source = _RELATIVE_SOURCES[topic]
            return lambda stamp, message: self._relative(source, stamp, message)
        match = _CRAFT_TOPIC.match(topic)
        if match is not None:
            craft = match["craft"].replace("/", ".")
            put = {
                "truth/orbit": self._orbit,
                "gnss/fix": self._fix,
                "gnss/epoch": self._epoch,
                "gnss/ephemeris": self._ephemeris,
                "control/thrust_command": self._command,
                "propulsion/thrust_applied": self._applied,
                "iono/slant_tec": self._slant_tec,
                "iono/scintillation": self._scintillation,
            }[match["what"]]
            return lambda stamp, message: put(craft, stamp, message)
        if _BOUNDARY_TOPIC.search(topic):
            return self._boundary
        return None

    def wanted(self, topic: str, time: int) -> bool:
        """Tell whether a message of this time is kept, and count on it being given.

        The slots are the same for all topics, so that samples of one time stay together.

        Parameters
        ----------
        topic
            Its topic.
        time
            Log time or time of arrival in the scale of the stamps, ns since 1970.
        """
        slot = (time + round(_EARLY * self._slot)) // self._slot
        if self._newest.get(topic) == slot:
            return bool(_NEVER_THINNED.search(topic))
        self._newest[topic] = slot
        return True

    def put(self, topic: str, time: int, message: Any) -> None:
        """Hand a message to its handler; its own stamp counts, or `time` where it has none."""
        handler = self.handler(topic)
        if handler is None:
            return
        header = getattr(message, "header", None)
        stamp = int(header.stamp.sec) * _NANOSECONDS + int(header.stamp.nanosec) if header else 0
        stamp = stamp or time
        if topic.endswith(_EPHEMERIS):
            handler(stamp, message)  # received before the run, or one that holds for hours
            return
        if not self.scene.start:
            self.scene.start = stamp
        handler(stamp, message)
        self.scene.duration = max(self.scene.duration, self.scene.seconds(stamp))

    def finish(self) -> None:
        """Place the satellites up to the end of the scene."""
        self._satellites.extend()

    # ---- handlers ----------------------------------------------------------------------------

    def _orbit(self, craft: str, stamp: int, message: Any) -> None:
        state = np.concatenate((message.position, message.velocity))
        if not np.isfinite(state).all():
            return
        if message.header.frame_id != _EARTH_FRAME:
            state = state_gcrf_to_itrf(GpsTime.from_unix_nanoseconds(stamp), state)
        self.scene.add("orbit", stamp, state.tolist(), craft=craft, source="truth")

    def _fix(self, craft: str, stamp: int, message: Any) -> None:
        state = np.concatenate((message.position, message.velocity))
        if message.status == _STATUS_NONE or not np.isfinite(state).all():
            return
        self.scene.add("orbit", stamp, state.tolist(), craft=craft, source="receiver")

    def _epoch(self, craft: str, stamp: int, message: Any) -> None:
        strongest: dict[tuple[int, int], float] = {}
        columns = (message.system, message.prn, message.cn0_dbhz)
        for system, prn, cn0 in zip(*columns, strict=True):
            satellite = (system, prn)
            strongest[satellite] = max(strongest.get(satellite, 0.0), cn0)
        for (system, prn), cn0 in strongest.items():
            satellite_id = satellite_name(system, prn)
            self.scene.add("link", stamp, [cn0], craft=craft, satellite=satellite_id)
            self._satellites.need(system, prn, stamp)

    def _ephemeris(self, craft: str, stamp: int, message: Any) -> None:
        # Message packages are only needed where there are messages.
        from vtff_node.conversions.gnss import ephemeris_from_message

        self._satellites.add_ephemeris(ephemeris_from_message(message))

    def _command(self, deputy: str, stamp: int, message: Any) -> None:
        self._thrust(deputy, "command", stamp, message)

    def _applied(self, deputy: str, stamp: int, message: Any) -> None:
        self._thrust(deputy, "applied", stamp, message)

    def _thrust(self, deputy: str, source: str, stamp: int, message: Any) -> None:
        linear = message.accel.linear
        row = [linear.x, linear.y, linear.z]
        self.scene.add("thrust", stamp, row, deputy=deputy, source=source)

    def _relative(self, source: str, stamp: int, message: Any) -> None:
        unusable = source == "estimate" and message.solution == _SOLUTION_NONE
        if unusable or not np.isfinite(message.position).all():
            return
        deputy = message.child_frame_id or "deputy"
        row = [float(value) for value in message.position]
        self.scene.add("relative", stamp, row, deputy=deputy, source=source)

    def _slant_tec(self, craft: str, stamp: int, message: Any) -> None:
        names = ("pierce_latitude_deg", "pierce_longitude_deg", "stec_tecu", "vtec_tecu")
        columns = [_column(message, name) for name in names]
        rejected = _column(message, "rejected")
        rows = zip(message.system, message.prn, rejected, *columns, strict=True)
        for system, prn, reason, *values in rows:
            if not reason > 0:  # NaN where it is not told
                satellite = satellite_name(system, prn)
                self.scene.add("pierce", stamp, values, craft=craft, satellite=satellite)

    def _scintillation(self, craft: str, stamp: int, message: Any) -> None:
        corrected, s4 = _column(message, "s4_corrected"), _column(message, "s4")
        sigma_phi = _column(message, "sigma_phi")
        first: dict[str, list[float]] = {}
        for row, system in enumerate(message.system):
            satellite = satellite_name(int(system), int(message.prn[row]))
            value = corrected[row] if math.isfinite(corrected[row]) else s4[row]
            # Of several signals the first: that is L1, whose index the paper shows.
            first.setdefault(satellite, [value, sigma_phi[row]])
        for satellite, values in first.items():
            self.scene.add("scintillation", stamp, values, craft=craft, satellite=satellite)

    def _boundary(self, stamp: int, message: Any) -> None:
        place = [message.latitude_deg, message.longitude_deg, message.altitude]
        if not any(place):  # only the position may be given
            latitude, longitude, altitude = geodetic_from_itrf(np.asarray(message.position))
            place = [float(np.degrees(latitude)), float(np.degrees(longitude)), float(altitude)]
        craft = message.spacecraft or "formation"
        self.scene.add("boundary", stamp, [*place, float(message.entry)], craft=craft)


def _column(message: Any, name: str) -> list[float]:
    """Return a column as numbers; NaN where another program has left it out."""
    column = getattr(message, name)
    count = len(message.system)
    return list(column) if len(column) == count else [math.nan] * count

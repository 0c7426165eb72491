"""Publishes the decoded events of a receiver on its topics."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.publisher import Publisher

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix
from vtff_gnss.novatel import Event, IsmScintillation, IsmSlantTec, RawLog
from vtff_gnss.observations import ObservationEpoch
from vtff_msgs.msg import GlonassEphemeris as GlonassEphemerisMessage
from vtff_msgs.msg import (
    GnssEphemeris,
    GnssFix,
    GnssObservations,
    ReceiverLog,
    Scintillation,
    SlantTec,
)
from vtff_node.conversions.gnss import (
    ephemeris_to_message,
    fix_to_message,
    glonass_ephemeris_to_message,
    ism_scintillation_to_message,
    ism_slant_tec_to_message,
    observations_to_message,
    raw_log_to_message,
)
from vtff_node.node import CountingPublisher, VtffNode

__all__ = ["EventPublisher"]

#: Longest wait for the subscribers to have an ephemeris, s of wall time; only in lockstep.
ACKNOWLEDGE_LIMIT = 5.0


class EventPublisher:
    """Publishes the events of one receiver.

    The publishers for the logs of a GPStation-6 are made with the first such log.

    DDS keeps the order of a topic, not that of two topics: over a link that loses packets an
    ephemeris may come after the observations that need it. In lockstep observations are therefore
    published when all subscribers have the ephemerides before them, so that equal runs stay equal.

    Parameters
    ----------
    node : VtffNode
        Owns the publishers.
    frame_id : str
        Frame of observations and raw logs.
    publishes_raw : bool
        Publish gnss/raw.
    holds_epoch : bool
        Hold each gnss/epoch until `release_epoch` or the next observations, so that it is published
        after the ephemerides of its second and, in lockstep, after its fix.

    Attributes
    ----------
    published, left_out : dict of str to int
        Number of events that were published and that were not, by kind.
    """

    def __init__(
        self, node: VtffNode, frame_id: str, *, publishes_raw: bool, holds_epoch: bool
    ) -> None:
        self._node = node
        self._frame_id = frame_id
        self._holds_epoch = holds_epoch
        self._held: tuple[int, GnssObservations] | None = None
        #: Time of the last epoch, ns since 1980-01-06 (GPS); None if it had no signal.
        self._last_nanoseconds: int | None = None
        self.published = {"epochs": 0, "fixes": 0, "ephemerides": 0, "raw logs": 0}
        self.left_out = {"epochs repeated": 0}
        self._high_rate = node.publisher(GnssObservations, "gnss/high_rate")
        self._epoch = node.publisher(GnssObservations, "gnss/epoch")
        self._ephemeris = node.publisher(GnssEphemeris, "gnss/ephemeris")
        self._glonass_ephemeris = node.publisher(GlonassEphemerisMessage, "gnss/glonass_ephemeris")
        self._fix = node.publisher(GnssFix, "gnss/fix")
        self._raw = node.publisher(ReceiverLog, "gnss/raw") if publishes_raw else None
        self._ism_slant_tec: Publisher | None = None
        self._ism_scintillation: Publisher | None = None
        self._unconfirmed: set[CountingPublisher] = set()

    def publish(self, event: Event) -> None:
        """Publish an event; an event without a topic is ignored.

        Raises
        ------
        ValueError
            If the time of the event does not fit a stamp.
        """
        if isinstance(event, ObservationEpoch):
            self._publish_epoch(event)
        elif isinstance(event, Fix):
            self.published["fixes"] += 1
            self._fix.publish(fix_to_message(event))
        elif isinstance(event, BroadcastEphemeris):
            self.published["ephemerides"] += 1
            self._ephemeris.publish(ephemeris_to_message(event))
            self._unconfirmed.add(self._ephemeris)
        elif isinstance(event, GlonassEphemeris):
            self.published["ephemerides"] += 1
            self._glonass_ephemeris.publish(glonass_ephemeris_to_message(event))
            self._unconfirmed.add(self._glonass_ephemeris)
        elif isinstance(event, RawLog) and self._raw is not None:
            self.published["raw logs"] += 1
            self._raw.publish(raw_log_to_message(event, self._frame_id))
        elif isinstance(event, IsmSlantTec):
            self._publish_ism_slant_tec(event)
        elif isinstance(event, IsmScintillation):
            self._publish_ism_scintillation(event)

    def release_epoch(self, newest_second: int | None = None) -> None:
        """Publish the gnss/epoch that is held, if there is one.

        Parameters
        ----------
        newest_second
            Publish it only if it is of this or an earlier second, s since 1980-01-06 (GPS).
        """
        if self._held is None:
            return
        second, message = self._held
        if newest_second is None or second <= newest_second:
            self._held = None
            self._epoch.publish(message)

    def _publish_epoch(self, epoch: ObservationEpoch) -> None:
        nanoseconds = epoch.time.nanoseconds
        if nanoseconds == self._last_nanoseconds:
            # The same epoch came in a second format, e.g. RANGE and RANGECMP in one log. An epoch
            # without signals does not count: RANGECMP4 cannot be decoded without its reference.
            self.left_out["epochs repeated"] += 1
            return
        self.release_epoch()
        message = observations_to_message(epoch, self._frame_id)
        self._confirm_ephemerides()
        self._high_rate.publish(message)
        self._last_nanoseconds = nanoseconds if len(epoch) else None
        self.published["epochs"] += 1
        if nanoseconds % NANOSECONDS_PER_SECOND == 0:
            self._held = (nanoseconds // NANOSECONDS_PER_SECOND, message)
            if not self._holds_epoch:
                self.release_epoch()

    def _confirm_ephemerides(self) -> None:
        """In lockstep, wait until the subscribers have all ephemerides that were published."""
        if self._node.lockstep:
            for publisher in self._unconfirmed:
                publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_LIMIT))
        self._unconfirmed.clear()

    def _publish_ism_slant_tec(self, event: IsmSlantTec) -> None:
        if self._ism_slant_tec is None:
            self._ism_slant_tec = self._node.publisher(SlantTec, "gnss/ism/slant_tec")
        self._count("slant TEC of the receiver")
        self._ism_slant_tec.publish(ism_slant_tec_to_message(event, self._frame_id))

    def _publish_ism_scintillation(self, event: IsmScintillation) -> None:
        if self._ism_scintillation is None:
            self._ism_scintillation = self._node.publisher(Scintillation, "gnss/ism/scintillation")
        self._count("scintillation of the receiver")
        self._ism_scintillation.publish(ism_scintillation_to_message(event, self._frame_id))

    def _count(self, name: str) -> None:
        self.published[name] = self.published.get(name, 0) + 1

"""The logs of an emulated NovAtel receiver: when they can be sent, and from what they are made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeVar

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import (
    EPHEMERIS_SOURCE_FNAV,
    EPHEMERIS_SOURCE_INAV,
    EPHEMERIS_SOURCE_LNAV,
)
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel.encode.ephemeris import (
    encode_galileo_ephemeris,
    encode_gpsephem,
    encode_rawephem,
)
from vtff_gnss.novatel.encode.frame import HeaderSettings
from vtff_gnss.novatel.encode.range import encode_range_series, encode_rangecmp
from vtff_gnss.novatel.encode.rangecmp4 import RangeCmp4Encoder
from vtff_gnss.novatel.encode.solution import (
    ComponentVersion,
    IonosphereUtc,
    encode_bestxyz,
    encode_ionutc,
    encode_receiver_time,
    encode_version,
)
from vtff_gnss.observations import ObservationEpoch, ObservationSeries

EVENT_TRIGGERS = ("ONNEW", "ONCHANGED")
_Observations = TypeVar("_Observations", ObservationEpoch, ObservationSeries)
_SYNCHRONOUS = frozenset({"ONTIME", "ONCE"})
_ASYNCHRONOUS = frozenset({"ONTIME", "ONCE", *EVENT_TRIGGERS})


@dataclass(frozen=True, eq=False)
class EpochOfSeries:
    """One epoch of a series; the series is the same object for all of its epochs."""

    series: ObservationSeries
    index: int


class ReceiverOutputs(Protocol):
    """Data that a receiver has for its logs at some epochs; computed only when a log is due.

    What its messages tell does not change from the first to the last of these epochs.
    """

    def observations(self, time: GpsTime) -> EpochOfSeries:
        """Return the observations of the epoch, with those of the epochs around it."""

    def fix(self, time: GpsTime) -> Fix:
        """Return the navigation solution of the epoch."""

    def receiver_time(self, time: GpsTime) -> ReceiverTime:
        """Return the estimate of the receiver clock at the epoch."""

    def ephemerides(self, time: GpsTime) -> Sequence[BroadcastEphemeris]:
        """Return the ephemerides that the receiver holds; the same object while none comes."""

    def ionosphere_utc(self, time: GpsTime) -> Sequence[IonosphereUtc]:
        """Return the ionosphere model, or nothing; the same object while it does not change."""


class LogContext(NamedTuple):
    """Header fields common to all logs of an epoch; `time` is None before the first epoch."""

    time: GpsTime | None
    settings: HeaderSettings
    time_status: int
    receiver_status: int
    versions: Sequence[ComponentVersion]


LogEncoder = Callable[[Any, LogContext], bytes]


@dataclass(frozen=True)
class LogDefinition:
    """Encoding of a log, and its triggers.

    Parameters
    ----------
    name : str
        Without format suffix.
    triggers : frozenset of str
        Triggers that a LOG command may name.
    items : callable
        ``items(outputs, time)`` returns the data to encode.
    accepts : callable or None
        Returns whether an item belongs to this log; None: every item. An item is one frame.
    make_encoder : callable
        Returns the encoder of one series of the log: ``encoder(item, context)`` is a frame.
    is_static : bool
        The log needs no epoch: ONCE is answered at once.
    """

    name: str
    triggers: frozenset[str]
    items: Callable[[ReceiverOutputs, GpsTime], Sequence[Any]]
    make_encoder: Callable[[], LogEncoder]
    accepts: Callable[[Any], bool] | None = None
    is_static: bool = False


class _RangeEncoder:
    """Encoder of RANGE: encodes a whole series at its first epoch."""

    def __init__(self) -> None:
        self._series: ObservationSeries | None = None
        self._receiver_status = 0
        self._frames: list[bytes] = []

    def __call__(self, item: EpochOfSeries, context: LogContext) -> bytes:
        """Return the frame of an epoch."""
        if item.series is not self._series or context.receiver_status != self._receiver_status:
            self._series = item.series
            self._receiver_status = context.receiver_status
            series = _with_status(item.series, context.receiver_status)
            self._frames = encode_range_series(series, context.settings)
        return self._frames[item.index]


def _rangecmp(item: EpochOfSeries, context: LogContext) -> bytes:
    series, index = item.series, item.index
    channel = None if series.channel is None else series.channel[index][series.is_observed[index]]
    epoch = _with_status(series.epoch(index), context.receiver_status)
    return encode_rangecmp(epoch, context.settings, channel)


def _rangecmp4_encoder() -> LogEncoder:
    rangecmp4 = RangeCmp4Encoder()

    def encoder(item: EpochOfSeries, context: LogContext) -> bytes:
        epoch = _with_status(item.series.epoch(item.index), context.receiver_status)
        return rangecmp4.encode(epoch, context.settings)

    return encoder


def _observations(outputs: ReceiverOutputs, time: GpsTime) -> tuple[EpochOfSeries]:
    return (outputs.observations(time),)


def _with_status(observations: _Observations, receiver_status: int) -> _Observations:
    """Return observations with further bits in the status of the receiver."""
    status = observations.receiver_status | receiver_status
    if status == observations.receiver_status:
        return observations
    return replace(observations, receiver_status=status)


def _ephemeris_log(
    name: str,
    source: int,
    encode: Callable[[BroadcastEphemeris, HeaderSettings, int], bytes],
) -> LogDefinition:
    def encoder(ephemeris: BroadcastEphemeris, context: LogContext) -> bytes:
        return encode(ephemeris, context.settings, context.receiver_status)

    def accepts(ephemeris: BroadcastEphemeris) -> bool:
        return ephemeris.source == source

    return LogDefinition(
        name, _ASYNCHRONOUS, lambda o, t: o.ephemerides(t), lambda: encoder, accepts
    )


def _bestxyz(fix: Fix, context: LogContext) -> bytes:
    return encode_bestxyz(fix, context.settings, context.time_status, context.receiver_status)


def _time(receiver_time: ReceiverTime, context: LogContext) -> bytes:
    return encode_receiver_time(
        receiver_time, context.settings, context.time_status, context.receiver_status
    )


def _ionutc(parameters: IonosphereUtc, context: LogContext) -> bytes:
    if context.time is None:
        raise ValueError("IONUTC: no epoch yet")
    return encode_ionutc(
        parameters, context.time, context.settings, context.time_status, context.receiver_status
    )


def _version(_item: object, context: LogContext) -> bytes:
    return encode_version(
        context.versions,
        context.time,
        context.settings,
        context.time_status,
        context.receiver_status,
    )


LOG_DEFINITIONS: tuple[LogDefinition, ...] = (
    LogDefinition("RANGE", _SYNCHRONOUS, _observations, _RangeEncoder),
    LogDefinition("RANGECMP", _SYNCHRONOUS, _observations, lambda: _rangecmp),
    LogDefinition("RANGECMP4", _SYNCHRONOUS, _observations, _rangecmp4_encoder),
    LogDefinition("BESTXYZ", _SYNCHRONOUS, lambda o, t: (o.fix(t),), lambda: _bestxyz),
    LogDefinition("IONUTC", _ASYNCHRONOUS, lambda o, t: o.ionosphere_utc(t), lambda: _ionutc),
    _ephemeris_log("RAWEPHEM", EPHEMERIS_SOURCE_LNAV, encode_rawephem),
    _ephemeris_log("GPSEPHEM", EPHEMERIS_SOURCE_LNAV, encode_gpsephem),
    _ephemeris_log("GALINAVEPHEMERIS", EPHEMERIS_SOURCE_INAV, encode_galileo_ephemeris),
    _ephemeris_log("GALFNAVEPHEMERIS", EPHEMERIS_SOURCE_FNAV, encode_galileo_ephemeris),
    LogDefinition("VERSION", _SYNCHRONOUS, lambda o, t: (None,), lambda: _version, is_static=True),
    LogDefinition("TIME", _SYNCHRONOUS, lambda o, t: (o.receiver_time(t),), lambda: _time),
)
"""All logs, in the order in which those of one epoch are sent; TIME last, so that it marks the end
of an epoch."""

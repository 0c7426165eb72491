"""Continuous arcs of carrier phase: where a cycle slip is possible, an arc ends.

An arc is broken, never repaired: in scintillation a wrong guess of the lost cycles would make the
electron content wrong for the rest of the arc. The tests follow in this order. A sample that fails
one of them breaks all links of its satellite, because the links of a satellite share signals:

1. the receiver reports it: lock lost, half a cycle changed, a lock time shorter than the time since
   the last sample;
2. a gap longer than the settings allow (this one breaks its own link only);
3. geometry-free: the phase content jumps away from its prediction (a filter of value and rate);
4. Melbourne-Wuebbena: the wide lane, averaged over a short time, leaves its mean;
5. closure: two links of the satellite that share the first signal see the same ionosphere, so the
   difference of their contents hardly changes, whatever the ionosphere does.

The limits of test 3 grow with the interval of the samples: 0.15 TECU at 20 Hz detects every slip of
integer cycles that changes the content by 0.24 TECU or more, while a wall of a plasma bubble that
is crossed at 7.5 km/s changes it by 0.08 TECU at most. At 30 s on the ground the ionosphere moves
more than the smallest slips, and so does scintillation from sample to sample where it decorrelates
within some of them: the limit follows the scatter of the innovations up to a cap, which is half of
what a cycle of one signal makes at least.

References
----------
Blewitt (1990), An automatic editing algorithm for GPS data, Geophys. Res. Lett. 17(3), 199-202
(tests 3 and 4; here both are recursive, for any sample rate).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.compiled import compiled
from vtff_iono.links.signal_pairs import PairRows

__all__ = [
    "LOCK_INTERVAL_MARGIN",
    "LOCK_TIME_MARGIN",
    "ArcBreak",
    "ArcDetector",
    "ArcSettings",
    "Arcs",
    "arc_keys",
]


class ArcBreak(enum.IntEnum):
    """Reason for which a new arc begins with a sample."""

    NONE = 0
    """The sample continues an arc, or belongs to no arc."""
    START = 1
    """First sample of the link, or first sample after samples without a valid phase."""
    GAP = 2
    """The link had no sample for longer than the settings allow."""
    LOCK = 3
    """The receiver lost lock or its lock time began anew."""
    HALF_CYCLE = 4
    """The receiver added or removed half a cycle."""
    GEOMETRY_FREE = 5
    """The phase content jumped away from its prediction."""
    WIDE_LANE = 6
    """The wide lane left its mean."""
    OTHER_LINK = 7
    """A test detected a slip in another link of the satellite."""
    CLOSURE = 8
    """The content departed from that of another link with the same first signal."""


class ArcSettings(NamedTuple):
    """Limits of the tests. The compiled loops read them by name.

    Attributes
    ----------
    gap_intervals : float
        A gap is longer than this many sample intervals ...
    gap : float
        ... and longer than this time, s.
    jump_tecu, jump_rate : float
        Smallest limit of the geometry-free test: TECU, plus TECU/s times the sample interval.
    cap_tecu, cap_rate : float
        Largest limit of the geometry-free test: TECU, plus TECU/s times the sample interval.
    scatter_cap : float
        Largest limit where the innovations scatter, TECU, if the cap above is not larger.
    jump_sigmas : float
        Between the smallest and the largest limit, the limit is this many times the scatter of the
        innovations.
    scatter_time : float
        An arc that begins within this time of the end of another, s, begins with its scatter.
    wide_lane_cycles, wide_lane_sigmas : float
        Limit of the Melbourne-Wuebbena test: the larger of a number of cycles and a number of
        standard deviations.
    wide_lane_average : float
        Time over which the wide lane is averaged for the test, s.
    closure_tecu, closure_sigmas : float
        Limit of the closure test: the larger of a content, TECU, and a number of standard
        deviations.
    closure_average : float
        Time over which the mean of the closure follows the slow changes of the hardware, s.
    """

    gap_intervals: float = 2.5
    gap: float = 1.5
    jump_tecu: float = 0.15
    jump_rate: float = 0.03
    cap_tecu: float = 0.18
    cap_rate: float = 0.25
    scatter_cap: float = 0.9
    jump_sigmas: float = 5.5
    scatter_time: float = 5.0
    wide_lane_cycles: float = 0.6
    wide_lane_sigmas: float = 5.0
    wide_lane_average: float = 3.0
    closure_tecu: float = 0.15
    closure_sigmas: float = 5.5
    closure_average: float = 60.0


@dataclass(frozen=True, eq=False)
class Arcs:
    """Arcs of rows; all arrays have shape (n,).

    Parameters
    ----------
    number : ndarray of int64
        Number of the arc within its link, from 1; 0 where the phase cannot be used.
    break_reason : ndarray of int64
        `ArcBreak` at the first sample of an arc; 0 at all others.
    """

    number: npt.NDArray[np.int64]
    break_reason: npt.NDArray[np.int64]


# More arcs than a link has.
_ARCS_OF_LINK = 2**32


def arc_keys(link: npt.NDArray[np.int64], arc: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return one integer for each arc of each link, from the numbers of link and arc."""
    return link * _ARCS_OF_LINK + arc


# Columns of the state of a link: its arc, the filter of the phase content, and what the receiver
# reported with the last sample; then the wide lane; then the closure; then whether the scatter was
# that of the arc before.
_ARC, _TIME, _VALUE, _RATE, _COUNT, _SCATTER, _HALF, _LOCK = range(8)
_WIDE_FAST, _WIDE_MEAN, _WIDE_SPREAD, _WIDE_COUNT = range(8, 12)
_CLOSURE_MEAN, _CLOSURE_SPREAD, _CLOSURE_COUNT = range(12, 15)
_HAS_SCATTER = 15
_STATE_COLUMNS = 16
# Elements of the state of the detector: time of the last epoch, shortest interval of epochs.
_LAST_EPOCH, _NOMINAL = range(2)

# Gains of the filter that predicts the content: critically damped, with a memory of some samples.
_GAIN_VALUE = 0.5
_GAIN_RATE = 0.2
_SETTLING_SAMPLES = 4
# Number of samples over which the scatter of the innovations is averaged.
_SCATTER_MEMORY = 30.0
# Number of samples before the spread of the wide lane can be trusted, and the time over which its
# mean is formed, s.
_WIDE_LANE_SETTLING = 20
_WIDE_LANE_MEMORY = 1800.0
# Lock times are rounded to 1/32 s in compressed logs, sample times to the epoch: a lock time is
# too short only if it falls short by more than these margins, s.
LOCK_TIME_MARGIN = 0.05
LOCK_INTERVAL_MARGIN = 0.1


class ArcDetector:
    """Divides the rows of links into arcs.

    Parameters
    ----------
    settings : ArcSettings
    """

    def __init__(self, settings: ArcSettings = ArcSettings()) -> None:  # noqa: B008 - immutable
        self._settings = settings
        self._states = np.zeros((0, _STATE_COLUMNS))
        self._satellite_slipped = np.zeros(0, dtype=np.bool_)
        self._epochs = np.zeros(2)

    def update(self, rows: PairRows) -> Arcs:
        """Return the arcs of rows; these must be one or more whole epochs in order of time."""
        self._make_room(rows)
        number, break_reason = _divide_into_arcs(
            rows.time,
            rows.link,
            rows.satellite,
            rows.row_first,
            rows.stec_phase_tecu,
            rows.wide_lane_cycles,
            rows.lock_time,
            rows.phase_valid,
            rows.code_valid,
            rows.lock_lost,
            rows.half_cycle,
            self._settings,
            self._states,
            self._satellite_slipped,
            self._epochs,
        )
        return Arcs(number, break_reason)

    def _make_room(self, rows: PairRows) -> None:
        """Append states for the links and satellites that appear for the first time."""
        if len(rows) == 0:
            return
        missing = int(rows.link.max()) + 1 - len(self._states)
        if missing > 0:
            self._states = np.concatenate((self._states, np.zeros((missing, _STATE_COLUMNS))))
        missing = int(rows.satellite.max()) + 1 - len(self._satellite_slipped)
        if missing > 0:
            self._satellite_slipped = np.concatenate(
                (self._satellite_slipped, np.zeros(missing, dtype=np.bool_))
            )


@compiled
def _largest_limit(interval, settings):  # type: ignore[no-untyped-def]
    """Return the jump of the content that no ionosphere makes within an interval, TECU."""
    return settings.cap_tecu + settings.cap_rate * interval


@compiled
def _geometry_free_limit(state, interval, settings):  # type: ignore[no-untyped-def]
    """Return how far a content may be from its prediction, TECU."""
    largest = _largest_limit(interval, settings)
    scatter_limit = settings.jump_sigmas * np.sqrt(state[_SCATTER])
    # Until the filter has settled, only what no ionosphere does is a jump.
    if state[_COUNT] <= _SETTLING_SAMPLES:
        return max(largest, min(scatter_limit, settings.scatter_cap))
    smallest = settings.jump_tecu + settings.jump_rate * interval
    return min(max(smallest, scatter_limit), max(largest, smallest, settings.scatter_cap))


@compiled
def _wide_lane_slips(state, interval, wide_lane, settings):  # type: ignore[no-untyped-def]
    """Return whether a sample moves the short average of the wide lane too far from its mean."""
    gain = min(1.0, interval / settings.wide_lane_average)
    fast = state[_WIDE_FAST] + gain * (wide_lane - state[_WIDE_FAST])
    spread = np.sqrt(state[_WIDE_SPREAD])
    if state[_WIDE_COUNT] < _WIDE_LANE_SETTLING:
        spread = max(spread, settings.wide_lane_cycles)
    limit = max(settings.wide_lane_cycles, settings.wide_lane_sigmas * spread)
    return abs(fast - state[_WIDE_MEAN]) > limit


@compiled
def _classify_sample(  # type: ignore[no-untyped-def]
    state, interval, content, wide_lane, lock_time, has_code, lost, half, nominal, settings
):
    """Return the `ArcBreak` that a sample calls for; NONE if it continues the arc."""
    if state[_COUNT] == 0.0:
        return ArcBreak.START
    if (
        lost
        or lock_time < state[_LOCK] - LOCK_TIME_MARGIN
        or lock_time < interval - LOCK_INTERVAL_MARGIN
    ):
        return ArcBreak.LOCK
    if half != state[_HALF]:
        return ArcBreak.HALF_CYCLE
    if interval > settings.gap and interval > settings.gap_intervals * nominal:
        return ArcBreak.GAP
    # The wide lane is tested first: a slip that it shows is certain, while a jump of the content
    # alone may be the ionosphere.
    if has_code and state[_WIDE_COUNT] >= 2.0:
        if _wide_lane_slips(state, interval, wide_lane, settings):
            return ArcBreak.WIDE_LANE
    jump = abs(content - state[_VALUE] - state[_RATE] * interval)
    if jump > _geometry_free_limit(state, interval, settings):
        return ArcBreak.GEOMETRY_FREE
    return ArcBreak.NONE


@compiled
def _is_slip(break_reason):  # type: ignore[no-untyped-def]
    """Return whether a break is one that the other links of the satellite share."""
    return (
        break_reason != ArcBreak.NONE
        and break_reason != ArcBreak.START
        and break_reason != ArcBreak.GAP
    )


@compiled
def _begin_arc(  # type: ignore[no-untyped-def]
    state, interval, content, wide_lane, has_code, half, settings
):
    """Reset the state of a link to the first sample of a new arc."""
    arc = state[_ARC] + 1.0
    scatter = state[_SCATTER] if interval <= settings.scatter_time else 0.0
    state[:] = 0.0
    state[_SCATTER] = scatter
    state[_HAS_SCATTER] = scatter > 0.0
    state[_ARC] = arc
    state[_COUNT] = 1.0
    state[_VALUE] = content
    state[_HALF] = half
    if has_code:
        _update_wide_lane(state, 1.0, wide_lane, settings)


@compiled
def _continue_arc(state, interval, content, wide_lane, has_code, settings):  # type: ignore[no-untyped-def]
    """Add a sample of the same arc to the state of its link."""
    count = state[_COUNT]
    innovation = content - state[_VALUE] - state[_RATE] * interval
    if count == 1.0:
        state[_RATE] = innovation / interval
        state[_VALUE] = content
    else:
        # The first gains are those of a straight line through all samples so far.
        gain_value = max(_GAIN_VALUE, 2.0 * (2.0 * count + 1.0) / ((count + 1.0) * (count + 2.0)))
        gain_rate = max(_GAIN_RATE, 6.0 / ((count + 1.0) * (count + 2.0)))
        state[_VALUE] += state[_RATE] * interval + gain_value * innovation
        state[_RATE] += gain_rate * innovation / interval
        if count >= _SETTLING_SAMPLES:
            gain_scatter = 1.0 / _SCATTER_MEMORY
            if not state[_HAS_SCATTER]:
                gain_scatter = max(gain_scatter, 1.0 / (count - _SETTLING_SAMPLES + 1.0))
            state[_SCATTER] += gain_scatter * (innovation * innovation - state[_SCATTER])
    state[_COUNT] = count + 1.0
    if has_code:
        _update_wide_lane(state, interval, wide_lane, settings)


@compiled
def _update_wide_lane(state, interval, wide_lane, settings):  # type: ignore[no-untyped-def]
    """Update the short and the long mean of the wide lane, and the spread of their difference."""
    count = state[_WIDE_COUNT]
    if count == 0.0:
        state[_WIDE_FAST] = state[_WIDE_MEAN] = wide_lane
        state[_WIDE_SPREAD] = 0.0
    else:
        gain_fast = max(min(1.0, interval / settings.wide_lane_average), 1.0 / (count + 1.0))
        state[_WIDE_FAST] += gain_fast * (wide_lane - state[_WIDE_FAST])
        deviation = state[_WIDE_FAST] - state[_WIDE_MEAN]
        gain_mean = max(1.0 / (count + 1.0), min(1.0, interval / _WIDE_LANE_MEMORY))
        state[_WIDE_MEAN] += gain_mean * (wide_lane - state[_WIDE_MEAN])
        state[_WIDE_SPREAD] += gain_mean * (deviation * deviation - state[_WIDE_SPREAD])
    state[_WIDE_COUNT] = count + 1.0


@compiled
def _check_closure(state, interval, closure, settings):  # type: ignore[no-untyped-def]
    """Return whether a closure is near its mean; if so, the mean and its spread are updated."""
    count = state[_CLOSURE_COUNT]
    if count == 0.0:
        state[_CLOSURE_MEAN] = closure
        state[_CLOSURE_COUNT] = 1.0
        return True
    deviation = closure - state[_CLOSURE_MEAN]
    limit = max(settings.closure_tecu, settings.closure_sigmas * np.sqrt(state[_CLOSURE_SPREAD]))
    if abs(deviation) > limit:
        return False
    gain = max(1.0 / (count + 1.0), min(1.0, interval / settings.closure_average))
    state[_CLOSURE_MEAN] += gain * deviation
    state[_CLOSURE_SPREAD] += gain * (deviation * deviation - state[_CLOSURE_SPREAD])
    state[_CLOSURE_COUNT] = count + 1.0
    return True


@compiled
def _first_row_with_signal(row_first, row, epoch_start):  # type: ignore[no-untyped-def]
    """Return the first of the rows just before `row` that share its first signal."""
    reference = row
    while reference > epoch_start and row_first[reference - 1] == row_first[row]:
        reference -= 1
    return reference


@compiled
def _follow_epochs(time, epochs):  # type: ignore[no-untyped-def]
    """Keep the time of the last epoch, ns, and the shortest interval of epochs so far, s."""
    since_last = 1e-9 * (time - epochs[_LAST_EPOCH])
    if epochs[_LAST_EPOCH] > 0.0 and (epochs[_NOMINAL] == 0.0 or since_last < epochs[_NOMINAL]):
        epochs[_NOMINAL] = since_last
    epochs[_LAST_EPOCH] = time


@compiled
def _divide_into_arcs(  # type: ignore[no-untyped-def]
    time,
    link,
    satellite,
    row_first,
    content,
    wide_lane,
    lock_time,
    phase_valid,
    code_valid,
    lock_lost,
    half_cycle,
    settings,
    states,
    satellite_slipped,
    epochs,
):
    """Return the number of the arc and the reason of its beginning for each row.

    `states` and `epochs` are updated; `satellite_slipped` is scratch, False before and after.
    """
    count = len(time)
    number = np.zeros(count, dtype=np.int64)
    reason = np.zeros(count, dtype=np.int64)
    start = 0
    while start < count:
        _follow_epochs(time[start], epochs)
        end = start
        # All samples of the epoch are classified first: a slip of one link breaks the others.
        while end < count and time[end] == time[start]:
            if link[end] >= 0 and phase_valid[end]:
                state = states[link[end]]
                interval = 1e-9 * (time[end] - state[_TIME])
                reason[end] = _classify_sample(
                    state,
                    interval,
                    content[end],
                    wide_lane[end],
                    lock_time[end],
                    code_valid[end],
                    lock_lost[end],
                    half_cycle[end],
                    epochs[_NOMINAL],
                    settings,
                )
                reference = _first_row_with_signal(row_first, end, start)
                if (
                    reference < end
                    and reason[end] == ArcBreak.NONE
                    and reason[reference] == ArcBreak.NONE
                    and phase_valid[reference]
                    and not _check_closure(
                        state, interval, content[end] - content[reference], settings
                    )
                ):
                    reason[end] = ArcBreak.CLOSURE
                if _is_slip(reason[end]):
                    satellite_slipped[satellite[end]] = True
            end += 1
        for row in range(start, end):
            if link[row] < 0:
                continue
            state = states[link[row]]
            if not phase_valid[row]:
                state[_COUNT] = 0.0
                continue
            if satellite_slipped[satellite[row]] and reason[row] == ArcBreak.NONE:
                reason[row] = ArcBreak.OTHER_LINK
            has_code = code_valid[row]
            interval = 1e-9 * (time[row] - state[_TIME])
            if reason[row] != ArcBreak.NONE:
                _begin_arc(
                    state,
                    interval,
                    content[row],
                    wide_lane[row],
                    has_code,
                    half_cycle[row],
                    settings,
                )
            else:
                _continue_arc(state, interval, content[row], wide_lane[row], has_code, settings)
            state[_TIME] = time[row]
            state[_LOCK] = lock_time[row]
            number[row] = int(state[_ARC])
        for row in range(start, end):
            satellite_slipped[satellite[row]] = False
        start = end
    return number, reason
